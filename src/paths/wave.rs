//! Paths as pressures: what the deterministic paths of one source and probe give when they interfere.

use num_complex::Complex64;

use super::smooth::{NODES, Nodes, Smooth, turn};
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::series::Legendre;
use crate::wbsdf::slit::gauss_nodes;

/// Most frequencies a band. More are needed only where ways differ by hundreds of wavelengths, whose interference the mean
/// over a band leaves little of.
const MOST_FREQUENCIES: usize = 4096;
/// Frequencies a band that resolve the interference about one edge or opening.
pub(super) const FEW: usize = 8;
/// Those of the coherent second opinion, which takes every wave at every frequency.
const MANY: usize = 32;
/// Waves below this share of the strongest one are left out: together with it 0.0002 dB.
const FEEBLE: f64 = 1e-5;
/// Radians of phase over a band, between two ways, from which on their interference is forgotten: its mean is below
/// 2/FORGOTTEN. Tones forget nothing.
const FORGOTTEN: f64 = 400.0;
/// Radians of phase over a band by which a wave may turn that is still smooth.
const SMOOTH: f64 = 0.5;
/// Radians of phase over a band for which one Gauss node more is needed.
const PER_RADIAN: f64 = 0.7;

/// The sound of a path as a pressure.
pub(super) struct Wave<'a> {
    /// Length of its way in m.
    pub(super) length_m: f64,
    /// By how much in m the ways differ that it is made of.
    pub(super) wander_m: f64,
    /// Relative to the free field's modulus over 1 m.
    pub(super) sound: Sound<'a>,
}

/// Pressure in a band (by its index: materials and air) at a wave number in 1/m.
type Pressure<'a> = Box<dyn Fn(usize, f64) -> Complex64 + Send + Sync + 'a>;

impl<'a> Wave<'a> {
    /// The pressure in a band at a wave number in 1/m, of waves that are told at any.
    fn at(&self, band: usize, k: f64) -> Complex64 {
        match &self.sound {
            Sound::At(pressure) => pressure(band, k),
            Sound::Smooth(_) => Complex64::ZERO,
        }
    }

    /// This wave in the `shares` (one a band), and another one in what is left of them.
    pub(super) fn mixed(self, other: Self, shares: Vec<f64>) -> Self {
        if shares.iter().all(|share| *share == 1.0) {
            return self;
        }
        let length_m = self.length_m.min(other.length_m);
        let longest_m = (self.length_m + self.wander_m).max(other.length_m + other.wander_m);
        let pressure = move |band: usize, k: f64| match shares[band] {
            1.0 => self.at(band, k),
            share => share * self.at(band, k) + (1.0 - share) * other.at(band, k),
        };
        Self { length_m, wander_m: longest_m - length_m, sound: Sound::at(pressure) }
    }
}

/// How a wave depends on frequency.
pub(super) enum Sound<'a> {
    /// A pressure with the phase of the whole way.
    At(Pressure<'a>),
    /// Amplitudes without the phase of the way's length, one set a band.
    Smooth(Vec<Smooth>),
}

impl<'a> Sound<'a> {
    pub(super) fn at(pressure: impl Fn(usize, f64) -> Complex64 + Send + Sync + 'a) -> Self {
        Self::At(Box::new(pressure))
    }
}

/// How the pressures of a source's paths are added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Adding {
    /// Products of two waves have closed means over the band.
    Means,
    /// Every wave at every one of many frequencies.
    Frequencies,
}

/// A wave in one band.
struct Heard<'w, 'a> {
    wave: &'w Wave<'a>,
    smooth: Option<Smooth>,
    strength: f64,
}

/// Band means of |sum of all waves|^2 times `scale(k)`, one a band.
///
/// Each wave without the phase of its length is smooth: it is taken at a few Gauss nodes. Where there are few waves the mean of
/// every product of two is closed; else each is interpolated to as many frequencies as the differences of the ways ask for.
/// Between ways that differ by so much that the mean over the band leaves less than 1/200 of their interference, none is
/// reckoned.
pub(super) fn together(
    waves: &mut [Wave<'_>],
    spectra: &[Spectrum],
    nodes: &[Nodes],
    adding: Adding,
    scale: impl Fn(f64) -> f64,
) -> Vec<f64> {
    waves.sort_by(|a, b| a.length_m.total_cmp(&b.length_m));
    let mean = |(band, (spectrum, nodes)): (usize, (&Spectrum, &Nodes))| -> f64 {
        let dk = spectrum.high_k() - spectrum.low_k();
        let heard = |wave| Heard::new(wave, band, spectrum, nodes, adding);
        let mut heard: Vec<Heard<'_, '_>> = waves.iter().map(heard).collect();
        let feeble = FEEBLE * heard.iter().fold(0.0_f64, |a, h| a.max(h.strength));
        heard.retain(|h| h.strength > feeble);
        let scales = nodes.scale(&scale);
        let apart_m = FORGOTTEN / dk;
        let clusters = heard.chunk_by(|a, b| b.wave.length_m - a.wave.length_m - a.wave.wander_m < apart_m);
        clusters
            .map(|cluster| match closed(cluster, spectrum) {
                true if adding == Adding::Means => products(cluster, nodes, &scales),
                _ => coherent(cluster, band, spectrum, nodes, adding, &scale),
            })
            .sum()
    };
    spectra.iter().zip(nodes).enumerate().map(mean).collect()
}

/// Band mean of what two waves bring together beside the sum of their energies.
pub(super) fn interference(a: &Wave<'_>, b: &Wave<'_>, band: usize, spectrum: &Spectrum) -> f64 {
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let apart_m = (a.length_m - b.length_m).abs() + a.wander_m + b.wander_m;
    if (high - low) * (a.length_m - b.length_m).abs() > FORGOTTEN {
        return 0.0;
    }
    let nodes = gauss_nodes(low, high, frequencies(FEW, high - low, apart_m));
    nodes.map(|(k, weight)| 2.0 * weight * (a.at(band, k) * b.at(band, k).conj()).re).sum()
}

impl<'w, 'a> Heard<'w, 'a> {
    fn new(wave: &'w Wave<'a>, band: usize, spectrum: &Spectrum, nodes: &Nodes, adding: Adding) -> Self {
        let dk = spectrum.high_k() - spectrum.low_k();
        let smooth = match &wave.sound {
            Sound::Smooth(bands) => Some(bands[band]),
            Sound::At(pressure) if adding == Adding::Means && dk * wave.wander_m < SMOOTH => {
                Some(nodes.map(|k| pressure(band, k) * turn(-k * wave.length_m)))
            }
            Sound::At(_) => None,
        };
        // What an edge sends is strongest at the longest waves.
        let strength = match (&smooth, &wave.sound) {
            (Some(values), _) => values[0].norm(),
            (None, Sound::At(pressure)) => pressure(band, spectrum.low_k()).norm(),
            (None, Sound::Smooth(_)) => 0.0,
        };
        Self { wave, smooth, strength }
    }
}

/// Whether the closed means of all products cost less than the frequencies that the ways ask for.
fn closed(waves: &[Heard<'_, '_>], spectrum: &Spectrum) -> bool {
    let frequencies = frequencies(FEW, spectrum.high_k() - spectrum.low_k(), span_m(waves));
    waves.len() <= 2 * frequencies && waves.iter().all(|h| h.smooth.is_some())
}

/// Difference in m between the shortest and the longest way.
fn span_m(waves: &[Heard<'_, '_>]) -> f64 {
    let shortest = waves.iter().map(|h| h.wave.length_m).fold(f64::INFINITY, f64::min);
    waves.iter().map(|h| h.wave.length_m + h.wave.wander_m - shortest).fold(0.0, f64::max)
}

/// By the means of the products of two waves each.
fn products(waves: &[Heard<'_, '_>], nodes: &Nodes, scale: &[f64; NODES]) -> f64 {
    let known = || waves.iter().filter_map(|h| Some((h.wave.length_m, h.smooth.as_ref()?)));
    let mut sum = 0.0;
    for (i, (length_m, values)) in known().enumerate() {
        sum += nodes.power(values, scale);
        for (other_m, others) in known().take(i) {
            sum += 2.0 * nodes.product(values, others, length_m - other_m, scale);
        }
    }
    sum
}

fn coherent(
    waves: &[Heard<'_, '_>],
    band: usize,
    spectrum: &Spectrum,
    smooth: &Nodes,
    adding: Adding,
    scale: &impl Fn(f64) -> f64,
) -> f64 {
    let shortest = waves.iter().map(|h| h.wave.length_m).fold(f64::INFINITY, f64::min);
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let fewest = if adding == Adding::Frequencies { MANY } else { FEW };
    let nodes: Vec<(f64, f64)> = gauss_nodes(low, high, frequencies(fewest, high - low, span_m(waves))).collect();
    let mut sum = vec![Complex64::ZERO; nodes.len()];
    for Heard { wave, smooth: values, .. } in waves {
        let turned = |k: f64, value: Complex64| value * turn(k * (wave.length_m - shortest));
        let series = match (values, &wave.sound) {
            (Some(values), _) => {
                let mut values = values.iter().copied();
                Legendre::through([low, high], smooth.k.len(), |_| values.next().unwrap_or_default())
            }
            (None, Sound::Smooth(_)) => continue,
            (None, Sound::At(pressure)) => {
                let envelope = |k: f64| pressure(band, k) * turn(-k * wave.length_m);
                let count = frequencies(fewest, high - low, wave.wander_m);
                if adding == Adding::Frequencies || count >= nodes.len() {
                    for (sum, (k, _)) in sum.iter_mut().zip(&nodes) {
                        *sum += pressure(band, *k) * turn(-k * shortest);
                    }
                    continue;
                }
                Legendre::through([low, high], count, envelope)
            }
        };
        for (sum, (k, _)) in sum.iter_mut().zip(&nodes) {
            *sum += turned(*k, series.at(*k));
        }
    }
    sum.iter().zip(&nodes).map(|(p, (k, weight))| weight * p.norm_sqr() * scale(*k)).sum()
}

/// Gauss nodes for |p|^2 over a band of width `dk` in 1/m whose ways differ by `apart_m`; one for a tone.
pub(super) fn frequencies(fewest: usize, dk: f64, apart_m: f64) -> usize {
    if dk <= 0.0 {
        return 1;
    }
    // As a float: anything longer is cut off.
    (8.0 + PER_RADIAN * dk * apart_m).ceil().clamp(fewest as f64, MOST_FREQUENCIES as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_paths_interfere_by_the_closed_band_mean() {
        let spectrum = Spectrum { low_hz: 707.1, high_hz: 1414.2, speed_m_s: 343.0 };
        for apart in [0.0, 0.1, 3.0, 25.0] {
            let wave = |length_m: f64| Wave {
                length_m,
                wander_m: 0.0,
                sound: Sound::at(move |_, k| Complex64::from_polar(1.0 / length_m, k * length_m)),
            };
            let (a, b) = (5.0, 5.0 + apart);
            let sum =
                |adding| together(&mut [wave(a), wave(b)], &[spectrum], &Nodes::of(&[spectrum]), adding, |_| 1.0)[0];
            // Mean of cos(k d): sin(dk d/2)/(dk d/2) cos(k_c d).
            let half = 0.5 * (spectrum.high_k() - spectrum.low_k()) * apart;
            let sinc = if half > 0.0 { half.sin() / half } else { 1.0 };
            let cos = sinc * (0.5 * (spectrum.high_k() + spectrum.low_k()) * apart).cos();
            let expected = 1.0 / (a * a) + 1.0 / (b * b) + 2.0 * cos / (a * b);
            for got in [sum(Adding::Means), sum(Adding::Frequencies)] {
                assert!((got - expected).abs() < 1e-9, "{apart}: {got} {expected}");
            }
        }
    }
}
