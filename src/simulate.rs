//! One scene from plan to receptions: deterministic paths, then traced rays, then levels with their errors.

use std::time::Instant;

use crate::error::{Result, Warning};
use crate::geometry::Geometry;
use crate::paths::{Early, Prepared, add_courses};
use crate::plan::Plan;
use crate::probe::{BandLevel, Echogram, Reception, TableCost};
use crate::scene::Scene;
use crate::trace::{self, Ended, Ledger, TraceOutcome, TracePlan};
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::scatter::PortalScatter;

/// What a run gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// One reception a source and probe, sources slowest.
    pub receptions: Vec<Reception>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// Rays traced, all sources.
    pub rays: u64,
    /// Hits of traced rays.
    pub hits: u64,
    /// Why the tracing ended, in words.
    pub stop: String,
    /// Energy ledger, one a source; empty where nothing was traced.
    pub ledger: Vec<Ledger>,
    /// Seconds spent by phase, in order.
    pub times_s: Vec<(String, f64)>,
    /// What the openings on deterministic paths cost.
    pub tables: Vec<TableCost>,
}

/// Runs the plan. `progress` is called now and then while rays are traced.
///
/// # Errors
/// [`crate::error::Error::Run`] if the plan does not fit the scene.
pub fn run(
    scene: &Scene,
    geometry: &Geometry,
    plan: &Plan,
    progress: &(dyn Fn(trace::Progress) + Sync),
) -> Result<Outcome> {
    let start = Instant::now();
    let prepared = Prepared::new(scene, geometry, plan.reflection_order);
    let preparing_s = start.elapsed().as_secs_f64();
    let mut outcome = run_prepared(scene, geometry, plan, &prepared, progress)?;
    if plan.responses {
        let courses = Instant::now();
        let costs = add_courses(scene, geometry, plan.reflection_order, &mut outcome.receptions);
        TableCost::add(&mut outcome.tables, costs);
        outcome.times_s.push(("courses".to_owned(), courses.elapsed().as_secs_f64()));
    }
    if let Some((_, paths_s)) = outcome.times_s.first_mut() {
        *paths_s += preparing_s;
    }
    Ok(outcome)
}

/// The same with `prepared` from this scene and plan: a second run finds the tables of its openings filled.
///
/// # Errors
/// As [`run`].
pub fn run_prepared(
    scene: &Scene,
    geometry: &Geometry,
    plan: &Plan,
    prepared: &Prepared<'_>,
    progress: &(dyn Fn(trace::Progress) + Sync),
) -> Result<Outcome> {
    let start = Instant::now();
    let early = prepared.find();
    let mut times_s = vec![("paths".to_owned(), start.elapsed().as_secs_f64())];
    let mut warnings = plan.warnings.clone();
    let traced = match &plan.traced {
        Some(part) => {
            let tables = Instant::now();
            let spectra: Vec<Spectrum> =
                scene.bands.iter().map(|b| Spectrum::new(b, scene.air.speed_of_sound_m_s)).collect();
            let scatter: Vec<PortalScatter> = geometry
                .portals
                .iter()
                .map(|p| {
                    let depth_m = scene.gap_depth_m(&scene.openings[p.opening]);
                    PortalScatter::new(p.x_m, p.y_m, depth_m, &spectra, scene.simulation.transport)
                })
                .collect();
            times_s.push(("opening tables".to_owned(), tables.elapsed().as_secs_f64()));
            let tracing = Instant::now();
            let trace_plan = TracePlan {
                reflection_order: plan.reflection_order,
                portal_order: usize::from(scene.simulation.diffraction_order > 0),
                bin_s: part.bin_s,
                decays: plan.responses,
                early: early_sums(scene, &early),
                ..TracePlan::new(scene, part.length_s)
            };
            let outcome = trace::trace(scene, geometry, &scatter, &trace_plan, progress)?;
            times_s.push(("tracing".to_owned(), tracing.elapsed().as_secs_f64()));
            warnings.extend(limit_warning(scene, &outcome));
            Some(outcome)
        }
        None => None,
    };
    let volume_m3 = plan.traced.as_ref().and_then(|part| part.volume_m3);
    let growth_per_s3 = volume_m3.map(|v| 4.0 * std::f64::consts::PI * scene.air.speed_of_sound_m_s.powi(3) / v);
    let receptions = receptions(scene, early, traced.as_ref(), growth_per_s3);
    let closed = scene.openings.iter().any(|o| o.is_closed());
    warnings.extend(silent_warnings(&receptions, closed));
    let stop = match &traced {
        None => plan.untraced_why.clone().unwrap_or_default(),
        Some(outcome) => match outcome.ended {
            Ended::Target => format!("every level is within {} dB", scene.simulation.target_db),
            Ended::MaxRays => format!("max_rays = {} reached", scene.simulation.max_rays),
            Ended::MaxTime => format!("max_time_s = {} reached", scene.simulation.max_time_s),
            Ended::NothingToTrace => "nothing to trace".to_owned(),
        },
    };
    let (rays, hits, ledger) = traced.map_or((0, 0, Vec::new()), |t| (t.rays.iter().sum(), t.hits, t.ledger));
    Ok(Outcome { receptions, warnings, rays, hits, stop, ledger, times_s, tables: prepared.costs() })
}

/// Intensity of the deterministic paths, `[source][probe][band]`.
fn early_sums(scene: &Scene, early: &[Early]) -> Vec<Vec<Vec<f64>>> {
    let of_source = |probes: &[Early]| probes.iter().map(|e| e.intensity.clone()).collect();
    early.chunks(scene.probes.len().max(1)).map(of_source).collect()
}

/// `growth_per_s3`: of the reflections a second, see [`Echogram::reflections_per_s3`].
fn receptions(
    scene: &Scene,
    early: Vec<Early>,
    traced: Option<&TraceOutcome>,
    growth_per_s3: Option<f64>,
) -> Vec<Reception> {
    let pairs = (0..scene.sources.len()).flat_map(|s| (0..scene.probes.len()).map(move |p| (s, p)));
    pairs
        .zip(early)
        .map(|((s, p), early)| {
            let echogram = traced
                .and_then(|t| t.traced.iter().find(|t| t.source == s && t.probe == p))
                .map(|t| Echogram { reflections_per_s3: growth_per_s3, ..t.echogram.clone() });
            let levels = levels(scene, &early, echogram.as_ref());
            Reception {
                source: scene.sources[s].name.clone(),
                probe: scene.probes[p].name.clone(),
                paths: early.paths,
                echogram,
                levels,
            }
        })
        .collect()
}

fn levels(scene: &Scene, early: &Early, echogram: Option<&Echogram>) -> Vec<BandLevel> {
    scene
        .bands
        .iter()
        .enumerate()
        .map(|(b, band)| {
            let quadrature: f64 = early.paths.iter().map(|p| p.error[b]).sum();
            let early = early.intensity[b];
            let (late, statistics) = echogram.map_or((0.0, 0.0), |e| (e.energy[b].iter().sum::<f64>(), e.std_error[b]));
            let intensity = (early + late).max(0.0);
            BandLevel {
                band_hz: band.nominal_hz,
                intensity,
                intensity_error: quadrature.hypot(statistics),
                early_share: if intensity > 0.0 { (early / intensity).clamp(0.0, 1.0) } else { 0.0 },
            }
        })
        .collect()
}

/// If the budget ended before the target was met: which level is worst, and what it would take.
fn limit_warning(scene: &Scene, outcome: &TraceOutcome) -> Option<Warning> {
    let worst = outcome.worst?;
    if !matches!(outcome.ended, Ended::MaxRays | Ended::MaxTime) || worst.std_error_db <= scene.simulation.target_db {
        return None;
    }
    let rays = outcome.rays.get(worst.source).copied().unwrap_or(0) as f64;
    let needed = rays * (worst.std_error_db / scene.simulation.target_db).powi(2);
    Some(Warning {
        observation: format!(
            "the standard error of {} -> {} at {} Hz is {:.2} dB, not yet {} dB",
            scene.sources[worst.source].name,
            scene.probes[worst.probe].name,
            scene.bands[worst.band].nominal_hz,
            worst.std_error_db,
            scene.simulation.target_db
        ),
        remedy: if needed.is_finite() {
            format!("about {needed:.1e} rays from this source would do: raise max_rays or max_time_s, or target_db")
        } else {
            "no ray has arrived there: is the probe in a closed room of its own?".to_owned()
        },
    })
}

/// Levels that nothing reached (silence behind a closed door is none), and sums over signed rays that came out negative.
fn silent_warnings(receptions: &[Reception], closed: bool) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for reception in receptions {
        let name = format!("{} -> {}", reception.source, reception.probe);
        if reception.levels.iter().all(|l| l.intensity == 0.0 && l.intensity_error == 0.0) {
            if closed {
                continue;
            }
            warnings.push(Warning {
                observation: format!("nothing of {name} arrives"),
                remedy: "its levels are -inf; is there a way for the sound? Through two openings in a row only traced rays of \
                         point sources find one"
                    .to_owned(),
            });
            continue;
        }
        let negative: Vec<String> = reception
            .levels
            .iter()
            .filter(|l| l.intensity == 0.0 && l.intensity_error > 0.0)
            .map(|l| format!("{} Hz", l.band_hz))
            .collect();
        if !negative.is_empty() {
            warnings.push(Warning {
                observation: format!("the sum over signed rays of {name} is not positive at {}", negative.join(", ")),
                remedy: "its level is -inf and its error the size of the sum: trace more rays (max_rays, target_db)"
                    .to_owned(),
            });
        }
    }
    warnings
}
