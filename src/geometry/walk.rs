//! Diffuse walks through the air: which region a point lies in, and what that region is like.

use std::f64::consts::TAU;

use glam::DVec3;
use rand_core::Rng;
use rand_pcg::Pcg64;

use super::{Element, Geometry, Hit, Skip};

/// Portals and coincident faces in a row that a straight ray may pass; a safeguard only.
const MAX_PASSES: usize = 64;

/// A ray that is reflected by Lambert's law at every surface and passes portals straight.
pub(crate) struct Walk<'a> {
    geometry: &'a Geometry,
    random: Pcg64,
    position: DVec3,
    direction: DVec3,
    skip: Skip,
    last: Option<(Hit, usize, bool)>,
}

/// A stop of a walk.
pub(crate) struct Stop {
    /// Point in m.
    pub(crate) point: DVec3,
    /// Surface index.
    pub(crate) surface: usize,
    /// Whether the ray came from the side of the normal.
    pub(crate) in_front: bool,
    /// Distance in m from the last stop.
    pub(crate) chord_m: f64,
}

impl<'a> Walk<'a> {
    /// A walk from `position` (m) along the unit vector `direction`; `stream` picks its random numbers.
    pub(crate) fn new(geometry: &'a Geometry, position: DVec3, direction: DVec3, stream: usize) -> Self {
        // neighbouring streams of one state start alike: the state differs too, by the golden ratio of 2^128
        let state = (stream as u128).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835);
        let random = Pcg64::new(state, stream as u128);
        Self { geometry, random, position, direction, skip: Skip::NONE, last: None }
    }

    fn unit(&mut self) -> f64 {
        (self.random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Leaves the last stop in a new direction by Lambert's law; before the first stop, any direction from where it is.
    pub(crate) fn turn_back(&mut self) {
        let (r2, phi) = (self.unit(), TAU * self.unit());
        let Some((hit, surface, in_front)) = self.last else {
            let z = 2.0 * r2 - 1.0;
            let r = (1.0 - z * z).max(0.0).sqrt();
            self.direction = DVec3::new(r * phi.cos(), r * phi.sin(), z);
            return;
        };
        // the projection on the surface is uniform on the unit disc
        let frame = self.geometry.surfaces[surface].frame;
        let (r, height) = (r2.sqrt(), (1.0 - r2).sqrt());
        let up = if in_front { height } else { -height };
        let d = frame.x * (r * phi.cos()) + frame.y * (r * phi.sin()) + frame.normal * up;
        self.position = hit.point;
        self.direction = d.normalize_or(frame.normal);
        self.skip = Skip::reflected(&hit);
    }
}

impl Iterator for Walk<'_> {
    type Item = Stop;

    /// The next surface met; `None` if the ray escapes.
    fn next(&mut self) -> Option<Stop> {
        let mut chord_m = 0.0;
        for _ in 0..MAX_PASSES {
            let hit = self.geometry.closest(self.position, self.direction, f64::INFINITY, self.skip)?;
            self.position = hit.point;
            chord_m += hit.t;
            let Element::Surface(surface) = hit.element else {
                self.skip = Skip::passed(&hit);
                continue;
            };
            let in_front = self.direction.dot(self.geometry.surfaces[surface].frame.normal) < 0.0;
            self.last = Some((hit, surface, in_front));
            self.turn_back();
            return Some(Stop { point: hit.point, surface, in_front, chord_m });
        }
        None
    }
}

/// Direction number `i` of `n` spread evenly over the sphere (Fibonacci lattice).
pub(crate) fn spread(i: usize, n: usize) -> DVec3 {
    let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
    let phi = i as f64 * TAU * 0.618_033_988_749_894_9;
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * phi.cos(), r * phi.sin(), z)
}
