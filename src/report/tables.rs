//! The CSV tables. Numbers are written with as many digits as bring back the same f64; `-inf` where nothing arrives,
//! an empty field where a quantity is not defined.

use std::io::{self, Write};

use super::series::{Series, rises};
use super::{Pair, Run};
use crate::probe::{BandLevel, Reception};
use crate::response::Metrics;

/// The columns that describe a level, after those that say where it belongs.
const LEVEL_COLUMNS: [&str; 4] = ["level_db", "std_error_db", "early_level_db", "spl_db"];

/// Shortest text that reads back as the same number.
fn number(x: f64) -> String {
    x.to_string()
}

fn optional(x: Option<f64>) -> String {
    x.map(number).unwrap_or_default()
}

/// The fields of [`LEVEL_COLUMNS`]; `spl_1m_db`: sound pressure level of the source's free field at 1 m.
fn level_fields(level: &BandLevel, spl_1m_db: Option<f64>) -> [String; 4] {
    let early = BandLevel { intensity: level.intensity * level.early_share, ..*level };
    let spl = spl_1m_db.map(|at_1m| at_1m + level.level_db());
    [number(level.level_db()), number(level.std_error_db()), number(early.level_db()), optional(spl)]
}

/// Writes `bands.csv`: one row a source, probe and band.
///
/// # Errors
/// What the writer says.
pub fn write_bands<'a>(
    out: impl Write,
    run: &Run,
    receptions: impl IntoIterator<Item = &'a Reception>,
) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["source", "probe", "band_hz"].iter().chain(&LEVEL_COLUMNS))?;
    for r in receptions {
        for (band, level) in r.levels.iter().enumerate() {
            let place = [r.source.clone(), r.probe.clone(), number(level.band_hz)];
            csv.write_record(place.iter().chain(&level_fields(level, run.spl_1m_db(&r.source, band))))?;
        }
    }
    csv.flush()
}

/// Writes `sweep.csv`: one row a value, source, probe and band, the values ascending.
///
/// # Errors
/// What the writer says.
pub fn write_sweep(out: impl Write, series: &[Series]) -> io::Result<()> {
    let mut rows: Vec<_> = series.iter().enumerate().flat_map(|(i, s)| s.points.iter().map(move |p| (i, p))).collect();
    rows.sort_by(|(i, a), (j, b)| a.value.total_cmp(&b.value).then(i.cmp(j)));
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["value", "source", "probe", "band_hz"].iter().chain(&LEVEL_COLUMNS))?;
    for (i, point) in rows {
        let s = &series[i];
        let place = [number(point.value), s.source.clone(), s.probe.clone(), number(s.band_hz)];
        csv.write_record(place.iter().chain(&level_fields(&point.level, point.spl_1m_db)))?;
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

/// Writes `metrics.csv`: one row a source, probe and band; from the echogram, and in the columns `ir_` from the rendered response.
///
/// # Errors
/// What the writer says.
pub fn write_metrics(out: impl Write, pairs: &[Pair]) -> io::Result<()> {
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
        "g_db",
        "curvature",
        "reliable",
        "sti",
        "ir_edt_s",
        "ir_t20_s",
        "ir_t30_s",
        "ir_c50_db",
        "ir_c80_db",
        "ir_d50",
        "ir_ts_s",
        "ir_t30_correlation",
        "ir_note",
        "ir_g_db",
        "ir_curvature",
        "ir_reliable",
    ])?;
    for pair in pairs {
        let names = [&pair.reception.source, &pair.reception.probe];
        for (b, m) in pair.metrics.iter().enumerate() {
            let decays = [&m.edt, &m.t20, &m.t30];
            let numbers = decays
                .map(|d| d.seconds)
                .into_iter()
                .chain([m.c50_db, m.c80_db, m.d50, m.ts_s])
                .chain(decays.map(|d| d.correlation))
                .map(optional);
            let place = names.map(String::clone).into_iter().chain([number(m.band_hz)]);
            let doubt = |m: &Metrics| [optional(m.g_db), optional(m.curvature), m.is_reliable().to_string()];
            let rendered = pair.response_metrics.get(b).map_or_else(
                || vec![String::new(); 12],
                |r| {
                    let numbers = [&r.edt, &r.t20, &r.t30].map(|d| d.seconds).into_iter();
                    let numbers = numbers.chain([r.c50_db, r.c80_db, r.d50, r.ts_s, r.t30.correlation]).map(optional);
                    numbers.chain([doubts(r)]).chain(doubt(r)).collect()
                },
            );
            let own = place.chain(numbers).chain([doubts(m)]).chain(doubt(m));
            csv.write_record(own.chain([optional(pair.speech_transmission_index)]).chain(rendered))?;
        }
    }
    csv.flush()
}

/// Why decay times are not to be trusted, those with the same reason together; empty if they are.
pub(super) fn doubts(m: &Metrics) -> String {
    let mut reasons: Vec<(String, &str)> = Vec::new();
    for (name, decay) in [("EDT", &m.edt), ("T20", &m.t20), ("T30", &m.t30)] {
        if let Some(reason) = &decay.reason {
            match reasons.iter_mut().find(|(_, known)| known == reason) {
                Some((names, _)) => *names = format!("{names}, {name}"),
                None => reasons.push((name.to_owned(), reason)),
            }
        }
    }
    reasons.iter().map(|(names, reason)| format!("{names}: {reason}")).collect::<Vec<_>>().join("; ")
}
