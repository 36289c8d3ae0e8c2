//! Sources and probes, and where they may stand.

use glam::DVec3;
use serde_spanned::Spanned;

use super::clearance::{Matter, TOUCH_M};
use super::options::{Kind, kind};
use super::values::{Names, choice_or, direction, point};
use crate::error::{Result, Warning};
use crate::scene::locate::Locator;
use crate::scene::room_file::{ProbeTable, SourceTable};
use crate::scene::spectrum::Spectrum;
use crate::scene::{Band, BoxRoom, Directivity, Probe, ProbeFormat, Source, SourceKind};

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
    two_dimensional(&name, kind, matter).map_err(|(message, hint)| at.error(place(), message, hint))?;
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
        matter.check("source", &name, position_m, table.position_m.span(), at, warnings)?;
    }
    let power_db = table.power_db.as_ref().map(|power| power_db(power, bands, at)).transpose()?;
    Ok(Source { name, position_m, kind, power_db, directivity })
}

/// Line sources and plane waves are for two-dimensional scenes: every opening infinitely long, and a line along all of them and
/// along all walls.
fn two_dimensional(
    name: &str,
    kind: SourceKind,
    matter: &Matter<'_>,
) -> std::result::Result<(), (String, &'static str)> {
    const PARALLEL: f64 = 1e-9;
    if kind == SourceKind::Point {
        return Ok(());
    }
    if let Some(opening) = matter.openings.iter().find(|o| o.y_m.iter().any(|y| y.is_finite())) {
        let message = format!(
            "source `{name}` is a line or plane source, which needs infinitely long openings; opening `{}` ends along local y",
            opening.name
        );
        return Err((message, "leave y_m out (on an unbounded wall), or use kind = \"point\""));
    }
    let SourceKind::Line(axis) = kind else { return Ok(()) };
    if let Some(opening) = matter.openings.iter().find(|o| axis.cross(o.frame.y).length() > PARALLEL) {
        let message =
            format!("the axis of line source `{name}` must be parallel to local y of opening `{}`", opening.name);
        return Err((message, "a line source lies along the edges it is diffracted by"));
    }
    if let Some(wall) = matter.walls.iter().find(|w| axis.dot(w.frame.normal).abs() > PARALLEL) {
        let message = format!("the axis of line source `{name}` must be parallel to wall `{}`", wall.name);
        return Err((message, "in two dimensions nothing changes along the line: no wall may cross it"));
    }
    Ok(())
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
    warnings: &mut Vec<Warning>,
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
        matter.check("probe", &name, position_m, table.position_m.span(), at, warnings)?;
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
        let format = format(&name, table, at)?;
        probes.push(Probe { name, position_m, format });
    }
    Ok(probes)
}

/// What a probe's impulse response records: the names of directivities, and "ambix1" to "ambix3".
fn format(name: &str, table: &ProbeTable, at: &Locator<'_>) -> Result<ProbeFormat> {
    let axis = table.direction.as_ref().map(|axis| direction(axis, "direction", at)).transpose()?;
    let pattern = |(word, omni_share)| {
        let directivity = Directivity { omni_share, axis: axis.unwrap_or(DVec3::X) };
        (word, if omni_share == 1.0 { ProbeFormat::Omni } else { ProbeFormat::Pattern(directivity) })
    };
    let ambix = [("ambix1", 1), ("ambix2", 2), ("ambix3", 3)].map(|(word, order)| (word, ProbeFormat::Ambix(order)));
    let choices: Vec<(&'static str, ProbeFormat)> = DIRECTIVITIES.map(pattern).into_iter().chain(ambix).collect();
    let format = choice_or(table.format.as_ref(), ProbeFormat::Omni, "format", &choices, at)?;
    match (format, axis) {
        (ProbeFormat::Pattern(_), None) => Err(at.error(
            table.format.as_ref().map_or(0..0, Spanned::span),
            format!("the format of probe `{name}` lacks direction"),
            "the axis it points along: direction = [1, 0, 0]",
        )),
        _ => Ok(format),
    }
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
