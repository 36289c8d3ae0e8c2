//! Noise with the echogram's energy in every band and bin.
//!
//! Pulses of random signs, as many a second as reflections arrive, have the smooth spectrum through the late band energies and are made
//! steady in narrow bands (`steady`). The sequence is divided into bands whose powers add up to its own, and each is given the envelope
//! of its echogram. Filtering comes before the envelope, so nothing rings before the first arrival.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use realfft::num_complex::Complex64;
use sha2::{Digest, Sha256};

use crate::probe::Reception;
use crate::scene::Band;

use super::energy::EnergyCurve;
use super::envelope::BandFilter;
use super::spectrum::{between_bins, centres_hz, fade, ln_magnitude};
use super::steady::{narrow, steady};
use super::transform::Transform;

/// Half width of the cross-fade between two bands, as a share of the narrower one's width in octaves.
///
/// Narrow, so that a band keeps its own decay up to its edges; filters come before envelopes and ring unheard.
const CROSSFADE_SHARE: f64 = 1.0 / 48.0;

/// Width of the groups of bins between which the envelope is interpolated, as a share of the time since the first bin: a decay is
/// smooth over them, and late bins in which few rays arrived do not stand out.
const GROWTH: f64 = 1.0 / 24.0;

/// Random sequences of a response: one of signs a channel, and this one of places.
const PLACES: usize = 16;

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

/// The noise of one band.
pub(super) struct Layer {
    /// Index of the band.
    pub(super) band: usize,
    pub(super) samples: Vec<f64>,
}

/// What makes the noise of a reception.
pub(super) struct Noise<'a> {
    reception: &'a Reception,
    axis: TimeAxis,
    /// Amplitude of each bin: the smooth spectrum through the late energies.
    amplitudes: Vec<f64>,
    parts: Vec<Part>,
    /// Filters of the narrow bands.
    narrow: Vec<BandFilter>,
    transform: &'a Transform,
}

/// A band with late sound.
struct Part {
    band: usize,
    /// Bins of the band and its amplitude share in each.
    first: usize,
    shares: Vec<f64>,
    /// Square root of the share of the energy in each sample.
    envelope: Vec<f64>,
}

impl<'a> Noise<'a> {
    /// `curves`: the energies of the reception, one a band of `bands`.
    pub(super) fn new(
        reception: &'a Reception,
        curves: &[EnergyCurve],
        bands: &[Band],
        axis: TimeAxis,
        transform: &'a Transform,
    ) -> Self {
        let TimeAxis { sample_rate_hz, length, shift_s } = axis;
        let end_s = length as f64 / sample_rate_hz - shift_s;
        let energy: Vec<f64> =
            curves.iter().map(|c| (c.remaining_in_bins(0.0) - c.remaining_in_bins(end_s)).max(0.0)).collect();
        let silent: Vec<bool> = energy.iter().map(|e| *e <= 0.0).collect();
        let ln = ln_magnitude(bands, &energy);
        let (step_hz, bins) = (sample_rate_hz / transform.length() as f64, transform.bins());
        let mut amplitudes: Vec<f64> =
            between_bins(&centres_hz(bands), step_hz, bins).iter().map(|place| place.of(&ln).exp()).collect();
        for (k, amplitude) in amplitudes.iter_mut().enumerate() {
            *amplitude *= outer_fade(bands, k as f64 * step_hz);
            if silent.contains(&true) {
                *amplitude *= fade(bands, &silent, k as f64 * step_hz);
            }
        }
        let part = |band: usize| {
            let (first, last) = reach(bands, band, step_hz, bins);
            let share = share(bands, band);
            let shares = (first..last).map(|k| share(k as f64 * step_hz)).collect();
            Part { band, first, shares, envelope: envelope(&curves[band], axis) }
        };
        let parts = (0..bands.len()).filter(|b| !silent[*b]).map(part).collect();
        let narrow = narrow(bands, sample_rate_hz, transform.length());
        Self { reception, axis, amplitudes, parts, narrow, transform }
    }

    /// Amplitudes of the bins before any change.
    pub(super) fn amplitudes(&self) -> Vec<f64> {
        self.amplitudes.clone()
    }

    /// Spectrum of the pulses of a channel, of power 1 in the mean.
    pub(super) fn pulses(&self, seed: u64, channel: usize) -> Vec<Complex64> {
        let generator = |stream: usize| generator(self.reception, seed, stream);
        let mut samples = random_signs(generator(channel), self.transform.length());
        thin(&mut samples, |n| density(self.reception, self.axis, n), generator(PLACES));
        let scale = 1.0 / (samples.len() as f64).sqrt();
        samples.iter_mut().for_each(|s| *s *= scale);
        self.transform.spectrum(samples)
    }

    /// Makes the noise of every band of `pulses` with the `amplitudes`; where there is some, of the bands that have `changed` (one a bin).
    pub(super) fn make(&self, layers: &mut Vec<Layer>, pulses: &[Complex64], amplitudes: &[f64], changed: &[bool]) {
        let grid = self.transform.length();
        let mut spectrum: Vec<Complex64> = pulses.iter().zip(amplitudes).map(|(h, a)| h * a).collect();
        steady(&mut spectrum, amplitudes, &self.narrow);
        let layer = |part: &Part| {
            let (mut filtered, mut power) = (vec![Complex64::ZERO; self.transform.bins()], 0.0);
            for (n, share) in part.shares.iter().enumerate() {
                let k = part.first + n;
                // Bins between 0 and half the sample rate stand for two frequencies.
                power += (share * amplitudes[k]).powi(2) * if k == 0 || 2 * k == grid { 1.0 } else { 2.0 };
                filtered[k] = spectrum[k] * share;
            }
            let mut samples = self.transform.samples(&mut filtered);
            samples.truncate(self.axis.length);
            let mut realised = 0.0;
            for (s, e) in samples.iter_mut().zip(&part.envelope) {
                *s *= e;
                realised += *s * *s;
            }
            // The envelope's squares sum to 1, so the expected energy is the mean power of the filtered noise.
            let scale = if realised > 0.0 { (power / grid as f64 / realised).sqrt() } else { 0.0 };
            samples.iter_mut().for_each(|s| *s *= scale);
            Layer { band: part.band, samples }
        };
        if layers.is_empty() {
            *layers = self.parts.iter().map(layer).collect();
            return;
        }
        for (old, part) in layers.iter_mut().zip(&self.parts) {
            if changed[part.first..part.first + part.shares.len()].contains(&true) {
                *old = layer(part);
            }
        }
    }
}

/// A generator for one random sequence (`stream`) of a response, from the seed and the names of source and probe.
fn generator(reception: &Reception, seed: u64, stream: usize) -> Pcg64 {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    hash.update((reception.source.len() as u64).to_le_bytes());
    hash.update(reception.source.as_bytes());
    hash.update(reception.probe.as_bytes());
    if stream > 0 {
        hash.update((stream as u64).to_le_bytes());
    }
    Pcg64::from_seed(hash.finalize().into())
}

fn random_signs(mut random: Pcg64, length: usize) -> Vec<f64> {
    let mut signs = Vec::with_capacity(length + 64);
    while signs.len() < length {
        let bits = random.next_u64();
        signs.extend((0..64).map(|i| if bits >> i & 1 == 1 { 1.0 } else { -1.0 }));
    }
    signs.truncate(length);
    signs
}

/// Reflections a sample at sample `n`: at least one a bin of the echogram, at most 1.
pub(super) fn density(reception: &Reception, axis: TimeAxis, n: f64) -> f64 {
    let TimeAxis { sample_rate_hz, shift_s, .. } = axis;
    let Some((growth, bin_s)) = reception.echogram.as_ref().and_then(|e| Some((e.reflections_per_s3?, e.bin_s))) else {
        return 1.0;
    };
    let time_s = n / sample_rate_hz - shift_s;
    ((growth * time_s * time_s).max(1.0 / bin_s) / sample_rate_hz).min(1.0)
}

/// Thins samples of random signs to pulses of a `density` a sample (velvet noise; Valimaki and others 2013, with a growing density):
/// the time is divided into cells that hold one pulse each, at a random place, with the power of all of the cell's samples.
fn thin(samples: &mut [f64], density: impl Fn(f64) -> f64, mut random: Pcg64) {
    let (mut from, mut reflections) = (0, 0.0);
    while from < samples.len() {
        let mut to = from;
        while to < samples.len() && (to == from || reflections < 1.0) {
            reflections += density(to as f64);
            to += 1;
        }
        reflections -= 1.0;
        if to - from > 1 {
            let kept = from + (random.next_u64() % (to - from) as u64) as usize;
            let pulse = samples[kept] * ((to - from) as f64).sqrt();
            samples[from..to].fill(0.0);
            samples[kept] = pulse;
        }
        from = to;
    }
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
    // Sample of a place in bins since the first, and the other way round.
    let sample = |place: f64| ((place + first as f64) * curve.bin_s + shift_s) * sample_rate_hz;
    let place = |n: usize| (n as f64 / sample_rate_hz - shift_s) / curve.bin_s - first as f64;
    let bins_a_sample = 1.0 / (sample_rate_hz * curve.bin_s);
    let limit = |group: Option<&(f64, f64)>| {
        group.map_or(end, |group| (sample(group.0).ceil().max(0.0) as usize).clamp(begin.min(end), end))
    };
    let (mut from, mut sum) = (begin.min(end), 0.0);
    for next in 0..=groups.len() {
        let to = limit(groups.get(next));
        let (before, after) = (groups[next.saturating_sub(1)], groups[next.min(groups.len() - 1)]);
        let slope = if after.0 > before.0 { (after.1 - before.1) / (after.0 - before.0) } else { 0.0 };
        let power = before.1 + slope * (place(from) - before.0);
        for (n, e) in envelope[from..to].iter_mut().enumerate() {
            let power = (power + slope * bins_a_sample * n as f64).max(0.0);
            *e = power.sqrt();
            sum += power;
        }
        from = to;
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

/// Amplitude share of band `b` over frequency in Hz; the squares of the shares of all bands sum to 1, as bands add their powers.
fn share(bands: &[Band], b: usize) -> impl Fn(f64) -> f64 {
    let rise = |(edge, half): (f64, f64), hz: f64| {
        // The logarithm lies between 1 - 1/x and x - 1.
        match hz / edge {
            x if x - 1.0 <= -half => 0.0,
            x if 1.0 - 1.0 / x >= half => 1.0,
            x => 0.5 + 0.5 * (std::f64::consts::FRAC_PI_2 * (x.ln() / half).clamp(-1.0, 1.0)).sin(),
        }
    };
    let low = (b > 0).then(|| edge(&bands[b - 1], &bands[b]));
    let high = (b + 1 < bands.len()).then(|| edge(&bands[b], &bands[b + 1]));
    move |hz| (low.map_or(1.0, |edge| rise(edge, hz)) * high.map_or(1.0, |edge| 1.0 - rise(edge, hz))).sqrt()
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
    let held =
        |(first, last): (&Band, &Band)| (0.5 * first.low_hz..std::f64::consts::SQRT_2 * last.high_hz).contains(&hz);
    if bands.first().zip(bands.last()).is_some_and(held) {
        return 1.0;
    }
    let rise = |u: f64| 0.5 - 0.5 * (std::f64::consts::PI * u.clamp(0.0, 1.0)).cos();
    let low = bands.first().map_or(1.0, |b| rise((hz / b.low_hz).log2() + 2.0));
    let high = bands.last().map_or(1.0, |b| rise(2.0 * (1.0 - (hz / b.high_hz).log2())));
    low * high
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
            let sum: f64 = (0..8).map(|b| share(&bands, b)(hz).powi(2)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{hz}: {sum}");
        }
    }
}
