//! The finite receiver: a sphere round each probe that rays pass through.
//!
//! The mean intensity over a volume V is the sum of power times path length inside V over V. A sphere that a wall cuts
//! counts only with the part the probe can see, otherwise a probe near a wall would read low and one behind a thin
//! screen would hear through it.
//!
//! Bias: the mean of 1/d^2 over a ball of radius R exceeds the value at its centre by the factor 1 + R^2/(5 d^2) + ...
//! (Laplacian of d^-2 is 2 d^-4, mean over a ball adds R^2/10 of it): 0.14 dB for an image source 1 m away, 0.04 dB at 2 m.
//! What a Lambert wall sends, cos(theta)/d^2, has no Laplacian and no such bias.
//!
//! The farther a sound has come, the wider the ball may be: its radius grows with the distance d from the source's image (or
//! that of the last portal) up to d/10, where the bias is 0.2 % (0.009 dB), as long as no surface cuts it. The mean square
//! of what a ray brings falls as 1/R^2. The radius goes in steps, and d is taken where the ray comes nearest to the probe,
//! so that all rays of one image meet the same ball.

use glam::DVec3;

use super::lanes::Lanes;
use super::portal::Passage;
use super::{Scattering, TracePlan};
use crate::geometry::{Geometry, Skip};

/// Directions of the fixed set that measures the visible part of the sphere.
const VISIBILITY_DIRECTIONS: usize = 4096;

/// The radius shrinks to this share of the distance to the nearest portal, where the field varies quickly.
const SHARE_OF_PORTAL_DISTANCE: f64 = 0.35;

/// Radii of the wider balls over the next narrower one.
const STEP: f64 = std::f64::consts::SQRT_2;

/// Most wider balls: the widest has 5.7 times the radius.
const MOST_WIDER: usize = 5;

/// Distance of a source's image over the radius of its ball; see the module.
const REACH: f64 = 10.0;

/// A lobe counts as broad if its solid angle is this many times that of the sphere: at equality both estimators have the
/// same mean square, but the density in the middle of an opening is some four times its mean.
const BROAD_LOBE: f64 = 4.0;

/// One probe as the rays see it.
pub(super) struct Receiver<const N: usize> {
    /// Centre in m.
    pub(super) position: DVec3,
    /// The balls, narrowest first.
    balls: Vec<Ball>,
    /// Per portal: 1 in the bands in which the sphere collects the flight after a crossing, 0 in those that are summed at
    /// the crossing itself.
    pub(super) sphere_bands: Vec<Lanes<N>>,
    /// Per portal: whether any band is summed at the crossing.
    pub(super) at_crossing: Vec<bool>,
}

/// One of the balls about a probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ball {
    /// Radius squared in m^2.
    radius2: f64,
    /// Distance in m from which a sound may have come to be collected by this ball.
    from_m: f64,
    /// 4 pi / visible volume in m^-3.
    pub(super) scale: f64,
    /// Whether surfaces may cut it.
    pub(super) may_be_cut: bool,
}

/// The part of a flight inside a ball, as distances in m from the flight's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Chord {
    pub(super) start: f64,
    pub(super) end: f64,
    /// Closest approach to the probe.
    pub(super) closest: f64,
    pub(super) ball: Ball,
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
        // What the ray that comes in is worth in a wider ball must be the same wherever it starts: no portal inside.
        let clear = geometry.closest_surface_distance(position).min(SHARE_OF_PORTAL_DISTANCE * nearest);
        let mut balls = vec![Ball::new(radius, volume, true)];
        balls[0].from_m = 0.0;
        for step in 1..=MOST_WIDER {
            let wider = radius * STEP.powi(step as i32);
            if wider < clear {
                balls.push(Ball::new(wider, 4.0 / 3.0 * std::f64::consts::PI * wider.powi(3), false));
            }
        }
        Self { position, balls, sphere_bands, at_crossing }
    }

    /// The part of a flight of `length` m along the unit vector `direction` inside the ball for a sound that has come
    /// `from_m` to `origin`.
    #[inline]
    pub(super) fn chord(&self, origin: DVec3, direction: DVec3, length: f64, from_m: f64) -> Option<Chord> {
        let to = self.position - origin;
        let along = to.dot(direction);
        let miss2 = to.length_squared() - along * along;
        let widest = self.balls[self.balls.len() - 1].radius2;
        if miss2 >= widest {
            return None;
        }
        let come = from_m + along.clamp(0.0, length);
        let ball = self.balls.iter().rev().find(|ball| ball.from_m <= come)?;
        let half2 = ball.radius2 - miss2;
        if half2 <= 0.0 {
            return None;
        }
        let half = half2.sqrt();
        let (start, end) = ((along - half).max(0.0), (along + half).min(length));
        (start < end).then(|| Chord { start, end, closest: along.clamp(start, end), ball: *ball })
    }
}

impl Ball {
    fn new(radius: f64, volume: f64, may_be_cut: bool) -> Self {
        Self {
            radius2: radius * radius,
            from_m: REACH * radius,
            scale: 4.0 * std::f64::consts::PI / volume,
            may_be_cut,
        }
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
            balls: vec![Ball { radius2: 0.16, from_m: 0.0, scale: 1.0, may_be_cut: true }],
            sphere_bands: Vec::new(),
            at_crossing: Vec::new(),
        }
    }

    #[test]
    fn a_chord_through_the_middle_is_the_diameter() {
        let Chord { start, end, closest, .. } =
            ball().chord(DVec3::new(0.0, 2.0, 3.0), DVec3::X, 9.0, 0.0).expect("it passes the middle");
        assert!((start - 0.6).abs() < 1e-12 && (end - 1.4).abs() < 1e-12 && (closest - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_flight_that_ends_in_the_sphere_counts_to_its_end() {
        let Chord { start, end, closest, .. } =
            ball().chord(DVec3::new(0.0, 2.0, 3.0), DVec3::X, 0.9, 0.0).expect("it enters");
        assert!((end - start - 0.3).abs() < 1e-12 && closest == end);
        assert_eq!(ball().chord(DVec3::new(0.0, 2.0, 3.0), DVec3::X, 0.5, 0.0), None);
        assert_eq!(ball().chord(DVec3::new(2.0, 2.0, 3.0), DVec3::X, 9.0, 0.0), None);
        assert_eq!(ball().chord(DVec3::new(0.0, 2.41, 3.0), DVec3::X, 9.0, 0.0), None);
    }

    #[test]
    fn the_mean_chord_of_parallel_rays_is_four_thirds_of_the_radius() {
        let n = 400;
        let (mut sum, mut hits) = (0.0, 0);
        for i in 0..n {
            for j in 0..n {
                let offset = |k: i32| 0.4 * ((f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0);
                let origin = DVec3::new(-5.0, 2.0 + offset(i), 3.0 + offset(j));
                if let Some(Chord { start, end, .. }) = ball().chord(origin, DVec3::X, 99.0, 0.0) {
                    sum += end - start;
                    hits += 1;
                }
            }
        }
        // 160 000 rays over the square round the disc: the edge of the disc is resolved to 1e-3.
        assert!((sum / f64::from(hits) / (4.0 / 3.0 * 0.4) - 1.0).abs() < 2e-3);
    }

    #[test]
    fn a_wider_ball_takes_over_from_ten_radii_on_and_reads_the_same() {
        let room = Receiver::<8> {
            balls: vec![
                Ball { from_m: 0.0, ..Ball::new(0.4, 4.0 / 3.0 * std::f64::consts::PI * 0.064, true) },
                Ball::new(0.8, 4.0 / 3.0 * std::f64::consts::PI * 0.512, false),
            ],
            ..ball()
        };
        // Parallel rays of one power per square metre make the same intensity in either ball: 4 pi.
        for (come, cut) in [(0.0, true), (100.0, false)] {
            let (n, side) = (400, 1.0);
            let mut sum = 0.0;
            for i in 0..n {
                for j in 0..n {
                    let offset = |k: i32| side * ((f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0);
                    let origin = DVec3::new(-5.0, 2.0 + offset(i), 3.0 + offset(j));
                    if let Some(chord) = room.chord(origin, DVec3::X, 99.0, come) {
                        assert_eq!(chord.ball.may_be_cut, cut);
                        sum += (chord.end - chord.start) * chord.ball.scale * (2.0 * side / f64::from(n)).powi(2);
                    }
                }
            }
            // The grid resolves the narrow disc to some 1e-3.
            assert!((sum / (4.0 * std::f64::consts::PI) - 1.0).abs() < 3e-3, "{sum}");
        }
    }
}
