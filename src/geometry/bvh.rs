//! Finds the facets along a ray: by their planes where these are few ([`super::few`]), else by obvhs' binary tree.
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
use super::few::FewPlanes;

/// Padding of the boxes relative to the largest coordinate: over 30 times the rounding of an f32 entry distance, and
/// enough for directions whose inverse obvhs clamps at 1.2e-7.
const PADDING: f32 = 4e-6;

/// Facets in the order of the tree's leaves.
pub(crate) struct FacetTree {
    pub(crate) facets: Vec<Facet>,
    pub(crate) shapes: Vec<FacetShape>,
    tree: Bvh2,
    /// The planes, where they are few; then there is no tree.
    pub(crate) few: Option<FewPlanes>,
    reach_m: f64,
    margin_m: f64,
}

impl FacetTree {
    /// `margin_m`: by how much each facet's inclusive test reaches over its border.
    pub(crate) fn new(shapes: Vec<FacetShape>, margin_m: f64) -> Self {
        let shapes: Vec<FacetShape> = shapes.into_iter().filter(|s| Facet::new(s, margin_m).is_some()).collect();
        let reach_m = shapes.iter().flat_map(|s| s.corners()).fold(0.0_f64, |r, c| r.max(c.abs().max_element()));
        let tree = build(&shapes, reach_m);
        let shapes: Vec<FacetShape> = tree.primitive_indices.iter().map(|&i| shapes[i as usize]).collect();
        let mut facets: Vec<Facet> = shapes.iter().filter_map(|s| Facet::new(s, margin_m)).collect();
        match FewPlanes::new(&mut facets, 0.1 * margin_m) {
            None => Self { facets, shapes, tree, few: None, reach_m, margin_m },
            Some((order, few)) => Self {
                facets: order.iter().map(|&i| facets[i]).collect(),
                shapes: order.iter().map(|&i| shapes[i]).collect(),
                tree: Bvh2::default(),
                few: Some(few),
                reach_m,
                margin_m,
            },
        }
    }

    /// Calls `test(index, facet, t)` for every facet that the ray may meet before `limit` (m), nearest first as far as
    /// that is known; t in m is where the ray meets the facet's plane (infinite or NaN if never). Facets in the plane `skip`
    /// may be left out.
    ///
    /// `test` answers the new, shorter limit when it has found something (negative infinity ends the search), else
    /// `None`.
    #[inline(always)]
    pub(crate) fn visit(
        &self,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        skip: u32,
        mut test: impl FnMut(usize, &Facet, f64) -> Option<f64>,
    ) {
        if let Some(few) = &self.few {
            let range = (-self.margin_m, limit);
            few.visit(origin, direction, range, skip, |i, t| test(i, &self.facets[i], t));
        } else {
            self.visit_tree(origin, direction, limit, test);
        }
    }

    fn visit_tree(
        &self,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        mut test: impl FnMut(usize, &Facet, f64) -> Option<f64>,
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
        self.tree.ray_traverse(ray, &mut RayHit::none(), |_, i| {
            let facet = &self.facets[i];
            match test(i, facet, facet.meet_plane(origin, direction)) {
                Some(limit) => up(limit),
                None => f32::INFINITY,
            }
        });
    }

    /// Calls `visit(index)` for every facet whose box reaches into the box between `low` and `high` (m).
    pub(crate) fn overlapping(&self, low: DVec3, high: DVec3, mut visit: impl FnMut(usize)) {
        if self.few.is_some() {
            (0..self.facets.len()).for_each(visit);
            return;
        }
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
