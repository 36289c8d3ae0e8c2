//! Paths over edges: free edges of thin walls and convex wedges.
//!
//! In the shadow of an edge its ray sum is a path of its own. In sight of the source the direct (or specular) path
//! already carries the undisturbed sound, and the edge adds the difference between its ray sum and that: so the level
//! is continuous across the shadow boundary.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::images::{ImageTree, Origin};
use super::{Pair, Specular};
use crate::geometry::{Edge, Geometry, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Edges, Scene, SourceKind, Transport};
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::edge::{self, AboutEdge};
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::quadrature::RaySum;
use crate::wbsdf::wedge::{Wave, WedgeField, coherent};

/// Fresnel number beyond which an edge in sight is left out: it changes the level by less than 0.7 dB there, and by less
/// than 0.1 dB in the mean over an octave.
const FELT_FRESNEL: f64 = 4.0;
/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-4;
/// Angle in radians about a shadow boundary within which the geometry says whether the straight way is free.
const ON_BOUNDARY: f64 = 1e-9;

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

/// Sum of the cosines by which the way over the edge is longer than that of the image in face A or B, whichever is less: 1 + cos
/// of the angle between image and receiver. Near 0 about a reflection boundary, on either side of it.
fn beside_reflection(edge: &Edge, from: &Place, to: &Place) -> f64 {
    let sum = from.phi + to.phi;
    [sum, 2.0 * edge.exterior_angle - sum].map(|angle| 1.0 + angle.cos()).into_iter().fold(2.0, f64::min)
}

/// By how much in m the way `over_m` over the edge is longer than that of the source's image in a face, `along_m` apart along
/// the edge.
fn image_detour_m(edge: &Edge, from: &Place, to: &Place, over_m: f64, along_m: f64) -> f64 {
    let beside = beside_reflection(edge, from, to);
    if from.r_m.is_infinite() {
        return to.r_m * beside;
    }
    let across = (from.r_m + to.r_m).powi(2) - 2.0 * from.r_m * to.r_m * beside;
    over_m - across.max(0.0).sqrt().hypot(along_m)
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
            let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
            for source in &scene.sources {
                for probe in &scene.probes {
                    let receiver = place(edge, probe.position_m);
                    // Detours of the way over the edge against the direct one and that of the image in a face, and how
                    // much weaker the image is.
                    let (direct, image, weaker) = match source.kind {
                        SourceKind::Plane(d) => {
                            let from = Place { r_m: f64::INFINITY, phi: angle_of(edge, d), along_m: 0.0 };
                            let span = (receiver.phi - from.phi).abs();
                            let direct = if span >= PI { 0.0 } else { receiver.r_m * (1.0 + span.cos()) };
                            (direct, image_detour_m(edge, &from, &receiver, 0.0, 0.0), 1.0)
                        }
                        _ => {
                            let from = place(edge, source.position_m);
                            let along = receiver.along_m - from.along_m;
                            let over = (from.r_m + receiver.r_m).hypot(along);
                            let straight = (probe.position_m - source.position_m).length();
                            let shadow = (receiver.phi - from.phi).abs() >= PI;
                            let keller = from.along_m + along * from.r_m / (from.r_m + receiver.r_m);
                            let within = source.kind != SourceKind::Point || (0.0..=edge.length_m).contains(&keller);
                            let image = image_detour_m(edge, &from, &receiver, over, along);
                            (
                                if shadow { 0.0 } else { over - straight },
                                if within { image } else { f64::INFINITY },
                                straight / (over - image),
                            )
                        }
                    };
                    let fresnel = [direct, image].map(|detour| 2.0 * detour / longest);
                    least = least.min(fresnel[0]).min(fresnel[1]);
                    // Keller's far field against the direct sound: 1/(2 pi sqrt(N)) in amplitude at most.
                    let keller = fresnel.map(|n| 1.0 / (TAU * n.max(1e-6).sqrt()));
                    most = most.max(keller[0] + if image.is_finite() { weaker * keller[1] } else { 0.0 });
                }
            }
            let bound_db = 20.0 * (1.0 + most).log10();
            EdgeReach { name: edge.name.clone(), felt: modelled && least < FELT_FRESNEL, bound_db }
        })
        .collect()
}

/// Adds the paths over all felt edges, and what edges in sight change, to `paths`.
pub(super) fn add(pair: &Pair<'_>, reaches: &[EdgeReach], paths: &mut Vec<Specular>) {
    let &Pair { scene, geometry, spectra, kind, source, probe, order } = pair;
    // What the edges change is reckoned from the undisturbed intensities.
    let undisturbed: Vec<Vec<f64>> = paths.iter().map(|path| path.path.intensity.clone()).collect();
    for (edge, reach) in geometry.edges.iter().zip(reaches) {
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
                let planes = |between: Option<usize>| {
                    from.planes.iter().copied().chain(between).chain(to.planes.iter().rev().copied())
                };
                let find = |between: Option<usize>| {
                    undisturbed.iter().zip(&*paths).position(|(_, path)| {
                        path.path.reflections == path.planes.len() && planes(between).eq(path.planes.iter().copied())
                    })
                };
                let lit = find(None);
                let reflected = edge.planes.iter().find_map(|plane| find(Some(*plane)));
                let reflected = reflected.map(|path| undisturbed[path].as_slice());
                match over.path(source, s, probe, p, lit.is_some(), reflected) {
                    Some(Found::Shadow(path)) => paths.push(Specular { planes: planes(None).collect(), path }),
                    Some(Found::Lit(changes)) => {
                        let Some(lit) = lit else { continue };
                        for (intensity, change) in paths[lit].path.intensity.iter_mut().zip(changes) {
                            *intensity = (*intensity + change).max(0.0);
                        }
                    }
                    None => {}
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
    /// `lit`: whether the path without the edge exists; `reflected`: intensities of the same path with a reflection at
    /// one of the edge's faces, if it exists.
    fn path(
        &self,
        source: &ImageTree,
        s: usize,
        probe: &ImageTree,
        p: usize,
        lit: bool,
        reflected: Option<&[f64]>,
    ) -> Option<Found> {
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
                let from = Place { r_m: f64::INFINITY, phi: angle_of(edge, direction), along_m: to.along_m };
                // The ray keeps its direction cosine along the edge.
                let cos_beta = direction.dot(edge.direction);
                let sin_beta = (1.0 - cos_beta * cos_beta).max(0.0).sqrt();
                let along = to.along_m - to.r_m * cos_beta / sin_beta;
                let length = (edge.start + edge.direction * along).dot(direction) + to.r_m / sin_beta;
                (from, along, length, self.receiver.dot(direction))
            }
        };
        let inside = |phi: f64| phi <= edge.exterior_angle + 1e-9;
        if !(inside(from.phi) && inside(to.phi) && from.r_m > 0.0 && to.r_m > 0.0 && length.is_finite()) {
            return None;
        }
        let two_dimensional = *self.kind != SourceKind::Point;
        if !two_dimensional && !(0.0..=edge.length_m).contains(&along) {
            return None;
        }
        let span = (to.phi - from.phi).abs();
        // On the boundary itself rounding decides whether the straight way is free.
        let shadow = if (span - PI).abs() < ON_BOUNDARY { !lit } else { span >= PI };
        if !shadow && !lit {
            return None;
        }
        // The edge is felt near its shadow boundary and near the reflection boundaries of its faces.
        let apart = if two_dimensional { 0.0 } else { to.along_m - from.along_m };
        let detour = (length - straight).min(image_detour_m(edge, &from, &to, length, apart)).max(0.0);
        let fresnel = |f: f64| 2.0 * detour * f / self.scene.air.speed_of_sound_m_s;
        if !shadow && fresnel(self.spectra.first()?.low_hz) > FELT_FRESNEL {
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
            let air = (-self.scene.air.attenuation_per_m[band] * length).exp();
            let factor = before.factors[band] * after.factors[band] * air;
            if shadow {
                let sum = self.in_shadow(&from, &to, spectrum);
                intensity.push(sum.value.max(0.0) * factor);
                error.push((sum.error + (-sum.value).max(0.0)) * factor);
                continue;
            }
            // In sight, short waves do not feel an edge that long ones do.
            let felt = 1.0 - smooth_step(fresnel(spectrum.low_hz) / FELT_FRESNEL * 2.0 - 1.0);
            let share = reflected.map(|r| r[band] / factor.max(f64::MIN_POSITIVE));
            let change = if felt > 0.0 { self.in_sight(&from, &to, spectrum, free, share) } else { 0.0 };
            intensity.push(change * felt * factor);
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

    /// The exact field of the wedge between source and receiver, and the spectrum across the edge.
    fn field(&self, from: &Place, to: &Place, spectrum: &Spectrum) -> (WedgeField, Spectrum) {
        let (wave, across) = match (self.kind, self.from) {
            (SourceKind::Line(_), _) => (Wave::Line, *spectrum),
            (_, Origin::Along(direction)) => {
                // Across the edge the wave number is k sin(beta).
                let cos_beta = direction.dot(self.edge.direction);
                let speed_m_s = spectrum.speed_m_s / (1.0 - cos_beta * cos_beta).sqrt();
                (Wave::Plane, Spectrum { speed_m_s, ..*spectrum })
            }
            _ => (Wave::Point(to.along_m - from.along_m), *spectrum),
        };
        (WedgeField::new(self.edge.exterior_angle, about(from), about(to), wave, &across), across)
    }

    /// Intensity in the shadow.
    fn in_shadow(&self, from: &Place, to: &Place, spectrum: &Spectrum) -> RaySum {
        if self.scene.simulation.transport == Transport::Paraxial {
            return self.paraxial(from, to, spectrum);
        }
        let (field, across) = self.field(from, to, spectrum);
        let value = field.mean(&across, coherent);
        RaySum { value, error: 1e-5 * value, absolute: value, rays: 0 }
    }

    /// What the edge changes of the intensity `free` of a path in sight, and of the reflection `share` by a face with it.
    fn in_sight(&self, from: &Place, to: &Place, spectrum: &Spectrum, free: f64, share: Option<f64>) -> f64 {
        if self.scene.simulation.transport == Transport::Paraxial {
            return self.paraxial(from, to, spectrum).value.clamp(0.25 * free, 2.0 * free) - free;
        }
        let (field, across) = self.field(from, to, spectrum);
        match share {
            // On the boundary itself rounding may have found a reflection: its power is in the coherent field.
            _ if !field.reflects() => field.mean(&across, coherent) - free - share.unwrap_or(0.0),
            None => field.mean(&across, |parts| parts.incident.norm_sqr()) - free,
            Some(share) => {
                // Direct and reflected sound add as energies, but as pressures near the reflection boundary, where the
                // edge joins them: so the level is continuous there too.
                let rigid = field.reflected_intensity();
                let face = share / rigid;
                let together = 1.0 - smooth_step(field.reflection_fresnel(spectrum));
                field.mean(&across, |parts| {
                    parts.incident.norm_sqr()
                        + face * parts.reflected.norm_sqr()
                        + 2.0 * together * face.sqrt() * (parts.incident * parts.reflected.conj()).re
                }) - free
                    - share
            }
        }
    }

    /// The published small-angle form.
    fn paraxial(&self, from: &Place, to: &Place, spectrum: &Spectrum) -> RaySum {
        let edge = self.edge;
        let dy_m = (*self.kind == SourceKind::Point).then_some(to.along_m - from.along_m);
        let opposite = (from.phi - PI) * (to.phi - PI) < 0.0;
        if edge.exterior_angle < TAU - 1e-6 || !opposite {
            return edge::intensity(edge.exterior_angle, about(from), about(to), dy_m, spectrum, TOLERANCE);
        }
        // x away from the screen, z across it.
        let across = |p: &Place| (p.r_m * (PI - p.phi).cos(), (p.r_m * (PI - p.phi).sin()).abs());
        let (x_m, z_m) = across(from);
        let incident = match (from.r_m.is_infinite(), dy_m) {
            (true, _) => Incident::Plane { s_x: from.phi.cos(), s_y: 0.0 },
            (false, Some(dy_m)) => Incident::Point { x_m, z_m, dy_m },
            (false, None) => Incident::Line { x_m, z_m },
        };
        let (x_m, z_m) = across(to);
        let crossing = Crossing { incident, x_m, z_m };
        Mask::new(&[[0.0, f64::INFINITY]]).intensity(&crossing, spectrum, Jambs::Paraxial, TOLERANCE)
    }
}

fn about(p: &Place) -> AboutEdge {
    AboutEdge { r_m: p.r_m, phi: p.phi }
}

/// 0 below 0, 1 above 1, smooth between.
fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
