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

use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

use super::aperture::{EULER_GAMMA, distances, line_transfer};
use super::crossing::{Crossing, Incident};
use super::factors::{Factors, mirrored};
use super::hankel::{hankel0, hankel0_each, sin_cos};
use super::slit::fade;

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

/// Half the number of intervals for an opening of width `ka` (k times width) and `flatness` (width over depth, at which scale
/// its modes fade): the level behind it is converged to 0.02 dB.
fn half_intervals(ka: f64, flatness: f64) -> usize {
    12 + (0.42 * ka + 0.25 * flatness).ceil() as usize
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
        for &opening in openings {
            let width_m = opening[1] - opening[0];
            let half = finer * half_intervals(resolved_k * width_m, width_m / thickness_m);
            mouths.push(Mouth { start: total, half, width_m, nodes: nodes(opening, half) });
            total += 2 * half - 1;
        }
        let mut outside = DMatrix::<Complex64>::zeros(total, total);
        for a in &mouths {
            for b in mouths.iter().filter(|b| b.start != a.start) {
                for (i, from) in a.nodes.iter().enumerate() {
                    for (j, to) in b.nodes.iter().enumerate() {
                        outside[(a.start + i, b.start + j)] = HALF_I * hankel0(k * (from.x_m - to.x_m).abs());
                    }
                }
            }
        }
        let (mut even, mut odd) = (outside.clone(), outside);
        for mouth in &mouths {
            mouth.add(k, thickness_m, &mut even, &mut odd);
        }
        let mirrored = mirrored(openings);
        Self { k, thickness_m, mouths, even: Factors::new(&even, mirrored), odd: Factors::new(&odd, mirrored) }
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
        self.mouths.iter().flat_map(|m| &m.nodes).map(|n| n.x_m).collect()
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
            let own = &strengths[mouth.start..mouth.start + mouth.nodes.len()];
            let places: Vec<f64> = mouth.nodes.iter().map(|n| n.x_m).collect();
            let nearest = distances(&places, 1.0, x_m, z_m).into_iter().fold(f64::INFINITY, f64::min);
            // In the middle the nodes are twice as far apart as even ones.
            let spacing = mouth.width_m / mouth.half as f64;
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

impl Mouth {
    /// Adds the mouth's own blocks, over the step, to the even and the odd matrix.
    fn add(&self, k: f64, thickness_m: f64, even: &mut DMatrix<Complex64>, odd: &mut DMatrix<Complex64>) {
        let (n, a) = (self.nodes.len(), self.width_m);
        let step = PI / self.half as f64;
        // What the modes add to their asymptote a/(m pi), m = 1, 2, ...: it falls like m^-3 once a mode fades in the gap.
        let count = 40 + (2.0 * k * a / PI + 8.0 * a / (PI * thickness_m)).ceil() as usize;
        // Everything is the same seen from the other jamb: half of the nodes, and even and odd modes apart.
        let half = n.div_ceil(2);
        let shares = |parity: usize, which: usize| {
            let modes = (parity..count).step_by(2);
            let shapes =
                DMatrix::from_fn(half, modes.len(), |i, m| sin_cos((2 * m + parity) as f64 * PI * self.nodes[i].low).1);
            let mut weighted = shapes.clone();
            for (mut column, m) in weighted.column_iter_mut().zip(modes) {
                let z = impedances(k, m as f64 * PI / a, thickness_m)[which];
                column *= if m == 0 { z / a } else { 2.0 * (z - a / (m as f64 * PI)) / a };
            }
            shapes * weighted.transpose()
        };
        let own = [0, 1].map(|which| [shares(0, which), shares(1, which)]);
        // ln(4 sin^2((s - s')/2)) by |i - j|, and its quadrature weights over the step (Kress 1989, eq. 12.19 for 2 half nodes).
        let cosines: Vec<f64> = (0..2 * self.half).map(|d| (d as f64 * step).cos()).collect();
        let inverses: Vec<f64> = (1..self.half).map(|m| 1.0 / m as f64).collect();
        let logarithm: Vec<(f64, f64)> = (0..n)
            .map(|d| {
                let mut at = 0;
                let series: f64 = inverses
                    .iter()
                    .map(|inverse| {
                        at += d;
                        at -= if at >= cosines.len() { cosines.len() } else { 0 };
                        cosines[at] * inverse
                    })
                    .sum();
                let last = if d % 2 == 0 { 1.0 } else { -1.0 };
                let periodic = if d == 0 { 0.0 } else { (4.0 * (0.5 * d as f64 * step).sin().powi(2)).ln() };
                (periodic, -2.0 * series - last / self.half as f64)
            })
            .collect();
        // sin(pi/2 share): sin(pi/2 (p - q)) sin(pi/2 (p + q)) is the difference of their squares.
        let sines: Vec<[f64; 2]> = self.nodes.iter().map(|p| [p.low, p.high].map(|x| (FRAC_PI_2 * x).sin())).collect();
        for i in 0..half {
            for j in i..n - i {
                let (p, q) = (&self.nodes[i], &self.nodes[j]);
                let (periodic, weight) = logarithm[j - i];
                let (j0, rest) = if i == j {
                    let outside = Complex64::new(-((0.5 * k * p.slope_m).ln() + EULER_GAMMA) / PI, 0.5);
                    let image = (2.0 * (PI * p.low).sin()).ln();
                    (1.0, outside - ((PI * p.slope_m / a).ln() + image) / PI)
                } else {
                    // From the nearer jamb, free of cancellation.
                    let (apart, near) = if q.low < 0.5 { (q.low - p.low, 0) } else { (p.high - q.high, 1) };
                    let h = HALF_I * hankel0(k * a * apart);
                    let (s, t) = (sines[i][near], sines[j][near]);
                    let inside_and_image = (4.0 * ((s - t) * (s + t)).abs()).ln();
                    // (i/2) H0 has J0/2 as its imaginary part.
                    let j0 = 2.0 * h.im;
                    (j0, h - inside_and_image / PI + (j0 + 1.0) * periodic / TAU)
                };
                let common = rest - (j0 + 1.0) * weight / TAU;
                for (matrix, [same, opposite]) in [&mut *even, &mut *odd].into_iter().zip(&own) {
                    let modes = match j < half {
                        true => same[(i, j)] + opposite[(i, j)],
                        false => same[(i, n - 1 - j)] - opposite[(i, n - 1 - j)],
                    };
                    let value = common + modes;
                    for (row, column) in [(i, j), (j, i), (n - 1 - i, n - 1 - j), (n - 1 - j, n - 1 - i)] {
                        matrix[(self.start + row, self.start + column)] = value;
                    }
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
