//! The progress bar on the standard error; nothing is drawn if that is no terminal.

use std::time::Duration;

use diffray::trace::Progress;
use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the bar for one simulation.
const STEPS: u64 = 1000;

/// Progress of one simulation, or of a sweep over several values.
pub(crate) struct Bar {
    bar: ProgressBar,
}

impl Bar {
    /// A bar for this many simulations; hidden if `quiet`.
    pub(crate) fn new(simulations: usize, quiet: bool) -> Bar {
        if quiet {
            return Bar { bar: ProgressBar::hidden() };
        }
        let bar = ProgressBar::new(simulations as u64 * STEPS);
        // A style is refused only if its template is malformed; then the default one does.
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {elapsed}  {wide_msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Bar { bar }
    }

    /// Says what is being done, before rays are traced.
    pub(crate) fn say(&self, text: &str) {
        self.bar.set_message(text.to_owned());
    }

    /// Simulation number `index` (from 0) has come this far.
    pub(crate) fn traced(&self, index: usize, what: &str, progress: &Progress) {
        let share = share_done(progress);
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

/// Share of the work that is done, 0..=1, if the error goes on falling with the square root of the number of rays.
fn share_done(progress: &Progress) -> f64 {
    let share = (progress.target_db / progress.worst_db).powi(2);
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_the_error_is_a_quarter_of_the_way() {
        let at = |worst_db| share_done(&Progress { rays: 1, seconds: 1.0, worst_db, target_db: 0.5 });
        assert_eq!(at(f64::INFINITY), 0.0);
        assert!((at(1.0) - 0.25).abs() < 1e-12);
        assert_eq!(at(0.4), 1.0);
        assert_eq!(at(f64::NAN), 0.0);
        assert_eq!(at(0.0), 0.0);
    }
}
