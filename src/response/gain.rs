//! The last correction: a smooth gain that gives the whole response the band energies of the reception.
//!
//! Levels add intensities, samples add pressures: early paths that overlap within a period interfere, most of all in the
//! lowest bands. A gain, linear in ln G over ln f between the band centres and of minimum phase, restores each band's
//! energy and leaves times of arrival alone.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;

use super::late::smooth_length;
use super::spectrum::{Between, Shaper, between, fade, fill_silent};

/// Remaining error at which the iteration stops, in dB.
const GOAL_DB: f64 = 0.01;
/// Largest gain or loss, in nepers of amplitude (about 52 dB).
const LIMIT: f64 = 6.0;

/// Integrates |H|^2 over bands, on a grid fine enough to hold every detail of a response of the given length.
struct Meter {
    /// Transform length in samples, at least twice the response and at least one second.
    grid: usize,
    /// First bin and weights of each band; the weighted sum of |H|^2 is the mean over the band.
    weights: Vec<(usize, Vec<f64>)>,
}

impl Meter {
    fn new(shaper: &Shaper<'_>, samples: usize) -> Self {
        let rate = shaper.sample_rate_hz();
        let grid = smooth_length((2 * samples).max(samples + shaper.length()).max(rate.ceil() as usize));
        let step = rate / grid as f64;
        let weights = shaper
            .bands()
            .iter()
            .map(|b| {
                let top = (grid / 2) as f64;
                let (low, high) = ((b.low_hz / step).min(top), (b.high_hz / step).min(top));
                let (first, last) = (low.floor() as usize, (high.ceil() as usize).min(grid / 2));
                let mut weights = vec![0.0; last - first + 1];
                // Exact integral of the polygon through the bins, cell by cell.
                for k in first..last {
                    let (from, to) = (low.max(k as f64) - k as f64, high.min((k + 1) as f64) - k as f64);
                    let upper = 0.5 * (to * to - from * from);
                    weights[k - first] += (to - from) - upper;
                    weights[k - first + 1] += upper;
                }
                let width = high - low;
                if width > 0.0 {
                    weights.iter_mut().for_each(|w| *w /= width);
                }
                (first, weights)
            })
            .collect();
        Self { grid, weights }
    }

    /// White mean of |H|^2 over each band.
    fn means(&self, spectrum: &[Complex64]) -> Vec<f64> {
        self.weights
            .iter()
            .map(|(first, weights)| weights.iter().zip(&spectrum[*first..]).map(|(w, h)| w * h.norm_sqr()).sum())
            .collect()
    }

    /// The same energies in about 48 pieces a band, for the gain to be fitted on: place of the piece and energy.
    fn pieces(&self, shaper: &Shaper<'_>, spectrum: &[Complex64]) -> Vec<Vec<(Between, f64)>> {
        let step = shaper.sample_rate_hz() / self.grid as f64;
        let bands = shaper.bands();
        self.weights
            .iter()
            .map(|(first, weights)| {
                let size = weights.len().div_ceil(48);
                weights
                    .chunks(size)
                    .enumerate()
                    .map(|(i, w)| {
                        let start = first + i * size;
                        let energy = w.iter().zip(&spectrum[start..]).map(|(w, h)| w * h.norm_sqr()).sum();
                        (between(bands, (start as f64 + 0.5 * (w.len() - 1) as f64) * step), energy)
                    })
                    .collect()
            })
            .collect()
    }
}

/// Gives `samples` the band means of |H|^2 in `target` (one a band of the shaper; 0: the band is silenced). Returns the
/// remaining error of each band in dB: 0 where a silent band was asked for, infinite where there was nothing to amplify.
pub(super) fn match_bands(
    samples: &mut [f64],
    target: &[f64],
    shaper: &mut Shaper<'_>,
    planner: &mut RealFftPlanner<f64>,
) -> Vec<f64> {
    let meter = Meter::new(shaper, samples.len());
    let (forward, inverse) = (planner.plan_fft_forward(meter.grid), planner.plan_fft_inverse(meter.grid));
    let mut time = vec![0.0; meter.grid];
    let mut raw = forward.make_output_vec();
    time[..samples.len()].copy_from_slice(samples);
    // Buffers have the plan's own lengths, the only thing the transforms can object to.
    let done = forward.process(&mut time, &mut raw);
    debug_assert!(done.is_ok());

    let mut means = meter.means(&raw);
    let asked_silent: Vec<bool> = target.iter().map(|t| *t <= 0.0).collect();
    let fixed: Vec<bool> = means.iter().zip(&asked_silent).map(|(m, s)| *s || *m <= 0.0).collect();
    let silent_enough = means.iter().zip(&asked_silent).all(|(m, s)| !*s || *m <= 0.0);
    let mut errors = errors_db(&means, target);
    if fixed.iter().all(|f| *f) {
        if asked_silent.iter().all(|s| *s) {
            samples.fill(0.0);
        }
        return errors;
    }
    if silent_enough && worst(&errors, &fixed) < GOAL_DB {
        return errors;
    }

    let pieces = meter.pieces(shaper, &raw);
    let step = shaper.sample_rate_hz() / meter.grid as f64;
    let places: Vec<Between> = (0..raw.len()).map(|k| between(shaper.bands(), k as f64 * step)).collect();
    let fades: Option<Vec<f64>> = asked_silent
        .contains(&true)
        .then(|| (0..raw.len()).map(|k| fade(shaper.bands(), &asked_silent, k as f64 * step)).collect());
    let mut wanted = target.to_vec();
    let mut ln_gain = vec![0.0; target.len()];
    let mut best: Option<(f64, Vec<f64>, Vec<f64>)> = None;
    let mut spectrum = raw.clone();
    for _ in 0..6 {
        fit_gain(&pieces, &wanted, &fixed, &mut ln_gain);
        let phase = shaper.pulse(&ln_gain, &asked_silent, 0.0).1;
        let ratio = shaper.length() as f64 / meter.grid as f64;
        for (k, (s, r)) in spectrum.iter_mut().zip(&raw).enumerate() {
            let position = k as f64 * ratio;
            let cell = (position as usize).min(phase.len() - 2);
            let angle = phase[cell] + (position - cell as f64) * (phase[cell + 1] - phase[cell]);
            let gain = places[k].of(&ln_gain).exp() * fades.as_ref().map_or(1.0, |f| f[k]) / meter.grid as f64;
            *s = r * Complex64::from_polar(gain, angle);
        }
        spectrum[0].im = 0.0;
        if let Some(last) = spectrum.last_mut() {
            last.im = 0.0;
        }
        let done = inverse.process(&mut spectrum, &mut time);
        debug_assert!(done.is_ok());
        // What rings past either end of the response is cut off, then the loss is measured.
        time[samples.len()..].fill(0.0);
        let result = time[..samples.len()].to_vec();
        let done = forward.process(&mut time, &mut spectrum);
        debug_assert!(done.is_ok());
        means = meter.means(&spectrum);
        errors = errors_db(&means, target);
        let now = worst(&errors, &fixed);
        if best.as_ref().is_none_or(|b| now < b.0) {
            best = Some((now, errors.clone(), result));
        }
        if now < GOAL_DB {
            break;
        }
        for b in (0..wanted.len()).filter(|b| !fixed[*b]) {
            wanted[b] *= target[b] / means[b];
        }
    }
    if let Some((_, best_errors, result)) = best {
        samples.copy_from_slice(&result);
        errors = best_errors;
    }
    errors
}

/// Improves `ln_gain` (amplitude, at the band centres) until the pieces' energies times the gain squared sum to `wanted`.
fn fit_gain(pieces: &[Vec<(Between, f64)>], wanted: &[f64], fixed: &[bool], ln_gain: &mut [f64]) {
    for _ in 0..100 {
        let mut largest: f64 = 0.0;
        let missing: Vec<f64> = pieces
            .iter()
            .zip(wanted)
            .map(|(pieces, wanted)| {
                let energy: f64 = pieces.iter().map(|(place, e)| e * (2.0 * place.of(ln_gain)).exp()).sum();
                0.5 * (wanted / energy).ln()
            })
            .collect();
        for b in (0..ln_gain.len()).filter(|b| !fixed[*b]) {
            let next = (ln_gain[b] + missing[b]).clamp(-LIMIT, LIMIT);
            largest = largest.max((next - ln_gain[b]).abs());
            ln_gain[b] = next;
        }
        fill_silent(ln_gain, fixed);
        if largest < 1e-5 {
            break;
        }
    }
}

/// 10 lg(mean/target); 0 where silence was asked for.
fn errors_db(means: &[f64], target: &[f64]) -> Vec<f64> {
    means.iter().zip(target).map(|(m, t)| if *t > 0.0 { 10.0 * (m / t).log10() } else { 0.0 }).collect()
}

/// Largest error of the bands that can be changed.
fn worst(errors: &[f64], fixed: &[bool]) -> f64 {
    errors.iter().zip(fixed).filter(|(_, f)| !**f).map(|(e, _)| e.abs()).fold(0.0, f64::max)
}
