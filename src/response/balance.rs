//! Gives every band of the late noise the energy of its echogram over time, as band filters measure it.
//!
//! Noise of a narrow band has few degrees of freedom, neighbours reach over a band's edges, and noise interferes with the early sound:
//! over some time a filter measures a little more or less than the echogram holds, and decay times and clarity follow. Band by band
//! the filtered noise N and the early sound E are compared over windows that grow with time, and the noise is multiplied by the smooth
//! factor g with g^2 NN + 2 g EN = late energy of the window (NN and EN: their sums of products). After the last gain the same
//! windows are compared once more.

use std::ops::Range;
use std::sync::Arc;

use realfft::num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};

use super::analysis::{pass, passed};
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

/// What balances the noise of a response.
pub(super) struct Balance<'a> {
    /// Late energies, one a band.
    curves: &'a [EnergyCurve],
    axis: TimeAxis,
    forward: Arc<dyn RealToComplex<f64>>,
    /// Length of the transform: the response and the silence after it.
    grid: usize,
    /// One a band; `None` where it reaches beyond half the sample rate.
    filters: Vec<Option<Filter>>,
}

impl<'a> Balance<'a> {
    pub(super) fn new(
        curves: &'a [EnergyCurve],
        bands: &[Band],
        axis: TimeAxis,
        planner: &mut RealFftPlanner<f64>,
    ) -> Self {
        let grid = smooth_length(axis.length + (RINGING_S * axis.sample_rate_hz) as usize);
        let mut fast = FftPlanner::new();
        let filters = bands.iter().map(|band| Filter::new(band, axis, grid, &mut fast)).collect();
        Self { curves, axis, forward: planner.plan_fft_forward(grid), grid, filters }
    }

    /// Multiplies the `layers` by factors of time; `early` is what sounds beside them.
    pub(super) fn balance(&self, layers: &mut [Layer], early: &[f64]) {
        let beside = self.spectrum(early.to_vec());
        let beside: Vec<Vec<Complex64>> = self.heard(layers).map(|(_, filter)| filter.envelope(&beside)).collect();
        for _ in 0..ROUNDS {
            let noise = self.spectrum(sum(layers, self.axis.length));
            let factors: Vec<(usize, Vec<(f64, f64)>)> = self
                .heard(layers)
                .zip(&beside)
                .map(|((n, filter), beside)| {
                    let late = |_: Range<usize>| 0.0;
                    (n, filter.factors(self.late(&layers[n]), &filter.envelope(&noise), beside, late, LIMITS))
                })
                .collect();
            factors.iter().for_each(|(n, factors)| apply(&mut layers[*n].samples, factors));
        }
    }

    /// Makes up in `whole`, the response after a gain, for what that has changed of the decays: adds shares of the `layers` until
    /// it has the energies of `early`, of before the gain, and of the late sound.
    pub(super) fn make_up(&self, whole: &mut [f64], early: Vec<f64>, layers: &[Layer]) {
        let noise = self.spectrum(sum(layers, self.axis.length));
        let (early, all) = (self.spectrum(early), self.spectrum(whole.to_vec()));
        for (n, filter) in self.heard(layers) {
            let (early, all) = (filter.envelope(&early), filter.envelope(&all));
            let missing = |window: Range<usize>| filter.power(&early[window.clone()]) - filter.power(&all[window]);
            let shares = filter.factors(self.late(&layers[n]), &filter.envelope(&noise), &all, missing, SHARES);
            let mut added = layers[n].samples.clone();
            apply(&mut added, &shares);
            whole.iter_mut().zip(&added).for_each(|(sum, a)| *sum += a);
        }
    }

    /// The layers whose band the sample rate holds, by their index, with the band's filter.
    fn heard(&self, layers: &[Layer]) -> impl Iterator<Item = (usize, &Filter)> {
        let bands: Vec<usize> = layers.iter().map(|layer| layer.band).collect();
        bands.into_iter().enumerate().filter_map(|(n, band)| Some((n, self.filters[band].as_ref()?)))
    }

    fn late(&self, layer: &Layer) -> (&EnergyCurve, TimeAxis) {
        (&self.curves[layer.band], self.axis)
    }

    fn spectrum(&self, mut time: Vec<f64>) -> Vec<Complex64> {
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
    inverse: Arc<dyn Fft<f64>>,
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
        let bins = passed(band, step_hz, grid / 2 + 1);
        let first = bins.start;
        let powers: Vec<f64> = bins.map(|k| pass(band, k as f64 * step_hz)).collect();
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

    /// Energy of a piece of an envelope, as intensity.
    fn power(&self, envelope: &[Complex64]) -> f64 {
        self.unit * envelope.iter().map(|z| z.norm_sqr()).sum::<f64>()
    }

    /// Factors on the noise at the middles of the windows (in samples), such that together with `beside` it brings the late energy
    /// and what else is `missing` in a window of the envelopes.
    fn factors(
        &self,
        (curve, axis): (&EnergyCurve, TimeAxis),
        noise: &[Complex64],
        beside: &[Complex64],
        missing: impl Fn(Range<usize>) -> f64,
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
            let pairs = noise[window.clone()].iter().zip(&beside[window.clone()]);
            let cross = self.unit * pairs.map(|(n, b)| n.re * b.re + n.im * b.im).sum::<f64>();
            let own = self.power(&noise[window.clone()]);
            let late = curve.remaining_in_bins(from_s) - curve.remaining_in_bins(to_s);
            let root = (cross * cross + own * (late + missing(window))).max(0.0).sqrt();
            let middle = (0.5 * (from_s + to_s) + axis.shift_s) * axis.sample_rate_hz;
            // A window without noise asks for nothing.
            if own > 0.0 {
                factors.push((middle, ((root - cross) / own).clamp(limits[0], limits[1])));
            }
            from_s = to_s;
        }
        factors
    }
}
