//! The bounded planes that edges are looked for on: box faces, wall faces and rims before any hole is cut.

use glam::DVec3;

use super::Surface;
use super::cut::Piece;

/// A polygon with a border; coordinates relative to the scene's centre.
#[derive(Debug, Clone)]
pub(crate) struct Sheet {
    /// A point of the plane in m.
    pub(crate) point: DVec3,
    /// Unit normal.
    pub(crate) normal: DVec3,
    /// Border corners in m, in order; empty for an unbounded wall.
    pub(crate) ring: Vec<DVec3>,
    /// Convex parts of the polygon, corners in m.
    pub(crate) parts: Vec<Vec<DVec3>>,
    /// Openings in its plane, corners in m.
    pub(crate) holes: Vec<Vec<DVec3>>,
    /// Whether sound is only on the side of the normal.
    pub(crate) one_sided: bool,
    /// Whether it belongs to a box: where a wall coincides, the wall counts.
    pub(crate) is_box_face: bool,
    /// Whether it is the whole plane.
    pub(crate) unbounded: bool,
    /// Plane id.
    pub(crate) plane: usize,
    /// Group id.
    pub(crate) group: usize,
    /// Name of the surface.
    pub(crate) name: String,
}

impl Sheet {
    pub(crate) fn wall(surface: &Surface, ring_m: &[DVec3], pieces: &[Piece], centre: DVec3) -> Self {
        let frame = surface.frame;
        let corners = |piece: &Piece| piece.iter().map(|c| frame.point(c.x, c.y) - centre).collect();
        Self {
            point: frame.origin_m - centre,
            normal: frame.normal,
            ring: ring_m.iter().map(|c| *c - centre).collect(),
            parts: pieces.iter().map(corners).collect(),
            holes: Vec::new(),
            one_sided: surface.one_sided,
            is_box_face: false,
            unbounded: false,
            plane: surface.plane,
            group: surface.group,
            name: surface.name.clone(),
        }
    }

    pub(crate) fn box_face(surface: &Surface, corners_m: &[DVec3], centre: DVec3) -> Self {
        let mut sheet = Self::wall(surface, corners_m, &[], centre);
        sheet.parts = vec![sheet.ring.clone()];
        sheet.is_box_face = true;
        sheet
    }

    pub(crate) fn unbounded(surface: &Surface, centre: DVec3) -> Self {
        Self { unbounded: true, ..Self::wall(surface, &[], &[], centre) }
    }
}
