//! What each subcommand does: read the room, plan, run, write.

mod listen;
mod verify;

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use clap::CommandFactory;
use diffray::error::{Error, Result, Warning};
use diffray::geometry::Geometry;
use diffray::plan::Plan;
use diffray::probe::TableCost;
use diffray::report::{self, Folder, Pair, ReferenceCurve, Run, Series, Simulated, SweepValue, Swept, spl_at_1m_db};
use diffray::response::{self, Metrics, RenderOptions, Response, octave_levels_db, speech_transmission_index};
use diffray::scene::{Loaded, Override, ProbeFormat, Room, Scene, SourceKind, Sweep};
use diffray::simulate::{self, Outcome};
use diffray::sweep::{self, SweepPoint};
use rayon::prelude::*;

use crate::cli::{self, Cli, Command, RoomArgs, RunArgs};
use crate::progress::Bar;

/// Does what the arguments say.
pub(crate) fn run(command: Command) -> Result<()> {
    match command {
        Command::Simulate(args) => simulate(&args),
        Command::Sweep(args) => sweep(&args.run, args.listen.as_deref()),
        Command::Listen(args) => listen::run(&args),
        Command::Plan(args) => plan(&args),
        Command::Check(args) => check(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "diffray", &mut script);
            cli::print(&String::from_utf8_lossy(&script))
        }
    }
}

/// The values of the room file that the options change, in this order: `--set`, then options of their own.
fn overrides(args: &RoomArgs, set: &[String]) -> Result<Vec<Override>> {
    let own = [
        ("--seed", "simulation.seed", args.seed.map(|x| x.to_string())),
        ("--target-db", "simulation.target_db", args.target_db.map(|x| x.to_string())),
        ("--max-rays", "simulation.max_rays", args.max_rays.map(|x| x.to_string())),
        ("--max-time", "simulation.max_time_s", args.max_time.map(|x| x.to_string())),
    ];
    let own = own.iter().filter_map(|(option, path, value)| Some(Ok(Override::option(option, path, value.as_ref()?))));
    set.iter().map(|text| Override::parse(text)).chain(own).collect()
}

fn as_typed(overrides: &[Override]) -> Vec<String> {
    overrides.iter().map(|o| format!("{}={}", o.path(), o.value())).collect()
}

/// The checked scene, after telling what is odd about it.
fn load(args: &RoomArgs) -> Result<(Loaded, Vec<Override>)> {
    let overrides = overrides(args, &args.set)?;
    let loaded = Scene::load(&args.room, &overrides)?;
    Ok((loaded, overrides))
}

fn check(args: &RoomArgs) -> Result<()> {
    let (Loaded { scene, warnings, .. }, _) = load(args)?;
    let geometry = Geometry::new(&scene)?;
    cli::warn(&warnings);
    cli::print(&format!(
        "{}: ok\n{}: {}, {}, {}, {}; {}\n",
        args.room.display(),
        scene.name,
        counted(geometry.surfaces.len(), "surface"),
        counted(scene.openings.len(), "opening"),
        counted(scene.sources.len(), "source"),
        counted(scene.probes.len(), "probe"),
        counted(scene.bands.len(), "band"),
    ))
}

/// "1 source", "2 sources".
fn counted(n: usize, noun: &str) -> String {
    if n == 1 { format!("1 {noun}") } else { format!("{n} {noun}s") }
}

fn plan(args: &RoomArgs) -> Result<()> {
    let (Loaded { scene, warnings, .. }, _) = load(args)?;
    let geometry = Geometry::new(&scene)?;
    cli::warn(&warnings);
    cli::print(&format!("{}\n\n{}", scene.name, Plan::new(&scene, &geometry).text()))
}

/// Uses this many threads from now on.
fn use_threads(threads: Option<u16>) -> Result<()> {
    let Some(n) = threads else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(n)).build_global();
    pool.map_err(|e| Error::Run(format!("cannot start {n} threads: {e}")))
}

fn simulate(args: &RunArgs) -> Result<()> {
    let (loaded, overrides) = load(&args.room)?;
    let out = args.out();
    report::check_writable(&out)?;
    use_threads(args.threads)?;
    cli::warn(&loaded.warnings);
    let Loaded { scene, source, warnings } = loaded;
    let mut run = Run { warnings, ..Run::of(&scene, source, as_typed(&overrides)) };

    let bar = Bar::new(1, &scene.simulation, args.quiet);
    bar.say("planning");
    let start = Instant::now();
    let geometry = Geometry::new(&scene)?;
    let plan = Plan::new(&scene, &geometry);
    run.times_s.push(("plan".to_owned(), start.elapsed().as_secs_f64()));
    bar.say("deterministic paths");
    let outcome = simulate::run(&scene, &geometry, &plan, &|progress| bar.traced(0, "", &progress))?;
    bar.done(0);
    bar.say("impulse responses");
    let start = Instant::now();
    let (pairs, mut heard) = pairs(&scene, outcome.receptions);
    run.times_s.extend(outcome.times_s);
    run.opening_tables = outcome.tables;
    run.times_s.push(("responses".to_owned(), start.elapsed().as_secs_f64()));
    drop(bar);

    let mut found = outcome.warnings;
    found.append(&mut heard);
    cli::warn(&found);
    run.warnings.append(&mut found);
    run.rays = outcome.rays;
    run.stop = outcome.stop;
    run.plan_text = plan.text();
    run.plan = as_json(&plan)?;
    let results = Simulated { run, pairs };
    publish(&out, args.quiet, |folder| results.write(folder))?;
    cli::print(&report::levels_table(&results))
}

/// The impulse response and the metrics of every reception, and what to know about them.
fn pairs(scene: &Scene, receptions: Vec<diffray::probe::Reception>) -> (Vec<Pair>, Vec<Warning>) {
    let pair = |reception: diffray::probe::Reception| {
        let mut metrics = response::metrics(&reception, &scene.bands);
        let source = scene.sources.iter().find(|s| s.name == reception.source);
        let point = source.is_some_and(|s| s.kind == SourceKind::Point);
        let strength = |metrics: &mut Vec<Metrics>| {
            metrics.iter_mut().filter(|_| !point).for_each(|m| m.g_db = None);
        };
        strength(&mut metrics);
        match rendered(scene, &reception) {
            Ok(response) => {
                let warnings = response.warnings.clone();
                let mut response_metrics = response::response_metrics(&reception, &response, &scene.bands);
                strength(&mut response_metrics);
                let snr_db = scene.output.signal_to_noise_db.unwrap_or(f64::INFINITY);
                let speech_db = source.and_then(|s| spl_at_1m_db(s, &scene.air));
                let speech_db = speech_db.and_then(|at_1m| octave_levels_db(&reception, &scene.bands, &at_1m));
                let speech_transmission_index = speech_transmission_index(&response, snr_db, speech_db);
                let response = Some(response);
                (Pair { reception, response, metrics, response_metrics, speech_transmission_index }, warnings)
            }
            Err(warning) => {
                let response_metrics = Vec::new();
                let pair =
                    Pair { reception, response: None, metrics, response_metrics, speech_transmission_index: None };
                (pair, vec![warning])
            }
        }
    };
    let (pairs, warnings): (Vec<Pair>, Vec<Vec<Warning>>) = receptions.into_par_iter().map(pair).unzip();
    let mut distinct: Vec<Warning> = Vec::new();
    for warning in warnings.into_iter().flatten() {
        if !distinct.contains(&warning) {
            distinct.push(warning);
        }
    }
    (pairs, distinct)
}

/// The impulse response of a reception, as its probe records it.
fn rendered(scene: &Scene, reception: &diffray::probe::Reception) -> std::result::Result<Response, Warning> {
    let probe = scene.probes.iter().find(|p| p.name == reception.probe);
    let options = RenderOptions {
        sample_rate_hz: scene.output.sample_rate_hz,
        length_s: scene.output.response_length_s,
        seed: scene.simulation.seed,
        format: probe.map_or(ProbeFormat::Omni, |p| p.format),
    };
    let mut response = response::render(reception, &scene.bands, &options)?;
    response.title = format!("{}: {}", scene.name, response.title);
    Ok(response)
}

/// Splits `--set` options into the one that gives the swept values, if any, and the others.
fn swept_setting(set: &[String]) -> Result<(Option<Sweep>, Vec<String>)> {
    let is_sweep = |text: &String| {
        let value = text.split_once('=').map_or("", |(_, value)| value.trim());
        !value.starts_with(['[', '{', '"', '\'']) && value.contains([':', ','])
    };
    let (swept, others): (Vec<String>, Vec<String>) = set.iter().cloned().partition(is_sweep);
    match &swept[..] {
        [] => Ok((None, others)),
        [one] => Ok((Some(Sweep::parse(one)?), others)),
        [first, second, ..] => Err(Error::input(
            format!("--set {first} and --set {second}: only one value can be swept"),
            "give the others a single value",
        )),
    }
}

fn sweep(args: &RunArgs, dry: Option<&Path>) -> Result<()> {
    let (swept, others) = swept_setting(&args.room.set)?;
    let overrides = overrides(&args.room, &others)?;
    let room = Room::read(&args.room.room)?;
    let loaded = room.load(&overrides)?;
    let Some(Sweep { parameter, values, .. }) = swept.or_else(|| loaded.scene.sweep.clone()) else {
        return Err(Error::input(
            format!("{}: there is no [sweep] in the file", args.room.room.display()),
            "add one, or give --set opening.door.open_m=0:1.2:0.02",
        ));
    };
    let out = args.out();
    report::check_writable(&out)?;
    use_threads(args.threads)?;
    let (references, left_out) = references(&loaded.scene, &parameter, &overrides);
    let mut warnings = loaded.warnings;
    warnings.extend(left_out);
    cli::warn(&warnings);
    let mut run = Run { warnings, ..Run::of(&loaded.scene, loaded.source, as_typed(&overrides)) };

    let bar = Bar::new(values.len(), &loaded.scene.simulation, args.quiet);
    bar.say(&format!("{} values of {parameter}", values.len()));
    let finished = AtomicUsize::new(0);
    let done = |count: usize| {
        finished.fetch_max(count, Ordering::Relaxed);
        bar.done(count - 1);
    };
    let traced = |progress| {
        let index = finished.load(Ordering::Relaxed);
        bar.traced(index, &format!("value {} of {}, ", index + 1, values.len()), &progress);
    };
    let start = Instant::now();
    let points = sweep::run(&room, &overrides, &parameter, &values, dry.is_some(), &done, &traced)?;
    run.times_s.push(("sweep".to_owned(), start.elapsed().as_secs_f64()));
    drop(bar);

    let mut found = warnings_of(&parameter, &points);
    cli::warn(&found);
    run.warnings.append(&mut found);
    run.rays = points.iter().map(|p| p.outcome.rays).sum();
    points.iter().for_each(|p| TableCost::add(&mut run.opening_tables, p.outcome.tables.clone()));
    run.stop = stops(&points);
    run.plan_text = plan_texts(&parameter, &points);
    run.plan = points
        .iter()
        .map(|p| Ok(serde_json::json!({ "value": p.value, "plan": as_json(&p.plan)? })))
        .collect::<Result<_>>()?;
    let at_each = points
        .iter()
        .map(|p| {
            let scene = room.scene_at(&overrides, &parameter, p.value)?;
            Ok(SweepValue {
                value: p.value,
                receptions: &p.outcome.receptions,
                spl_1m_db: report::spl_of_sources(&scene),
            })
        })
        .collect::<Result<Vec<_>>>()?;
    let heard = dry.map(|dry| listen::steps(&room, &overrides, &parameter, &points, dry)).transpose()?;
    let results = Swept { run, parameter, series: Series::collect(&at_each), references };
    publish(&out, args.quiet, |folder| {
        heard.iter().try_for_each(|heard| heard.write(folder, "listen/"))?;
        results.write(folder)
    })?;
    heard.iter().try_for_each(|heard| cli::print(&heard.text()))?;
    cli::print(&report::rises_table(&results))
}

/// The curves of the room file's reference table. It belongs to the room as the file has it: where an option changes
/// more than how the room is simulated it is left out, with a warning.
fn references(scene: &Scene, parameter: &str, overrides: &[Override]) -> (Vec<ReferenceCurve>, Option<Warning>) {
    const HARMLESS: [&str; 5] = ["simulation.", "output.", "sweep.", "bands.from_hz", "bands.to_hz"];
    let Some(sweep) = scene.sweep.as_ref().filter(|s| s.parameter == parameter) else { return (Vec::new(), None) };
    let Some(table) = &sweep.reference else { return (Vec::new(), None) };
    let changes = |o: &&Override| o.path() != parameter && !HARMLESS.iter().any(|path| o.path().starts_with(path));
    match overrides.iter().find(changes) {
        None => (ReferenceCurve::collect(table), None),
        Some(change) => {
            let warning = Warning {
                observation: format!("{} is not shown: {} changes the room", table.file.display(), change.label()),
                remedy: "the reference belongs to the room as the file describes it".to_owned(),
            };
            (Vec::new(), Some(warning))
        }
    }
}

/// The warnings of all values; those that differ only in their numbers are told once.
fn warnings_of(parameter: &str, points: &[SweepPoint]) -> Vec<Warning> {
    let shape = |w: &Warning| w.observation.replace(|c: char| c.is_ascii_digit() || "+-.".contains(c), "");
    let mut kinds: Vec<(String, f64, Warning, usize)> = Vec::new();
    for point in points {
        for warning in &point.outcome.warnings {
            let shape = shape(warning);
            match kinds.iter_mut().find(|(known, ..)| *known == shape) {
                Some((.., times)) => *times += 1,
                None => kinds.push((shape, point.value, warning.clone(), 1)),
            }
        }
    }
    kinds
        .into_iter()
        .map(|(_, value, warning, times)| {
            let also =
                if times > 1 { format!(", and {} like it", counted(times - 1, "warning")) } else { String::new() };
            Warning { observation: format!("{} (at {parameter} = {value}{also})", warning.observation), ..warning }
        })
        .collect()
}

/// Why the runs of a sweep ended: the reason they share, or how many there were of each.
fn stops(points: &[SweepPoint]) -> String {
    let mut reasons: Vec<(&Outcome, usize)> = Vec::new();
    for outcome in points.iter().map(|p| &p.outcome) {
        match reasons.iter_mut().find(|(known, _)| known.stop == outcome.stop) {
            Some((_, times)) => *times += 1,
            None => reasons.push((outcome, 1)),
        }
    }
    match &reasons[..] {
        [(only, _)] => only.stop.clone(),
        several => {
            several.iter().map(|(o, n)| format!("{}: {}", counted(*n, "value"), o.stop)).collect::<Vec<_>>().join("; ")
        }
    }
}

/// The plans of the smallest and the largest value in words.
fn plan_texts(parameter: &str, points: &[SweepPoint]) -> String {
    let by_value = |a: &&SweepPoint, b: &&SweepPoint| a.value.total_cmp(&b.value);
    let ends = [points.iter().min_by(by_value), points.iter().max_by(by_value)];
    let [Some(low), Some(high)] = ends else { return String::new() };
    let text = |p: &SweepPoint| format!("{parameter} = {}\n{}", p.value, p.plan.text());
    if low.value == high.value { text(low) } else { format!("{}\n{}", text(low), text(high)) }
}

fn as_json(plan: &Plan) -> Result<serde_json::Value> {
    serde_json::to_value(plan).map_err(|e| Error::Run(format!("the plan cannot be written as JSON: {e}")))
}

/// Writes all files of a run to `out`, or none.
fn publish(out: &Path, quiet: bool, write: impl FnOnce(&mut Folder) -> Result<()>) -> Result<()> {
    let mut folder = Folder::stage(out)?;
    write(&mut folder)?;
    let place = folder.publish()?;
    if !quiet {
        cli::tell_results(&place);
    }
    Ok(())
}
