//! The exact rectangle: the aperture of a rigid screen in three dimensions, and the gap through a thick wall.
//!
//! Behind a rigid screen p(r) = (1/2 pi) int exp(ikR)/R u dS, u = -dp/dz in the opening, and continuity asks for
//!
//! ```text
//! S u = (1/2 pi) int exp(ikR)/R u dS = p_inc   in the opening.
//! ```
//!
//! u is a sum of products of the functions of overlap.rs along the two sides; tested with the same functions (Galerkin) the pressure from a
//! source to a receiver is g_r S^-1 g_s with g the moments of either one's free field: symmetric in the two, and its error is of
//! second order in that of u, so that the corners, which the functions do not know, cost less than 0.001 dB. The matrix is
//! the kernel between separations along x and y times the overlaps of either side. Through a wall of thickness h the gap's
//! impedances are added to S for the parts even and odd about its middle, as in thick.rs, with
//! gamma^2 = k^2 - (p pi/w)^2 - (q pi/h)^2 for the modes of the rectangle. Time factor exp(-i omega t).

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use nalgebra::{DMatrix, DVector, Dyn, LU};
use num_complex::Complex64;

use super::hankel::sin_cos;
use super::overlap::{SideFunctions, chebyshev, functions};
use super::thick::impedances;

/// Digits (as a power of e) to which the moments are summed.
const DIGITS: f64 = 14.0;
/// Distance of the source's singularity from the path of integration, in radians of the cosine substitution, below which the
/// nodes are graded towards it.
const NEAR: f64 = 0.25;
/// Nearest distance in m at which a point is told from the opening itself.
const TOUCHING_M: f64 = 1e-6;

/// Unknowns for an opening of k times width `x` and k times height `y`, on average.
pub fn unknowns(x: f64, y: f64) -> f64 {
    functions(0.5 * x) * functions(0.5 * y)
}

/// The factorised opening at the wave numbers of one band.
pub struct Hatch {
    centre: DVec3,
    half_depth_m: f64,
    sides: [SideFunctions; 2],
    at: Vec<AtWaveNumber>,
}

struct AtWaveNumber {
    k: f64,
    weight: f64,
    /// S, or through a gap S + Z_odd and S + Z_even: the velocity that leaves is the difference. By parity along x and y.
    blocks: Vec<(Factors, Option<Factors>)>,
}

/// A point as the opening sees it: the moments of its free field exp(ikR)/R at every wave number, block after block.
pub struct View(Vec<DVector<Complex64>>);

/// What a source does in the opening.
pub struct Driven(Vec<DVector<Complex64>>);

impl Hatch {
    /// Sets up the opening `x_m` by `y_m` (finite limits in m) through a wall of `thickness_m` (0: thin) at the wave numbers
    /// and weights `nodes`.
    pub fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, nodes: &[(f64, f64)]) -> Self {
        let highest = nodes.iter().fold(0.0_f64, |k, node| k.max(node.0));
        let sides = [x_m, y_m].map(|limits| SideFunctions::new(limits[1] - limits[0], highest));
        let modes = (thickness_m > 0.0).then(|| [0, 1].map(|side| sides[side].modes()));
        let factorised = |&(k, weight): &(f64, f64)| {
            let outside = tested(&sides, &outside(&sides, k));
            let blocks = match &modes {
                None => outside.into_iter().map(|s| (s.lu(), None)).collect(),
                Some(modes) => {
                    let gaps = [1, 0].map(|odd| in_gap(&sides, modes, k, thickness_m, odd));
                    let mut blocks = Vec::new();
                    for ((s, odd), even) in outside.into_iter().zip(&gaps[0]).zip(&gaps[1]) {
                        let part = |z: &DMatrix<f64>| s.zip_map(z, |s, z| s + z).lu();
                        blocks.push((part(odd), Some(part(even))));
                    }
                    blocks
                }
            };
            AtWaveNumber { k, weight, blocks }
        };
        let at = nodes.iter().map(factorised).collect();
        let centre = DVec3::new(0.5 * (x_m[0] + x_m[1]), 0.5 * (y_m[0] + y_m[1]), 0.0);
        Self { centre, half_depth_m: 0.5 * thickness_m, sides, at }
    }

    /// The moments of the free field of a point in the opening's frame (in m, on either side).
    pub fn view(&self, point: DVec3) -> View {
        let from = point - self.centre;
        let z = (from.z.abs() - self.half_depth_m).max(TOUCHING_M);
        let highest = self.at.iter().fold(0.0_f64, |k, at| k.max(at.k));
        let beyond = |x: f64, half: f64| (x.abs() - half).max(0.0);
        let [x, y] = &self.sides;
        let across_x = nodes(x, from.x, z.hypot(beyond(from.y, y.half_m)), highest);
        let across_y = nodes(y, from.y, z.hypot(beyond(from.x, x.half_m)), highest);
        let mut sums = vec![vec![Complex64::ZERO; x.count * y.count]; self.at.len()];
        let mut row = vec![Complex64::ZERO; x.count];
        let mut lengths = vec![0.0; across_x.x_m.len()];
        let mut waves = vec![(0.0, 0.0); lengths.len()];
        for (b, b_functions) in across_y.each() {
            let square = (from.y - b).powi(2) + z * z;
            lengths.iter_mut().zip(&across_x.x_m).for_each(|(r, a)| *r = ((from.x - a).powi(2) + square).sqrt());
            for (at, sums) in self.at.iter().zip(&mut sums) {
                waves.iter_mut().zip(&lengths).for_each(|(wave, r)| *wave = sin_cos(at.k * r));
                row.fill(Complex64::ZERO);
                for ((_, a_functions), (r, (sin, cos))) in across_x.each().zip(lengths.iter().zip(&waves)) {
                    let (re, im) = (cos / r, sin / r);
                    for (value, f) in row.iter_mut().zip(a_functions) {
                        value.re += re * f;
                        value.im += im * f;
                    }
                }
                for (sums, value) in sums.chunks_exact_mut(y.count).zip(&row) {
                    sums.iter_mut().zip(b_functions).for_each(|(sum, f)| *sum += value * f);
                }
            }
        }
        View(sums.iter().map(|sums| self.by_parity(sums)).collect())
    }

    /// Moments, x slowest, in the order of the blocks.
    fn by_parity(&self, sums: &[Complex64]) -> DVector<Complex64> {
        let [x, y] = &self.sides;
        let mut ordered = Vec::with_capacity(sums.len());
        for (p, q) in PARITIES {
            for i in (p..x.count).step_by(2) {
                ordered.extend((q..y.count).step_by(2).map(|j| sums[i * y.count + j]));
            }
        }
        DVector::from_vec(ordered)
    }

    /// The velocities that the field of `source` drives in the opening (far side).
    pub fn driven(&self, source: &View) -> Driven {
        let solve = |(at, moments): (&AtWaveNumber, &DVector<Complex64>)| {
            let mut strengths = DVector::zeros(moments.len());
            let mut start = 0;
            for (first, even) in &at.blocks {
                let size = first.lu_internal().nrows();
                let own = moments.rows(start, size).into_owned();
                let mut leaving = solved(first, &own);
                if let Some(even) = even {
                    leaving -= solved(even, &own);
                }
                strengths.rows_mut(start, size).copy_from(&leaving);
                start += size;
            }
            strengths
        };
        Driven(self.at.iter().zip(&source.0).map(solve).collect())
    }

    /// Intensity at a receiver relative to the source's free field at 1 m, mean over the wave numbers.
    pub fn intensity(&self, driven: &Driven, receiver: &View) -> f64 {
        self.pressures(driven, receiver).zip(&self.at).map(|(p, at)| at.weight * p.norm_sqr()).sum()
    }

    /// Pressures at a receiver relative to the modulus of the source's free field at 1 m, one a wave number.
    pub fn pressures(&self, driven: &Driven, receiver: &View) -> impl Iterator<Item = Complex64> {
        driven.0.iter().zip(&receiver.0).map(|(driven, seen)| driven.dot(seen))
    }
}

type Factors = LU<Complex64, Dyn, Dyn>;

/// The equations are uniquely solvable; a failed factorisation means an empty opening: silence.
fn solved(factors: &Factors, right: &DVector<Complex64>) -> DVector<Complex64> {
    factors.solve(right).unwrap_or_else(|| DVector::zeros(right.len()))
}

/// Parities along x and y, block after block.
const PARITIES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

/// exp(ikR)/R between all separations, real and imaginary part, times 4 for both signs of either.
fn outside(sides: &[SideFunctions; 2], k: f64) -> [DMatrix<f64>; 2] {
    let [x, y] = [0, 1].map(|side| &sides[side].separations_m);
    let mut parts = [DMatrix::zeros(x.len(), y.len()), DMatrix::zeros(x.len(), y.len())];
    for (j, dy) in y.iter().enumerate() {
        for (i, dx) in x.iter().enumerate() {
            let r = (dx * dx + dy * dy).sqrt();
            let (sin, cos) = (k * r).sin_cos();
            parts[0][(i, j)] = 4.0 * cos / r;
            parts[1][(i, j)] = 4.0 * sin / r;
        }
    }
    parts
}

/// The kernel tested with all pairs of functions, one matrix a pair of parities.
fn tested(sides: &[SideFunctions; 2], kernel: &[DMatrix<f64>; 2]) -> Vec<DMatrix<Complex64>> {
    let [x, y] = sides;
    let by_pair = [0, 1].map(|part: usize| &x.overlaps * &kernel[part] * y.overlaps.transpose());
    blocks(sides, |pair| Complex64::new(by_pair[0][pair], by_pair[1][pair]))
}

/// 2 pi times the impedances of the gap for the part that is even (`odd` 0) or odd (1) about the middle of the wall.
fn in_gap(
    sides: &[SideFunctions; 2],
    modes: &[DMatrix<f64>; 2],
    k: f64,
    thickness_m: f64,
    odd: usize,
) -> Vec<DMatrix<f64>> {
    let [x, y] = sides;
    let area = 4.0 * x.half_m * y.half_m;
    let twice = |k: f64| if k == 0.0 { 1.0 } else { 2.0 };
    let (along_x, along_y): (Vec<f64>, Vec<f64>) = (x.mode_k().collect(), y.mode_k().collect());
    let impedance = DMatrix::from_fn(along_x.len(), along_y.len(), |p, q| {
        let (kx, ky) = (along_x[p], along_y[q]);
        TAU * twice(kx) * twice(ky) / area * impedances(k, kx.hypot(ky), thickness_m)[odd]
    });
    let by_pair = &modes[0] * impedance * modes[1].transpose();
    blocks(sides, |pair| by_pair[pair])
}

/// Spreads values by pairs of functions along x and y over matrices between unknowns.
fn blocks<T: nalgebra::Scalar>(sides: &[SideFunctions; 2], value: impl Fn((usize, usize)) -> T) -> Vec<DMatrix<T>> {
    let [x, y] = sides;
    let block = |&(p, q): &(usize, usize)| {
        let (nx, ny) = (x.of_parity(p), y.of_parity(q));
        DMatrix::from_fn(nx * ny, nx * ny, |a, b| value((x.pair(p, a / ny, b / ny), y.pair(q, a % ny, b % ny))))
    };
    PARITIES.iter().map(block).collect()
}

/// Places along a side with the values of its functions times sqrt(1 - x^2) and the weight, place after place.
struct Nodes {
    x_m: Vec<f64>,
    functions: Vec<f64>,
    count: usize,
}

impl Nodes {
    fn each(&self) -> impl Iterator<Item = (f64, &[f64])> {
        self.x_m.iter().copied().zip(self.functions.chunks_exact(self.count))
    }
}

/// Nodes along a side for the field of a point at `x_m` along it and `off_m` from it: x = a cos(tau).
///
/// The field is singular at tau with cos(tau) = (x + i off)/a. Far from the real axis even steps of tau converge
/// exponentially at the rate of that distance; near it Gauss panels grow from it.
fn nodes(side: &SideFunctions, x_m: f64, off_m: f64, k: f64) -> Nodes {
    let pole = Complex64::new(x_m / side.half_m, off_m / side.half_m).acosh();
    let (near, at) = (pole.re.abs().max(1e-7), pole.im.abs());
    let phase = side.count as f64 + k * side.half_m;
    let mut taus = Vec::new();
    if near > NEAR {
        let count = (0.5 * (phase + DIGITS / near)).ceil();
        taus.extend((0..count as usize).map(|j| ((j as f64 + 0.5) * PI / count, PI / count)));
    } else {
        for (sign, end) in [(-1.0, at), (1.0, PI - at)] {
            let (mut low, mut high) = (0.0, near);
            while low < end {
                let width = f64::min(high, end) - low;
                let order = 8 + (0.4 * width * phase).ceil() as usize;
                let panel = super::slit::gauss_nodes(low, low + width, order);
                taus.extend(panel.map(|(from, weight)| (at + sign * from, weight * width)));
                (low, high) = (high, 3.0 * high);
            }
        }
    }
    let mut functions = vec![0.0; taus.len() * side.count];
    for ((tau, weight), values) in taus.iter().zip(functions.chunks_exact_mut(side.count)) {
        chebyshev(tau.cos(), values);
        values.iter_mut().for_each(|value| *value *= weight);
    }
    let x_m = taus.iter().map(|(tau, _)| side.half_m * tau.cos()).collect();
    Nodes { x_m, functions, count: side.count }
}

/// Transmitted power of a plane wave at normal incidence over the power that meets the area of the opening, mean over the wave
/// numbers `nodes`.
///
/// With b the moments of 1 and S c = 2 pi b, T = Im(c* S c)/(2 pi k area).
pub fn transmission(width_m: f64, height_m: f64, thickness_m: f64, nodes: &[(f64, f64)]) -> f64 {
    let highest = nodes.iter().fold(0.0_f64, |k, node| k.max(node.0));
    // It is solved once: to 1e-4.
    let sides = [width_m, height_m].map(|width| SideFunctions::with(5, width, highest));
    let modes = (thickness_m > 0.0).then(|| [0, 1].map(|side| sides[side].modes()));
    let at = |k: f64| {
        // An even wave moves the first block only, and there the first function only.
        let s = tested(&sides, &outside(&sides, k)).swap_remove(0);
        let mut right = DVector::zeros(s.nrows());
        right[0] = Complex64::from(TAU * PI * PI);
        let solve = |matrix: DMatrix<Complex64>| solved(&matrix.lu(), &right);
        let leaving = match &modes {
            None => solve(s.clone()),
            Some(modes) => {
                let part = |odd: usize| {
                    let gap = in_gap(&sides, modes, k, thickness_m, odd).swap_remove(0);
                    solve(s.zip_map(&gap, |s, z| s + z))
                };
                part(1) - part(0)
            }
        };
        leaving.dotc(&(&s * &leaving)).im / (TAU * k * width_m * height_m)
    };
    nodes.iter().map(|(k, weight)| weight * at(*k)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_square_hole_conducts_like_the_capacity_of_a_square_plate() {
        // A plate of side a has the capacity 0.366789 a (Read 1997), the hole the flow 2 pi times that: T = 2 pi 0.366789^2.
        let got = transmission(0.1, 0.1, 0.0, &[(0.01, 1.0)]);
        assert!((got / 0.845_306 - 1.0).abs() < 1e-4, "{got}");
    }

    #[test]
    fn a_wide_hole_passes_the_power_that_meets_it_through_any_depth() {
        // k times side 15: Bouwkamp's circle passes 0.998 at k times radius 10, the depth turns waves back by a few per cent.
        for depth in [0.0, 0.1] {
            let got = transmission(1.0, 1.0, depth, &[(15.0, 1.0)]);
            assert!((got - 1.0).abs() < 0.05, "{depth}: {got}");
        }
    }
}
