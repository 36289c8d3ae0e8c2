//! Rounds of rays and the rule that ends them.

use std::time::Instant;

use rayon::prelude::*;

use super::random::Stream;
use super::ray::Ray;
use super::stage::Stage;
use super::tally::Tally;
use super::walk::trace_ray;
use super::{CHUNK_RAYS, Ended, Ledger, Progress, Scattering, TraceOutcome, TracePlan, Traced, Worst};
use crate::geometry::Geometry;
use crate::scene::{Scene, SourceKind};

/// Chunks a source in the first round: 8192 rays, so that decay times are known to about 1 % even where the levels are
/// known sooner.
const FIRST_CHUNKS: u64 = 32;

/// Populations of rays (see [`trace_ray`]) in the first round, in later ones, and where no decay times are asked for. Measured in two
/// rooms with a doorway, 8192 rays, and a shoebox, 65,536: decay times spread by 2 to 4 % and 0.8 % at 3; 2 to 14 % and 1 % at 1.5; 5 to 15 % and 1.7 %
/// at 0.75; the time to a given error of the level at 8 kHz is as 1 to 0.6 to 0.36.
const FOR_DECAYS: f32 = 3.0;
/// See [`FOR_DECAYS`].
const FOR_LEVELS_TOO: f32 = 1.5;
/// See [`FOR_DECAYS`].
const FOR_LEVELS: f32 = 0.75;

/// A standard error counts as known only once this many rays have reached the probe ...
const ARRIVALS_FOR_AN_ERROR: u64 = 64;

/// ... or this many rays were traced: then what has not arrived is taken for absent.
const RAYS_FOR_SILENCE: u64 = 65_536;

/// Memory in bytes for the tallies of chunks under way.
const CHUNK_MEMORY: usize = 512 << 20;

/// One chunk of work and its result, reused from batch to batch.
struct Slot<const N: usize> {
    source: usize,
    chunk: u64,
    tally: Tally<N>,
    pending: Vec<Ray<N>>,
}

/// One point source.
struct Part<const N: usize> {
    source: usize,
    chunks: u64,
    tally: Tally<N>,
}

/// Traces all point sources with N lanes a ray.
pub(super) fn run<S: Scattering, const N: usize>(
    scene: &Scene,
    geometry: &Geometry,
    scatter: &[S],
    plan: &TracePlan,
    progress: &(dyn Fn(Progress) + Sync),
) -> TraceOutcome {
    let start = Instant::now();
    let stage = Stage::<S, N>::new(scene, geometry, scatter, plan);
    let probes = scene.probes.len();
    let bins = ((plan.length_s / plan.bin_s).ceil() as usize).max(1);
    let new_tally = || Tally::<N>::new(probes, bins, plan.bin_s);
    let mut parts: Vec<Part<N>> = (0..scene.sources.len())
        .filter(|&i| scene.sources[i].kind == SourceKind::Point)
        .map(|source| Part { source, chunks: 0, tally: Tally::of_batches(probes, bins, plan.bin_s) })
        .collect();
    let in_memory = CHUNK_MEMORY / Tally::<N>::bytes(probes, bins).max(1);
    let slots = (4 * rayon::current_num_threads()).min(in_memory).max(1);
    let mut slots: Vec<Slot<N>> =
        (0..slots).map(|_| Slot { source: 0, chunk: 0, tally: new_tally(), pending: Vec::new() }).collect();

    let max_chunks = (plan.max_rays / CHUNK_RAYS).max(parts.len() as u64);
    let mut worst_db = f64::INFINITY;
    let mut wanted: Vec<u64> = vec![FIRST_CHUNKS.min(max_chunks / parts.len() as u64); parts.len()];
    let mut population = if plan.decays { FOR_DECAYS } else { FOR_LEVELS };
    let ended = 'rounds: loop {
        // (part, chunk) in the order of merging.
        let work: Vec<(usize, u64)> = (0..parts.len())
            .flat_map(|p| (parts[p].chunks..parts[p].chunks + wanted[p]).map(move |chunk| (p, chunk)))
            .collect();
        for batch in work.chunks(slots.len()) {
            for (slot, &(part, chunk)) in slots.iter_mut().zip(batch) {
                (slot.source, slot.chunk) = (parts[part].source, chunk);
            }
            slots[..batch.len()]
                .par_iter_mut()
                .for_each(|slot| trace_chunk(&stage, scene, plan.seed, population, slot));
            for (slot, &(part, _)) in slots.iter().zip(batch) {
                parts[part].tally.merge(&slot.tally);
                parts[part].chunks += 1;
            }
            let rays = parts.iter().map(|p| p.tally.rays).sum();
            let seconds = start.elapsed().as_secs_f64();
            progress(Progress { rays, seconds, worst_db, target_db: plan.target_db });
            if seconds >= plan.max_time_s {
                break 'rounds Ended::MaxTime;
            }
        }
        worst_db = worst(&parts, plan, stage.bands).map_or(f64::INFINITY, |w| w.std_error_db);
        let used: u64 = parts.iter().map(|p| p.chunks).sum();
        let needs: Vec<f64> = parts.iter().map(|p| growth(p, plan, stage.bands)).collect();
        if needs.iter().all(|&g| g <= 1.0) {
            break Ended::Target;
        }
        if used >= max_chunks {
            break Ended::MaxRays;
        }
        wanted = next_round(&parts, &needs, max_chunks - used);
        population = population.min(FOR_LEVELS_TOO);
    };

    TraceOutcome {
        traced: parts
            .iter()
            .flat_map(|part| {
                (0..probes).map(|probe| Traced {
                    source: part.source,
                    probe,
                    echogram: part.tally.echogram(probe, stage.bands),
                    arrivals: part.tally.arrivals[probe],
                })
            })
            .collect(),
        rays: per_source(scene, &parts, |part| part.tally.rays),
        ledger: per_source(scene, &parts, |part| -> Ledger {
            part.tally.accounts.ledger(stage.bands, part.tally.rays)
        }),
        ended,
        worst: worst(&parts, plan, stage.bands),
        hits: parts.iter().map(|p| p.tally.hits).sum(),
        seconds: start.elapsed().as_secs_f64(),
    }
}

/// Traces one chunk of rays into its slot.
fn trace_chunk<S: Scattering, const N: usize>(
    stage: &Stage<'_, S, N>,
    scene: &Scene,
    seed: u64,
    population: f32,
    slot: &mut Slot<N>,
) {
    slot.tally.clear();
    let source = &scene.sources[slot.source];
    for ray in slot.chunk * CHUNK_RAYS..(slot.chunk + 1) * CHUNK_RAYS {
        let mut stream = Stream::new(seed, slot.source, ray);
        trace_ray(stage, source, population, &mut stream, &mut slot.pending, &mut slot.tally);
    }
}

/// A value for each source of the scene; the default for those that are not traced.
fn per_source<T: Default + Clone, const N: usize>(
    scene: &Scene,
    parts: &[Part<N>],
    value: impl Fn(&Part<N>) -> T,
) -> Vec<T> {
    let mut out = vec![T::default(); scene.sources.len()];
    for part in parts {
        out[part.source] = value(part);
    }
    out
}

/// Standard error in dB of a total level whose traced part has the given mean and standard error; `None` while too few rays have
/// arrived to know it.
fn error_db<const N: usize>(part: &Part<N>, plan: &TracePlan, probe: usize, band: usize) -> Option<f64> {
    let tally = &part.tally;
    if tally.arrivals[probe] < ARRIVALS_FOR_AN_ERROR && tally.rays < RAYS_FOR_SILENCE {
        return None;
    }
    let (mean, error) = tally.mean_and_error(probe, band);
    let total = mean + plan.early(part.source, probe, band);
    Some(if error == 0.0 {
        0.0
    } else if total > 0.0 {
        10.0 / std::f64::consts::LN_10 * error / total
    } else {
        f64::INFINITY
    })
}

/// The level with the largest error.
fn worst<const N: usize>(parts: &[Part<N>], plan: &TracePlan, bands: usize) -> Option<Worst> {
    let mut worst: Option<Worst> = None;
    for part in parts {
        for probe in 0..part.tally.sum.len() {
            for band in 0..bands {
                let std_error_db = error_db(part, plan, probe, band).unwrap_or(f64::INFINITY);
                if worst.is_none_or(|w| std_error_db > w.std_error_db) {
                    worst = Some(Worst { source: part.source, probe, band, std_error_db });
                }
            }
        }
    }
    worst
}

/// By which factor the rays of a source must grow; 1 or less: it has reached the target.
fn growth<const N: usize>(part: &Part<N>, plan: &TracePlan, bands: usize) -> f64 {
    let mut factor = 0.0f64;
    for probe in 0..part.tally.sum.len() {
        for band in 0..bands {
            let error = error_db(part, plan, probe, band).unwrap_or(f64::INFINITY);
            factor = factor.max((error / plan.target_db).powi(2));
        }
    }
    // A target of zero with nothing uncertain.
    if factor.is_nan() { 0.0 } else { factor }
}

/// Chunks of the next round: what each source seems to need and a little more, at least a quarter and at most three times of what it has,
/// scaled down to the rays that are left.
fn next_round<const N: usize>(parts: &[Part<N>], needs: &[f64], left: u64) -> Vec<u64> {
    let mut wanted: Vec<u64> = parts
        .iter()
        .zip(needs)
        .map(|(part, &factor)| {
            if factor <= 1.0 {
                return 0;
            }
            let more = (1.2 * factor - 1.0).clamp(0.25, 3.0);
            ((part.chunks as f64 * more).ceil() as u64).max(1)
        })
        .collect();
    let total: u64 = wanted.iter().sum();
    if total > left {
        for w in &mut wanted {
            *w = (u128::from(*w) * u128::from(left) / u128::from(total)) as u64;
        }
        if wanted.iter().all(|&w| w == 0)
            && let Some(first) = needs.iter().position(|&g| g > 1.0)
        {
            wanted[first] = left.min(1);
        }
    }
    wanted
}
