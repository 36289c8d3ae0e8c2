//! A single straight edge: the half-plane from the edge into the fluid is the portal.
//!
//! Weight (3), (4) of the nearest (only) edge with an obliquity that makes the sum over rays equal Keller's rigid-edge
//! diffraction far from the shadow boundary, eq. (5) for a thin screen and eq. (6) for a wedge of any exterior angle.
//! On the reflection boundary phi + phi' = pi the diffracted power belongs partly to the rays reflected by the face;
//! it is split by the squared cotangents, so that eq. (6) stays finite.

use std::f64::consts::{FRAC_PI_2, PI};

use super::crossing::{Crossing, Incident, Ray, Spectrum};
use super::quadrature::{RaySum, integrate};

/// A wedge seen from a source and a receiver: angles from face A through the fluid, in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wedge {
    /// Fluid angle between the faces, > pi, <= 2 pi.
    pub exterior_angle: f64,
    /// Angle of the portal, the half-plane on which rays cross: between source and receiver.
    pub portal_angle: f64,
    /// Whether the receiver is in sight of the source: then the power that belongs to the rays reflected by a face is left out.
    pub lit: bool,
}

/// A point about an edge: distance from it in m and angle from face A in radians; line, point or plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AboutEdge {
    /// Distance from the edge in m (infinite: a plane wave from that angle).
    pub r_m: f64,
    /// Angle from face A through the fluid.
    pub phi: f64,
}

/// Sum of |cot((pi +- (phi - phi'))/2n)| and |cot((pi +- (phi + phi'))/2n)|, n pi the exterior angle: Keller's coefficient with
/// all its terms of one sign, times 2 n sqrt(2 pi k). Infinite on a boundary.
pub fn cotangents(exterior_angle: f64, from: f64, to: f64) -> f64 {
    let n = exterior_angle / PI;
    let whole = if n == 2.0 { 1.0 } else { (FRAC_PI_2 / n).tan() };
    let pair = |angle: f64| {
        let part = (0.5 * angle / n).tan();
        ((1.0 - whole * part) / (whole + part)).abs() + ((1.0 + whole * part) / (whole - part)).abs()
    };
    pair(to - from) + pair(to + from)
}

/// Phase in radians at the lower band edge over which the rays fade out (see mask.rs).
const FADE: [f64; 2] = [6.0 * PI, 18.0 * PI];

/// Intensity behind (or beside) an edge relative to the source's free field at 1 m: what arrives from the source's
/// side past the edge, the direct sound included where it is in sight; rays reflected by the faces are not.
///
/// `dy_m`: receiver minus source along the edge for a point source, `None` for line sources and plane waves.
/// Swapping source and receiver changes nothing.
pub fn intensity(
    exterior_angle: f64,
    source: AboutEdge,
    receiver: AboutEdge,
    dy_m: Option<f64>,
    spectrum: &Spectrum,
    tolerance: f64,
) -> RaySum {
    // The portal looks from the smaller angle to the larger one; mirror the wedge if the source has the larger.
    let (mut source, mut receiver) = (source, receiver);
    if source.phi > receiver.phi {
        source.phi = exterior_angle - source.phi;
        receiver.phi = exterior_angle - receiver.phi;
    }
    let span = receiver.phi - source.phi;
    if span < 1e-9 {
        return RaySum::default();
    }
    let portal_angle = 0.5 * (source.phi + receiver.phi);
    let wedge = Wedge { exterior_angle, portal_angle, lit: span < PI };
    let before = portal_angle - source.phi;
    let incident = if source.r_m.is_infinite() {
        Incident::Plane { s_x: -before.cos(), s_y: 0.0 }
    } else {
        let (x_m, z_m) = (source.r_m * before.cos(), source.r_m * before.sin());
        match dy_m {
            Some(dy_m) => Incident::Point { x_m, z_m, dy_m },
            None => Incident::Line { x_m, z_m },
        }
    };
    let behind = receiver.phi - portal_angle;
    let crossing = Crossing { incident, x_m: receiver.r_m * behind.cos(), z_m: receiver.r_m * behind.sin() };
    wedge.sum(&crossing, spectrum, tolerance)
}

impl Wedge {
    /// Obliquity O^2 of the ray, eq. (6); on the lit side with the share of the reflected field left out.
    pub fn obliquity(&self, ray: &Ray) -> f64 {
        let n = self.exterior_angle / PI;
        let theta_i = ray.sin_i.atan2(ray.cos_i);
        let theta_o = ray.sin_o.atan2(ray.cos_o);
        let phi_source = self.portal_angle - FRAC_PI_2 - theta_i;
        let phi_receiver = self.portal_angle + FRAC_PI_2 - theta_o;
        let delta = ray.sin_o - ray.sin_i;
        // Delta times the cotangents: each has its pole where sin(theta_o) = sin(theta_i) (incident) or on a
        // reflection boundary (reflected).
        let pair = |beta: f64| delta / ((PI + beta) / (2.0 * n)).tan() + delta / ((PI - beta) / (2.0 * n)).tan();
        let incident = if delta.abs() < 1e-7 {
            // Limit on the shadow boundary: the pole of the incident pair gives 2n cos(theta), see docs/physics.md.
            -2.0 * n * (ray.cos_i * ray.cos_o).sqrt()
        } else {
            pair(phi_receiver - phi_source)
        };
        let reflected = if delta.abs() < 1e-7 { 0.0 } else { pair(phi_receiver + phi_source) };
        let total = (incident + reflected).powi(2) / (4.0 * n * n);
        if self.lit {
            total * incident * incident / (incident * incident + reflected * reflected).max(f64::MIN_POSITIVE)
        } else {
            total
        }
    }

    fn sum(&self, crossing: &Crossing, spectrum: &Spectrum, tolerance: f64) -> RaySum {
        let value = |x: f64| {
            let ray = crossing.ray(x);
            spectrum.weight(x, ray.delta()) * self.obliquity(&ray) * ray.spread
        };
        let phase = |x: f64, k: f64| 2.0 * k * x * crossing.ray(x).delta();
        let high = |x: f64| phase(x, spectrum.high_k());
        let low = |x: f64| phase(x, spectrum.low_k()).abs();
        let start = crossing.straight_x_m().max(0.0);
        let mut end = start + 1e-6 * crossing.length_m(start).abs().max(crossing.z_m);
        while low(end) < FADE[1] && end < 1e9 {
            end = start + 1.25 * (end - start);
        }
        let mut faded = |x: f64| {
            let t = if x > start { ((low(x) - FADE[0]) / (FADE[1] - FADE[0])).clamp(0.0, 1.0) } else { 0.0 };
            value(x) * (1.0 - t * t * t * (10.0 - t * (15.0 - 6.0 * t)))
        };
        let mut run = |bound: f64| {
            let mut sum = integrate(&mut faded, &high, 0.0, start, 0.5 * bound);
            sum += integrate(&mut faded, &high, start, end, 0.5 * bound);
            sum
        };
        let first = run(f64::INFINITY);
        if first.error <= tolerance * first.value.abs() {
            return first;
        }
        let second = run(tolerance * first.value.abs().max(1e-9 * first.absolute));
        RaySum { rays: first.rays + second.rays, ..second }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_cotangents_is_kellers_with_all_terms_of_one_sign() {
        for exterior_angle in [1.2, 1.5, 1.75, 1.99, 2.0].map(|n| n * PI) {
            for (from, to) in [(0.0, 1.1), (0.3, 3.9), (2.0, 0.4), (1.0, exterior_angle), (3.1, 3.2)] {
                let n = exterior_angle / PI;
                let angles = [PI + (to - from), PI - (to - from), PI + (to + from), PI - (to + from)];
                let expected: f64 = angles.iter().map(|angle| (0.5 * angle / n).tan().abs().recip()).sum();
                let got = cotangents(exterior_angle, from, to);
                assert!((got / expected - 1.0).abs() < 1e-12, "{exterior_angle} {from} {to}: {got} {expected}");
            }
        }
        assert!(cotangents(2.0 * PI, 0.5, 0.5 + PI) > 1e12);
    }
}
