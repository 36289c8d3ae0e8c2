//! Paths as pressures: what the deterministic paths of one source and probe give when they interfere.

use num_complex::Complex64;

use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::series::Legendre;
use crate::wbsdf::slit::gauss_nodes;

/// Most frequencies a band. More are needed only where ways differ by hundreds of wavelengths, whose interference the mean
/// over a band leaves little of.
const MOST_FREQUENCIES: usize = 4096;
/// Frequencies a band that resolve the interference about one edge or opening.
pub(super) const FEW: usize = 8;
/// Those of the coherent second opinion, which takes every wave at every frequency.
pub(super) const MANY: usize = 32;
/// Waves below this share of the strongest one are left out: together with it 0.0002 dB.
const FEEBLE: f64 = 1e-5;
/// Radians of phase over a band, between two ways, from which on their interference is forgotten: its mean is below
/// 2/FORGOTTEN. Tones forget nothing.
const FORGOTTEN: f64 = 400.0;
/// Radians of phase over a band for which one Gauss node more is needed.
const PER_RADIAN: f64 = 0.7;

/// The sound of a path as a pressure.
pub(super) struct Wave<'a> {
    /// Length of its way in m.
    pub(super) length_m: f64,
    /// By how much in m the ways differ that it is made of.
    pub(super) wander_m: f64,
    /// Pressure in a band (by its index: materials and air) at a wave number in 1/m, relative to the free field's modulus over
    /// 1 m; the phase is that of the whole way.
    pub(super) pressure: Box<dyn Fn(usize, f64) -> Complex64 + Send + Sync + 'a>,
}

/// Band means of |sum of all waves|^2 times `scale(k)`, one a band.
///
/// Each wave without the phase of its length is smooth: it is taken at a few Gauss nodes and interpolated to as many
/// frequencies as the differences of the ways ask for. Between ways that differ by so much that the mean over the band leaves
/// less than 1/200 of their interference, none is reckoned.
/// `fewest`: frequencies a band at least; from [`MANY`] on every wave is taken at every one of them.
pub(super) fn together(
    waves: &mut [Wave<'_>],
    spectra: &[Spectrum],
    fewest: usize,
    scale: impl Fn(f64) -> f64,
) -> Vec<f64> {
    waves.sort_by(|a, b| a.length_m.total_cmp(&b.length_m));
    let mean = |(band, spectrum): (usize, &Spectrum)| -> f64 {
        let apart_m = FORGOTTEN / (spectrum.high_k() - spectrum.low_k());
        // What an edge sends is strongest at the longest waves.
        let strengths: Vec<f64> = waves.iter().map(|w| (w.pressure)(band, spectrum.low_k()).norm()).collect();
        let feeble = FEEBLE * strengths.iter().fold(0.0_f64, |a, b| a.max(*b));
        let heard: Vec<&Wave<'_>> =
            waves.iter().zip(&strengths).filter(|(_, s)| **s > feeble).map(|(w, _)| w).collect();
        let clusters = heard.chunk_by(|a, b| b.length_m - a.length_m - a.wander_m < apart_m);
        clusters.map(|cluster| coherent(cluster, band, spectrum, fewest, &scale)).sum()
    };
    spectra.iter().enumerate().map(mean).collect()
}

fn coherent(waves: &[&Wave<'_>], band: usize, spectrum: &Spectrum, fewest: usize, scale: &impl Fn(f64) -> f64) -> f64 {
    let shortest = waves.iter().map(|w| w.length_m).fold(f64::INFINITY, f64::min);
    let longest = waves.iter().map(|w| w.length_m + w.wander_m).fold(shortest, f64::max);
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let nodes: Vec<(f64, f64)> = gauss_nodes(low, high, frequencies(fewest, high - low, longest - shortest)).collect();
    let mut sum = vec![Complex64::ZERO; nodes.len()];
    for wave in waves {
        let envelope = |k: f64| (wave.pressure)(band, k) * Complex64::from_polar(1.0, -k * wave.length_m);
        let turned = |k: f64, value: Complex64| value * Complex64::from_polar(1.0, k * (wave.length_m - shortest));
        let count = frequencies(fewest, high - low, wave.wander_m);
        if fewest >= MANY || count >= nodes.len() {
            for (sum, (k, _)) in sum.iter_mut().zip(&nodes) {
                *sum += turned(*k, envelope(*k));
            }
            continue;
        }
        let series = Legendre::through([low, high], count, envelope);
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
                pressure: Box::new(move |_, k| Complex64::from_polar(1.0 / length_m, k * length_m)),
            };
            let (a, b) = (5.0, 5.0 + apart);
            let got = together(&mut [wave(a), wave(b)], &[spectrum], FEW, |_| 1.0)[0];
            // Mean of cos(k d): sin(dk d/2)/(dk d/2) cos(k_c d).
            let half = 0.5 * (spectrum.high_k() - spectrum.low_k()) * apart;
            let sinc = if half > 0.0 { half.sin() / half } else { 1.0 };
            let cos = sinc * (0.5 * (spectrum.high_k() + spectrum.low_k()) * apart).cos();
            let expected = 1.0 / (a * a) + 1.0 / (b * b) + 2.0 * cos / (a * b);
            assert!((got - expected).abs() < 1e-9, "{apart}: {got} {expected}");
        }
    }
}
