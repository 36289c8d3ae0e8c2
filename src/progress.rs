//! The progress bar on the standard error; nothing is drawn if that is no terminal.

use std::time::Duration;

use diffray::scene::Simulation;
use diffray::trace::Progress;
use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the bar for one simulation.
const STEPS: u64 = 1000;

/// Progress of one simulation, or of a sweep over several values.
pub(crate) struct Bar {
    bar: ProgressBar,
    limits: Simulation,
}

impl Bar {
    /// A bar for this many simulations within these limits; hidden if `quiet`.
    pub(crate) fn new(simulations: usize, limits: &Simulation, quiet: bool) -> Bar {
        let limits = limits.clone();
        if quiet {
            return Bar { bar: ProgressBar::hidden(), limits };
        }
        let bar = ProgressBar::new(simulations as u64 * STEPS);
        // A style is refused only if its template is malformed; then the default one does.
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {elapsed}  {wide_msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Bar { bar, limits }
    }

    /// Says what is being done, before rays are traced.
    pub(crate) fn say(&self, text: &str) {
        self.bar.set_message(text.to_owned());
    }

    /// Simulation number `index` (from 0) has come this far.
    pub(crate) fn traced(&self, index: usize, what: &str, progress: &Progress) {
        let share = share_done(progress, &self.limits);
        self.bar.set_position(index as u64 * STEPS + (share * STEPS as f64) as u64);
        let error = match progress.worst_db {
            db if db.is_finite() => format!("largest standard error {db:.2} dB, target {} dB", progress.target_db),
            _ => format!("target {} dB", progress.target_db),
        };
        self.bar.set_message(format!("{what}{} rays, {error}", progress.rays));
    }

    /// Simulation number `index` (from 0) is complete.
    pub(crate) fn done(&self, index: usize) {
        self.bar.set_position((index as u64 + 1) * STEPS);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Share of the work that is done, 0..=1: of the way to the target, if the error goes on falling with the square root of
/// the number of rays, or of the rays or the time allowed, whichever ends first.
fn share_done(progress: &Progress, limits: &Simulation) -> f64 {
    let of_target = (progress.target_db / progress.worst_db).powi(2);
    let of_rays = progress.rays as f64 / limits.max_rays as f64;
    let of_time = progress.seconds / limits.max_time_s;
    [of_target, of_rays, of_time].into_iter().filter(|share| share.is_finite()).fold(0.0, f64::max).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diffray::scene::{Edges, Transport};

    const LIMITS: Simulation = Simulation {
        seed: 1,
        target_db: 0.5,
        max_rays: 1_000_000,
        max_time_s: 100.0,
        reflection_order: 3,
        diffraction_order: 2,
        edges: Edges::Auto,
        transport: Transport::Wbsdf,
        interference: false,
    };

    fn share(rays: u64, seconds: f64, worst_db: f64) -> f64 {
        share_done(&Progress { rays, seconds, worst_db, target_db: 0.5 }, &LIMITS)
    }

    #[test]
    fn halving_the_error_is_a_quarter_of_the_way() {
        assert_eq!(share(0, 0.0, f64::INFINITY), 0.0);
        assert!((share(1, 1.0, 1.0) - 0.25).abs() < 1e-12);
        assert_eq!(share(1, 1.0, 0.4), 1.0);
    }

    #[test]
    fn the_limit_that_ends_first_counts() {
        assert_eq!(share(1, 70.0, 5.0), 0.7);
        assert_eq!(share(800_000, 70.0, 5.0), 0.8);
        assert_eq!(share(2, 1.0, f64::NAN), 0.01);
    }
}
