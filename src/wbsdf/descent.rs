//! The integral of a wedge's field along one path of steepest descent, for all wave numbers of a spectrum at once.
//!
//! On L = L_0 + i s nothing oscillates. With s = exp(2 t) the trapezoidal rule converges exponentially whatever the distance
//! from a shadow boundary, with weights that do not depend on frequency. Its step doubles s, and the sum is taken at wave
//! numbers half an octave apart: k s is then a power of sqrt(2), whose exponentials are known. Without the phase k L_0 the sum
//! is smooth in log k (analytic but for k <= 0), and six neighbours give it at any other wave number.

use std::f64::consts::{FRAC_PI_4, LN_2, PI};
use std::sync::LazyLock;

use num_complex::Complex64;

use super::crossing::Spectrum;
use super::hankel::hankel0_ratio;
use super::wedge::Wave;

/// Step of the trapezoidal rule in t, which doubles s: its error is about exp(-pi^2/(2 step)) = 7e-7 of the undisturbed wave.
const STEP: f64 = 0.5 * LN_2;
/// First node relative to the shortest length on which the integrand changes; what lies before it is proportional to
/// exp(t) within the square of this.
const FIRST: f64 = 0.01;
/// Power of 2 that is k s of the last node at the lowest wave number: exp(-16) = 1e-7.
const LAST: i32 = 4;
/// Half octaves of k s in the table of exponentials: below the first one the exponential is 1 within 1e-9, above the last it
/// is 1e-20.
const HALF_OCTAVES: [i32; 2] = [-60, 11];
/// Neighbours that interpolate between wave numbers half an octave apart: within 3e-5.
const NEIGHBOURS: usize = 6;

/// exp(-2^(n/2)) for n in [`HALF_OCTAVES`].
static DECAYS: LazyLock<Vec<f64>> =
    LazyLock::new(|| (HALF_OCTAVES[0]..=HALF_OCTAVES[1]).map(|n| (-(0.5 * f64::from(n)).exp2()).exp()).collect());

/// An integral along one path of steepest descent.
pub(super) struct Branch {
    /// Length in m at its start.
    pub(super) length_m: f64,
    nodes: Vec<Node>,
    /// The sums at wave numbers half an octave apart from the lowest one on; one for a tone.
    sums: Vec<Terms>,
}

struct Node {
    s_m: f64,
    weights: Terms,
}

/// What belongs to the incident wave and to the waves reflected by face A and by face B.
pub(super) type Terms = [Complex64; 3];

/// Neighbours in a table of sums, and their weights.
#[derive(Debug, Clone, Copy)]
pub struct Between {
    first: usize,
    weights: [f64; NEIGHBOURS],
}

impl Branch {
    /// A way over which nothing is sent.
    pub(super) fn silent(length_m: f64) -> Self {
        Self { length_m, nodes: Vec::new(), sums: Vec::new() }
    }

    /// The sum at wave number `k`, without the phase of the branch's length.
    pub(super) fn direct(&self, wave: Wave, k: f64) -> Terms {
        self.nodes.iter().fold([Complex64::ZERO; 3], |sum, node| {
            let decay = (-k * node.s_m).exp() * self.hankel(wave, k, node.s_m);
            [0, 1, 2].map(|n| sum[n] + node.weights[n] * decay)
        })
    }

    /// What H0(k (L0 + i s)) adds to the weights, without exp(i k L0): its modulus over 1 m is 1/sqrt(r) far away.
    fn hankel(&self, wave: Wave, k: f64, s_m: f64) -> Complex64 {
        if wave == Wave::Line { hankel0_ratio(Complex64::new(k * self.length_m, k * s_m)) } else { Complex64::ONE }
    }

    /// Takes the sums at `count` wave numbers half an octave apart; the first node has k s = 2^`first` at the lowest one.
    fn tabulate(&mut self, wave: Wave, low_k: f64, first: i32, count: usize) {
        let [least, most] = HALF_OCTAVES;
        let mut sums = vec![[0.0; 6]; count];
        let ks: Vec<f64> = (0..count).map(|j| low_k * (0.5 * j as f64).exp2()).collect();
        for (i, node) in (first..).zip(&self.nodes) {
            let weights = node.weights.map(|w| [w.re, w.im]);
            let weights = weights.as_flattened();
            // Beyond the table nothing is left.
            let end = usize::try_from(most - 2 * i + 1).map_or(0, |end| end.min(count));
            for (j, sum) in sums[..end].iter_mut().enumerate() {
                let n = (2 * i + j as i32).max(least) - least;
                let decay = DECAYS[n as usize];
                if wave == Wave::Line {
                    let decay = decay * self.hankel(wave, ks[j], node.s_m);
                    for (sum, w) in sum.chunks_exact_mut(2).zip(node.weights) {
                        sum[0] += w.re * decay.re - w.im * decay.im;
                        sum[1] += w.re * decay.im + w.im * decay.re;
                    }
                } else {
                    for (sum, w) in sum.iter_mut().zip(weights) {
                        *sum += w * decay;
                    }
                }
            }
        }
        self.sums = sums.iter().map(|s| [0, 2, 4].map(|n| Complex64::new(s[n], s[n + 1]))).collect();
    }

    /// The sum between those of the table.
    pub(super) fn at(&self, between: &Between) -> Terms {
        let mut sum = [Complex64::ZERO; 3];
        for (terms, weight) in self.sums[between.first..].iter().zip(between.weights) {
            for (sum, term) in sum.iter_mut().zip(terms) {
                *sum += term * weight;
            }
        }
        sum
    }

    /// Sum of the moduli of what the branch sends at the lowest wave number.
    pub(super) fn amplitude(&self) -> f64 {
        self.sums.first().map_or(0.0, |terms| terms.iter().map(|part| part.norm()).sum())
    }
}

impl Between {
    /// For the wave number `k` in the table of `spectrum`; `None` outside of it.
    pub fn new(spectrum: &Spectrum, k: f64) -> Option<Self> {
        let place = 2.0 * (k / spectrum.low_k()).log2();
        let count = table_len(spectrum);
        if place.abs() < 1e-9 {
            let mut weights = [0.0; NEIGHBOURS];
            weights[0] = 1.0;
            return Some(Self { first: 0, weights });
        }
        if count < NEIGHBOURS || !(0.0..=(count - 1) as f64 + 1e-9).contains(&place) {
            return None;
        }
        let first = ((place as usize + 1).saturating_sub(NEIGHBOURS / 2)).min(count - NEIGHBOURS);
        let t = place - first as f64;
        // Lagrange's weights for equal distances: products of the distances to all others over their factorials.
        const FACTORS: [f64; NEIGHBOURS] =
            [-1.0 / 120.0, 1.0 / 24.0, -1.0 / 12.0, 1.0 / 12.0, -1.0 / 24.0, 1.0 / 120.0];
        let mut weights = FACTORS;
        for (n, weight) in weights.iter_mut().enumerate() {
            for other in (0..NEIGHBOURS).filter(|other| *other != n) {
                *weight *= t - other as f64;
            }
        }
        Some(Self { first, weights })
    }
}

/// Wave numbers in the table of a branch.
fn table_len(spectrum: &Spectrum) -> usize {
    let half_octaves = 2.0 * (spectrum.high_hz / spectrum.low_hz).log2();
    if half_octaves < 1e-9 { 1 } else { ((half_octaves - 1e-9).ceil() as usize + 1).max(NEIGHBOURS) }
}

/// The square root on the right half plane, for finite numbers of common size.
#[inline]
fn sqrt(z: Complex64) -> Complex64 {
    let norm = (z.re * z.re + z.im * z.im).sqrt();
    if z.re >= 0.0 {
        let re = (0.5 * (norm + z.re)).sqrt();
        Complex64::new(re, if re > 0.0 { 0.5 * z.im / re } else { 0.0 })
    } else {
        let im = (0.5 * (norm - z.re)).sqrt().copysign(z.im);
        Complex64::new(0.5 * z.im / im, im)
    }
}

/// The quantities of the integrand that do not depend on the branch.
pub(super) struct Integrand {
    pub(super) wave: Wave,
    pub(super) nu: f64,
    pub(super) over_m: f64,
    pub(super) radii_m: [f64; 2],
    /// sin(nu phi) of the four terms and sin(nu phi/2).
    pub(super) sines: [f64; 4],
    pub(super) halves: [f64; 4],
    pub(super) felt: [bool; 4],
    /// cosh(eta) grows like i s L/(r r_s) (point and line source) or i s/r (plane wave).
    pub(super) rising_per_m: f64,
    pub(super) falling_per_m2: f64,
}

impl Integrand {
    /// Upper bound of the amplitude at wave number `k` that the branch from `eta` > 0 on sends, `factor` as in
    /// [`Integrand::branch`]: the integrand only falls on the path of steepest descent.
    pub(super) fn bound(&self, eta: f64, factor: f64, k: f64) -> f64 {
        let [r, r_s] = self.radii_m;
        let cosh = (self.nu * eta).cosh();
        // cos(nu phi) = 1 - 2 sin^2(nu phi/2)
        let beta = |n: usize| self.sines[n].abs() / (cosh - 1.0 + 2.0 * self.halves[n] * self.halves[n]);
        let sum: f64 = (0..4).filter(|n| self.felt[*n]).map(beta).sum();
        factor.abs() * self.nu / PI * sum / (k * r * r_s * eta.sinh())
    }

    /// The branch that starts at `eta` >= 0, where the way is `length_m` long; `factor`: of all weights.
    pub(super) fn branch(&self, eta: f64, length_m: f64, factor: f64, spectrum: &Spectrum) -> Branch {
        let rising =
            if self.wave == Wave::Plane { self.rising_per_m } else { self.rising_per_m * length_m / self.over_m };
        let start_half = (0.5 * eta).sinh();
        let scale = (2.0 / rising).sqrt();
        let nearest = (0..4).filter(|n| self.felt[*n]).fold(1.0_f64, |a, n| a.min(self.halves[n].abs() / self.nu));
        let start = FIRST * (nearest.max(start_half) * scale).min(1.0 / spectrum.high_k().sqrt());
        let low_k = spectrum.low_k();
        let first = ((low_k * start * start).log2().floor() as i32).clamp(-400, LAST - 1);
        // What lies before the first node falls like exp(t) from the saddle, like exp(2 t) elsewhere.
        let before = if start_half * scale < start { 1.0 } else { 2.0 };
        let [r, r_s] = self.radii_m;
        let thin = (self.nu - 0.5).abs() < 1e-12;
        let mut nodes = Vec::with_capacity((LAST - first + 1) as usize);
        let mut s = f64::from(first).exp2() / low_k;
        for i in first..=LAST {
            let squared_half = start_half * start_half + Complex64::new(-s * s * self.falling_per_m2, s * rising) * 0.5;
            let half = sqrt(squared_half);
            let other = sqrt(1.0 + squared_half);
            // sinh^2(nu eta/2)
            let squared = if thin {
                squared_half / (2.0 * (1.0 + other))
            } else {
                let sinh_half = if half.norm_sqr() < 1e-6 {
                    // asinh(x) = x - x^3/6, and sinh(y) = y + y^3/6.
                    let y = self.nu * (half - half * squared_half / 6.0);
                    y + y * y * y / 6.0
                } else {
                    let sum = half + other;
                    let (ln, angle) = (0.5 * self.nu * sum.norm_sqr().ln(), self.nu * sum.im.atan2(sum.re));
                    let (sin, cos) = angle.sin_cos();
                    let grown = ln.exp();
                    0.5 * Complex64::new((grown - 1.0 / grown) * cos, (grown + 1.0 / grown) * sin)
                };
                sinh_half * sinh_half
            };
            // sin(nu phi) / (cosh(nu eta) - cos(nu phi)), both through half angles.
            let term = |n: usize| match self.felt[n] {
                true => self.sines[n] / (2.0 * (squared + self.halves[n] * self.halves[n])),
                false => Complex64::ZERO,
            };
            // d eta = i ds * measure, ds = 2 u^2 dt; the nodes before the first one form a geometric series.
            let rest = if i == first { 1.0 / (1.0 - (-before * STEP).exp()) } else { 1.0 };
            let measure = match self.wave {
                Wave::Plane => Complex64::from(1.0 / r),
                // With the 1/sqrt(L) of H0.
                Wave::Line => sqrt(Complex64::new(length_m, s)) * Complex64::from_polar(1.0 / (r * r_s), -FRAC_PI_4),
                Wave::Point(_) => Complex64::from(1.0 / (r * r_s)),
            };
            let weight = Complex64::I * measure / (2.0 * half * other) * (-factor * self.nu / PI * s * STEP * rest);
            nodes.push(Node { s_m: s, weights: [weight * (term(0) + term(1)), weight * term(2), weight * term(3)] });
            s *= 2.0;
        }
        let mut branch = Branch { length_m, nodes, sums: Vec::new() };
        branch.tabulate(self.wave, low_k, first, table_len(spectrum));
        branch
    }
}
