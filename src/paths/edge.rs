//! Paths over edges: free edges of thin walls and convex wedges.
//!
//! In the shadow of an edge its ray sum is a path of its own. In sight of the source the direct (or specular) path
//! already carries the undisturbed sound, and the edge adds the difference between its ray sum and that: so the level
//! is continuous across the shadow boundary.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::Specular;
use super::images::{ImageTree, Origin};
use crate::geometry::{Edge, Geometry, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Edges, Scene, SourceKind, Transport};
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::edge::{self, AboutEdge};
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::quadrature::RaySum;

/// Fresnel number beyond which an edge in sight is left out: it changes the level by less than 0.7 dB there, and by less
/// than 0.1 dB in the mean over an octave.
const FELT_FRESNEL: f64 = 4.0;
/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-4;

/// What an edge can do to the direct sound of any source and probe.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct EdgeReach {
    /// Name of the edge.
    pub name: String,
    /// Whether it is modelled.
    pub felt: bool,
    /// If it is left out: bound in dB of what that leaves out of a tone's level.
    pub bound_db: f64,
}

/// Source or receiver about an edge: distance from it, angle from face A, place along it.
#[derive(Clone, Copy)]
struct Place {
    r_m: f64,
    phi: f64,
    along_m: f64,
}

fn place(edge: &Edge, p: DVec3) -> Place {
    let d = p - edge.start;
    let (a, n) = (d.dot(edge.face_a), d.dot(edge.normal_a));
    Place { r_m: a.hypot(n), phi: n.atan2(a).rem_euclid(TAU), along_m: d.dot(edge.direction) }
}

/// The angle of a plane wave's origin about the edge.
fn angle_of(edge: &Edge, direction: DVec3) -> f64 {
    (-direction.dot(edge.normal_a)).atan2(-direction.dot(edge.face_a)).rem_euclid(TAU)
}

/// Which edges matter to the direct sound of some source and probe, in the order of the geometry's edges.
pub fn edge_reach(scene: &Scene, geometry: &Geometry) -> Vec<EdgeReach> {
    let longest = scene.bands.first().map_or(1.0, |b| scene.air.speed_of_sound_m_s / b.low_hz);
    let modelled = scene.simulation.edges == Edges::Auto
        && scene.simulation.transport != Transport::Geometric
        && scene.simulation.diffraction_order > 0;
    geometry
        .edges
        .iter()
        .map(|edge| {
            let mut least = f64::INFINITY;
            for source in &scene.sources {
                for probe in &scene.probes {
                    let receiver = place(edge, probe.position_m);
                    let fresnel = match source.kind {
                        SourceKind::Plane(d) => {
                            let span = (receiver.phi - angle_of(edge, d)).abs();
                            if span >= PI { 0.0 } else { 2.0 * receiver.r_m * (1.0 + span.cos()) / longest }
                        }
                        _ => {
                            let from = place(edge, source.position_m);
                            if (receiver.phi - from.phi).abs() >= PI {
                                0.0
                            } else {
                                let along = receiver.along_m - from.along_m;
                                let over = (from.r_m + receiver.r_m).hypot(along);
                                2.0 * (over - (probe.position_m - source.position_m).length()) / longest
                            }
                        }
                    };
                    least = least.min(fresnel);
                }
            }
            // Keller's far field against the direct sound: 1/(2 pi sqrt(N)) in amplitude at most.
            let bound_db = 20.0 * (1.0 + 1.0 / (TAU * least.max(1e-6).sqrt())).log10();
            EdgeReach { name: edge.name.clone(), felt: modelled && least < FELT_FRESNEL, bound_db }
        })
        .collect()
}

/// Adds the paths over all felt edges, and what edges in sight change, to `paths`.
#[expect(clippy::too_many_arguments, reason = "one call site; a struct would only rename them")]
pub(super) fn add(
    scene: &Scene,
    geometry: &Geometry,
    spectra: &[Spectrum],
    kind: &SourceKind,
    source: &ImageTree,
    probe: &ImageTree,
    order: usize,
    paths: &mut Vec<Specular>,
) {
    for (edge, reach) in geometry.edges.iter().zip(edge_reach(scene, geometry)) {
        if !reach.felt {
            continue;
        }
        if let SourceKind::Line(axis) = kind
            && axis.dot(edge.direction).abs() < 1.0 - 1e-9
        {
            continue;
        }
        for (s, from) in source.images.iter().enumerate() {
            for (p, to) in
                probe.images.iter().enumerate().filter(|(_, to)| from.planes.len() + to.planes.len() <= order)
            {
                let Origin::At(receiver) = to.origin else { continue };
                let over = Over { scene, geometry, edge, spectra, kind, from: from.origin, receiver };
                let Some(found) = over.path(source, s, probe, p) else { continue };
                let planes: Vec<usize> = from.planes.iter().chain(to.planes.iter().rev()).copied().collect();
                match found {
                    Found::Shadow(path) => paths.push(Specular { planes, path }),
                    Found::Lit(changes) => {
                        if let Some(lit) =
                            paths.iter_mut().find(|path| path.planes == planes && path.path.reflections == planes.len())
                        {
                            for (intensity, change) in lit.path.intensity.iter_mut().zip(changes) {
                                *intensity = (*intensity + change).max(0.0);
                            }
                        }
                    }
                }
            }
        }
    }
}

enum Found {
    /// A path of its own.
    Shadow(EarlyPath),
    /// Change of the intensity of the path in sight, one a band.
    Lit(Vec<f64>),
}

/// One edge between one source image and one probe image.
struct Over<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    edge: &'a Edge,
    spectra: &'a [Spectrum],
    kind: &'a SourceKind,
    from: Origin,
    receiver: DVec3,
}

impl Over<'_> {
    fn path(&self, source: &ImageTree, s: usize, probe: &ImageTree, p: usize) -> Option<Found> {
        let edge = self.edge;
        let to = place(edge, self.receiver);
        let (from, along, length, straight) = match self.from {
            Origin::At(position) => {
                let from = place(edge, position);
                let over = from.r_m + to.r_m;
                match self.kind {
                    SourceKind::Line(_) => {
                        let straight = (from.r_m.powi(2) + to.r_m.powi(2)
                            - 2.0 * from.r_m * to.r_m * (to.phi - from.phi).cos())
                        .max(0.0)
                        .sqrt();
                        (from, to.along_m, over, straight)
                    }
                    _ => {
                        let along = from.along_m + (to.along_m - from.along_m) * from.r_m / over;
                        let length = over.hypot(to.along_m - from.along_m);
                        (from, along, length, (self.receiver - position).length())
                    }
                }
            }
            Origin::Along(direction) => {
                let phi = angle_of(edge, direction);
                let from = Place { r_m: f64::INFINITY, phi, along_m: to.along_m };
                let offset = edge.start.dot(direction);
                (from, to.along_m, offset + to.r_m, self.receiver.dot(direction))
            }
        };
        let inside = |phi: f64| phi <= edge.exterior_angle + 1e-9;
        if !inside(from.phi) || !inside(to.phi) || from.r_m <= 0.0 || to.r_m <= 0.0 {
            return None;
        }
        let two_dimensional = *self.kind != SourceKind::Point;
        if !two_dimensional && !(0.0..=edge.length_m).contains(&along) {
            return None;
        }
        let span = (to.phi - from.phi).abs();
        let shadow = span >= PI;
        let longest = self.spectra.first()?.speed_m_s / self.spectra.first()?.low_hz;
        if !shadow && 2.0 * (length - straight) / longest > FELT_FRESNEL {
            return None;
        }
        // Just outside the edge, in the middle of the fluid.
        let (sin, cos) = (0.5 * edge.exterior_angle).sin_cos();
        let outwards = edge.face_a * cos + edge.normal_a * sin;
        let apex = edge.start + edge.direction * along + outwards * (1e-6 * (1.0 + to.r_m));
        let before = source.arrive(self.scene, self.geometry, s, apex, Skip::NONE)?;
        let after = probe.arrive(self.scene, self.geometry, p, apex, Skip::NONE)?;
        let free = self.free_intensity(straight);
        let mut intensity = Vec::with_capacity(self.spectra.len());
        let mut error = Vec::with_capacity(self.spectra.len());
        for (band, spectrum) in self.spectra.iter().enumerate() {
            // In sight, short waves do not feel an edge that long ones do.
            if !shadow && 2.0 * (length - straight) * spectrum.low_hz / spectrum.speed_m_s > FELT_FRESNEL {
                intensity.push(0.0);
                error.push(0.0);
                continue;
            }
            let sum = self.sum(&from, &to, spectrum)?;
            let air = (-self.scene.air.attenuation_per_m[band] * length).exp();
            let factor = before.factors[band] * after.factors[band] * air;
            // No edge lifts the mean over a band by more than 3 dB: a larger sum is a pole of the reflected field.
            let value =
                if shadow { sum.value.clamp(0.0, free) } else { sum.value.clamp(0.25 * free, 2.0 * free) - free };
            intensity.push(value * factor);
            error.push((sum.error + (-sum.value).max(0.0)) * factor);
        }
        if !shadow {
            return Some(Found::Lit(intensity));
        }
        let names = |planes: &[usize]| planes.iter().map(|q| super::plane_name(self.geometry, *q)).collect::<Vec<_>>();
        let mut parts = names(&source.images[s].planes);
        parts.push(edge.name.clone());
        parts.extend(names(&probe.images[p].planes).into_iter().rev());
        Some(Found::Shadow(EarlyPath {
            label: parts.join(", "),
            reflections: source.images[s].planes.len() + probe.images[p].planes.len(),
            delay_s: length / self.scene.air.speed_of_sound_m_s,
            intensity,
            error,
        }))
    }

    fn free_intensity(&self, straight_m: f64) -> f64 {
        match self.kind {
            SourceKind::Line(_) => 1.0 / straight_m,
            SourceKind::Point => 1.0 / straight_m.powi(2),
            SourceKind::Plane(_) => 1.0,
        }
    }

    /// The ray sum over the edge: the closed form with its jamb ray for a thin screen between source and receiver, the
    /// wedge's obliquity otherwise.
    fn sum(&self, from: &Place, to: &Place, spectrum: &Spectrum) -> Option<RaySum> {
        let edge = self.edge;
        let dy_m = (*self.kind == SourceKind::Point).then_some(to.along_m - from.along_m);
        let paraxial = self.scene.simulation.transport == Transport::Paraxial;
        let opposite = (from.phi - PI) * (to.phi - PI) < 0.0;
        if edge.exterior_angle > TAU - 1e-6 && opposite {
            // x away from the screen, z across it.
            let before = PI - from.phi;
            let incident = match (from.r_m.is_infinite(), dy_m) {
                (true, _) => Incident::Plane { s_x: from.phi.cos(), s_y: 0.0 },
                (false, Some(dy_m)) => {
                    Incident::Point { x_m: from.r_m * before.cos(), z_m: (from.r_m * before.sin()).abs(), dy_m }
                }
                (false, None) => Incident::Line { x_m: from.r_m * before.cos(), z_m: (from.r_m * before.sin()).abs() },
            };
            let behind = PI - to.phi;
            let crossing = Crossing { incident, x_m: to.r_m * behind.cos(), z_m: (to.r_m * behind.sin()).abs() };
            let jambs = if paraxial { Jambs::Paraxial } else { Jambs::Rigid };
            return Some(Mask::new(&[[0.0, f64::INFINITY]]).intensity(&crossing, spectrum, jambs, TOLERANCE));
        }
        if edge.exterior_angle > TAU - 1e-6 && (from.phi - PI) * (to.phi - PI) >= 0.0 && (to.phi - from.phi).abs() < PI
        {
            return None;
        }
        let about = |p: &Place| AboutEdge { r_m: p.r_m, phi: p.phi };
        Some(edge::intensity(edge.exterior_angle, about(from), about(to), dy_m, spectrum, TOLERANCE))
    }
}
