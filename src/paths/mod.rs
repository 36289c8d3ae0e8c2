//! The deterministic paths: direct sound, specular chains, and each of them through an opening or over an edge.

mod edge;
mod gap;
mod images;
mod rectangle;

use rayon::prelude::*;

use crate::geometry::{Geometry, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Scene, SourceKind};
use crate::wbsdf::crossing::Spectrum;

pub use edge::{EdgeReach, edge_reach};
pub use gap::Gap;
pub use images::{ImageTree, Origin};

/// Paths weaker than this relative to the strongest of their pair in every band are dropped (-120 dB).
const NEGLIGIBLE: f64 = 1e-12;

/// A source and a probe with their images, and the scene between them.
struct Pair<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    /// One a band.
    spectra: &'a [Spectrum],
    kind: &'a SourceKind,
    source: &'a ImageTree,
    probe: &'a ImageTree,
    /// Most reflections on a path.
    order: usize,
}

/// All deterministic paths, one list for every (source, probe), sources slowest.
///
/// `reflection_order`: specular reflections on a path at most.
pub fn find(scene: &Scene, geometry: &Geometry, reflection_order: usize) -> Vec<Vec<EarlyPath>> {
    let spectra: Vec<Spectrum> = scene.bands.iter().map(|b| Spectrum::new(b, scene.air.speed_of_sound_m_s)).collect();
    let gaps = if scene.simulation.diffraction_order > 0 { Gap::find(scene, geometry) } else { Vec::new() };
    let reaches = edge_reach(scene, geometry);
    let probes: Vec<ImageTree> =
        scene.probes.par_iter().map(|p| ImageTree::of_probe(p.position_m, geometry, reflection_order)).collect();
    let sources: Vec<ImageTree> =
        scene.sources.par_iter().map(|s| ImageTree::of_source(s, geometry, reflection_order)).collect();
    let pairs: Vec<(usize, usize)> = (0..sources.len()).flat_map(|s| (0..probes.len()).map(move |p| (s, p))).collect();
    pairs
        .par_iter()
        .map(|&(s, p)| {
            let pair = Pair {
                scene,
                geometry,
                spectra: &spectra,
                kind: &scene.sources[s].kind,
                source: &sources[s],
                probe: &probes[p],
                order: reflection_order,
            };
            let mut paths = specular(scene, geometry, pair.kind, pair.source, p);
            if scene.simulation.diffraction_order > 0 {
                edge::add(&pair, &reaches, &mut paths);
            }
            let mut paths: Vec<EarlyPath> = paths.into_iter().map(|path| path.path).collect();
            paths.extend(gaps.iter().flat_map(|gap| gap.paths(&pair)));
            tidy(paths)
        })
        .collect()
}

/// Drops what no band hears and sorts by arrival.
fn tidy(paths: Vec<EarlyPath>) -> Vec<EarlyPath> {
    let strongest = paths.iter().flat_map(|p| &p.intensity).fold(0.0_f64, |a, b| a.max(*b));
    let mut kept: Vec<EarlyPath> =
        paths.into_iter().filter(|p| p.intensity.iter().any(|i| *i > NEGLIGIBLE * strongest)).collect();
    kept.sort_by(|a, b| a.delay_s.total_cmp(&b.delay_s));
    kept
}

/// The direct sound and the specular reflections in sight.
fn specular(scene: &Scene, geometry: &Geometry, kind: &SourceKind, source: &ImageTree, probe: usize) -> Vec<Specular> {
    let receiver = scene.probes[probe].position_m;
    let mut paths: Vec<Specular> = Vec::new();
    let mut found: Vec<Origin> = Vec::new();
    for (index, image) in source.images.iter().enumerate() {
        // A way exactly through a corner exists in both orders of reflection, with one and the same image.
        if found.iter().any(|other| other.coincides(&image.origin)) {
            continue;
        }
        let Some(loss) = source.arrive(scene, geometry, index, receiver, Skip::NONE) else { continue };
        found.push(image.origin);
        let (length, spread) = spreading(&image.origin, kind, receiver);
        let intensity: Vec<f64> = loss
            .factors
            .iter()
            .zip(&scene.air.attenuation_per_m)
            .map(|(f, m)| f * spread * (-m * length).exp())
            .collect();
        let names: Vec<String> = loss.surfaces.iter().map(|s| geometry.surfaces[*s].name.clone()).collect();
        paths.push(Specular {
            planes: image.planes.clone(),
            path: EarlyPath {
                label: if names.is_empty() { "direct".into() } else { names.join(", ") },
                reflections: image.planes.len(),
                delay_s: length / scene.air.speed_of_sound_m_s,
                error: vec![0.0; intensity.len()],
                intensity,
            },
        });
    }
    paths
}

/// A path with the planes it was reflected by.
struct Specular {
    planes: Vec<usize>,
    path: EarlyPath,
}

/// Length of the way in m and spreading of the intensity relative to the free field at 1 m.
fn spreading(origin: &Origin, kind: &SourceKind, receiver: glam::DVec3) -> (f64, f64) {
    match (*origin, kind) {
        (Origin::At(position), SourceKind::Line(axis)) => {
            let d = receiver - position;
            let r = (d - *axis * d.dot(*axis)).length();
            (r, 1.0 / r)
        }
        (Origin::At(position), _) => {
            let r = (receiver - position).length();
            (r, 1.0 / (r * r))
        }
        (Origin::Along(direction), _) => (receiver.dot(direction), 1.0),
    }
}

/// Name of a plane for people: that of its first surface.
fn plane_name(geometry: &Geometry, plane: usize) -> String {
    let surface = geometry.planes().get(plane).and_then(|p| p.surfaces.first());
    surface.map_or_else(String::new, |s| geometry.surfaces[*s].name.clone())
}
