//! Values that are made when they are first needed and then serve all pairs, and how long that took.

use std::sync::OnceLock;
use std::time::Instant;

/// A value made once, by whichever thread needs it first.
pub struct Timed<T>(OnceLock<(T, f64)>);

impl<T> Default for Timed<T> {
    fn default() -> Self {
        Self(OnceLock::new())
    }
}

impl<T> Timed<T> {
    /// The value, by `make` if there is none yet.
    pub fn get_or_make(&self, make: impl FnOnce() -> T) -> &T {
        let timed = || {
            let start = Instant::now();
            let value = make();
            (value, start.elapsed().as_secs_f64())
        };
        &self.0.get_or_init(timed).0
    }

    /// The value if it has been made.
    pub fn get(&self) -> Option<&T> {
        self.0.get().map(|made| &made.0)
    }

    /// Seconds it took to make it; 0 if it has not been made.
    pub fn seconds(&self) -> f64 {
        self.0.get().map_or(0.0, |made| made.1)
    }
}

/// What it took to solve openings exactly.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Cost {
    /// Frequencies at which they were solved.
    pub frequencies: usize,
    /// Seconds of one thread.
    pub seconds: f64,
}

impl std::iter::Sum for Cost {
    fn sum<I: Iterator<Item = Self>>(costs: I) -> Self {
        costs.fold(Self::default(), |a, b| Self {
            frequencies: a.frequencies + b.frequencies,
            seconds: a.seconds + b.seconds,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_made_once_is_timed_once() {
        let timed = Timed::default();
        assert_eq!((timed.get(), timed.seconds()), (None, 0.0));
        let make = || {
            std::thread::sleep(std::time::Duration::from_millis(2));
            1
        };
        assert_eq!(timed.get_or_make(make), &1);
        let seconds = timed.seconds();
        assert!((0.002..1.0).contains(&seconds), "{seconds}");
        assert_eq!((timed.get_or_make(|| 2), timed.seconds()), (&1, seconds));
    }
}
