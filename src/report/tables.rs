//! The CSV tables. Numbers are written with as many digits as bring back the same f64; `-inf` where nothing arrives,
//! an empty field where a quantity is not defined.

use std::io::{self, Write};

use super::Run;
use super::series::{Series, rises};
use crate::probe::{BandLevel, Reception};

/// Decay and clarity of one source at one probe in one band (ISO 3382-1). `None` where the response does not
/// determine the quantity; the note says why.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct Decay {
    /// Name of the source.
    pub source: String,
    /// Name of the probe.
    pub probe: String,
    /// Nominal centre of the band in Hz; 0 stands for the broadband response.
    pub band_hz: f64,
    /// Early decay time in s.
    pub edt_s: Option<f64>,
    /// Reverberation time from -5 to -25 dB in s.
    pub t20_s: Option<f64>,
    /// Reverberation time from -5 to -35 dB in s.
    pub t30_s: Option<f64>,
    /// Clarity with the limit at 50 ms in dB.
    pub c50_db: Option<f64>,
    /// Clarity with the limit at 80 ms in dB.
    pub c80_db: Option<f64>,
    /// Definition: share of the energy within 50 ms, 0..=1.
    pub d50: Option<f64>,
    /// Centre time in s.
    pub ts_s: Option<f64>,
    /// Correlation coefficient of the fit behind `edt_s`, in magnitude.
    pub edt_correlation: Option<f64>,
    /// Correlation coefficient of the fit behind `t20_s`, in magnitude.
    pub t20_correlation: Option<f64>,
    /// Correlation coefficient of the fit behind `t30_s`, in magnitude.
    pub t30_correlation: Option<f64>,
    /// What to keep in mind; empty if nothing.
    pub note: String,
}

/// The columns that describe a level, after those that say where it belongs.
const LEVEL_COLUMNS: [&str; 4] = ["level_db", "std_error_db", "early_level_db", "spl_db"];

/// Shortest text that reads back as the same number.
fn number(x: f64) -> String {
    x.to_string()
}

fn optional(x: Option<f64>) -> String {
    x.map(number).unwrap_or_default()
}

/// The fields of [`LEVEL_COLUMNS`].
fn level_fields(run: &Run, source: &str, band: usize, level: &BandLevel) -> [String; 4] {
    let early = BandLevel { intensity: level.intensity * level.early_share, ..*level };
    let spl = run.spl_1m_db(source, band).map(|at_1m| at_1m + level.level_db());
    [number(level.level_db()), number(level.std_error_db()), number(early.level_db()), optional(spl)]
}

/// Writes `bands.csv`: one row a source, probe and band.
///
/// # Errors
/// What the writer says.
pub fn write_bands(out: impl Write, run: &Run, receptions: &[Reception]) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["source", "probe", "band_hz"].iter().chain(&LEVEL_COLUMNS))?;
    for r in receptions {
        for (band, level) in r.levels.iter().enumerate() {
            let place = [r.source.clone(), r.probe.clone(), number(level.band_hz)];
            csv.write_record(place.iter().chain(&level_fields(run, &r.source, band, level)))?;
        }
    }
    csv.flush()
}

/// Writes `sweep.csv`: one row a value, source, probe and band, the values ascending.
///
/// # Errors
/// What the writer says.
pub fn write_sweep(out: impl Write, run: &Run, series: &[Series]) -> io::Result<()> {
    let mut rows: Vec<_> = series.iter().enumerate().flat_map(|(i, s)| s.points.iter().map(move |p| (i, p))).collect();
    rows.sort_by(|(i, a), (j, b)| a.value.total_cmp(&b.value).then(i.cmp(j)));
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["value", "source", "probe", "band_hz"].iter().chain(&LEVEL_COLUMNS))?;
    for (i, point) in rows {
        let s = &series[i];
        let place = [number(point.value), s.source.clone(), s.probe.clone(), number(s.band_hz)];
        csv.write_record(place.iter().chain(&level_fields(run, &s.source, s.band, &point.level)))?;
    }
    csv.flush()
}

/// Writes `closing.csv`: the intervals of the swept value in which the level falls while the value grows, so that
/// going back (closing a door) raises it. See [`rises`] for the definition.
///
/// # Errors
/// What the writer says.
pub fn write_closing(out: impl Write, series: &[Series]) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record([
        "source",
        "probe",
        "band_hz",
        "value_low",
        "value_high",
        "level_low_db",
        "level_high_db",
        "rise_db",
        "std_error_db",
    ])?;
    for s in series {
        for rise in rises(&s.points) {
            let numbers = [
                s.band_hz,
                rise.value_low,
                rise.value_high,
                rise.level_low_db,
                rise.level_high_db,
                rise.rise_db,
                rise.std_error_db,
            ];
            csv.write_record([s.source.clone(), s.probe.clone()].into_iter().chain(numbers.map(number)))?;
        }
    }
    csv.flush()
}

/// Writes `metrics.csv`: one row a source, probe and band.
///
/// # Errors
/// What the writer says.
pub fn write_metrics(out: impl Write, decays: &[Decay]) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record([
        "source",
        "probe",
        "band_hz",
        "edt_s",
        "t20_s",
        "t30_s",
        "c50_db",
        "c80_db",
        "d50",
        "ts_s",
        "edt_correlation",
        "t20_correlation",
        "t30_correlation",
        "note",
    ])?;
    for d in decays {
        let quantities = [d.edt_s, d.t20_s, d.t30_s, d.c50_db, d.c80_db, d.d50, d.ts_s];
        let fits = [d.edt_correlation, d.t20_correlation, d.t30_correlation];
        let place = [d.source.clone(), d.probe.clone(), number(d.band_hz)];
        let numbers = quantities.into_iter().chain(fits).map(optional);
        csv.write_record(place.into_iter().chain(numbers).chain([d.note.clone()]))?;
    }
    csv.flush()
}
