//! `run.json`: everything needed to repeat a run and to judge it. Levels where nothing arrives are `null`, as JSON has
//! no infinity.

use serde::{Serialize, Serializer};

use super::series::{Rise, Series, rises};
use super::{Pair, Run, Simulated, Swept};
use crate::error::Warning;
use crate::probe::{BandLevel, EarlyPath, TableCost};
use crate::response::Metrics;
use crate::scene::{Band, Output, Simulation};

/// The value of `program`, by which a later run knows a record as ours.
pub(super) const PROGRAM: &str = "diffray";

/// The whole record; fields appear in this order.
#[derive(Serialize)]
pub(super) struct Record<'a> {
    program: &'static str,
    version: &'static str,
    command: &'static str,
    name: &'a str,
    room_file: String,
    room_file_sha256: &'a str,
    set: &'a [String],
    seed: u64,
    options: Options<'a>,
    bands: &'a [Band],
    plan: &'a serde_json::Value,
    rays: u64,
    stop: &'a str,
    #[serde(serialize_with = "as_map")]
    times_s: &'a [(String, f64)],
    opening_tables: &'a [TableCost],
    warnings: &'a [Warning],
    #[serde(skip_serializing_if = "Option::is_none")]
    parameter: Option<&'a str>,
    results: Results<'a>,
    files: Vec<String>,
}

#[derive(Serialize)]
struct Options<'a> {
    simulation: &'a Simulation,
    output: &'a Output,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Results<'a> {
    Pairs(Vec<PairRecord<'a>>),
    Series(Vec<SeriesRecord<'a>>),
}

#[derive(Serialize)]
struct PairRecord<'a> {
    source: &'a str,
    probe: &'a str,
    levels: Vec<LevelRecord>,
    paths: Vec<PathRecord<'a>>,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    metrics: &'a [Metrics],
}

#[derive(Serialize)]
struct LevelRecord {
    band_hz: f64,
    level_db: f64,
    std_error_db: f64,
    early_share: f64,
}

#[derive(Serialize)]
struct PathRecord<'a> {
    label: &'a str,
    reflections: usize,
    delay_s: f64,
    level_db: Vec<f64>,
}

#[derive(Serialize)]
struct SeriesRecord<'a> {
    source: &'a str,
    probe: &'a str,
    band_hz: f64,
    points: Vec<PointRecord>,
    closing: Vec<Rise>,
}

#[derive(Serialize)]
struct PointRecord {
    value: f64,
    level_db: f64,
    std_error_db: f64,
}

/// Writes pairs as an object, in their order.
fn as_map<S: Serializer>(pairs: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(key, value)| (key, value)))
}

impl<'a> Record<'a> {
    /// What simulations and sweeps have in common.
    fn of(run: &'a Run, command: &'static str, results: Results<'a>, files: Vec<String>) -> Self {
        Record {
            program: PROGRAM,
            version: env!("CARGO_PKG_VERSION"),
            command,
            name: &run.name,
            room_file: run.source.file.display().to_string(),
            room_file_sha256: &run.source.sha256,
            set: &run.set,
            seed: run.simulation.seed,
            options: Options { simulation: &run.simulation, output: &run.output },
            bands: &run.bands,
            plan: &run.plan,
            rays: run.rays,
            stop: &run.stop,
            times_s: &run.times_s,
            opening_tables: &run.opening_tables,
            warnings: &run.warnings,
            parameter: None,
            results,
            files,
        }
    }

    /// The record of a simulation whose other results are in `files`.
    pub(super) fn of_simulation(simulated: &'a Simulated, files: Vec<String>) -> Self {
        let pairs = simulated.pairs.iter().map(PairRecord::from).collect();
        Record::of(&simulated.run, "simulate", Results::Pairs(pairs), files)
    }

    /// The record of a sweep whose other results are in `files`.
    pub(super) fn of_sweep(swept: &'a Swept, files: Vec<String>) -> Self {
        let series = swept.series.iter().map(SeriesRecord::from).collect();
        let record = Record::of(&swept.run, "sweep", Results::Series(series), files);
        Record { parameter: Some(&swept.parameter), ..record }
    }
}

impl<'a> From<&'a Pair> for PairRecord<'a> {
    fn from(pair: &'a Pair) -> Self {
        let r = &pair.reception;
        PairRecord {
            source: &r.source,
            probe: &r.probe,
            levels: r.levels.iter().map(LevelRecord::from).collect(),
            paths: r.paths.iter().map(PathRecord::from).collect(),
            metrics: &pair.metrics,
        }
    }
}

impl From<&BandLevel> for LevelRecord {
    fn from(level: &BandLevel) -> Self {
        LevelRecord {
            band_hz: level.band_hz,
            level_db: level.level_db(),
            std_error_db: level.std_error_db(),
            early_share: level.early_share,
        }
    }
}

impl<'a> From<&'a EarlyPath> for PathRecord<'a> {
    fn from(path: &'a EarlyPath) -> Self {
        PathRecord {
            label: &path.label,
            reflections: path.reflections,
            delay_s: path.delay_s,
            level_db: path.intensity.iter().map(|i| 10.0 * i.log10()).collect(),
        }
    }
}

impl<'a> From<&'a Series> for SeriesRecord<'a> {
    fn from(s: &'a Series) -> Self {
        let point = |p: &super::SeriesPoint| PointRecord {
            value: p.value,
            level_db: p.level.level_db(),
            std_error_db: p.level.std_error_db(),
        };
        SeriesRecord {
            source: &s.source,
            probe: &s.probe,
            band_hz: s.band_hz,
            points: s.points.iter().map(point).collect(),
            closing: rises(&s.points),
        }
    }
}
