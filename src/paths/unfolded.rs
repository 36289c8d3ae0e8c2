//! Image sources by position: in rooms without diffraction, images that coincide are one and the same.
//!
//! Six planes of a box give 6 x 5^(n-1) chains of n reflections, but only 4 n^2 + 2 places of images. Which chain leads to
//! an image depends on the receiver; it is the one that a ray from the receiver towards the image meets, reflected until
//! its length is used up. That way is unique where every surface is opaque.

use std::collections::HashSet;

use glam::DVec3;

use super::images::{Loss, Origin};
use super::reach::EdgeReach;
use crate::geometry::{Element, Geometry, Skip};
use crate::scene::{Scene, Source, SourceKind};

/// Edge of the cells in m in which images count as one.
const CELL_M: f64 = 1e-6;

/// Whether images may be merged: nothing bends, nothing passes through a surface, and no wall has air on both sides.
pub(super) fn applies(scene: &Scene, geometry: &Geometry, reaches: &[EdgeReach]) -> bool {
    let opaque = |s: &crate::geometry::Surface| s.one_sided && scene.materials[s.material].transmission.is_none();
    geometry.portals.is_empty()
        && geometry.surfaces.iter().all(opaque)
        && scene.sources.iter().all(|s| s.kind == SourceKind::Point)
        && (scene.simulation.diffraction_order == 0 || !reaches.iter().any(|reach| reach.felt))
}

/// Positions in m of the source and its images up to `order` reflections, as far as there are no more than `most`; and
/// the order reached.
pub(super) fn positions(source: DVec3, geometry: &Geometry, order: usize, most: usize) -> (Vec<DVec3>, usize) {
    let cell = |p: DVec3| (p / CELL_M).round().to_array().map(|x| x as i64);
    let mut known = HashSet::from([cell(source)]);
    let mut found = vec![source];
    let mut first = 0;
    for reached in 0..order {
        let last = found.len();
        for parent in first..last {
            for plane in geometry.planes().iter().filter(|p| !p.surfaces.is_empty()) {
                let image = found[parent] - plane.normal * (2.0 * (found[parent] - plane.point_m).dot(plane.normal));
                if known.insert(cell(image)) {
                    found.push(image);
                }
            }
        }
        if found.len() > most {
            found.truncate(last);
            return (found, reached);
        }
        first = last;
    }
    (found, order)
}

/// The way from an image of `source` to `receiver`: its planes from the source on, and what is lost. `None` if there is none
/// with at most `order` reflections.
pub(super) fn arrive(
    scene: &Scene,
    geometry: &Geometry,
    source: &Source,
    image: DVec3,
    receiver: DVec3,
    order: usize,
) -> Option<(Vec<usize>, Loss)> {
    let mut loss = Loss { factors: vec![1.0; scene.bands.len()], surfaces: Vec::new() };
    let mut planes = Vec::new();
    let mut left_m = (image - receiver).length();
    let near_m = CELL_M * left_m.max(1.0);
    let (mut at, mut skip) = (receiver, Skip::NONE);
    let mut direction = Origin::At(image).direction_from(receiver);
    while let Some(hit) = geometry.closest(at, direction, left_m - near_m, skip) {
        let Element::Surface(id) = hit.element else { return None };
        if planes.len() == order {
            return None;
        }
        let material = &scene.materials[geometry.surfaces[id].material];
        for (f, (a, s)) in loss.factors.iter_mut().zip(material.absorption.iter().zip(&material.scattering)) {
            *f *= (1.0 - a) * (1.0 - s);
        }
        let normal = geometry.planes()[hit.plane].normal;
        at = hit.point;
        left_m -= hit.t;
        direction -= normal * (2.0 * direction.dot(normal));
        skip = Skip::reflected(&hit);
        loss.surfaces.push(id);
        planes.push(hit.plane);
    }
    let arrived = (at + direction * left_m - source.position_m).length() < near_m;
    let emitted = source.directivity.intensity(-direction);
    loss.factors.iter_mut().for_each(|f| *f *= emitted);
    loss.surfaces.reverse();
    planes.reverse();
    (arrived && loss.factors.iter().any(|f| *f > 0.0)).then_some((planes, loss))
}
