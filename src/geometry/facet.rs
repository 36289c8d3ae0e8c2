//! The primitive of all ray queries: a triangle or parallelogram with an inclusive f64 test.

use glam::DVec3;

/// Set in [`Facet::element`] for portals; the other bits are the index.
pub(crate) const PORTAL_BIT: u32 = 1 << 31;

/// Set in [`Facet::group`] for the rims of thick walls.
const RIM_BIT: u32 = 1 << 31;

/// A triangle or parallelogram, 128 bytes, coordinates relative to the scene's centre.
///
/// A ray meets the plane at t = (d - n.o)/(n.s); the point lies inside if its two affine coordinates (1 at the far
/// side) satisfy u >= 0, v >= 0 and u + v <= 1 (triangle) or u <= 1, v <= 1 (parallelogram). Every limit is widened
/// by the scene's rounding margin in m, so that neighbours overlap and nothing passes between them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facet {
    normal: DVec3,
    distance: f64,
    gradient_u: DVec3,
    offset_u: f64,
    gradient_v: DVec3,
    offset_v: f64,
    margin_u: f64,
    margin_v: f64,
    limit_sum: f64,
    /// Plane id.
    pub(crate) plane: u32,
    group: u32,
}

/// The corner and sides a facet is made of, and what it belongs to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FacetShape {
    /// Corner in m, relative to the scene's centre.
    pub(crate) corner: DVec3,
    /// First side in m.
    pub(crate) side_u: DVec3,
    /// Second side in m.
    pub(crate) side_v: DVec3,
    /// Whether the fourth corner belongs to it.
    pub(crate) parallelogram: bool,
    /// Unit normal of the surface.
    pub(crate) normal: DVec3,
    /// Surface index, or portal index with [`PORTAL_BIT`].
    pub(crate) element: u32,
    /// Plane id.
    pub(crate) plane: u32,
    /// Group id.
    pub(crate) group: u32,
    /// Whether it is the rim of a thick wall.
    pub(crate) is_rim: bool,
}

impl FacetShape {
    /// The three or four corners in m, relative to the scene's centre.
    pub(crate) fn corners(&self) -> impl Iterator<Item = DVec3> {
        let far = if self.parallelogram { self.side_u + self.side_v } else { self.side_u };
        [self.corner, self.corner + self.side_u, self.corner + self.side_v, self.corner + far].into_iter()
    }

    /// The corners in order round the facet, in m, relative to the scene's centre.
    pub(crate) fn ring(&self) -> Vec<DVec3> {
        let (a, b, c) = (self.corner, self.corner + self.side_u, self.corner + self.side_v);
        if self.parallelogram { vec![a, b, b + self.side_v, c] } else { vec![a, b, c] }
    }

    /// Distance in m from a point (relative to the scene's centre) to the nearest point of the facet.
    pub(crate) fn distance(&self, p: DVec3) -> f64 {
        let q = p - self.corner;
        let (u, v) = (self.side_u, self.side_v);
        let cross = u.cross(v);
        let n2 = cross.length_squared();
        let (a, b) = (q.cross(v).dot(cross) / n2, u.cross(q).dot(cross) / n2);
        let inside = a >= 0.0 && b >= 0.0 && if self.parallelogram { a <= 1.0 && b <= 1.0 } else { a + b <= 1.0 };
        if inside {
            return q.dot(self.normal).abs();
        }
        let to_side = |from: DVec3, side: DVec3| {
            let r = q - from;
            let s = (r.dot(side) / side.length_squared()).clamp(0.0, 1.0);
            (r - side * s).length()
        };
        let near = to_side(DVec3::ZERO, u).min(to_side(DVec3::ZERO, v));
        if self.parallelogram { near.min(to_side(u, v)).min(to_side(v, u)) } else { near.min(to_side(u, v - u)) }
    }
}

impl Facet {
    /// Precomputes the test; `None` for a facet without area.
    pub(crate) fn new(shape: &FacetShape, margin_m: f64) -> Option<Self> {
        let (u, v, n) = (shape.side_u, shape.side_v, shape.normal);
        let (across_v, across_u) = (v.cross(n), n.cross(u));
        let det = u.dot(across_v);
        let gradient_u = across_v / det;
        let gradient_v = across_u / v.dot(across_u);
        let facet = Self {
            normal: n,
            distance: n.dot(shape.corner),
            gradient_u,
            offset_u: -gradient_u.dot(shape.corner),
            gradient_v,
            offset_v: -gradient_v.dot(shape.corner),
            margin_u: margin_m * gradient_u.length(),
            margin_v: margin_m * gradient_v.length(),
            limit_sum: if shape.parallelogram { 3.0 } else { 1.0 + margin_m * (gradient_u + gradient_v).length() },
            plane: shape.plane,
            group: if shape.is_rim { shape.group | RIM_BIT } else { shape.group },
        };
        (gradient_u.is_finite() && gradient_v.is_finite()).then_some(facet)
    }

    /// Distance along the ray from `origin` (relative to the scene's centre) to the facet's plane; may be negative, infinite
    /// or NaN (a ray in parallel), with which [`Facet::contains`] fails.
    #[inline(always)]
    pub(crate) fn meet_plane(&self, origin: DVec3, direction: DVec3) -> f64 {
        (self.distance - self.normal.dot(origin)) / self.normal.dot(direction)
    }

    /// Unit normal, and the plane's distance from the scene's centre along it in m.
    pub(crate) fn plane_equation(&self) -> (DVec3, f64) {
        (self.normal, self.distance)
    }

    /// Whether two facets lie in one plane but for rounding, whichever way they face.
    pub(crate) fn shares_plane(&self, other: &Self, rounding_m: f64) -> bool {
        let turn = self.turn(other);
        self.plane == other.plane
            && self.normal == other.normal * turn
            && (self.distance - other.distance * turn).abs() <= rounding_m
    }

    /// Moves a facet that shares its plane with `other` into that plane to the last bit: a change of both signs leaves all
    /// distances along rays the same.
    pub(crate) fn settle(&mut self, other: &Self) {
        self.distance = other.distance * self.turn(other);
    }

    /// 1 if the normal points to the side of the other's, else -1.
    fn turn(&self, other: &Self) -> f64 {
        1.0_f64.copysign(self.normal.dot(other.normal))
    }

    /// Whether the projection of a point (relative to the scene's centre) on the plane lies in the facet, borders
    /// included.
    #[inline(always)]
    pub(crate) fn contains(&self, p: DVec3) -> bool {
        let u = self.gradient_u.dot(p) + self.offset_u;
        let v = self.gradient_v.dot(p) + self.offset_v;
        (u >= -self.margin_u)
            & (v >= -self.margin_v)
            & (u <= 1.0 + self.margin_u)
            & (v <= 1.0 + self.margin_v)
            & (u + v <= self.limit_sum)
    }

    /// Group id.
    #[inline(always)]
    pub(crate) fn group(&self) -> u32 {
        self.group & !RIM_BIT
    }

    /// Whether a ray would leave a thick wall sideways here.
    #[inline(always)]
    pub(crate) fn is_rim_from_within(&self, direction: DVec3) -> bool {
        self.group & RIM_BIT != 0 && self.normal.dot(direction) > 0.0
    }

    /// Whether the ray runs against the normal.
    #[inline(always)]
    pub(crate) fn faces(&self, direction: DVec3) -> bool {
        self.normal.dot(direction) < 0.0
    }
}
