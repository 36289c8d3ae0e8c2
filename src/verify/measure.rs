//! Running a case with a transport: the errors of its levels and the time they take.

use std::time::{Duration, Instant};

use super::cases::Case;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::paths::Prepared;
use crate::plan::Plan;
use crate::scene::{RAY_TOLERANCE, Scene, Transport};
use crate::simulate;

/// A run is repeated for at least this long, and together with new tables for twice as long, so that the clock and the first
/// touch of memory do not count.
const LEAST: Duration = Duration::from_millis(4);

/// A transport with what it may spend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    /// Value of `simulation.transport`.
    pub transport: Transport,
    /// The same as text.
    pub name: &'static str,
    /// Relative accuracy of the sums over signed rays.
    pub tolerance: f64,
}

impl Method {
    /// With the accuracy that rooms get.
    pub const fn new(transport: Transport, name: &'static str) -> Self {
        Self { transport, name, tolerance: RAY_TOLERANCE }
    }

    /// Name and, for signed rays, tolerance.
    pub fn label(&self) -> String {
        if self.transport == Transport::Wbsdf {
            format!("{} {:.0e}", self.name, self.tolerance)
        } else {
            self.name.to_owned()
        }
    }
}

/// What one case gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Computed level minus exact level in dB, one a reference level of the case; -inf where nothing arrives.
    pub errors_db: Vec<f64>,
    /// Levels that a run computes: probes times bands.
    pub computed: usize,
    /// Time of one run in s with the tables of the openings in place, deterministic paths and levels only: the quickest of all
    /// repetitions.
    pub time_s: f64,
    /// By how much the first run takes longer in s, which makes these tables: the quickest of all repetitions.
    pub set_up_s: f64,
}

/// Runs the case; `None` if the transport refuses its room.
///
/// # Errors
/// What [`Scene::from_str`], [`Geometry::new`] and [`simulate::run`] say.
pub(super) fn measure(case: &Case, method: &Method) -> Result<Option<Measured>> {
    let loaded = match Scene::from_str(&case.room_text(method.name), "reference.toml", &[]) {
        Ok(loaded) => loaded,
        Err(Error::Input { .. }) if method.transport != Transport::Wbsdf => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut scene = loaded.scene;
    scene.simulation.ray_tolerance = method.tolerance;
    let geometry = Geometry::new(&scene)?;
    // Everything here is on deterministic paths; walls that end must not bring traced rays in.
    let plan = Plan { traced: None, ..Plan::new(&scene, &geometry) };
    let begin = Instant::now();
    let (mut first_s, mut time_s) = (f64::INFINITY, f64::INFINITY);
    let outcome = loop {
        let start = Instant::now();
        let prepared = Prepared::new(&scene, &geometry, plan.reflection_order);
        let outcome = simulate::run_prepared(&scene, &geometry, &plan, &prepared, &|_| {})?;
        first_s = first_s.min(start.elapsed().as_secs_f64());
        let repeated = Instant::now();
        loop {
            // What belongs to a source or a probe is found anew: only what the scene's openings share is set up.
            prepared.forget_points();
            let start = Instant::now();
            simulate::run_prepared(&scene, &geometry, &plan, &prepared, &|_| {})?;
            time_s = time_s.min(start.elapsed().as_secs_f64());
            if repeated.elapsed() >= LEAST {
                break;
            }
        }
        if begin.elapsed() >= 2 * LEAST {
            break outcome;
        }
    };
    let set_up_s = (first_s - time_s).max(0.0);
    let error_db = |exact: &super::cases::Reference| {
        let band = scene.bands.iter().position(|b| b.nominal_hz == exact.band_hz);
        let level = band.and_then(|band| outcome.receptions.get(exact.probe)?.levels.get(band));
        level.map(|level| level.level_db() - exact.level_db).ok_or_else(|| {
            Error::Run(format!("{}: no level at probe {} and {} Hz", case.name, exact.probe, exact.band_hz))
        })
    };
    let errors_db = case.levels.iter().map(error_db).collect::<Result<_>>()?;
    Ok(Some(Measured { errors_db, computed: scene.bands.len() * scene.probes.len(), time_s, set_up_s }))
}
