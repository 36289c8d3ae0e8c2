//! One opening as the coherent sum of its two jambs: for directions along the screen.
//!
//! p = p_A + p_B - p_free + p_AB + p_BA: the exact half-planes of both jambs, and the waves that run from jamb to jamb along
//! the opening. In the plane of the opening the wave diffracted by a rigid jamb vanishes, so that these are waves of slope
//! diffraction. With phi the angle from a jamb's own screen, the derivative of Keller's coefficient across that plane is
//!
//! ```text
//! D' = -exp(i pi/4)/(2 sqrt(2 pi k)) cos(phi/2)/sin^2(phi/2) F_s(X) ,   X = 2 k sin^2(phi/2) a r/(a + r)
//! p_AB = p_inc(A) D'_A exp(i k a)/(i k a^(3/2)) D'_B exp(i k r)/sqrt(r)
//! ```
//!
//! with the transition function F_s = 2 j X (1 - F(X)) of slope diffraction (Kouyoumjian and Pathak 1974; Hwang and
//! Kouyoumjian 1974) for directions along the screen, where sound meets the far jamb without being diffracted at the near
//! one. Three and more crossings of the opening are of the order (k a)^-3.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use num_complex::Complex64;
use spec_math::Fresnel;

use super::crossing::{Crossing, Incident, Spectrum};
use super::edge::AboutEdge;
use super::hankel::hankel0;
use super::quadrature::RaySum;
use super::slit::{MOST_FREQUENCIES, gauss_nodes};
use super::wedge::{Wave, WedgeField};

/// Argument of the transition function from which its asymptotic series is used: the next term is 1e-4.
const FAR: f64 = 50.0;

/// The field about the half-plane with its edge at `edge_m` and its screen towards `side` of it, and the spectrum as it is
/// across the edge.
pub(super) fn edge_field(edge_m: f64, side: f64, crossing: &Crossing, spectrum: &Spectrum) -> (WedgeField, Spectrum) {
    let mut across = *spectrum;
    let (source, wave) = match crossing.incident {
        Incident::Line { x_m, z_m } => (((x_m - edge_m) * side, z_m), Wave::Line),
        Incident::Point { x_m, z_m, dy_m } => (((x_m - edge_m) * side, z_m), Wave::Point(dy_m)),
        Incident::Plane { s_x, s_y } => {
            // Only k sin(beta) counts across the edge.
            let sin_beta = (1.0 - s_y * s_y).sqrt();
            across.speed_m_s /= sin_beta;
            let sin_i = s_x / sin_beta;
            ((-sin_i * side, (1.0 - sin_i * sin_i).max(0.0).sqrt()), Wave::Plane)
        }
    };
    // Angles from the face on the source's side, through the opening.
    let r_m = if wave == Wave::Plane { f64::INFINITY } else { source.0.hypot(source.1) };
    let source = AboutEdge { r_m, phi: source.1.atan2(source.0) };
    let x = (crossing.x_m - edge_m) * side;
    let receiver = AboutEdge { r_m: x.hypot(crossing.z_m), phi: TAU - crossing.z_m.atan2(x) };
    (WedgeField::new(TAU, source, receiver, wave, &across), across)
}

/// Intensity behind a bounded opening relative to the source's free field at 1 m, summed at Gauss frequencies of the band.
///
/// Within 0.3 dB for k a > 30 up to 87 degrees off the normal on both sides.
pub(super) fn two_edges(opening: [f64; 2], crossing: &Crossing, spectrum: &Spectrum) -> RaySum {
    let edges = [(opening[0], -1.0), (opening[1], 1.0)].map(|(edge_m, side)| {
        let (field, across) = edge_field(edge_m, side, crossing, spectrum);
        (field, across, in_space_m(crossing, crossing.length_m(edge_m)))
    });
    let runs = [Run::new(opening[0], opening[1], crossing), Run::new(opening[1], opening[0], crossing)];
    let straight = match crossing.incident {
        Incident::Plane { s_x, s_y } => {
            let sin_i = s_x / (1.0 - s_y * s_y).sqrt();
            crossing.x_m * sin_i + crossing.z_m * (1.0 - sin_i * sin_i).max(0.0).sqrt()
        }
        Incident::Line { .. } => 1.0 / crossing.free_intensity(),
        Incident::Point { .. } => 1.0 / crossing.free_intensity().sqrt(),
    };
    let across = edges[0].1;
    let (low, high) = (across.low_k(), across.high_k());
    let detour = edges.iter().map(|e| e.2 - straight).fold(0.0_f64, |a, d| a.max(d.abs()));
    let apart = detour.max((edges[0].2 - edges[1].2).abs());
    // |p|^2 has the phase dk * apart over the band: Gauss nodes integrate it from a quarter of that on.
    let count = if high > low { 6 + (0.35 * (high - low) * apart).ceil() as usize } else { 1 };
    let mean: f64 = gauss_nodes(low, high, count.min(MOST_FREQUENCIES))
        .map(|(k, weight)| {
            let free = match crossing.incident {
                Incident::Plane { .. } => Complex64::from_polar(1.0, k * straight),
                Incident::Point { .. } => Complex64::from_polar(1.0 / straight, k * straight),
                Incident::Line { .. } => hankel0(k * straight) * (0.5 * PI * k).sqrt(),
            };
            let once = edges.iter().map(|(field, _, over)| {
                let parts = field.parts(k);
                (parts.incident + parts.reflected) * Complex64::from_polar(1.0, k * over)
            });
            let twice: Complex64 = runs.iter().map(|run| run.pressure(k)).sum();
            weight * (once.sum::<Complex64>() - free + twice).norm_sqr() / free.norm_sqr()
        })
        .sum();
    let value = mean * crossing.free_intensity();
    RaySum { value, error: 1e-5 * value, absolute: value, rays: 2 * count }
}

/// Length in m of a way that is `across_m` long across the edges: in space for a point source.
fn in_space_m(crossing: &Crossing, across_m: f64) -> f64 {
    match crossing.incident {
        Incident::Point { dy_m, .. } => across_m.hypot(dy_m),
        _ => across_m,
    }
}

/// The wave over the near jamb, along the opening and over the far jamb.
pub(super) struct Run {
    width_m: f64,
    /// sin^2(phi/2) and the distance parameter a r/(a + r) in m at both jambs.
    near: (f64, f64),
    far: (f64, f64),
    receiver_m: f64,
    /// Modulus of the source's field at the near jamb relative to 1 m.
    strength: f64,
    /// Length of the way in m (plane wave: from the wave front through the origin), in space for a point source.
    pub(super) length_m: f64,
    /// Sine of the angle between the way and the edges.
    sin_beta: f64,
    kind: Wave,
}

impl Run {
    pub(super) fn new(near: f64, far: f64, crossing: &Crossing) -> Self {
        let width_m = (far - near).abs();
        let along = (far - near).signum();
        let receiver_m = (crossing.x_m - far).hypot(crossing.z_m);
        // sin^2(phi/2) = (1 + cos)/2 with the cosine of the direction against that to the other jamb.
        let half_square = |cosine: f64| 0.5 * (1.0 + cosine);
        let reach = |r: f64| width_m * r / (width_m + r);
        let (near_part, strength, before, kind) = match crossing.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                let r = (x_m - near).hypot(z_m);
                let kind =
                    if let Incident::Point { dy_m, .. } = crossing.incident { Wave::Point(dy_m) } else { Wave::Line };
                ((half_square((x_m - near) * along / r), reach(r)), 1.0 / r.sqrt(), r, kind)
            }
            Incident::Plane { s_x, s_y } => {
                let sin_i = s_x / (1.0 - s_y * s_y).sqrt();
                ((half_square(-sin_i * along), width_m), 1.0, near * sin_i, Wave::Plane)
            }
        };
        let across = before + width_m + receiver_m;
        let length_m = in_space_m(crossing, across);
        // From two to three dimensions: the wave also spreads along the edges.
        let spread = if let Wave::Point(_) = kind { across.sqrt() / length_m } else { 1.0 };
        Self {
            width_m,
            near: near_part,
            far: (half_square((far - crossing.x_m) * along / receiver_m), reach(receiver_m)),
            receiver_m,
            strength: strength * spread,
            length_m,
            sin_beta: if let Wave::Point(_) = kind { across / length_m } else { 1.0 },
            kind,
        }
    }

    /// Pressure at wave number `k` relative to the free field's modulus over 1 m.
    pub(super) fn pressure(&self, k: f64) -> Complex64 {
        let across = k * self.sin_beta;
        let slope = |(half_square, reach_m): (f64, f64)| {
            let half_square = half_square.max(f64::MIN_POSITIVE);
            let ratio = (1.0 - half_square).max(0.0).sqrt() / half_square;
            slope_transition(2.0 * across * half_square * reach_m) * (ratio / (2.0 * (TAU * across).sqrt()))
        };
        // Twice exp(i pi/4) of D' and 1/i cancel; a line source's H0 starts with -pi/4.
        let turn = if self.kind == Wave::Line { -FRAC_PI_4 } else { 0.0 };
        let spread = self.strength / (across * self.width_m * (self.width_m * self.receiver_m).sqrt());
        slope(self.near) * slope(self.far) * Complex64::from_polar(spread, k * self.length_m + turn)
    }
}

/// Transition function of slope diffraction, 2 j X (1 - F(X)) conjugated for exp(-i omega t), with
/// F = -2 i sqrt(X) exp(-i X) int_sqrt(X)^inf exp(i t^2) dt: 1 far from the screen, 0 along it.
fn slope_transition(x: f64) -> Complex64 {
    if x > FAR {
        return Complex64::new(1.0 - 3.75 / (x * x), -1.5 / x);
    }
    let root = x.sqrt();
    let fresnel = (root * (2.0 / PI).sqrt()).fresnel();
    let rest = Complex64::new(0.5 - fresnel.c, 0.5 - fresnel.s) * FRAC_PI_2.sqrt();
    let f = Complex64::new(0.0, -2.0 * root) * Complex64::from_polar(1.0, -x) * rest;
    Complex64::new(0.0, -2.0 * x) * (1.0 - f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wbsdf::mask::Mask;
    use crate::wbsdf::referee::exact_intensity;

    #[test]
    fn the_transition_function_is_smooth_where_its_forms_meet() {
        let (near, far) = (slope_transition(FAR * (1.0 - 1e-9)), slope_transition(FAR * (1.0 + 1e-9)));
        // The term left out: 105/8 / X^3.
        assert!((near - far).norm() < 2e-4, "{near} {far}");
        assert!(slope_transition(1e-12).norm() < 1e-11);
    }

    #[test]
    fn waves_from_jamb_to_jamb_are_what_the_half_planes_miss_along_the_screen() {
        let tone = |k: f64| Spectrum::tone(k * 343.0 / TAU, 343.0);
        for (k, sign, dy) in [(40.0, 1.0, 0.0), (40.0, -1.0, 0.0), (60.0, 1.0, 0.9), (90.0, -1.0, 0.0)] {
            for kind in 0..3 {
                let (x, z) = (-1.2 * sign, 0.2);
                let incident = match kind {
                    0 => Incident::Line { x_m: x, z_m: z },
                    1 => Incident::Point { x_m: x, z_m: z, dy_m: dy },
                    _ => Incident::Plane { s_x: 0.98 * sign, s_y: 0.0 },
                };
                let crossing = Crossing { incident, x_m: 1.5, z_m: 0.3 };
                let exact = exact_intensity(&Mask::new(&[[-0.4, 0.4]]), 0.0, &crossing, &tone(k)).value;
                let got = two_edges([-0.4, 0.4], &crossing, &tone(k)).value;
                // Left out: three crossings, (k a)^-3, and overlapping transitions; k a is 32 to 72.
                assert!((got / exact).log10().abs() < 0.05, "{k} {sign} {kind}: {got} {exact}");
            }
        }
    }
}
