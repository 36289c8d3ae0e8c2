//! The reference cases: rooms with many probes, and the exact levels there.

use std::fmt::Write as _;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};

/// Directions behind an opening further than this off its normal, in degrees, are a region of their own: a ray there runs
/// along the screen.
const OBLIQUE_DEG: f64 = 75.0;

/// One exact level of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Index of the probe.
    pub probe: usize,
    /// Centre of the octave band, or the tone, in Hz.
    pub band_hz: f64,
    /// Exact level in dB re the source's free field at 1 m.
    pub level_db: f64,
    /// "lit", "transition" or "shadow"; "oblique" beyond 75 degrees off the normal, "all" if not told.
    pub region: &'static str,
}

/// A scene with a source, probes and bands.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// What stands between source and probe: "half-plane", "slit".
    pub name: String,
    /// "line", "point" or "plane".
    pub source: &'static str,
    /// "octave" or "tone".
    pub mean: &'static str,
    /// Walls, openings and source as text of a room file.
    room: String,
    /// Places of the probes in m.
    pub probes_m: Vec<[f64; 3]>,
    /// The exact levels.
    pub levels: Vec<Reference>,
}

impl Case {
    /// The bands in Hz, ascending.
    pub fn bands_hz(&self) -> Vec<f64> {
        let mut bands: Vec<f64> = self.levels.iter().map(|l| l.band_hz).collect();
        bands.sort_by(f64::total_cmp);
        bands.dedup();
        bands
    }

    /// Whether sound meets a single edge.
    pub(super) fn about_edge(&self) -> bool {
        self.name.contains("half-plane") || self.name.contains("wedge")
    }

    /// The room file with this transport. The exact levels beside a rigid face are those of direct and reflected sound
    /// together, so paths add as pressures.
    pub fn room_text(&self, transport: &str) -> String {
        let bands = self.bands_hz();
        let bands = match (self.mean, bands.first(), bands.last()) {
            ("octave", Some(low), Some(high)) => format!("from_hz = {low}\nto_hz = {high}"),
            _ => format!("spacing = \"tones\"\nfrequencies_hz = {bands:?}"),
        };
        let mut text = format!(
            "[air]\nspeed_of_sound_m_s = 343.0\nabsorption = false\n[bands]\n{bands}\n[simulation]\nmax_rays = 0\n\
             interference = {}\ntransport = \"{transport}\"\n{}",
            self.about_edge(),
            self.room
        );
        for (i, at) in self.probes_m.iter().enumerate() {
            // Writing to a String cannot fail.
            let _ = write!(text, "[[probe]]\nname = \"{i}\"\nposition_m = {at:?}\n");
        }
        text
    }

    /// The same case with its first `count` probes only.
    pub fn of_probes(&self, count: usize) -> Case {
        let probes_m = self.probes_m.iter().take(count).copied().collect();
        let levels = self.levels.iter().filter(|l| l.probe < count).cloned().collect();
        Case { probes_m, levels, ..self.clone() }
    }
}

/// Source of a room file; `toward`: axis of a line, direction of a plane wave.
fn source_text(kind: &str, at_m: [f64; 3], toward: [f64; 3]) -> String {
    match kind {
        "line" => format!("[[source]]\nname = \"s\"\nkind = \"line\"\nposition_m = {at_m:?}\naxis = [0, 0, 1]\n"),
        "plane" => {
            format!("[[source]]\nname = \"s\"\nkind = \"plane\"\nposition_m = [0, 5, 0]\ndirection = {toward:?}\n")
        }
        _ => format!("[[source]]\nname = \"s\"\nposition_m = {at_m:?}\n"),
    }
}

/// The unbounded wall that fills `-thickness_m` < y < 0; local x is world x, local y world z.
fn screen_text(thickness_m: f64) -> String {
    let y = -0.5 * thickness_m;
    let thickness = if thickness_m > 0.0 { format!("thickness_m = {thickness_m:?}\n") } else { String::new() };
    format!(
        "[[wall]]\nname = \"screen\"\ncorners_m = [[0, {y:?}, 0], [1, {y:?}, 0], [1, {y:?}, 1]]\nunbounded = true\n{thickness}"
    )
}

/// An opening of the screen, infinitely long without `y_m`.
fn opening_text(name: &str, x_m: [f64; 2], y_m: Option<[f64; 2]>) -> String {
    let side = |limits: [f64; 2]| {
        let toml = |x: f64| if x == f64::NEG_INFINITY { "-inf".to_owned() } else { format!("{x:?}") };
        format!("[{}, {}]", toml(limits[0]), toml(limits[1]))
    };
    let y = y_m.map_or(String::new(), |y| format!("y_m = {}\n", side(y)));
    format!("[[opening]]\nname = \"{name}\"\nwall = \"screen\"\nx_m = {}\n{y}", side(x_m))
}

/// Faces of a wedge from the z axis, 400 m along it and 200 m deep.
fn faces_text(exterior_deg: f64) -> String {
    let face = |name: &str, degrees: f64| {
        let (y, x) = degrees.to_radians().sin_cos();
        let (x, y) = (200.0 * x, 200.0 * y);
        format!(
            "[[wall]]\nname = \"{name}\"\ncorners_m = [[0, 0, -200], [0, 0, 200], [{x:?}, {y:?}, 200], [{x:?}, {y:?}, -200]]\n"
        )
    };
    if exterior_deg < 360.0 { face("a", 0.0) + &face("b", exterior_deg) } else { face("a", 0.0) }
}

fn polar(r_m: f64, degrees: f64, z_m: f64) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [r_m * cos, r_m * sin, z_m]
}

/// The known words, so that columns need not be copied.
fn word(text: &str) -> &'static str {
    const WORDS: [&str; 8] = ["line", "point", "plane", "octave", "tone", "lit", "transition", "shadow"];
    WORDS.iter().find(|w| **w == text).copied().unwrap_or("all")
}

#[derive(Deserialize)]
struct EdgeRow {
    exterior_deg: f64,
    source: String,
    source_r_m: Option<f64>,
    source_deg: f64,
    r_m: f64,
    angle_deg: f64,
    dz_m: f64,
    band_hz: f64,
    level_db: f64,
    region: String,
}

#[derive(Deserialize)]
struct ScreenRow {
    case: String,
    mean: String,
    source: String,
    source_x: f64,
    source_y: f64,
    low_m: f64,
    high_m: f64,
    low2_m: Option<f64>,
    high2_m: Option<f64>,
    band_hz: f64,
    x_m: f64,
    y_m: f64,
    level_db: f64,
    region: String,
}

#[derive(Deserialize)]
struct ThickRow {
    source: String,
    source_x: f64,
    source_y: f64,
    width_m: f64,
    thickness_m: f64,
    band_hz: f64,
    x_m: f64,
    y_m: f64,
    level_db: f64,
}

#[derive(Deserialize)]
struct RectangleRow {
    mean: String,
    width_m: f64,
    height_m: f64,
    sx_m: f64,
    sy_m: f64,
    sz_m: f64,
    x_m: f64,
    y_m: f64,
    z_m: f64,
    band_hz: f64,
    level_db: f64,
}

fn rows<T: DeserializeOwned>(name: &str, table: &str) -> Result<Vec<T>> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(table.as_bytes());
    let rows = reader.deserialize().collect::<std::result::Result<_, _>>();
    rows.map_err(|e| Error::Run(format!("the reference table {name} is malformed: {e}")))
}

/// Adds a level to the case with this room, or begins it.
fn add(cases: &mut Vec<Case>, new: Case, at_m: [f64; 3], level: Reference) {
    let same = |c: &Case| c.name == new.name && c.mean == new.mean && c.room == new.room;
    let index = cases.iter().position(same);
    let index = index.unwrap_or_else(|| {
        cases.push(new);
        cases.len() - 1
    });
    let case = &mut cases[index];
    let known = case.probes_m.iter().position(|p| *p == at_m);
    let probe = known.unwrap_or_else(|| {
        case.probes_m.push(at_m);
        case.probes_m.len() - 1
    });
    case.levels.push(Reference { probe, ..level });
}

fn case(name: &str, source: &str, mean: &str, room: String) -> Case {
    let (source, mean) = (word(source), word(mean));
    Case { name: name.to_owned(), source, mean, room, probes_m: Vec::new(), levels: Vec::new() }
}

fn edges(cases: &mut Vec<Case>) -> Result<()> {
    for row in rows::<EdgeRow>("edges.csv", include_str!("reference/edges.csv"))? {
        let from = polar(1.0, row.source_deg, 0.0);
        let at_m = polar(row.source_r_m.unwrap_or(1.0), row.source_deg, 0.0);
        let source = source_text(&row.source, at_m, from.map(|c| -c));
        let probe_m = polar(row.r_m, row.angle_deg, row.dz_m);
        let level = Reference { probe: 0, band_hz: row.band_hz, level_db: row.level_db, region: word(&row.region) };
        let thin = row.exterior_deg >= 360.0;
        // A plane wave would also come over the far ends of the faces.
        if row.source != "plane" {
            let name = if thin { "half-plane".to_owned() } else { format!("wedge {}", row.exterior_deg) };
            let new = case(&name, &row.source, "octave", faces_text(row.exterior_deg) + &source);
            add(cases, new, probe_m, level.clone());
        }
        // Behind a half-plane it is also what an opening without end leaves of an unbounded screen: the mask of one jamb.
        if thin && row.angle_deg > 180.0 {
            let room = screen_text(0.0) + &opening_text("rest", [f64::NEG_INFINITY, 0.0], None) + &source;
            add(cases, case("open half-plane", &row.source, "octave", room), probe_m, level);
        }
    }
    Ok(())
}

fn screens(cases: &mut Vec<Case>) -> Result<()> {
    for row in rows::<ScreenRow>("screens.csv", include_str!("reference/screens.csv"))? {
        let mut room = screen_text(0.0) + &opening_text("a", [row.low_m, row.high_m], None);
        let mut middle_m = 0.5 * (row.low_m + row.high_m);
        if let (Some(low), Some(high)) = (row.low2_m, row.high2_m) {
            room += &opening_text("b", [low, high], None);
            middle_m = 0.5 * (row.low_m + high);
        }
        room += &source_text(&row.source, [row.source_x, row.source_y, 0.0], [row.source_x, row.source_y, 0.0]);
        let name = match &*row.case {
            "door" => "sliding door",
            "two" => "two slits",
            _ => "slit",
        };
        let oblique = (row.x_m - middle_m).atan2(-row.y_m).abs() > OBLIQUE_DEG.to_radians() && name != "two slits";
        let region = if oblique { "oblique" } else { word(&row.region) };
        let level = Reference { probe: 0, band_hz: row.band_hz, level_db: row.level_db, region };
        add(cases, case(name, &row.source, &row.mean, room), [row.x_m, row.y_m, 0.0], level);
    }
    Ok(())
}

fn thick_slits(cases: &mut Vec<Case>) -> Result<()> {
    for row in rows::<ThickRow>("thick_slits.csv", include_str!("reference/thick_slits.csv"))? {
        let toward = [row.source_x, row.source_y, 0.0];
        let half = 0.5 * row.width_m;
        let room = screen_text(row.thickness_m)
            + &opening_text("a", [-half, half], None)
            + &source_text(&row.source, toward, toward);
        let level = Reference { probe: 0, band_hz: row.band_hz, level_db: row.level_db, region: "all" };
        add(cases, case("thick slit", &row.source, "octave", room), [row.x_m, row.y_m, 0.0], level);
    }
    Ok(())
}

fn rectangles(cases: &mut Vec<Case>) -> Result<()> {
    for row in rows::<RectangleRow>("rectangles.csv", include_str!("reference/rectangles.csv"))? {
        let (w, h) = (0.5 * row.width_m, 0.5 * row.height_m);
        let room = screen_text(0.0)
            + &opening_text("door", [-w, w], Some([-h, h]))
            + &source_text("point", [row.sx_m, row.sy_m, row.sz_m], [0.0; 3]);
        let level = Reference { probe: 0, band_hz: row.band_hz, level_db: row.level_db, region: "all" };
        add(cases, case("rectangle", "point", &row.mean, room), [row.x_m, row.y_m, row.z_m], level);
    }
    Ok(())
}

/// All cases in the order of the tables.
///
/// # Errors
/// [`Error::Run`] if a table is malformed; a test reads them all.
pub(super) fn all() -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    edges(&mut cases)?;
    screens(&mut cases)?;
    thick_slits(&mut cases)?;
    rectangles(&mut cases)?;
    Ok(cases)
}

/// The first case of every kind: name, source and mean.
pub(super) fn few(cases: Vec<Case>) -> Vec<Case> {
    let mut kept: Vec<Case> = Vec::new();
    for case in cases {
        if !kept.iter().any(|k| (&k.name, k.source, k.mean) == (&case.name, case.source, case.mean)) {
            kept.push(case);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_case_has_levels_in_several_bands_and_regions() {
        let cases = all().unwrap();
        assert!(cases.iter().map(|c| c.levels.len()).sum::<usize>() > 1500);
        for case in &cases {
            let (probes, bands) = (case.probes_m.len(), case.bands_hz().len());
            assert!(probes >= 2 && bands >= 5, "{} {}: {probes} probes, {bands} bands", case.name, case.source);
            // Boundary elements were too dear for some of the highest bands.
            let full = probes * bands;
            assert!(case.levels.len() <= full && 2 * case.levels.len() > full, "{}", case.name);
            for level in &case.levels {
                assert!(level.level_db.is_finite() && level.level_db < 12.0 && level.probe < probes);
            }
        }
        for region in ["lit", "transition", "shadow", "oblique", "all"] {
            assert!(cases.iter().flat_map(|c| &c.levels).any(|l| l.region == region), "{region}");
        }
    }

    #[test]
    fn the_short_run_has_every_kind_of_case_once() {
        let cases = all().unwrap();
        let kinds = few(cases.clone());
        for case in &cases {
            let same = |k: &&Case| (&k.name, k.source, k.mean) == (&case.name, case.source, case.mean);
            assert_eq!(kinds.iter().filter(same).count(), 1, "{}", case.name);
        }
    }
}
