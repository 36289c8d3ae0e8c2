//! Openings through a rigid wall of some thickness, solved exactly: mode matching in the gap.
//!
//! Frame: z along the travel, the gap from z = 0 to z = h. With v = -dp/dz, S the operator of the thin aperture
//! ((i/2) int H0 v dx') and Z the impedances of the gap's modes cos(m pi x/a), the parts of the field that are even and
//! odd about the middle of the wall part company:
//!
//! ```text
//! (Z_even + S) v_even = p_inc ,  Z_even = -cot(gamma h/2)/gamma
//! (Z_odd  + S) v_odd  = p_inc ,  Z_odd  =  tan(gamma h/2)/gamma ,  gamma^2 = k^2 - (m pi/a)^2
//! ```
//!
//! and v_odd - v_even leaves the far mouth. The corner of 270 degrees makes v grow like r^(-1/3): the functions of mouth.rs do so,
//! too, and few of them are enough. Derived in docs/physics.md section 2. Rigid jambs, no viscous losses.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

use super::aperture::{distances, line_transfer};
use super::crossing::{Crossing, Incident};
use super::factors::{Factors, Split, mirrored};
use super::hankel::{hankel0, hankel0_each};
use super::mouth::{Functions, polynomials};
use super::slit::fade;

/// Exponent of the grading for points next to a mouth: v dx/ds vanishes like s^(2 q/3 - 1) at the jambs.
const GRADING: i32 = 6;
/// Distance from the places of the unknowns, in distances of theirs, from which the sum over them is accurate.
const RESOLVED: f64 = 2.5;
/// Most times as many places for points next to the mouth.
const MOST_FINER: f64 = 32.0;
const HALF_I: Complex64 = Complex64 { re: 0.0, im: 0.5 };

/// One of the places graded towards the jambs: shares of the width to the low and to the high jamb, each exact where it is small,
/// and dx/ds in m.
struct Node {
    x_m: f64,
    low: f64,
    high: f64,
    slope_m: f64,
}

/// One opening, the first of its unknowns among all.
struct Mouth {
    start: usize,
    low_m: f64,
    width_m: f64,
    functions: Arc<Functions>,
}

/// The factorised equations of openings in one thick wall at one wave number.
pub struct ThickAperture {
    k: f64,
    thickness_m: f64,
    mouths: Vec<Mouth>,
    even: Factors,
    odd: Factors,
}

/// Half the number of unknowns for an opening of width `ka` (k times width) and `flatness` (width over depth, at which scale its
/// modes fade): the field is converged to 1e-4.
fn half_of_places(ka: f64, flatness: f64) -> usize {
    4 + (0.25 * ka + 0.6 * flatness.sqrt()).ceil() as usize
}

/// Kress' sigmoidal map of s in 0..2 pi on 0..1 and its derivative.
fn graded(s: f64) -> (f64, f64) {
    let q = f64::from(GRADING);
    let v = |s: f64| {
        let t = (s - PI) / PI;
        ((0.5 - 1.0 / q) * t.powi(3) + t / q + 0.5, (3.0 * (0.5 - 1.0 / q) * t * t + 1.0 / q) / PI)
    };
    let ((a, da), (b, db)) = (v(s), v(TAU - s));
    let (pa, pb) = (a.powi(GRADING), b.powi(GRADING));
    (pa / (pa + pb), q * pa * pb * (da / a + db / b) / (pa + pb).powi(2))
}

/// At s = j pi/half, j = 1..2 half.
fn nodes(opening: [f64; 2], half: usize) -> Vec<Node> {
    let width = opening[1] - opening[0];
    (1..2 * half)
        .map(|j| {
            let s = j as f64 * PI / half as f64;
            let ((low, slope), (high, _)) = (graded(s), graded(TAU - s));
            let x_m = if low < 0.5 { opening[0] + width * low } else { opening[1] - width * high };
            Node { x_m, low, high, slope_m: slope * width }
        })
        .collect()
}

/// Impedances of the gap's mode with transverse wave number `mu`, even and odd, in m.
pub(super) fn impedances(k: f64, mu: f64, thickness_m: f64) -> [f64; 2] {
    let square = k * k - mu * mu;
    let gamma = square.abs().sqrt().max(1e-9 * k);
    let half = 0.5 * gamma * thickness_m;
    let (sign, tangent) = if square >= 0.0 { (-1.0, half.tan()) } else { (1.0, half.tanh()) };
    [sign / (tangent * gamma), tangent / gamma]
}

/// Widths over depth between which a gap comes to count as thin: there its depth changes levels by less than 0.08 dB, but for
/// directions along the screen.
const FLAT: [f64; 2] = [100.0, 125.0];

/// Whether a gap of `width_m` counts as deep.
pub fn is_thick(width_m: f64, thickness_m: f64) -> bool {
    FLAT[0] * thickness_m > width_m
}

/// Share of the deep gap in the intensity behind an opening `width_m` across, 0..=1, smooth; the thin one has the rest.
pub(super) fn deep_share(width_m: f64, thickness_m: f64) -> f64 {
    if thickness_m > 0.0 { fade(width_m / thickness_m, FLAT) } else { 0.0 }
}

/// The depths in m as which an opening `width_m` across counts (0: thin), each with its share of the intensity.
pub(super) fn depths(width_m: f64, thickness_m: f64) -> Vec<(f64, f64)> {
    shared(deep_share(width_m, thickness_m), thickness_m)
}

/// The depth in m with the share `deep`, and none with the rest; without what has no share.
pub(super) fn shared(deep: f64, depth_m: f64) -> Vec<(f64, f64)> {
    [(deep, depth_m), (1.0 - deep, 0.0)].into_iter().filter(|(share, _)| *share > 0.0).collect()
}

/// The pressure whose intensity is the sum of those of `pressures` by their shares, its phase that of their own sum.
pub(super) fn blended(pressures: impl Iterator<Item = (f64, Complex64)>) -> Complex64 {
    let (square, sum) = pressures
        .fold((0.0, Complex64::ZERO), |(square, sum), (share, p)| (square + share * p.norm_sqr(), sum + share * p));
    Complex64::from_polar(square.sqrt(), sum.arg())
}

impl ThickAperture {
    /// Sets up and factorises the equations for disjoint, finite openings (limits in m) through a wall of
    /// `thickness_m` > 0 at wave number `k` in 1/m.
    pub fn new(openings: &[[f64; 2]], thickness_m: f64, k: f64) -> Self {
        Self::finer(openings, thickness_m, k, 1)
    }

    /// The same with `finer` times as many nodes.
    pub(super) fn finer(openings: &[[f64; 2]], thickness_m: f64, k: f64, finer: usize) -> Self {
        Self::resolved(openings, thickness_m, k, k, finer)
    }

    /// The same on the nodes that the wave number `resolved_k` >= k asks for.
    pub(super) fn resolved(openings: &[[f64; 2]], thickness_m: f64, k: f64, resolved_k: f64, finer: usize) -> Self {
        let mut mouths: Vec<Mouth> = Vec::new();
        let mut total = 0;
        for &[low_m, high_m] in openings {
            let width_m = high_m - low_m;
            let half = finer * half_of_places(resolved_k * width_m, width_m / thickness_m);
            mouths.push(Mouth { start: total, low_m, width_m, functions: Functions::of(half) });
            total += 2 * half;
        }
        let [even, odd] = match &mouths[..] {
            [mouth] => mouth.operators(k, thickness_m).map(Factors::of_halves),
            _ => coupled(&mouths, total, k, thickness_m).map(|matrix| Factors::new(&matrix, mirrored(openings))),
        };
        Self { k, thickness_m, mouths, even, odd }
    }

    /// p/|p_free| of `crossing`, whose distances count from the middle of the wall; p_free is the field with the wall
    /// taken away.
    pub fn transfer(&self, crossing: &Crossing) -> Complex64 {
        let depth = 0.5 * self.thickness_m;
        match crossing.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                line_transfer(self.k, (x_m, z_m), (crossing.x_m, crossing.z_m), |far, near| {
                    let phases = distances(&self.positions(), self.k, far.0, far.1 - depth);
                    let strengths = self.strengths(hankel0_each(&phases).iter().map(|h| 0.5 * HALF_I * h).collect());
                    self.pressure(&strengths, near.0, near.1 - depth)
                })
            }
            Incident::Plane { s_x, s_y } => {
                let k_x = self.k * s_x / (1.0 - s_y * s_y).sqrt();
                // The wave front through the middle of the wall has phase 0.
                let early = depth * (self.k * self.k - k_x * k_x).max(0.0).sqrt();
                let wave = |x: &f64| Complex64::from_polar(1.0, k_x * x - early);
                let strengths = self.strengths(self.positions().iter().map(wave).collect());
                self.pressure(&strengths, crossing.x_m, crossing.z_m - depth)
            }
        }
    }

    /// Far-field amplitude in m towards sin(theta_o) of a unit plane wave from sin(theta_i), as
    /// [`Solution::far_amplitude`](super::aperture::Solution::far_amplitude).
    pub fn far_amplitude(&self, sin_i: f64, sin_o: &[f64]) -> Vec<Complex64> {
        let nodes = self.positions();
        let strengths = self.strengths(nodes.iter().map(|x| Complex64::from_polar(1.0, self.k * x * sin_i)).collect());
        let towards = |sin_o: f64| {
            nodes
                .iter()
                .zip(&strengths)
                .map(|(x, s)| Complex64::from_polar(1.0, -self.k * x * sin_o) * s)
                .sum::<Complex64>()
        };
        sin_o.iter().map(|s| towards(*s) / TAU).collect()
    }

    /// Wave number across the edges in 1/m.
    pub(super) fn wave_number(&self) -> f64 {
        self.k
    }

    /// The nodes' places across the openings in m.
    pub(super) fn positions(&self) -> Vec<f64> {
        self.mouths.iter().flat_map(Mouth::positions).collect()
    }

    /// v dx/ds times the step at the nodes of the far mouth, for the incident pressure at those of the near one.
    pub(super) fn strengths(&self, p_inc: Vec<Complex64>) -> Vec<Complex64> {
        let right = DVector::from_vec(p_inc);
        (self.odd.solve(&right) - self.even.solve(&right)).as_slice().to_vec()
    }

    /// `shapes`^T times what leaves the far mouth for each of the columns of `shapes` as incident pressure at the nodes.
    pub(super) fn moments(&self, shapes: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        let [odd, even] = [&self.odd, &self.even].map(|factors| factors.moments(shapes));
        [&odd[0] - &even[0], &odd[1] - &even[1]]
    }

    /// Pressure at (x, z), z > 0 behind the far mouth, in m.
    fn pressure(&self, strengths: &[Complex64], x_m: f64, z_m: f64) -> Complex64 {
        let sum_over = |places: &[f64], strengths: &[Complex64]| -> Complex64 {
            hankel0_each(&distances(places, self.k, x_m, z_m)).iter().zip(strengths).map(|(h, s)| h * s).sum()
        };
        let mut sum = Complex64::ZERO;
        for mouth in &self.mouths {
            let places: Vec<f64> = mouth.positions().collect();
            let own = &strengths[mouth.start..mouth.start + places.len()];
            let nearest = distances(&places, 1.0, x_m, z_m).into_iter().fold(f64::INFINITY, f64::min);
            // In the middle, where they are farthest apart.
            let spacing = FRAC_PI_2 * mouth.width_m / places.len() as f64;
            sum += if nearest > RESOLVED * spacing {
                sum_over(&places, own)
            } else {
                let finer = (RESOLVED * spacing / nearest.max(1e-6 * spacing)).ceil().min(MOST_FINER) as usize;
                let (places, own): (Vec<f64>, Vec<Complex64>) = mouth.refined(own, finer).into_iter().unzip();
                sum_over(&places, &own)
            };
        }
        HALF_I * sum
    }
}

/// The equations of all mouths, even and odd.
fn coupled(mouths: &[Mouth], total: usize, k: f64, thickness_m: f64) -> [DMatrix<Complex64>; 2] {
    let mut outside = DMatrix::<Complex64>::zeros(total, total);
    for a in mouths {
        for b in mouths.iter().filter(|b| b.start != a.start) {
            for (i, from) in a.positions().enumerate() {
                for (j, to) in b.positions().enumerate() {
                    outside[(a.start + i, b.start + j)] = HALF_I * hankel0(k * (from - to).abs());
                }
            }
        }
    }
    let mut matrices = [outside.clone(), outside];
    for mouth in mouths {
        for (matrix, [symmetric, antisymmetric]) in matrices.iter_mut().zip(mouth.operators(k, thickness_m)) {
            let [symmetric, antisymmetric] = [symmetric, antisymmetric].map(|[re, im]| re.zip_map(&im, Complex64::new));
            let n = 2 * symmetric.nrows();
            let mut own = matrix.view_mut((mouth.start, mouth.start), (n, n));
            for j in 0..n / 2 {
                for i in 0..n / 2 {
                    let (sum, difference) = (symmetric[(i, j)], antisymmetric[(i, j)]);
                    let (same, opposite) = (0.5 * (sum + difference), 0.5 * (sum - difference));
                    own[(i, j)] = same;
                    own[(n - 1 - i, n - 1 - j)] = same;
                    own[(i, n - 1 - j)] = opposite;
                    own[(n - 1 - i, j)] = opposite;
                }
            }
        }
    }
    matrices
}

impl Mouth {
    /// The places of its unknowns, in m.
    fn positions(&self) -> impl Iterator<Item = f64> {
        let at = |[low, high]: &[f64; 2]| {
            if low < high { self.low_m + self.width_m * low } else { self.low_m + self.width_m * (1.0 - high) }
        };
        self.functions.places().iter().map(at)
    }

    /// Its own equations, as [`Functions::operators`].
    fn operators(&self, k: f64, thickness_m: f64) -> [[Split; 2]; 2] {
        let (a, half_m) = (self.width_m, 0.5 * self.width_m);
        // What the modes add to their asymptote a/(m pi), m = 1, 2, ...: it falls like m^-3 once a mode fades in the gap.
        let count = 40 + (2.0 * k * a / PI + 8.0 * a / (PI * thickness_m)).ceil() as usize;
        let modes = |m: usize| impedances(k, m as f64 * PI / a, thickness_m).map(|z| z / half_m);
        self.functions.operators(k * half_m, count, modes)
    }

    /// Strengths at `finer` times as many places, which are graded towards the jambs.
    fn refined(&self, strengths: &[Complex64], finer: usize) -> Vec<(f64, Complex64)> {
        let series = self.functions.series(strengths);
        let half = self.functions.places().len() * finer;
        let step = PI / half as f64;
        nodes([self.low_m, self.low_m + self.width_m], half)
            .iter()
            .map(|node| {
                let xi = if node.low < 0.5 { 2.0 * node.low - 1.0 } else { 1.0 - 2.0 * node.high };
                let sum: Complex64 = series.iter().zip(polynomials(series.len(), xi)).map(|(c, value)| c * value).sum();
                // d xi/ds is twice dx/ds over the width.
                (
                    node.x_m,
                    sum * (4.0 * node.low * node.high).powf(-1.0 / 3.0) * (2.0 * node.slope_m / self.width_m * step),
                )
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_converged_at_any_width_and_depth() {
        for (width_m, thickness_m, k) in [
            (0.01, 0.04, 1.0),
            (0.1, 0.1, 20.0),
            (0.9, 0.04, 90.0),
            (0.4, 0.3, 73.0),
            (0.9, 0.008, 50.0),
            (0.9, 0.3, 180.0),
        ] {
            let opening = [[-0.5 * width_m, 0.5 * width_m]];
            let [few, many] = [1, 2].map(|finer| ThickAperture::finer(&opening, thickness_m, k, finer));
            let near = Crossing {
                incident: Incident::Line { x_m: 0.4 * width_m, z_m: 0.5 * thickness_m + 0.02 * width_m },
                x_m: 1.0,
                z_m: 2.0,
            };
            let (a, b) = (few.transfer(&near), many.transfer(&near));
            assert!((a - b).norm() < 1e-3 * b.norm(), "{width_m} {thickness_m} {k}: {a} {b}");
            for sine in [0.0, 0.5, 0.95] {
                let [a, b] = [&few, &many].map(|aperture| aperture.far_amplitude(sine, &[-0.3, 0.9]));
                let scale = width_m * (k * width_m).sqrt().min(1.0);
                for (a, b) in a.iter().zip(&b) {
                    assert!(
                        (a - b).norm() < 1e-4 * scale.max(b.norm()),
                        "{width_m} {thickness_m} {k}, {sine}: {a} {b}"
                    );
                }
            }
        }
    }
}
