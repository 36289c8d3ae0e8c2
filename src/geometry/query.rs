//! Ray queries: closest hit, blocked segments, all hits along a segment, distance to the nearest surface.

use glam::DVec3;

use super::facet::PORTAL_BIT;
use super::planes::COPLANAR_M;
use super::{Element, Geometry, Hit, Skip};

/// Two hits nearer than this times (1 + distance in m) are at the same distance.
const TIE: f64 = 1e-9;

/// A skip as the facets store ids; `u32::MAX` is no id.
#[derive(Clone, Copy)]
struct Skipped {
    plane: u32,
    group: u32,
}

impl From<Skip> for Skipped {
    fn from(skip: Skip) -> Self {
        let id = |i: Option<usize>| i.map_or(u32::MAX, |i| i as u32);
        Self { plane: id(skip.plane), group: id(skip.group) }
    }
}

impl Skipped {
    #[inline(always)]
    fn covers(self, plane: u32, group: u32) -> bool {
        (plane == self.plane) | (group == self.group)
    }
}

/// How a surface is met; of hits at equal distance the lower one counts.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    /// The rim of the thick wall that the ray is passing through, from within.
    Within,
    /// A surface that faces the ray, or has two sides.
    Front,
    /// A one-sided surface from behind.
    Back,
}

/// A hit in the making.
#[derive(Clone, Copy)]
struct Candidate {
    t: f64,
    /// Then the lower index counts, surfaces before portals.
    rank: (Side, u32),
    plane: u32,
    group: u32,
}

impl Geometry {
    /// The nearest surface or portal along the ray from `origin` (m) in the unit `direction`, nearer than `t_max` (m).
    ///
    /// At equal distance (within 1e-9 (1 + t)) the surface whose normal faces the ray wins, then the lower index,
    /// surfaces before portals. A one-sided surface within rounding of the origin is met if the ray runs against its
    /// normal, any other if it does not lie behind the origin. A skipped group still shows the rims of its wall from
    /// within, so that a ray which passes a thick wall or its portal leaves it through a face and not sideways (see
    /// [`Hit::inside`]).
    #[inline]
    pub fn closest(&self, origin: DVec3, direction: DVec3, t_max: f64, skip: Skip) -> Option<Hit> {
        let skip = Skipped::from(skip);
        let plain = self.plain_hit(origin, direction, t_max, skip);
        if plain.is_some() { plain } else { self.contested_hit(origin, direction, t_max, skip) }
    }

    /// The nearest hit where no other facet comes near it, in scenes of few planes: most hits there.
    #[inline(always)]
    fn plain_hit(&self, origin: DVec3, direction: DVec3, t_max: f64, skip: Skipped) -> Option<Hit> {
        let few = self.tree.few.as_ref().filter(|_| self.screens.is_empty())?;
        let o = origin - self.centre_m;
        let (facets, shapes) = (&self.tree.facets, &self.tree.shapes);
        let range = (-self.tolerance_m, t_max);
        let clear_of = |t: f64| t + 2.0 * TIE * (1.0 + t);
        let (i, t) = few.sole(o, direction, range, skip.plane, clear_of, |i, point| facets[i].contains(point))?;
        let (facet, element) = (&facets[i], shapes[i].element);
        (t > self.tolerance_m && t < t_max && facet.group() != skip.group).then(|| {
            let rank = (Side::Front, element);
            self.hit(origin, direction, Candidate { t, rank, plane: facet.plane, group: facet.group() })
        })
    }

    /// The nearest hit, whatever else is met near it.
    fn contested_hit(&self, origin: DVec3, direction: DVec3, t_max: f64, skip: Skipped) -> Option<Hit> {
        let o = origin - self.centre_m;
        let mut best: Option<Candidate> = None;
        let mut limit = t_max;
        // answers whether the hit counts, and shortens the ray
        let mut consider = |limit: &mut f64, t: f64, rank: (Side, u32), plane: u32, group: u32| {
            // t may be NaN: written so that NaN fails
            if !(t >= -self.tolerance_m && t < *limit) {
                return false;
            }
            if t <= self.tolerance_m && (rank.0 == Side::Back || (t < 0.0 && !self.is_one_sided(rank.1))) {
                return false;
            }
            if let Some(b) = best {
                let same = (t - b.t).abs() <= TIE * (1.0 + b.t);
                if (same && (rank > b.rank || (rank == b.rank && t >= b.t))) || (!same && t > b.t) {
                    return false;
                }
            }
            best = Some(Candidate { t, rank, plane, group });
            *limit = (t + TIE * (1.0 + t)).min(t_max);
            true
        };
        for screen in &self.screens {
            if let Some((t, element, group)) = screen.meet(o, direction)
                && !skip.covers(screen.plane as u32, group as u32)
            {
                let rank = (self.side(element, screen.faces(direction)), element);
                consider(&mut limit, t, rank, screen.plane as u32, group as u32);
            }
        }
        self.tree.visit(o, direction, limit, skip.plane, |i, facet, t| {
            let within = facet.group() == skip.group && facet.is_rim_from_within(direction);
            if facet.plane == skip.plane || (facet.group() == skip.group && !within) {
                return None;
            }
            if !(t < limit && facet.contains(o + direction * t)) {
                return None;
            }
            let element = self.tree.shapes[i].element;
            let side = if within { Side::Within } else { self.side(element, facet.faces(direction)) };
            consider(&mut limit, t, (side, element), facet.plane, facet.group()).then_some(limit)
        });
        best.map(|b| self.hit(origin, direction, b))
    }

    /// Whether any surface or portal lies strictly between two points (m).
    ///
    /// Hits within 1e-9 (1 + length) of an end point do not block. The skips name what the end points stand on and
    /// hold along the whole segment. Points on an edge of a solid need none.
    pub fn blocked(&self, from: DVec3, to: DVec3, skip_from: Skip, skip_to: Skip) -> bool {
        let Some((direction, range)) = self.between(from, to) else { return false };
        let (a, b) = (Skipped::from(skip_from), Skipped::from(skip_to));
        let o = from - self.centre_m;
        let skipped = |plane: u32, group: u32| a.covers(plane, group) | b.covers(plane, group);
        for screen in &self.screens {
            let plane = screen.plane as u32;
            if let Some((t, _, group)) = screen.meet(o, direction)
                && range.contains(&t)
                && !skipped(plane, group as u32)
            {
                return true;
            }
        }
        let mut blocked = false;
        self.tree.visit(o, direction, range.end, a.plane, |_, facet, t| {
            if skipped(facet.plane, facet.group()) {
                return None;
            }
            blocked |= range.contains(&t) && facet.contains(o + direction * t);
            blocked.then_some(f64::NEG_INFINITY)
        });
        blocked
    }

    /// Everything strictly between two points (m) in order, each group once and of touching surfaces in one plane the
    /// one that faces the ray: multiply the transmission of the surfaces, stop at a portal.
    ///
    /// End points and skips as in [`Geometry::blocked`]; `t` counts from `from`.
    pub fn segment(&self, from: DVec3, to: DVec3, skip_from: Skip, skip_to: Skip) -> Vec<Hit> {
        let Some((direction, range)) = self.between(from, to) else { return Vec::new() };
        let (a, b) = (Skipped::from(skip_from), Skipped::from(skip_to));
        let o = from - self.centre_m;
        let mut found: Vec<Candidate> = Vec::new();
        let mut consider = |t: f64, element: u32, plane: u32, group: u32, faces: bool| {
            if range.contains(&t) && !a.covers(plane, group) && !b.covers(plane, group) {
                let rank = (self.side(element, faces), element);
                found.push(Candidate { t, rank, plane, group });
            }
        };
        for screen in &self.screens {
            if let Some((t, element, group)) = screen.meet(o, direction) {
                consider(t, element, screen.plane as u32, group as u32, screen.faces(direction));
            }
        }
        self.tree.visit(o, direction, range.end, a.plane, |i, facet, t| {
            if facet.contains(o + direction * t) {
                consider(t, self.tree.shapes[i].element, facet.plane, facet.group(), facet.faces(direction));
            }
            None
        });
        found.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.rank.cmp(&b.rank)));
        let mut hits: Vec<Candidate> = Vec::new();
        for c in found {
            if hits.iter().any(|h| h.group == c.group) {
                continue;
            }
            match hits.last_mut() {
                Some(last) if last.plane == c.plane => {
                    if c.rank < last.rank {
                        *last = c;
                    }
                }
                _ => hits.push(c),
            }
        }
        hits.into_iter().map(|c| self.hit(from, direction, c)).collect()
    }

    /// Distance in m from a point (m) to the nearest surface, portals not counted; infinite in an empty scene.
    pub fn closest_surface_distance(&self, point: DVec3) -> f64 {
        let p = point - self.centre_m;
        let facets = self.tree.shapes.iter().filter(|s| s.element & PORTAL_BIT == 0).map(|s| s.distance(p));
        facets.chain(self.screens.iter().map(|s| s.distance(p))).fold(f64::INFINITY, f64::min)
    }

    /// The surface or portal of a plane (index in [`Geometry::planes`]) at a point of it (m), for a ray that arrives
    /// along `direction`; `None` where the plane has a hole or ends. For the mirror points of image sources.
    pub fn element_at(&self, plane: usize, point: DVec3, direction: DVec3) -> Option<Element> {
        let p = point - self.centre_m;
        let mut best: Option<(Side, u32)> = None;
        let mut consider = |rank: (Side, u32)| best = Some(best.map_or(rank, |b| b.min(rank)));
        for screen in self.screens.iter().filter(|s| s.plane == plane) {
            if let Some(element) = screen.element(p) {
                consider((self.side(element, screen.faces(direction)), element));
            }
        }
        let near = DVec3::splat(COPLANAR_M);
        self.tree.overlapping(p - near, p + near, |i| {
            let (facet, shape) = (&self.tree.facets[i], &self.tree.shapes[i]);
            if shape.plane as usize == plane && facet.contains(p) {
                consider((self.side(shape.element, facet.faces(direction)), shape.element));
            }
        });
        best.map(|(_, element)| decode(element))
    }

    /// Unit direction and the open range of distances strictly between two points; `None` if they coincide.
    fn between(&self, from: DVec3, to: DVec3) -> Option<(DVec3, std::ops::Range<f64>)> {
        let length = (to - from).length();
        let end = TIE * (1.0 + length) + self.tolerance_m;
        (length > 2.0 * end && length.is_finite()).then(|| ((to - from) / length, end..length - end))
    }

    #[inline(always)]
    fn is_one_sided(&self, element: u32) -> bool {
        element & PORTAL_BIT == 0 && self.surfaces[element as usize].one_sided
    }

    #[inline(always)]
    fn side(&self, element: u32, faces: bool) -> Side {
        if self.is_one_sided(element) && !faces { Side::Back } else { Side::Front }
    }

    #[inline(always)]
    fn hit(&self, origin: DVec3, direction: DVec3, c: Candidate) -> Hit {
        let t = c.t.max(0.0);
        let (element, group) = (decode(c.rank.1), c.group as usize);
        let inside = (c.rank.0 == Side::Within).then_some(group);
        Hit { t, point: origin + direction * t, element, plane: c.plane as usize, group, inside }
    }
}

#[inline(always)]
fn decode(element: u32) -> Element {
    let index = (element & !PORTAL_BIT) as usize;
    if element & PORTAL_BIT == 0 { Element::Surface(index) } else { Element::Portal(index) }
}
