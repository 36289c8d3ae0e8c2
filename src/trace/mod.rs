//! The stochastic rays: everything deterministic paths leave out.
//!
//! # Normalisation
//! Intensities are relative to the source's free field at 1 m on its axis. Of N rays each carries 1/N of a power of 1 (times
//! the directivity's intensity in its direction), and a power of 1 spread over the sphere gives 1/r^2: hence the factor 4 pi
//! before power per steradian and square metre.
//!
//! # Estimators
//! * Diffuse rain: every hit of power P on a surface sends 4 P (1 - alpha) s cos(theta)/r^2 exp(-m r) to every probe in sight.
//! * Receiver spheres collect P 4 pi chord/V_visible after specular reflections, passages through walls and portals.
//! * Portal crossings send 4 pi P density/r^2 where the lobe is broader than the sphere.
//!
//! The last event before the probe decides which one counts, so they add up without overlap. Histories covered by
//! deterministic paths (all-specular, up to the plan's orders) are not recorded.
//!
//! # Error
//! One ray with everything split off from it is one independent sample. Sums and sums of squares over rays, one a probe and
//! band, give the standard error of the mean; positive and negative parts of signed rays are both in it.
//!
//! # Same bits
//! Random numbers depend on (seed, source, ray) alone; rays are traced in chunks of [`CHUNK_RAYS`] that are merged in order;
//! decisions fall between rounds only, from merged results. The number of threads changes nothing but the time (unless
//! the time limit ends the run).

mod lanes;
mod ledger;
mod portal;
mod random;
mod ray;
mod receiver;
mod rounds;
mod stage;
mod tally;
mod walk;

pub use ledger::Ledger;
pub use portal::Scattering;

use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::probe::Echogram;
use crate::scene::{Scene, SourceKind};

/// Rays a chunk: the unit of work and of merging.
pub const CHUNK_RAYS: u64 = 256;

/// Most bands a ray can carry.
pub const MAX_BANDS: usize = 1024;

/// What to trace and when to stop.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TracePlan {
    /// Specular reflections that deterministic paths cover.
    pub reflection_order: usize,
    /// Portals that deterministic paths cross, 0 or 1.
    pub portal_order: usize,
    /// Echogram bin width in s.
    pub bin_s: f64,
    /// Echogram length in s; later arrivals are ignored.
    pub length_s: f64,
    /// Radius of the receiver spheres in m; smaller near portals.
    pub receiver_radius_m: f64,
    /// Seed of every random number.
    pub seed: u64,
    /// Whether decay times are asked for: weak rays are then followed further, which levels alone do not need.
    pub decays: bool,
    /// Standard error in dB of every level (early + traced) at which the run stops.
    pub target_db: f64,
    /// Upper bound of rays, all sources together; at least one chunk a source is traced.
    pub max_rays: u64,
    /// Upper bound of tracing time in s.
    pub max_time_s: f64,
    /// Intensity of the deterministic paths, `early[source][probe][band]`; missing entries count as 0.
    pub early: Vec<Vec<Vec<f64>>>,
}

impl TracePlan {
    /// A plan with the scene's own options, 1 ms bins, nothing deterministic, and the given echogram length in s.
    pub fn new(scene: &Scene, length_s: f64) -> Self {
        Self {
            reflection_order: scene.simulation.reflection_order,
            portal_order: 0,
            bin_s: 1e-3,
            length_s,
            receiver_radius_m: 0.4,
            seed: scene.simulation.seed,
            decays: true,
            target_db: scene.simulation.target_db,
            max_rays: scene.simulation.max_rays,
            max_time_s: scene.simulation.max_time_s,
            early: Vec::new(),
        }
    }

    /// Intensity of the deterministic paths.
    fn early(&self, source: usize, probe: usize, band: usize) -> f64 {
        let entry = self.early.get(source).and_then(|s| s.get(probe)).and_then(|p| p.get(band));
        entry.copied().unwrap_or(0.0)
    }
}

/// How far a run has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Rays traced, all sources.
    pub rays: u64,
    /// Time since the start in s.
    pub seconds: f64,
    /// Largest standard error in dB after the last complete round; infinite before.
    pub worst_db: f64,
    /// The error to be reached in dB.
    pub target_db: f64,
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ended {
    /// Every level has reached the target.
    Target,
    /// The rays were used up.
    MaxRays,
    /// The time was used up.
    MaxTime,
    /// No point source or no probe.
    NothingToTrace,
}

/// The level with the largest standard error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Worst {
    /// Index of the source.
    pub source: usize,
    /// Index of the probe.
    pub probe: usize,
    /// Index of the band.
    pub band: usize,
    /// Its standard error in dB.
    pub std_error_db: f64,
}

/// What one source sent to one probe.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Traced {
    /// Index of the source.
    pub source: usize,
    /// Index of the probe.
    pub probe: usize,
    /// The echogram with its standard errors.
    pub echogram: Echogram,
    /// Rays that reached the probe.
    pub arrivals: u64,
}

/// The result of a run.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TraceOutcome {
    /// One a point source and probe: sources outside, probes inside.
    pub traced: Vec<Traced>,
    /// Rays traced, one a source of the scene; 0 for lines and plane waves.
    pub rays: Vec<u64>,
    /// Energy ledger, one a source of the scene; empty for lines and plane waves.
    pub ledger: Vec<Ledger>,
    /// Why the run ended.
    pub ended: Ended,
    /// The level that is known least; `None` where nothing was traced.
    pub worst: Option<Worst>,
    /// Hits on surfaces and portals, all rays.
    pub hits: u64,
    /// Tracing time in s.
    pub seconds: f64,
}

/// Traces the rays of all point sources to all probes of a scene, in rayon's current thread pool.
///
/// `scatter` holds one element a portal of `geometry`. `progress` is called between batches of chunks.
///
/// # Errors
/// More than [`MAX_BANDS`] bands, an echogram of no or unbounded length, or `scatter` that does not fit the portals.
pub fn trace<S: Scattering>(
    scene: &Scene,
    geometry: &Geometry,
    scatter: &[S],
    plan: &TracePlan,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<TraceOutcome> {
    if scatter.len() != geometry.portals.len() {
        return Err(Error::Run(format!(
            "tracing needs one scattering function a portal: {} for {} portals",
            scatter.len(),
            geometry.portals.len()
        )));
    }
    let bins = plan.length_s / plan.bin_s;
    if !(plan.bin_s > 0.0 && bins > 0.0 && bins <= 1e7) {
        return Err(Error::Run(format!(
            "an echogram of {} s in bins of {} s cannot be recorded: 1 to 10 000 000 bins are allowed",
            plan.length_s, plan.bin_s
        )));
    }
    let point_sources = scene.sources.iter().any(|s| s.kind == SourceKind::Point);
    let bands = scene.bands.len();
    if !point_sources || scene.probes.is_empty() || bands == 0 {
        return Ok(TraceOutcome {
            traced: Vec::new(),
            rays: vec![0; scene.sources.len()],
            ledger: vec![Ledger::default(); scene.sources.len()],
            ended: Ended::NothingToTrace,
            worst: None,
            hits: 0,
            seconds: 0.0,
        });
    }
    let run = match bands {
        1..=8 => rounds::run::<S, 8>,
        9..=16 => rounds::run::<S, 16>,
        17..=32 => rounds::run::<S, 32>,
        33..=64 => rounds::run::<S, 64>,
        65..=256 => rounds::run::<S, 256>,
        257..=MAX_BANDS => rounds::run::<S, MAX_BANDS>,
        _ => {
            return Err(Error::Run(format!("{bands} bands cannot be traced at once: at most {MAX_BANDS} are allowed")));
        }
    };
    Ok(run(scene, geometry, scatter, plan, progress))
}
