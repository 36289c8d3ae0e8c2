//! Which points share the air of the scene's sources and probes.

use glam::DVec3;

use super::walk::{Stop, Walk, spread};
use super::{Element, Geometry, Skip};
use crate::scene::{Scene, SourceKind};

/// At most this many positions stand for the sources and probes.
const MAX_SEEDS: usize = 64;
/// Walks from a point, and surfaces met by each, before two regions count as separate.
const WALKS: usize = 64;
const STOPS: usize = 16;

/// The air in which the sources and probes stand.
pub(crate) struct Region {
    seeds: Vec<DVec3>,
    open: bool,
}

impl Region {
    pub(crate) fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let mut open = false;
        let mut seeds = Vec::new();
        for source in &scene.sources {
            match source.kind {
                SourceKind::Plane(_) => open = true, // it comes from afar
                _ => seeds.push(source.position_m),
            }
        }
        seeds.extend(scene.probes.iter().map(|p| p.position_m));
        let step = seeds.len().div_ceil(MAX_SEEDS).max(1);
        let seeds: Vec<DVec3> = seeds.into_iter().step_by(step).collect();
        let escapes = |seed: &DVec3| (0..WALKS).any(|i| walk_escapes(geometry, *seed, i));
        open |= seeds.is_empty() || seeds.iter().any(escapes);
        Self { seeds, open }
    }

    /// Whether sound can go from a seed to `point` (m) through the air; unbounded air is one region. A point counts as outside
    /// only if none of its walks finds a seed.
    pub(crate) fn reaches(&self, geometry: &Geometry, point: DVec3) -> bool {
        if self.seeds.is_empty() || self.sees_a_seed(geometry, point) {
            return true;
        }
        for i in 0..WALKS {
            let mut walk = Walk::new(geometry, point, spread(i, WALKS), i);
            for _ in 0..STOPS {
                match walk.next() {
                    None => return self.open,
                    Some(stop) if self.sees_a_seed_from(geometry, &stop) => return true,
                    Some(_) => {}
                }
            }
        }
        false
    }

    fn sees_a_seed(&self, geometry: &Geometry, point: DVec3) -> bool {
        self.seeds.iter().any(|seed| open_air(geometry, point, *seed, Skip::NONE))
    }

    /// The same from a stop on a surface, for seeds on the side that the walk came from.
    fn sees_a_seed_from(&self, geometry: &Geometry, stop: &Stop) -> bool {
        let surface = &geometry.surfaces[stop.surface];
        let skip = Skip { plane: Some(surface.plane), group: None };
        let same_side = |seed: &DVec3| ((*seed - stop.point).dot(surface.frame.normal) > 0.0) == stop.in_front;
        self.seeds.iter().any(|seed| same_side(seed) && open_air(geometry, stop.point, *seed, skip))
    }
}

/// Whether only portals stand between two points.
fn open_air(geometry: &Geometry, from: DVec3, to: DVec3, skip: Skip) -> bool {
    geometry.segment(from, to, skip, Skip::NONE).iter().all(|h| matches!(h.element, Element::Portal(_)))
}

fn walk_escapes(geometry: &Geometry, from: DVec3, stream: usize) -> bool {
    let mut walk = Walk::new(geometry, from, spread(stream, WALKS), stream);
    (0..STOPS).any(|_| walk.next().is_none())
}
