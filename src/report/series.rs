//! Level against a swept parameter, and the intervals in which it falls while the parameter grows.
//!
//! For a sliding door those are the intervals in which closing it makes the sound behind it louder.

use crate::probe::{BandLevel, Reception};

/// A level falls if it drops by more than this from one value to the next, in dB.
const STEP_THRESHOLD_DB: f64 = 1e-4;

/// One value of the parameter and the level there.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SeriesPoint {
    /// Value of the swept parameter in its own unit.
    pub value: f64,
    /// What arrived.
    pub level: BandLevel,
    /// Sound pressure level of the source's free field at 1 m in dB re 20 uPa, if the source has a power.
    pub spl_1m_db: Option<f64>,
}

/// The results at one value of the swept parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepValue<'a> {
    /// Value of the swept parameter in its own unit.
    pub value: f64,
    /// One entry a source and probe.
    pub receptions: &'a [Reception],
    /// Sound pressure level of each source's free field at 1 m in dB re 20 uPa, one a band; only sources with a power.
    pub spl_1m_db: Vec<(String, Vec<f64>)>,
}

/// The level of one source at one probe in one band, against the swept parameter.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Series {
    /// Name of the source.
    pub source: String,
    /// Name of the probe.
    pub probe: String,
    /// Nominal centre of the band in Hz.
    pub band_hz: f64,
    /// The points, ascending in the value.
    pub points: Vec<SeriesPoint>,
}

impl Series {
    /// Sorts the receptions of all values into one series a source, probe and band, in order of appearance.
    pub fn collect(values: &[SweepValue]) -> Vec<Series> {
        let mut all: Vec<Series> = Vec::new();
        for SweepValue { value, receptions, spl_1m_db } in values {
            for reception in *receptions {
                let spl = spl_1m_db.iter().find(|(name, _)| *name == reception.source).map(|(_, levels)| levels);
                for (band, &level) in reception.levels.iter().enumerate() {
                    let spl_1m_db = spl.and_then(|levels| levels.get(band).copied());
                    let point = SeriesPoint { value: *value, level, spl_1m_db };
                    let known = all.iter_mut().find(|s| {
                        s.band_hz == level.band_hz && s.source == reception.source && s.probe == reception.probe
                    });
                    match known {
                        Some(series) => series.points.push(point),
                        None => all.push(Series {
                            source: reception.source.clone(),
                            probe: reception.probe.clone(),
                            band_hz: level.band_hz,
                            points: vec![point],
                        }),
                    }
                }
            }
        }
        for series in &mut all {
            series.points.sort_by(|a, b| a.value.total_cmp(&b.value));
        }
        all
    }
}

/// An interval of the swept parameter in which the level falls while the value grows: going back from `value_high`
/// to `value_low` raises the level.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Rise {
    /// Lower end, where the level is higher.
    pub value_low: f64,
    /// Upper end, where the level is lower.
    pub value_high: f64,
    /// Level at the lower end in dB.
    pub level_low_db: f64,
    /// Level at the upper end in dB.
    pub level_high_db: f64,
    /// `level_low_db - level_high_db`, positive; infinite if nothing arrives at the upper end.
    pub rise_db: f64,
    /// Combined standard error of `rise_db` in dB.
    pub std_error_db: f64,
}

/// The maximal intervals in which the level falls while the value grows.
///
/// Where the levels are exact, an interval is a maximal run of steps that each fall by more than 1e-4 dB. Where
/// they carry a standard error, a fall counts from one extremum to the next, and an extremum counts only if the level
/// turns back by more than twice the combined standard error of the two points: noise alone makes no interval and
/// does not cut one in two.
pub fn rises(points: &[SeriesPoint]) -> Vec<Rise> {
    let exact = points.windows(2).all(|w| 2.0 * combined_error_db(&w[0], &w[1]) < STEP_THRESHOLD_DB);
    let spans = if exact { falling_runs(points) } else { falling_legs(points) };
    spans.into_iter().map(|(low, high)| rise(&points[low], &points[high])).collect()
}

fn rise(low: &SeriesPoint, high: &SeriesPoint) -> Rise {
    Rise {
        value_low: low.value,
        value_high: high.value,
        level_low_db: low.level.level_db(),
        level_high_db: high.level.level_db(),
        rise_db: fall_db(low, high),
        std_error_db: combined_error_db(low, high),
    }
}

/// Level at `from` minus level at `to`; 0 if nothing arrives at either.
fn fall_db(from: &SeriesPoint, to: &SeriesPoint) -> f64 {
    let fall = from.level.level_db() - to.level.level_db();
    if fall.is_nan() { 0.0 } else { fall }
}

/// Standard error of the difference of two levels; that of a point where nothing arrives is taken as 0.
fn combined_error_db(a: &SeriesPoint, b: &SeriesPoint) -> f64 {
    let error = |p: &SeriesPoint| Some(p.level.std_error_db()).filter(|e| e.is_finite()).unwrap_or(0.0);
    error(a).hypot(error(b))
}

/// Index pairs of the maximal runs of falling steps.
fn falling_runs(points: &[SeriesPoint]) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for i in 1..points.len() {
        if fall_db(&points[i - 1], &points[i]) > STEP_THRESHOLD_DB {
            match runs.last_mut() {
                Some((_, end)) if *end == i - 1 => *end = i,
                _ => runs.push((i - 1, i)),
            }
        }
    }
    runs
}

/// Index pairs (peak, trough) of the falls between significant extrema.
fn falling_legs(points: &[SeriesPoint]) -> Vec<(usize, usize)> {
    let significant =
        |fall: f64, a: usize, b: usize| fall > STEP_THRESHOLD_DB.max(2.0 * combined_error_db(&points[a], &points[b]));
    let mut legs = Vec::new();
    let (mut peak, mut trough) = (0, 0);
    let mut falling = false;
    for i in 1..points.len() {
        if falling {
            if fall_db(&points[i], &points[trough]) < 0.0 {
                trough = i;
            } else if significant(fall_db(&points[i], &points[trough]), trough, i) {
                legs.push((peak, trough));
                falling = false;
                peak = i;
            }
        } else if fall_db(&points[peak], &points[i]) <= 0.0 {
            peak = i;
        } else if significant(fall_db(&points[peak], &points[i]), peak, i) {
            falling = true;
            trough = i;
        }
    }
    if falling {
        legs.push((peak, trough));
    }
    legs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(levels: impl IntoIterator<Item = (f64, f64)>, std_error_db: f64) -> Vec<SeriesPoint> {
        levels
            .into_iter()
            .map(|(value, db)| {
                let intensity = 10f64.powf(db / 10.0);
                let intensity_error = std_error_db * intensity * std::f64::consts::LN_10 / 10.0;
                let level = BandLevel { band_hz: 1000.0, intensity, intensity_error, early_share: 1.0 };
                SeriesPoint { value, level, spl_1m_db: None }
            })
            .collect()
    }

    #[test]
    fn a_level_that_only_grows_has_no_rise_on_closing() {
        let points = series((0..20).map(|i| (f64::from(i) * 0.1, f64::from(i) - 30.0)), 0.0);
        assert_eq!(rises(&points), vec![]);
        assert_eq!(rises(&[]), vec![]);
        assert_eq!(rises(&points[..1]), vec![]);
    }

    #[test]
    fn a_fall_below_the_step_threshold_is_no_interval_and_ends_one() {
        let points = series([(0.0, 0.0), (1.0, -1.0), (2.0, -1.00005), (3.0, -2.0)], 0.0);
        let found: Vec<_> = rises(&points).iter().map(|r| (r.value_low, r.value_high)).collect();
        assert_eq!(found, vec![(0.0, 1.0), (2.0, 3.0)]);
    }

    #[test]
    fn a_closed_door_that_lets_nothing_pass_is_lower_than_anything() {
        let points = series([(0.0, f64::NEG_INFINITY), (0.1, -20.0), (0.2, -25.0), (0.3, f64::NEG_INFINITY)], 0.0);
        let found = rises(&points);
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].value_low, found[0].value_high), (0.1, 0.3));
        assert_eq!(found[0].rise_db, f64::INFINITY);
    }

    #[test]
    fn noise_within_its_standard_error_makes_no_interval() {
        let points = series((0..40).map(|i| (f64::from(i), if i % 2 == 0 { 0.1 } else { -0.1 })), 0.1);
        assert_eq!(rises(&points), vec![]);
    }

    #[test]
    fn noise_does_not_cut_a_long_fall_in_two() {
        let ripple = |i: i32| if i % 2 == 0 { 0.1 } else { -0.1 };
        let points = series((0..41).map(|i| (f64::from(i), -0.15 * f64::from(i) + ripple(i))), 0.1);
        let found = rises(&points);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].value_low, found[0].value_high), (0.0, 39.0));
        assert!((found[0].rise_db - 6.05).abs() < 1e-9, "{}", found[0].rise_db);
        assert!((found[0].std_error_db - 0.1 * 2f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn series_are_sorted_by_value_whatever_the_order_of_the_sweep() {
        let reception = |db: f64| Reception {
            source: "s".into(),
            probe: "p".into(),
            paths: vec![],
            echogram: None,
            levels: vec![series([(0.0, db)], 0.0)[0].level],
        };
        let sets = [vec![reception(1.0)], vec![reception(2.0)], vec![reception(3.0)]];
        let at = |value, i: usize| SweepValue { value, receptions: &sets[i], spl_1m_db: vec![] };
        let all = Series::collect(&[at(0.5, 0), at(0.1, 1), at(0.3, 2)]);
        assert_eq!(all.len(), 1);
        let order: Vec<f64> = all[0].points.iter().map(|p| p.level.level_db().round()).collect();
        assert_eq!(order, vec![2.0, 3.0, 1.0]);
    }

    /// Octave band 1 kHz, line source at (0, 2), receiver (0, -2), openings 0.44-1.2 m of a sliding door in a thin
    /// rigid screen: levels re free field and expected intervals from the exact solution (spectral Nystrom method,
    /// relative accuracy 1e-9), reference tables G_door_octave and G_door_intervals.
    const DOOR_1K: &str = "
        0.44,-3.952635012 0.46,-3.854075184 0.48,-3.803456655 0.5,-3.800895351 0.52,-3.845996694
        0.54,-3.9376109 0.56,-4.073529751 0.58,-4.250103851 0.6,-4.461777746 0.62,-4.700581676
        0.64,-4.95569199 0.66,-5.213276478 0.68,-5.456944399 0.7,-5.669136257 0.72,-5.83358025
        0.74,-5.938438011 0.76,-5.979149601 0.78,-5.959755637 0.8,-5.892008614 0.82,-5.792626432
        0.84,-5.679812616 0.86,-5.570177015 0.88,-5.476653236 0.9,-5.407449272 0.92,-5.365790952
        0.94,-5.350214019 0.96,-5.355285016 0.98,-5.37274777 1,-5.393111531 1.02,-5.407577972
        1.04,-5.409982285 1.06,-5.398233184 1.08,-5.374755323 1.1,-5.345733643 1.12,-5.319387126
        1.14,-5.303803941 1.16,-5.304911427 1.18,-5.325003166 1.2,-5.362065645";

    #[test]
    fn the_intervals_of_the_exact_sliding_door_are_found() {
        let points = series(
            DOOR_1K.split_whitespace().map(|row| {
                let (w, level) = row.split_once(',').unwrap();
                (w.parse().unwrap(), level.parse().unwrap())
            }),
            0.0,
        );
        let expected = [(0.5, 0.76, 2.17825425), (0.94, 1.04, 0.05976826512), (1.14, 1.2, 0.05826170329)];
        let found = rises(&points);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (rise, (low, high, rise_db)) in found.iter().zip(expected) {
            assert_eq!((rise.value_low, rise.value_high), (low, high));
            // The table has ten digits.
            assert!((rise.rise_db - rise_db).abs() < 2e-9, "{} against {rise_db}", rise.rise_db);
        }
    }
}
