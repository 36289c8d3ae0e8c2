//! The deterministic paths: direct sound, specular chains, and each of them through an opening or over an edge.

mod beam;
mod bend;
mod beside;
mod bodies;
mod chain;
mod course;
mod edge;
mod flanked;
mod gap;
mod images;
mod joined;
mod reach;
mod rectangle;
mod side;
mod smooth;
mod unfolded;
mod wave;

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::{Edge, Geometry, Skip};
use crate::probe::{EarlyPath, TableCost};
use crate::scene::{Scene, Source, SourceKind, Transport};
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::wedge;
use edge::Reached;
use images::Loss;
use smooth::Nodes;
use wave::{Adding, Sound, Wave};

pub use course::add_courses;
pub use gap::Gap;
pub use images::{ImageTree, Origin};
pub use reach::{EdgeReach, MOST_EDGES, edge_reach};

/// Paths weaker than this relative to the strongest of their pair in every band are dropped (-120 dB).
const NEGLIGIBLE: f64 = 1e-12;

/// Share of the sum through an opening up to which its weakest ways are only estimated, within some 5 dB: 0.04 dB of the sum.
const ESTIMATED: f64 = 0.01;

/// What the deterministic paths bring from one source to one probe.
#[derive(Debug, Clone, PartialEq)]
pub struct Early {
    /// The paths in order of arrival.
    pub paths: Vec<EarlyPath>,
    /// Their intensity together, one a band: the sum of theirs, or where pressures add the mean of |sum of pressures|^2.
    pub intensity: Vec<f64>,
}

/// A source and a probe with their images, and the scene between them.
struct Pair<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    /// One a band.
    spectra: &'a [Spectrum],
    /// One a band.
    nodes: &'a [Nodes],
    kind: &'a SourceKind,
    source: &'a ImageTree,
    probe: &'a ImageTree,
    /// The edges that may matter, alone (`true`) or only after another one.
    edges: &'a [(&'a Edge, bool)],
    /// Which of them the images of source and probe reach.
    reached: [&'a Reached; 2],
    /// Most reflections on a path.
    order: usize,
    /// Share of the sum through an opening up to which its weakest ways are only estimated.
    estimated: f64,
}

/// What all paths of a scene share: its openings, whose tables are filled as the first paths need them.
pub struct Prepared<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    order: usize,
    spectra: Vec<Spectrum>,
    nodes: Vec<Nodes>,
    gaps: Vec<Gap>,
    estimated: f64,
    /// Share of the strongest path of a pair below which paths are dropped.
    negligible: f64,
}

/// All deterministic paths, one list for every (source, probe), sources slowest.
///
/// `reflection_order`: specular reflections on a path at most.
pub fn find(scene: &Scene, geometry: &Geometry, reflection_order: usize) -> Vec<Early> {
    Prepared::new(scene, geometry, reflection_order).find()
}

impl<'a> Prepared<'a> {
    /// `reflection_order`: specular reflections on a path at most.
    pub fn new(scene: &'a Scene, geometry: &'a Geometry, reflection_order: usize) -> Self {
        let spectra: Vec<Spectrum> =
            scene.bands.iter().map(|b| Spectrum::new(b, scene.air.speed_of_sound_m_s)).collect();
        let gaps = if scene.simulation.diffraction_order > 0 { Gap::find(scene, geometry) } else { Vec::new() };
        let nodes = Nodes::of(&spectra);
        Self {
            scene,
            geometry,
            order: reflection_order,
            nodes,
            spectra,
            gaps,
            estimated: ESTIMATED,
            negligible: NEGLIGIBLE,
        }
    }

    /// For what every single path is like: with this share of the sum through an opening up to which its weakest ways are only
    /// estimated, instead of 1 %, and with the faintest of paths.
    fn estimating(self, share: f64) -> Self {
        Self { estimated: share, negligible: 0.0, ..self }
    }

    /// Drops what is known of single sources and probes: only what belongs to the openings themselves is kept.
    pub fn forget_points(&self) {
        self.gaps.iter().for_each(Gap::forget_points);
    }

    /// What its openings have cost so far.
    pub fn costs(&self) -> Vec<TableCost> {
        self.gaps.iter().map(Gap::cost).collect()
    }

    /// All deterministic paths, one list for every (source, probe), sources slowest.
    pub fn find(&self) -> Vec<Early> {
        bodies::weighted(self, self.find_all())
    }

    /// The same with every body as if it were large.
    fn find_all(&self) -> Vec<Early> {
        let &Self { scene, geometry, order, .. } = self;
        let reaches = edge_reach(scene, geometry);
        // Images by position make trees of chains superfluous.
        let merged = unfolded::applies(scene, geometry, &reaches);
        let places = |s: &Source| merged.then(|| unfolded::positions(s.position_m, geometry, order, usize::MAX).0);
        let positions: Vec<Option<Vec<DVec3>>> = scene.sources.par_iter().map(places).collect();
        let tree_order = if merged { 0 } else { order };
        let probes: Vec<ImageTree> =
            scene.probes.par_iter().map(|p| ImageTree::of_probe(p.position_m, geometry, tree_order)).collect();
        let sources: Vec<ImageTree> =
            scene.sources.par_iter().map(|s| ImageTree::of_source(s, geometry, tree_order)).collect();
        let all = geometry.edges.len() <= MOST_EDGES;
        let edges = geometry.edges.iter().zip(&reaches).map(|(edge, reach)| (edge, reach.felt));
        let edges: Vec<(&Edge, bool)> = edges.filter(|(_, felt)| all || *felt).collect();
        let is_point = |source: &Source| source.kind == SourceKind::Point;
        let reached = |tree: &ImageTree, points: bool| edge::reached(tree, geometry, &edges, points);
        let from_sources: Vec<Reached> =
            sources.iter().zip(&scene.sources).map(|(tree, source)| reached(tree, is_point(source))).collect();
        let points = scene.sources.iter().all(is_point);
        let from_probes: Vec<Reached> = probes.iter().map(|tree| reached(tree, points)).collect();
        let pairs: Vec<(usize, usize)> =
            (0..sources.len()).flat_map(|s| (0..probes.len()).map(move |p| (s, p))).collect();
        pairs
            .par_iter()
            .map(|&(s, p)| {
                let pair = Pair {
                    scene,
                    geometry,
                    spectra: &self.spectra,
                    nodes: &self.nodes,
                    kind: &scene.sources[s].kind,
                    source: &sources[s],
                    probe: &probes[p],
                    edges: &edges,
                    reached: [&from_sources[s], &from_probes[p]],
                    order,
                    estimated: self.estimated,
                };
                self.between(&pair, (&scene.sources[s], scene.probes[p].position_m), positions[s].as_deref())
            })
            .collect()
    }

    /// The paths of one pair; `images`: where those of the source are, if they are told apart by their positions alone.
    fn between(&self, pair: &Pair<'_>, (source, probe_m): (&Source, DVec3), images: Option<&[DVec3]>) -> Early {
        let &Self { scene, geometry, order, .. } = self;
        let ways = match images {
            Some(images) => {
                let way = |image: &DVec3| {
                    let arrived = unfolded::arrive(scene, geometry, source, *image, probe_m, order);
                    arrived.map(|(planes, loss)| (Origin::At(*image), planes, loss))
                };
                images.par_iter().filter_map(way).collect()
            }
            None => in_sight(pair, probe_m),
        };
        let (mut paths, mut waves) = specular(pair, probe_m, ways);
        if scene.simulation.diffraction_order > 0 {
            edge::add(pair, &mut paths, &mut waves);
            chain::add(pair, &mut paths, &mut waves);
            beside::add(pair, &self.gaps, &mut paths, &mut waves);
        }
        let mut paths: Vec<EarlyPath> = paths.into_iter().map(|path| path.path).collect();
        for gap in &self.gaps {
            paths.extend(gap.paths(pair, &mut waves));
        }
        let intensity = if scene.adds_pressures() {
            let utd = scene.simulation.transport == Transport::Utd;
            let adding = if utd { Adding::Frequencies } else { Adding::Means };
            wave::together(&mut waves, pair.spectra, pair.nodes, adding, |k| line_scale(source, probe_m, k))
        } else {
            (0..pair.spectra.len()).map(|b| paths.iter().map(|p| p.intensity[b]).sum()).collect()
        };
        Early { paths: tidy(paths, self.negligible), intensity }
    }
}

/// Where images are told apart by their positions alone (`unfolded`): the highest order up to `order` at which no source has
/// more than `most`, and how many there are. `None`: chains have to be followed.
pub fn merged_images(scene: &Scene, geometry: &Geometry, order: usize, most: f64) -> Option<(usize, f64)> {
    if !unfolded::applies(scene, geometry, &edge_reach(scene, geometry)) {
        return None;
    }
    let of_source = |s: &Source| unfolded::positions(s.position_m, geometry, order, most as usize);
    let all: Vec<(Vec<DVec3>, usize)> = scene.sources.iter().map(of_source).collect();
    let order = all.iter().map(|(_, reached)| *reached).min()?;
    let count = scene.sources.iter().map(|s| unfolded::positions(s.position_m, geometry, order, usize::MAX).0.len());
    Some((order, count.max()? as f64))
}

/// From |p|^2 over that of the free field at 1 m to the intensity relative to it: 1 but for line sources, whose free field is
/// taken as 1/r (see [`crate::probe`]).
fn line_scale(source: &Source, receiver: DVec3, k: f64) -> f64 {
    match source.kind {
        SourceKind::Line(_) => {
            let (length_m, free) = spreading(&Origin::At(source.position_m), &source.kind, receiver);
            free / wedge::free_amplitude(wedge::Wave::Line, length_m, k).norm_sqr()
        }
        _ => 1.0,
    }
}

/// Drops what no band hears, up to the share `negligible` of the strongest, and sorts by arrival.
fn tidy(paths: Vec<EarlyPath>, negligible: f64) -> Vec<EarlyPath> {
    let strongest = paths.iter().flat_map(|p| &p.intensity).fold(0.0_f64, |a, b| a.max(*b));
    let mut kept: Vec<EarlyPath> =
        paths.into_iter().filter(|p| p.intensity.iter().any(|i| *i > negligible * strongest)).collect();
    kept.sort_by(|a, b| a.delay_s.total_cmp(&b.delay_s));
    kept
}

/// The images of the source's tree in sight of `receiver`: origin, planes of reflection, loss.
fn in_sight(pair: &Pair<'_>, receiver: DVec3) -> Vec<(Origin, Vec<usize>, Loss)> {
    let &Pair { scene, geometry, source, .. } = pair;
    let mut found: Vec<(Origin, Vec<usize>, Loss)> = Vec::new();
    for (index, image) in source.images.iter().enumerate() {
        // A way exactly through a corner exists in both orders of reflection, with one and the same image.
        if found.iter().any(|(other, ..)| other.coincides(&image.origin)) {
            continue;
        }
        if let Some(loss) = source.arrive(scene, geometry, index, receiver, Skip::NONE) {
            found.push((image.origin, image.planes.clone(), loss));
        }
    }
    found
}

/// The direct sound and the specular reflections in sight, as paths and as pressures.
fn specular<'a>(
    pair: &Pair<'a>,
    receiver: DVec3,
    ways: Vec<(Origin, Vec<usize>, Loss)>,
) -> (Vec<Specular>, Vec<Wave<'a>>) {
    let &Pair { scene, geometry, kind, .. } = pair;
    let (mut paths, mut waves): (Vec<Specular>, Vec<Wave<'a>>) = (Vec::new(), Vec::new());
    for (origin, planes, loss) in ways {
        let (length_m, spread) = spreading(&origin, kind, receiver);
        let air = scene.air.attenuation_per_m.iter().map(|m| (-m * length_m).exp());
        let shares: Vec<f64> = loss.factors.iter().zip(air).map(|(f, air)| f * air).collect();
        let intensity: Vec<f64> = shares.iter().map(|share| share * spread).collect();
        let names: Vec<String> = loss.surfaces.iter().map(|s| geometry.surfaces[*s].name.clone()).collect();
        paths.push(Specular {
            bent: false,
            path: EarlyPath {
                from: origin.direction_from(receiver),
                label: if names.is_empty() { "direct".into() } else { names.join(", ") },
                reflections: planes.len(),
                delay_s: length_m / scene.air.speed_of_sound_m_s,
                error: vec![0.0; intensity.len()],
                course: Vec::new(),
                intensity,
            },
            planes,
        });
        if scene.adds_pressures() {
            let wave = match kind {
                SourceKind::Point => wedge::Wave::Point(0.0),
                SourceKind::Line(_) => wedge::Wave::Line,
                SourceKind::Plane(_) => wedge::Wave::Plane,
            };
            // The pressure reflection factor of a face is the root of the share it reflects, in phase.
            let sound = if scene.simulation.transport == Transport::Utd {
                Sound::at(move |band, k| shares[band].sqrt() * wedge::free_wave(wave, length_m, k))
            } else {
                let amplitude = |(nodes, share): (&Nodes, &f64)| {
                    let root = share.sqrt();
                    nodes.map(|k| root * wedge::free_amplitude(wave, length_m, k))
                };
                Sound::Smooth(pair.nodes.iter().zip(&shares).map(amplitude).collect())
            };
            waves.push(Wave { length_m, wander_m: 0.0, sound });
        }
    }
    (paths, waves)
}

/// A path with the planes it was reflected by.
struct Specular {
    planes: Vec<usize>,
    /// Whether it also leads over an edge.
    bent: bool,
    path: EarlyPath,
}

/// Length of the way in m and spreading of the intensity relative to the free field at 1 m.
fn spreading(origin: &Origin, kind: &SourceKind, receiver: DVec3) -> (f64, f64) {
    match (*origin, kind) {
        (Origin::At(position), SourceKind::Line(axis)) => {
            let d = receiver - position;
            let r = (d - *axis * d.dot(*axis)).length();
            (r, 1.0 / r)
        }
        (Origin::At(_), _) => {
            let r = origin.length_m(receiver);
            (r, 1.0 / (r * r))
        }
        (Origin::Along { .. }, _) => (origin.length_m(receiver), 1.0),
    }
}

/// Name of a plane for people: that of its first surface.
fn plane_name(geometry: &Geometry, plane: usize) -> String {
    let surface = geometry.planes().get(plane).and_then(|p| p.surfaces.first());
    surface.map_or_else(String::new, |s| geometry.surfaces[*s].name.clone())
}
