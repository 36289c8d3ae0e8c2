//! Which surfaces lie in one plane: plane ids by a hash over quantised planes.

use std::collections::HashMap;

use glam::DVec3;

/// A plane that holds at least one surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// A point of the plane in m.
    pub point_m: DVec3,
    /// Unit normal (that of the first surface found in it).
    pub normal: DVec3,
    /// Indices of its surfaces in [`super::Geometry::surfaces`], ascending.
    pub surfaces: Vec<usize>,
    /// The rectangle of what lies in it; `None` if that is unbounded.
    pub outline: Option<Outline>,
}

/// A rectangle in a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Unit vectors along its sides.
    pub axes: [DVec3; 2],
    /// Limits in m along them, counted from the plane's point.
    pub limits_m: [[f64; 2]; 2],
}

/// How far in m surfaces may lie apart and still share a plane.
pub(crate) const COPLANAR_M: f64 = 1e-6;

/// Width of a hash cell: of the components of the normal, and of the offset over the scene's extent.
const CELL: f64 = 1e-3;

/// Share of a cell next to its border from which the neighbouring cell is searched too: triangles of 1 cm with corners
/// rounded to 1e-6 m tilt by a tenth of a cell.
const BORDER: f64 = 0.1;

impl Plane {
    /// The corners of its outline in m, in order; empty if it is unbounded.
    pub fn corners_m(&self) -> Vec<DVec3> {
        let Some(Outline { axes: [u, v], limits_m: [[u0, u1], [v0, v1]] }) = self.outline else { return Vec::new() };
        [[u0, v0], [u1, v0], [u1, v1], [u0, v1]].map(|[a, b]| self.point_m + u * a + v * b).to_vec()
    }

    /// Widens the outline, whose sides have the directions `axes`, to `point` in m.
    pub(crate) fn widen(&mut self, axes: [DVec3; 2], point: DVec3) {
        let none = Outline { axes, limits_m: [[f64::INFINITY, f64::NEG_INFINITY]; 2] };
        let outline = self.outline.get_or_insert(none);
        for (axis, [low, high]) in outline.axes.iter().zip(&mut outline.limits_m) {
            let along = (point - self.point_m).dot(*axis);
            (*low, *high) = (low.min(along), high.max(along));
        }
    }
}

/// Hands out plane ids, in near-linear time.
pub(crate) struct PlaneBook {
    centre: DVec3,
    extent_m: f64,
    pub(crate) planes: Vec<Plane>,
    cells: HashMap<[i64; 4], Vec<usize>>,
}

impl PlaneBook {
    pub(crate) fn new(centre: DVec3, extent_m: f64) -> Self {
        Self { centre, extent_m: extent_m.max(1.0), planes: Vec::new(), cells: HashMap::new() }
    }

    /// The id of the plane through all `points_m`, known or new.
    pub(crate) fn id(&mut self, normal: DVec3, points_m: &[DVec3]) -> usize {
        let Some(&point_m) = points_m.first() else { return 0 };
        if let Some(id) = self.find(normal, points_m) {
            return id;
        }
        let id = self.planes.len();
        self.planes.push(Plane { point_m, normal, surfaces: Vec::new(), outline: None });
        for sign in [1.0, -1.0] {
            let key = self.cell(normal * sign, point_m).map(|c| c.floor() as i64);
            self.cells.entry(key).or_default().push(id);
        }
        id
    }

    /// The known plane through all `points_m`, if there is one.
    pub(crate) fn find(&self, normal: DVec3, points_m: &[DVec3]) -> Option<usize> {
        let &point_m = points_m.first()?;
        let cell = self.cell(normal, point_m);
        let base = cell.map(|c| c.floor() as i64);
        let step = cell.map(|c| match c - c.floor() {
            f if f < BORDER => -1,
            f if f > 1.0 - BORDER => 1,
            _ => 0,
        });
        let mut best = None;
        for corner in 0..16u32 {
            if (0..4).any(|i| corner >> i & 1 == 1 && step[i] == 0) {
                continue;
            }
            let key =
                std::array::from_fn(|i| if corner >> i & 1 == 1 { base[i].saturating_add(step[i]) } else { base[i] });
            for &id in self.cells.get(&key).into_iter().flatten() {
                let plane = &self.planes[id];
                let off = |p: &DVec3| plane.normal.dot(*p - plane.point_m).abs() > COPLANAR_M;
                if best.is_none_or(|b| id < b) && !points_m.iter().any(off) {
                    best = Some(id);
                }
            }
        }
        best
    }

    fn cell(&self, normal: DVec3, point_m: DVec3) -> [f64; 4] {
        let offset = normal.dot(point_m - self.centre) / self.extent_m;
        [normal.x, normal.y, normal.z, offset].map(|v| v / CELL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_faces_of_one_plane_share_their_id_and_parallel_planes_do_not() {
        let mut book = PlaneBook::new(DVec3::ZERO, 10.0);
        let square = |z: f64| [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, z));
        let a = book.id(DVec3::Z, &square(2.0));
        assert_eq!(book.id(-DVec3::Z, &square(2.0 + 5e-7)), a);
        assert_ne!(book.id(DVec3::Z, &square(2.0 + 5e-6)), a);
        assert_eq!(book.planes.len(), 2);
    }

    #[test]
    fn rounding_across_a_hash_cell_does_not_part_a_plane() {
        let mut book = PlaneBook::new(DVec3::ZERO, 1.0);
        for k in 0..200 {
            let z = k as f64 * CELL; // offsets on the borders of cells
            let a = book.id(DVec3::Z, &[DVec3::new(0.0, 0.0, z)]);
            let b = book.id(DVec3::new(1e-9, -1e-9, 1.0), &[DVec3::new(0.1, 0.0, z - 1e-9)]);
            assert_eq!(a, b);
        }
    }
}
