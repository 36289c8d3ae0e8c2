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
const FIRST_PERIODS: f64 = 3.0;
/// Growth of the windows with the time since the first bin.
const GROWTH: f64 = 1.0 / 12.0;
/// Silence in s after the response, in which filters ring.
const RINGING_S: f64 = 0.1;
/// Least and greatest factor.
const LIMITS: [f64; 2] = [0.25, 2.0];
/// Least and greatest share of the noise that is added to make up for the last gain.
const SHARES: [f64; 2] = [-0.5, 0.5];
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
    let transform = Transform::new(axis, planner);
    let spectrum_of = |time| transform.of(time);
    let grid = transform.grid;
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
                let factors =
                    filter.factors(&curves[layer.band], axis, &filter.envelope(&noise), (early, None), LIMITS);
                apply(&mut layer.samples, &factors);
            }
        }
    }
}

/// Makes up in `sounds`, the whole response, for what the gain over it has changed of the decays: adds shares of the `layers`.
pub(super) fn make_up(
    sounds: &mut [f64],
    layers: &[Layer],
    (curves, bands): (&[EnergyCurve], &[Band]),
    axis: TimeAxis,
    planner: &mut RealFftPlanner<f64>,
) {
    let transform = Transform::new(axis, planner);
    let (whole, noise) = (transform.of(sounds.to_vec()), transform.of(sum(layers, axis.length)));
    let mut fast = FftPlanner::new();
    for layer in layers {
        let curve = &curves[layer.band];
        let Some(filter) = Filter::new(&bands[layer.band], axis, transform.grid, &mut fast) else { continue };
        let (whole, mut missing) = (filter.envelope(&whole), filter.energies(&curve.arrivals, axis));
        missing.iter_mut().zip(&whole).for_each(|(m, z)| *m -= filter.unit * z.norm_sqr());
        let shares = filter.factors(curve, axis, &filter.envelope(&noise), (&whole, Some(&missing)), SHARES);
        let mut added = layer.samples.clone();
        apply(&mut added, &shares);
        sounds.iter_mut().zip(&added).for_each(|(s, a)| *s += a);
    }
}

/// Spectra of the response with the silence after it.
struct Transform {
    forward: std::sync::Arc<dyn realfft::RealToComplex<f64>>,
    grid: usize,
}

impl Transform {
    fn new(axis: TimeAxis, planner: &mut RealFftPlanner<f64>) -> Self {
        let grid = smooth_length(axis.length + (RINGING_S * axis.sample_rate_hz) as usize);
        Self { forward: planner.plan_fft_forward(grid), grid }
    }

    fn of(&self, mut time: Vec<f64>) -> Vec<Complex64> {
        time.resize(self.grid, 0.0);
        let mut spectrum = self.forward.make_output_vec();
        // Buffers have the plan's own lengths, the only thing the transforms can object to.
        let done = self.forward.process(&mut time, &mut spectrum);
        debug_assert!(done.is_ok());
        spectrum
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

    /// Energies of the envelope of `arrivals` (delay, intensity) that do not interfere.
    fn energies(&self, arrivals: &[(f64, f64)], axis: TimeAxis) -> Vec<f64> {
        let length = self.inverse.len();
        let mut kernel: Vec<Complex64> = self.shares.iter().map(|f| Complex64::from(*f)).collect();
        kernel.resize(length, Complex64::ZERO);
        self.inverse.process(&mut kernel);
        // What one arrival of intensity 1 leaves: it adds up to 1.
        kernel.iter_mut().for_each(|z| *z = Complex64::from(self.unit * z.norm_sqr()));
        let mut sum = vec![Complex64::ZERO; length];
        for (delay_s, intensity) in arrivals {
            let place = (delay_s + axis.shift_s) * axis.sample_rate_hz / self.step;
            if (0.0..(length - 1) as f64).contains(&place) {
                let (at, share) = (place as usize, place.fract());
                sum[at] += (1.0 - share) * intensity;
                sum[at + 1] += share * intensity;
            }
        }
        // Two transforms forth, conjugated: the third one leads back.
        self.inverse.process(&mut kernel);
        self.inverse.process(&mut sum);
        sum.iter_mut().zip(&kernel).for_each(|(s, k)| *s = (*s * k).conj());
        self.inverse.process(&mut sum);
        sum.iter().map(|s| (s.re / length as f64).max(0.0)).collect()
    }

    /// Factors on the noise at the middles of the windows (in samples), such that beside `beside` it brings the late energy and what
    /// else is `missing` (a sample of the envelope).
    fn factors(
        &self,
        curve: &EnergyCurve,
        axis: TimeAxis,
        noise: &[Complex64],
        (beside, missing): (&[Complex64], Option<&[f64]>),
        limits: [f64; 2],
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
            for (n, e) in noise[window.clone()].iter().zip(&beside[window.clone()]) {
                own += self.unit * n.norm_sqr();
                cross += self.unit * (n.re * e.re + n.im * e.im);
            }
            let late = curve.remaining_in_bins(from_s) - curve.remaining_in_bins(to_s);
            let wanted = late + missing.map_or(0.0, |missing| missing[window].iter().sum());
            let root = (cross * cross + own * wanted).max(0.0).sqrt();
            let factor = if own > 0.0 { (root - cross) / own } else { 0.0 };
            let middle = (0.5 * (from_s + to_s) + axis.shift_s) * axis.sample_rate_hz;
            factors.push((middle, factor.clamp(limits[0], limits[1])));
            from_s = to_s;
        }
        factors
    }
}
