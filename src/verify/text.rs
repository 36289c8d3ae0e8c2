//! `verify.csv` and the tables on the terminal.

use std::io;

use super::measure::Method;
use super::summary::{Entry, Quantiles};
use super::{Extent, Verified};
use crate::report::console::table;
use crate::report::notation;

/// One row a kind of case, band, region and transport. The times are those of all bands and regions of the kind
/// together, for the set-up the longest of its scenes.
pub(super) fn write_csv(out: &mut dyn io::Write, verified: &Verified) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record([
        "case",
        "source",
        "mean",
        "band_hz",
        "region",
        "transport",
        "budget",
        "levels",
        "median_db",
        "p90_db",
        "max_db",
        "time_us_per_level",
        "set_up_ms",
    ])?;
    for kind in verified.kinds() {
        for method in &verified.methods {
            let of_kind = || verified.entries(method).filter(|e| e.trial.kind() == kind);
            let time_s = Verified::time_per_level_s(verified.trials_of(method).filter(|t| t.kind() == kind));
            let set_up_s = Verified::set_up_s(verified.trials_of(method).filter(|t| t.kind() == kind)).unwrap_or(0.0);
            let mut groups: Vec<(f64, &str)> = of_kind().map(|e| (e.level.band_hz, e.level.region)).collect();
            groups.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(b.1)));
            groups.dedup();
            for (band_hz, region) in groups {
                let chosen = |e: &Entry<'_>| e.level.band_hz == band_hz && e.level.region == region;
                let (Some(q), Some(time_s)) = (Quantiles::of(of_kind().filter(chosen).map(|e| e.error_db)), time_s)
                else {
                    continue;
                };
                csv.write_record([
                    kind.0.to_owned(),
                    kind.1.to_owned(),
                    kind.2.to_owned(),
                    notation::trimmed(band_hz, 3),
                    region.to_owned(),
                    method.name.to_owned(),
                    format!("{:.0e}", method.tolerance),
                    q.levels.to_string(),
                    format!("{:.5}", q.median_db),
                    format!("{:.5}", q.p90_db),
                    format!("{:.5}", q.max_db),
                    format!("{:.3}", time_s * 1e6),
                    format!("{:.4}", set_up_s * 1e3),
                ])?;
            }
        }
    }
    csv.flush()
}

/// An error in dB with three figures at most.
pub(super) fn error(db: f64) -> String {
    match db {
        db if !db.is_finite() => "inf".to_owned(),
        db if db < 0.0005 => "<0.001".to_owned(),
        db if db < 1.0 => format!("{db:.3}"),
        db => format!("{db:.2}"),
    }
}

/// "90th percentile / max".
pub(super) fn high(q: Option<Quantiles>) -> String {
    q.map_or("–".to_owned(), |q| format!("{} / {}", error(q.p90_db), error(q.max_db)))
}

/// "median / 90th percentile / max".
pub(super) fn errors(q: Option<Quantiles>) -> String {
    q.map_or("–".to_owned(), |q| format!("{} / {} / {}", error(q.median_db), error(q.p90_db), error(q.max_db)))
}

/// A time with its unit: "3.2 µs".
pub(super) fn time(seconds: Option<f64>) -> String {
    match seconds {
        None => "–".to_owned(),
        Some(s) if s < 1e-3 => format!("{} µs", notation::trimmed(s * 1e6, if s < 1e-5 { 1 } else { 0 })),
        Some(s) if s < 1.0 => format!("{} ms", notation::trimmed(s * 1e3, if s < 1e-2 { 1 } else { 0 })),
        Some(s) => format!("{s:.1} s"),
    }
}

/// A ratio with two or three figures: "34", "12 000".
pub(super) fn times(ratio: f64) -> String {
    if ratio < 10.0 { format!("{ratio:.1}") } else { notation::grouped(ratio.round() as u64) }
}

/// What was left out, in a sentence; empty if nothing was.
pub(super) fn left_out(verified: &Verified) -> String {
    let cases = |(name, count): &(String, usize)| format!("{name} for {count} cases");
    let list: Vec<String> = verified.left_out.iter().map(cases).collect();
    if list.is_empty() {
        return String::new();
    }
    format!("Left out (the transport does not know such rooms, or its time was up): {}.", list.join(", "))
}

/// All tables for the terminal, at most 100 characters wide.
pub(super) fn tables(verified: &Verified) -> String {
    let header = |texts: &[&str]| texts.iter().map(|t| (*t).to_owned()).collect::<Vec<_>>();
    let mut text = format!(
        "Verification against exact solutions{}\nErrors: median / 90th percentile / max of |level - exact level| in dB\n",
        if verified.extent == Extent::Fast { " (fast: one case of a kind)" } else { "" }
    );
    let mut add = |title: &str, table: comfy_table::Table| {
        text.push_str(&format!("\n{title}\n{}\n", table.trim_fmt()));
    };

    let mut methods = table(header(&["transport", "levels", "all octave bands", "tones", "a level", "set-up"]), 1);
    for method in &verified.methods {
        let octaves = verified.errors(method, |e| e.octave());
        methods.add_row([
            method.label(),
            octaves.map_or(0, |q| q.levels).to_string(),
            errors(octaves),
            errors(verified.errors(method, |e| !e.octave())),
            time(Verified::time_per_level_s(verified.trials_of(method).filter(|t| t.case.mean == "octave"))),
            time(Verified::set_up_s(verified.trials_of(method).filter(|t| t.case.mean == "octave"))),
        ]);
    }
    add("By transport and ray budget: time a level, longest set-up of a scene (tables that all probes share)", methods);

    let Some(standard) = verified.standard() else { return text };
    let others = || verified.methods.iter().filter(|m| m.name != standard.name && m.name != "geometric");
    // The paraxial form stands in the other tables; here there is no room for it.
    let timed = || others().filter(|m| m.name != "paraxial");
    let names = ["case", "wbsdf", "time", "set-up"].into_iter().map(str::to_owned);
    let heads = timed().flat_map(|m| [m.name.to_owned(), "time".to_owned()]);
    let mut cases = table(names.chain(heads).collect(), 1);
    for kind in verified.kinds() {
        let time_of = |m: &Method| time(Verified::time_per_level_s(verified.trials_of(m).filter(|t| t.kind() == kind)));
        let of = |m: &Method| verified.errors(m, |e| e.trial.kind() == kind);
        let set_up = time(Verified::set_up_s(verified.trials_of(standard).filter(|t| t.kind() == kind)));
        let own = [case_name(kind), high(of(standard)), time_of(standard), set_up];
        let other = |m: &Method| [of(m).map_or("–".to_owned(), |q| error(q.p90_db)), time_of(m)];
        cases.add_row(own.into_iter().chain(timed().flat_map(other)));
    }
    add("By case: 90th percentile / max of wbsdf, 90th percentile of the others, time per level", cases);

    let shown = || std::iter::once(standard).chain(others());
    let columns =
        |first: &str| std::iter::once(first.to_owned()).chain(shown().map(|m| m.name.to_owned())).collect::<Vec<_>>();
    let mut regions = table(columns("region"), 1);
    for region in verified.regions() {
        let of = |m| high(verified.errors(m, |e| e.octave() && e.level.region == region));
        regions.add_row(std::iter::once(region.to_owned()).chain(shown().map(of)));
    }
    add("By region, octave bands: 90th percentile / max", regions);

    let mut bands = table(columns("band"), 1);
    for band_hz in verified.octaves_hz() {
        let of = |m| high(verified.errors(m, |e| e.octave() && e.level.band_hz == band_hz));
        bands.add_row(std::iter::once(notation::band(band_hz)).chain(shown().map(of)));
    }
    add("By octave band: 90th percentile / max", bands);

    let mut bars = table(header(&["wbsdf", "levels", "asked", "reached", ""]), 1);
    for bar in verified.bars() {
        let Some(q) = bar.reached else { continue };
        bars.add_row([
            bar.what.to_owned(),
            q.levels.to_string(),
            format!("≤ {} / {} dB", bar.p90_db, bar.max_db),
            format!("{} / {} dB", error(q.p90_db), error(q.max_db)),
            met(bar.met()).to_owned(),
        ]);
    }
    for ratio in verified.ratios() {
        bars.add_row([
            format!("time a level: {} / wbsdf, {}", ratio.other, ratio.which()),
            String::new(),
            format!("≥ {}", times(ratio.least_wanted)),
            format!("{} ({}; {})", times(ratio.median), times(ratio.least), times(ratio.overall)),
            met(ratio.met()).to_owned(),
        ]);
    }
    if let Some(set_up) = verified.set_up() {
        bars.add_row([
            format!("set-up of a scene, {} cases", set_up.cases),
            String::new(),
            format!("≤ {}", time(Some(set_up.most_wanted_s))),
            format!("{} ({})", time(Some(set_up.longest_s)), time(Some(set_up.median_s))),
            met(set_up.met()).to_owned(),
        ]);
    }
    add("What is asked of wbsdf: 90th percentile / max; times: median (least; all); set-up: longest (median)", bars);
    let left_out = left_out(verified);
    if !left_out.is_empty() {
        text.push_str(&format!("\n{left_out}\n"));
    }
    text
}

/// Words for a bar.
pub(super) fn met(met: bool) -> &'static str {
    if met { "met" } else { "NOT MET" }
}

/// "slit, line, tone".
pub(super) fn case_name((name, source, mean): (&str, &str, &str)) -> String {
    format!("{name}, {source}{}", if mean == "tone" { ", tone" } else { "" })
}
