//! What a source or probe may not touch.

use glam::DVec3;

use crate::error::{Result, Warning};
use crate::scene::locate::Locator;
use crate::scene::polygon;
use crate::scene::{BoxRoom, Face, Host, Mesh, Opening, Wall};

/// Nearer than this to a surface is on it, and nearer to each other is at the same point, in m.
pub(super) const TOUCH_M: f64 = 1e-6;

/// All that has a surface.
pub(super) struct Matter<'a> {
    pub(super) boxes: &'a [BoxRoom],
    pub(super) walls: &'a [Wall],
    pub(super) meshes: &'a [Mesh],
    pub(super) openings: &'a [Opening],
}

impl Matter<'_> {
    /// Refuses a point on a surface or inside a wall; a point in the plane of a thin opening is warned of.
    pub(super) fn check(
        &self,
        what: &str,
        name: &str,
        p: DVec3,
        span: std::ops::Range<usize>,
        at: &Locator<'_>,
        warnings: &mut Vec<Warning>,
    ) -> Result<()> {
        if let Some(opening) = self.openings.iter().find(|opening| self.in_thin_opening(opening, p)) {
            warnings.push(Warning {
                observation: format!("{what} `{name}` lies in the plane of the opening `{}`", opening.name),
                remedy: "levels there belong to both sides; move it by 1 mm or more to the side you mean".to_owned(),
            });
            return Ok(());
        }
        match self.touching(p) {
            None => Ok(()),
            Some(place) => Err(at.error(
                span,
                format!("{what} `{name}` lies {place}, must stand clear of all surfaces"),
                "move it by 1 mm or more to the side you mean",
            )),
        }
    }

    /// Whether a point lies in the open part of an opening without thickness.
    fn in_thin_opening(&self, opening: &Opening, p: DVec3) -> bool {
        let thickness_m = match opening.host {
            Host::Wall(index) => self.walls[index].thickness_m,
            Host::BoxFace(..) => 0.0,
        };
        let local = opening.frame.local(p);
        let within = |value: f64, [low, high]: [f64; 2]| value > low + TOUCH_M && value < high - TOUCH_M;
        thickness_m == 0.0
            && local.z.abs() <= TOUCH_M
            && within(local.x, opening.open_x_m)
            && within(local.y, opening.y_m)
    }

    /// What the point lies in or on, as "on the wall `x`".
    fn touching(&self, p: DVec3) -> Option<String> {
        for (index, wall) in self.walls.iter().enumerate() {
            let local = wall.frame.local(p);
            if local.z.abs() > wall.thickness_m / 2.0 + TOUCH_M {
                continue;
            }
            if wall.unbounded || polygon::contains(&wall.outline_m(), local.truncate(), TOUCH_M) {
                return Some(match self.opening_at(Host::Wall(index), local) {
                    Some(opening) if wall.thickness_m > 0.0 => {
                        format!("inside the wall, in its opening `{}`", opening.name)
                    }
                    Some(opening) => format!("on the edge or the leaf of the opening `{}`", opening.name),
                    None if wall.thickness_m > 0.0 => format!("inside the wall `{}`", wall.name),
                    None => format!("on the wall `{}`", wall.name),
                });
            }
        }
        for (index, room) in self.boxes.iter().enumerate() {
            for face in Face::ALL.into_iter().filter(|face| room.face(*face).is_some()) {
                let local = room.face_frame(face).local(p);
                let [w, h] = room.face_size_m(face);
                let within = |value: f64, length: f64| (-TOUCH_M..=length + TOUCH_M).contains(&value);
                if local.z.abs() <= TOUCH_M && within(local.x, w) && within(local.y, h) {
                    return Some(match self.opening_at(Host::BoxFace(index, face), local) {
                        Some(opening) => format!("on the edge or the leaf of the opening `{}`", opening.name),
                        None => format!("on the face {} of box `{}`", face.name(), room.name),
                    });
                }
            }
        }
        let on_mesh = |mesh: &&Mesh| mesh.triangles_m.iter().any(|triangle| triangle_distance(p, triangle) <= TOUCH_M);
        self.meshes.iter().find(on_mesh).map(|mesh| format!("on a triangle of mesh `{}`", mesh.file.display()))
    }

    fn opening_at(&self, host: Host, local: DVec3) -> Option<&Opening> {
        let inside = |o: &&Opening| {
            o.host == host
                && (o.hole_x_m[0]..=o.hole_x_m[1]).contains(&local.x)
                && (o.y_m[0]..=o.y_m[1]).contains(&local.y)
        };
        self.openings.iter().find(inside)
    }
}

/// Distance of a point from a triangle in m.
fn triangle_distance(p: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let [a, b, c] = *triangle;
    let normal = (b - a).cross(c - a);
    let inside = polygon::edges(triangle).all(|(u, v)| (v - u).cross(p - u).dot(normal) >= 0.0);
    if inside {
        return normal.try_normalize().map_or(f64::INFINITY, |n| (p - a).dot(n).abs());
    }
    let to_edge = |(u, v): (DVec3, DVec3)| {
        let along = v - u;
        let t = ((p - u).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (u + along * t - p).length()
    };
    polygon::edges(triangle).map(to_edge).fold(f64::INFINITY, f64::min)
}
