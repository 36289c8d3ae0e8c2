//! Smooth functions of the wave number between the ends of a band: Legendre series.

use num_complex::Complex64;

use super::slit::gauss_nodes;

/// A Legendre series on an interval.
pub struct Legendre {
    middle: f64,
    half: f64,
    coefficients: Vec<Complex64>,
}

impl Legendre {
    /// Through the values of `f` at `count` Gauss nodes of the interval, asked for in their order.
    pub fn through([low, high]: [f64; 2], count: usize, mut f: impl FnMut(f64) -> Complex64) -> Self {
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let mut coefficients = vec![Complex64::ZERO; count];
        if half == 0.0 {
            coefficients.truncate(1);
        }
        for (k, weight) in gauss_nodes(low, high, coefficients.len()) {
            let value = f(k) * weight;
            let x = if half > 0.0 { (k - middle) / half } else { 0.0 };
            for (n, (c, p)) in coefficients.iter_mut().zip(polynomials(x)).enumerate() {
                *c += value * (p * (2 * n + 1) as f64);
            }
        }
        Self { middle, half, coefficients }
    }

    /// Its value at `k`.
    pub fn at(&self, k: f64) -> Complex64 {
        let x = if self.half > 0.0 { (k - self.middle) / self.half } else { 0.0 };
        self.coefficients.iter().zip(polynomials(x)).map(|(c, p)| c * p).sum()
    }
}

/// P_0(x), P_1(x), ...
pub(crate) fn polynomials(x: f64) -> impl Iterator<Item = f64> {
    let mut state = (1.0, x, 1.0);
    std::iter::from_fn(move || {
        let (p, next, n) = state;
        state = (next, ((2.0 * n + 1.0) * x * next - n * p) / (n + 1.0), n + 1.0);
        Some(p)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_is_interpolated_and_a_tone_keeps_its_value() {
        let wave = |k: f64| Complex64::from_polar(1.0, 3.0 * k);
        // Half phase 3: J_14(3) is below 1e-8.
        let series = Legendre::through([1.0, 3.0], 14, wave);
        for k in [1.0, 1.7, 2.99] {
            assert!((series.at(k) - wave(k)).norm() < 1e-7, "{k}");
        }
        assert!((Legendre::through([2.0, 2.0], 1, wave).at(2.0) - wave(2.0)).norm() < 1e-12);
    }
}
