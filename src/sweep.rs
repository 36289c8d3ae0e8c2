//! The same scene for many values of one parameter.

use rayon::prelude::*;

use crate::error::Result;
use crate::geometry::Geometry;
use crate::plan::Plan;
use crate::scene::{Override, Room};
use crate::simulate::{self, Outcome};
use crate::trace;

/// One value of the parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPoint {
    /// The value in its own unit.
    pub value: f64,
    /// What was planned.
    pub plan: Plan,
    /// What the run gave.
    pub outcome: Outcome,
}

/// Runs `room` for every value of `parameter` (path of a number in the room file, as `opening.door.open_m`), on top of
/// `overrides`; for levels, and with `responses` also for impulse responses. Scenes without traced rays run side by side, others one after the other on all threads: the results do not
/// depend on it. `done` is called after each value with the number of values finished, `progress` while rays are traced.
///
/// # Errors
/// The first value (in order) that makes a bad room, or whose run fails.
pub fn run(
    room: &Room,
    overrides: &[Override],
    parameter: &str,
    values: &[f64],
    responses: bool,
    done: &(dyn Fn(usize) + Sync),
    progress: &(dyn Fn(trace::Progress) + Sync),
) -> Result<Vec<SweepPoint>> {
    let finished = std::sync::atomic::AtomicUsize::new(0);
    let prepare = |value: f64| {
        let scene = room.scene_at(overrides, parameter, value)?;
        let geometry = Geometry::new(&scene)?;
        let mut plan = Plan::new(&scene, &geometry);
        plan.responses = responses;
        Ok((value, scene, geometry, plan))
    };
    let point = |(value, scene, geometry, plan): (f64, _, _, Plan)| {
        let outcome = simulate::run(&scene, &geometry, &plan, progress)?;
        done(finished.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1);
        Ok(SweepPoint { value, plan, outcome })
    };
    let prepared: Vec<_> = values.par_iter().map(|v| prepare(*v)).collect::<Result<_>>()?;
    if prepared.iter().any(|(.., plan)| plan.traced.is_some()) {
        prepared.into_iter().map(point).collect()
    } else {
        prepared.into_par_iter().map(point).collect()
    }
}
