//! Small bodies: what covers little of the Fresnel zone between source and probe is passed by sound as if it were not there.
//!
//! The fields of single wedges take their faces as endless; round a body much smaller than the Fresnel zone they do not add up to
//! what the body does, which is next to nothing. Kirchhoff's integral over an obstacle of the sides a and b says what is
//! missing: the share (a/w)(b/w) of the direct pressure, w = sqrt(lambda d d'/(d + d')), as long as that is small. A closed body of a
//! mesh therefore counts with the weight [`share`] of either side, 0 to 1, and the scene without it with the rest, in energy.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use super::{Early, NEGLIGIBLE, Prepared, tidy};
use crate::geometry::{Geometry, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Scene, SourceKind};
use crate::wbsdf::crossing::Spectrum;

/// Corners nearer than this, in m, are one.
const SAME_M: f64 = 1e-6;
/// Within this distance in m a body stands on a surface, in which it is mirrored.
const TOUCHING_M: f64 = 1e-3;
/// Ratio of sizes within which bodies are left out together, and the most classes of sizes.
const CLASS: f64 = 2.0;
const MOST_CLASSES: usize = 3;

/// A closed part of a mesh with no source and no probe inside.
struct Body {
    /// Triangles as (mesh, index).
    triangles: Vec<(usize, usize)>,
    low: DVec3,
    high: DVec3,
    /// The two longer sides in m, the shorter one first; mirrored in the surfaces on which it stands.
    sides_m: [f64; 2],
}

/// The weight of a body's side over the width of the Fresnel zone: as long as it is at first, 1 from two widths on.
fn share(ratio: f64) -> f64 {
    1.0 - (1.0 - 0.5 * ratio.min(2.0)).powi(2)
}

impl Body {
    fn empty() -> Self {
        let infinite = DVec3::splat(f64::INFINITY);
        Self { triangles: Vec::new(), low: infinite, high: -infinite, sides_m: [0.0; 2] }
    }

    /// Measures its sides between what is there besides bodies.
    fn measure(&mut self, bare: &Geometry) {
        let (middle, size) = (0.5 * (self.low + self.high), self.high - self.low);
        let mut sides_m = size.to_array();
        for (axis, side) in DVec3::AXES.into_iter().zip(&mut sides_m) {
            let touches = |sign: f64| {
                let inside = middle + axis * (sign * (0.5 * *side - TOUCHING_M));
                bare.closest(inside, axis * sign, 2.0 * TOUCHING_M, Skip::NONE).is_some()
            };
            *side *= match [touches(-1.0), touches(1.0)] {
                [false, false] => 1.0,
                [true, true] => f64::INFINITY,
                _ => 2.0,
            };
        }
        sides_m.sort_by(f64::total_cmp);
        self.sides_m = [sides_m[1], sides_m[2]];
    }

    /// Weight at the wavelength in m between a source (`None`: far away) and a probe.
    fn weight(&self, source: Option<DVec3>, probe: DVec3, wavelength_m: f64) -> f64 {
        let distance = |p: DVec3| (p - p.clamp(self.low, self.high)).length().max(f64::MIN_POSITIVE);
        let inverse = source.map_or(0.0, |s| 1.0 / distance(s)) + 1.0 / distance(probe);
        let width_m = (wavelength_m / inverse).sqrt();
        self.sides_m.iter().map(|side| share(side / width_m)).product()
    }
}

/// `full`, what all bodies together make of the pairs, with small bodies weighted as they deserve.
pub(super) fn weighted(prepared: &Prepared<'_>, full: Vec<Early>) -> Vec<Early> {
    let &Prepared { scene, geometry, order, .. } = prepared;
    if scene.simulation.diffraction_order == 0 || geometry.edges.is_empty() {
        return full;
    }
    let Some(classes) = classes(scene) else { return full };
    // What is there with all bodies, without the smallest class, without the two smallest, ...; and the weight [class][pair][band] of
    // what is smaller being there.
    let (mut earlies, mut weights) = (vec![full], Vec::new());
    let mut left_out: Vec<(usize, usize)> = Vec::new();
    for class in classes {
        let of_class = weights_of(prepared, &class);
        if of_class.iter().flatten().all(|w| *w >= 1.0) {
            break;
        }
        left_out.extend(class.iter().flat_map(|body| &body.triangles));
        let fewer = without(scene, &left_out);
        let Ok(fewer_geometry) = Geometry::new(&fewer) else { break };
        earlies.push(Prepared::new(&fewer, &fewer_geometry, order).find_all());
        weights.push(of_class);
    }
    let pairs = earlies[0].len();
    let mut blended = vec![Early { paths: Vec::new(), intensity: vec![0.0; scene.bands.len()] }; pairs];
    for (i, of_scene) in earlies.into_iter().enumerate() {
        for (pair, (sum, early)) in blended.iter_mut().zip(of_scene).enumerate() {
            let weight = |class: Option<usize>, band: usize| class.map_or(0.0, |c| largest(&weights[..=c], pair, band));
            let share = |band: usize| {
                let upper = if i < weights.len() { weight(Some(i), band) } else { 1.0 };
                upper - weight(i.checked_sub(1), band)
            };
            add(sum, early, share);
        }
    }
    for early in &mut blended {
        early.paths = tidy(std::mem::take(&mut early.paths), NEGLIGIBLE);
    }
    blended
}

/// A larger class is there at least as much as a smaller one.
fn largest(weights: &[Vec<Vec<f64>>], pair: usize, band: usize) -> f64 {
    weights.iter().map(|w| w[pair][band]).fold(0.0, f64::max)
}

/// Adds `early` times a share, one a band.
fn add(sum: &mut Early, early: Early, share: impl Fn(usize) -> f64) {
    for (band, intensity) in early.intensity.iter().enumerate() {
        sum.intensity[band] += share(band) * intensity;
    }
    let scaled = |values: &[f64]| values.iter().enumerate().map(|(b, v)| share(b) * v).collect::<Vec<f64>>();
    for path in early.paths {
        let (intensity, error) = (scaled(&path.intensity), scaled(&path.error));
        if intensity.iter().all(|i| *i <= 0.0) {
            continue;
        }
        let same = |p: &&mut EarlyPath| p.label == path.label && (p.delay_s - path.delay_s).abs() < 1e-9;
        match sum.paths.iter_mut().find(same) {
            Some(known) => {
                known.intensity.iter_mut().zip(&intensity).for_each(|(a, b)| *a += b);
                known.error.iter_mut().zip(&error).for_each(|(a, b)| *a += b);
            }
            None => sum.paths.push(EarlyPath { intensity, error, ..path }),
        }
    }
}

/// The weight of a class [pair][band]: that of its body that counts most.
fn weights_of(prepared: &Prepared<'_>, class: &[Body]) -> Vec<Vec<f64>> {
    let scene = prepared.scene;
    let mut weights = Vec::with_capacity(scene.sources.len() * scene.probes.len());
    for source in &scene.sources {
        let from = (!matches!(source.kind, SourceKind::Plane(_))).then_some(source.position_m);
        for probe in &scene.probes {
            let of_band = |spectrum: &Spectrum| {
                let wavelength_m = 2.0 * spectrum.speed_m_s / (spectrum.low_hz + spectrum.high_hz);
                class.iter().map(|body| body.weight(from, probe.position_m, wavelength_m)).fold(0.0, f64::max)
            };
            weights.push(prepared.spectra.iter().map(of_band).collect());
        }
    }
    weights
}

/// The scene without these triangles.
fn without(scene: &Scene, left_out: &[(usize, usize)]) -> Scene {
    let mut scene = scene.clone();
    let left_out: HashSet<(usize, usize)> = left_out.iter().copied().collect();
    for (m, mesh) in scene.meshes.iter_mut().enumerate() {
        let kept: Vec<usize> = (0..mesh.triangles_m.len()).filter(|t| !left_out.contains(&(m, *t))).collect();
        mesh.triangles_m = kept.iter().map(|t| mesh.triangles_m[*t]).collect();
        mesh.materials = kept.iter().map(|t| mesh.materials[*t]).collect();
    }
    scene.meshes.retain(|mesh| !mesh.triangles_m.is_empty());
    scene
}

/// The small bodies of a scene in classes of their shorter sides, the smallest first; `None` without any.
fn classes(scene: &Scene) -> Option<Vec<Vec<Body>>> {
    let mut bodies = parts(scene);
    if bodies.is_empty() {
        return None;
    }
    let all: Vec<(usize, usize)> = bodies.iter().flat_map(|body| body.triangles.iter().copied()).collect();
    let bare = Geometry::new(&without(scene, &all)).ok()?;
    for body in &mut bodies {
        body.measure(&bare);
    }
    bodies.sort_by(|a, b| b.sides_m[0].total_cmp(&a.sides_m[0]));
    let mut classes: Vec<Vec<Body>> = Vec::new();
    for body in bodies {
        let of_last = |class: &Vec<Body>| CLASS * body.sides_m[0] > class[0].sides_m[0];
        let count = classes.len();
        match classes.last_mut() {
            Some(class) if count == MOST_CLASSES || of_last(class) => class.push(body),
            _ => classes.push(vec![body]),
        }
    }
    classes.reverse();
    Some(classes)
}

/// The closed parts of all meshes that have no source and no probe inside; not yet measured.
fn parts(scene: &Scene) -> Vec<Body> {
    let mut corners: HashMap<[i64; 3], usize> = HashMap::new();
    let mut faces: Vec<((usize, usize), [usize; 3])> = Vec::new();
    for (m, mesh) in scene.meshes.iter().enumerate() {
        for (t, triangle) in mesh.triangles_m.iter().enumerate() {
            let corner = |p: DVec3| {
                let key = (p / SAME_M).round().to_array().map(|c| c as i64);
                let next = corners.len();
                *corners.entry(key).or_insert(next)
            };
            faces.push(((m, t), triangle.map(corner)));
        }
    }
    let mut part: Vec<usize> = (0..corners.len()).collect();
    for (_, [a, b, c]) in &faces {
        for other in [b, c] {
            let (first, second) = (root(&mut part, *a), root(&mut part, *other));
            part[first.max(second)] = first.min(second);
        }
    }
    // Borders of each part that an odd number of triangles share: none in a closed one.
    let mut odd: HashMap<usize, HashSet<(usize, usize)>> = HashMap::new();
    let mut bodies: HashMap<usize, Body> = HashMap::new();
    for (of, ids) in &faces {
        let key = root(&mut part, ids[0]);
        let body = bodies.entry(key).or_insert_with(Body::empty);
        body.triangles.push(*of);
        for (corner, next) in scene.meshes[of.0].triangles_m[of.1].iter().zip([(0, 1), (1, 2), (2, 0)]) {
            (body.low, body.high) = (body.low.min(*corner), body.high.max(*corner));
            let (a, b) = (ids[next.0], ids[next.1]);
            let borders = odd.entry(key).or_default();
            if !borders.remove(&(a.min(b), a.max(b))) {
                borders.insert((a.min(b), a.max(b)));
            }
        }
    }
    let points = || scene.sources.iter().map(|s| s.position_m).chain(scene.probes.iter().map(|p| p.position_m));
    let mut closed: Vec<(usize, Body)> = bodies.into_iter().filter(|(key, _)| odd[key].is_empty()).collect();
    closed.retain(|(_, body)| points().all(|p| p.clamp(body.low, body.high) != p));
    closed.sort_by_key(|(key, _)| *key);
    closed.into_iter().map(|(_, body)| body).collect()
}

/// The representative of a corner's part, with its way there shortened.
fn root(part: &mut [usize], mut corner: usize) -> usize {
    while part[corner] != corner {
        part[corner] = part[part[corner]];
        corner = part[corner];
    }
    corner
}
