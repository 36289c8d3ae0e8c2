//! One side of an exact rectangle: its functions, and how two of them overlap at a distance.
//!
//! Along a side of half width a the functions are T_m(x/a)/sqrt(1 - (x/a)^2), which grow at the edges like the velocity in
//! an opening of a thin screen. As the kernel of the aperture depends on differences of places only, all that is needed of two of
//! them is their overlap at the separation s (in half widths),
//!
//! ```text
//! C_mn(s) = int T_m(x) T_n(x + s) / sqrt[(1 - x^2) (1 - (x + s)^2)] dx ,   0 < s < 2 ,
//! ```
//!
//! which is even in s where m and n are both even or both odd, and cancels in a symmetric kernel where they are not. It has
//! a logarithm at s = 0, and so has the kernel: the nodes lie on panels that shrink towards 0 by a fifth each.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::kept::Kept;
use super::slit::gauss_nodes;
use super::thick::impedances;

/// Functions of a side beyond those that its phase asks for: octave levels are converged to 0.0004 dB from half a longer side on,
/// to 0.01 dB from a sixth of it (docs/physics.md section 4).
const FUNCTIONS: f64 = 6.0;
/// How many fewer do across openings whose sides have at least this ratio (0.03 dB).
const SPARED: (usize, f64) = (2, 4.0);
/// Ratio of the sides from which, and phase up to which the flow across has one profile, even or odd (0.03 dB), ...
const PROFILED: (f64, f64) = (8.0, 0.7);
/// ... in gaps deeper than this share of their width, where the two parts of a thick wall have the same.
const DEEP: f64 = 0.4;
/// Functions that make a profile.
const PROFILE_TERMS: usize = 6;
/// Square of the phase, times what the depth leaves of it, below which the odd flow is left out.
const NO_ODD_FLOW: f64 = 3e-4;
/// Panels of separations: the smallest ends at 2/5^9 = 1e-6, what lies below changes nothing.
const PANELS: i32 = 10;
/// Ratio of the limits of a panel, and its least number of nodes (error 3e-7).
const RATIO: f64 = 0.2;
const PANEL_NODES: usize = 8;
/// Modes of a gap along a side; what the others add to levels is below 0.006 dB.
const MODES: usize = 96;

/// The functions of one side with their overlaps.
pub(super) struct SideFunctions {
    /// Half the width in m.
    pub(super) half_m: f64,
    /// Number of functions.
    pub(super) count: usize,
    overlaps: Arc<Overlaps>,
    /// Where the functions are sums of Chebyshev's: their shares of each.
    profiles: Option<Vec<[f64; PROFILE_TERMS]>>,
}

/// How functions overlap, at any width.
struct Overlaps {
    /// Separations in half widths.
    separations: Vec<f64>,
    /// Overlaps times quadrature weights: pairs by separations.
    weighted: DMatrix<f64>,
}

impl Overlaps {
    /// Of the first `count` functions, for a kernel that with them varies by `phase` over half a width.
    fn new(count: usize, phase: usize) -> Self {
        let mut nodes = Vec::new();
        let mut high = 2.0;
        for panel in 0..PANELS {
            let share = RATIO.powi(panel);
            let low = if panel + 1 == PANELS { 0.0 } else { high * RATIO };
            let order = PANEL_NODES + (phase as f64 * share).ceil() as usize;
            nodes.extend(gauss_nodes(low, high, order).map(|(s, weight)| (s, weight * (high - low))));
            high = low;
        }
        let mut weighted = DMatrix::zeros(pairs(count), nodes.len());
        let rule: Vec<(f64, f64)> = gauss_nodes(0.0, 1.0, 16 + count).collect();
        for (column, (s, weight)) in nodes.iter().enumerate() {
            let mut values = vec![0.0; pairs(count)];
            add_overlaps(&mut values, count, *s, &rule);
            weighted.column_mut(column).iter_mut().zip(values).for_each(|(o, value)| *o = weight * value);
        }
        Self { separations: nodes.into_iter().map(|(s, _)| s).collect(), weighted }
    }

    /// The same, kept for the next side.
    fn of(count: usize, phase: usize) -> Arc<Self> {
        static KNOWN: Kept<(usize, usize), Overlaps> = Kept::new();
        KNOWN.of((count, phase), || Self::new(count, phase))
    }
}

impl SideFunctions {
    /// For the sides of a rectangle `sides_m` through a wall of `thickness_m` (0: thin) up to the wave number `k`.
    pub(super) fn of_rectangle(sides_m: [f64; 2], thickness_m: f64, k: f64) -> [Self; 2] {
        [0, 1].map(|side| {
            let (own_m, ratio) = (sides_m[side], sides_m[1 - side] / sides_m[side]);
            let phase = 0.5 * k * own_m;
            if ratio >= PROFILED.0 && phase < PROFILED.1 && thickness_m > DEEP * own_m {
                return Self::with_profiles(own_m, thickness_m, k);
            }
            let spared = if ratio >= SPARED.1 { SPARED.0 } else { 0 };
            Self::of_count(functions(phase).ceil() as usize - spared, 0.5 * own_m, phase)
        })
    }

    /// With `more` functions than levels need.
    #[cfg(test)]
    pub(super) fn with(more: usize, width_m: f64, k: f64) -> Self {
        let phase = 0.5 * k * width_m;
        Self::of_count(functions(phase).ceil() as usize + more, 0.5 * width_m, phase)
    }

    /// Across a slender rectangle: one even profile, and one odd where it is felt.
    fn with_profiles(width_m: f64, thickness_m: f64, k: f64) -> Self {
        let (half_m, phase) = (0.5 * width_m, 0.5 * k * width_m);
        let terms = Self::of_count(PROFILE_TERMS, half_m, phase);
        let faded = (-PI * thickness_m / width_m).exp();
        let parities = if phase * phase * faded < NO_ODD_FLOW { 1 } else { 2 };
        let profiles: Vec<_> = (0..parities).map(|parity| terms.profile(parity, thickness_m, k)).collect();
        let mut weighted = DMatrix::zeros(parities, terms.overlaps().ncols());
        for (parity, profile) in profiles.iter().enumerate() {
            for j in 0..terms.of_parity(parity) {
                for i in 0..=j {
                    let share = profile[2 * i + parity] * profile[2 * j + parity] * if i == j { 1.0 } else { 2.0 };
                    let mut row = weighted.row_mut(parity);
                    row += share * terms.overlaps().row(terms.pair(parity, i, j));
                }
            }
        }
        let overlaps = Arc::new(Overlaps { separations: terms.overlaps.separations.clone(), weighted });
        Self { count: parities, overlaps, profiles: Some(profiles), ..terms }
    }

    /// Shares of the functions in the velocity that an even (`parity` 0) or odd (1) flow of long waves has across a long gap: the first
    /// function is 1, the others leave no pressure but its own.
    ///
    /// Along the gap the kernel sums up to -2 ln s; of the two impedances that of the odd part counts, in deep gaps both are the same.
    fn profile(&self, parity: usize, thickness_m: f64, k: f64) -> [f64; PROFILE_TERMS] {
        let modes = self.modes();
        let impedance = |mu: f64| impedances(k, mu, thickness_m)[1];
        let entry = |i: usize, j: usize| {
            let pair = self.pair(parity, i, j);
            let outside: f64 =
                self.overlaps().row(pair).iter().zip(self.separations_m()).map(|(o, s)| -4.0 * o * s.ln()).sum();
            let in_gap: f64 =
                modes.row(pair).iter().zip(self.mode_k()).skip(1).map(|(product, mu)| product * impedance(mu)).sum();
            outside + TAU / self.half_m * in_gap
        };
        let others = self.of_parity(parity) - 1;
        let matrix = DMatrix::from_fn(others, others, |i, j| entry(i + 1, j + 1));
        let right = DVector::from_fn(others, |i, _| -entry(i + 1, 0));
        let mut profile = [0.0; PROFILE_TERMS];
        profile[parity] = 1.0;
        if let Some(shares) = matrix.lu().solve(&right) {
            shares.iter().enumerate().for_each(|(i, share)| profile[2 * i + 2 + parity] = *share);
        }
        profile
    }

    /// The first `count` functions.
    fn of_count(count: usize, half_m: f64, phase: f64) -> Self {
        Self { half_m, count, overlaps: Overlaps::of(count, (count as f64 + phase).ceil() as usize), profiles: None }
    }

    /// Separations in m.
    pub(super) fn separations_m(&self) -> impl Iterator<Item = f64> + Clone {
        self.overlaps.separations.iter().map(|s| self.half_m * s)
    }

    /// Overlaps times quadrature weights: pairs by separations.
    pub(super) fn overlaps(&self) -> &DMatrix<f64> {
        &self.overlaps.weighted
    }

    /// Chebyshev's functions that the functions are made of.
    pub(super) fn terms(&self) -> usize {
        self.profiles.as_ref().map_or(self.count, |_| PROFILE_TERMS)
    }

    /// The functions without sqrt(1 - x^2) at `x` in half widths.
    pub(super) fn values(&self, x: f64, values: &mut [f64]) {
        let Some(profiles) = &self.profiles else { return chebyshev(x, values) };
        let mut terms = [0.0; PROFILE_TERMS];
        chebyshev(x, &mut terms);
        for (value, profile) in values.iter_mut().zip(profiles) {
            *value = profile.iter().zip(terms).map(|(share, term)| share * term).sum();
        }
    }

    /// Number of functions that are even (`parity` 0) or odd (1).
    pub(super) fn of_parity(&self, parity: usize) -> usize {
        of_parity(self.count, parity)
    }

    /// Row in the tables of the functions number `i` and `j` of one parity.
    pub(super) fn pair(&self, parity: usize, i: usize, j: usize) -> usize {
        let (low, high) = (i.min(j), i.max(j));
        let even = of_parity(self.count, 0);
        parity * even * (even + 1) / 2 + high * (high + 1) / 2 + low
    }

    /// Products of the two functions' components along the gap's modes cos(p pi (x/a + 1)/2): pairs by modes p.
    ///
    /// int T_m(x) cos(p pi (x + 1)/2)/sqrt(1 - x^2) dx = pi cos((m + p) pi/2) J_m(p pi/2).
    pub(super) fn modes(&self) -> DMatrix<f64> {
        let component = |m: usize, p: usize| {
            let sign = if (m + p).is_multiple_of(4) { PI } else { -PI };
            sign * libm::jn(m as i32, FRAC_PI_2 * p as f64)
        };
        let mut products = DMatrix::zeros(self.overlaps().nrows(), MODES);
        for parity in 0..2 {
            for p in (parity..MODES).step_by(2) {
                let own = |i: usize| match &self.profiles {
                    None => component(2 * i + parity, p),
                    Some(profiles) => {
                        let terms = profiles[i + parity].iter().enumerate().filter(|(_, share)| **share != 0.0);
                        terms.map(|(m, share)| share * component(m, p)).sum()
                    }
                };
                let own: Vec<f64> = (0..self.of_parity(parity)).map(own).collect();
                for (j, b) in own.iter().enumerate() {
                    for (i, a) in own[..=j].iter().enumerate() {
                        products[(self.pair(parity, i, j), p)] = a * b;
                    }
                }
            }
        }
        products
    }

    /// Transverse wave numbers of the gap's modes in 1/m.
    pub(super) fn mode_k(&self) -> impl Iterator<Item = f64> + Clone {
        let step = FRAC_PI_2 / self.half_m;
        (0..MODES).map(move |p| p as f64 * step)
    }
}

/// Functions along a side of half width `phase` (times k).
pub(super) fn functions(phase: f64) -> f64 {
    FUNCTIONS + phase
}

fn of_parity(count: usize, parity: usize) -> usize {
    (count + 1 - parity) / 2
}

/// Pairs of functions of one parity, an order of the two not counted.
fn pairs(count: usize) -> usize {
    (0..2).map(|parity| of_parity(count, parity)).map(|n| n * (n + 1) / 2).sum()
}

/// T_0(x) .. T_(n-1)(x) by their recurrence.
pub(super) fn chebyshev(x: f64, values: &mut [f64]) {
    let (mut one, mut two) = (1.0, x);
    for value in values {
        *value = one;
        (one, two) = (two, 2.0 * x * two - one);
    }
}

/// Adds C_mn(s) to `values` (by pair).
///
/// Both ends of the overlap, x = -1 + (2 - s) y, look alike: for the lower half dy/sqrt(y (y + e)) with e = s/(2 - s) is 2 dw
/// for y = e sinh^2 w, which takes the edge and the edge near it out. `rule`: Gauss nodes on 0..1.
fn add_overlaps(values: &mut [f64], count: usize, s: f64, rule: &[(f64, f64)]) {
    let e = s / (2.0 - s);
    let end = (0.5 / e).sqrt().asinh();
    // Away from the end the integrand is flat in w.
    let cuts = if end > 3.0 { vec![0.0, end - 2.0, end] } else { vec![0.0, end] };
    let (mut here, mut there) = (vec![0.0; count], vec![0.0; count]);
    for cut in cuts.windows(2) {
        for (share, weight) in rule {
            let w = cut[0] + share * (cut[1] - cut[0]);
            let y = e * w.sinh().powi(2);
            let x = -1.0 + (2.0 - s) * y;
            let measure = 2.0 * weight * (cut[1] - cut[0]) / (((1.0 - y) * (1.0 - y + e)).sqrt() * (2.0 - s));
            chebyshev(x, &mut here);
            chebyshev(x + s, &mut there);
            let mut pair = 0;
            for parity in 0..2 {
                for j in (parity..count).step_by(2) {
                    for i in (parity..=j).step_by(2) {
                        values[pair] += measure * (here[i] * there[j] + here[j] * there[i]);
                        pair += 1;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_and_their_integrals_are_those_of_chebyshevs_functions() {
        let side = SideFunctions::with(0, 2.0, 3.0);
        // int C_mn(s) ds over both signs of s is the product of int T_m/sqrt and int T_n/sqrt: pi^2 for m = n = 0, else 0.
        for parity in 0..2 {
            for j in 0..side.of_parity(parity) {
                for i in 0..=j {
                    let integral = 2.0 * side.overlaps().row(side.pair(parity, i, j)).sum();
                    let expected = if parity == 0 && j == 0 { PI * PI } else { 0.0 };
                    // What lies below the smallest panel's first node is left out: 1e-7.
                    assert!((integral - expected).abs() < 2e-6, "{parity} {i} {j}: {integral} {expected}");
                }
            }
        }
        // C_00(s) is a complete elliptic integral: 2/(1 + s/2) K of modulus (1 - s/2)/(1 + s/2), pi/AGM(1 + s/2, sqrt(2 s)).
        let rule: Vec<(f64, f64)> = gauss_nodes(0.0, 1.0, 24).collect();
        for s in [1e-6_f64, 0.01, 0.5, 1.9] {
            let mut value = [0.0];
            add_overlaps(&mut value, 1, s, &rule);
            let (mut a, mut g) = (1.0 + 0.5 * s, (2.0 * s).sqrt());
            for _ in 0..12 {
                (a, g) = (0.5 * (a + g), (a * g).sqrt());
            }
            assert!((value[0] * a / PI - 1.0).abs() < 1e-10, "{s}: {} {}", value[0], PI / a);
        }
    }
}
