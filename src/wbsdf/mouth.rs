//! The mouth of a gap between right-angled jambs: equations of the velocity in it, by functions that vary as the velocity does at
//! corners of 270 degrees.
//!
//! On the mouth |xi| < 1, xi = x/b, the velocity is (1 - xi^2)^(-1/3) times a polynomial, a sum of few C_n, Gegenbauer's of order
//! lambda = 1/6. Scaled, their Fourier transforms are
//!
//! ```text
//! g_n(tau) = tau^-lambda J_(n+lambda)(tau) ,
//! ```
//!
//! and with K = k b, tau_m = m pi/2 the operator S of the space outside and Z of the modes of the gap (thick.rs) are, over b^2/pi,
//!
//! ```text
//! S_nm = int_0^inf i/sqrt(K^2 - tau^2) g_n g_m dtau ,   Z_nm = pi sum_j (e_j/2) Z_j/b g_n(tau_j) g_m(tau_j) ,
//! ```
//!
//! between functions of the same parity. For large tau both weights are 1/tau and pi/tau_j; the integral of that is closed (Weber and
//! Schafheitlin, DLMF 10.22.57), its sum a table for all mouths, and what is left falls fast. At the zeros of C_N N of them are the
//! values at N places.

use std::f64::consts::{FRAC_PI_2, PI};
use std::num::NonZeroUsize;
use std::sync::Arc;

use gauss_quad::{FiniteAboveNegOneF64, GaussJacobi};
use nalgebra::{DMatrix, DMatrixView};
use num_complex::Complex64;

use super::factors::Split;
use super::kept::Kept;
use super::slit::gauss_nodes;

const LAMBDA: f64 = 1.0 / 6.0;
/// Values of tau that are followed side by side.
const LANES: usize = 8;

/// One matrix for even functions and one for odd ones.
type ByParity = [DMatrix<f64>; 2];

/// The functions of a mouth, by their number.
pub(super) struct Functions {
    /// Shares of the width from the places to the low and to the high jamb, each exact where it is small.
    places: Vec<[f64; 2]>,
    /// Values at the places in the lower half -> functions, transposed: places by functions.
    resolved: ByParity,
}

/// What is the same for all mouths with as many functions and modes.
struct Common {
    /// g_n(tau_j), functions by modes.
    modes: ByParity,
    /// S + Z of the weights 1/tau and pi/tau_j, j > 0; that of S is tau/(1 + tau^2) for n = m = 0.
    limits: ByParity,
}

/// Ascending coefficients of (tau/2)^lambda = sum c_j J_(2 j + lambda)(tau) (DLMF 10.23.15).
fn powers(count: usize) -> Vec<f64> {
    let mut gamma = libm::tgamma(LAMBDA);
    (0..count)
        .map(|j| {
            if j > 0 {
                gamma *= (LAMBDA + j as f64 - 1.0) / j as f64;
            }
            (LAMBDA + 2.0 * j as f64) * gamma
        })
        .collect()
}

/// g_n(tau) for n = 0..2 `half` and each of the `taus` > 0, functions by taus; neighbours should be of like size.
fn transforms(half: usize, taus: &[f64]) -> ByParity {
    let start = |tau: f64| (tau + 11.0 * tau.cbrt()) as usize + 15;
    let coefficients = powers(start(taus.iter().fold(0.0, |most, tau| tau.max(most))) / 2 + 1);
    let mut all = [0, 1].map(|_| DMatrix::zeros(half, taus.len()));
    let mut values = vec![[0.0; LANES]; 2 * half];
    for (first, taus) in taus.chunks(LANES).enumerate() {
        let mut lanes = [taus[0]; LANES];
        lanes[..taus.len()].copy_from_slice(taus);
        // Downwards, which is stable (Miller), then scaled by the sum of the even ones.
        let start = start(lanes.iter().fold(0.0, |most, tau| tau.max(most)));
        let twice_over = lanes.map(|tau| 2.0 / tau);
        let (mut above, mut here, mut sum) = ([0.0; LANES], [1e-100; LANES], [0.0; LANES]);
        values.fill([0.0; LANES]);
        for n in (0..=start).rev() {
            if let Some(value) = values.get_mut(n) {
                *value = here;
            }
            let even = if n % 2 == 0 { coefficients[n / 2] } else { 0.0 };
            let factor = n as f64 + LAMBDA;
            for lane in 0..LANES {
                sum[lane] += even * here[lane];
                let below = factor * twice_over[lane] * here[lane] - above[lane];
                above[lane] = here[lane];
                here[lane] = below;
            }
        }
        let scale = sum.map(|sum| 2f64.powf(-LAMBDA) / sum);
        for lane in 0..taus.len() {
            for (n, value) in values.iter().enumerate() {
                all[n % 2][(n / 2, first * LANES + lane)] = value[lane] * scale[lane];
            }
        }
    }
    all
}

/// sum over points of weight g_n g_m.
fn summed(points: DMatrixView<f64>, weights: &[f64]) -> DMatrix<f64> {
    points * DMatrix::from_fn(points.ncols(), points.nrows(), |j, n| weights[j] * points[(n, j)])
}

/// A smooth H_(n+lambda)(tau) e^(-i tau) for n = 0..`count`, tau > `count` and > 50.
fn outgoing(count: usize, tau: f64) -> Vec<Complex64> {
    // Hankel's expansion (DLMF 10.17.5) of the first two.
    let first = |order: f64| {
        let (mut term, mut sum) = (Complex64::ONE, Complex64::ONE);
        for k in 1..12 {
            let odd = (2 * k - 1) as f64;
            term *= Complex64::I * (4.0 * order * order - odd * odd) / (8.0 * k as f64 * tau);
            sum += term;
        }
        sum * Complex64::from_polar((2.0 / (PI * tau)).sqrt(), -FRAC_PI_2 * (order + 0.5))
    };
    let mut values = vec![first(LAMBDA), first(1.0 + LAMBDA)];
    for n in 1..count {
        values.push(2.0 * (n as f64 + LAMBDA) / tau * values[n] - values[n - 1]);
    }
    values
}

/// int_0^inf tau/(1 + tau^2) g_0^2 dtau.
fn lowest() -> f64 {
    // J^2 is (1 + sin(2 tau - lambda pi))/(pi tau) in the end.
    let end = 400.0;
    let (taus, weights): (Vec<f64>, Vec<f64>) = gauss_nodes(0.0, end, 500).unzip();
    let values = transforms(1, &taus);
    let inside: f64 =
        values[0].iter().zip(&taus).zip(&weights).map(|((g, tau), w)| end * w * g * g * tau / (1.0 + tau * tau)).sum();
    let oscillating = 0.5 * (2.0 * end - LAMBDA * PI).cos() * end.powf(-7.0 / 3.0);
    inside + (0.75 * end.powf(-4.0 / 3.0) + oscillating) / PI
}

impl Common {
    /// For 2 `half` functions and `count` modes.
    fn new(half: usize, count: usize) -> Self {
        let tau = |j: usize| j as f64 * FRAC_PI_2;
        let still = 2f64.powf(-LAMBDA) / libm::tgamma(1.0 + LAMBDA);
        let modes = [0, 1].map(|parity| {
            let taus: Vec<f64> = (parity..count).step_by(2).map(tau).collect();
            if parity == 1 {
                return transforms(half, &taus)[1].clone();
            }
            // Mode 0 is known.
            let mut all = DMatrix::zeros(half, taus.len());
            all[(0, 0)] = still;
            all.columns_mut(1, taus.len() - 1).copy_from(&transforms(half, &taus[1..])[0]);
            all
        });
        // Beyond the last one the terms, which do not oscillate there, are an integral over tau = from/t^3.
        let rest = |parity: usize| {
            let from = tau(parity + 2 * modes[parity].ncols() - 1);
            let (taus, weights): (Vec<f64>, Vec<f64>) = gauss_nodes(0.0, 1.0, 16 + half / 2)
                .map(|(t, weight)| (from / t.powi(3), 3.0 * weight * t.powi(3) * from.powf(-4.0 / 3.0)))
                .unzip();
            let turn = [Complex64::ONE, Complex64::I][parity];
            let columns: Vec<f64> = taus
                .iter()
                .flat_map(|&tau| {
                    let all = outgoing(2 * half, tau);
                    let real = move |h: &Complex64| (h * turn).re * tau.sqrt();
                    all.iter().skip(parity).step_by(2).take(half).map(real).collect::<Vec<_>>()
                })
                .collect();
            summed(DMatrix::from_vec(half, taus.len(), columns).as_view(), &weights)
        };
        let limits = [0, 1].map(|parity| {
            let weight = |j: usize| if j == 0 { 0.0 } else { PI / tau(j) };
            let weights: Vec<f64> = (parity..count).step_by(2).map(weight).collect();
            summed(modes[parity].as_view(), &weights) + rest(parity) + integrals(half, parity)
        });
        Self { modes, limits }
    }

    /// The same, kept for the next mouth.
    fn of(half: usize, count: usize) -> Arc<Self> {
        static KNOWN: Kept<(usize, usize), Common> = Kept::new();
        let half = half.next_multiple_of(8);
        let count = count.max(6 * half + 40).next_multiple_of(64);
        KNOWN.of((half, count), || Self::new(half, count))
    }
}

/// int_0^inf g_n g_m dtau/tau, closed.
fn integrals(half: usize, parity: usize) -> DMatrix<f64> {
    // Gamma(p)/Gamma(p + 4/3), p = (n + m)/2, and 1/(Gamma(7/6 + d) Gamma(7/6 - d)), d = (n - m)/2.
    let sums: Vec<f64> = (0..2 * half + 1)
        .scan(0.0, |value, p| {
            *value = match p {
                0 => 0.0,
                1 => 1.0 / libm::tgamma(7.0 / 3.0),
                _ => *value * (p as f64 - 1.0) / (p as f64 + 1.0 / 3.0),
            };
            Some(*value)
        })
        .collect();
    let differences: Vec<f64> = (0..half)
        .scan(libm::tgamma(7.0 / 6.0).powi(-2), |value, d| {
            let now = *value;
            *value *= (1.0 / 6.0 - d as f64) / (7.0 / 6.0 + d as f64);
            Some(now)
        })
        .collect();
    let scale = libm::tgamma(4.0 / 3.0) * 2f64.powf(-4.0 / 3.0);
    DMatrix::from_fn(half, half, |n, m| match n + m + parity {
        0 => lowest(),
        p => scale * sums[p] * differences[n.abs_diff(m)],
    })
}

/// What S adds to its limit 1/tau, real and imaginary part, at `reach` = k b.
fn radiation(half: usize, reach: f64) -> [Split; 2] {
    // Each panel by a variable in which its weight is smooth: tau, its measure and the square root of |K^2 - tau^2|.
    let (middle, end) = ((1.5 * reach).max(1.0), 4.0 * reach + 20.0);
    let most = (middle / reach).acosh();
    let rule = |length: f64, phase: f64| {
        gauss_nodes(0.0, length, 14 + (0.5 * phase) as usize).map(move |(x, w)| (x, length * w))
    };
    let lit = rule(FRAC_PI_2, FRAC_PI_2 * reach).map(|(x, w)| (reach * x.sin(), w * reach * x.cos(), reach * x.cos()));
    let near =
        rule(most, reach * most * most.sinh()).map(|(x, w)| (reach * x.cosh(), w * reach * x.sinh(), reach * x.sinh()));
    let far = rule(end - middle, end - middle).map(|(x, w)| {
        let tau = middle + x;
        (tau, w, (tau * tau - reach * reach).sqrt())
    });
    let points: Vec<(f64, f64, f64)> = lit.chain(near).chain(far).collect();
    let taus: Vec<f64> = points.iter().map(|p| p.0).collect();
    let lit = taus.partition_point(|tau| *tau < reach);
    let outside = |(i, (_, measure, root)): (usize, &(f64, f64, f64))| if i < lit { 0.0 } else { measure / root };
    let real: Vec<f64> = points.iter().enumerate().map(|(i, p)| outside((i, p)) - p.1 / p.0).collect();
    let imaginary: Vec<f64> = points[..lit].iter().map(|(_, measure, root)| measure / root).collect();
    let values = transforms(half, &taus);
    let mut sums =
        values.each_ref().map(|values| [summed(values.as_view(), &real), summed(values.columns(0, lit), &imaginary)]);
    let limit = |(tau, measure, _): &(f64, f64, f64)| measure * tau / (1.0 + tau * tau);
    let lowest = values[0].row(0);
    sums[0][0][(0, 0)] =
        points.iter().enumerate().zip(lowest.iter()).map(|((i, p), g)| g * g * (outside((i, p)) - limit(p))).sum();
    sums
}

impl Functions {
    /// 2 `half` of them.
    pub(super) fn of(half: usize) -> Arc<Self> {
        static KNOWN: Kept<usize, Functions> = Kept::new();
        KNOWN.of(half, || Self::new(half))
    }

    fn new(half: usize) -> Self {
        const THIRD: FiniteAboveNegOneF64 = FiniteAboveNegOneF64::new(-1.0 / 3.0).unwrap();
        const HALF: FiniteAboveNegOneF64 = FiniteAboveNegOneF64::new(-0.5).unwrap();
        // C_(2 half) is a polynomial of t = 2 xi^2 - 1.
        let rule = GaussJacobi::new(NonZeroUsize::new(half).unwrap_or(NonZeroUsize::MIN), THIRD, HALF);
        let mut upper: Vec<f64> = rule.nodes().map(|t| (0.5 * (1.0 + t)).sqrt()).collect();
        upper.sort_by(f64::total_cmp);
        let lower = upper.iter().rev().map(|xi| [0.5 * (1.0 - xi), 0.5 * (1.0 + xi)]);
        let places = lower.chain(upper.iter().map(|xi| [0.5 * (1.0 + xi), 0.5 * (1.0 - xi)])).collect();
        let mut resolved = [0, 1].map(|_| DMatrix::zeros(half, half));
        for (i, xi) in upper.iter().rev().enumerate() {
            let values = polynomials(2 * half, -xi);
            let scale = 2f64.powf(LAMBDA) * libm::tgamma(LAMBDA);
            for (n, value) in values.iter().enumerate() {
                let sign = if (n / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
                resolved[n % 2][(i, n / 2)] = sign * scale * (n as f64 + LAMBDA) * value;
            }
        }
        Self { places, resolved }
    }

    /// Places of the unknowns: shares of the width from the low and from the high jamb.
    pub(super) fn places(&self) -> &[[f64; 2]] {
        &self.places
    }

    /// S + Z as they act on v dx at the places, for the fields that are even and odd along the gap: for symmetric and for
    /// antisymmetric v between the places in the lower half. `reach`: k b; `impedances`: over b, of the `count` modes.
    pub(super) fn operators(
        &self,
        reach: f64,
        count: usize,
        impedances: impl Fn(usize) -> [f64; 2],
    ) -> [[Split; 2]; 2] {
        let half = self.resolved[0].nrows();
        let common = Common::of(half, count);
        let impedances: Vec<[f64; 2]> = (0..count).map(impedances).collect();
        let radiation = radiation(half, reach);
        let by_parity = [0, 1].map(|parity| {
            let at_places = |functions: &DMatrix<f64>| {
                let resolved = &self.resolved[parity];
                resolved * functions * (resolved.transpose() / PI)
            };
            let [real, imaginary] = &radiation[parity];
            let open = real + common.limits[parity].view((0, 0), (half, half));
            let modes = common.modes[parity].view((0, 0), (half, (count - parity).div_ceil(2)));
            let imaginary = at_places(imaginary);
            [0, 1].map(|which| {
                let weight = |j: usize| match j {
                    0 => FRAC_PI_2 * impedances[0][which],
                    _ => PI * (impedances[j][which] - 1.0 / (j as f64 * FRAC_PI_2)),
                };
                let weights: Vec<f64> = (parity..count).step_by(2).map(weight).collect();
                [at_places(&(&open + summed(modes, &weights))), imaginary.clone()]
            })
        });
        let [[even, odd], [even_too, odd_too]] = by_parity;
        [[even, even_too], [odd, odd_too]].map(|halves| halves.map(|half| half.map(|part| 2.0 * part)))
    }

    /// v dx/(d xi) (1 - xi^2)^(1/3) at xi, for v dx at the places.
    pub(super) fn series(&self, strengths: &[Complex64]) -> Vec<Complex64> {
        let half = self.resolved[0].nrows();
        let (low, high) = strengths.split_at(half);
        let mut all = vec![Complex64::ZERO; 2 * half];
        for (i, (low, high)) in low.iter().zip(high.iter().rev()).enumerate() {
            for (n, value) in all.iter_mut().enumerate() {
                let part = if n % 2 == 0 { low + high } else { low - high };
                *value += self.resolved[n % 2][(i, n / 2)] * part;
            }
        }
        // Of C_n: sign, 1/K_n.
        let mut norm = PI * 2f64.powf(1.0 - LAMBDA) * libm::tgamma(2.0 * LAMBDA) / libm::tgamma(LAMBDA);
        for (n, value) in all.iter_mut().enumerate() {
            if n > 0 {
                norm *= (n as f64 - 1.0 + 2.0 * LAMBDA) / n as f64;
            }
            let sign = if (n / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
            *value *= sign / norm;
        }
        all
    }
}

/// C_n(xi), n = 0..`count`.
pub(super) fn polynomials(count: usize, xi: f64) -> Vec<f64> {
    let mut values = vec![1.0, 2.0 * LAMBDA * xi];
    for n in 2..count {
        let n_f = n as f64;
        let next = (2.0 * (n_f + LAMBDA - 1.0) * xi * values[n - 1] - (n_f + 2.0 * LAMBDA - 2.0) * values[n - 2]) / n_f;
        values.push(next);
    }
    values.truncate(count);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The function number `n` at xi = sin t, times cos t, so that its integral over t is one over xi.
    fn function(n: usize, t: f64) -> f64 {
        let gamma = |x: f64| libm::tgamma(x);
        let factorial: f64 = (1..=n).map(|i| i as f64).product();
        let norm = PI * 2f64.powf(1.0 - LAMBDA) * gamma(n as f64 + 2.0 * LAMBDA) / (factorial * gamma(LAMBDA));
        let sign = if (n / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
        sign / norm * t.cos().powf(1.0 / 3.0) * polynomials(n + 1, t.sin())[n]
    }

    #[test]
    fn transforms_are_those_of_the_functions() {
        let taus = [0.03, 0.7, 5.0, 40.0];
        let all = transforms(4, &taus);
        for n in 0..8 {
            for (i, tau) in taus.iter().enumerate() {
                // cos^(1/3) at the ends: t = pi/2 (3 u - u^3)/2 makes it smooth enough.
                let rule =
                    gauss_nodes(-1.0, 1.0, 300).map(|(u, w)| (0.5 * (3.0 * u - u * u * u), 3.0 * w * (1.0 - u * u)));
                let sum: f64 = rule
                    .map(|(u, weight)| {
                        let t = FRAC_PI_2 * u;
                        let wave = if n % 2 == 0 { (tau * t.sin()).cos() } else { (tau * t.sin()).sin() };
                        FRAC_PI_2 * weight * function(n, t) * wave
                    })
                    .sum();
                let got = all[n % 2][(n / 2, i)];
                assert!((got - sum).abs() < 1e-6, "{n} {tau}: {got} {sum}");
            }
        }
    }

    #[test]
    fn limits_are_sums_over_all_modes_and_integrals_over_all_waves() {
        let (half, end) = (3, 4000.0);
        let common = Common::new(half, 64);
        let (taus, weights): (Vec<f64>, Vec<f64>) = gauss_nodes(0.0, end, 5000).unzip();
        let waves = transforms(half, &taus);
        for (parity, waves) in waves.iter().enumerate() {
            let modes: Vec<f64> = (1..).map(|j| f64::from(j) * FRAC_PI_2).take_while(|tau| *tau < end).collect();
            let own: Vec<f64> = modes.into_iter().skip(1 - parity).step_by(2).collect();
            let at_modes = &transforms(half, &own)[parity];
            let limit = |n: usize, m: usize, tau: f64| match n + m + parity {
                0 => tau / (1.0 + tau * tau),
                _ => 1.0 / tau,
            };
            for (n, m) in [(0, 0), (1, 1), (0, 2), (2, 2)] {
                let over_waves: f64 = (0..taus.len())
                    .map(|i| end * weights[i] * limit(n, m, taus[i]) * waves[(n, i)] * waves[(m, i)])
                    .sum();
                let over_modes: f64 =
                    own.iter().enumerate().map(|(i, tau)| PI / tau * at_modes[(n, i)] * at_modes[(m, i)]).sum();
                // Beyond the end: 3/4 end^(-4/3) over pi on average, half of it again at the modes at most.
                let rest = 0.75 * end.powf(-4.0 / 3.0) / PI;
                let got = common.limits[parity][(n, m)];
                let error = got - over_waves - over_modes;
                assert!(error.abs() < 3.0 * rest, "{parity} {n} {m}: {got}, {error:e}, {rest:e}");
            }
        }
    }
}
