//! Gives every band of the late noise the energy of its echogram over time, as band filters measure it.
//!
//! Noise of a narrow band has few degrees of freedom, neighbours reach over a band's edges, and noise interferes with the early sound:
//! over some time a filter measures a little more or less than the echogram holds, and decay times and clarity follow. Band by band
//! the filtered noise N and the early sound E are compared over windows that grow with time, and the noise is multiplied by the smooth
//! factor g with g^2 NN + 2 g EN = late energy of the window (NN and EN: their sums of products).

use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;
use rustfft::FftPlanner;

use super::analysis::{pass, reach_hz};
use super::energy::EnergyCurve;
use super::late::{TimeAxis, smooth_length};
use crate::scene::Band;

/// Length of the first window in periods of the band's width.
const FIRST_PERIODS: f64 = 4.0;
/// Growth of the windows with the time since the first bin.
const GROWTH: f64 = 1.0 / 12.0;
/// Silence in s after the response, in which filters ring.
const RINGING_S: f64 = 0.1;
/// Least and greatest factor.
const LIMITS: [f64; 2] = [0.5, 2.0];
/// Rounds: what one band's factor does to its neighbours is left to the second.
const ROUNDS: usize = 2;

/// The noise of one band.
pub(super) struct Layer {
    /// Index of the band.
    pub(super) band: usize,
    pub(super) samples: Vec<f64>,
}

/// Balances the `layers`; `curves` (one a band) hold the late energies, `early` is what sounds beside them.
pub(super) fn balance(
    layers: &mut [Layer],
    (curves, bands): (&[EnergyCurve], &[Band]),
    axis: TimeAxis,
    early: &[f64],
    planner: &mut RealFftPlanner<f64>,
) {
    let grid = smooth_length(axis.length + (RINGING_S * axis.sample_rate_hz) as usize);
    let forward = planner.plan_fft_forward(grid);
    let spectrum_of = |mut time: Vec<f64>| {
        time.resize(grid, 0.0);
        let mut spectrum = forward.make_output_vec();
        // Buffers have the plan's own lengths, the only thing the transforms can object to.
        let done = forward.process(&mut time, &mut spectrum);
        debug_assert!(done.is_ok());
        spectrum
    };
    let beside = spectrum_of(early.to_vec());
    let mut fast = FftPlanner::new();
    let filters: Vec<Option<Filter>> =
        layers.iter().map(|layer| Filter::new(&bands[layer.band], axis, grid, &mut fast)).collect();
    let sounds: Vec<Vec<Complex64>> =
        filters.iter().map(|f| f.as_ref().map_or_else(Vec::new, |f| f.envelope(&beside))).collect();
    for _ in 0..ROUNDS {
        let noise = spectrum_of(sum(layers, axis.length));
        for ((layer, filter), early) in layers.iter_mut().zip(&filters).zip(&sounds) {
            if let Some(filter) = filter {
                let factors = filter.factors(&curves[layer.band], axis, &filter.envelope(&noise), early);
                apply(&mut layer.samples, &factors);
            }
        }
    }
}

/// The noise of all bands.
pub(super) fn sum(layers: &[Layer], length: usize) -> Vec<f64> {
    let mut sum = vec![0.0; length];
    for layer in layers {
        sum.iter_mut().zip(&layer.samples).for_each(|(sum, s)| *sum += s);
    }
    sum
}

/// Multiplies by factors at places (in samples, ascending), linear between them and held beyond.
fn apply(samples: &mut [f64], factors: &[(f64, f64)]) {
    let (Some(first), Some(last)) = (factors.first(), factors.last()) else { return };
    let length = samples.len();
    let place = |factor: &(f64, f64)| (factor.0.ceil() as usize).min(length);
    let (begin, end) = (place(first), place(last));
    samples[..begin].iter_mut().for_each(|s| *s *= first.1);
    samples[end..].iter_mut().for_each(|s| *s *= last.1);
    for pair in factors.windows(2) {
        let (from, to) = (place(&pair[0]), place(&pair[1]));
        let slope = (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0);
        for (n, s) in samples[from..to].iter_mut().enumerate() {
            *s *= pair[0].1 + slope * ((from + n) as f64 - pair[0].0);
        }
    }
}

/// A band's filter, and the transform that gives its envelope at the rate its width needs.
struct Filter {
    /// First bin and the filter's amplitude at each.
    first: usize,
    shares: Vec<f64>,
    inverse: std::sync::Arc<dyn rustfft::Fft<f64>>,
    /// From |z|^2 to intensity.
    unit: f64,
    /// Samples of the response a sample of the envelope.
    step: f64,
    /// Length of the first window in s.
    window_s: f64,
}

impl Filter {
    /// `None` where the band reaches beyond half the sample rate.
    fn new(band: &Band, axis: TimeAxis, grid: usize, fast: &mut FftPlanner<f64>) -> Option<Self> {
        if band.high_hz > 0.49 * axis.sample_rate_hz {
            return None;
        }
        let step_hz = axis.sample_rate_hz / grid as f64;
        let [first, last] = reach_hz(band).map(|hz| ((hz / step_hz) as usize).min(grid / 2));
        let powers: Vec<f64> = (first..=last).map(|k| pass(band, k as f64 * step_hz)).collect();
        let shares: Vec<f64> = powers.iter().map(|p| p.sqrt()).collect();
        let length = smooth_length(shares.len());
        Some(Self {
            first,
            inverse: fast.plan_fft_inverse(length),
            unit: 1.0 / (length as f64 * powers.iter().sum::<f64>()),
            step: grid as f64 / length as f64,
            window_s: FIRST_PERIODS / (band.high_hz - band.low_hz),
            shares,
        })
    }

    /// The complex envelope of what passes the filter.
    fn envelope(&self, spectrum: &[Complex64]) -> Vec<Complex64> {
        let mut values: Vec<Complex64> = spectrum[self.first..].iter().zip(&self.shares).map(|(h, f)| h * f).collect();
        values.resize(self.inverse.len(), Complex64::ZERO);
        self.inverse.process(&mut values);
        values
    }

    /// Factors on the noise at the middles of the windows (in samples).
    fn factors(
        &self,
        curve: &EnergyCurve,
        axis: TimeAxis,
        noise: &[Complex64],
        early: &[Complex64],
    ) -> Vec<(f64, f64)> {
        let Some(first) = curve.bins.iter().position(|e| *e > 0.0) else { return Vec::new() };
        let start_s = first as f64 * curve.bin_s;
        let end_s =
            (axis.length as f64 / axis.sample_rate_hz - axis.shift_s).min(curve.bins.len() as f64 * curve.bin_s);
        let place = |s: f64| {
            (((s + axis.shift_s) * axis.sample_rate_hz / self.step).round().max(0.0) as usize).min(noise.len())
        };
        let mut factors = Vec::new();
        let mut from_s = start_s;
        while from_s < end_s {
            let to_s = from_s + self.window_s.max(GROWTH * (from_s - start_s));
            // A rest shorter than a window belongs to the last one.
            let to_s = if to_s + 0.5 * self.window_s >= end_s { end_s } else { to_s };
            let window = place(from_s)..place(to_s);
            let (mut own, mut cross) = (0.0, 0.0);
            for (n, e) in noise[window.clone()].iter().zip(&early[window]) {
                own += self.unit * n.norm_sqr();
                cross += self.unit * (n.re * e.re + n.im * e.im);
            }
            let late = curve.remaining_in_bins(from_s) - curve.remaining_in_bins(to_s);
            let factor = if own > 0.0 { ((cross * cross + own * late).sqrt() - cross) / own } else { 1.0 };
            let middle = (0.5 * (from_s + to_s) + axis.shift_s) * axis.sample_rate_hz;
            factors.push((middle, factor.clamp(LIMITS[0], LIMITS[1])));
            from_s = to_s;
        }
        factors
    }
}
