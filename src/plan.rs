//! What a scene needs: decided before anything runs, as plain data that can be printed, compared and tested.

use std::fmt::Write as _;

use glam::DVec3;

use crate::error::Warning;
use crate::geometry::{Element, Enclosure, FINE_M, Geometry, Skip};
use crate::paths::{EdgeReach, ImageTree, MOST_EDGES, edge_reach, merged_images};
use crate::scene::{Edges, Opening, Scene, SourceKind, Transport};
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::mask::Mask;
use crate::wbsdf::rectangle::Sides;
use crate::wbsdf::slit::Form;
use crate::wbsdf::thick::is_thick;

/// How an opening is modelled in a band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PortalModel {
    /// A plain hole: straight rays only.
    Geometric,
    /// One edge: the exact half-plane.
    Edge,
    /// A wide opening: signed rays.
    Opening,
    /// Narrow in one direction at least: exact aperture there.
    NarrowOpening,
    /// A gap whose depth counts, of any width: mode matching.
    DeepGap,
    /// The coherent second opinion: uniform theory of diffraction.
    Uniform,
    /// The integral equation at many frequencies.
    Referee,
    /// Nothing passes (but for the leaf's transmission).
    Closed,
}

impl PortalModel {
    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Geometric => "geometric",
            Self::Edge => "edge",
            Self::Opening => "opening",
            Self::NarrowOpening => "narrow opening",
            Self::DeepGap => "deep gap",
            Self::Uniform => "uniform theory",
            Self::Referee => "exact",
            Self::Closed => "closed",
        }
    }
}

/// One opening in one band.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PortalBand {
    /// Nominal centre in Hz.
    pub band_hz: f64,
    /// k times the smaller side at the band's centre.
    pub ka: Option<f64>,
    /// What is modelled.
    pub model: PortalModel,
}

/// One opening.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PortalPlan {
    /// Its name.
    pub name: String,
    /// Open width in m along the wall's local x; `None`: unbounded.
    pub width_m: Option<f64>,
    /// Height in m along local y; `None`: unbounded.
    pub height_m: Option<f64>,
    /// One entry a band.
    pub bands: Vec<PortalBand>,
    /// Why.
    pub why: String,
}

/// The stochastic part.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TracePart {
    /// Why rays are traced.
    pub why: String,
    /// Echogram length in s.
    pub length_s: f64,
    /// Echogram bin width in s.
    pub bin_s: f64,
    /// Reverberation time (Eyring) in s of the slowest band that the length follows from, if the room is closed.
    pub reverberation_s: Option<f64>,
    /// Volume in m^3 of the largest closed room of a source or probe.
    pub volume_m3: Option<f64>,
}

/// What will be done for a scene.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Plan {
    /// How diffraction is modelled.
    pub transport: Transport,
    /// Whether the deterministic paths of a source add as pressures.
    pub adds_pressures: bool,
    /// Whether impulse responses follow: decay times count, not levels alone, and the course of paths within the bands.
    pub responses: bool,
    /// Specular reflections on deterministic paths (at most what was asked for).
    pub reflection_order: usize,
    /// Image sources to be tried per source and probe.
    pub images: f64,
    /// Openings.
    pub portals: Vec<PortalPlan>,
    /// Edges of the geometry.
    pub edges: Vec<EdgeReach>,
    /// Traced rays; `None`: the deterministic paths are everything.
    pub traced: Option<TracePart>,
    /// Why no rays are traced, if none are.
    pub untraced_why: Option<String>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// Most image sources per source or probe.
const MAX_IMAGES: f64 = 50_000.0;
/// Most edges that the plan lists in words.
const LISTED: usize = 24;
/// Echogram bin in s.
const BIN_S: f64 = 1e-3;
/// Bounds of the echogram's length in s.
const LENGTH_S: [f64; 2] = [0.1, 20.0];
/// Rays of the fan that looks for reflections beyond the deterministic order.
const FAN: usize = 512;

impl Plan {
    /// Decides what `scene` needs; traces nothing but a small fan of rays.
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let mut warnings = Vec::new();
        let planes = geometry.planes().len();
        let mut reflection_order = scene.simulation.reflection_order;
        let mut images = ImageTree::count(planes, reflection_order);
        if let Some((order, merged)) = merged_images(scene, geometry, reflection_order, MAX_IMAGES) {
            (reflection_order, images) = (order, merged);
        }
        while reflection_order > 0 && images > MAX_IMAGES {
            reflection_order -= 1;
            images = ImageTree::count(planes, reflection_order);
        }
        if reflection_order < scene.simulation.reflection_order {
            warnings.push(Warning {
                observation: format!(
                    "{planes} planes give {:.0} image sources at reflection order {}: more than {MAX_IMAGES:.0}",
                    ImageTree::count(planes, scene.simulation.reflection_order),
                    scene.simulation.reflection_order
                ),
                remedy: format!("reflection order {reflection_order} is used; traced rays carry the rest"),
            });
        }
        let edges = edge_reach(scene, geometry);
        warnings.extend(edges_warnings(&edges, geometry.fine_edges));
        warnings.extend(scene.openings.iter().filter_map(|opening| thin_warning(scene, opening)));
        let rooms = closed_rooms(scene, geometry);
        warnings.extend(modes_warning(scene, &rooms));
        let (traced, untraced_why) = trace_part(scene, geometry, reflection_order, &rooms);
        Self {
            transport: scene.simulation.transport,
            adds_pressures: scene.adds_pressures(),
            responses: true,
            reflection_order,
            images,
            portals: portal_plans(scene),
            edges,
            traced,
            untraced_why,
            warnings,
        }
    }

    /// The plan in words, as `diffray plan` prints it.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "Deterministic paths: direct sound and specular reflections up to order {} ({:.0} images a source){}.",
            self.reflection_order,
            self.images,
            if self.adds_pressures { "; they interfere" } else { "" }
        );
        for portal in &self.portals {
            let size = |m: Option<f64>| m.map_or("unbounded".to_owned(), |m| format!("{m:.4} m"));
            let _ = writeln!(
                out,
                "Opening \"{}\", {} by {}: {}",
                portal.name,
                size(portal.width_m),
                size(portal.height_m),
                portal.why
            );
            for run in portal.bands.chunk_by(|a, b| a.model == b.model) {
                let (first, last) = (&run[0], &run[run.len() - 1]);
                let ka = match (first.ka, last.ka) {
                    (Some(a), Some(b)) if run.len() > 1 => format!(" (ka {a:.3} to {b:.3})"),
                    (Some(a), _) => format!(" (ka {a:.3})"),
                    _ => String::new(),
                };
                let range = if run.len() > 1 {
                    format!("{} to {} Hz", first.band_hz, last.band_hz)
                } else {
                    format!("{} Hz", first.band_hz)
                };
                let _ = writeln!(out, "  {range:<18} {}{ka}", first.model.name());
            }
        }
        for edge in self.edges.iter().take(LISTED) {
            if edge.felt {
                let _ = writeln!(out, "Edge \"{}\": modelled (in reach of a source and a probe).", edge.name);
            } else {
                let _ = writeln!(
                    out,
                    "Edge \"{}\": left out, changes levels by less than {:.2} dB.",
                    edge.name, edge.bound_db
                );
            }
        }
        if self.edges.len() > LISTED {
            let felt = self.edges.iter().filter(|edge| edge.felt).count();
            let _ = writeln!(out, "... of {} edges in all {felt} are modelled.", self.edges.len());
        }
        match (&self.traced, &self.untraced_why) {
            (Some(part), _) => {
                let _ = writeln!(
                    out,
                    "Traced rays: {}. Echogram of {:.2} s in bins of {:.1} ms{}.",
                    part.why,
                    part.length_s,
                    1e3 * part.bin_s,
                    part.reverberation_s.map_or(String::new(), |t| format!(" (Eyring: {t:.2} s in the slowest band)"))
                );
            }
            (None, why) => {
                let _ = writeln!(out, "Traced rays: none, {}.", why.as_deref().unwrap_or("nothing is left for them"));
            }
        }
        for warning in &self.warnings {
            let _ = writeln!(out, "{warning}");
        }
        out
    }
}

fn portal_plans(scene: &Scene) -> Vec<PortalPlan> {
    let geometric = scene.simulation.transport == Transport::Geometric
        || scene.simulation.edges == Edges::Off
        || scene.simulation.diffraction_order == 0;
    let finite = |limits: [f64; 2]| Some(limits[1] - limits[0]).filter(|w| w.is_finite());
    scene
        .openings
        .iter()
        .map(|opening| {
            let (width_m, height_m) = (finite(opening.open_x_m), finite(opening.y_m));
            let side = [width_m, height_m].into_iter().flatten().reduce(f64::min);
            let depth_m = scene.gap_depth_m(opening);
            let deep = side.is_some_and(|side| is_thick(side, depth_m));
            let model = |spectrum: &Spectrum| {
                if opening.is_closed() {
                    PortalModel::Closed
                } else if geometric {
                    PortalModel::Geometric
                } else if scene.simulation.transport == Transport::Utd {
                    PortalModel::Uniform
                } else if scene.simulation.transport == Transport::Exact {
                    PortalModel::Referee
                } else if opening.is_slit() {
                    match (width_m, Form::of(&Mask::new(&[opening.open_x_m]), spectrum)) {
                        (None, _) => PortalModel::Edge,
                        _ if deep && scene.simulation.transport == Transport::Wbsdf => PortalModel::DeepGap,
                        (_, Form::Exact) if scene.simulation.transport == Transport::Wbsdf => {
                            PortalModel::NarrowOpening
                        }
                        _ => PortalModel::Opening,
                    }
                } else {
                    let sides =
                        Sides::of(opening.open_x_m[1] - opening.open_x_m[0], opening.y_m[1] - opening.y_m[0], spectrum);
                    match sides {
                        _ if scene.simulation.transport == Transport::Paraxial => PortalModel::Opening,
                        _ if deep => PortalModel::DeepGap,
                        Sides::WideBoth => PortalModel::Opening,
                        _ => PortalModel::NarrowOpening,
                    }
                }
            };
            let bands = scene
                .bands
                .iter()
                .map(|band| {
                    let spectrum = Spectrum::new(band, scene.air.speed_of_sound_m_s);
                    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
                    let ka = side.filter(|_| !opening.is_closed()).map(|a| k * a);
                    PortalBand { band_hz: band.nominal_hz, ka, model: model(&spectrum) }
                })
                .collect();
            let why = if opening.is_closed() {
                "the door is closed; only its leaf's transmission loss counts".to_owned()
            } else if geometric {
                "diffraction is switched off: a plain hole".to_owned()
            } else if scene.simulation.transport == Transport::Paraxial {
                "signed rays of the published small-angle form, at any width".to_owned()
            } else if scene.simulation.transport == Transport::Utd {
                "rays with phase over every jamb, and from jamb to jamb".to_owned()
            } else if scene.simulation.transport == Transport::Exact {
                "the integral equation at 64 frequencies a band".to_owned()
            } else if opening.is_slit() && width_m.is_none() {
                "the exact rigid half-plane".to_owned()
            } else if deep && opening.is_slit() {
                format!("mode matching in a gap {depth_m} m deep, resonances included")
            } else if deep {
                format!(
                    "edges and reveals {depth_m} m deep where it is wide (traced rays: as thin); where it is narrow, a gap of that depth \
                     with its resonances"
                )
            } else {
                "signed rays where it is wide, the exact aperture where it is narrow".to_owned()
            };
            PortalPlan { name: opening.name.clone(), width_m, height_m, bands, why }
        })
        .collect()
}

/// Whether anything is left for traced rays, and for how long.
///
/// `rooms`: reverberation times in s and volumes in m^3.
fn trace_part(
    scene: &Scene,
    geometry: &Geometry,
    order: usize,
    rooms: &[(f64, f64)],
) -> (Option<TracePart>, Option<String>) {
    let points = || scene.sources.iter().filter(|s| s.kind == SourceKind::Point);
    if points().next().is_none() {
        return (None, Some("line sources and plane waves have the deterministic paths only".to_owned()));
    }
    if geometry.surfaces.is_empty() {
        return (None, Some("there is no surface: free field".to_owned()));
    }
    let reflects = |surface: usize| {
        let material = &scene.materials[geometry.surfaces[surface].material];
        material.absorption.iter().any(|a| *a < 1.0)
    };
    let scatters = |surface: usize| {
        let material = &scene.materials[geometry.surfaces[surface].material];
        reflects(surface) && material.scattering.iter().any(|s| *s > 0.0)
    };
    let mut scattered = false;
    let mut beyond = false;
    for source in points() {
        for direction in sphere(FAN) {
            let (mut at, mut direction, mut skip) = (source.position_m, direction, Skip::NONE);
            let mut reflections = 0;
            // Passages of portals and walls count too, so that the walk ends.
            for _ in 0..order + 8 {
                let Some(hit) = geometry.closest(at, direction, f64::INFINITY, skip) else { break };
                at = hit.point;
                match hit.element {
                    Element::Surface(surface) if reflects(surface) => {
                        scattered |= scatters(surface);
                        reflections += 1;
                        let normal = geometry.surfaces[surface].frame.normal;
                        direction -= normal * (2.0 * direction.dot(normal));
                        skip = Skip::reflected(&hit);
                    }
                    Element::Surface(_) => break,
                    Element::Portal(_) => skip = Skip::passed(&hit),
                }
            }
            beyond |= reflections > order;
        }
    }
    let why = match (scattered, beyond) {
        (false, false) => {
            let why = format!("nothing scatters and no sound is reflected more than {order} times");
            return (None, Some(why));
        }
        (true, true) => format!("surfaces scatter, and sound is reflected more than {order} times"),
        (true, false) => "surfaces scatter".to_owned(),
        (false, true) => format!("sound is reflected more than {order} times"),
    };
    let reverberation_s = rooms.iter().map(|(seconds, _)| *seconds).reduce(f64::max);
    let length = scene.output.response_length_s.unwrap_or_else(|| match reverberation_s {
        Some(t) => 1.2 * t,
        None => 4.0 * farthest(scene) / scene.air.speed_of_sound_m_s + 0.2,
    });
    let length_s = length.clamp(LENGTH_S[0], LENGTH_S[1]);
    let volume_m3 = rooms.iter().map(|(_, volume_m3)| *volume_m3).reduce(f64::max);
    (Some(TracePart { why, length_s, bin_s: BIN_S, reverberation_s, volume_m3 }), None)
}

/// Longest Eyring reverberation time in s of any band, and volume in m^3, of each source's and probe's room if it is closed.
/// Of positions that see each other one is asked.
fn closed_rooms(scene: &Scene, geometry: &Geometry) -> Vec<(f64, f64)> {
    let mut asked: Vec<DVec3> = Vec::new();
    for position in scene.sources.iter().map(|s| s.position_m).chain(scene.probes.iter().map(|p| p.position_m)) {
        if asked.iter().all(|other| geometry.blocked(*other, position, Skip::NONE, Skip::NONE)) {
            asked.push(position);
        }
    }
    let rooms = asked.into_iter().filter_map(|p| geometry.enclosure(p, &scene.materials));
    let seconds_and_volume = |room: Enclosure| {
        let decay = 24.0 * std::f64::consts::LN_10 / scene.air.speed_of_sound_m_s;
        let bands = room.absorption.iter().zip(&scene.air.attenuation_per_m);
        let seconds = bands.map(|(a, m)| {
            let absorbed = -room.area_m2 * f64::ln(1.0 - a.min(0.999)) + 4.0 * m * room.volume_m3;
            decay * room.volume_m3 / absorbed.max(1e-9)
        });
        Some((seconds.reduce(f64::max)?, room.volume_m3))
    };
    rooms.filter_map(seconds_and_volume).collect()
}

/// Edges of meshes that are not modelled, `fine` of them as they belong to small faces.
fn edges_warnings(edges: &[EdgeReach], fine: usize) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if fine > 0 {
        warnings.push(Warning {
            observation: format!(
                "{fine} edges of meshes lie between faces less than {FINE_M} m deep and do not diffract"
            ),
            remedy: "the scattering of their materials stands for what they do; larger faces have edges".to_owned(),
        });
    }
    if edges.len() > MOST_EDGES {
        let felt = edges.iter().filter(|edge| edge.felt).count();
        warnings.push(Warning {
            observation: format!(
                "of {} edges the {felt} strongest diffract, those nearest to the direct sound",
                edges.len()
            ),
            remedy: "leave small things out of the mesh, or set simulation.edges = \"openings\"".to_owned(),
        });
    }
    warnings
}

/// The edge of a half-plane that an opening leaves of a thick unbounded wall, which counts as thin.
fn thin_warning(scene: &Scene, opening: &Opening) -> Option<Warning> {
    let depth_m = scene.gap_depth_m(opening);
    let half_plane = opening.open_x_m.iter().any(|limit| limit.is_infinite());
    (half_plane && depth_m > 0.0 && scene.simulation.diffraction_order > 0).then(|| Warning {
        observation: format!(
            "sound bends over the edge of opening \"{}\" as if its wall were thin, not {depth_m} m thick",
            opening.name
        ),
        remedy: "leave unbounded out and give the wall's corners: edges of walls with ends are as thick as the wall"
            .to_owned(),
    })
}

/// Below 2000 sqrt(T/V) Hz (T in s, V in m^3; Schroeder 1962) a room answers with single modes.
fn modes_warning(scene: &Scene, rooms: &[(f64, f64)]) -> Option<Warning> {
    let schroeder_hz = rooms.iter().map(|(t, volume)| 2000.0 * (t / volume).sqrt()).reduce(f64::max)?;
    scene.bands.first().filter(|band| band.low_hz < schroeder_hz).map(|_| Warning {
        observation: format!("below the Schroeder frequency of {schroeder_hz:.0} Hz the room has single modes, which are not modelled"),
        remedy: "levels there are those of many rooms like this one; interference = true adds the first reflections as pressures"
            .to_owned(),
    })
}

/// Largest distance in m between a source and a probe.
fn farthest(scene: &Scene) -> f64 {
    let pairs = scene.sources.iter().flat_map(|s| scene.probes.iter().map(move |p| (s, p)));
    pairs.map(|(s, p)| (s.position_m - p.position_m).length()).fold(0.0, f64::max)
}

/// `count` directions spread evenly over the sphere (Fibonacci lattice).
fn sphere(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let r = (1.0 - z * z).sqrt();
        let (sin, cos) = (golden * i as f64).sin_cos();
        DVec3::new(r * cos, r * sin, z)
    })
}
