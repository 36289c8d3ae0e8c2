//! Openings and their doors.

use glam::DVec2;
use serde_spanned::Spanned;

use super::values::{Limits, Names, choice, choice_or, number_or, unknown};
use crate::error::{Result, Warning};
use crate::scene::locate::Locator;
use crate::scene::materials::Palette;
use crate::scene::polygon;
use crate::scene::room_file::{DoorTable, OpeningTable};
use crate::scene::{BoxRoom, Face, Frame, Host, Leaf, Opening, Wall};

/// Narrowest opening in m.
const NARROWEST_M: f64 = 1e-6;
/// Lengths that differ by less are equal, in m.
const SLACK_M: f64 = 1e-6;

/// Holes in walls and box faces.
pub(super) fn openings(
    tables: &[Spanned<OpeningTable>],
    boxes: &[BoxRoom],
    walls: &[Wall],
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Opening>> {
    let mut names = Names::new("opening", at);
    let mut openings: Vec<Opening> = Vec::with_capacity(tables.len());
    for table in tables {
        let opening = one_opening(table.get_ref(), &mut names, boxes, walls, palette, at)?;
        for other in openings.iter().filter(|other| other.host == opening.host) {
            let common = |a: [f64; 2], b: [f64; 2]| a[1].min(b[1]) - a[0].max(b[0]);
            let (x, y) = (common(opening.hole_x_m, other.hole_x_m), common(opening.y_m, other.y_m));
            if x > SLACK_M && y > SLACK_M {
                return Err(at.error(
                    table.get_ref().x_m.span(),
                    format!("opening `{}` overlaps opening `{}` in the same wall", opening.name, other.name),
                    "make one opening of them, or move their limits apart",
                ));
            }
            let x = common(opening.open_x_m, other.open_x_m);
            let touch = x.min(y) >= -SLACK_M && !opening.is_closed() && !other.is_closed();
            if touch {
                warnings.push(Warning {
                    observation: format!("the openings `{}` and `{}` touch", opening.name, other.name),
                    remedy: "there is no bar between them: make one opening of them".to_owned(),
                });
            }
        }
        openings.push(opening);
    }
    Ok(openings)
}

/// The host called `name`, its frame and what of its plane it is.
fn host<'w>(
    name: &Spanned<String>,
    boxes: &[BoxRoom],
    walls: &'w [Wall],
    at: &Locator<'_>,
) -> Result<(Host, Frame, Plane<'w>)> {
    if let Some(index) = walls.iter().position(|wall| wall.name == *name.get_ref()) {
        let wall = &walls[index];
        let plane = if wall.unbounded { Plane::Unbounded } else { Plane::Polygon(wall) };
        return Ok((Host::Wall(index), wall.frame, plane));
    }
    if let Some((box_name, face_name)) = name.get_ref().rsplit_once('.')
        && let Some(index) = boxes.iter().position(|room| room.name == box_name)
    {
        let words = Face::ALL.map(|face| (face.name(), face));
        let face = choice(&Spanned::new(name.span(), face_name.to_owned()), "the face of the box", &words, at)?;
        let room = &boxes[index];
        if room.face(face).is_none() {
            return Err(at.error(
                name.span(),
                format!("the face {face_name} of box `{box_name}` is \"none\", there is nothing to cut a hole into"),
                "a removed face is open already; for a smaller hole give the face a material",
            ));
        }
        return Ok((Host::BoxFace(index, face), room.face_frame(face), Plane::Rectangle(room.face_size_m(face))));
    }
    let faces = boxes.iter().flat_map(|room| Face::ALL.map(|face| format!("{}.{}", room.name, face.name())));
    let all: Vec<String> = walls.iter().map(|wall| wall.name.clone()).chain(faces).collect();
    Err(unknown(name, "wall", all.iter().map(String::as_str), at))
}

/// What an opening must lie in.
enum Plane<'w> {
    /// All of it is wall.
    Unbounded,
    /// A wall's outline.
    Polygon(&'w Wall),
    /// A box face from (0, 0) to these lengths in m.
    Rectangle([f64; 2]),
}

impl Plane<'_> {
    /// The outline in local coordinates; empty if there is none.
    fn outline(&self) -> Vec<DVec2> {
        match self {
            Plane::Unbounded => Vec::new(),
            Plane::Polygon(wall) => wall.outline_m(),
            Plane::Rectangle([w, h]) => {
                vec![DVec2::ZERO, DVec2::new(*w, 0.0), DVec2::new(*w, *h), DVec2::new(0.0, *h)]
            }
        }
    }
}

fn one_opening(
    table: &OpeningTable,
    names: &mut Names<'_>,
    boxes: &[BoxRoom],
    walls: &[Wall],
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
) -> Result<Opening> {
    let name = names.add(&table.name)?;
    let (host, frame, plane) = host(&table.wall, boxes, walls, at)?;
    let unbounded = matches!(plane, Plane::Unbounded);
    let mut hole_x_m = limits(&table.x_m, "x_m", unbounded, at)?;
    let mut y_m = match &table.y_m {
        Some(y_m) => limits(y_m, "y_m", unbounded, at)?,
        None if unbounded => [f64::NEG_INFINITY, f64::INFINITY],
        None => {
            return Err(at.error(
                table.name.span(),
                format!("opening `{name}` lacks y_m"),
                "only on an unbounded wall it may be left out: an infinitely long slit",
            ));
        }
    };
    if hole_x_m == [f64::NEG_INFINITY, f64::INFINITY] {
        return Err(at.error(
            table.x_m.span(),
            format!("opening `{name}` is unlimited along local x, must end on one side at least"),
            if y_m[0].is_finite() || y_m[1].is_finite() {
                "order the wall's corners so that the slit runs along local y"
            } else {
                "it would leave nothing of the wall"
            },
        ));
    }
    let outline = plane.outline();
    if !unbounded {
        let low = outline.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = outline.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        if !polygon::contains_rectangle(&outline, hole_x_m, y_m, SLACK_M) {
            return Err(at.error(
                table.x_m.span(),
                format!(
                    "opening `{name}` (x {} to {}, y {} to {} m) reaches beyond `{}`, whose local x goes from {} to {} and y from {} to {} m",
                    hole_x_m[0], hole_x_m[1], y_m[0], y_m[1], table.wall.get_ref(),
                    tidy(low.x), tidy(high.x), tidy(low.y), tidy(high.y)
                ),
                "local x runs from corner 1 towards corner 2; on box faces along the increasing world axes",
            ));
        }
        hole_x_m = snapped(hole_x_m, [low.x, high.x]);
        y_m = snapped(y_m, [low.y, high.y]);
    }
    let (open_x_m, leaf) = match &table.door {
        None => (hole_x_m, None),
        Some(door) => leaf(door.get_ref(), hole_x_m, palette, at)?,
    };
    Ok(Opening { name, host, frame, hole_x_m, y_m, open_x_m, leaf })
}

/// A length for people: without the noise of rounding.
fn tidy(length_m: f64) -> f64 {
    (length_m * 1e6).round() / 1e6 + 0.0
}

/// Limits that differ from the host's only by rounding, made equal to them.
fn snapped(limits: [f64; 2], [low, high]: [f64; 2]) -> [f64; 2] {
    let [from, to] = limits;
    [if from < low + SLACK_M { low } else { from }, if to > high - SLACK_M { high } else { to }]
}

/// Two ascending limits; infinite ones only on an unbounded wall.
fn limits(value: &Spanned<[f64; 2]>, key: &str, unbounded: bool, at: &Locator<'_>) -> Result<[f64; 2]> {
    let [from, to] = *value.get_ref();
    let wrong = |message: String, hint: &str| Err(at.error(value.span(), message, hint));
    if from.is_nan() || to.is_nan() {
        return wrong(format!("{key} is [{from}, {to}], must be numbers"), "");
    }
    if !(unbounded || from.is_finite() && to.is_finite()) {
        return wrong(
            format!("{key} is [{from}, {to}], must be finite"),
            "inf is allowed on a wall with unbounded = true",
        );
    }
    if !(from.is_infinite() || from.abs() <= super::values::FARTHEST_M)
        || !(to.is_infinite() || to.abs() <= super::values::FARTHEST_M)
    {
        return wrong(format!("{key} is [{from}, {to}], must lie within {} m", super::values::FARTHEST_M), "");
    }
    // Not `to - from`, which is not a number for equal infinities.
    if !(to >= from + NARROWEST_M && to > from) {
        return wrong(
            format!("{key} is [{from}, {to}], must go up by at least {NARROWEST_M} m"),
            "a closed door is an opening with door = { kind = \"sliding\", open_m = 0 }",
        );
    }
    Ok([from, to])
}

/// What a door leaves open, and its leaf if that covers anything.
fn leaf(
    door: &DoorTable,
    hole_x_m: [f64; 2],
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
) -> Result<([f64; 2], Option<Leaf>)> {
    if let Some(kind) = &door.kind {
        choice(kind, "kind", &[("sliding", ())], at)?;
    }
    let [x_min, x_max] = hole_x_m;
    if !(x_min.is_finite() && x_max.is_finite()) {
        return Err(at.error(
            door.open_m.span(),
            format!("a door needs an opening of finite width, this one goes from {x_min} to {x_max} m"),
            "give x_m two finite limits",
        ));
    }
    let width = x_max - x_min;
    let typed = *door.open_m.get_ref();
    if !(-SLACK_M..=width + SLACK_M).contains(&typed) {
        return Err(at.error(
            door.open_m.span(),
            format!("open_m is {typed}, must lie in 0..={}", tidy(width)),
            "0 is closed, the width of the opening is fully open",
        ));
    }
    let opens_at_x_max =
        choice_or(door.fixed_jamb.as_ref(), false, "fixed_jamb", &[("x_min", false), ("x_max", true)], at)?;
    let material = palette.id_or_rigid(door.material.as_ref())?;
    let thickness_m = number_or(
        door.thickness_m.as_ref(),
        0.0,
        "thickness_m",
        Limits::Within(0.0, 1.0),
        "in metres: 40 mm = 0.04",
        at,
    )?;
    // Limits that rounding alone separates are the same limit: fully open has no leaf, closed no gap.
    let open = if typed < SLACK_M { 0.0 } else { typed };
    if open > width - SLACK_M {
        return Ok((hole_x_m, None));
    }
    let (open_x_m, covered) = if opens_at_x_max {
        ([x_max - open, x_max], [x_min, x_max - open])
    } else {
        ([x_min, x_min + open], [x_min + open, x_max])
    };
    Ok((open_x_m, Some(Leaf { x_m: covered, material, thickness_m })))
}
