//! Where source and receiver stand about an edge, and which edges can matter to a scene at all.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::{Edge, Geometry};
use crate::scene::{Edges, Scene, SourceKind, Transport};

/// Fresnel number beyond which an edge in sight is left out: it adds no pressure to the direct sound there, and less than
/// -22 dB of its energy.
pub(super) const FELT_FRESNEL: f64 = 4.0;

/// Most edges of a scene that are modelled: their waves meet in pairs.
pub const MOST_EDGES: usize = 1000;

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
pub(super) struct Place {
    pub(super) r_m: f64,
    pub(super) phi: f64,
    pub(super) along_m: f64,
}

impl Place {
    /// Nowhere.
    pub(super) const NONE: Self = Self { r_m: f64::NAN, phi: f64::NAN, along_m: f64::NAN };
}

pub(super) fn place(edge: &Edge, p: DVec3) -> Place {
    let d = p - edge.start;
    let (a, n) = (d.dot(edge.face_a), d.dot(edge.normal_a));
    let phi = n.atan2(a);
    // Not rem_euclid: the same value in a tenth of the time.
    Place { r_m: (a * a + n * n).sqrt(), phi: if phi < 0.0 { phi + TAU } else { phi }, along_m: d.dot(edge.direction) }
}

/// Sum of the cosines by which the way over the edge is longer than that of the image in face A or B, whichever is less: 1 + cos
/// of the angle between image and receiver. Near 0 about a reflection boundary, on either side of it.
fn beside_reflection(edge: &Edge, from: &Place, to: &Place) -> f64 {
    let sum = from.phi + to.phi;
    [sum, 2.0 * edge.exterior_angle - sum].map(|angle| 1.0 + angle.cos()).into_iter().fold(2.0, f64::min)
}

/// By how much in m the way `over_m` over the edge is longer than that of the source's image in a face, `along_m` apart along
/// the edge.
pub(super) fn image_detour_m(edge: &Edge, from: &Place, to: &Place, over_m: f64, along_m: f64) -> f64 {
    let beside = beside_reflection(edge, from, to);
    if from.r_m.is_infinite() {
        return to.r_m * beside;
    }
    let across = (from.r_m + to.r_m).powi(2) - 2.0 * from.r_m * to.r_m * beside;
    over_m - across.max(0.0).sqrt().hypot(along_m)
}

/// Length in m of the way from one place to the other over the point `along_m` of the edge.
pub(super) fn way_m(from: &Place, to: &Place, along_m: f64) -> f64 {
    let leg = |r_m: f64, along_m: f64| (r_m * r_m + along_m * along_m).sqrt();
    leg(from.r_m, along_m - from.along_m) + leg(to.r_m, to.along_m - along_m)
}

/// The angle of a plane wave's origin about the edge.
pub(super) fn angle_of(edge: &Edge, direction: DVec3) -> f64 {
    (-direction.dot(edge.normal_a)).atan2(-direction.dot(edge.face_a)).rem_euclid(TAU)
}

/// Which edges matter to the direct sound of some source and probe, in the order of the geometry's edges: of those that can be
/// felt the [`MOST_EDGES`] strongest.
pub fn edge_reach(scene: &Scene, geometry: &Geometry) -> Vec<EdgeReach> {
    let longest = scene.bands.first().map_or(1.0, |b| scene.air.speed_of_sound_m_s / b.low_hz);
    let modelled = scene.simulation.edges != Edges::Off
        && scene.simulation.transport != Transport::Geometric
        && scene.simulation.diffraction_order > 0;
    let mut reaches: Vec<(EdgeReach, f64)> = geometry
        .edges
        .par_iter()
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
                            let straight = (probe.position_m - source.position_m).length();
                            let shadow = (receiver.phi - from.phi).abs() >= PI;
                            let keller = from.along_m + along * from.r_m / (from.r_m + receiver.r_m);
                            let on_edge = match source.kind {
                                SourceKind::Point => keller.clamp(0.0, edge.length_m),
                                _ => keller,
                            };
                            let over = way_m(&from, &receiver, on_edge);
                            let image = image_detour_m(edge, &from, &receiver, over, along);
                            let mirrored =
                                (edge.on_surface[0] && keller < 0.0) || (edge.on_surface[1] && keller > edge.length_m);
                            if mirrored && source.kind == SourceKind::Point {
                                continue;
                            }
                            let direct = if shadow && on_edge == keller { 0.0 } else { over - straight };
                            (direct, image, straight / (over - image))
                        }
                    };
                    let fresnel = [direct, image].map(|detour| 2.0 * detour / longest);
                    least = least.min(fresnel[0]).min(fresnel[1]);
                    // Keller's far field against the direct sound: 1/(2 pi sqrt(N)) in amplitude at most.
                    let keller = fresnel.map(|n| 1.0 / (TAU * n.max(1e-6).sqrt()));
                    most = most.max(keller[0] + weaker * keller[1]);
                }
            }
            let bound_db = 20.0 * (1.0 + most).log10();
            let felt = modelled && (least < FELT_FRESNEL || scene.adds_pressures());
            (EdgeReach { name: edge.name.clone(), felt, bound_db }, most)
        })
        .collect();
    let mut felt: Vec<usize> = (0..reaches.len()).filter(|&i| reaches[i].0.felt).collect();
    felt.sort_by(|&i, &j| reaches[j].1.total_cmp(&reaches[i].1));
    felt.into_iter().skip(MOST_EDGES).for_each(|i| reaches[i].0.felt = false);
    reaches.into_iter().map(|(reach, _)| reach).collect()
}
