//! Tables for the terminal.

use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, TableStyle};

use super::beside::comparisons;
use super::notation;
use super::series::{Rise, Series, rises};
use super::{Simulated, Swept};
use crate::probe::{BandLevel, Reception};

/// Widest table in characters; more bands go into a further block below.
const WIDTH: usize = 100;

/// Standard errors below this many dB are not written beside each level.
const NEGLIGIBLE_ERROR_DB: f64 = 0.005;

const RULE: LineStyle = LineStyle::none().fill('─').junction('─');
const STYLE: TableStyle = TableStyle::new().top_border(RULE).header_separator(RULE).bottom_border(RULE);

/// A table with rules; all columns but the first `left_columns` are right-aligned.
pub(crate) fn table(header: Vec<String>, left_columns: usize) -> Table {
    let mut table = Table::new();
    table.load_style(STYLE).set_content_arrangement(ContentArrangement::Disabled);
    let columns = header.len();
    table.set_header(header);
    for i in left_columns..columns {
        if let Some(column) = table.column_mut(i) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

fn pair_name(source: &str, probe: &str) -> String {
    format!("{source} → {probe}")
}

fn level_cell(level_db: f64, std_error_db: f64, with_error: bool) -> String {
    let text = notation::level(level_db, 2);
    if with_error && level_db.is_finite() { format!("{text} ±{std_error_db:.2}") } else { text }
}

/// One row a source and probe, one column a band; several blocks if there are many bands.
fn blocks(receptions: &[&Reception], with_error: bool, level_db: impl Fn(&Reception, usize) -> f64) -> String {
    let bands = receptions.first().map_or(0, |r| r.levels.len());
    let cell = |r: &Reception, b: usize| match r.levels.get(b) {
        Some(level) => level_cell(level_db(r, b), level.std_error_db(), with_error),
        None => String::new(),
    };
    let names: Vec<String> = receptions.iter().map(|r| pair_name(&r.source, &r.probe)).collect();
    let name_width = names.iter().map(|n| n.chars().count()).max().unwrap_or(0).max(15);
    let cells = receptions.iter().flat_map(|r| (0..bands).map(move |b| cell(r, b)));
    let headers = (0..bands).map(|b| notation::band(receptions[0].levels[b].band_hz));
    let cell_width = cells.chain(headers).map(|text| text.chars().count()).max().unwrap_or(0);
    let fitting = (WIDTH.saturating_sub(name_width + 2) / (cell_width + 2)).max(1);
    let in_a_block = bands.div_ceil(bands.div_ceil(fitting).max(1)).max(1);
    let all: Vec<usize> = (0..bands).collect();
    let mut text = String::new();
    for block in all.chunks(in_a_block) {
        let header = block.iter().map(|&b| notation::band(receptions[0].levels[b].band_hz));
        let mut table = table(std::iter::once("source → probe".to_owned()).chain(header).collect(), 1);
        for (r, name) in receptions.iter().zip(&names) {
            table.add_row(std::iter::once(name.clone()).chain(block.iter().map(|&b| cell(r, b))));
        }
        text.push_str(&table.trim_fmt());
        text.push('\n');
    }
    text
}

/// Whether any standard error is large enough to be written beside its level.
pub(super) fn errors_matter<'a>(receptions: impl Iterator<Item = &'a Reception>) -> bool {
    let mut errors = receptions.flat_map(|r| &r.levels).map(BandLevel::std_error_db).filter(|e| e.is_finite());
    errors.any(|e| e >= NEGLIGIBLE_ERROR_DB)
}

/// The band levels of all pairs with their standard errors, and the sound pressure levels of sources with a power.
pub fn levels_table(results: &Simulated) -> String {
    let run = &results.run;
    let all: Vec<&Reception> = results.receptions().collect();
    let with_error = errors_matter(all.iter().copied());
    let spread = if with_error {
        "± standard error".to_owned()
    } else {
        format!("standard errors below {NEGLIGIBLE_ERROR_DB} dB")
    };
    let mut text = format!("{}\nLevels in dB re the source's free field at 1 m ({spread})\n", run.name);
    text.push_str(&blocks(&all, with_error, |r, b| r.levels[b].level_db()));
    let with_power: Vec<&Reception> = all.into_iter().filter(|r| run.spl_1m_db(&r.source, 0).is_some()).collect();
    if !with_power.is_empty() {
        text.push_str("\nSound pressure levels in dB re 20 µPa\n");
        text.push_str(&blocks(&with_power, false, |r, b| {
            r.levels[b].level_db() + run.spl_1m_db(&r.source, b).unwrap_or(f64::NAN)
        }));
    }
    text
}

/// The largest rise of a series, and how many there are.
pub(super) fn largest_rise(series: &Series) -> (Option<Rise>, usize) {
    let all = rises(&series.points);
    (all.iter().copied().max_by(|a, b| a.rise_db.total_cmp(&b.rise_db)), all.len())
}

/// One row a source, probe and band of a sweep: the level at both ends and the largest rise while the value falls.
pub fn rises_table(swept: &Swept) -> String {
    let unit = notation::unit_of(&swept.parameter);
    let act = notation::act_of(&swept.parameter);
    let with_unit = |v: f64| format!("{} {unit}", notation::trimmed(v, 4)).trim_end().to_owned();
    let ends = swept.series.first().and_then(|s| Some((s.points.first()?.value, s.points.last()?.value)));
    let Some((first, last)) = ends else { return format!("{}: the sweep has no values\n", swept.run.name) };
    let mut text = format!(
        "{}: {} values of {}\nLevels in dB re the source's free field at 1 m\n",
        swept.run.name,
        swept.series[0].points.len(),
        swept.parameter
    );
    let header = [
        "source → probe".to_owned(),
        "band".to_owned(),
        format!("at {}", with_unit(first)),
        format!("at {}", with_unit(last)),
        format!("largest rise on {act}"),
        "from → to".to_owned(),
        "rises".to_owned(),
    ];
    let mut table = table(header.into(), 1);
    let mut last_pair = String::new();
    for s in &swept.series {
        let pair = pair_name(&s.source, &s.probe);
        let shown = if pair == last_pair { String::new() } else { pair.clone() };
        last_pair = pair;
        let at = |p: Option<&super::SeriesPoint>| p.map_or(String::new(), |p| notation::level(p.level.level_db(), 2));
        let (largest, count) = largest_rise(s);
        let (rise, span) = match largest {
            Some(r) => (
                format!("{:.2} dB", r.rise_db),
                format!("{} → {}", notation::trimmed(r.value_high, 4), with_unit(r.value_low)),
            ),
            None => ("none".to_owned(), String::new()),
        };
        table.add_row([
            shown,
            notation::band(s.band_hz),
            at(s.points.first()),
            at(s.points.last()),
            rise,
            span,
            count.to_string(),
        ]);
    }
    text.push_str(&table.trim_fmt());
    text.push('\n');
    text.push_str(&beside_table(swept));
    text
}

/// One row a source, probe and band that has a reference curve: both largest rises, and how far the levels are apart.
/// Empty without reference curves.
fn beside_table(swept: &Swept) -> String {
    let all = comparisons(swept);
    let Some(first) = all.first() else { return String::new() };
    let act = notation::act_of(&swept.parameter);
    let unit = notation::unit_of(&swept.parameter);
    let header = ["source → probe", "band", "largest rise", "reference", "median |diff|", "largest difference"];
    let mut table = table(header.map(str::to_owned).into(), 1);
    let rise = |r: Option<Rise>| r.map_or("none".to_owned(), |r| format!("{:.2} dB", r.rise_db));
    let mut last_pair = String::new();
    for c in &all {
        let pair = pair_name(&c.series.source, &c.series.probe);
        let shown = if pair == last_pair { String::new() } else { pair.clone() };
        last_pair = pair;
        let median = if c.common > 0 { format!("{:.2} dB", c.median_db) } else { String::new() };
        let largest = c.largest.map_or("no common value".to_owned(), |(value, db)| {
            // No minus before what rounds to nothing.
            let db = if db.abs() < 0.005 { 0.0 } else { db };
            format!("{} dB at {} {unit}", notation::level(db, 2), notation::trimmed(value, 4)).trim_end().to_owned()
        });
        table.add_row([shown, notation::band(c.series.band_hz), rise(c.rise), rise(c.reference_rise), median, largest]);
    }
    format!(
        "\nRises on {act} beside the reference {}, at the values both have\n{}\n",
        first.reference.label,
        table.trim_fmt()
    )
}
