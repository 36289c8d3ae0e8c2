//! Errors and times of many levels in a few numbers, and whether they are what they must be.

use super::measure::Method;
use super::{Reference, Trial, Verified};
use crate::scene::Transport;

/// Median, 90th percentile and largest of absolute errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// Number of levels.
    pub levels: usize,
    /// Half of the errors are at most this, in dB.
    pub median_db: f64,
    /// Nine tenths of them are at most this, in dB.
    pub p90_db: f64,
    /// All of them are at most this, in dB.
    pub max_db: f64,
}

impl Quantiles {
    /// Of these errors in dB; `None` without any.
    pub fn of(errors_db: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sizes: Vec<f64> = errors_db.map(f64::abs).collect();
        sizes.sort_by(f64::total_cmp);
        let max_db = *sizes.last()?;
        let at = |share: f64| sizes[((share * sizes.len() as f64) as usize).min(sizes.len() - 1)];
        Some(Self { levels: sizes.len(), median_db: at(0.5), p90_db: at(0.9), max_db })
    }
}

/// One computed level beside its exact one.
#[derive(Clone, Copy)]
pub(super) struct Entry<'a> {
    pub(super) trial: &'a Trial,
    pub(super) level: &'a Reference,
    pub(super) error_db: f64,
}

impl Entry<'_> {
    fn name(&self) -> &str {
        &self.trial.case.name
    }

    /// Half-planes and wedges.
    fn of_an_edge(&self) -> bool {
        self.name().ends_with("half-plane") || self.name().starts_with("wedge")
    }

    /// Whether it is an octave band.
    pub(super) fn octave(&self) -> bool {
        self.trial.case.mean == "octave"
    }
}

/// A bound on errors, and what was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// Which levels.
    pub what: &'static str,
    /// Bound of the 90th percentile in dB.
    pub p90_db: f64,
    /// Bound of the largest error in dB.
    pub max_db: f64,
    /// What signed rays reach; `None`: there were no such levels.
    pub reached: Option<Quantiles>,
}

impl Bar {
    /// Whether both bounds are kept; levels that were not run keep them.
    pub fn met(&self) -> bool {
        self.reached.is_none_or(|q| q.p90_db <= self.p90_db && q.max_db <= self.max_db)
    }
}

/// Time in which the tables of a scene's openings are made, which all its sources and probes share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetUp {
    /// Bound of `longest_s` from above.
    pub most_wanted_s: f64,
    /// Median of the cases in s.
    pub median_s: f64,
    /// Longest of a case in s.
    pub longest_s: f64,
    /// Number of cases.
    pub cases: usize,
}

impl SetUp {
    /// Whether the bound is kept.
    pub fn met(&self) -> bool {
        self.longest_s <= self.most_wanted_s
    }
}

/// How many times longer another transport takes for a level, octave bands of the cases that both ran; of the exact transport
/// those with an integral equation: openings.
#[derive(Debug, Clone, PartialEq)]
pub struct Ratio {
    /// The other transport.
    pub other: &'static str,
    /// Bound of `median` from below.
    pub least_wanted: f64,
    /// Median of the ratios of the cases.
    pub median: f64,
    /// Smallest ratio of a case.
    pub least: f64,
    /// Ratio of the times of all levels together: the slowest cases decide it.
    pub overall: f64,
    /// Number of cases in common.
    pub cases: usize,
}

impl Ratio {
    /// How many cases, and of which kind.
    pub(super) fn which(&self) -> String {
        format!("{} cases{}", self.cases, if self.other == "exact" { " with openings" } else { "" })
    }

    /// Whether the bound is kept.
    pub fn met(&self) -> bool {
        self.median >= self.least_wanted
    }
}

impl Verified {
    /// The signed rays as rooms get them.
    pub fn standard(&self) -> Option<&Method> {
        self.methods.iter().rfind(|m| m.transport == Transport::Wbsdf)
    }

    pub(super) fn trials_of<'a>(&'a self, method: &'a Method) -> impl Iterator<Item = &'a Trial> + Clone {
        self.trials.iter().filter(move |t| t.method == *method)
    }

    /// All levels that a transport computed.
    pub(super) fn entries<'a>(&'a self, method: &'a Method) -> impl Iterator<Item = Entry<'a>> + Clone {
        self.trials_of(method).flat_map(|trial| {
            let pairs = trial.case.levels.iter().zip(&trial.measured.errors_db);
            pairs.map(move |(level, error_db)| Entry { trial, level, error_db: *error_db })
        })
    }

    /// Errors of a transport over the chosen levels.
    pub(super) fn errors(&self, method: &Method, chosen: impl Fn(&Entry<'_>) -> bool) -> Option<Quantiles> {
        Quantiles::of(self.entries(method).filter(chosen).map(|e| e.error_db))
    }

    /// The bounds on the errors of signed rays.
    pub fn bars(&self) -> Vec<Bar> {
        type Chosen = fn(&Entry<'_>) -> bool;
        const BARS: [(&str, Chosen, f64, f64); 8] = [
            (
                "slits and door up to 75° off the normal",
                |e| e.octave() && matches!(e.name(), "slit" | "sliding door") && e.level.region != "oblique",
                0.1,
                0.5,
            ),
            ("half-plane and wedges, shadow", |e| e.of_an_edge() && e.level.region == "shadow", 0.15, 0.6),
            ("half-plane and wedges, transition", |e| e.of_an_edge() && e.level.region == "transition", 0.3, 1.2),
            ("half-plane and wedges, lit", |e| e.of_an_edge() && e.level.region == "lit", 0.5, 2.0),
            ("two slits", |e| e.octave() && e.name() == "two slits", 0.2, 1.0),
            ("slits through thick walls", |e| e.octave() && e.name() == "thick slit", 0.3, 1.5),
            ("rectangles", |e| e.octave() && e.name() == "rectangle", 0.5, 1.5),
            ("sliding door, tones", |e| !e.octave() && e.name() == "sliding door", 0.5, 2.0),
        ];
        let reached = |chosen: Chosen| self.errors(self.standard()?, chosen);
        BARS.iter()
            .map(|&(what, chosen, p90_db, max_db)| Bar { what, p90_db, max_db, reached: reached(chosen) })
            .collect()
    }

    /// Mean time of a level in s over these trials; `None` without any.
    pub(super) fn time_per_level_s<'a>(trials: impl Iterator<Item = &'a Trial>) -> Option<f64> {
        let (time_s, levels) =
            trials.fold((0.0, 0), |(t, n), trial| (t + trial.measured.time_s, n + trial.measured.computed));
        (levels > 0).then(|| time_s / levels as f64)
    }

    /// Longest time in s in which the tables of a scene's openings are made, over these trials; `None` without any.
    pub(super) fn set_up_s<'a>(trials: impl Iterator<Item = &'a Trial>) -> Option<f64> {
        trials.map(|trial| trial.measured.set_up_s).reduce(f64::max)
    }

    /// What the tables of signed rays may cost, octave bands: `None` without such cases.
    pub fn set_up(&self) -> Option<SetUp> {
        let octaves = self.trials_of(self.standard()?).filter(|t| t.case.mean == "octave");
        let mut times_s: Vec<f64> = octaves.map(|t| t.measured.set_up_s).collect();
        times_s.sort_by(f64::total_cmp);
        Some(SetUp {
            most_wanted_s: 0.2,
            median_s: *times_s.get(times_s.len() / 2)?,
            longest_s: *times_s.last()?,
            cases: times_s.len(),
        })
    }

    /// How much faster signed rays are.
    pub fn ratios(&self) -> Vec<Ratio> {
        let Some(standard) = self.standard() else { return Vec::new() };
        let per_level = |t: &Trial| t.measured.time_s / t.measured.computed as f64;
        let wanted = [(Transport::Utd, 10.0), (Transport::Exact, 10_000.0)];
        let ratio = |(transport, least_wanted): (Transport, f64)| {
            let other = self.methods.iter().find(|m| m.transport == transport)?;
            let common: Vec<(f64, f64, f64)> = self
                .trials_of(other)
                .filter(|t| t.case.mean == "octave")
                // At a single edge the exact transport is the same closed form.
                .filter(|t| transport != Transport::Exact || !t.case.about_edge())
                .filter_map(|t| {
                    let own = self.trials_of(standard).find(|own| own.index == t.index)?;
                    Some((per_level(own), per_level(t), t.measured.computed as f64))
                })
                .collect();
            let mut ratios: Vec<f64> = common.iter().map(|(own, other, _)| other / own).collect();
            ratios.sort_by(f64::total_cmp);
            let sum = |pick: fn(&(f64, f64, f64)) -> f64| common.iter().map(|c| pick(c) * c.2).sum::<f64>();
            Some(Ratio {
                other: other.name,
                least_wanted,
                median: *ratios.get(ratios.len() / 2)?,
                least: *ratios.first()?,
                overall: sum(|c| c.1) / sum(|c| c.0),
                cases: ratios.len(),
            })
        };
        wanted.into_iter().filter_map(ratio).collect()
    }

    /// Regions in which there are octave bands, in the order of light to dark.
    pub(super) fn regions(&self) -> Vec<&'static str> {
        let all = || self.trials.iter().flat_map(|t| &t.case.levels);
        let known = ["lit", "transition", "shadow", "oblique", "all"];
        known.into_iter().filter(|region| all().any(|l| l.region == *region)).collect()
    }

    /// The octave bands in Hz, ascending.
    pub(super) fn octaves_hz(&self) -> Vec<f64> {
        let octaves = self.trials.iter().filter(|t| t.case.mean == "octave");
        let mut bands: Vec<f64> = octaves.flat_map(|t| t.case.levels.iter().map(|l| l.band_hz)).collect();
        bands.sort_by(f64::total_cmp);
        bands.dedup();
        bands
    }

    /// Kinds of cases in order of appearance: name, source and mean.
    pub(super) fn kinds(&self) -> Vec<(&str, &'static str, &'static str)> {
        let mut kinds = Vec::new();
        for case in self.trials.iter().map(|t| &t.case) {
            let kind = (case.name.as_str(), case.source, case.mean);
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        kinds
    }
}

impl Trial {
    /// Name, source and mean of the case.
    pub(super) fn kind(&self) -> (&str, &'static str, &'static str) {
        (&self.case.name, self.case.source, self.case.mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_absolute_errors_and_silence_is_infinitely_wrong() {
        let q = Quantiles::of([0.1, -0.3, 0.2, f64::NEG_INFINITY, 0.0].into_iter()).unwrap();
        assert_eq!((q.levels, q.median_db, q.p90_db, q.max_db), (5, 0.2, f64::INFINITY, f64::INFINITY));
        assert_eq!(Quantiles::of(std::iter::empty()), None);
    }
}
