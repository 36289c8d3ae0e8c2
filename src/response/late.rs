//! The late part: noise with the echogram's energy in every band and bin.
//!
//! A sequence of random signs (white, and of exactly equal energy a sample) is divided into bands whose powers add up to its
//! own; each band is given the envelope of its echogram and balanced against it (`balance`), and the bands are added. Filtering comes before the envelope, so nothing rings before the first arrival.
//! Each band also carries the smooth spectrum through the late band energies, so the sum has no steps at the band edges.

use rand_core::{Rng, SeedableRng};
use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;
use sha2::{Digest, Sha256};

use crate::probe::Reception;
use crate::scene::Band;

use super::balance::Layer;
use super::energy::EnergyCurve;
use super::spectrum::{between_hz, centres_hz, fade, ln_magnitude};

/// Half width of the cross-fade between two bands, as a share of the narrower one's width in octaves.
///
/// Narrow, so that a band keeps its own decay up to its edges; filters come before envelopes and ring unheard.
const CROSSFADE_SHARE: f64 = 1.0 / 48.0;

/// Width of the groups of bins between which the envelope is interpolated, as a share of the time since the first bin: a decay is
/// smooth over them, and late bins in which few rays arrived do not stand out.
const GROWTH: f64 = 1.0 / 24.0;

/// Window over which a band's noise is given constant power, in periods of its width.
const LEVELLED: f64 = 4.0;

/// The time axis of a response.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeAxis {
    /// Sample rate in Hz.
    pub(super) sample_rate_hz: f64,
    /// Number of samples.
    pub(super) length: usize,
    /// Time in s added to every delay of the reception.
    pub(super) shift_s: f64,
}

/// Noise with the energy curves' bins (`curves`: one a band of `bands`) that has next to nothing in common with the `early` samples, so
/// that the energies of both add up in every band.
pub(super) fn noise(
    reception: &Reception,
    curves: &[EnergyCurve],
    bands: &[Band],
    axis: TimeAxis,
    (seed, channel): (u64, usize),
    planner: &mut RealFftPlanner<f64>,
) -> Vec<Layer> {
    let TimeAxis { sample_rate_hz, length, shift_s } = axis;
    let end_s = length as f64 / sample_rate_hz - shift_s;
    let energy: Vec<f64> =
        curves.iter().map(|c| (c.remaining_in_bins(0.0) - c.remaining_in_bins(end_s)).max(0.0)).collect();
    let mut layers: Vec<Layer> = Vec::new();
    if energy.iter().all(|e| *e <= 0.0) {
        return layers;
    }
    let silent: Vec<bool> = energy.iter().map(|e| *e <= 0.0).collect();
    let ln = ln_magnitude(bands, &energy);

    let grid = smooth_length(length);
    let (forward, inverse) = (planner.plan_fft_forward(grid), planner.plan_fft_inverse(grid));
    let mut samples = random_signs(reception, (seed, channel), grid);
    let mut white = forward.make_output_vec();
    // Buffers have the plan's own lengths, the only thing the transforms can object to.
    let done = forward.process(&mut samples, &mut white);
    debug_assert!(done.is_ok());
    let (step_hz, centres) = (sample_rate_hz / grid as f64, centres_hz(bands));
    let magnitude: Vec<f64> = (0..white.len())
        .map(|k| {
            let hz = k as f64 * step_hz;
            between_hz(&centres, hz).of(&ln).exp() * fade(bands, &silent, hz) * outer_fade(bands, hz)
        })
        .collect();

    for b in (0..bands.len()).filter(|b| !silent[*b]) {
        let (mut filtered, mut power) = (vec![Complex64::ZERO; white.len()], 0.0);
        let (first, last) = reach(bands, b, step_hz, white.len());
        for k in first..last {
            let gain = magnitude[k] * share(bands, b, k as f64 * step_hz);
            // Bins between 0 and half the sample rate stand for two frequencies.
            power += gain * gain * if k == 0 || 2 * k == grid { 1.0 } else { 2.0 };
            filtered[k] = white[k] * gain / grid as f64;
        }
        filtered[0].im = 0.0;
        if let Some(last) = filtered.last_mut() {
            last.im = 0.0;
        }
        let done = inverse.process(&mut filtered, &mut samples);
        debug_assert!(done.is_ok());
        level(&mut samples, LEVELLED / (bands[b].high_hz - bands[b].low_hz) * sample_rate_hz);
        let envelope = envelope(&curves[b], axis);
        let mut realised = 0.0;
        for (s, e) in samples.iter_mut().zip(&envelope) {
            *s *= e;
            realised += *s * *s;
        }
        // The envelope's squares sum to 1, so the expected energy is the mean power of the filtered noise.
        let scale = if realised > 0.0 { (power / grid as f64 / realised).sqrt() } else { 0.0 };
        layers.push(Layer { band: b, samples: samples[..length].iter().map(|s| scale * s).collect() });
    }
    layers
}

/// Gives noise the same mean power everywhere, over `window` samples: filtered noise swells and fades, and a decay curve
/// would carry that.
fn level(samples: &mut [f64], window: f64) {
    let mut power: Vec<f64> = samples.iter().map(|s| s * s).collect();
    let half = ((0.5 * window).round().max(1.0) as usize).min((power.len() - 1) / 2);
    // Two running means in a row, a triangle; the noise is periodic.
    for _ in 0..2 {
        let (end, begin) = (&power[power.len() - half..], &power[..half]);
        let mut sum = 0.0;
        let sums: Vec<f64> = std::iter::once(0.0)
            .chain(end.iter().chain(&power).chain(begin).map(|p| {
                sum += p;
                sum
            }))
            .collect();
        power = sums.iter().zip(&sums[2 * half + 1..]).map(|(from, to)| (to - from) / (2 * half + 1) as f64).collect();
    }
    let mean = power.iter().sum::<f64>() / power.len() as f64;
    for (s, p) in samples.iter_mut().zip(&power) {
        *s *= (mean / p.max(1e-3 * mean)).sqrt();
    }
}

/// Random signs from the seed and the names of source and probe.
fn random_signs(reception: &Reception, (seed, channel): (u64, usize), length: usize) -> Vec<f64> {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    hash.update((reception.source.len() as u64).to_le_bytes());
    hash.update(reception.source.as_bytes());
    hash.update(reception.probe.as_bytes());
    if channel > 0 {
        hash.update((channel as u64).to_le_bytes());
    }
    let mut random = rand_pcg::Pcg64::from_seed(hash.finalize().into());
    let mut signs = Vec::with_capacity(length + 64);
    while signs.len() < length {
        let bits = random.next_u64();
        signs.extend((0..64).map(|i| if bits >> i & 1 == 1 { 1.0 } else { -1.0 }));
    }
    signs.truncate(length);
    signs
}

/// Square root of the share of the band's energy in each sample, from the powers of groups of bins (see [`grouped`]) interpolated linearly
/// between their middles. Before the middle of the first group, and after that of the last, the power is held; nothing precedes
/// the first bin's start or, if an early path arrives within that bin, that path.
fn envelope(curve: &EnergyCurve, axis: TimeAxis) -> Vec<f64> {
    let TimeAxis { sample_rate_hz, length, shift_s } = axis;
    let mut envelope = vec![0.0; length];
    let (Some(first), Some(last)) =
        (curve.bins.iter().position(|e| *e > 0.0), curve.bins.iter().rposition(|e| *e > 0.0))
    else {
        return envelope;
    };
    let onset_s = curve.first_arrival_s().unwrap_or(0.0).max(first as f64 * curve.bin_s);
    let begin = ((onset_s + shift_s) * sample_rate_hz).ceil().max(0.0) as usize;
    let end = ((((last + 1) as f64 * curve.bin_s + shift_s) * sample_rate_hz).ceil().max(0.0) as usize).min(length);
    let groups = grouped(&curve.bins[first..=last]);
    let (mut sum, mut next) = (0.0, 0);
    for (n, e) in envelope.iter_mut().enumerate().take(end).skip(begin) {
        let position = (n as f64 / sample_rate_hz - shift_s) / curve.bin_s - first as f64;
        while next < groups.len() && groups[next].0 <= position {
            next += 1;
        }
        let (after, before) = (groups[next.min(groups.len() - 1)], groups[next.saturating_sub(1)]);
        let share = if after.0 > before.0 { (position - before.0) / (after.0 - before.0) } else { 0.0 };
        let power = before.1 + share * (after.1 - before.1);
        *e = power.sqrt();
        sum += power;
    }
    let scale = if sum > 0.0 { 1.0 / sum.sqrt() } else { 0.0 };
    for e in &mut envelope {
        *e *= scale;
    }
    envelope
}

/// Middle (in bins) and mean energy a bin of groups of bins that grow with the time since the first by [`GROWTH`].
fn grouped(bins: &[f64]) -> Vec<(f64, f64)> {
    let mut groups = Vec::new();
    let mut from = 0;
    while from < bins.len() {
        let to = (from + 1 + (GROWTH * from as f64) as usize).min(bins.len());
        groups.push((0.5 * (from + to) as f64, bins[from..to].iter().sum::<f64>() / (to - from) as f64));
        from = to;
    }
    groups
}

/// Amplitude share of band `b` at `hz`; the squares of the shares of all bands sum to 1, as bands add their powers.
fn share(bands: &[Band], b: usize, hz: f64) -> f64 {
    let rise = |below: &Band, above: &Band| {
        let (edge, half) = edge(below, above);
        let u = ((hz / edge).ln() / half).clamp(-1.0, 1.0);
        0.5 + 0.5 * (std::f64::consts::FRAC_PI_2 * u).sin()
    };
    let low = if b > 0 { rise(&bands[b - 1], &bands[b]) } else { 1.0 };
    let high = if b + 1 < bands.len() { 1.0 - rise(&bands[b], &bands[b + 1]) } else { 1.0 };
    (low * high).sqrt()
}

/// Edge between two bands in Hz and the half width of their cross-fade in ln f.
fn edge(below: &Band, above: &Band) -> (f64, f64) {
    let width = (below.high_hz / below.low_hz).ln().min((above.high_hz / above.low_hz).ln());
    ((below.high_hz * above.low_hz).sqrt(), CROSSFADE_SHARE * width)
}

/// The bins in which band `b` has a share.
fn reach(bands: &[Band], b: usize, step_hz: f64, bins: usize) -> (usize, usize) {
    let limit = |below: usize, sign: f64| {
        let (edge, half) = edge(&bands[below], &bands[below + 1]);
        edge * (sign * half).exp() / step_hz
    };
    let first = if b > 0 { limit(b - 1, -1.0).floor() as usize } else { 0 };
    let last = if b + 1 < bands.len() { limit(b, 1.0).ceil() as usize + 1 } else { bins };
    (first.min(bins), last.min(bins))
}

/// Fades the noise out beyond the bands: held for an octave below the lowest edge, gone two octaves below; held for half an
/// octave above the highest edge, gone an octave above.
fn outer_fade(bands: &[Band], hz: f64) -> f64 {
    let rise = |u: f64| 0.5 - 0.5 * (std::f64::consts::PI * u.clamp(0.0, 1.0)).cos();
    let low = bands.first().map_or(1.0, |b| rise((hz / b.low_hz).log2() + 2.0));
    let high = bands.last().map_or(1.0, |b| rise(2.0 * (1.0 - (hz / b.high_hz).log2())));
    low * high
}

/// The smallest even product of 2, 3 and 5 that is not below `least`: a fast transform length.
pub(super) fn smooth_length(least: usize) -> usize {
    let mut n = least.max(2).next_multiple_of(2);
    loop {
        let mut rest = n;
        for p in [2, 3, 5] {
            while usize::is_multiple_of(rest, p) {
                rest /= p;
            }
        }
        if rest == 1 {
            return n;
        }
        n += 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_powers_of_the_bands_add_up_to_the_whole() {
        let bands: Vec<Band> = (0..8)
            .map(|i| {
                let c = 1000.0 * 2f64.powi(i - 4);
                Band { nominal_hz: c, low_hz: c / 2f64.sqrt(), high_hz: c * 2f64.sqrt() }
            })
            .collect();
        for i in 1..2400 {
            let hz = f64::from(i) * 10.0;
            let sum: f64 = (0..8).map(|b| share(&bands, b, hz).powi(2)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{hz}: {sum}");
        }
    }

    #[test]
    fn transform_lengths_are_smooth_and_not_below_what_is_asked() {
        assert_eq!([1, 2, 7, 31, 72_000, 72_001].map(smooth_length), [2, 2, 8, 32, 72_000, 72_900]);
    }
}
