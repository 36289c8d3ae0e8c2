//! Rooms in text, their levels, and the exact tables that `diffray verify` runs.

#![allow(dead_code, unreachable_pub, reason = "every test file uses its own part")]

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

use diffray::geometry::Geometry;
use diffray::plan::Plan;
use diffray::scene::Scene;
use diffray::simulate::{self, Outcome};

/// The plane y = 0; local x is world x, local y world z.
pub const SCREEN: &str =
    "[[wall]]\nname = \"screen\"\ncorners_m = [[0, 0, 0], [1, 0, 0], [1, 0, 1]]\nunbounded = true\n";

/// One row of a table, by column name.
pub struct Row(HashMap<String, String>);

impl Row {
    /// The text of a column, empty where there is none.
    pub fn text(&self, column: &str) -> &str {
        self.0.get(column).map_or("", String::as_str)
    }

    /// The number of a column.
    pub fn number(&self, column: &str) -> f64 {
        self.text(column).parse().unwrap_or_else(|_| panic!("{column} = {:?}", self.text(column)))
    }
}

/// All rows of `<name>.csv`, of the tables that `diffray verify` runs (src/verify/reference) or those of the tests alone
/// (tests/reference).
pub fn table(name: &str) -> Vec<Row> {
    let path = ["src/verify/reference", "tests/reference"]
        .map(|folder| Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join(format!("{name}.csv")))
        .into_iter()
        .find(|path| path.exists())
        .expect("table is there");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(&path).expect("table is there");
    let columns = reader.headers().expect("table has a header").clone();
    let row = |r: csv::StringRecord| Row(columns.iter().map(String::from).zip(r.iter().map(String::from)).collect());
    reader.records().map(|r| row(r.expect("row is well formed"))).collect()
}

/// The first lines of a room: c = 343 m/s, no absorption, one octave band or tone.
pub fn head(mean: &str, band_hz: f64) -> String {
    let bands = if mean == "tone" {
        format!("spacing = \"tones\"\nfrequencies_hz = [{band_hz}]")
    } else {
        format!("from_hz = {band_hz}\nto_hz = {band_hz}")
    };
    format!("[air]\nspeed_of_sound_m_s = 343.0\nabsorption = false\n[bands]\n{bands}\n")
}

/// An infinitely long slit in the screen.
pub fn slit(name: &str, low_m: f64, high_m: f64) -> String {
    format!("[[opening]]\nname = \"{name}\"\nwall = \"screen\"\nx_m = [{low_m:?}, {high_m:?}]\n")
}

/// A source; `toward`: axis of a line, direction of a plane wave.
pub fn source(kind: &str, at: [f64; 3], toward: [f64; 3]) -> String {
    let extra = match kind {
        "line" => format!("axis = {toward:?}\n"),
        "plane" => format!("direction = {toward:?}\n"),
        _ => String::new(),
    };
    format!("[[source]]\nname = \"s\"\nkind = \"{kind}\"\nposition_m = {at:?}\n{extra}")
}

/// A probe.
pub fn probe(name: &str, at: [f64; 3]) -> String {
    format!("[[probe]]\nname = \"{name}\"\nposition_m = {at:?}\n")
}

/// Levels in dB, `[probe][band]`, of a room with one source.
pub fn levels(room: &str) -> Vec<Vec<f64>> {
    outcome(room).receptions.iter().map(|r| r.levels.iter().map(|l| l.level_db()).collect()).collect()
}

/// What a room does.
pub fn outcome(room: &str) -> Outcome {
    let loaded = Scene::from_str(room, "room.toml", &[]).unwrap_or_else(|e| panic!("{e}\n{room}"));
    let geometry = Geometry::new(&loaded.scene).expect("geometry");
    let plan = Plan::new(&loaded.scene, &geometry);
    simulate::run(&loaded.scene, &geometry, &plan, &|_| {}).expect("run")
}

/// The level of a room with one source, probe and band.
pub fn level(room: &str) -> f64 {
    levels(room)[0][0]
}

/// The largest step in dB of a sweep beyond the mean of the steps before and after it.
pub fn largest_step(levels: &[f64]) -> f64 {
    let beyond = |w: &[f64]| (w[2] - w[1] - 0.5 * (w[1] - w[0] + w[3] - w[2])).abs();
    levels.windows(4).map(beyond).fold(0.0, f64::max)
}

/// Absolute errors in dB, in order of size.
#[derive(Default)]
pub struct Errors(Vec<f64>);

impl Errors {
    /// Adds the difference of two levels.
    pub fn add(&mut self, got: f64, expected: f64) {
        self.0.push(if got.is_finite() { (got - expected).abs() } else { f64::INFINITY });
        self.0.sort_by(f64::total_cmp);
    }

    /// The error that the share `q` of all does not exceed.
    pub fn quantile(&self, q: f64) -> f64 {
        self.0[((q * self.0.len() as f64) as usize).min(self.0.len() - 1)]
    }

    /// Median, 90th percentile and largest error are at most `bounds`.
    pub fn assert_within(&self, what: &str, bounds: [f64; 3]) {
        let reached = [self.quantile(0.5), self.quantile(0.9), self.quantile(1.0)];
        let mut line = String::new();
        let _ = write!(line, "{what}, {} levels: median, 90th percentile, max {reached:.4?}", self.0.len());
        println!("{line} (at most {bounds:?})");
        assert!(reached.iter().zip(bounds).all(|(r, b)| *r <= b), "{line}, allowed {bounds:?}");
    }
}
