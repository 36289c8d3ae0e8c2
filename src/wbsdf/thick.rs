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
//! and v_odd - v_even leaves the far mouth. For large m both Z tend to a/(m pi), whose sum is closed: a logarithm like
//! that of S and its mirror image in the jamb. The corner of 270 degrees makes v grow like r^(-1/3); nodes graded after
//! Kress (1990) take that out, and the logarithm is integrated exactly (Martensen; Kress 1989). Derived in
//! docs/physics.md section 2. Rigid jambs, no viscous losses.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{DMatrix, DVector, Dyn, LU};
use num_complex::Complex64;

use super::aperture::{EULER_GAMMA, hankel0, line_transfer};
use super::crossing::{Crossing, Incident};

/// Exponent of the grading: v dx/ds vanishes like s^(2 q/3 - 1) at the jambs.
const GRADING: i32 = 6;
/// Distance from the nodes, in node distances, from which the sum over them is accurate.
const RESOLVED: f64 = 2.5;
/// Most times the nodes are refined for points next to the mouth.
const MOST_FINER: f64 = 32.0;
const HALF_I: Complex64 = Complex64 { re: 0.0, im: 0.5 };

/// A node of an opening: shares of its width to the low and to the high jamb, each exact where it is small, and
/// dx/ds in m.
#[derive(Clone, Copy)]
struct Node {
    x_m: f64,
    low: f64,
    high: f64,
    slope_m: f64,
}

/// One opening's graded nodes: s = j pi/half for j = 1..2 half.
struct Mouth {
    start: usize,
    half: usize,
    width_m: f64,
    nodes: Vec<Node>,
}

/// The factorised equations of openings in one thick wall at one wave number.
pub struct ThickAperture {
    k: f64,
    thickness_m: f64,
    mouths: Vec<Mouth>,
    even: Factors,
    odd: Factors,
}

/// A factorised matrix.
enum Factors {
    Whole(LU<Complex64, Dyn, Dyn>),
    /// One that mirroring x leaves as it is: for symmetric and antisymmetric vectors, a quarter of the work.
    Mirrored(LU<Complex64, Dyn, Dyn>, LU<Complex64, Dyn, Dyn>),
}

/// Half the number of intervals for an opening of width `ka` (k times width) and `flatness` (width over depth, at which scale
/// its modes fade): the level behind it is converged to 0.02 dB.
fn half_intervals(ka: f64, flatness: f64) -> usize {
    12 + (0.6 * ka + 0.25 * flatness).ceil() as usize
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
    if square >= 0.0 {
        [-1.0 / (half.tan() * gamma), half.tan() / gamma]
    } else {
        [1.0 / (half.tanh() * gamma), half.tanh() / gamma]
    }
}

/// Whether the depth of a gap of `width_m` counts: below 1/100 of the width it changes levels by less than 0.08 dB.
pub fn is_thick(width_m: f64, thickness_m: f64) -> bool {
    100.0 * thickness_m > width_m
}

impl ThickAperture {
    /// Sets up and factorises the equations for disjoint, finite openings (limits in m) through a wall of
    /// `thickness_m` > 0 at wave number `k` in 1/m.
    pub fn new(openings: &[[f64; 2]], thickness_m: f64, k: f64) -> Self {
        let mut mouths: Vec<Mouth> = Vec::new();
        let mut total = 0;
        for &opening in openings {
            let width_m = opening[1] - opening[0];
            let half = half_intervals(k * width_m, width_m / thickness_m);
            mouths.push(Mouth { start: total, half, width_m, nodes: nodes(opening, half) });
            total += 2 * half - 1;
        }
        let mut outside = DMatrix::<Complex64>::zeros(total, total);
        for a in &mouths {
            for b in mouths.iter().filter(|b| b.start != a.start) {
                let step = PI / b.half as f64;
                for (i, from) in a.nodes.iter().enumerate() {
                    for (j, to) in b.nodes.iter().enumerate() {
                        outside[(a.start + i, b.start + j)] = HALF_I * step * hankel0(k * (from.x_m - to.x_m).abs());
                    }
                }
            }
        }
        let (mut even, mut odd) = (outside.clone(), outside);
        for mouth in &mouths {
            mouth.add(k, thickness_m, &mut even, &mut odd);
        }
        let mirrored = mouths.len() == 1;
        Self { k, thickness_m, mouths, even: Factors::new(even, mirrored), odd: Factors::new(odd, mirrored) }
    }

    /// |p/p_free|^2 of `crossing`, whose distances count from the middle of the wall; p_free is the field with the wall
    /// taken away.
    pub fn transfer(&self, crossing: &Crossing) -> f64 {
        let depth = 0.5 * self.thickness_m;
        match crossing.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                line_transfer(self.k, (x_m, z_m), (crossing.x_m, crossing.z_m), |far, near| {
                    let strengths = self.solve(|x| 0.5 * HALF_I * hankel0(self.k * (x - far.0).hypot(far.1 - depth)));
                    self.pressure(&strengths, near.0, near.1 - depth)
                })
            }
            Incident::Plane { s_x, s_y } => {
                let k_x = self.k * s_x / (1.0 - s_y * s_y).sqrt();
                let strengths = self.solve(|x| Complex64::from_polar(1.0, k_x * x));
                self.pressure(&strengths, crossing.x_m, crossing.z_m - depth).norm_sqr()
            }
        }
    }

    /// Far-field amplitude in m towards sin(theta_o) of a unit plane wave from sin(theta_i), as
    /// [`Solution::far_amplitude`](super::aperture::Solution::far_amplitude).
    pub fn far_amplitude(&self, sin_i: f64, sin_o: &[f64]) -> Vec<Complex64> {
        let strengths = self.solve(|x| Complex64::from_polar(1.0, self.k * x * sin_i));
        let nodes: Vec<f64> = self.mouths.iter().flat_map(|m| &m.nodes).map(|n| n.x_m).collect();
        let towards = |sin_o: f64| {
            nodes
                .iter()
                .zip(&strengths)
                .map(|(x, s)| Complex64::from_polar(1.0, -self.k * x * sin_o) * s)
                .sum::<Complex64>()
        };
        sin_o.iter().map(|s| towards(*s) / TAU).collect()
    }

    /// v dx/ds times the step at the nodes of the far mouth, for the incident pressure `p_inc(x)` at the near one.
    fn solve(&self, p_inc: impl Fn(f64) -> Complex64) -> Vec<Complex64> {
        let positions = self.mouths.iter().flat_map(|m| &m.nodes).map(|n| p_inc(n.x_m));
        let right = DVector::from_vec(positions.collect());
        let leaving = self.odd.solve(&right) - self.even.solve(&right);
        let steps = self.mouths.iter().flat_map(|m| m.nodes.iter().map(|_| PI / m.half as f64));
        leaving.iter().zip(steps).map(|(v, step)| v * step).collect()
    }

    /// Pressure at (x, z), z > 0 behind the far mouth, in m.
    fn pressure(&self, strengths: &[Complex64], x_m: f64, z_m: f64) -> Complex64 {
        let sum_over = |places: &mut dyn Iterator<Item = (f64, Complex64)>| -> Complex64 {
            places.map(|(x, s)| hankel0(self.k * (x_m - x).hypot(z_m)) * s).sum()
        };
        let mut sum = Complex64::ZERO;
        for mouth in &self.mouths {
            let own = &strengths[mouth.start..mouth.start + mouth.nodes.len()];
            let nearest = mouth.nodes.iter().map(|n| (x_m - n.x_m).hypot(z_m)).fold(f64::INFINITY, f64::min);
            // In the middle the nodes are twice as far apart as even ones.
            let spacing = mouth.width_m / mouth.half as f64;
            sum += if nearest > RESOLVED * spacing {
                sum_over(&mut mouth.nodes.iter().map(|n| n.x_m).zip(own.iter().copied()))
            } else {
                let finer = (RESOLVED * spacing / nearest.max(1e-6 * spacing)).ceil().min(MOST_FINER) as usize;
                sum_over(&mut mouth.refined(own, finer).into_iter())
            };
        }
        HALF_I * sum
    }
}

impl Factors {
    fn new(matrix: DMatrix<Complex64>, mirrored: bool) -> Self {
        if !mirrored {
            return Self::Whole(matrix.lu());
        }
        let (n, half) = (matrix.nrows(), matrix.nrows() / 2);
        let part = |size: usize, sign: f64| {
            let folded = |i: usize, j: usize| match n - 1 - j == j {
                true => matrix[(i, j)],
                false => matrix[(i, j)] + sign * matrix[(i, n - 1 - j)],
            };
            DMatrix::from_fn(size, size, folded).lu()
        };
        Self::Mirrored(part(n - half, 1.0), part(half, -1.0))
    }

    /// The equations are uniquely solvable; a failed factorisation means empty openings: silence.
    fn solve(&self, right: &DVector<Complex64>) -> DVector<Complex64> {
        let solved = |factors: &LU<Complex64, Dyn, Dyn>, right: &DVector<Complex64>| {
            factors.solve(right).unwrap_or_else(|| DVector::zeros(right.len()))
        };
        match self {
            Self::Whole(factors) => solved(factors, right),
            Self::Mirrored(symmetric, antisymmetric) => {
                let n = right.len();
                let half =
                    |size: usize, sign: f64| DVector::from_fn(size, |i, _| 0.5 * (right[i] + sign * right[n - 1 - i]));
                let same = solved(symmetric, &half(n - n / 2, 1.0));
                let opposite = solved(antisymmetric, &half(n / 2, -1.0));
                DVector::from_fn(n, |i, _| {
                    let mirror = n - 1 - i;
                    let odd = if i < n / 2 {
                        opposite[i]
                    } else if mirror < n / 2 {
                        -opposite[mirror]
                    } else {
                        Complex64::ZERO
                    };
                    same[i.min(mirror)] + odd
                })
            }
        }
    }
}

impl Mouth {
    /// Adds the mouth's own blocks to the even and the odd matrix.
    fn add(&self, k: f64, thickness_m: f64, even: &mut DMatrix<Complex64>, odd: &mut DMatrix<Complex64>) {
        let (n, a) = (self.nodes.len(), self.width_m);
        let step = PI / self.half as f64;
        // What the modes add to their asymptote a/(m pi), m = 1, 2, ...: it falls like m^-3 once a mode fades in the gap.
        let count = 40 + (2.0 * k * a / PI + 8.0 * a / (PI * thickness_m)).ceil() as usize;
        let modes: Vec<[f64; 2]> = (0..count)
            .map(|m| {
                let z = impedances(k, m as f64 * PI / a, thickness_m);
                if m == 0 { z.map(|z| z / a) } else { z.map(|z| 2.0 * (z - a / (m as f64 * PI)) / a) }
            })
            .collect();
        let shapes: Vec<Vec<f64>> =
            self.nodes.iter().map(|p| (0..count).map(|m| (m as f64 * PI * p.low).cos()).collect()).collect();
        // Weights of ln(4 sin^2((s - s')/2)) by |i - j| (Kress 1989, eq. 12.19 for 2 half nodes).
        let logarithm: Vec<f64> = (0..n)
            .map(|d| {
                let series: f64 = (1..self.half).map(|m| (m as f64 * d as f64 * step).cos() / m as f64).sum();
                let last = if d % 2 == 0 { 1.0 } else { -1.0 };
                -2.0 * step * series - last * step / self.half as f64
            })
            .collect();
        for i in 0..n {
            for j in 0..=i {
                let (p, q) = (&self.nodes[i], &self.nodes[j]);
                // Differences and sums of shares from the nearer jamb, free of cancellation.
                let (apart, mirrored) = match p.low < 0.5 && q.low < 0.5 {
                    true => ((p.low - q.low).abs(), p.low + q.low),
                    false => ((p.high - q.high).abs(), p.high + q.high),
                };
                let image = -(2.0 * (FRAC_PI_2 * mirrored).sin().abs()).ln() / PI;
                let (j0, rest) = if i == j {
                    let outside = Complex64::new(-((0.5 * k * p.slope_m).ln() + EULER_GAMMA) / PI, 0.5);
                    (1.0, outside - (PI * p.slope_m / a).ln() / PI)
                } else {
                    let h = HALF_I * hankel0(k * a * apart);
                    let j0 = libm::j0(k * a * apart);
                    let inside = -(2.0 * (FRAC_PI_2 * apart).sin()).ln() / PI;
                    let periodic = (4.0 * (0.5 * (i - j) as f64 * step).sin().powi(2)).ln();
                    (j0, h + inside + (j0 + 1.0) * periodic / TAU)
                };
                let common = step * (rest + image) - (j0 + 1.0) * logarithm[i - j] / TAU;
                let (mut own_even, mut own_odd) = (0.0, 0.0);
                for ((z, p), q) in modes.iter().zip(&shapes[i]).zip(&shapes[j]) {
                    own_even += z[0] * p * q;
                    own_odd += z[1] * p * q;
                }
                for (matrix, own) in [(&mut *even, own_even), (&mut *odd, own_odd)] {
                    matrix[(self.start + i, self.start + j)] = common + step * own;
                    matrix[(self.start + j, self.start + i)] = common + step * own;
                }
            }
        }
    }

    /// Strengths on `finer` times as many nodes, by their sine series (they vanish at both jambs).
    fn refined(&self, strengths: &[Complex64], finer: usize) -> Vec<(f64, Complex64)> {
        let count = 2 * self.half;
        let sine = |m: usize, s: f64| (0.5 * m as f64 * s).sin();
        let step = PI / self.half as f64;
        let coefficients: Vec<Complex64> = (1..count)
            .map(|m| {
                let sum: Complex64 =
                    strengths.iter().enumerate().map(|(j, v)| v * sine(m, (j + 1) as f64 * step)).sum();
                sum * 2.0 / (count * finer) as f64
            })
            .collect();
        let opening = [self.nodes[0].x_m - self.width_m * self.nodes[0].low, 0.0];
        nodes([opening[0], opening[0] + self.width_m], self.half * finer)
            .iter()
            .enumerate()
            .map(|(i, node)| {
                let s = (i + 1) as f64 * step / finer as f64;
                (node.x_m, coefficients.iter().zip(1..).map(|(c, m)| c * sine(m, s)).sum())
            })
            .collect()
    }
}
