//! Everything that stays the same while rays are traced: materials in lanes, receivers, portals, air.

use std::collections::HashMap;

use glam::DVec3;

use super::lanes::{Air, Lanes, lanes};
use super::portal::{Intake, Passage, box_corners};
use super::receiver::Receiver;
use super::{Scattering, TracePlan};
use crate::geometry::{Geometry, Surface};
use crate::scene::{Material, Scene};

/// A material, one value a lane.
pub(super) struct MaterialLanes<const N: usize> {
    /// Reflected share, 1 - alpha.
    pub(super) reflected: Lanes<N>,
    /// Diffuse rain: 4 (1 - alpha) s, the intensity at 1 m along the normal per unit of ray power, over its probability.
    pub(super) rain: Lanes<N>,
    /// Diffuse share s of the reflected energy.
    pub(super) scattering: Lanes<N>,
    /// Share of the hits that send diffuse rain: with little scattering most hits have little to send, and its expectation is kept.
    pub(super) rain_probability: f64,
    /// The scattering where it is the same in all bands.
    pub(super) uniform_scattering: Option<f64>,
    /// Whether the bands scatter so differently that one decision for all of them is costly.
    pub(super) parts_bands: bool,
    /// Transmitted share of the incident energy.
    pub(super) transmission: Option<Lanes<N>>,
}

/// Mean square by which the bands' weights spread at one decision from which bands are parted.
const COSTLY_SPREAD: f64 = 0.1;

impl<const N: usize> MaterialLanes<N> {
    fn new(material: &Material) -> Self {
        let pairs = || material.absorption.iter().zip(&material.scattering);
        let first = material.scattering.first().copied().unwrap_or(0.0);
        let most = pairs().filter(|(a, _)| **a < 1.0).map(|(_, s)| *s).fold(0.0, f64::max);
        let rain_probability = if most > 0.0 { (0.1 + 2.0 * most).min(1.0) } else { 0.0 };
        // One decision with the mean probability p multiplies a band's weight by s/p or (1 - s)/(1 - p): the mean square
        // exceeds 1 by the variance of s over p (1 - p).
        let bands = material.scattering.len().max(1) as f64;
        let mean = material.scattering.iter().sum::<f64>() / bands;
        let variance = material.scattering.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / bands;
        Self {
            rain_probability,
            parts_bands: variance > COSTLY_SPREAD * mean * (1.0 - mean),
            reflected: lanes(material.absorption.iter().map(|a| 1.0 - a)),
            rain: lanes(pairs().map(|(a, s)| 4.0 * (1.0 - a) * s / rain_probability.max(f64::MIN_POSITIVE))),
            scattering: lanes(material.scattering.iter().copied()),
            uniform_scattering: material.scattering.iter().all(|&s| s == first).then_some(first),
            transmission: material
                .transmission
                .as_ref()
                .filter(|t| t.iter().any(|&t| t > 0.0))
                .map(|t| lanes(t.iter().copied())),
        }
    }
}

/// A surface as the rays see it, beyond what [`Geometry`] knows.
pub(super) struct Face {
    /// Unit normal.
    pub(super) normal: DVec3,
    /// Index of its material.
    pub(super) material: usize,
    /// Distance in m to the opposite face of the same wall along +normal and along -normal; 0 without one.
    pub(super) through_m: [f64; 2],
    /// Whether it lets sound through and anything lies beyond its plane along +normal and along -normal.
    pub(super) beyond: [bool; 2],
    /// Portals whose capture region lies on this face.
    pub(super) captures: Vec<usize>,
}

/// The fixed part of a run.
pub(super) struct Stage<'a, S, const N: usize> {
    pub(super) geometry: &'a Geometry,
    pub(super) scatter: &'a [S],
    pub(super) bands: usize,
    pub(super) materials: Vec<MaterialLanes<N>>,
    pub(super) faces: Vec<Face>,
    pub(super) passages: Vec<Passage>,
    /// Per portal: portals with capture regions on the same wall, itself included.
    pub(super) companions: Vec<Vec<usize>>,
    pub(super) receivers: Vec<Receiver<N>>,
    /// Absorption of the air; `None`: none in any band.
    pub(super) air: Option<Air<N>>,
    pub(super) speed_m_s: f64,
    /// Probability with which a hit rains on a probe over cos(theta)/r^2.
    pub(super) rain_m2: f64,
    /// Way in m that sound goes within the echogram.
    pub(super) length_m: f64,
    pub(super) reflection_order: u32,
    pub(super) portal_order: u32,
}

impl<'a, S: Scattering, const N: usize> Stage<'a, S, N> {
    /// Sets up a run.
    pub(super) fn new(scene: &Scene, geometry: &'a Geometry, scatter: &'a [S], plan: &TracePlan) -> Self {
        let passages: Vec<Passage> = geometry
            .portals
            .iter()
            .zip(scatter)
            .map(|(p, s)| Passage::new(p, &Intake::new(s, scene.bands.len()), scene, geometry))
            .collect();
        let receivers = scene
            .probes
            .iter()
            .map(|p| Receiver::new(p.position_m, geometry, &passages, scatter, scene.bands.len(), plan))
            .collect();
        let captured = |group: usize| -> Vec<usize> {
            let narrow = |p: &Passage| p.is_captured(1.0) || p.is_captured(-1.0);
            (0..passages.len()).filter(|&i| passages[i].group == group && narrow(&passages[i])).collect()
        };
        let attenuation = &scene.air.attenuation_per_m;
        let speed_m_s = scene.air.speed_of_sound_m_s;
        Self {
            geometry,
            scatter,
            bands: scene.bands.len(),
            materials: scene.materials.iter().map(MaterialLanes::new).collect(),
            faces: faces(scene, geometry, |group, normal| {
                captured(group)
                    .into_iter()
                    .filter(|&i| passages[i].frame.normal.dot(normal).abs() > 1.0 - 1e-9)
                    .collect()
            }),
            companions: passages.iter().map(|p| captured(p.group)).collect(),
            passages,
            receivers,
            air: attenuation.iter().any(|&m| m > 0.0).then(|| Air::new(lanes(attenuation.iter().copied()))),
            speed_m_s,
            rain_m2: rain_m2(geometry, scene.probes.len()),
            length_m: plan.length_s * speed_m_s,
            reflection_order: u32::try_from(plan.reflection_order).unwrap_or(u32::MAX),
            portal_order: u32::try_from(plan.portal_order).unwrap_or(u32::MAX),
        }
    }
}

/// Rain on a probe is always sent where cos(theta)/r^2 is above this many times its mean over the surfaces of a room, 4 pi over their area, and
/// below in proportion. With 64 probes in a shoebox the product of time and variance is smallest about 10 (0.55 of that at 0).
const MOST_THINNED: f64 = 10.0;

/// [`Stage::rain_m2`]: infinite for a single probe, whose rain costs less than the ray itself.
fn rain_m2(geometry: &Geometry, probes: usize) -> f64 {
    let thinned = (0.5 * probes.saturating_sub(1) as f64).min(MOST_THINNED);
    let area_m2: f64 = geometry.surfaces.iter().map(|s| s.area_m2).filter(|a| a.is_finite()).sum();
    if thinned > 0.0 { area_m2 / (4.0 * std::f64::consts::PI * thinned) } else { f64::INFINITY }
}

/// The faces of all surfaces; `captures` gives the portals with capture regions on the faces of a group with a normal.
fn faces(scene: &Scene, geometry: &Geometry, captures: impl Fn(usize, DVec3) -> Vec<usize>) -> Vec<Face> {
    let points: Vec<DVec3> = scene
        .boxes
        .iter()
        .flat_map(box_corners)
        .chain(scene.walls.iter().flat_map(|w| w.corners_m.iter().copied()))
        .chain(scene.meshes.iter().flat_map(|m| m.triangles_m.iter().flatten().copied()))
        .chain(scene.probes.iter().map(|p| p.position_m))
        .collect();
    let unbounded = scene.walls.iter().any(|w| w.unbounded);
    let mut groups: HashMap<usize, Vec<&Surface>> = HashMap::new();
    for surface in &geometry.surfaces {
        groups.entry(surface.group).or_default().push(surface);
    }
    geometry
        .surfaces
        .iter()
        .map(|surface| {
            let (origin, normal) = (surface.frame.origin_m, surface.frame.normal);
            let mut through_m = [0.0f64; 2];
            for other in &groups[&surface.group] {
                let parallel = other.frame.normal.dot(normal).abs() > 1.0 - 1e-9;
                if other.plane == surface.plane || !parallel {
                    continue;
                }
                let height = (other.frame.origin_m - origin).dot(normal);
                let slot = &mut through_m[usize::from(height < 0.0)];
                if *slot == 0.0 || height.abs() < *slot {
                    *slot = height.abs();
                }
            }
            // Only asked of what lets sound through; the search goes over all corners.
            let lets_through = scene.materials[surface.material].transmission.is_some();
            let far = |sign: f64| points.iter().any(|p| sign * (p - origin).dot(normal) > 1e-6);
            let beyond = |sign: f64| lets_through && (unbounded || far(sign));
            Face {
                normal,
                material: surface.material,
                through_m,
                beyond: [beyond(1.0), beyond(-1.0)],
                captures: captures(surface.group, normal),
            }
        })
        .collect()
}
