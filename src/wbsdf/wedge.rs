//! The exact field of a rigid wedge: Biot and Tolstoy's solution on its path of steepest descent.
//!
//! Near the shadow boundary, within a wavelength of the edge and along a face the signed rays of a single edge are up
//! to some dB wrong. There the infinite rigid wedge is solved exactly. With theta_w the angle of air, nu = pi/theta_w,
//! and the source's free field exp(i k R)/R (Biot and Tolstoy 1957; Svensson, Fred and Vanderkooy 1999, eq. 28):
//!
//! ```text
//! p_diffracted = -(nu / 2 pi) int_0^inf beta(eta) exp(i k L)/L d eta ,   L^2 = r^2 + r_s^2 + z^2 + 2 r r_s cosh eta
//! beta = sum over phi in {pi +- (theta - theta_s), pi +- (theta + theta_s)} of sin(nu phi)/(cosh(nu eta) - cos(nu phi))
//! ```
//!
//! On L = L_0 + i s the exponential no longer oscillates and no pole is passed (they all lie on the imaginary axis of
//! eta). With s = exp(2 t) the trapezoidal rule converges exponentially whatever the distance from a shadow boundary,
//! with weights that do not depend on frequency. Its step doubles s, and the sum is taken at wave numbers half an octave
//! apart: k s is then a power of sqrt(2), whose exponentials are known. Without the phase k L_0 the sum is smooth in log k
//! (analytic but for k <= 0), and six neighbours give it at any other wave number. Line sources have H0(k L) instead of
//! exp(i k L)/L, plane waves exp(i k r cosh eta).

use std::f64::consts::{FRAC_PI_4, LN_2, PI};
use std::sync::LazyLock;

use num_complex::Complex64;

use super::crossing::Spectrum;
use super::edge::AboutEdge;
use super::hankel::{hankel0_ratio, scaled_hankel0};
use super::slit::gauss_nodes;

/// Step of the trapezoidal rule in t, which doubles s: its error is about exp(-pi^2/(2 step)) = 7e-7 of the undisturbed wave.
const STEP: f64 = 0.5 * LN_2;
/// First node relative to the shortest length on which the integrand changes; what lies before it is proportional to
/// exp(t) within the square of this.
const FIRST: f64 = 0.02;
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

/// Angle in radians from a shadow boundary within which half of the undisturbed wave is seen.
const ON_BOUNDARY: f64 = 1e-9;

/// Share of what an edge sends below which its ends are left out (0.01 dB).
const FEEBLE: f64 = 1e-3;

/// The kind of wave that meets the wedge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wave {
    /// A point source; receiver minus source along the edge in m.
    Point(f64),
    /// A line source along the edge.
    Line,
    /// A plane wave across the edge; its direction is the source's angle.
    Plane,
}

/// The field about a wedge between one source and one receiver, at any wave number within a band.
pub struct WedgeField {
    wave: Wave,
    /// Length over the edge (plane wave: relative to the wave front through the edge) in m.
    over_m: f64,
    /// From the saddle point, and from the ends of an edge of finite length.
    branches: Vec<Branch>,
    /// The wave numbers of their tables.
    spectrum: Spectrum,
    /// Straight way in m and whether it is free (1), on the boundary (1/2) or shaded (0).
    direct: (f64, f64),
    /// The same for the wave reflected by the nearer face.
    reflected: (f64, f64),
    /// Whether both stand exactly on their boundary and the way over the edge (or its very end) is there.
    on_boundary: [bool; 2],
    /// Whether the way over the edge leads over its end.
    at_end: bool,
}

/// An integral along one path of steepest descent.
struct Branch {
    /// Length in m at its start.
    length_m: f64,
    nodes: Vec<Node>,
    /// The sums at wave numbers half an octave apart from the lowest one on; one for a tone.
    sums: Vec<Terms>,
}

struct Node {
    s_m: f64,
    weights: Terms,
}

/// What belongs to the incident wave and to the waves reflected by face A and by face B.
type Terms = [Complex64; 3];

/// Neighbours in a table of sums, and their weights.
#[derive(Debug, Clone, Copy)]
pub struct Between {
    first: usize,
    weights: [f64; NEIGHBOURS],
}

/// Pressures relative to the free field's modulus over 1 m, at one wave number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// The direct sound with the diffracted wave that makes it continuous.
    pub incident: Complex64,
    /// The sound reflected by a face with the diffracted wave that makes it continuous.
    pub reflected: Complex64,
}

/// What the edge itself sends, in the unit of [`Parts`]: without direct and reflected sound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Diffracted {
    /// What makes the direct sound continuous.
    pub incident: Complex64,
    /// What makes the sound reflected by face A and by face B continuous.
    pub faces: [Complex64; 2],
}

impl Branch {
    /// The sum at wave number `k`, without the phase of the branch's length.
    fn direct(&self, wave: Wave, k: f64) -> Terms {
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
        for (i, node) in (first..).zip(&self.nodes) {
            let weights = node.weights.map(|w| [w.re, w.im]);
            let weights = weights.as_flattened();
            // Beyond the table nothing is left.
            let end = usize::try_from(most - 2 * i + 1).map_or(0, |end| end.min(count));
            for (j, sum) in sums[..end].iter_mut().enumerate() {
                let n = (2 * i + j as i32).max(least) - least;
                let decay = DECAYS[n as usize];
                if wave == Wave::Line {
                    let k = low_k * (0.5 * j as f64).exp2();
                    let decay = decay * self.hankel(wave, k, node.s_m);
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
    fn at(&self, between: &Between) -> Terms {
        let mut sum = [Complex64::ZERO; 3];
        for (terms, weight) in self.sums[between.first..].iter().zip(between.weights) {
            for (sum, term) in sum.iter_mut().zip(terms) {
                *sum += term * weight;
            }
        }
        sum
    }

    /// Sum of the moduli of what the branch sends at the lowest wave number.
    fn amplitude(&self) -> f64 {
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
struct Integrand {
    wave: Wave,
    nu: f64,
    over_m: f64,
    radii_m: [f64; 2],
    /// sin(nu phi) of the four terms and sin(nu phi/2).
    sines: [f64; 4],
    halves: [f64; 4],
    felt: [bool; 4],
    /// cosh(eta) grows like i s L/(r r_s) (point and line source) or i s/r (plane wave).
    rising_per_m: f64,
    falling_per_m2: f64,
}

impl Integrand {
    /// The branch that starts at `eta` >= 0, where the way is `length_m` long; `factor`: of all weights.
    fn branch(&self, eta: f64, length_m: f64, factor: f64, spectrum: &Spectrum) -> Branch {
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

impl WedgeField {
    /// Source and receiver about an infinitely long edge with `exterior_angle` of air between rigid faces, both outside
    /// the faces, for wave numbers (in 1/m) of `spectrum`.
    pub fn new(exterior_angle: f64, source: AboutEdge, receiver: AboutEdge, wave: Wave, spectrum: &Spectrum) -> Self {
        Self::between(exterior_angle, source, receiver, wave, [f64::NEG_INFINITY, f64::INFINITY], spectrum)
    }

    /// The same for an edge that ends: `ends_m` along it, counted from the source; for point sources (line sources and
    /// plane waves take every edge as infinitely long).
    ///
    /// On the edge eta = asinh(z/r_s) + asinh((z - z_r)/r), so that an end is a limit of the integral over eta: the
    /// integral from it to infinity on its own path of steepest descent is left out, or is all there is where the
    /// shortest way passes beside the edge. Corners themselves are not in it: single diffraction.
    pub fn between(
        exterior_angle: f64,
        source: AboutEdge,
        receiver: AboutEdge,
        wave: Wave,
        ends_m: [f64; 2],
        spectrum: &Spectrum,
    ) -> Self {
        let nu = PI / exterior_angle;
        let dz = if let Wave::Point(dz) = wave { dz } else { 0.0 };
        let (r, r_s) = (receiver.r_m, source.r_m);
        let over_m = if wave == Wave::Plane { r } else { (r + r_s).hypot(dz) };
        let (rising_per_m, falling_per_m2) =
            if wave == Wave::Plane { (1.0 / r, 0.0) } else { (over_m / (r * r_s), 0.5 / (r * r_s)) };
        let (difference, sum) = (receiver.phi - source.phi, receiver.phi + source.phi);
        let phases = [PI - difference, PI + difference, PI - sum, PI + sum];
        let halves = phases.map(|phi| (0.5 * nu * phi).sin());
        // On a boundary its own pair is half of the undisturbed wave and nothing else.
        // Boundaries of the far face stand at 2 theta_w, where the sine vanishes too.
        let felt = halves.map(|half| 2.0 * half.abs() / nu > ON_BOUNDARY);
        let radii_m = [r, r_s];
        let sines = phases.map(|phi| (nu * phi).sin());
        let integrand = Integrand { wave, nu, over_m, radii_m, sines, halves, felt, rising_per_m, falling_per_m2 };
        let mut branches = Vec::with_capacity(3);
        let etas: [f64; 2] = ends_m.map(|z| if z.is_finite() { (z / r_s).asinh() + ((z - dz) / r).asinh() } else { z });
        let over_edge = etas[0] < -ON_BOUNDARY && etas[1] > ON_BOUNDARY;
        if over_edge {
            branches.push(integrand.branch(0.0, over_m, 1.0, spectrum));
        }
        for (end, outwards) in [(0, -1.0), (1, 1.0)] {
            let eta = etas[end];
            if eta.is_finite() {
                // What lies beyond the far end is missing; an end on this side of the shortest way is the near limit.
                let sign = if eta * outwards > 0.0 { -0.5 } else { 0.5 };
                let length_m = ends_m[end].hypot(r_s) + (ends_m[end] - dz).hypot(r);
                let branch = integrand.branch(eta.abs(), length_m, sign, spectrum);
                // Ends send less the shorter the wave, and less than the edge itself.
                let feeble = |main: &Branch| branch.amplitude() < FEEBLE * main.amplitude();
                if !(over_edge && branches.first().is_some_and(feeble)) {
                    branches.push(branch);
                }
            }
        }
        let straight = |angle: f64| match wave {
            Wave::Plane => -r * angle.cos(),
            _ => ((r - r_s).powi(2) + 4.0 * r * r_s * (0.5 * angle).sin().powi(2) + dz * dz).sqrt(),
        };
        let seen = |angle: f64| match PI - angle {
            margin if margin.abs() < ON_BOUNDARY => 0.5,
            margin if margin > 0.0 => 1.0,
            _ => 0.0,
        };
        // The image in the far face stands at 2 theta_w - phi_s.
        let over_far = 2.0 * exterior_angle - sum;
        let image = sum.min(over_far);
        let at_end = etas.iter().any(|eta| eta.abs() < ON_BOUNDARY);
        let on_boundary = [difference.abs(), image].map(|angle| seen(angle) == 0.5 && (over_edge || at_end));
        Self {
            wave,
            over_m,
            branches,
            spectrum: *spectrum,
            direct: (straight(difference), seen(difference.abs())),
            reflected: (straight(image), seen(image)),
            on_boundary,
            at_end,
        }
    }

    /// Whether the face's reflection is seen from the receiver.
    pub fn reflects(&self) -> bool {
        self.reflected.1 == 1.0
    }

    /// What the edge sends at wave number `k` in 1/m; phases relative to the way over the (infinitely long) edge.
    ///
    /// `share`: of a wave whose way over the edge, or over one of its ends, is this many metres long.
    pub fn diffracted(&self, k: f64, share: impl Fn(f64) -> f64) -> Diffracted {
        let between = Between::new(&self.spectrum, k);
        let mut sum = Diffracted { incident: Complex64::ZERO, faces: [Complex64::ZERO; 2] };
        for branch in &self.branches {
            let share = share(branch.length_m);
            if share == 0.0 {
                continue;
            }
            let turn = if branch.length_m == self.over_m {
                Complex64::from(share)
            } else {
                Complex64::from_polar(share, k * (branch.length_m - self.over_m))
            };
            let terms = match &between {
                Some(between) => branch.at(between),
                None => branch.direct(self.wave, k),
            };
            sum.incident += terms[0] * turn;
            sum.faces[0] += terms[1] * turn;
            sum.faces[1] += terms[2] * turn;
        }
        sum
    }

    /// The free field over `length_m` at wave number `k`, with the phase of [`WedgeField::diffracted`].
    pub fn undisturbed(&self, length_m: f64, k: f64) -> Complex64 {
        free_wave(self.wave, length_m, k) * Complex64::from_polar(1.0, -k * self.over_m)
    }

    /// Both parts at wave number `k` in 1/m; phases relative to the way over the edge.
    pub fn parts(&self, k: f64) -> Parts {
        let edge = self.diffracted(k, |_| 1.0);
        let mut parts = [edge.incident, edge.faces[0] + edge.faces[1]];
        for (part, (length, seen)) in parts.iter_mut().zip([self.direct, self.reflected]) {
            if seen > 0.0 {
                *part += seen * self.undisturbed(length, k);
            }
        }
        Parts { incident: parts[0], reflected: parts[1] }
    }

    /// Lengths in m of the ways over the edge and over its ends.
    pub fn ways_m(&self) -> impl Iterator<Item = f64> {
        self.branches.iter().map(|branch| branch.length_m)
    }

    /// Length in m of the way over the infinitely long edge.
    pub fn over_m(&self) -> f64 {
        self.over_m
    }

    /// Length in m of the straight way and of that of the nearer face's reflection.
    pub fn lengths_m(&self) -> [f64; 2] {
        [self.direct.0, self.reflected.0]
    }

    /// What is missing from [`WedgeField::diffracted`] of direct and reflected sound exactly on their boundaries, where the sign
    /// of half of them is undecided; `found`: whether they are found. 0 elsewhere.
    ///
    /// Past the corner of a wall three quarters of the sound are seen, which two edges share.
    pub fn missing(&self, found: [bool; 2]) -> [f64; 2] {
        [0, 1].map(|n| match (self.on_boundary[n], self.at_end) {
            (false, _) => 0.0,
            (true, false) => 0.5 - f64::from(u8::from(found[n])),
            (true, true) => 0.5 * (0.75 - f64::from(u8::from(found[n]))),
        })
    }

    /// |p|^2 of the source's free field over `length_m` at wave number `k`, in the unit of [`Parts`].
    pub fn free(&self, length_m: f64, k: f64) -> f64 {
        match self.wave {
            Wave::Plane => 1.0,
            Wave::Point(_) => 1.0 / (length_m * length_m),
            Wave::Line => scaled_hankel0(Complex64::from(k * length_m)).norm_sqr() * 0.5 * PI * k,
        }
    }

    /// Intensity of the free field over `length_m` relative to 1 m: 1/r^2, 1/r or 1.
    pub fn free_intensity(&self, length_m: f64) -> f64 {
        match self.wave {
            Wave::Plane => 1.0,
            Wave::Point(_) => 1.0 / (length_m * length_m),
            Wave::Line => 1.0 / length_m,
        }
    }

    /// Band mean of `power` of the parts, relative to the free field at 1 m (for a line source by |p/p_free|^2 times 1/r).
    pub fn mean(&self, spectrum: &Spectrum, power: impl Fn(&Parts) -> f64) -> f64 {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let detours = [self.direct, self.reflected].map(|(length, seen)| (self.over_m - length) * seen);
        let phase = (high - low) * detours.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
        let count = if high > low { 5 + (0.7 * phase).ceil() as usize } else { 1 };
        let (length, _) = self.direct;
        let mean: f64 = gauss_nodes(low, high, count)
            .map(|(k, weight)| weight * power(&self.parts(k)) / self.free(length, k))
            .sum();
        mean * self.free_intensity(length)
    }
}

/// The free field over `length_m` at wave number `k` in 1/m: exp(i k r)/r, H0(k r) scaled to 1/sqrt(r) far away, or
/// exp(i k r) for a plane wave along the way.
pub fn free_wave(wave: Wave, length_m: f64, k: f64) -> Complex64 {
    let turn = Complex64::from_polar(1.0, k * length_m);
    match wave {
        Wave::Plane => turn,
        Wave::Point(_) => turn / length_m,
        Wave::Line => turn * scaled_hankel0(Complex64::from(k * length_m)) * (0.5 * PI * k).sqrt(),
    }
}

/// Coherent sum of both parts: the exact intensity.
pub fn coherent(parts: &Parts) -> f64 {
    (parts.incident + parts.reflected).norm_sqr()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sommerfeld's half-plane for a plane wave through the Fresnel integral, |p|^2 at one wave number: numerical
    /// integration of F(w) = (1/sqrt(i pi)) int_w^inf exp(i x^2) dx on its path of steepest descent.
    fn sommerfeld(k: f64, r: f64, phi: f64, source: f64) -> f64 {
        let f = |w: f64| {
            // erfc(exp(-i pi/4) w)/2 = exp(i w^2) (1/pi) int_0^inf exp(-t^2) a/(t^2 + a^2) dt, a = exp(-i pi/4) |w|.
            let a = Complex64::from_polar(w.abs().max(1e-12), -0.25 * PI);
            let n = 40_000;
            let sum: Complex64 = (0..n)
                .map(|i| {
                    let t = (i as f64 + 0.5) * 7.0 / n as f64;
                    (-t * t).exp() * a / (t * t + a * a) * (7.0 / n as f64)
                })
                .sum();
            let half = Complex64::from_polar(1.0, w * w) * sum / PI;
            if w >= 0.0 { half } else { 1.0 - half }
        };
        let part = |angle: f64| {
            Complex64::from_polar(1.0, -k * r * angle.cos()) * f(-(2.0 * k * r).sqrt() * (0.5 * angle).cos())
        };
        (part(phi - source) + part(phi + source)).norm_sqr()
    }

    #[test]
    fn a_half_plane_in_a_plane_wave_is_sommerfelds() {
        for (k, r, phi, source) in [(2.0, 0.5, 4.0, 0.6), (10.0, 1.0, 6.0, 1.5), (1.0, 0.3, 3.0, 0.4)] {
            let c = 343.0;
            let spectrum = Spectrum::tone(k * c / std::f64::consts::TAU, c);
            let about = |r_m: f64, phi: f64| AboutEdge { r_m, phi };
            let field = WedgeField::new(2.0 * PI, about(f64::INFINITY, source), about(r, phi), Wave::Plane, &spectrum);
            let (got, expected) = (field.mean(&spectrum, coherent), sommerfeld(k, r, phi, source));
            // 1e-5: the midpoint rule of the oracle.
            assert!((got / expected - 1.0).abs() < 1e-5, "k {k}, r {r}, phi {phi}: {got} {expected}");
        }
    }

    #[test]
    fn the_field_is_continuous_across_the_shadow_and_reflection_boundaries() {
        let spectrum = Spectrum { low_hz: 177.0, high_hz: 354.0, speed_m_s: 343.0 };
        for wave in [Wave::Point(0.7), Wave::Line, Wave::Plane] {
            let r_m = if wave == Wave::Plane { f64::INFINITY } else { 1.5 };
            let at = |phi: f64| {
                let (source, receiver) = (AboutEdge { r_m, phi: 1.0 }, AboutEdge { r_m: 2.0, phi });
                WedgeField::new(1.6 * PI, source, receiver, wave, &spectrum).mean(&spectrum, coherent)
            };
            for boundary in [1.0 + PI, PI - 1.0] {
                let (before, on, after) = (at(boundary - 1e-6), at(boundary), at(boundary + 1e-6));
                assert!((after / before - 1.0).abs() < 2e-5, "{wave:?} {boundary}: {before} {on} {after}");
                assert!((on / before - 1.0).abs() < 2e-5, "{wave:?} {boundary}: {before} {on} {after}");
            }
        }
    }

    #[test]
    fn a_wedge_of_180_degrees_is_a_plane_with_an_image() {
        let spectrum = Spectrum::tone(300.0, 343.0);
        let k = spectrum.low_k();
        let (source, receiver) = (AboutEdge { r_m: 1.0, phi: 0.9 }, AboutEdge { r_m: 2.0, phi: 2.0 });
        let field = WedgeField::new(PI, source, receiver, Wave::Point(0.4), &spectrum);
        let straight = |angle: f64| f64::sqrt(1.0 + 4.0 - 4.0 * angle.cos() + 0.16);
        let wave = |r: f64| Complex64::from_polar(1.0 / r, k * r);
        let expected = (wave(straight(1.1)) + wave(straight(2.9))).norm_sqr();
        let got = coherent(&field.parts(k));
        assert!((got / expected - 1.0).abs() < 1e-9, "{got} {expected}");
    }

    #[test]
    fn an_edge_that_ends_sends_the_line_integral_over_its_length() {
        let (exterior, r_s, r, dz, c) = (1.5 * PI, 1.2, 2.0, 0.8, 343.0);
        let nu = PI / exterior;
        let (source, receiver) = (AboutEdge { r_m: r_s, phi: 0.7 }, AboutEdge { r_m: r, phi: 4.2 });
        // Keller's point at 0.3: inside, at an end, just and far beside.
        for ends in [[-1.0, 0.9], [0.3, 2.0], [0.31, 5.0], [1.5, 4.0], [-3.0, -0.2]] {
            for f in [125.0, 1000.0] {
                let k = std::f64::consts::TAU * f / c;
                let n = 200_000;
                let step = (ends[1] - ends[0]) / n as f64;
                let phases = [PI - 3.5, PI + 3.5, PI - 4.9, PI + 4.9];
                let expected: Complex64 = (0..n)
                    .map(|i| {
                        let z: f64 = ends[0] + (i as f64 + 0.5) * step;
                        let (m, l) = (z.hypot(r_s), (z - dz).hypot(r));
                        let eta = (z / r_s).asinh() + ((z - dz) / r).asinh();
                        let beta: f64 =
                            phases.iter().map(|p| (nu * p).sin() / ((nu * eta).cosh() - (nu * p).cos())).sum();
                        Complex64::from_polar(-nu / (4.0 * PI) * beta * step / (m * l), k * (m + l))
                    })
                    .sum();
                let spectrum = Spectrum::tone(f, c);
                let field = WedgeField::between(exterior, source, receiver, Wave::Point(dz), ends, &spectrum);
                let d = field.diffracted(k, |_| 1.0);
                let got = (d.incident + d.faces[0] + d.faces[1]) * Complex64::from_polar(1.0, k * field.over_m());
                // 1e-5 of the whole edge: the rule's accuracy (STEP).
                assert!((got - expected).norm() < 1e-5, "{ends:?} {f} Hz: {got} {expected}");
            }
        }
    }
}
