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

/// Panels of a band with Gauss nodes, as many in each as a function of the wave number asks for there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Panels(Vec<([f64; 2], usize)>);

impl Panels {
    /// `panels`: limits, one after the other, and number of nodes.
    pub(super) fn new(panels: Vec<([f64; 2], usize)>) -> Self {
        Self(panels)
    }

    /// `count` equal ones with a node in the middle of each: waves interfere over a band up to half as much again as `count` Gauss
    /// nodes resolve, where a thousandth of the mean is enough.
    pub(super) fn even([low, high]: [f64; 2], count: usize) -> Self {
        let limit = |i: usize| low + (high - low) * i as f64 / count as f64;
        Self((0..count).map(|i| ([limit(i), limit(i + 1)], 1)).collect())
    }

    /// Wave numbers and weights for the mean over the band.
    pub(super) fn nodes(&self) -> Vec<(f64, f64)> {
        let whole: f64 = self.0.iter().map(|([low, high], _)| high - low).sum();
        let share = |[low, high]: [f64; 2]| if whole > 0.0 { (high - low) / whole } else { 1.0 / self.0.len() as f64 };
        let panel = |&(limits, count): &([f64; 2], usize)| {
            gauss_nodes(limits[0], limits[1], count).map(move |(k, weight)| (k, weight * share(limits)))
        };
        self.0.iter().flat_map(panel).collect()
    }

    /// The function with these values at the nodes.
    pub(super) fn through(&self, values: &[Complex64]) -> impl Fn(f64) -> Complex64 + Send + Sync + use<> {
        let mut values = values.iter();
        let mut next = |_| values.next().copied().unwrap_or(Complex64::ZERO);
        let panel = |&(limits, count): &([f64; 2], usize)| (limits[1], Legendre::through(limits, count, &mut next));
        let series: Vec<(f64, Legendre)> = self.0.iter().map(panel).collect();
        move |k| {
            let panel = series.iter().find(|(high, _)| k <= *high).or(series.last());
            panel.map_or(Complex64::ZERO, |(_, series)| series.at(k))
        }
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
    fn panels_carry_a_wave_and_its_mean() {
        let panels = Panels::new(vec![([1.0, 1.5], 10), ([1.5, 3.0], 14)]);
        let wave = |k: f64| Complex64::from_polar(1.0, 3.0 * k);
        let nodes = panels.nodes();
        let through = panels.through(&nodes.iter().map(|(k, _)| wave(*k)).collect::<Vec<_>>());
        for k in [1.0, 1.5, 1.7, 3.0] {
            assert!((through(k) - wave(k)).norm() < 1e-7, "{k}");
        }
        let mean: Complex64 = nodes.iter().map(|(k, weight)| wave(*k) * *weight).sum();
        let exact = (wave(3.0) - wave(1.0)) / Complex64::new(0.0, 6.0);
        assert!((mean - exact).norm() < 1e-9, "{mean} {exact}");
        assert_eq!(Panels::new(vec![([2.0, 2.0], 1)]).nodes(), [(2.0, 1.0)]);
    }

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
