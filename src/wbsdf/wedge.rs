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
//! On L = L_0 + i s the exponential no longer oscillates and no pole is passed (they all lie on the imaginary axis of eta): the
//! sum along it stands in `wbsdf::descent`. Line sources have H0(k L) instead of exp(i k L)/L, plane waves
//! exp(i k r cosh eta).

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use num_complex::Complex64;

use super::crossing::Spectrum;
pub use super::descent::Between;
use super::descent::{Branch, Integrand};
use super::edge::AboutEdge;
use super::hankel::hankel0_ratio;
use super::slit::gauss_nodes;

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

impl WedgeField {
    /// Source and receiver about an infinitely long edge with `exterior_angle` of air between rigid faces, both outside
    /// the faces, for wave numbers (in 1/m) of `spectrum`.
    pub fn new(exterior_angle: f64, source: AboutEdge, receiver: AboutEdge, wave: Wave, spectrum: &Spectrum) -> Self {
        Self::between(exterior_angle, source, receiver, wave, [f64::NEG_INFINITY, f64::INFINITY], spectrum)
    }

    /// Lengths and boundaries only: an infinitely long edge that sends nothing.
    pub fn silent(
        exterior_angle: f64,
        source: AboutEdge,
        receiver: AboutEdge,
        wave: Wave,
        spectrum: &Spectrum,
    ) -> Self {
        Self::over(exterior_angle, source, receiver, wave, None, spectrum)
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
        Self::over(exterior_angle, source, receiver, wave, Some(ends_m), spectrum)
    }

    fn over(
        exterior_angle: f64,
        source: AboutEdge,
        receiver: AboutEdge,
        wave: Wave,
        ends_m: Option<[f64; 2]>,
        spectrum: &Spectrum,
    ) -> Self {
        let silent = ends_m.is_none();
        let ends_m = ends_m.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
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
        if silent {
            branches.push(Branch::silent(over_m));
        } else if over_edge {
            branches.push(integrand.branch(0.0, over_m, 1.0, spectrum));
        }
        for (end, outwards) in [(0, -1.0), (1, 1.0)] {
            let eta = etas[end];
            if eta.is_finite() {
                // What lies beyond the far end is missing; an end on this side of the shortest way is the near limit.
                let sign = if eta * outwards > 0.0 { -0.5 } else { 0.5 };
                let length_m = ends_m[end].hypot(r_s) + (ends_m[end] - dz).hypot(r);
                // Ends send less the shorter the wave, and less than the edge itself.
                let audible = if over_edge { FEEBLE * branches.first().map_or(0.0, Branch::amplitude) } else { 0.0 };
                if integrand.bound(eta.abs(), sign, spectrum.low_k()) < audible {
                    continue;
                }
                let branch = integrand.branch(eta.abs(), length_m, sign, spectrum);
                if branch.amplitude() >= audible {
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

    /// What is sent over way number `way` of [`WedgeField::ways_m`] at wave number `k`, without the phase of its length: for
    /// the incident wave and for those reflected by face A and face B. `between`: the place of `k` in the table.
    pub fn over_way(&self, way: usize, k: f64, between: Option<&Between>) -> [Complex64; 3] {
        let branch = &self.branches[way];
        between.map_or_else(|| branch.direct(self.wave, k), |between| branch.at(between))
    }

    /// The free field over `length_m` at wave number `k` without its phase.
    pub fn amplitude(&self, length_m: f64, k: f64) -> Complex64 {
        free_amplitude(self.wave, length_m, k)
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
            Wave::Line => hankel0_ratio(Complex64::from(k * length_m)).norm_sqr() / length_m,
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
    free_amplitude(wave, length_m, k) * Complex64::from_polar(1.0, k * length_m)
}

/// The same without exp(i k r).
pub fn free_amplitude(wave: Wave, length_m: f64, k: f64) -> Complex64 {
    match wave {
        Wave::Plane => Complex64::ONE,
        Wave::Point(_) => Complex64::from(1.0 / length_m),
        Wave::Line => {
            let far = Complex64::new(FRAC_1_SQRT_2, -FRAC_1_SQRT_2) / length_m.sqrt();
            far * hankel0_ratio(Complex64::from(k * length_m))
        }
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
    fn between_the_tabulated_wave_numbers_the_field_is_the_sum_over_the_nodes() {
        let octaves = Spectrum { low_hz: 44.2, high_hz: 11_314.0, speed_m_s: 343.0 };
        for wave in [Wave::Point(0.4), Wave::Line, Wave::Plane] {
            let r_m = if wave == Wave::Plane { f64::INFINITY } else { 0.6 };
            // In the deep shadow, near the shadow boundary, near the reflection boundary, at a face.
            for (exterior, phi) in [(1.5, 4.6), (2.0, 0.7 + PI + 1e-3), (1.9, PI - 0.7 + 1e-2), (1.7, 5.34)] {
                let (source, receiver) = (AboutEdge { r_m, phi: 0.7 }, AboutEdge { r_m: 2.0, phi });
                let field = WedgeField::new(exterior * PI, source, receiver, wave, &octaves);
                let free = field.amplitude(field.over_m(), 1.0).norm();
                for i in 0..=200 {
                    let k = octaves.low_k() * 256_f64.powf(f64::from(i) / 200.0);
                    let between = Between::new(&octaves, k);
                    assert!(between.is_some());
                    let [got, exact] = [field.over_way(0, k, between.as_ref()), field.over_way(0, k, None)]
                        .map(|terms| terms.iter().sum::<Complex64>());
                    // Six neighbours half an octave apart; both ends of the table are worst.
                    assert!(
                        (got - exact).norm() < 4e-5 * exact.norm() + 1e-7 * free,
                        "{wave:?} {phi} {k}: {got} {exact}"
                    );
                }
                assert!(Between::new(&octaves, 0.9 * octaves.low_k()).is_none());
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
