//! Finds the facets along a ray where they lie in few planes: all planes are met at once, no tree.
//!
//! The distances to all planes are computed together, two at a time, and the facets of the nearest planes
//! tested first. In a convex room the nearest plane holds the hit, so one facet is tested a ray.

use glam::DVec3;

use super::facet::Facet;

/// Most planes for which this is faster than a tree (benches/ray_casting.rs).
pub(crate) const MOST_PLANES: usize = 16;

/// Most facets a plane on average: all facets of a plane are tested once it is met.
const MOST_FACETS: usize = 4;

/// Planes computed together: what a vector register of the oldest x86-64 holds.
const LANES: usize = 2;

/// Low bits of a sort key that hold the plane's number.
const INDEX_BITS: u64 = 2 * MOST_PLANES as u64 - 1;

/// Distances in m below this one are sorted as this one: no key is denormal.
const LEAST: f64 = 1e-300;

/// Planes as columns; unused lanes have no normal and are never met.
#[derive(Clone, Copy, Default)]
struct Block {
    x: [f64; LANES],
    y: [f64; LANES],
    z: [f64; LANES],
    distance: [f64; LANES],
    /// Plane id; a float, so that one compare serves a register of distances.
    plane: [f64; LANES],
}

impl Block {
    /// Distance along the ray to one of the planes in m; infinite or NaN in parallel to it.
    #[inline(always)]
    fn meet(&self, lane: usize, origin: DVec3, direction: DVec3) -> f64 {
        let height =
            self.distance[lane] - (self.x[lane] * origin.x + self.y[lane] * origin.y + self.z[lane] * origin.z);
        let slope = self.x[lane] * direction.x + self.y[lane] * direction.y + self.z[lane] * direction.z;
        height / slope
    }
}

/// The plane that a ray meets first.
struct Nearest {
    plane: usize,
    t: f64,
    /// What it is sorted by, and the same of the next plane.
    key: f64,
    second: f64,
}

/// The planes of a small scene.
pub(crate) struct FewPlanes {
    blocks: Vec<Block>,
    /// First facet of each plane, and the number of facets.
    starts: Vec<u32>,
}

impl FewPlanes {
    /// The order in which the facets have to be stored, and the planes; `None` if there are too many. Facets of one plane
    /// get the same distance from the origin to the last bit.
    pub(crate) fn new(facets: &mut [Facet], rounding_m: f64) -> Option<(Vec<usize>, Self)> {
        let mut planes: Vec<(Facet, Vec<usize>)> = Vec::new();
        for (i, facet) in facets.iter_mut().enumerate() {
            match planes.iter().position(|(first, _)| facet.shares_plane(first, rounding_m)) {
                Some(k) => {
                    facet.settle(&planes[k].0);
                    planes[k].1.push(i);
                }
                None if planes.len() == MOST_PLANES => return None,
                None => planes.push((*facet, vec![i])),
            }
        }
        if facets.is_empty() || facets.len() > MOST_FACETS * planes.len() {
            return None;
        }
        let mut blocks = vec![Block::default(); planes.len().div_ceil(LANES)];
        let mut order = Vec::with_capacity(facets.len());
        let mut starts = vec![0];
        for (k, (first, members)) in planes.iter().enumerate() {
            let (block, lane) = (&mut blocks[k / LANES], k % LANES);
            let (normal, distance) = first.plane_equation();
            [block.x[lane], block.y[lane], block.z[lane]] = normal.to_array();
            block.distance[lane] = distance;
            block.plane[lane] = f64::from(first.plane);
            order.extend(members);
            starts.push(order.len() as u32);
        }
        Some((order, Self { blocks, starts }))
    }

    /// The nearest plane that the ray meets at `from_m` <= t <= `limit` and whose key comes after `last`, but for those with
    /// the id `skip`.
    #[inline(always)]
    fn nearest(
        &self,
        origin: DVec3,
        direction: DVec3,
        (from_m, limit): (f64, f64),
        skip: u32,
        last: f64,
    ) -> Option<Nearest> {
        let skip = f64::from(skip);
        let mut distances = [0.0; MOST_PLANES];
        // A key is the distance with the plane's number in its last bits, so that minima carry the number along.
        let (mut nearest, mut second) = ([f64::INFINITY; LANES], [f64::INFINITY; LANES]);
        for (i, block) in self.blocks.iter().enumerate() {
            for lane in 0..LANES {
                let t = block.meet(lane, origin, direction);
                distances[i * LANES + lane] = t;
                let ahead = if t > LEAST { t } else { LEAST };
                let key = f64::from_bits((ahead.to_bits() & !INDEX_BITS) | (i * LANES + lane) as u64);
                let counts = (t >= from_m) & (t <= limit) & (key > last) & (block.plane[lane] != skip);
                let key = if counts { key } else { f64::INFINITY };
                let later = if key > nearest[lane] { key } else { nearest[lane] };
                nearest[lane] = if key < nearest[lane] { key } else { nearest[lane] };
                second[lane] = if later < second[lane] { later } else { second[lane] };
            }
        }
        let key = nearest[0].min(nearest[1]);
        if key == f64::INFINITY {
            return None;
        }
        let plane = (key.to_bits() & INDEX_BITS) as usize;
        let second = nearest[0].max(nearest[1]).min(second[0]).min(second[1]);
        Some(Nearest { plane, t: distances[plane & (MOST_PLANES - 1)], key, second })
    }

    /// Calls `test(index, t)` for the facets of every plane that the ray meets at `from_m` <= t <= `limit`, nearest planes
    /// first, but for those with the id `skip`. `test` as in [`super::bvh::FacetTree::visit`].
    #[inline(always)]
    pub(crate) fn visit(
        &self,
        origin: DVec3,
        direction: DVec3,
        (from_m, mut limit): (f64, f64),
        skip: u32,
        mut test: impl FnMut(usize, f64) -> Option<f64>,
    ) {
        let mut last = -1.0;
        while let Some(nearest) = self.nearest(origin, direction, (from_m, limit), skip, last) {
            for facet in self.facets_of(nearest.plane) {
                if let Some(shorter) = test(facet, nearest.t) {
                    limit = shorter;
                }
            }
            if nearest.second > limit {
                return;
            }
            last = nearest.key;
        }
    }

    /// The facet that the ray meets first and its distance in m, if that is plain to see: it is the only one of the nearest
    /// plane in the given range that `holds` the point, and no other plane is met before `clear_of` the distance.
    #[inline(always)]
    pub(crate) fn sole(
        &self,
        origin: DVec3,
        direction: DVec3,
        range: (f64, f64),
        skip: u32,
        clear_of: impl Fn(f64) -> f64,
        holds: impl Fn(usize, DVec3) -> bool,
    ) -> Option<(usize, f64)> {
        let nearest = self.nearest(origin, direction, range, skip, -1.0)?;
        let point = origin + direction * nearest.t;
        let mut holding = self.facets_of(nearest.plane).filter(|&facet| holds(facet, point));
        let facet = holding.next()?;
        (nearest.second > clear_of(nearest.t) && holding.next().is_none()).then_some((facet, nearest.t))
    }

    #[inline(always)]
    fn facets_of(&self, plane: usize) -> std::ops::Range<usize> {
        self.starts[plane] as usize..self.starts[plane + 1] as usize
    }
}
