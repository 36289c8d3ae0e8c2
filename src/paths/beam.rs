//! What an image can send to at all: its beam through the outlines of its mirrors, whatever stands in between.
//!
//! In a room with a few pieces of furniture there are tens of thousands of image sources, and hardly any of them is heard at a
//! given edge or opening. The beam tells which, without casting a ray.

use glam::DVec3;

use super::images::{Image, Origin};
use crate::geometry::Geometry;

/// By how much in m outlines are widened: far more than what rounding and the insets of aimed points need.
const MARGIN_M: f64 = 1e-3;

/// Whether sound of `images[image]` may reach the convex flat `target` (corners in m; a segment has two).
pub(super) fn may_reach(images: &[Image], geometry: &Geometry, image: usize, target: &[DVec3]) -> bool {
    let mut current = &images[image];
    let (mut seen, mut spare) = (target.to_vec(), Vec::with_capacity(16));
    while let (Some(parent), Some(&plane)) = (current.parent, current.planes.last()) {
        let plane = &geometry.planes()[plane];
        let height = |p: DVec3| (p - plane.point_m).dot(plane.normal);
        // What the beam has lit lies on the other side of the mirror than the image.
        let (side, rate) = match current.origin {
            Origin::At(origin) => (-height(origin).signum(), height(origin)),
            Origin::Along { direction, .. } => (direction.dot(plane.normal).signum(), direction.dot(plane.normal)),
        };
        clip(&mut seen, &mut spare, |p| side * height(p) + MARGIN_M);
        for p in &mut seen {
            // The margin may have let in points just behind the mirror: they are moved into it.
            let above = (side * height(*p)).max(0.0) * side;
            *p = match current.origin {
                Origin::At(origin) => *p + (origin - *p) * (above / (above - rate)),
                Origin::Along { direction, .. } => *p - direction * (above / rate),
            };
        }
        if let Some(outline) = &plane.outline {
            for (axis, [low, high]) in outline.axes.iter().zip(outline.limits_m) {
                let along = |p: DVec3| (p - plane.point_m).dot(*axis);
                clip(&mut seen, &mut spare, |p| along(p) - low + MARGIN_M);
                clip(&mut seen, &mut spare, |p| high + MARGIN_M - along(p));
            }
        }
        if seen.is_empty() {
            return false;
        }
        current = &images[parent];
    }
    true
}

/// Leaves of a convex polygon what is not below 0 in `inside`, which is linear in space.
fn clip(polygon: &mut Vec<DVec3>, spare: &mut Vec<DVec3>, inside: impl Fn(DVec3) -> f64) {
    if polygon.iter().all(|p| inside(*p) >= 0.0) {
        return;
    }
    spare.clear();
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (a, b) = (inside(p), inside(q));
        if a >= 0.0 {
            spare.push(p);
        }
        if (a < 0.0) != (b < 0.0) {
            spare.push(p + (q - p) * (a / (a - b)));
        }
    }
    std::mem::swap(polygon, spare);
}
