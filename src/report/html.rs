//! `report.html`: one self-contained page without scripts, in light and dark, for wide and narrow screens.

use std::fmt::Write as _;

use super::beside::comparisons;
use super::ink::Ink;
use super::notation::{self, escaped};
use super::series::{Series, rises};
use super::tables::doubts;
use super::{Pair, ReferenceCurve, Run, Simulated, Swept, charts, console};
use crate::error::Result;
use crate::probe::Reception;
use crate::response::DecayTime;

const STYLE: &str = include_str!("page.css");

/// Pairs whose charts are shown without a click.
const OPEN_PAIRS: usize = 4;

/// Adds formatted text; writing to a `String` cannot fail.
macro_rules! put {
    ($out:expr, $($arg:tt)*) => {{ let _ = writeln!($out, $($arg)*); }};
}

/// The report of a simulation.
pub(super) fn simulation_page(results: &Simulated) -> Result<String> {
    let run = &results.run;
    let mut body = String::new();
    put!(body, "<h2>Band levels</h2>");
    levels_tables(&mut body, run, results.receptions());
    for (i, pair) in results.pairs.iter().enumerate() {
        let name = pair_name(&pair.reception.source, &pair.reception.probe);
        let figures = pair_figures(results, pair, &name)?;
        folded(&mut body, &name, &figures, i < OPEN_PAIRS);
    }
    if results.pairs.iter().any(|p| !p.metrics.is_empty()) {
        put!(body, "<h2>Decay and clarity</h2>");
        decay_table(&mut body, &results.pairs);
    }
    Ok(page(run, "simulation", &body))
}

/// The report of a sweep.
pub(super) fn sweep_page(results: &Swept) -> Result<String> {
    let act = notation::act_of(&results.parameter);
    let mut body = String::new();
    put!(body, "<h2>Where {act} raises the level</h2>");
    put!(
        body,
        "<p>Intervals of <code>{}</code> in which the level falls while the value grows: going back from the upper to the \
         lower end makes it louder.</p>",
        escaped(&results.parameter)
    );
    rises_table(&mut body, results);
    beside_table(&mut body, results);
    for (i, (source, probe)) in pairs_of(results).into_iter().enumerate() {
        let of_pair: Vec<&Series> = results.series.iter().filter(|s| s.source == source && s.probe == probe).collect();
        let name = pair_name(source, probe);
        let figures = sweep_figures(results, &of_pair, &name)?;
        folded(&mut body, &name, &figures, i < OPEN_PAIRS);
    }
    Ok(page(&results.run, "sweep", &body))
}

/// A self-contained page: `head` stands below the title, `foot` in the footer.
pub(crate) fn document(title: &str, kind: &str, head: &str, body: &str, foot: &str) -> String {
    let title = escaped(title);
    let mut out = String::new();
    put!(out, "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">");
    put!(out, "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">");
    put!(out, "<title>{title} – diffray {kind}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>");
    put!(out, "<header>\n<h1>{title}</h1>");
    put!(out, "<p class=\"muted\">Acoustic {kind} by diffray {}</p>", env!("CARGO_PKG_VERSION"));
    put!(out, "{head}</header>\n{body}\n<footer>{foot}</footer>\n</body>\n</html>");
    out
}

/// Everything around the results: head, facts, warnings, plan and room file.
fn page(run: &Run, kind: &str, body: &str) -> String {
    let mut head = String::new();
    facts(&mut head, run);
    let mut out = String::new();
    if !run.warnings.is_empty() {
        put!(out, "<section class=\"warnings\">\n<h2>Warnings</h2>\n<ul>");
        for w in &run.warnings {
            put!(out, "<li>{}<br>{}</li>", escaped(&w.observation), escaped(&w.remedy));
        }
        put!(out, "</ul>\n</section>");
    }
    put!(out, "<main>\n{body}</main>");
    if !run.plan_text.is_empty() {
        put!(out, "<h2>What was modelled, and why</h2>\n<pre>{}</pre>", escaped(run.plan_text.trim_end()));
    }
    put!(
        out,
        "<h2>Room file</h2>\n<p class=\"muted\"><code>{}</code>",
        escaped(&run.source.file.display().to_string())
    );
    put!(out, "<br>SHA-256 <code>{}</code></p>", run.source.sha256);
    if !run.set.is_empty() {
        put!(out, "<p>Changed on the command line:</p>\n<pre>{}</pre>", escaped(&run.set.join("\n")));
    }
    put!(out, "<details>\n<summary>Show the room file</summary>\n<pre>{}</pre>\n</details>", escaped(&run.source.text));
    let foot = "Levels are relative to the same source's free field at 1 m.\n\
                Every number is in the CSV files beside this page.";
    document(&run.name, kind, &head, &out, foot)
}

fn facts(out: &mut String, run: &Run) {
    let total_s: f64 = run.times_s.iter().map(|(_, s)| s).sum();
    let phases: Vec<String> =
        run.times_s.iter().map(|(phase, s)| format!("{} {}", escaped(phase), notation::duration(*s))).collect();
    let bands = match (run.bands.first(), run.bands.last()) {
        (Some(low), Some(high)) if run.bands.len() > 1 => format!(
            "{} from {} to {}",
            run.bands.len(),
            notation::band(low.nominal_hz),
            notation::band(high.nominal_hz)
        ),
        (Some(only), _) => notation::band(only.nominal_hz),
        _ => "none".to_owned(),
    };
    let rays = if run.rays == 0 { "none traced".to_owned() } else { notation::grouped(run.rays) };
    let rows = [
        ("Bands", bands),
        ("Rays", format!("{rays}<br><small>{}</small>", escaped(&run.stop))),
        ("Time", format!("{}<br><small>{}</small>", notation::duration(total_s), phases.join(", "))),
        ("Seed", run.simulation.seed.to_string()),
    ];
    facts_list(out, &rows);
}

/// Terms with their values, as HTML.
pub(crate) fn facts_list(out: &mut String, rows: &[(&str, String)]) {
    put!(out, "<dl class=\"facts\">");
    for (term, value) in rows {
        put!(out, "<div><dt>{term}</dt><dd>{value}</dd></div>");
    }
    put!(out, "</dl>");
}

/// Charts of one pair: open for the first pairs, folded away for the others.
fn folded(out: &mut String, name: &str, figures: &str, open: bool) {
    let name = escaped(name);
    if open {
        put!(out, "<section>\n<h3>{name}</h3>\n{figures}</section>");
    } else {
        put!(out, "<details>\n<summary>{name}</summary>\n{figures}</details>");
    }
}

fn pair_name(source: &str, probe: &str) -> String {
    format!("{source} → {probe}")
}

/// A level for a cell, with a real minus sign.
fn decibels(db: f64, digits: usize) -> String {
    notation::level(db, digits).replace('-', "−").replace("inf", "∞")
}

fn levels_tables<'a>(out: &mut String, run: &Run, receptions: impl Iterator<Item = &'a Reception> + Clone) {
    let header = |out: &mut String, caption: &str| {
        put!(out, "<div class=\"scroll\"><table>\n<caption>{caption}</caption>");
        let bands: String = run.bands.iter().map(|b| format!("<th>{}</th>", notation::band(b.nominal_hz))).collect();
        put!(out, "<thead><tr><th class=\"left\">source → probe</th>{bands}</tr></thead>\n<tbody>");
    };
    let with_error = console::errors_matter(receptions.clone());
    let errors = if with_error { "with standard error" } else { "standard errors below 0.005 dB" };
    header(out, &format!("Level in dB re the source's free field at 1 m, {errors}"));
    for r in receptions.clone() {
        put!(out, "<tr><th scope=\"row\">{}</th>", escaped(&pair_name(&r.source, &r.probe)));
        for level in &r.levels {
            let (db, error) = (level.level_db(), level.std_error_db());
            let error = if with_error && db.is_finite() && error > 0.0 {
                format!(" <small>±{}</small>", significant(error))
            } else {
                String::new()
            };
            put!(out, "<td>{}{error}</td>", decibels(db, 2));
        }
        put!(out, "</tr>");
    }
    put!(out, "</tbody></table></div>");
    let powered: Vec<&Reception> = receptions.filter(|r| run.spl_1m_db(&r.source, 0).is_some()).collect();
    if powered.is_empty() {
        return;
    }
    header(out, "Sound pressure level in dB re 20 µPa");
    for r in powered {
        put!(out, "<tr><th scope=\"row\">{}</th>", escaped(&pair_name(&r.source, &r.probe)));
        for (band, level) in r.levels.iter().enumerate() {
            let spl =
                run.spl_1m_db(&r.source, band).map_or(String::new(), |at_1m| decibels(at_1m + level.level_db(), 1));
            put!(out, "<td>{spl}</td>");
        }
        put!(out, "</tr>");
    }
    put!(out, "</tbody></table></div>");
}

/// A standard error in dB with two decimals, or "<0.01".
fn significant(error_db: f64) -> String {
    if error_db < 0.005 { "&lt;0.01".to_owned() } else { format!("{error_db:.2}") }
}

pub(crate) fn figure(out: &mut String, heading: &str, svg: Option<String>, caption: &str) {
    match svg {
        Some(svg) => {
            put!(out, "<figure>\n<h4>{heading}</h4>\n{svg}\n<figcaption>{caption}</figcaption>\n</figure>");
        }
        None => put!(out, "<figure>\n<h4>{heading}</h4>\n<p class=\"muted\">Nothing arrives.</p>\n</figure>"),
    }
}

fn pair_figures(results: &Simulated, pair: &Pair, name: &str) -> Result<String> {
    let reception = &pair.reception;
    let mut out = String::from("<div class=\"gallery\">\n");
    let bars = charts::levels(&format!("Band levels, {name}"), &results.run.bands, &reception.levels)?;
    let early =
        if reception.echogram.is_some() { " Orange line: what arrives on deterministic paths alone." } else { "" };
    figure(&mut out, "Band levels", bars, &format!("Vertical stroke: plus and minus one standard error.{early}"));
    if let Some(response) = &pair.response {
        let wave = charts::waveform(&format!("Impulse response, {name}"), response)?;
        figure(
            &mut out,
            "Impulse response",
            wave,
            "Pressure relative to the free-field peak at 1 m; time from emission.",
        );
        let energy = charts::energy_time_curve(&format!("Energy over time, {name}"), response)?;
        figure(
            &mut out,
            "Energy over time",
            energy,
            "Blue: squared pressure re its maximum. Orange: backward-integrated decay.",
        );
    }
    put!(out, "</div>");
    paths_table(&mut out, results, reception);
    Ok(out)
}

/// The strongest deterministic paths in order of arrival.
fn paths_table(out: &mut String, results: &Simulated, reception: &Reception) {
    const SHOWN: usize = 20;
    if reception.paths.is_empty() {
        return;
    }
    let strength = |i: &usize| reception.paths[*i].intensity.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..reception.paths.len()).collect();
    order.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    order.truncate(SHOWN);
    order.sort_unstable();
    put!(
        out,
        "<details>\n<summary>Deterministic paths ({})</summary>\n<div class=\"scroll\"><table>",
        reception.paths.len()
    );
    if reception.paths.len() > SHOWN {
        put!(out, "<caption>The strongest {SHOWN}; level in dB re free field at 1 m</caption>");
    } else {
        put!(out, "<caption>Level in dB re free field at 1 m</caption>");
    }
    let bands: String =
        results.run.bands.iter().map(|b| format!("<th>{}</th>", notation::band(b.nominal_hz))).collect();
    put!(out, "<thead><tr><th class=\"left\">path</th><th>arrival (ms)</th>{bands}</tr></thead>\n<tbody>");
    for path in order.into_iter().map(|i| &reception.paths[i]) {
        put!(out, "<tr><th scope=\"row\">{}</th><td>{:.2}</td>", escaped(&path.label), path.delay_s * 1e3);
        for intensity in &path.intensity {
            put!(out, "<td>{}</td>", decibels(10.0 * intensity.log10(), 1));
        }
        put!(out, "</tr>");
    }
    put!(out, "</tbody></table></div>\n</details>");
}

fn decay_table(out: &mut String, pairs: &[Pair]) {
    put!(
        out,
        "<div class=\"scroll\"><table>\n<caption>ISO 3382-1; small: correlation of the fit</caption>\n<thead><tr>"
    );
    put!(out, "<th class=\"left\">source → probe</th><th>band</th><th>EDT (s)</th><th>T20 (s)</th><th>T30 (s)</th>");
    put!(
        out,
        "<th>C50 (dB)</th><th>C80 (dB)</th><th>D50</th><th>Ts (ms)</th><th class=\"left\">note</th></tr></thead>\n<tbody>"
    );
    let plain = |x: Option<f64>, digits: usize| x.map_or("–".to_owned(), |x| decibels(x, digits));
    let fitted = |d: &DecayTime| match (d.seconds, d.correlation) {
        (Some(seconds), Some(r)) => format!("{seconds:.2} <small>{:.3}</small>", r.abs()),
        (seconds, _) => plain(seconds, 2),
    };
    for (pair, m) in pairs.iter().flat_map(|p| p.metrics.iter().map(move |m| (p, m))) {
        put!(
            out,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td>",
            escaped(&pair_name(&pair.reception.source, &pair.reception.probe)),
            notation::band(m.band_hz),
            fitted(&m.edt),
            fitted(&m.t20),
            fitted(&m.t30)
        );
        put!(
            out,
            "<td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"note\">{}</td></tr>",
            plain(m.c50_db, 1),
            plain(m.c80_db, 1),
            plain(m.d50, 2),
            plain(m.ts_s.map(|s| s * 1e3), 0),
            escaped(&doubts(m))
        );
    }
    put!(out, "</tbody></table></div>");
}

fn rises_table(out: &mut String, results: &Swept) {
    let unit = notation::unit_of(&results.parameter);
    let unit = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
    if results.series.iter().all(|s| console::largest_rise(s).1 == 0) {
        put!(out, "<p>There is none: every level grows with the value.</p>");
        return;
    }
    largest_rises_table(out, results, &pairs_of(results));
    put!(out, "<details>\n<summary>All intervals</summary>");
    put!(out, "<div class=\"scroll\"><table>\n<thead><tr><th class=\"left\">source → probe</th><th>band</th>");
    put!(
        out,
        "<th>from{unit}</th><th>to{unit}</th><th>level before (dB)</th><th>after (dB)</th><th>rise (dB)</th></tr></thead>"
    );
    put!(out, "<tbody>");
    for s in &results.series {
        for r in rises(&s.points).iter().filter(|r| r.rise_db >= 0.05) {
            let error = if r.std_error_db > 0.0 {
                format!(" <small>±{}</small>", significant(r.std_error_db))
            } else {
                String::new()
            };
            put!(
                out,
                "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}{error}</td></tr>",
                escaped(&pair_name(&s.source, &s.probe)),
                notation::band(s.band_hz),
                notation::trimmed(r.value_high, 4),
                notation::trimmed(r.value_low, 4),
                decibels(r.level_high_db, 2),
                decibels(r.level_low_db, 2),
                decibels(r.rise_db, 2)
            );
        }
    }
    put!(out, "</tbody></table></div>");
    put!(out, "<p class=\"muted\">Rises below 0.05 dB are left out here; closing.csv has all.</p>\n</details>");
}

/// The largest rises and the differences of the levels beside the reference curves, where there are any.
fn beside_table(out: &mut String, results: &Swept) {
    let all = comparisons(results);
    let Some(first) = all.first() else { return };
    let unit = notation::unit_of(&results.parameter);
    put!(out, "<details>\n<summary>Beside the reference {}</summary>", escaped(&first.reference.label));
    put!(out, "<div class=\"scroll\"><table>\n<thead><tr><th class=\"left\">source → probe</th><th>band</th>");
    put!(out, "<th>largest rise here (dB)</th><th>in the reference (dB)</th><th>values in common</th>");
    put!(out, "<th>median |difference| (dB)</th><th>largest (dB)</th></tr></thead>\n<tbody>");
    let rise = |r: Option<super::Rise>| r.map_or("–".to_owned(), |r| decibels(r.rise_db, 2));
    for c in &all {
        put!(
            out,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td>",
            escaped(&pair_name(&c.series.source, &c.series.probe)),
            notation::band(c.series.band_hz),
            rise(c.rise),
            rise(c.reference_rise),
            c.common
        );
        match c.largest {
            Some((value, db)) => put!(
                out,
                "<td>{}</td><td>{} <small>at {} {unit}</small></td></tr>",
                decibels(c.median_db, 2),
                decibels(db, 2),
                notation::trimmed(value, 4)
            ),
            None => put!(out, "<td>–</td><td>–</td></tr>"),
        }
    }
    put!(out, "</tbody></table></div>\n</details>");
}

/// The sources and probes of a sweep in order of appearance.
fn pairs_of(results: &Swept) -> Vec<(&str, &str)> {
    let mut pairs: Vec<(&str, &str)> = Vec::new();
    for s in &results.series {
        if !pairs.contains(&(&s.source, &s.probe)) {
            pairs.push((&s.source, &s.probe));
        }
    }
    pairs
}

/// One row a pair, one column a band: the largest rise and where it is.
fn largest_rises_table(out: &mut String, results: &Swept, pairs: &[(&str, &str)]) {
    put!(out, "<div class=\"scroll\"><table>\n<caption>Largest rise in dB, and between which values</caption>");
    let mut bands: Vec<f64> = results.series.iter().map(|s| s.band_hz).collect();
    bands.sort_by(f64::total_cmp);
    bands.dedup();
    let header: String = bands.iter().map(|b| format!("<th>{}</th>", notation::band(*b))).collect();
    put!(out, "<thead><tr><th class=\"left\">source → probe</th>{header}</tr></thead>\n<tbody>");
    for (source, probe) in pairs {
        put!(out, "<tr><th scope=\"row\">{}</th>", escaped(&pair_name(source, probe)));
        let in_band =
            |b: &f64| results.series.iter().find(|s| s.source == *source && s.probe == *probe && s.band_hz == *b);
        for series in bands.iter().map(in_band) {
            match series.and_then(|s| console::largest_rise(s).0) {
                Some(r) => {
                    let (from, to) = (notation::trimmed(r.value_high, 4), notation::trimmed(r.value_low, 4));
                    put!(out, "<td>{}<br><small>{from} → {to}</small></td>", decibels(r.rise_db, 2));
                }
                None => put!(out, "<td>–</td>"),
            }
        }
        put!(out, "</tr>");
    }
    put!(out, "</tbody></table></div>");
}

fn sweep_figures(results: &Swept, of_pair: &[&Series], name: &str) -> Result<String> {
    let act = notation::act_of(&results.parameter);
    let unit = notation::unit_of(&results.parameter);
    let axis = if unit.is_empty() { results.parameter.clone() } else { format!("{} ({unit})", results.parameter) };
    let mut out = String::from("<div class=\"gallery\">\n");
    if of_pair.len() > 1 {
        let lines: Vec<_> =
            of_pair.iter().enumerate().map(|(i, s)| (Ink::of_band(i, of_pair.len()), s.points.as_slice())).collect();
        let svg = charts::sweep_overview(&format!("Level against {}, {name}", results.parameter), &axis, &lines)?;
        let keys: Vec<(Ink, String)> =
            lines.iter().zip(of_pair).map(|((ink, _), s)| (*ink, notation::band(s.band_hz))).collect();
        figure(&mut out, "All bands", svg, &legend(&keys));
    }
    for s in of_pair {
        let band = notation::band(s.band_hz);
        let references: Vec<&ReferenceCurve> = results
            .references
            .iter()
            .filter(|r| r.source == s.source && r.probe == s.probe && r.band_hz == s.band_hz)
            .collect();
        let found = rises(&s.points);
        let title = format!("Level against {}, {name}, {band}", results.parameter);
        let svg = charts::sweep(&title, &axis, &s.points, &found, &references)?;
        let mut keys = Vec::new();
        if !references.is_empty() {
            keys.push((Ink::Level, "this run".to_owned()));
            keys.extend(references.iter().map(|r| (Ink::Reference, r.label.clone())));
        }
        let mut caption = legend(&keys);
        if !found.is_empty() {
            let _ = write!(caption, "Shaded: {act} raises the level. ");
        }
        if charts::sweep_cuts_levels_off(&s.points, &references) {
            caption.push_str("Lower levels are below the axis.");
        }
        figure(&mut out, &band, svg, &caption);
    }
    put!(out, "</div>");
    Ok(out)
}

/// Samples of the line colours with their meaning; empty without keys.
pub(crate) fn legend(keys: &[(Ink, String)]) -> String {
    if keys.is_empty() {
        return String::new();
    }
    let items: String = keys
        .iter()
        .map(|(ink, text)| {
            let line =
                format!("<line x1=\"0\" y1=\"5\" x2=\"24\" y2=\"5\" stroke-width=\"3\" class=\"s-{}\"/>", ink.name());
            let sample = format!("<svg viewBox=\"0 0 24 10\" aria-hidden=\"true\">{line}</svg>");
            format!("<li>{sample}{}</li>", escaped(text))
        })
        .collect();
    format!("<ul class=\"legend\">{items}</ul>")
}
