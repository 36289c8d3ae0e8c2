//! `report.html` of a verification.

use std::fmt::Write as _;

use super::cases::Case;
use super::measure::Method;
use super::summary::{Entry, Quantiles};
use super::text::{self, case_name, error, errors, high, met, time, times};
use super::{Extent, Verified};
use crate::error::Result;
use crate::report::html::{document, facts_list, figure, legend};
use crate::report::ink::Ink;
use crate::report::notation::{self, escaped};
use crate::report::pareto::{FLOOR_DB, Marks, chart};
use crate::scene::Transport;

/// Adds formatted text; writing to a `String` cannot fail.
macro_rules! put {
    ($out:expr, $($arg:tt)*) => {{ let _ = writeln!($out, $($arg)*); }};
}

/// The report.
pub(super) fn page(verified: &Verified) -> Result<String> {
    let mut head = String::new();
    facts(&mut head, verified);
    let mut body = String::from("<main>\n");
    put!(
        body,
        "<p>Every case is run from a room file as a user would run it, and its levels are compared with exact solutions of the \
         wave equation by other programs. An error is |level − exact level| in dB.</p>"
    );
    bars(&mut body, verified);
    pareto(&mut body, verified)?;
    put!(body, "<h2>By transport</h2>");
    by_method(&mut body, verified);
    put!(body, "<h2>By case</h2>");
    by_case(&mut body, verified);
    put!(body, "<h2>By region and band</h2>");
    put!(
        body,
        "<p>Transition: Fresnel number below 0.5 at the nearest edge. Oblique: behind a slit more than 75° off its normal. All: \
         thick walls and rectangles, whose tables do not tell regions.</p>"
    );
    let regions: Vec<(String, &str)> = verified.regions().into_iter().map(|r| (r.to_owned(), r)).collect();
    groups(&mut body, verified, "region", &regions, |e, region| e.level.region == *region);
    let bands: Vec<(String, f64)> = verified.octaves_hz().into_iter().map(|hz| (notation::band(hz), hz)).collect();
    groups(&mut body, verified, "band", &bands, |e, hz| e.level.band_hz == *hz);
    notes(&mut body, verified);
    put!(body, "</main>");
    let foot = "Every group of levels is a row of verify.csv beside this page.";
    Ok(document("Verification against exact solutions", "verification", &head, &body, foot))
}

fn facts(out: &mut String, verified: &Verified) {
    let mut seen: Vec<(usize, &Case)> = Vec::new();
    for trial in &verified.trials {
        if !seen.iter().any(|(index, _)| *index == trial.index) {
            seen.push((trial.index, &trial.case));
        }
    }
    let levels: usize = seen.iter().map(|(_, case)| case.levels.len()).sum();
    let extent = match verified.extent {
        Extent::Full => "all cases",
        Extent::Fast => "fast: one case of a kind",
    };
    let rows = [
        ("Extent", extent.to_owned()),
        ("Cases", seen.len().to_string()),
        ("Exact levels", notation::grouped(levels as u64)),
        ("Time", notation::duration(verified.time_s)),
    ];
    facts_list(out, &rows);
}

fn open_table(out: &mut String, caption: &str, columns: &[String]) {
    put!(out, "<div class=\"scroll\"><table>\n<caption>{caption}</caption>\n<thead><tr>");
    for (i, column) in columns.iter().enumerate() {
        put!(out, "<th{}>{column}</th>", if i == 0 { " class=\"left\"" } else { "" });
    }
    put!(out, "</tr></thead>\n<tbody>");
}

fn row(out: &mut String, first: &str, cells: impl Iterator<Item = String>) {
    put!(out, "<tr><th scope=\"row\">{first}</th>");
    for cell in cells {
        put!(out, "<td>{cell}</td>");
    }
    put!(out, "</tr>");
}

const CLOSE_TABLE: &str = "</tbody></table></div>";

fn columns(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|t| (*t).to_owned()).collect()
}

/// Error cells are safe but for "&lt;".
fn cell(text: String) -> String {
    escaped(&text).replace("inf", "∞")
}

fn bars(out: &mut String, verified: &Verified) {
    put!(out, "<h2>What is asked of signed rays, and what they reach</h2>");
    let verdict = |ok: bool| format!("<span class=\"{}\">{}</span>", if ok { "met" } else { "not-met" }, met(ok));
    open_table(
        out,
        "Errors: 90th percentile / largest, dB. Times: median of the cases (least of a case; time of all levels together)",
        &columns(&["levels", "number", "asked", "reached", ""]),
    );
    for bar in verified.bars() {
        let Some(q) = bar.reached else { continue };
        let asked = format!("≤ {} / {}", bar.p90_db, bar.max_db);
        let reached = cell(format!("{} / {}", error(q.p90_db), error(q.max_db)));
        row(out, &escaped(bar.what), [q.levels.to_string(), asked, reached, verdict(bar.met())].into_iter());
    }
    for ratio in verified.ratios() {
        let what = format!("time a level, {} : wbsdf, octave bands", ratio.other);
        let reached =
            format!("{} <small>({}; {})</small>", times(ratio.median), times(ratio.least), times(ratio.overall));
        let cells = [ratio.which(), format!("≥ {}", times(ratio.least_wanted)), reached, verdict(ratio.met())];
        row(out, &what, cells.into_iter());
    }
    if let Some(set_up) = verified.set_up() {
        let cells = [
            format!("{} cases", set_up.cases),
            format!("≤ {}", time(Some(set_up.most_wanted_s))),
            format!("{} <small>(median {})</small>", time(Some(set_up.longest_s)), time(Some(set_up.median_s))),
            verdict(set_up.met()),
        ];
        row(out, "set-up of a scene, octave bands: the longest", cells.into_iter());
    }
    put!(out, "{CLOSE_TABLE}");
}

fn ink(transport: Transport) -> Ink {
    match transport {
        Transport::Wbsdf => Ink::Level,
        Transport::Paraxial => Ink::Early,
        Transport::Utd => Ink::Band(5),
        Transport::Exact => Ink::Band(0),
        Transport::Geometric => Ink::Band(9),
    }
}

/// Marks of all transports over the chosen levels.
fn marks(verified: &Verified, chosen: impl Fn(&Entry<'_>) -> bool, error_of: fn(&Quantiles) -> f64) -> Vec<Marks> {
    let mut all: Vec<Marks> = Vec::new();
    for method in &verified.methods {
        let Some(q) = verified.errors(method, &chosen) else { continue };
        let mut indices: Vec<usize> = verified.entries(method).filter(&chosen).map(|e| e.trial.index).collect();
        indices.dedup();
        let timed = verified.trials_of(method).filter(|t| indices.contains(&t.index));
        let Some(time_s) = Verified::time_per_level_s(timed) else { continue };
        let point = (time_s, error_of(&q));
        match all.iter_mut().find(|m| m.name == method.name) {
            Some(marks) => marks.points.push(point),
            None => all.push(Marks { ink: ink(method.transport), name: method.name.to_owned(), points: vec![point] }),
        }
    }
    all
}

fn pareto(out: &mut String, verified: &Verified) -> Result<()> {
    put!(out, "<h2>Error against time</h2>");
    put!(
        out,
        "<p>Down and left is better. One mark a transport; signed rays have one for each ray budget, joined by a line, the last and \
         named one with the tolerance of 0.002 that every room gets (all of them lie on one another where the first rays already meet it). Errors below {FLOOR_DB} dB are drawn there. What is \
         silent in a shadow is infinitely wrong and has no mark.</p>"
    );
    put!(out, "<div class=\"gallery\">");
    type ErrorOf = fn(&Quantiles) -> f64;
    let kinds: [(&str, ErrorOf); 2] = [("median", |q| q.median_db), ("90th percentile", |q| q.p90_db)];
    for (name, error_of) in kinds {
        let marks = marks(verified, |e| e.octave(), error_of);
        let keys: Vec<(Ink, String)> = marks.iter().map(|m| (m.ink, m.name.clone())).collect();
        let heading = format!("All octave bands, {name}");
        let svg = chart(&format!("Error against time, {heading}"), &format!("{name} of the error (dB)"), &marks)?;
        figure(out, &heading, svg, &legend(&keys));
    }
    put!(out, "</div>\n<details>\n<summary>The same for every kind of case (90th percentile)</summary>");
    put!(out, "<div class=\"gallery\">");
    let mut names: Vec<&str> = verified.kinds().into_iter().map(|k| k.0).collect();
    names.dedup();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let marks = marks(verified, |e| e.octave() && e.trial.case.name == name, |q| q.p90_db);
        let svg = chart(&format!("Error against time, {name}"), "90th percentile of the error (dB)", &marks)?;
        figure(out, &escaped(name), svg, "");
    }
    put!(out, "</div>\n</details>");
    Ok(())
}

fn by_method(out: &mut String, verified: &Verified) {
    let caption = "Median / 90th percentile / largest error in dB; time per level of the octave bands on one thread, and the longest set-up of a scene";
    open_table(
        out,
        caption,
        &columns(&["transport, tolerance", "levels", "octave bands", "tones", "time per level", "set-up"]),
    );
    for method in &verified.methods {
        let octaves = verified.errors(method, |e| e.octave());
        let timed = verified.trials_of(method).filter(|t| t.case.mean == "octave");
        let cells = [
            octaves.map_or(0, |q| q.levels).to_string(),
            cell(errors(octaves)),
            cell(errors(verified.errors(method, |e| !e.octave()))),
            time(Verified::time_per_level_s(timed.clone())),
            time(Verified::set_up_s(timed)),
        ];
        row(out, &method.label(), cells.into_iter());
    }
    put!(out, "{CLOSE_TABLE}");
}

/// Signed rays as rooms get them and the other transports.
fn shown(verified: &Verified) -> Vec<&Method> {
    let others = verified.methods.iter().filter(|m| m.transport != Transport::Wbsdf);
    verified.standard().into_iter().chain(others).collect()
}

fn by_case(out: &mut String, verified: &Verified) {
    let methods = shown(verified);
    let mut header = columns(&["case"]);
    header.extend(methods.iter().map(|m| m.name.to_owned()));
    let caption =
        "90th percentile / largest error in dB; below it the time per level, and the longest set-up of a scene";
    open_table(out, caption, &header);
    for kind in verified.kinds() {
        let of = |m: &&Method| {
            let Some(q) = verified.errors(m, |e| e.trial.kind() == kind) else { return "–".to_owned() };
            let timed = verified.trials_of(m).filter(|t| t.kind() == kind);
            let (level, set_up) = (Verified::time_per_level_s(timed.clone()), Verified::set_up_s(timed));
            format!("{}<br><small>{} + {}</small>", cell(high(Some(q))), time(level), time(set_up))
        };
        row(out, &escaped(&case_name(kind)), methods.iter().map(of));
    }
    put!(out, "{CLOSE_TABLE}");
}

fn groups<G>(
    out: &mut String,
    verified: &Verified,
    name: &str,
    groups: &[(String, G)],
    within: impl Fn(&Entry<'_>, &G) -> bool,
) {
    let methods = shown(verified);
    let mut header = columns(&[name, "levels"]);
    header.extend(methods.iter().map(|m| m.name.to_owned()));
    open_table(out, "90th percentile / largest error in dB, octave bands", &header);
    for (name, group) in groups {
        let of = |m: &&Method| verified.errors(m, |e| e.octave() && within(e, group));
        let levels = methods.first().and_then(of).map_or(0, |q| q.levels).to_string();
        row(out, name, std::iter::once(levels).chain(methods.iter().map(|m| cell(high(of(m))))));
    }
    put!(out, "{CLOSE_TABLE}");
}

fn notes(out: &mut String, verified: &Verified) {
    put!(out, "<h2>How this was measured</h2>\n<ul>");
    let mut notes = vec![
        "Rigid walls, c = 343 m/s, no absorption, no traced rays: these are the deterministic paths. An octave level is the mean of the \
         intensity over 64 equally spaced frequencies in the exact solution."
            .to_owned(),
        "Half-planes and wedges are walls with free edges; their line and point fields are closed solutions of the program (a \
         contour integral) and know no ray budget. “Open half-plane” is the same edge, left by an opening in an unbounded wall."
            .to_owned(),
        "Beside a rigid face the exact level is that of direct, reflected and diffracted sound together; these rooms have \
         <code>interference = true</code>."
            .to_owned(),
        "The time is that of one run (image sources, paths and levels) on one thread, divided by probes × bands: the quickest of the \
         repetitions within 4 ms. Reading the room file and building the geometry are not in it, and neither are tables that belong to an \
         opening and a band alone; a first run with new tables takes longer by the set-up. What belongs to one source or one probe is found \
         anew in every run. The uniform theory has no tables, and the exact transport, which is \
         compared where there are openings (at single edges it is the same closed form), factorises its matrices for every level anew. \
         Levels that the reference does not have are computed all the same and count in the division."
            .to_owned(),
        format!(
            "The exact transport is run for the first {} probes of a case, one case of each kind before the next, for at most {} s; its \
             cases are compared with the same cases of signed rays.",
            super::EXACT_PROBES,
            verified.extent.exact_s()
        ),
        "Rectangles are compared with boundary elements that are themselves uncertain by 0.05 dB.".to_owned(),
    ];
    notes.extend(Some(text::left_out(verified)).filter(|t| !t.is_empty()).map(|t| escaped(&t)));
    for note in notes {
        put!(out, "<li>{note}</li>");
    }
    put!(out, "</ul>");
}
