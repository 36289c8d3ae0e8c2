//! Finds the facets along a ray by obvhs' binary tree. A plain loop over all facets is no faster even in the smallest
//! rooms (million rays/s, tree against loop: six faces 12 against 12, twelve triangles 10 against 8, a box with a door
//! 9 against 5; benches/ray_casting.rs), so there is none.
//!
//! The tree works in f32 and only finds: its boxes are padded by far more than f32 rounding, and whether and where a
//! facet is met is decided in f64 by the caller. Coordinates are relative to the scene's centre. Traps of obvhs 0.4
//! avoided here: -0.0 in a direction (added to +0.0), directions below 1.2e-7 (their clamped inverse is harmless for
//! padded boxes), far origins (moved up to the scene before rounding to f32).

use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};

use super::facet::{Facet, FacetShape};

/// Padding of the boxes relative to the largest coordinate: over 30 times the rounding of an f32 entry distance, and
/// enough for directions whose inverse obvhs clamps at 1.2e-7.
const PADDING: f32 = 4e-6;

/// Facets in the order of the tree's leaves.
pub(crate) struct FacetTree {
    pub(crate) facets: Vec<Facet>,
    pub(crate) shapes: Vec<FacetShape>,
    tree: Bvh2,
    reach_m: f64,
}

impl FacetTree {
    /// `margin_m`: by how much each facet's inclusive test reaches over its border.
    pub(crate) fn new(shapes: Vec<FacetShape>, margin_m: f64) -> Self {
        let shapes: Vec<FacetShape> = shapes.into_iter().filter(|s| Facet::new(s, margin_m).is_some()).collect();
        let reach_m = shapes.iter().flat_map(|s| s.corners()).fold(0.0_f64, |r, c| r.max(c.abs().max_element()));
        let tree = build(&shapes, reach_m);
        let shapes: Vec<FacetShape> = tree.primitive_indices.iter().map(|&i| shapes[i as usize]).collect();
        let facets = shapes.iter().filter_map(|s| Facet::new(s, margin_m)).collect();
        Self { facets, shapes, tree, reach_m }
    }

    /// Calls `test(index, facet)` for every facet that the ray may meet before `limit` (m), nearest boxes first.
    ///
    /// `test` answers the new, shorter limit when it has found something (negative infinity ends the search), else
    /// `None`.
    #[inline(always)]
    pub(crate) fn visit(
        &self,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        mut test: impl FnMut(usize, &Facet) -> Option<f64>,
    ) {
        if !(origin.is_finite() && direction.is_finite()) {
            return;
        }
        let mut start = origin;
        let mut advance = 0.0;
        if origin.abs().max_element() > 2.0 * self.reach_m {
            let radius = 2.0 * self.reach_m; // of a sphere well round all facets: their corners lie within sqrt(3) reach
            let nearest = -origin.dot(direction);
            if (origin + direction * nearest).length() > radius {
                return;
            }
            advance = (nearest - radius).max(0.0);
            start = origin + direction * advance;
        }
        let up = |t: f64| ((t - advance) as f32).next_up();
        let ray = Ray::new(start.as_vec3a(), direction.as_vec3a() + Vec3A::ZERO, 0.0, up(limit));
        self.tree.ray_traverse(ray, &mut RayHit::none(), |_, i| match test(i, &self.facets[i]) {
            Some(limit) => up(limit),
            None => f32::INFINITY,
        });
    }

    /// Calls `visit(index)` for every facet whose box reaches into the box between `low` and `high` (m).
    pub(crate) fn overlapping(&self, low: DVec3, high: DVec3, mut visit: impl FnMut(usize)) {
        let range = Aabb::new(low.as_vec3a(), high.as_vec3a());
        self.tree.aabb_traverse(range, |tree, node| {
            let node = &tree.nodes[node as usize];
            (node.first_index..node.first_index + node.prim_count).for_each(|i| visit(i as usize));
            true
        });
    }
}

fn build(shapes: &[FacetShape], reach_m: f64) -> Bvh2 {
    if shapes.is_empty() {
        return Bvh2::default();
    }
    let padding = Vec3A::splat(reach_m as f32 * PADDING);
    let boxes: Vec<Aabb> = shapes
        .iter()
        .map(|s| {
            let mut aabb = Aabb::empty();
            for corner in s.corners() {
                aabb.extend(corner.as_vec3a());
            }
            Aabb::new(aabb.min - padding, aabb.max + padding)
        })
        .collect();
    // small leaves: an f64 facet costs more than a box (up to 1.6 times faster than the preset with leaves of 8)
    let params = BvhBuildParams {
        max_prims_per_leaf: 2,
        collapse_traversal_cost: 1.0,
        reinsertion_batch_ratio: 0.2,
        ..BvhBuildParams::medium_build()
    };
    build_bvh2(&boxes, params, &mut Duration::default())
}
