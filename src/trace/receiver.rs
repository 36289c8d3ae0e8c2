//! The finite receiver: a sphere round each probe that rays pass through.
//!
//! The mean intensity over a volume V is the sum of power times path length inside V over V. A sphere that a wall cuts
//! counts only with the part the probe can see, otherwise a probe near a wall would read low and one behind a thin
//! screen would hear through it.
//!
//! Bias: the mean of 1/d^2 over a ball of radius R exceeds the value at its centre by the factor 1 + R^2/(5 d^2) + ...
//! (Laplacian of d^-2 is 2 d^-4, mean over a ball adds R^2/10 of it): 0.14 dB for an image source 1 m away, 0.04 dB at 2 m.

use glam::DVec3;

use super::lanes::Lanes;
use super::portal::Passage;
use super::{Scattering, TracePlan};
use crate::geometry::{Geometry, Skip};

/// Directions of the fixed set that measures the visible part of the sphere.
const VISIBILITY_DIRECTIONS: usize = 4096;

/// The radius shrinks to this share of the distance to the nearest portal, where the field varies quickly.
const SHARE_OF_PORTAL_DISTANCE: f64 = 0.35;

/// A lobe counts as broad if its solid angle is this many times that of the sphere: at equality both estimators have the
/// same mean square, but the density in the middle of an opening is some four times its mean.
const BROAD_LOBE: f64 = 4.0;

/// One probe as the rays see it.
pub(super) struct Receiver<const N: usize> {
    /// Centre in m.
    pub(super) position: DVec3,
    /// Radius squared in m^2.
    pub(super) radius2: f64,
    /// 4 pi / visible volume in m^-3.
    pub(super) scale: f64,
    /// Per portal: 1 in the bands in which the sphere collects the flight after a crossing, 0 in those that are summed at
    /// the crossing itself.
    pub(super) sphere_bands: Vec<Lanes<N>>,
    /// Per portal: whether any band is summed at the crossing.
    pub(super) at_crossing: Vec<bool>,
}

impl<const N: usize> Receiver<N> {
    /// Sets up the receiver at `position` in m.
    pub(super) fn new<S: Scattering>(
        position: DVec3,
        geometry: &Geometry,
        passages: &[Passage],
        scatter: &[S],
        bands: usize,
        plan: &TracePlan,
    ) -> Self {
        let nearest = passages.iter().map(|p| p.distance(position)).fold(f64::INFINITY, f64::min);
        let radius = plan.receiver_radius_m.min(SHARE_OF_PORTAL_DISTANCE * nearest).max(0.02);
        let volume = visible_volume(position, radius, geometry);
        let mut sphere_bands = Vec::with_capacity(passages.len());
        let mut at_crossing = Vec::with_capacity(passages.len());
        for (passage, scatter) in passages.iter().zip(scatter) {
            let d = passage.centre.distance(position).max(1e-9);
            // Solid angle of the sphere seen from the middle of the portal, small-angle form.
            let sphere_sr = std::f64::consts::PI * (radius / d).powi(2);
            let mut mask = [1.0; N];
            for (b, slot) in mask.iter_mut().enumerate().take(bands) {
                if scatter.lobe_sr(b) > BROAD_LOBE * sphere_sr {
                    *slot = 0.0;
                }
            }
            at_crossing.push(mask[..bands].contains(&0.0));
            sphere_bands.push(mask);
        }
        Self {
            position,
            radius2: radius * radius,
            scale: 4.0 * std::f64::consts::PI / volume,
            sphere_bands,
            at_crossing,
        }
    }

    /// The part of a flight inside the sphere: (start, end, closest approach) as distances in m from `origin` along the
    /// unit vector `direction`, within 0..=`length`.
    #[inline]
    pub(super) fn chord(&self, origin: DVec3, direction: DVec3, length: f64) -> Option<(f64, f64, f64)> {
        let to = self.position - origin;
        let along = to.dot(direction);
        let half2 = self.radius2 - (to.length_squared() - along * along);
        if half2 <= 0.0 {
            return None;
        }
        let half = half2.sqrt();
        let (start, end) = ((along - half).max(0.0), (along + half).min(length));
        (start < end).then(|| (start, end, along.clamp(start, end)))
    }
}

/// Volume in m^3 of the part of a sphere that its centre can see: the mean of t^3 over a Fibonacci set of directions.
fn visible_volume(centre: DVec3, radius: f64, geometry: &Geometry) -> f64 {
    let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    let mut cubes = 0.0;
    for i in 0..VISIBILITY_DIRECTIONS {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / VISIBILITY_DIRECTIONS as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let direction = DVec3::new(r * cos, r * sin, z);
        let t = geometry.closest(centre, direction, radius, Skip::NONE).map_or(radius, |hit| hit.t.min(radius));
        cubes += t * t * t;
    }
    // A probe that touches surfaces on all sides would have no volume at all.
    (4.0 / 3.0 * std::f64::consts::PI * cubes / VISIBILITY_DIRECTIONS as f64).max(1e-9 * radius.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball() -> Receiver<8> {
        Receiver {
            position: DVec3::new(1.0, 2.0, 3.0),
            radius2: 0.16,
            scale: 1.0,
            sphere_bands: Vec::new(),
            at_crossing: Vec::new(),
        }
    }

    #[test]
    fn a_chord_through_the_middle_is_the_diameter() {
        let (start, end, closest) =
            ball().chord(DVec3::new(0.0, 2.0, 3.0), DVec3::X, 9.0).expect("it passes the middle");
        assert!((start - 0.6).abs() < 1e-12 && (end - 1.4).abs() < 1e-12 && (closest - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_flight_that_ends_in_the_sphere_counts_to_its_end() {
        let (start, end, closest) = ball().chord(DVec3::new(0.0, 2.0, 3.0), DVec3::X, 0.9).expect("it enters");
        assert!((end - start - 0.3).abs() < 1e-12 && closest == end);
        assert_eq!(ball().chord(DVec3::new(0.0, 2.0, 3.0), DVec3::X, 0.5), None);
        assert_eq!(ball().chord(DVec3::new(2.0, 2.0, 3.0), DVec3::X, 9.0), None);
        assert_eq!(ball().chord(DVec3::new(0.0, 2.41, 3.0), DVec3::X, 9.0), None);
    }

    #[test]
    fn the_mean_chord_of_parallel_rays_is_four_thirds_of_the_radius() {
        let n = 400;
        let (mut sum, mut hits) = (0.0, 0);
        for i in 0..n {
            for j in 0..n {
                let offset = |k: i32| 0.4 * ((f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0);
                let origin = DVec3::new(-5.0, 2.0 + offset(i), 3.0 + offset(j));
                if let Some((start, end, _)) = ball().chord(origin, DVec3::X, 99.0) {
                    sum += end - start;
                    hits += 1;
                }
            }
        }
        // 160 000 rays over the square round the disc: the edge of the disc is resolved to 1e-3.
        assert!((sum / f64::from(hits) / (4.0 / 3.0 * 0.4) - 1.0).abs() < 2e-3);
    }
}
