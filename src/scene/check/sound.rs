//! Sources and probes, and where they may stand.

use glam::DVec3;
use serde_spanned::Spanned;

use super::options::{Kind, kind};
use super::values::{Names, choice_or, direction, point};
use crate::error::{Result, Warning};
use crate::scene::locate::Locator;
use crate::scene::polygon;
use crate::scene::room_file::{ProbeTable, SourceTable};
use crate::scene::spectrum::Spectrum;
use crate::scene::{Band, BoxRoom, Directivity, Face, Host, Mesh, Opening, Probe, Source, SourceKind, Wall};

/// Nearer than this to a surface is on it, and nearer to each other is at the same point, in m.
const TOUCH_M: f64 = 1e-6;

/// Names of first-order directivities and their omnidirectional shares: the supercardioid has the largest
/// front-to-back ratio, (sqrt 3 - 1)/2; the hypercardioid the largest directivity, 1/4.
const DIRECTIVITIES: [(&str, f64); 6] = [
    ("omni", 1.0),
    ("subcardioid", 0.7),
    ("cardioid", 0.5),
    ("supercardioid", 0.366_025_403_784_438_65),
    ("hypercardioid", 0.25),
    ("dipole", 0.0),
];

/// Everything a source or probe may be in the way of.
pub(super) struct Matter<'a> {
    pub(super) boxes: &'a [BoxRoom],
    pub(super) walls: &'a [Wall],
    pub(super) meshes: &'a [Mesh],
    pub(super) openings: &'a [Opening],
}

impl Matter<'_> {
    /// What the point lies in or on, as "the wall `x`".
    fn touching(&self, p: DVec3) -> Option<String> {
        for (index, wall) in self.walls.iter().enumerate() {
            let local = wall.frame.local(p);
            if local.z.abs() > wall.thickness_m / 2.0 + TOUCH_M {
                continue;
            }
            if wall.unbounded || polygon::contains(&wall.outline_m(), local.truncate(), TOUCH_M) {
                return Some(match self.opening_at(Host::Wall(index), local) {
                    Some(opening) => format!("in the opening `{}`", opening.name),
                    None if wall.thickness_m > 0.0 => format!("inside the wall `{}`", wall.name),
                    None => format!("on the wall `{}`", wall.name),
                });
            }
        }
        for (index, room) in self.boxes.iter().enumerate() {
            for face in Face::ALL.into_iter().filter(|face| room.face(*face).is_some()) {
                let local = room.face_frame(face).local(p);
                let [w, h] = room.face_size_m(face);
                let within = |value: f64, length: f64| (-TOUCH_M..=length + TOUCH_M).contains(&value);
                if local.z.abs() <= TOUCH_M && within(local.x, w) && within(local.y, h) {
                    return Some(match self.opening_at(Host::BoxFace(index, face), local) {
                        Some(opening) => format!("in the opening `{}`", opening.name),
                        None => format!("on the face {} of box `{}`", face.name(), room.name),
                    });
                }
            }
        }
        let on_mesh = |mesh: &&Mesh| mesh.triangles_m.iter().any(|triangle| triangle_distance(p, triangle) <= TOUCH_M);
        self.meshes.iter().find(on_mesh).map(|mesh| format!("on a triangle of mesh `{}`", mesh.file.display()))
    }

    fn opening_at(&self, host: Host, local: DVec3) -> Option<&Opening> {
        let inside = |o: &&Opening| {
            o.host == host
                && (o.hole_x_m[0]..=o.hole_x_m[1]).contains(&local.x)
                && (o.y_m[0]..=o.y_m[1]).contains(&local.y)
        };
        self.openings.iter().find(inside)
    }

    fn check(&self, what: &str, name: &str, p: DVec3, span: std::ops::Range<usize>, at: &Locator<'_>) -> Result<()> {
        match self.touching(p) {
            None => Ok(()),
            Some(where_) => Err(at.error(
                span,
                format!("{what} `{name}` lies {where_}, must stand clear of all surfaces and openings"),
                "move it by 1 mm or more to the side you mean",
            )),
        }
    }
}

/// Distance of a point from a triangle in m.
fn triangle_distance(p: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let [a, b, c] = *triangle;
    let normal = (b - a).cross(c - a);
    let inside = polygon::edges(triangle).all(|(u, v)| (v - u).cross(p - u).dot(normal) >= 0.0);
    if inside {
        return normal.try_normalize().map_or(f64::INFINITY, |n| (p - a).dot(n).abs());
    }
    let to_edge = |(u, v): (DVec3, DVec3)| {
        let along = v - u;
        let t = ((p - u).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (u + along * t - p).length()
    };
    polygon::edges(triangle).map(to_edge).fold(f64::INFINITY, f64::min)
}

/// Sources.
pub(super) fn sources(
    tables: &[Spanned<SourceTable>],
    bands: &[Band],
    matter: &Matter<'_>,
    at: &Locator<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Source>> {
    if tables.is_empty() {
        return Err(at.error(
            0..0,
            "the room has no source, must have at least one",
            "[[source]] with name = \"talker\" and position_m = [1.0, 2.5, 1.5]",
        ));
    }
    let mut names = Names::new("source", at);
    tables.iter().map(|table| one_source(table.get_ref(), &mut names, bands, matter, at, warnings)).collect()
}

fn one_source(
    table: &SourceTable,
    names: &mut Names<'_>,
    bands: &[Band],
    matter: &Matter<'_>,
    at: &Locator<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Source> {
    let name = names.add(&table.name)?;
    let position_m = point(&table.position_m, "position_m", at)?;
    let axis = table.axis.as_ref().map(|axis| direction(axis, "axis", at)).transpose()?;
    let towards = table.direction.as_ref().map(|towards| direction(towards, "direction", at)).transpose()?;
    let word = kind(table.kind.as_ref(), at)?;
    // Only "line" and "plane" are asked for by a word, so there is one to point at.
    let place = || table.kind.as_ref().map_or_else(|| table.name.span(), Spanned::span);
    let kind = match word {
        Kind::Point => SourceKind::Point,
        Kind::Line => SourceKind::Line(axis.ok_or_else(|| {
            at.error(place(), format!("line source `{name}` lacks axis"), "the direction of the line: axis = [0, 0, 1]")
        })?),
        Kind::Plane => SourceKind::Plane(towards.ok_or_else(|| {
            let hint = "the direction in which the wave travels: direction = [1, 0, 0]";
            at.error(place(), format!("plane source `{name}` lacks direction"), hint)
        })?),
    };
    if !matches!(word, Kind::Line) && axis.is_some() {
        warnings.push(Warning {
            observation: format!("source `{name}` has an axis, which only kind = \"line\" uses"),
            remedy: "the axis of a directivity is called direction".to_owned(),
        });
    }
    let dry = matter.boxes.is_empty() && matter.meshes.is_empty();
    if !(dry || matches!(word, Kind::Point)) {
        return Err(at.error(
            place(),
            format!("source `{name}` is a line or plane source, which needs a scene without boxes and meshes"),
            "they compare with 2D theory and have no reverberation: use walls, or kind = \"point\"",
        ));
    }
    let omni_share = choice_or(table.directivity.as_ref(), 1.0, "directivity", &DIRECTIVITIES, at)?;
    if omni_share != 1.0 {
        // Another share than that of "omni" was named, so there is a name to point at.
        let place = table.directivity.as_ref().map_or(0..0, Spanned::span);
        if !matches!(word, Kind::Point) {
            let message = format!("source `{name}` is a line or plane source, its directivity must be \"omni\"");
            return Err(at.error(place, message, "only point sources have a directivity"));
        }
        if towards.is_none() {
            return Err(at.error(
                place,
                format!("the directivity of source `{name}` lacks direction"),
                "the axis it points along: direction = [1, 0, 0]",
            ));
        }
    }
    let directivity = Directivity { omni_share, axis: towards.unwrap_or(DVec3::X) };
    if !matches!(word, Kind::Plane) {
        matter.check("source", &name, position_m, table.position_m.span(), at)?;
    }
    let power_db = table.power_db.as_ref().map(|power| power_db(power, bands, at)).transpose()?;
    Ok(Source { name, position_m, kind, power_db, directivity })
}

/// Sound power level: one number, or one a band of the scene.
fn power_db(typed: &Spanned<Spectrum>, bands: &[Band], at: &Locator<'_>) -> Result<Vec<f64>> {
    const FORMS: &str = "as power_db = 90.0";
    let check = |value: f64, span| {
        if (-200.0..=300.0).contains(&value) {
            Ok(value)
        } else {
            Err(at.error(span, format!("power_db is {value}, must lie in -200..=300"), "in dB re 1 pW"))
        }
    };
    match typed.get_ref() {
        Spectrum::Constant(value) => check(*value, typed.span()).map(|value| vec![value; bands.len()]),
        Spectrum::List(list) if list.len() == bands.len() => {
            list.iter().map(|value| check(*value.get_ref(), value.span())).collect()
        }
        Spectrum::List(list) => Err(at.error(
            typed.span(),
            format!("power_db has {} values, must have one number, or one a band: {}", list.len(), bands.len()),
            FORMS,
        )),
        Spectrum::Table(_) => {
            Err(at.error(typed.span(), "power_db is a table, must be one number or one a band", FORMS))
        }
    }
}

/// Probes.
pub(super) fn probes(
    tables: &[Spanned<ProbeTable>],
    sources: &[Source],
    matter: &Matter<'_>,
    at: &Locator<'_>,
) -> Result<Vec<Probe>> {
    if tables.is_empty() {
        return Err(at.error(
            0..0,
            "the room has no probe, must have at least one",
            "[[probe]] with name = \"mic-1\" and position_m = [6.0, 1.0, 1.5]",
        ));
    }
    let mut names = Names::new("probe", at);
    let mut probes: Vec<Probe> = Vec::with_capacity(tables.len());
    for table in tables {
        let table = table.get_ref();
        let name = names.add(&table.name)?;
        let position_m = point(&table.position_m, "position_m", at)?;
        matter.check("probe", &name, position_m, table.position_m.span(), at)?;
        for source in sources {
            let offset = position_m - source.position_m;
            let distance = match source.kind {
                SourceKind::Point => offset.length(),
                SourceKind::Line(axis) => offset.reject_from_normalized(axis).length(),
                SourceKind::Plane(_) => continue,
            };
            if distance <= TOUCH_M {
                return Err(at.error(
                    table.position_m.span(),
                    format!("probe `{name}` lies at source `{}`, where the level is infinite", source.name),
                    "move it away by 1 mm or more",
                ));
            }
        }
        // Impulse responses are files called SOURCE-PROBE.wav.
        let file = |source: &Source, probe: &str| format!("{}-{probe}", source.name);
        let clash = sources.iter().find_map(|source| {
            let wanted = file(source, &name);
            let taken = |other: &Probe| sources.iter().any(|s| file(s, &other.name) == wanted);
            probes.iter().find(|other| taken(other)).map(|other| (wanted.clone(), other.name.clone()))
        });
        if let Some((file, other)) = clash {
            return Err(at.error(
                table.name.span(),
                format!("the probes `{other}` and `{name}` would both write the impulse response {file}.wav"),
                "rename a source or a probe",
            ));
        }
        probes.push(Probe { name, position_m });
    }
    Ok(probes)
}

/// Points outside every box are likely a slip, where boxes are all there is.
pub(super) fn outside(sources: &[Source], probes: &[Probe], matter: &Matter<'_>, warnings: &mut Vec<Warning>) {
    if matter.boxes.is_empty() || !matter.meshes.is_empty() {
        return;
    }
    let points = sources
        .iter()
        .map(|source| ("source", &source.name, source.position_m))
        .chain(probes.iter().map(|probe| ("probe", &probe.name, probe.position_m)));
    for (what, name, p) in points {
        let inside = |room: &BoxRoom| p.cmpge(room.min_m).all() && p.cmple(room.max_m).all();
        if !matter.boxes.iter().any(inside) {
            warnings.push(Warning {
                observation: format!("{what} `{name}` lies outside every box"),
                remedy: "check its position_m; sound gets there only through openings and removed faces".to_owned(),
            });
        }
    }
}
