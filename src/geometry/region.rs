//! Which points share the air of the scene's sources and probes.

use glam::DVec3;

use super::walk::{Walk, spread};
use super::{Element, Geometry, Skip};
use crate::scene::{Scene, SourceKind};

/// At most this many positions stand for the sources and probes.
const MAX_SEEDS: usize = 64;
/// Walks from a point, and surfaces met by each, before two regions count as separate.
const WALKS: usize = 64;
const STOPS: usize = 16;

/// At most this many points known to lie elsewhere are kept.
const MAX_APART: usize = 64;

/// The air in which the sources and probes stand.
pub(crate) struct Region {
    /// Points in it: sources and probes first.
    inside: Vec<DVec3>,
    /// Points in other, closed regions.
    apart: Vec<DVec3>,
    /// Whether it is unbounded.
    open: bool,
}

/// What is known about a point.
enum Verdict {
    Inside,
    Apart,
    Unknown,
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
        let inside: Vec<DVec3> = seeds.into_iter().step_by(step).collect();
        let escapes = |seed: &DVec3| (0..WALKS).any(|i| walk_escapes(geometry, *seed, i));
        open |= inside.is_empty() || inside.iter().any(escapes);
        Self { inside, apart: Vec::new(), open }
    }

    /// Whether sound can go from a source or probe to `point` (m) through the air; unbounded air is one region. A
    /// point counts as outside only if none of its walks finds the region.
    pub(crate) fn reaches(&mut self, geometry: &Geometry, point: DVec3) -> bool {
        if self.inside.is_empty() {
            return true;
        }
        match self.explore(geometry, point) {
            Verdict::Inside => true,
            Verdict::Apart => false,
            Verdict::Unknown => {
                if self.apart.len() < MAX_APART {
                    self.apart.push(point);
                }
                false
            }
        }
    }

    fn explore(&self, geometry: &Geometry, point: DVec3) -> Verdict {
        let anywhere = |_: DVec3| true;
        match self.seen(geometry, point, Skip::NONE, anywhere) {
            Verdict::Unknown => {}
            known => return known,
        }
        for i in 0..WALKS {
            let mut walk = Walk::new(geometry, point, spread(i, WALKS), i);
            for _ in 0..STOPS {
                let Some(stop) = walk.next() else {
                    return if self.open { Verdict::Inside } else { Verdict::Apart };
                };
                let surface = &geometry.surfaces[stop.surface];
                let skip = Skip { plane: Some(surface.plane), group: None };
                let same_side = |p: DVec3| ((p - stop.point).dot(surface.frame.normal) > 0.0) == stop.in_front;
                match self.seen(geometry, stop.point, skip, same_side) {
                    Verdict::Unknown => {}
                    known => return known,
                }
            }
        }
        Verdict::Unknown
    }

    /// Whether a known point is in sight.
    fn seen(&self, geometry: &Geometry, from: DVec3, skip: Skip, eligible: impl Fn(DVec3) -> bool) -> Verdict {
        let sees = |p: &DVec3| eligible(*p) && open_air(geometry, from, *p, skip);
        if self.inside.iter().any(sees) {
            Verdict::Inside
        } else if self.apart.iter().any(sees) {
            Verdict::Apart
        } else {
            Verdict::Unknown
        }
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
