//! Image sources: which specular chains reach a point, and what they lose on the way.

use glam::DVec3;

use super::beam::may_reach;
use crate::geometry::{Element, Geometry, Plane, Skip};
use crate::scene::{Directivity, Scene, Source, SourceKind};

/// Where the sound of an image comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// From a position in m (point and line sources).
    At(DVec3),
    /// A plane wave.
    Along {
        /// Unit vector along which it travels.
        direction: DVec3,
        /// A point in m on the front from which its way is counted.
        from_m: DVec3,
    },
}

impl Origin {
    /// Unit direction from `point` towards the origin.
    pub fn direction_from(&self, point: DVec3) -> DVec3 {
        match *self {
            Self::At(position) => (position - point).normalize_or(DVec3::Z),
            Self::Along { direction, .. } => -direction,
        }
    }

    /// Length in m of the straight way from the origin to `point`; of a plane wave negative before it has reached its `from_m`.
    pub fn length_m(&self, point: DVec3) -> f64 {
        match *self {
            Self::At(position) => (point - position).length(),
            Self::Along { direction, from_m } => (point - from_m).dot(direction),
        }
    }

    /// Whether two origins are the same within 1e-6 m (or 1e-9 rad).
    pub fn coincides(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::At(a), Self::At(b)) => a.distance_squared(*b) < 1e-12,
            (Self::Along { direction: a, .. }, Self::Along { direction: b, from_m }) => {
                a.distance_squared(*b) < 1e-18 && self.length_m(*from_m).abs() < 1e-6
            }
            _ => false,
        }
    }

    fn mirrored(&self, point: DVec3, normal: DVec3) -> Self {
        let turned = |v: DVec3| v - normal * (2.0 * v.dot(normal));
        let beyond = |p: DVec3| point + turned(p - point);
        match *self {
            Self::At(p) => Self::At(beyond(p)),
            Self::Along { direction, from_m } => Self::Along { direction: turned(direction), from_m: beyond(from_m) },
        }
    }
}

/// A source, or its mirror image in a chain of planes.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// The mirrored origin.
    pub origin: Origin,
    /// Plane ids in the order of reflection, counted from the source.
    pub planes: Vec<usize>,
    /// Index of the image without the last reflection; the source itself has none.
    pub(super) parent: Option<usize>,
}

impl Image {
    /// Whether the reflection next to what sees the image is by one of these planes.
    pub(super) fn is_last_in(&self, planes: &[usize]) -> bool {
        self.planes.last().is_some_and(|plane| planes.contains(plane))
    }
}

/// A source (or probe, by reciprocity) with its images.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageTree {
    /// The source first, then its images, each after its parent.
    pub images: Vec<Image>,
    directivity: Option<Directivity>,
    /// Whether there are walls with air on both sides.
    thin_walls: bool,
    /// Length of the last leg's check for plane waves in m.
    far_m: f64,
}

/// What a specular chain leaves of the energy, one factor a band.
#[derive(Debug, Clone, PartialEq)]
pub struct Loss {
    /// Reflected, transmitted and emitted share, without spreading and air.
    pub factors: Vec<f64>,
    /// Names of the reflecting surfaces, from the source on.
    pub surfaces: Vec<usize>,
}

impl ImageTree {
    /// The images of `source` up to `order` reflections.
    pub fn of_source(source: &Source, geometry: &Geometry, order: usize) -> Self {
        let origin = match source.kind {
            SourceKind::Plane(direction) => Origin::Along { direction, from_m: source.position_m },
            SourceKind::Point | SourceKind::Line(_) => Origin::At(source.position_m),
        };
        let directivity = (source.kind == SourceKind::Point).then_some(source.directivity);
        Self::new(origin, directivity, geometry, order)
    }

    /// The images of a probe at `position_m`: sound takes every way in both directions alike.
    pub fn of_probe(position_m: DVec3, geometry: &Geometry, order: usize) -> Self {
        Self::new(Origin::At(position_m), None, geometry, order)
    }

    fn new(origin: Origin, directivity: Option<Directivity>, geometry: &Geometry, order: usize) -> Self {
        let mut images = vec![Image { origin, planes: Vec::new(), parent: None }];
        let outlines: Vec<Vec<DVec3>> = geometry.planes().iter().map(Plane::corners_m).collect();
        let mut first = 0;
        for _ in 0..order {
            let last = images.len();
            for parent in first..last {
                for (id, plane) in geometry.planes().iter().enumerate() {
                    if images[parent].planes.last() == Some(&id) || plane.surfaces.is_empty() {
                        continue;
                    }
                    if let Origin::At(p) = images[parent].origin
                        && (p - plane.point_m).dot(plane.normal).abs() < 1e-9
                    {
                        continue;
                    }
                    let corners = &outlines[id];
                    if !corners.is_empty() && !may_reach(&images, geometry, parent, corners) {
                        continue;
                    }
                    let origin = images[parent].origin.mirrored(plane.point_m, plane.normal);
                    let mut planes = images[parent].planes.clone();
                    planes.push(id);
                    images.push(Image { origin, planes, parent: Some(parent) });
                }
            }
            first = last;
        }
        let thin_walls = geometry.surfaces.iter().any(|s| !s.one_sided);
        Self { images, directivity, thin_walls, far_m: 1e4 * geometry.extent_m.max(1.0) }
    }

    /// Unit vector from the probe itself towards where sound comes from that reaches its image `image` from `point` (m).
    pub fn heard_from(&self, geometry: &Geometry, image: usize, point: DVec3) -> DVec3 {
        let Image { origin, planes, .. } = &self.images[image];
        let seen = match *origin {
            Origin::At(position) => (point - position).normalize_or_zero(),
            Origin::Along { .. } => DVec3::ZERO,
        };
        planes.iter().rev().map(|plane| geometry.planes()[*plane].normal).fold(seen, |d, n| d - n * (2.0 * d.dot(n)))
    }

    /// Number of images up to `order` for `planes` distinct planes.
    pub fn count(planes: usize, order: usize) -> f64 {
        let next = planes.saturating_sub(1) as f64;
        1.0 + (0..order).map(|n| planes as f64 * next.powi(n as i32)).sum::<f64>()
    }

    /// Follows the chain of `image` back from `from` (standing on what `skip` names); `None` if it does not exist: a
    /// reflection point is not on its surface, or something opaque or a portal is in the way.
    pub fn arrive(&self, scene: &Scene, geometry: &Geometry, image: usize, from: DVec3, skip: Skip) -> Option<Loss> {
        let mut loss = Loss { factors: vec![1.0; scene.bands.len()], surfaces: Vec::new() };
        let (mut at, mut skip) = (from, skip);
        // Where the last leg of some length began: of two reflections in a corner the second has none.
        let mut start = from;
        let mut current = image;
        while let Some(parent) = self.images[current].parent {
            let plane = *self.images[current].planes.last()?;
            let mirrored = self.images[current].origin;
            let direction = mirrored.direction_from(at);
            loop {
                // The mirror plane lies between the point and the image, or there is no reflection.
                let range = match mirrored {
                    Origin::At(position) => (position - at).length(),
                    Origin::Along { .. } => f64::INFINITY,
                };
                let hit = geometry.closest(at, direction, range, skip)?;
                let Element::Surface(id) = hit.element else { return None };
                let material = &scene.materials[geometry.surfaces[id].material];
                at = hit.point;
                if hit.plane == plane {
                    // Sound in the plane itself only grazes it (at an edge it might seem to meet it).
                    let Plane { point_m, normal, .. } = &geometry.planes()[plane];
                    if (start - *point_m).dot(*normal).abs() < 1e-9 {
                        return None;
                    }
                    if hit.t > 1e-9 {
                        start = at;
                    }
                    for (f, (a, s)) in loss.factors.iter_mut().zip(material.absorption.iter().zip(&material.scattering))
                    {
                        *f *= (1.0 - a) * (1.0 - s);
                    }
                    loss.surfaces.push(id);
                    skip = Skip::reflected(&hit);
                    let before = self.images[parent].planes.last();
                    if self.thin_walls && pinched(geometry, &self.images[parent].origin, at, skip, before) {
                        return None;
                    }
                    break;
                }
                transmit(&mut loss.factors, material.transmission.as_deref()?);
                skip = Skip::passed(&hit);
            }
            current = parent;
        }
        let origin = self.images[current].origin;
        let end = match origin {
            Origin::At(position) => position,
            Origin::Along { direction, .. } => at - direction * self.far_m,
        };
        for hit in geometry.segment(at, end, skip, Skip::NONE) {
            let Element::Surface(id) = hit.element else { return None };
            let material = &scene.materials[geometry.surfaces[id].material];
            transmit(&mut loss.factors, material.transmission.as_deref()?);
        }
        if let Some(directivity) = &self.directivity {
            let emitted = directivity.intensity(-origin.direction_from(at));
            loss.factors.iter_mut().for_each(|f| *f *= emitted);
        }
        loss.surfaces.reverse();
        loss.factors.iter().any(|f| *f > 0.0).then_some(loss)
    }
}

/// Whether a wall stands on the very point `at` of a reflection, between the sound before and after it (the foot of a
/// barrier): neither of the two legs crosses it, the reflected sound does. A wall that reflects next is no obstacle.
fn pinched(geometry: &Geometry, origin: &Origin, at: DVec3, skip: Skip, next: Option<&usize>) -> bool {
    const STEP_M: f64 = 1e-6;
    let onward = origin.direction_from(at);
    let hits = geometry.segment(at - onward * STEP_M, at + onward * STEP_M, skip, Skip::NONE);
    hits.iter().any(|hit| matches!(hit.element, Element::Surface(_)) && Some(&hit.plane) != next)
}

fn transmit(factors: &mut [f64], transmission: &[f64]) {
    factors.iter_mut().zip(transmission).for_each(|(f, t)| *f *= t);
}
