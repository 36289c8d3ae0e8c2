//! The exact aperture: openings in a rigid thin plane screen, solved as an integral equation.
//!
//! Openings narrower than a wavelength or so are beyond any ray model (Kirchhoff is 13 dB wrong at ka = 0.2). With the
//! rigid screen's Green's function the pressure behind the screen is p(r) = (i/2) int H0(k|r - x'|) u(x') dx', u the
//! normal velocity (times i omega rho) in the openings, and continuity asks for
//!
//! ```text
//! (i/2) int H0(k|x - x'|) u(x') dx' = p_inc(x)   in the openings.
//! ```
//!
//! On an opening with centre m and half width b, x = m + b cos(tau) removes the edge singularity of u, and the
//! logarithm of the kernel is integrated exactly on Chebyshev nodes (Kress 1989, Yan and Sloan 1988): the error falls
//! spectrally. Time factor exp(-i omega t); two dimensions, wave number k (k sin(beta) for oblique incidence along the
//! edges).

use std::f64::consts::{FRAC_2_PI, LN_2, PI};

use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

use super::crossing::{Crossing, Incident};
use super::factors::{Factors, mirrored};
use super::hankel::{hankel0, hankel0_each};

pub(super) const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;
/// Distance from the nodes, in node distances, from which the sum over them is accurate (1e-6).
const RESOLVED: f64 = 2.5;
/// Most times the nodes are refined for points next to the opening.
const MOST_FINER: f64 = 64.0;
const HALF_I: Complex64 = Complex64 { re: 0.0, im: 0.5 };

/// The factorised integral equation of a set of openings at one wave number.
pub struct Aperture {
    k: f64,
    /// Chebyshev nodes in m, opening after opening.
    nodes: Vec<f64>,
    /// Angular step pi/n of the opening of each node.
    steps: Vec<f64>,
    factors: Factors,
}

/// The normal velocity in the openings for one incident field.
pub struct Solution<'a> {
    aperture: &'a Aperture,
    /// u b sin(tau) times the quadrature weight, at the nodes.
    strengths: DVector<Complex64>,
}

/// Unknowns for one of `openings` of width `ka` (k times width): the relative error of the far field is below 1e-6 for
/// sources no nearer than a fifth of the width; 1e-4 and a width where there are several openings.
fn unknowns(ka: f64, openings: usize) -> usize {
    let least = if openings == 1 { 12 } else { 7 };
    least + (0.75 * ka).ceil() as usize
}

impl Aperture {
    /// Sets up and factorises the equation for disjoint, finite openings (limits in m) at wave number `k` in 1/m.
    pub fn new(openings: &[[f64; 2]], k: f64) -> Self {
        Self::finer(openings, k, 1)
    }

    /// The same with `finer` times as many unknowns.
    pub(super) fn finer(openings: &[[f64; 2]], k: f64, finer: usize) -> Self {
        Self::resolved(openings, k, k, finer)
    }

    /// The same on the nodes that the wave number `resolved_k` >= k asks for.
    pub(super) fn resolved(openings: &[[f64; 2]], k: f64, resolved_k: f64, finer: usize) -> Self {
        let mut nodes = Vec::new();
        let mut steps = Vec::new();
        let mut blocks = Vec::new();
        for o in openings {
            let n = finer * unknowns(resolved_k * (o[1] - o[0]), openings.len());
            let (middle, half) = (0.5 * (o[0] + o[1]), 0.5 * (o[1] - o[0]));
            blocks.push((nodes.len(), n, half));
            let step = PI / n as f64;
            nodes.extend((0..n).map(|j| middle + half * ((j as f64 + 0.5) * step).cos()));
            steps.extend(std::iter::repeat_n(step, n));
        }
        let total = nodes.len();
        let mut matrix = DMatrix::<Complex64>::zeros(total, total);
        for i in 0..total {
            for j in 0..i {
                let h = hankel0(k * (nodes[i] - nodes[j]).abs());
                matrix[(i, j)] = HALF_I * h;
                matrix[(j, i)] = HALF_I * h;
            }
        }
        for &(start, n, half) in &blocks {
            add_logarithm(&mut matrix, start, n, k, half);
        }
        Self { k, nodes, steps, factors: Factors::new(&matrix, mirrored(openings)) }
    }

    /// Solves for the incident pressure at the nodes.
    fn solve(&self, p_inc: Vec<Complex64>) -> Solution<'_> {
        Solution { aperture: self, strengths: self.strengths(p_inc) }
    }

    /// u dx at the nodes, of its quadrature, for the incident pressure there.
    pub(super) fn strengths(&self, p_inc: Vec<Complex64>) -> DVector<Complex64> {
        self.factors.solve(&DVector::from_vec(p_inc))
    }

    /// `shapes`^T times what leaves the openings for each of the columns of `shapes` as incident pressure at the nodes.
    pub(super) fn moments(&self, shapes: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        self.factors.moments(shapes)
    }

    /// The nodes' places across the openings in m.
    pub(super) fn positions(&self) -> &[f64] {
        &self.nodes
    }

    /// Wave number across the edges in 1/m.
    pub(super) fn wave_number(&self) -> f64 {
        self.k
    }

    /// Solves for the source of `crossing` in the plane across the edges: unit strength (i/4) H0 for line and point
    /// sources, unit amplitude for a plane wave.
    pub fn solve_for(&self, incident: &Incident) -> Solution<'_> {
        match *incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                let mut p_inc = hankel0_each(&distances(&self.nodes, self.k, x_m, z_m));
                for p in &mut p_inc {
                    *p *= 0.5 * HALF_I;
                }
                self.solve(p_inc)
            }
            Incident::Plane { s_x, s_y } => {
                let k_x = self.k * s_x / (1.0 - s_y * s_y).sqrt();
                self.solve(self.nodes.iter().map(|x| Complex64::from_polar(1.0, k_x * x)).collect())
            }
        }
    }

    /// p/|p_free| of `crossing` at this wave number; p_free is the field of the source ((i/4) H0 of a line in the plane
    /// across the edges) with the screen taken away.
    pub fn transfer(&self, crossing: &Crossing) -> Complex64 {
        match crossing.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                line_transfer(self.k, (x_m, z_m), (crossing.x_m, crossing.z_m), |far, near| {
                    self.solve_for(&Incident::Line { x_m: far.0, z_m: far.1 }).pressure(near.0, near.1)
                })
            }
            Incident::Plane { .. } => self.solve_for(&crossing.incident).pressure(crossing.x_m, crossing.z_m),
        }
    }
}

/// p/|p_free| of a line source at wave number `k`; both places as (x, distance from the plane) in m. Source and receiver
/// may change places: `pressure` gets the farther one first, which makes the smoother incident field.
pub(super) fn line_transfer(
    k: f64,
    source: (f64, f64),
    receiver: (f64, f64),
    pressure: impl FnOnce((f64, f64), (f64, f64)) -> Complex64,
) -> Complex64 {
    let free = 0.25 * hankel0(k * (receiver.0 - source.0).hypot(receiver.1 + source.1)).norm();
    let (far, near) = if source.1 < receiver.1 { (receiver, source) } else { (source, receiver) };
    pressure(far, near) / free
}

/// `scale` times the distances of the nodes from (x, z).
pub(super) fn distances(nodes: &[f64], scale: f64, x_m: f64, z_m: f64) -> Vec<f64> {
    nodes.iter().map(|x| scale * ((x_m - x) * (x_m - x) + z_m * z_m).sqrt()).collect()
}

/// Replaces the naive quadrature of an opening's own block by the one that is exact for its logarithm, both over the step.
fn add_logarithm(matrix: &mut DMatrix<Complex64>, start: usize, n: usize, k: f64, half: f64) {
    let step = PI / n as f64;
    // cos(j step/2): every angle below is a multiple of half a step.
    let cosines: Vec<f64> = (0..4 * n).map(|j| (0.5 * j as f64 * step).cos()).collect();
    // ln|cos tau_i - cos tau_j| = -ln 2 - sum_m (2/m) cos(m tau_i) cos(m tau_j): its quadrature weights divided by the
    // step, by differences and sums of indices: cos a cos b = [cos(a-b) + cos(a+b)]/2 with (a +- b) = m step * integer.
    let series: Vec<f64> = (0..2 * n).map(|d| (1..n).map(|m| cosines[2 * m * d % (4 * n)] / m as f64).sum()).collect();
    for i in 0..n {
        for j in 0..n {
            let exact = -LN_2 - series[i.abs_diff(j)] - series[i + j + 1];
            let (j0, remainder) = if i == j {
                (1.0, Complex64::new(1.0, FRAC_2_PI * ((0.5 * k * half).ln() + EULER_GAMMA)))
            } else {
                let distance = (cosines[2 * i + 1] - cosines[2 * j + 1]).abs();
                let naive = matrix[(start + i, start + j)] / HALF_I;
                (naive.re, naive - Complex64::new(0.0, FRAC_2_PI * naive.re * distance.ln()))
            };
            matrix[(start + i, start + j)] = HALF_I * (remainder + Complex64::new(0.0, FRAC_2_PI * j0 * exact));
        }
    }
}

impl Solution<'_> {
    /// Pressure behind the screen at (x, z), z > 0, in m.
    pub fn pressure(&self, x_m: f64, z_m: f64) -> Complex64 {
        let a = self.aperture;
        let mut start = 0;
        let mut sum = Complex64::ZERO;
        while start < a.nodes.len() {
            let n = (PI / a.steps[start]).round() as usize;
            let nodes = &a.nodes[start..start + n];
            let phases = distances(nodes, a.k, x_m, z_m);
            let nearest = phases.iter().copied().fold(f64::INFINITY, f64::min) / a.k;
            let spacing = (nodes[0] - nodes[n - 1]).abs() * a.steps[start];
            sum += if nearest > RESOLVED * spacing {
                let own = &self.strengths.as_slice()[start..start + n];
                hankel0_each(&phases).iter().zip(own).map(|(h, s)| h * s).sum::<Complex64>()
            } else {
                let finer = (RESOLVED * spacing / nearest.max(1e-6 * spacing)).ceil().min(MOST_FINER) as usize;
                self.sum_over(self.refined(start, n, finer).into_iter(), x_m, z_m)
            };
            start += n;
        }
        HALF_I * sum
    }

    fn sum_over(&self, nodes: impl Iterator<Item = (f64, Complex64)>, x_m: f64, z_m: f64) -> Complex64 {
        nodes.map(|(x, s)| hankel0(self.aperture.k * (x_m - x).hypot(z_m)) * s).sum()
    }

    /// The strengths of the opening with nodes `start..start + n` on `finer` times as many nodes, by their cosine series.
    fn refined(&self, start: usize, n: usize, finer: usize) -> Vec<(f64, Complex64)> {
        let nodes = &self.aperture.nodes[start..start + n];
        let strengths = &self.strengths.as_slice()[start..start + n];
        let step = PI / n as f64;
        let edge = (0.5 * step).cos();
        let (middle, half) = (0.5 * (nodes[0] + nodes[n - 1]), 0.5 * (nodes[0] - nodes[n - 1]) / edge);
        // cos(j step/2): every angle of the nodes is a multiple of half a step.
        let cosines: Vec<f64> = (0..4 * n).map(|j| (0.5 * j as f64 * step).cos()).collect();
        let coefficients: Vec<Complex64> = (0..n)
            .map(|m| {
                let sum: Complex64 =
                    strengths.iter().enumerate().map(|(j, s)| s * cosines[m * (2 * j + 1) % (4 * n)]).sum();
                sum * if m == 0 { 1.0 } else { 2.0 } / (n * finer) as f64
            })
            .collect();
        (0..n * finer)
            .map(|i| {
                let cosine = ((i as f64 + 0.5) * step / finer as f64).cos();
                // Clenshaw's recurrence for sum c_m cos(m tau).
                let (mut last, mut before) = (Complex64::ZERO, Complex64::ZERO);
                for c in coefficients.iter().skip(1).rev() {
                    (last, before) = (c + 2.0 * cosine * last - before, last);
                }
                (middle + half * cosine, coefficients[0] + cosine * last - before)
            })
            .collect()
    }

    /// The far-field amplitude A in m: p -> sqrt(2 pi / (k r)) exp(i (k r - pi/4)) (k/2 pi) A..., normalised so that the
    /// scattered intensity of a unit plane wave is Lambda |A|^2 / r with A = width * cos for a wide opening's axis.
    pub fn far_amplitude(&self, sin_o: f64) -> Complex64 {
        let a = self.aperture;
        let sum: Complex64 = a
            .nodes
            .iter()
            .zip(self.strengths.iter())
            .map(|(x, s)| Complex64::from_polar(1.0, -a.k * x * sin_o) * s)
            .sum();
        // p = (i/2) sqrt(2/(pi k r)) e^{..} sum: |p|^2 = sum^2 / (2 pi k r) = (Lambda/r) |A|^2 with A = sum/(2 pi).
        sum / (2.0 * PI)
    }
}
