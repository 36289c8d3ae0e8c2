//! Band means of products of waves, each a smooth amplitude times the phase of its way.
//!
//! Without the phase of its length a wave changes slowly with the wave number: six Gauss nodes of a band tell all of it. The
//! mean of a product of two is then a product integration (Filon's): Legendre polynomials through the nodes, whose means with
//! exp(i k d) are spherical Bessel functions. It costs the same whatever the difference d of the ways.

use std::sync::LazyLock;

use num_complex::Complex64;

use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::series::polynomials;
use crate::wbsdf::slit::gauss_nodes;
use crate::wbsdf::wedge::Between;

/// Wave numbers a band. What the polynomial misses of an edge's wave over an octave is below 1e-5 of it.
pub(super) const NODES: usize = 6;
/// Radians of phase over half of a band up to which the rule itself is as good: 1e-11.
const FEW_RADIANS: f64 = 1.0;

/// Amplitudes at the nodes of a band; of a tone only the first counts.
pub(super) type Smooth = [Complex64; NODES];
/// Silence.
pub(super) const SILENT: Smooth = [Complex64::ZERO; NODES];

/// The wave numbers of a band.
#[derive(Debug, Clone)]
pub(super) struct Nodes {
    /// Wave numbers in 1/m: [`NODES`] of them, or one for a tone.
    pub(super) k: Vec<f64>,
    weights: Vec<f64>,
    /// Where they stand in the tables of all bands together.
    pub(super) between: Vec<Option<Between>>,
    middle: f64,
    half: f64,
}

/// (2n + 1) P_n at the nodes times their weights: a sum with values there gives their Legendre coefficients.
static COEFFICIENTS: LazyLock<[[f64; NODES]; NODES]> = LazyLock::new(|| {
    let mut table = [[0.0; NODES]; NODES];
    for (q, (x, weight)) in gauss_nodes(-1.0, 1.0, NODES).enumerate() {
        for (n, (row, p)) in table.iter_mut().zip(polynomials(x)).enumerate() {
            row[q] = (2 * n + 1) as f64 * p * weight;
        }
    }
    table
});

impl Nodes {
    /// One a band.
    pub(super) fn of(spectra: &[Spectrum]) -> Vec<Self> {
        let (Some(first), Some(last)) = (spectra.first(), spectra.last()) else { return Vec::new() };
        let all = Spectrum { high_hz: last.high_hz, ..*first };
        let of_band = |spectrum: &Spectrum| {
            let (low, high) = (spectrum.low_k(), spectrum.high_k());
            let count = if high > low { NODES } else { 1 };
            let (k, weights): (Vec<f64>, Vec<f64>) = gauss_nodes(low, high, count).unzip();
            let between = k.iter().map(|k| Between::new(&all, *k)).collect();
            Self { k, weights, between, middle: 0.5 * (low + high), half: 0.5 * (high - low) }
        };
        spectra.iter().map(of_band).collect()
    }

    /// `f` at the nodes.
    pub(super) fn map(&self, mut f: impl FnMut(f64) -> Complex64) -> Smooth {
        let mut values = SILENT;
        for (value, k) in values.iter_mut().zip(&self.k) {
            *value = f(*k);
        }
        values
    }

    /// The same for real values, as a weight of powers.
    pub(super) fn scale(&self, f: impl Fn(f64) -> f64) -> [f64; NODES] {
        self.map(|k| Complex64::from(f(k))).map(|value| value.re)
    }

    /// Mean of `scale` |a|^2.
    pub(super) fn power(&self, a: &Smooth, scale: &[f64; NODES]) -> f64 {
        self.weights.iter().zip(a).zip(scale).map(|((w, a), s)| w * s * a.norm_sqr()).sum()
    }

    /// Mean of `scale` Re[a b* exp(i k d)], d = `apart_m` by which the way of `a` is longer.
    pub(super) fn product(&self, a: &Smooth, b: &Smooth, apart_m: f64, scale: &[f64; NODES]) -> f64 {
        let w = self.half * apart_m;
        if w.abs() < FEW_RADIANS {
            let terms = self.k.iter().zip(&self.weights).zip(a.iter().zip(b)).zip(scale);
            return terms.map(|(((k, weight), (a, b)), s)| weight * s * (a * b.conj() * turn(k * apart_m)).re).sum();
        }
        let (sin, cos) = w.sin_cos();
        // The mean of P_n(x) exp(i w x) is i^n j_n(w).
        let mut bessel = [0.0; NODES];
        bessel[0] = sin / w;
        bessel[1] = (bessel[0] - cos) / w;
        for n in 1..NODES - 1 {
            bessel[n + 1] = (2 * n + 1) as f64 / w * bessel[n] - bessel[n - 1];
        }
        let signed = [bessel[0], bessel[1], -bessel[2], -bessel[3], bessel[4], bessel[5]];
        let mut mean = Complex64::ZERO;
        for q in 0..NODES {
            let c = |n: usize| signed[n] * COEFFICIENTS[n][q];
            let moment = Complex64::new(c(0) + c(2) + c(4), c(1) + c(3) + c(5));
            mean += a[q] * b[q].conj() * moment * scale[q];
        }
        (mean * turn(self.middle * apart_m)).re
    }
}

/// exp(i x).
pub(super) fn turn(x: f64) -> Complex64 {
    let (sin, cos) = x.sin_cos();
    Complex64::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_a_product_is_that_of_many_frequencies_whatever_the_ways() {
        let spectrum = Spectrum { low_hz: 177.0, high_hz: 354.0, speed_m_s: 343.0 };
        let nodes = &Nodes::of(&[spectrum])[0];
        // As an edge sends: falling like 1/sqrt(k), with a slowly turning phase.
        let a = |k: f64| Complex64::new(1.0, 0.3) / (1.0 + Complex64::new(0.2, -0.4) * k).sqrt();
        let b = |k: f64| Complex64::new(0.7, -0.1 * k).inv();
        let scale = nodes.scale(|k| 1.0 + 0.1 / k);
        for apart_m in [0.0, 0.3, -0.59, 0.65, -2.0, 7.0, 60.0, -1500.0] {
            let expected: f64 = gauss_nodes(spectrum.low_k(), spectrum.high_k(), 4000)
                .map(|(k, weight)| weight * (1.0 + 0.1 / k) * (a(k) * b(k).conj() * turn(k * apart_m)).re)
                .sum();
            let got = nodes.product(&nodes.map(a), &nodes.map(b), apart_m, &scale);
            // 2e-5: what the polynomial of the fifth degree misses.
            let size = (nodes.power(&nodes.map(a), &scale) * nodes.power(&nodes.map(b), &scale)).sqrt();
            assert!((got - expected).abs() < 2e-5 * size, "{apart_m}: {got} {expected}");
        }
    }
}
