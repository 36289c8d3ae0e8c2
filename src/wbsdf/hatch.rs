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
use nalgebra::DMatrix;
use num_complex::Complex64;
use pulp::{Arch, Simd, WithSimd};

use super::hankel::sin_cos;
use super::overlap::{SideFunctions, functions};
use super::symmetric::{Parts, Symmetric, dot};
use super::thick::impedances;

/// Digits (as a power of e) to which the moments are summed.
const DIGITS: f64 = 14.0;
/// Distance of the source's singularity from the path of integration, in radians of the cosine substitution, below which the
/// nodes are graded towards it.
const NEAR: f64 = 0.25;
/// Decay (as a power of e) of a mode from mouth to mouth beyond which it does not reach the other one.
const FADED: f64 = 20.0;
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
    blocks: Vec<(Symmetric, Option<Symmetric>)>,
}

/// A point as the opening sees it: the moments of its free field exp(ikR)/R at every wave number, block after block.
pub struct View(Parts);

/// What a source does in the opening.
pub struct Driven(Parts);

impl Hatch {
    /// Sets up the opening `x_m` by `y_m` (finite limits in m) through a wall of `thickness_m` (0: thin) at the wave numbers
    /// and weights `nodes`.
    pub fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, nodes: &[(f64, f64)]) -> Self {
        let highest = nodes.iter().fold(0.0_f64, |k, node| k.max(node.0));
        let sides = SideFunctions::of_rectangle([x_m, y_m].map(|limits| limits[1] - limits[0]), thickness_m, highest);
        Self::with(sides, [x_m, y_m].map(|limits| 0.5 * (limits[0] + limits[1])), thickness_m, nodes)
    }

    /// Number of its wave numbers.
    pub(super) fn frequencies(&self) -> usize {
        self.at.len()
    }

    /// The same with these functions along the sides about `centre_m`.
    fn with(sides: [SideFunctions; 2], centre_m: [f64; 2], thickness_m: f64, nodes: &[(f64, f64)]) -> Self {
        let modes = (thickness_m > 0.0).then(|| [0, 1].map(|side| sides[side].modes()));
        let lengths = lengths(&sides);
        let factorised = |&(k, weight): &(f64, f64)| {
            let (first, even) = matrices(&sides, &lengths, modes.as_ref(), k, thickness_m);
            let mut even = even.into_iter();
            let blocks = first.into_iter().map(|s| (s.factorised(), even.next().map(Symmetric::factorised)));
            AtWaveNumber { k, weight, blocks: blocks.collect() }
        };
        let at = nodes.iter().map(factorised).collect();
        let centre = DVec3::new(centre_m[0], centre_m[1], 0.0);
        Self { centre, half_depth_m: 0.5 * thickness_m, sides, at }
    }

    /// Unknowns at one wave number.
    fn size(&self) -> usize {
        self.sides[0].count * self.sides[1].count
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
        let square = |a: &f64, b: &f64| (from.x - a).powi(2) + (from.y - b).powi(2) + z * z;
        let all = across_y.x_m.iter().flat_map(|b| across_x.x_m.iter().map(move |a| square(a, b).sqrt()));
        let lengths: Vec<f64> = all.collect();
        let (along_x, along_y) = (across_x.x_m.len(), across_y.x_m.len());
        // The free field at the places, x fastest, its real parts before its imaginary ones.
        let mut field = DMatrix::zeros(along_x, 2 * along_y);
        let mut moments = Parts { re: Vec::new(), im: Vec::new() };
        for at in &self.at {
            let (re, im) = field.as_mut_slice().split_at_mut(lengths.len());
            Arch::new().dispatch(Spherical { k: at.k, scale: 1.0, lengths: &lengths, re, im });
            let by_x = &across_x.functions * &field;
            let by_x = DMatrix::from_fn(along_y, 2 * x.count, |b, column| {
                by_x[(column % x.count, column / x.count * along_y + b)]
            });
            let by_both = &across_y.functions * by_x;
            let (re, im) = by_both.as_slice().split_at(self.size());
            self.by_parity(re, &mut moments.re);
            self.by_parity(im, &mut moments.im);
        }
        View(moments)
    }

    /// Appends moments, x slowest, in the order of the blocks.
    fn by_parity(&self, sums: &[f64], ordered: &mut Vec<f64>) {
        let [x, y] = &self.sides;
        ordered.reserve(sums.len());
        for (p, q) in PARITIES {
            for i in (p..x.count).step_by(2) {
                ordered.extend((q..y.count).step_by(2).map(|j| sums[i * y.count + j]));
            }
        }
    }

    /// The velocities that the field of `source` drives in the opening (far side).
    pub fn driven(&self, source: &View) -> Driven {
        let mut leaving = source.0.clone();
        let (mut re, mut im) = (&mut leaving.re[..], &mut leaving.im[..]);
        for (first, even) in self.at.iter().flat_map(|at| &at.blocks) {
            let (own_re, rest_re) = re.split_at_mut(first.size());
            let (own_im, rest_im) = im.split_at_mut(first.size());
            let part = even.as_ref().map(|even| {
                let (mut re, mut im) = (own_re.to_vec(), own_im.to_vec());
                even.solve(&mut re, &mut im);
                (re, im)
            });
            first.solve(own_re, own_im);
            if let Some((even_re, even_im)) = part {
                own_re.iter_mut().zip(even_re).for_each(|(value, even)| *value -= even);
                own_im.iter_mut().zip(even_im).for_each(|(value, even)| *value -= even);
            }
            (re, im) = (rest_re, rest_im);
        }
        Driven(leaving)
    }

    /// Intensity at a receiver relative to the source's free field at 1 m, mean over the wave numbers.
    pub fn intensity(&self, driven: &Driven, receiver: &View) -> f64 {
        self.pressures(driven, receiver).zip(&self.at).map(|(p, at)| at.weight * p.norm_sqr()).sum()
    }

    /// Pressures at a receiver relative to the modulus of the source's free field at 1 m, one a wave number.
    pub fn pressures(&self, driven: &Driven, receiver: &View) -> impl Iterator<Item = Complex64> {
        let size = self.size();
        (0..self.at.len()).map(move |at| dot(driven.0.part(at * size, size), receiver.0.part(at * size, size)))
    }
}

/// Parities along x and y, block after block.
const PARITIES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

/// `scale` times exp(ikR)/R over the `lengths` R, real and imaginary part, in the widest vectors of the machine.
struct Spherical<'a> {
    k: f64,
    scale: f64,
    lengths: &'a [f64],
    re: &'a mut [f64],
    im: &'a mut [f64],
}

impl WithSimd for Spherical<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for ((re, im), r) in self.re.iter_mut().zip(self.im).zip(self.lengths) {
            let (sin, cos) = sin_cos(self.k * r);
            let scale = self.scale / r;
            (*re, *im) = (scale * cos, scale * sin);
        }
    }
}

/// exp(ikR)/R between all separations along y and x, real and imaginary part, times 4 for both signs of either.
fn outside(sides: &[SideFunctions; 2], lengths: &[f64], k: f64) -> [DMatrix<f64>; 2] {
    let [x, y] = sides;
    let (rows, columns) = (y.separations_m().count(), x.separations_m().count());
    let mut parts = [DMatrix::zeros(rows, columns), DMatrix::zeros(rows, columns)];
    let [re, im] = &mut parts;
    Arch::new().dispatch(Spherical { k, scale: 4.0, lengths, re: re.as_mut_slice(), im: im.as_mut_slice() });
    parts
}

/// Lengths in m of all separations, those along y fastest.
fn lengths(sides: &[SideFunctions; 2]) -> Vec<f64> {
    let [x, y] = sides;
    x.separations_m().flat_map(|dx| y.separations_m().map(move |dy| dx.hypot(dy))).collect()
}

/// S at the wave number `k` and nothing, or through a gap S + Z_odd and S + Z_even: one matrix a pair of parities.
fn matrices(
    sides: &[SideFunctions; 2],
    lengths: &[f64],
    modes: Option<&[DMatrix<f64>; 2]>,
    k: f64,
    thickness_m: f64,
) -> (Vec<Symmetric>, Vec<Symmetric>) {
    let [x, y] = sides;
    let x_overlaps = x.overlaps().transpose();
    let [re, im] = outside(sides, lengths, k).map(|kernel| y.overlaps() * (kernel * &x_overlaps));
    let Some(modes) = modes else { return (blocks(sides, &re, &im), Vec::new()) };
    let [even, odd] = in_gap(sides, modes, k, thickness_m).map(|z| blocks(sides, &(&re + z), &im));
    (odd, even)
}

/// 2 pi times the impedances of the gap for the parts even and odd about the middle of the wall, by pairs of functions along y
/// and x.
fn in_gap(sides: &[SideFunctions; 2], modes: &[DMatrix<f64>; 2], k: f64, thickness_m: f64) -> [DMatrix<f64>; 2] {
    let [x, y] = sides;
    let area = 4.0 * x.half_m * y.half_m;
    let twice = |k: f64| if k == 0.0 { 1.0 } else { 2.0 };
    let (along_x, along_y): (Vec<f64>, Vec<f64>) = (x.mode_k().collect(), y.mode_k().collect());
    let mut parts = [0, 1].map(|_| DMatrix::zeros(along_y.len(), along_x.len()));
    for (p, kx) in along_x.iter().enumerate() {
        for (q, ky) in along_y.iter().enumerate() {
            let scale = TAU * twice(*kx) * twice(*ky) / area;
            let gamma = (kx * kx + ky * ky - k * k).max(0.0).sqrt();
            // Far below its cut-on a mode does not feel the other mouth.
            let both =
                if gamma * thickness_m > FADED { [1.0 / gamma; 2] } else { impedances(k, kx.hypot(*ky), thickness_m) };
            for (part, impedance) in parts.iter_mut().zip(both) {
                part[(q, p)] = scale * impedance;
            }
        }
    }
    let x_modes = modes[0].transpose();
    parts.map(|part| &modes[1] * (part * &x_modes))
}

/// Spreads values by pairs of functions along y and x over matrices between unknowns.
fn blocks(sides: &[SideFunctions; 2], re: &DMatrix<f64>, im: &DMatrix<f64>) -> Vec<Symmetric> {
    let [x, y] = sides;
    let block = |&(p, q): &(usize, usize)| {
        let (nx, ny) = (x.of_parity(p), y.of_parity(q));
        Symmetric::new(nx * ny, |a, b| {
            let pair = (y.pair(q, a % ny, b % ny), x.pair(p, a / ny, b / ny));
            Complex64::new(re[pair], im[pair])
        })
    };
    PARITIES.iter().map(block).collect()
}

/// Places along a side with the values of its functions (rows) times sqrt(1 - x^2) and the weight.
struct Nodes {
    x_m: Vec<f64>,
    functions: DMatrix<f64>,
}

/// Nodes along a side for the field of a point at `x_m` along it and `off_m` from it: x = a cos(tau).
///
/// The field is singular at tau with cos(tau) = (x + i off)/a. Far from the real axis even steps of tau converge
/// exponentially at the rate of that distance; near it Gauss panels grow from it.
fn nodes(side: &SideFunctions, x_m: f64, off_m: f64, k: f64) -> Nodes {
    let pole = Complex64::new(x_m / side.half_m, off_m / side.half_m).acosh();
    let (near, at) = (pole.re.abs().max(1e-7), pole.im.abs());
    let phase = side.terms() as f64 + k * side.half_m;
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
        side.values(tau.cos(), values);
        values.iter_mut().for_each(|value| *value *= weight);
    }
    let x_m = taus.iter().map(|(tau, _)| side.half_m * tau.cos()).collect();
    Nodes { x_m, functions: DMatrix::from_vec(side.count, taus.len(), functions) }
}

/// Transmitted power of a diffuse field over the power that meets the area of the opening, mean over the wave numbers `nodes`.
///
/// A plane wave with the moments b drives c = 2 pi D b (D = S^-1, through a gap the difference of the two parts' inverses) and
/// sends c* R c/(2 pi k) with R = Im S. The mean of b b* over all directions is R/k again, for the mean of exp(i k s.r) over the
/// sphere is sin(kr)/(kr): T = 4 pi tr(R D R D*)/(k^2 area), no direction being summed.
pub fn diffuse_transmission(width_m: f64, height_m: f64, thickness_m: f64, nodes: &[(f64, f64)]) -> f64 {
    let highest = nodes.iter().fold(0.0_f64, |k, node| k.max(node.0));
    let sides = SideFunctions::of_rectangle([width_m, height_m], thickness_m, highest);
    let modes = (thickness_m > 0.0).then(|| [0, 1].map(|side| sides[side].modes()));
    let lengths = lengths(&sides);
    let at = |k: f64| {
        let (thin, _) = matrices(&sides, &lengths, None, k, 0.0);
        let (odd, even) = matrices(&sides, &lengths, modes.as_ref(), k, thickness_m);
        let mut even = even.into_iter();
        let blocks = odd.into_iter().map(|odd| (odd.factorised(), even.next().map(Symmetric::factorised)));
        let traces = blocks.zip(&thin).map(|((odd, even), outside)| {
            let solved = |factors: &Symmetric, column: usize| {
                let mut x = Parts::zeros(outside.size());
                x.re.iter_mut().enumerate().for_each(|(row, re)| *re = outside.imaginary(row, column));
                factors.solve(&mut x.re, &mut x.im);
                x
            };
            // The columns of D R.
            let columns: Vec<Parts> = (0..outside.size())
                .map(|column| {
                    let mut leaving = solved(&odd, column);
                    even.iter().for_each(|even| leaving.subtract(&solved(even, column)));
                    leaving
                })
                .collect();
            let mut trace = 0.0;
            for (i, column) in columns.iter().enumerate() {
                for (j, row) in columns.iter().enumerate() {
                    trace += column.re[j] * row.re[i] + column.im[j] * row.im[i];
                }
            }
            trace
        });
        2.0 * TAU * traces.sum::<f64>() / (k * k * width_m * height_m)
    };
    nodes.iter().map(|(k, weight)| weight * at(*k)).sum()
}

#[cfg(test)]
mod tests {
    use super::super::slit::gauss_nodes;
    use super::*;

    #[test]
    fn few_functions_across_slender_openings_do() {
        // Against three functions more and none spared; probes from 0.15 longer sides, both directions to 83 degrees.
        let mut numbers = 0..;
        let mut random = || (f64::from(numbers.next().unwrap_or(0)) * 0.754_877_666_246_693).fract();
        for (width, ratio, depth, phase) in [
            (0.001, 30.0, 40.0, 0.02),
            (0.001, 20.0, 0.5, 0.6),
            (0.02, 8.1, 1.2, 0.3),
            (0.02, 10.0, 0.0, 0.05),
            (0.05, 16.0, 0.8, 0.6),
            (0.05, 5.0, 0.8, 2.5),
            (0.3, 6.0, 0.1, 0.05),
            (0.3, 4.5, 0.3, 1.2),
        ] {
            let (length, depth, k) = (width * ratio, width * depth, 2.0 * phase / width);
            let nodes: Vec<(f64, f64)> = gauss_nodes(0.7 * k, k, 6).collect();
            let [x_m, y_m] = [width, length].map(|side| [-0.5 * side, 0.5 * side]);
            let few = Hatch::new(x_m, y_m, depth, &nodes);
            let many = [width, length].map(|side| SideFunctions::with(3, side, k));
            let many = Hatch::with(many, [0.0; 2], depth, &nodes);
            assert!(few.sides[0].count < many.sides[0].count - 3);
            for near in [0.15, 0.3, 0.6, 2.0] {
                let mut point = |near: f64, sign: f64| {
                    let (theta, phi, r) = (1.45 * random(), TAU * random(), length * near);
                    let z = sign * (r * theta.cos() + 0.5 * depth);
                    DVec3::new(r * theta.sin() * phi.cos(), r * theta.sin() * phi.sin(), z)
                };
                let (from, to) = (point(0.6, -1.0), point(near, 1.0));
                let level = |h: &Hatch| 10.0 * h.intensity(&h.driven(&h.view(from)), &h.view(to)).log10();
                let error = level(&few) - level(&many);
                assert!(error.abs() < 0.03, "{width} x {length}, {depth} deep, {phase}, {near}: {error}");
            }
        }
    }

    #[test]
    fn a_small_square_hole_conducts_like_the_capacity_of_a_square_plate() {
        // A plate of side a has the capacity 0.366789 a (Read 1997), the hole the flow 2 pi times that: 2 pi 0.366789^2 at normal
        // incidence, and as much from everywhere, while the power that meets it falls with the cosine: twice of it.
        let got = diffuse_transmission(0.1, 0.1, 0.0, &[(0.01, 1.0)]);
        // The functions do not know the corners.
        assert!((got / (2.0 * 0.845_306) - 1.0).abs() < 1e-3, "{got}");
    }

    #[test]
    fn a_wide_hole_passes_what_meets_it_and_a_strip_along_its_edges() {
        // At normal incidence Bouwkamp's circle passes 0.998 at k times radius 10. From everywhere every edge takes in a strip of some
        // 1/(2 k), and the depth turns some of it back.
        for (depth, excess) in [(0.0, 0.5), (0.1, 0.35)] {
            let got = [15.0, 30.0].map(|k| (diffuse_transmission(1.0, 1.0, depth, &[(k, 1.0)]) - 1.0) * k / 4.0);
            assert!(got.iter().all(|g| (g - excess).abs() < 0.1), "{depth}: {got:?}");
        }
    }

    #[test]
    fn the_diffuse_transmission_is_the_mean_over_all_pairs_of_directions() {
        // Sources and receivers all round, far away: 1/pi of the mean of I r_i^2 r_o^2 over both hemispheres (2 pi)^2, over the area.
        const POINTS: usize = 60;
        const FAR_M: f64 = 300.0;
        for (width, height, depth, k) in [(0.3, 0.5, 0.0, 6.0), (0.05, 0.6, 0.2, 4.0), (0.4, 0.4, 0.3, 9.0)] {
            let hatch = Hatch::new([0.0, width], [0.0, height], depth, &[(k, 1.0)]);
            let point = |i: usize, side: f64| {
                let (z, turn) = ((i as f64 + 0.5) / POINTS as f64, 0.618_034 * TAU * i as f64);
                let r = (1.0 - z * z).sqrt();
                FAR_M * DVec3::new(r * turn.cos(), r * turn.sin(), side * z)
            };
            let receivers: Vec<View> = (0..POINTS).map(|i| hatch.view(point(i, 1.0))).collect();
            let sum: f64 = (0..POINTS)
                .map(|i| hatch.driven(&hatch.view(point(i, -1.0))))
                .map(|driven| receivers.iter().map(|r| hatch.intensity(&driven, r)).sum::<f64>())
                .sum();
            let expected = sum / (POINTS * POINTS) as f64 * FAR_M.powi(4) * TAU * TAU / (PI * width * height);
            let got = diffuse_transmission(width, height, depth, &[(k, 1.0)]);
            // 60 directions a side.
            assert!((got / expected - 1.0).abs() < 0.02, "{width} x {height} x {depth} m: {got} {expected}");
        }
    }
}
