//! Room-acoustic parameters after ISO 3382-1, from energies, without a detour over filtered noise.
//!
//! Time 0 is the first arrival in the band. The decay curve L(t) is the energy still to come (Schroeder's backward
//! integration, exact here: paths are steps, bins have constant power). An echogram that ends before the sound has died away
//! lacks a tail; it is continued exponentially with the decay of its last two quarters, the correction constant of ISO
//! 3382-1, 5.3.3, and no decay time is taken from beyond the echogram's end.

use super::energy::EnergyCurve;
use crate::probe::Reception;
use crate::scene::Band;

/// Points of a decay curve that a regression uses.
const POINTS: usize = 500;
/// Largest non-linearity 1000 (1 - r^2) of a straight decay (ISO 3382-2, annex B: above 10 the curve is far from straight).
const STRAIGHT: f64 = 10.0;
/// The same for the early decay, whose first step is the direct sound.
const STRAIGHT_EARLY: f64 = 50.0;
/// Largest difference between T30 and T20, as a share of T20, of a straight decay (curvature; ISO 3382-2, annex B).
const CURVATURE: f64 = 0.10;
/// How far below a regression's lower limit the data must reach, in dB.
const MARGIN_DB: f64 = 5.0;
/// Ratio of the energies of the last two quarters above which the end of the decay cannot be seen.
const STANDING: f64 = 0.95;
/// Share of all energy in the last quarter below which its ratio does not matter.
const NEGLIGIBLE: f64 = 1e-9;

/// A decay time with its doubt.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct DecayTime {
    /// Time of a decay by 60 dB in s, extrapolated from the range evaluated; `None` if that range is not there.
    pub seconds: Option<f64>,
    /// Correlation coefficient of level and time in the regression, -1 for a straight decay.
    pub correlation: Option<f64>,
    /// Whether the decay is there and straight.
    pub reliable: bool,
    /// Why it is not reliable.
    pub reason: Option<String>,
}

impl DecayTime {
    fn undefined(reason: impl Into<String>) -> Self {
        Self { seconds: None, correlation: None, reliable: false, reason: Some(reason.into()) }
    }

    /// Adds a doubt to those already there.
    fn doubt(&mut self, reason: impl AsRef<str>) {
        self.reliable = false;
        self.reason = Some(match self.reason.take() {
            Some(others) => format!("{others}; {}", reason.as_ref()),
            None => reason.as_ref().into(),
        });
    }
}

/// The parameters of one band; `None` where a parameter is not defined.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Metrics {
    /// Nominal centre in Hz.
    pub band_hz: f64,
    /// Early decay time: from 0 to -10 dB.
    pub edt: DecayTime,
    /// Decay from -5 to -25 dB.
    pub t20: DecayTime,
    /// Decay from -5 to -35 dB.
    pub t30: DecayTime,
    /// Clarity in dB: energy before 50 ms over energy after; `None` if either is nothing.
    pub c50_db: Option<f64>,
    /// Clarity in dB: energy before 80 ms over energy after; `None` if either is nothing.
    pub c80_db: Option<f64>,
    /// Definition, 0..=1: share of the energy before 50 ms.
    pub d50: Option<f64>,
    /// Centre time in s.
    pub ts_s: Option<f64>,
    /// Strength in dB: level re the same (point) source's free field at 10 m.
    pub g_db: Option<f64>,
    /// T30 over T20 less 1: how bent the decay is.
    pub curvature: Option<f64>,
}

impl Metrics {
    /// Those of a band in which nothing arrives.
    pub(super) fn silent(band_hz: f64) -> Self {
        let nothing = DecayTime::undefined("nothing arrives in this band");
        Self {
            band_hz,
            edt: nothing.clone(),
            t20: nothing.clone(),
            t30: nothing,
            c50_db: None,
            c80_db: None,
            d50: None,
            ts_s: None,
            g_db: None,
            curvature: None,
        }
    }

    /// Whether all three decay times are.
    pub fn is_reliable(&self) -> bool {
        [&self.edt, &self.t20, &self.t30].iter().all(|d| d.reliable)
    }
}

/// The parameters of a reception, one entry a band.
///
/// Decay times are not reliable where nothing was traced: a list of paths ends with its order, not with the sound.
pub fn metrics(reception: &Reception, bands: &[Band]) -> Vec<Metrics> {
    let curves = (0..bands.len()).map(|b| EnergyCurve::new(reception, b));
    bands
        .iter()
        .zip(curves)
        .map(|(band, curve)| {
            let traced = curve.bins.iter().any(|e| *e > 0.0);
            of_curve(curve, band.nominal_hz, traced)
        })
        .collect()
}

/// The parameters of one band's curve; `traced`: whether it holds more than a list of paths.
pub(super) fn of_curve(curve: EnergyCurve, band_hz: f64, traced: bool) -> Metrics {
    let Some(decay) = Decay::new(curve, traced) else { return Metrics::silent(band_hz) };
    let edt = decay.time(0.0, -10.0, STRAIGHT_EARLY);
    let mut t20 = decay.time(-5.0, -25.0, STRAIGHT);
    let mut t30 = decay.time(-5.0, -35.0, STRAIGHT);
    let curvature = t20.seconds.zip(t30.seconds).map(|(a, b)| b / a - 1.0);
    if let Some(curvature) = curvature.filter(|c| c.abs() > CURVATURE) {
        let reason = format!("the decay is bent: T30 differs from T20 by {:.0} %", 100.0 * curvature);
        t20.doubt(&reason);
        t30.doubt(&reason);
    }
    let share = |limit_s: f64| {
        let late = decay.energy_from(limit_s);
        (decay.total - late, late)
    };
    let clarity =
        |(early, late): (f64, f64)| (early > 0.0 && late > 1e-14 * decay.total).then(|| 10.0 * (early / late).log10());
    Metrics {
        band_hz,
        edt,
        t20,
        t30,
        c50_db: clarity(share(0.05)),
        c80_db: clarity(share(0.08)),
        d50: Some(share(0.05).0 / decay.total),
        ts_s: Some(decay.centre_time_s()),
        g_db: Some(10.0 * decay.total.log10() + 20.0),
        curvature,
    }
}

/// The energy still to come over the time since the first arrival.
struct Decay {
    curve: EnergyCurve,
    /// First arrival on the curve's clock, in s.
    start_s: f64,
    /// End of the data since the first arrival, in s.
    end_s: f64,
    /// Energy after the end, from the exponential continuation.
    tail: f64,
    /// Decay rate of the continuation in 1/s.
    tail_rate: f64,
    /// All energy, the tail included.
    total: f64,
    /// Why the whole curve is doubtful.
    doubt: Option<&'static str>,
}

impl Decay {
    /// `None` if there is no energy.
    fn new(curve: EnergyCurve, traced: bool) -> Option<Self> {
        let start_s = curve.first_arrival_s()?;
        let known = curve.total();
        if !(known > 0.0 && known.is_finite()) {
            return None;
        }
        let end_s = curve.end_s() - start_s;
        let bins_end = curve.bins.len() as f64 * curve.bin_s;
        let (mut tail, mut tail_rate, mut doubt) = (0.0, 0.0, None);
        if !traced {
            doubt = Some("no reverberation was traced");
        } else {
            let quarter = 0.25 * (bins_end - start_s.min(bins_end));
            let last = curve.remaining_in_bins(bins_end - quarter);
            let before = curve.remaining_in_bins(bins_end - 2.0 * quarter) - last;
            if last > NEGLIGIBLE * known {
                let ratio = last / before;
                if quarter > 0.0 && before > 0.0 && ratio < STANDING {
                    tail = last * ratio / (1.0 - ratio);
                    tail_rate = -ratio.ln() / quarter;
                } else {
                    doubt = Some("the echogram ends before its decay shows");
                }
            }
        }
        Some(Self { start_s, end_s, tail, tail_rate, total: known + tail, doubt, curve })
    }

    /// Energy at or after `t_s` since the first arrival.
    fn energy_from(&self, t_s: f64) -> f64 {
        if t_s > self.end_s && self.tail_rate > 0.0 {
            self.tail * (-self.tail_rate * (t_s - self.end_s)).exp()
        } else {
            self.curve.remaining(self.start_s + t_s) + self.tail
        }
    }

    /// Level of the energy still to come re all energy, in dB.
    fn level_db(&self, t_s: f64) -> f64 {
        10.0 * (self.energy_from(t_s) / self.total).log10()
    }

    /// The latest time at which the level is `level_db` or more, up to the end of the data.
    fn time_of_level(&self, level_db: f64) -> f64 {
        let (mut early, mut late) = (0.0, self.end_s);
        for _ in 0..60 {
            let middle = 0.5 * (early + late);
            if self.level_db(middle) >= level_db {
                early = middle;
            } else {
                late = middle;
            }
        }
        early
    }

    /// Decay time from the regression of the level over time between two levels.
    fn time(&self, upper_db: f64, lower_db: f64, straight: f64) -> DecayTime {
        let reached_db = if self.tail > 0.0 { 10.0 * (self.tail / self.total).log10() } else { f64::NEG_INFINITY };
        if reached_db > lower_db {
            return DecayTime::undefined(format!("the data end at {reached_db:.0} dB, the range needs {lower_db} dB"));
        }
        let (from, to) = (self.time_of_level(upper_db), self.time_of_level(lower_db));
        let step = (to - from) / POINTS as f64;
        if !(step > 0.0 && to - from > 1e-9 * self.end_s) {
            return DecayTime::undefined("a single arrival holds the whole range");
        }
        // The middle of each step, so that a jump at either end of the range is not sampled.
        let points: Vec<(f64, f64)> = (0..POINTS)
            .map(|i| from + (i as f64 + 0.5) * step)
            .map(|t| (t, self.level_db(t)))
            .filter(|p| p.1.is_finite())
            .collect();
        let Some((slope, correlation)) = regression(&points) else {
            return DecayTime::undefined("the level does not fall in the range");
        };
        let seconds = -60.0 / slope;
        let mut time =
            DecayTime { seconds: Some(seconds), correlation: Some(correlation), reliable: true, reason: None };
        if let Some(doubt) = self.doubt {
            time.doubt(doubt);
        }
        if reached_db > lower_db - MARGIN_DB {
            time.doubt(format!("the data end at {reached_db:.0} dB, less than {MARGIN_DB} dB below the range"));
        }
        let nonlinearity = 1000.0 * (1.0 - correlation * correlation);
        if nonlinearity > straight {
            time.doubt(format!("the decay is not straight: non-linearity {nonlinearity:.0} per mille"));
        }
        let first_db = points.first().map_or(upper_db, |p| p.1);
        if upper_db < 0.0 && first_db < upper_db - 0.25 * (upper_db - lower_db) {
            time.doubt(format!("a single arrival takes the level down to {first_db:.0} dB"));
        }
        time
    }

    /// Centre of gravity of the energy over time, in s.
    fn centre_time_s(&self) -> f64 {
        let paths: f64 = self.curve.arrivals.iter().map(|(t, e)| e * (t - self.start_s)).sum();
        let bin_s = self.curve.bin_s;
        let bins: f64 = self
            .curve
            .bins
            .iter()
            .enumerate()
            .map(|(i, e)| e * ((i as f64 + 0.5) * bin_s - self.start_s).max(0.0))
            .sum();
        let tail = if self.tail > 0.0 { self.tail * (self.end_s + 1.0 / self.tail_rate) } else { 0.0 };
        (paths + bins + tail) / self.total
    }
}

/// Slope in dB/s and correlation coefficient of (time, level) points; `None` unless the level falls.
fn regression(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let (t, l) = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0 / n, sum.1 + p.1 / n));
    let (mut tt, mut tl, mut ll) = (0.0, 0.0, 0.0);
    for (x, y) in points {
        tt += (x - t) * (x - t);
        tl += (x - t) * (y - l);
        ll += (y - l) * (y - l);
    }
    (points.len() > 2 && tt > 0.0 && tl < -1e-12 * tt).then(|| (tl / tt, (tl / (tt * ll).sqrt()).max(-1.0)))
}
