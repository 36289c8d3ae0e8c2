//! Sound over edges: free edges of thin walls and convex wedges, of finite length, between one source image and one
//! probe image.
//!
//! The edges of one such pair belong together: where one of them hides the source, another may still let it be seen, and
//! what the first takes away the second gives. Their waves and the direct sound add as pressures while their ways differ
//! by less than a wavelength or two, as energies beyond; so do the waves of a face and its reflection. Waves whose ways are
//! equal at a boundary thus always add as pressures there, and levels are continuous across every shadow and reflection
//! boundary. Absorbing faces: the terms of a face carry its pressure reflection factor (Luebbers 1984).

use super::bend::{Bend, Ends, Ray, Sent, Way, send};
use glam::DVec3;
use rayon::prelude::*;

use super::beam::may_reach;
use super::images::{Image, ImageTree, Origin};
use super::reach::{Place, place};
use super::smooth::{NODES, Nodes};
use super::wave::Wave;
use super::{Pair, Specular};
use crate::geometry::{Edge, Geometry};
use crate::probe::EarlyPath;
use crate::scene::Transport;
use crate::wbsdf::crossing::Spectrum;

/// Differences of two ways, in half wavelengths of the lower band edge, between which pressures turn into energies.
pub(super) const COHERENT_FRESNEL: [f64; 2] = [2.0, 4.0];
/// The same for direct sound and reflection, counted from the reflection boundary.
pub(super) const JOINED_FRESNEL: [f64; 2] = [0.0, 1.0];

/// Relative change of an intensity below which an edge is left out (0.0004 dB).
const UNHEARD: f64 = 1e-4;

/// Of each image of a source or probe the edges that its sound may reach, as indices in their list, and where it stands
/// about them.
pub(super) type Reached = Vec<Vec<(usize, Place)>>;

/// What the images of a tree reach of `edges`; `between_ends`: whether ways over an edge pass between its ends, as those
/// of point sources do.
pub(super) fn reached(tree: &ImageTree, geometry: &Geometry, edges: &[(&Edge, bool)], between_ends: bool) -> Reached {
    let ends: Vec<[DVec3; 2]> = edges.iter().map(|(edge, _)| [edge.start, edge.point(edge.length_m)]).collect();
    let of_image = |(i, image): (usize, &Image)| {
        let of_edge = |(e, (edge, _)): (usize, &(&Edge, bool))| {
            let about = match image.origin {
                Origin::At(at) => place(edge, at),
                Origin::Along { .. } => Place::NONE,
            };
            // An edge lies in the planes of its faces: it sees no image in them.
            let outside = about.phi > edge.exterior_angle + 1e-9 || image.is_last_in(&edge.planes);
            let dark = || between_ends && !may_reach(&tree.images, geometry, i, &ends[e]);
            (!outside && !dark()).then_some((e, about))
        };
        edges.iter().enumerate().filter_map(of_edge).collect()
    };
    tree.images.par_iter().enumerate().map(of_image).collect()
}

/// Adds the paths over all felt edges, and what edges in sight change, to `paths`; where pressures are asked for, also what
/// the edges send to `waves`.
pub(super) fn add<'a>(pair: &Pair<'a>, paths: &mut Vec<Specular>, waves: &mut Vec<Wave<'a>>) {
    let &Pair { geometry, source, probe, order, edges, reached: [sources, probes], .. } = pair;
    if edges.iter().all(|(_, felt)| !felt) {
        return;
    }
    // What the edges change is reckoned from the undisturbed intensities.
    let specular = paths.len();
    let undisturbed: Vec<Vec<f64>> = paths.iter().map(|path| path.path.intensity.clone()).collect();
    let mut heard = Heard::new(pair, paths);
    for (s, from) in source.images.iter().enumerate().filter(|(s, _)| !sources[*s].is_empty()) {
        for (p, to) in probe.images.iter().enumerate().filter(|(p, _)| !probes[*p].is_empty()) {
            let reflections = from.planes.len() + to.planes.len();
            let Origin::At(receiver) = to.origin else { continue };
            if reflections > order {
                continue;
            }
            let common: Vec<(usize, [Place; 2])> =
                in_both(&sources[s], &probes[p]).filter(|(edge, _)| edges[*edge].1).collect();
            if common.is_empty() {
                continue;
            }
            let find = |between: Option<usize>| {
                let planes = from.planes.iter().copied().chain(between).chain(to.planes.iter().rev().copied());
                paths[..specular].iter().position(|path| planes.clone().eq(path.planes.iter().copied()))
            };
            let lit = find(None);
            let mut ways: Vec<(Ends<'_, 'a>, Way, f64)> = common
                .into_iter()
                .map(|(edge, places)| Ends { pair, edge: edges[edge].0, from, receiver, places })
                .filter_map(|ends| {
                    let way = ends.way(lit.is_some())?;
                    let bound = ends.bound(&way, heard.low_k);
                    Some((ends, way, bound))
                })
                .collect();
            ways.sort_by(|a, b| b.2.total_cmp(&a.2));
            let mut bends: Vec<Bend<'a>> = Vec::with_capacity(ways.len());
            for (ends, way, bound) in ways {
                if heard.drowns(pair, way.length_m, bound) {
                    continue;
                }
                if let Some(bend) = ends.bend((s, p), &way) {
                    heard.add(pair, &bend);
                    bends.push(bend);
                }
            }
            if bends.is_empty() {
                continue;
            }
            // A reflection by a face of an edge is one more: beyond the order nobody knows whether it exists.
            let may_reflect = reflections < order;
            let mut reflected: Vec<(usize, usize)> = Vec::new();
            for plane in bends.iter().flat_map(|bend| bend.edge.planes) {
                if may_reflect
                    && reflected.iter().all(|(known, _)| *known != plane)
                    && let Some(path) = find(Some(plane))
                {
                    reflected.push((plane, path));
                }
            }
            let found = |bend: &Bend<'_>| {
                let reflects = bend.edge.planes.iter().any(|q| reflected.iter().any(|(plane, _)| plane == q));
                [lit.is_some(), reflects]
            };
            let sent: Vec<Vec<Vec<Sent>>> = bends
                .iter()
                .map(|bend| {
                    let found = found(bend);
                    let of_band = |(band, nodes)| bend.sent(band, nodes, found).collect();
                    pair.nodes.iter().enumerate().map(of_band).collect()
                })
                .collect();
            let group = Group { pair, bends: &bends, sent: &sent, may_reflect };
            let known = |path: usize| undisturbed[path].as_slice();
            let faces: Vec<(usize, &[f64])> = reflected.iter().map(|&(plane, path)| (plane, known(path))).collect();
            let changes = group.changes(lit.map(known), &faces);
            let add = |path: &mut Specular, change: &[f64]| {
                for (intensity, change) in path.path.intensity.iter_mut().zip(change) {
                    *intensity = (*intensity + change).max(0.0);
                }
            };
            if let Some(lit) = lit {
                add(&mut paths[lit], &changes.straight);
            }
            for ((_, path), change) in reflected.iter().zip(&changes.faces) {
                add(&mut paths[*path], change);
            }
            for (bend, intensity) in bends.iter().zip(changes.over) {
                let planes = from.planes.iter().chain(to.planes.iter().rev()).copied().collect();
                let error = intensity.iter().map(|i| 1e-5 * i).collect();
                let path = EarlyPath {
                    course: Vec::new(),
                    label: label(geometry, from, bend.edge, to),
                    reflections,
                    from: probe.heard_from(geometry, p, bend.apex),
                    delay_s: bend.length_m / pair.scene.air.speed_of_sound_m_s,
                    intensity,
                    error,
                };
                paths.push(Specular { planes, bent: true, path });
            }
            if pair.scene.adds_pressures() {
                for (bend, sent) in bends.into_iter().zip(&sent) {
                    let found = found(&bend);
                    send(bend, sent, found, waves);
                }
            }
        }
    }
}

/// The edges in two lists, each in ascending order.
fn in_both<'p>(
    a: &'p [(usize, Place)],
    b: &'p [(usize, Place)],
) -> impl Iterator<Item = (usize, [Place; 2])> + use<'p> {
    let mut rest = b;
    a.iter().filter_map(move |(edge, from)| {
        rest = &rest[rest.partition_point(|(other, _)| other < edge)..];
        rest.first().filter(|(other, _)| other == edge).map(|(_, to)| (*edge, [*from, *to]))
    })
}

/// The strongest sound that is known so far.
pub(super) struct Heard {
    /// Wave number in 1/m for which bounds are taken: the lowest one.
    low_k: f64,
    /// Amplitude, one a band.
    strongest: Vec<f64>,
    /// Lengths in m of the ways of all sound.
    lengths_m: Vec<f64>,
}

impl Heard {
    pub(super) fn new(pair: &Pair<'_>, paths: &[Specular]) -> Self {
        let strongest = |band: usize| paths.iter().map(|path| path.path.intensity[band]).fold(0.0, f64::max).sqrt();
        Self {
            low_k: pair.spectra.first().map_or(1.0, Spectrum::low_k),
            strongest: (0..pair.spectra.len()).map(strongest).collect(),
            lengths_m: paths.iter().map(|path| path.path.delay_s * pair.scene.air.speed_of_sound_m_s).collect(),
        }
    }

    /// Whether what comes over an edge, at most `bound` at the lowest wave number, is inaudible in every band.
    fn drowns(&self, pair: &Pair<'_>, length_m: f64, bound: f64) -> bool {
        let apart_m = self.apart_m(length_m);
        let in_band = |(band, spectrum): (usize, &Spectrum)| {
            self.change(band, spectrum, apart_m, bound * (self.low_k / spectrum.low_k()).sqrt()) < UNHEARD
        };
        pair.spectra.iter().enumerate().all(in_band)
    }

    /// By how much sound over a way `length_m` long with at most the amplitude `bound` in a band changes intensities at most, as
    /// energy or by interference, relative to the strongest, in units of what nobody hears.
    pub(super) fn loudness(&self, band: usize, spectrum: &Spectrum, length_m: f64, bound: f64) -> f64 {
        self.change(band, spectrum, self.apart_m(length_m), bound) / UNHEARD
    }

    /// Difference in m to the way that is nearest in length.
    fn apart_m(&self, length_m: f64) -> f64 {
        self.lengths_m.iter().map(|m| (m - length_m).abs()).fold(f64::INFINITY, f64::min)
    }

    fn change(&self, band: usize, spectrum: &Spectrum, apart_m: f64, bound: f64) -> f64 {
        let ratio = bound / self.strongest[band];
        // The mean of a cosine over the band.
        let mean = (2.0 / ((spectrum.high_k() - spectrum.low_k()) * apart_m)).min(1.0);
        ratio * ratio + 2.0 * ratio * mean
    }

    /// Far from its boundaries an edge sends amplitudes like 1/sqrt(k), on them all alike.
    fn add(&mut self, pair: &Pair<'_>, bend: &Bend<'_>) {
        let lowest = pair.nodes.first().map_or(0.0, |nodes| bend.strength(nodes));
        for ((strongest, factor), spectrum) in self.strongest.iter_mut().zip(&bend.factors).zip(pair.spectra) {
            let sent = lowest * (self.low_k / spectrum.high_k() * factor).sqrt();
            *strongest = strongest.max(sent);
        }
        self.lengths_m.push(bend.length_m);
    }
}

fn label(geometry: &Geometry, from: &Image, edge: &Edge, to: &Image) -> String {
    let name = |plane: &usize| super::plane_name(geometry, *plane);
    let before = from.planes.iter().map(name);
    let after = to.planes.iter().rev().map(name);
    before.chain([edge.name.clone()]).chain(after).collect::<Vec<_>>().join(", ")
}

/// The edges between one source image and one probe image.
struct Group<'p, 'a> {
    pair: &'p Pair<'a>,
    bends: &'p [Bend<'a>],
    /// What each sends, for each band and way.
    sent: &'p [Vec<Vec<Sent>>],
    may_reflect: bool,
}

/// What the edges of a group change, one value a band each.
struct Changes {
    /// Of the intensity of the direct way, where it is free.
    straight: Vec<f64>,
    /// Of the reflections by faces, in their order.
    faces: Vec<Vec<f64>>,
    /// Intensities over the edges, where the direct way is not free; else none.
    over: Vec<Vec<f64>>,
}

impl Group<'_, '_> {
    /// `direct`: intensities of the direct way, if it is free; `reflected`: planes that reflect with the intensities of
    /// these paths, both without edges.
    fn changes(&self, direct: Option<&[f64]>, reflected: &[(usize, &[f64])]) -> Changes {
        let bands = self.pair.spectra.len();
        let mut changes = Changes {
            straight: vec![0.0; bands],
            faces: vec![vec![0.0; bands]; reflected.len()],
            over: if direct.is_some() { Vec::new() } else { vec![vec![0.0; bands]; self.bends.len()] },
        };
        if self.pair.scene.simulation.transport == Transport::Paraxial {
            self.paraxial(direct, &mut changes);
            return changes;
        }
        let first = &self.bends[0];
        let [straight_m, _] = first.field.lengths_m();
        let free = first.field.free_intensity(straight_m);
        for (band, nodes) in self.pair.nodes.iter().enumerate() {
            let undisturbed = first.direct(nodes);
            let scale = undisturbed.map(|value| free / value.norm_sqr());
            let straight = direct.map(|d| {
                let amplitude = (d[band] / free).sqrt();
                Ray::single(first.straight_m, undisturbed.map(|value| amplitude * value))
            });
            self.within(band, nodes, &scale, straight, reflected, &mut changes);
        }
        changes
    }

    /// The published small-angle form, each edge for itself.
    fn paraxial(&self, direct: Option<&[f64]>, changes: &mut Changes) {
        for (e, bend) in self.bends.iter().enumerate() {
            let free = bend.field.free_intensity(bend.field.lengths_m()[0]);
            for (band, spectrum) in self.pair.spectra.iter().enumerate() {
                let value = bend.paraxial(self.pair.kind, spectrum).value;
                match direct {
                    Some(_) => {
                        let change = value.clamp(0.25 * free, 2.0 * free) - free;
                        changes.straight[band] += change * bend.factors[band];
                    }
                    None => changes.over[e][band] = value.max(0.0) * bend.factors[band],
                }
            }
        }
    }

    /// Adds the changes in one band, of means over `scale`.
    fn within(
        &self,
        band: usize,
        nodes: &Nodes,
        scale: &[f64; NODES],
        straight: Option<Ray>,
        reflected: &[(usize, &[f64])],
        changes: &mut Changes,
    ) {
        let spectrum = &self.pair.spectra[band];
        let coherent = |a_m: f64, b_m: f64| coherence(a_m - b_m, spectrum.low_hz, spectrum, COHERENT_FRESNEL);
        let product = |a: &Ray, b: &Ray| a.cross(b, nodes, scale);
        let weighted = |weight: f64, a: &Ray, b: &Ray| if weight > 0.0 { weight * product(a, b) } else { 0.0 };
        let both = |a: &Ray, b: &Ray| weighted(coherent(a.length_m, b.length_m), a, b);
        let power = |a: &Ray| a.power(nodes, scale);
        let alone = |rays: &[Ray]| {
            let pairs = rays.iter().enumerate().flat_map(|(i, a)| rays[..i].iter().map(move |b| (a, b)));
            rays.iter().map(power).sum::<f64>() + pairs.map(|(a, b)| both(a, b)).sum::<f64>()
        };
        // What belongs to the direct way, and what to each reflection: the face's own wave with those of the edges.
        let mut about: Vec<Ray> = Vec::with_capacity(self.bends.len());
        let mut faces: Vec<(Option<Ray>, Vec<Ray>)> = vec![Default::default(); reflected.len()];
        for (bend, sent) in self.bends.iter().zip(self.sent) {
            let found = |face: usize| reflected.iter().position(|(plane, _)| *plane == bend.edge.planes[face]);
            let found = [found(0), found(1)];
            let mut own = Ray::new(bend.length_m);
            let mut of_faces = [(); 2].map(|()| Ray::new(bend.length_m));
            // Beyond the order a reflection is left to the traced rays, and so is what the edge changes of it.
            let left_out = !self.may_reflect && bend.field.reflects();
            for way in &sent[band] {
                let share = coherent(way.length_m, bend.length_m);
                if share == 0.0 {
                    continue;
                }
                let mut values = way.incident;
                for (face, found) in found.iter().enumerate() {
                    match found {
                        Some(_) => of_faces[face].add(way.length_m, way.faces[face].map(|value| share * value)),
                        None if left_out => {}
                        None => values.iter_mut().zip(&way.faces[face]).for_each(|(sum, value)| *sum += value),
                    }
                }
                own.add(way.length_m, values.map(|value| share * value));
            }
            for (found, ray) in found.into_iter().zip(of_faces) {
                if let Some(n) = found {
                    let (reflection, rays) = &mut faces[n];
                    reflection.get_or_insert_with(|| bend.reflection_of(reflected[n].1[band], nodes));
                    rays.push(ray);
                }
            }
            about.push(own);
        }
        let total = alone(&about);
        match &straight {
            Some(direct) => changes.straight[band] += total + about.iter().map(|a| both(direct, a)).sum::<f64>(),
            None => {
                let powers: Vec<f64> = about.iter().map(power).collect();
                let all = powers.iter().sum::<f64>().max(f64::MIN_POSITIVE);
                for (over, own) in changes.over.iter_mut().zip(powers) {
                    over[band] += total * own / all;
                }
            }
        }
        for (n, (reflection, rays)) in faces.iter().enumerate() {
            let Some(reflection) = reflection else { continue };
            changes.faces[n][band] += alone(rays) + rays.iter().map(|r| both(reflection, r)).sum::<f64>();
            // Near the reflection boundary an edge joins the direct sound and the reflection.
            let hz = 0.5 * (spectrum.low_hz + spectrum.high_hz);
            let joined = |r: &Ray| coherence(r.length_m - reflection.length_m, hz, spectrum, JOINED_FRESNEL);
            let cross_with = |a: &Ray| {
                let (mut cross, mut most) = (0.0, 0.0_f64);
                for r in rays {
                    let weight = joined(r) * coherent(a.length_m, r.length_m);
                    cross += weighted(weight, a, r);
                    most = most.max(weight);
                }
                cross + weighted(most, a, reflection)
            };
            let cross: f64 = about.iter().chain(&straight).map(cross_with).sum();
            match &straight {
                Some(_) => changes.straight[band] += cross,
                None => changes.faces[n][band] += cross,
            }
        }
    }
}

/// Share in which waves over ways `apart_m` different add as pressures: 1 up to the first Fresnel number of `range` (half
/// wavelengths at `hz`), 0 from the second on, smooth between.
pub(super) fn coherence(apart_m: f64, hz: f64, spectrum: &Spectrum, range: [f64; 2]) -> f64 {
    let fresnel = 2.0 * apart_m.abs() * hz / spectrum.speed_m_s;
    let t = ((fresnel - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}
