//! Gives every band of the late noise the energy of its echogram over time, as band filters measure it.
//!
//! Noise of a narrow band has few degrees of freedom, neighbours reach over a band's edges, and noise interferes with the early sound:
//! over some time a filter measures a little more or less than the echogram holds, and decay times and clarity follow. Band by band
//! the filtered noise N and the early sound E are compared over windows that grow with time, and the noise is multiplied by the smooth
//! factor g with g^2 NN + 2 g EN = late energy of the window, as a filter that rings measures it (NN and EN: their sums of products).

use std::ops::Range;

use realfft::num_complex::Complex64;
use rustfft::FftPlanner;

use super::energy::EnergyCurve;
use super::envelope::BandFilter;
use super::noise::{Layer, TimeAxis, density};
use super::transform::Transform;
use crate::probe::Reception;
use crate::scene::Band;

/// Length of the first window in periods of the band's width.
const FIRST_PERIODS: f64 = 2.5;
/// Growth of the windows with the time since the first bin.
const GROWTH: f64 = 1.0 / 20.0;
/// Reflections that a window holds at least.
const REFLECTIONS: f64 = 4.0;
/// Samples that are added at a time.
const PIECE: usize = 2048;
/// Least and greatest factor.
const LIMITS: [f64; 2] = [0.25, 2.0];

/// What balances the noise of a response.
pub(super) struct Balance<'a> {
    /// Number of samples of the response.
    length: usize,
    transform: &'a Transform,
    /// One a band; `None` where it reaches beyond half the sample rate.
    filters: Vec<Option<Filter>>,
}

impl<'a> Balance<'a> {
    /// `curves`: the energies of the reception, one a band.
    pub(super) fn new(
        reception: &Reception,
        curves: &[EnergyCurve],
        bands: &[Band],
        axis: TimeAxis,
        transform: &'a Transform,
    ) -> Self {
        let grid = transform.length();
        let mut fast = FftPlanner::new();
        let mut filter = |(band, curve): (&Band, &EnergyCurve)| {
            let filter = BandFilter::new(band, axis.sample_rate_hz, grid, &mut fast)?;
            let windows = windows(reception, curve, band, axis, &filter, grid);
            Some(Filter { filter, windows })
        };
        let filters = bands.iter().zip(curves).map(&mut filter).collect();
        Self { length: axis.length, transform, filters }
    }

    /// Multiplies the `layers` by factors of time; `early` is the spectrum of what sounds beside them. Returns their sum.
    pub(super) fn balance(&self, layers: &mut [Layer], early: &[Complex64], rounds: usize) -> Vec<f64> {
        let beside: Vec<Vec<Complex64>> = self.heard(layers).map(|(_, f)| f.filter.envelope(early)).collect();
        let sum = |layers: &[Layer]| {
            let mut sum = vec![0.0; self.length];
            add(layers, |_| 1.0, &mut sum);
            sum
        };
        let mut all = sum(layers);
        for _ in 0..rounds {
            let noise = self.transform.spectrum(all);
            let factors: Vec<(usize, Vec<(f64, f64)>)> = self
                .heard(layers)
                .zip(&beside)
                .map(|((n, f), beside)| (n, f.factors(&f.filter.envelope(&noise), beside)))
                .collect();
            factors.iter().for_each(|(n, factors)| apply(&mut layers[*n].samples, factors));
            all = sum(layers);
        }
        all
    }

    /// The layers whose band the sample rate holds, by their index, with the band's filter.
    fn heard(&self, layers: &[Layer]) -> impl Iterator<Item = (usize, &Filter)> {
        let bands: Vec<usize> = layers.iter().map(|layer| layer.band).collect();
        bands.into_iter().enumerate().filter_map(|(n, band)| Some((n, self.filters[band].as_ref()?)))
    }
}

/// Adds the noise of all bands to samples, times the band's factor.
pub(super) fn add(layers: &[Layer], factor: impl Fn(usize) -> f64, samples: &mut [f64]) {
    // Piece by piece, which a cache holds.
    for (piece, sum) in samples.chunks_mut(PIECE).enumerate() {
        for layer in layers {
            let (from, factor) = (piece * PIECE, factor(layer.band));
            sum.iter_mut().zip(&layer.samples[from..]).for_each(|(sum, s)| *sum += factor * s);
        }
    }
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

/// A band's filter and its windows.
struct Filter {
    filter: BandFilter,
    windows: Vec<Window>,
}

/// A piece of an envelope.
struct Window {
    place: Range<usize>,
    /// Its middle in samples of the response.
    middle: f64,
    /// Late energy, as the filter measures it.
    late: f64,
}

/// The windows of a band from the first late sound on.
fn windows(
    reception: &Reception,
    curve: &EnergyCurve,
    band: &Band,
    axis: TimeAxis,
    filter: &BandFilter,
    grid: usize,
) -> Vec<Window> {
    let Some(first) = curve.bins.iter().position(|e| *e > 0.0) else { return Vec::new() };
    let TimeAxis { sample_rate_hz, length, shift_s } = axis;
    // Samples of the response a sample of the envelope.
    let step = grid as f64 / filter.length() as f64;
    let remaining = |place: f64| curve.remaining_in_bins((place - 0.5) * step / sample_rate_hz - shift_s);
    let left: Vec<f64> = (0..=filter.length()).map(|n| remaining(n as f64)).collect();
    let energies: Vec<f64> = left.windows(2).map(|pair| pair[0] - pair[1]).collect();
    // The filter rings over the edges of the windows, after these energies as after the noise.
    let energies = filter.smeared(&energies);
    let sample = |s: f64| (s + shift_s) * sample_rate_hz;
    let place = |s: f64| ((sample(s) / step).round().max(0.0) as usize).min(filter.length());
    let start_s = first as f64 * curve.bin_s;
    let end_s = (length as f64 / sample_rate_hz - shift_s).min(curve.bins.len() as f64 * curve.bin_s);
    let least_s = FIRST_PERIODS / (band.high_hz - band.low_hz);
    let mut windows = Vec::new();
    let mut from_s = start_s;
    while from_s < end_s {
        let sparse_s = REFLECTIONS / (density(reception, axis, sample(from_s)) * sample_rate_hz);
        let to_s = from_s + least_s.max(sparse_s).max(GROWTH * (from_s - start_s));
        // A rest shorter than a window belongs to the last one.
        let to_s = if to_s + 0.5 * least_s >= end_s { end_s } else { to_s };
        let place = place(from_s)..place(to_s);
        let late = energies[place.clone()].iter().sum();
        windows.push(Window { place, middle: sample(0.5 * (from_s + to_s)), late });
        from_s = to_s;
    }
    windows
}

impl Filter {
    /// Factors on the `noise` at the middles of the windows, such that together with what is `beside` it brings their late energies.
    /// A window without noise asks for nothing.
    fn factors(&self, noise: &[Complex64], beside: &[Complex64]) -> Vec<(f64, f64)> {
        let factor = |window: &Window| {
            let cross = self.filter.cross(noise, beside, window.place.clone());
            let own = self.filter.power(&noise[window.place.clone()]);
            let root = (cross * cross + own * window.late).max(0.0).sqrt();
            (own > 0.0).then(|| (window.middle, ((root - cross) / own).clamp(LIMITS[0], LIMITS[1])))
        };
        self.windows.iter().filter_map(factor).collect()
    }
}
