//! Sound over edges: free edges of thin walls and convex wedges, of finite length, between one source image and one
//! probe image.
//!
//! The edges of one such pair belong together: where one of them hides the source, another may still let it be seen, and
//! what the first takes away the second gives. Their waves and the direct sound add as pressures while their ways differ
//! by less than a wavelength or two, as energies beyond; so do the waves of a face and its reflection. Waves whose ways are
//! equal at a boundary thus always add as pressures there, and levels are continuous across every shadow and reflection
//! boundary. Absorbing faces: the terms of a face carry its pressure reflection factor (Luebbers 1984).

use super::bend::{Bend, Ends, Ray, send};
use super::images::{Image, Origin};
use super::reach::EdgeReach;
use super::wave::Wave;
use super::{Pair, Specular};
use crate::geometry::{Edge, Geometry};
use crate::probe::EarlyPath;
use crate::scene::Transport;
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::slit::gauss_nodes;

/// Differences of two ways, in half wavelengths of the lower band edge, between which pressures turn into energies.
const COHERENT_FRESNEL: [f64; 2] = [2.0, 4.0];
/// The same for direct sound and reflection, counted from the reflection boundary.
const JOINED_FRESNEL: [f64; 2] = [0.0, 1.0];

/// Adds the paths over all felt edges, and what edges in sight change, to `paths`; where pressures are asked for, also what
/// the edges send to `waves`.
pub(super) fn add<'a>(pair: &Pair<'a>, reaches: &[EdgeReach], paths: &mut Vec<Specular>, waves: &mut Vec<Wave<'a>>) {
    let &Pair { geometry, source, probe, order, .. } = pair;
    let felt: Vec<&'a Edge> =
        geometry.edges.iter().zip(reaches).filter(|(_, reach)| reach.felt).map(|(e, _)| e).collect();
    if felt.is_empty() {
        return;
    }
    // What the edges change is reckoned from the undisturbed intensities.
    let specular = paths.len();
    let undisturbed: Vec<Vec<f64>> = paths.iter().map(|path| path.path.intensity.clone()).collect();
    for (s, from) in source.images.iter().enumerate() {
        for (p, to) in probe.images.iter().enumerate() {
            let reflections = from.planes.len() + to.planes.len();
            let Origin::At(receiver) = to.origin else { continue };
            if reflections > order {
                continue;
            }
            let find = |between: Option<usize>| {
                let planes = from.planes.iter().copied().chain(between).chain(to.planes.iter().rev().copied());
                paths[..specular].iter().position(|path| planes.clone().eq(path.planes.iter().copied()))
            };
            let lit = find(None);
            let bends: Vec<Bend<'a>> = felt
                .iter()
                .filter_map(|edge| Ends { pair, edge, from, receiver }.bend((s, p), lit.is_some()))
                .collect();
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
            let group = Group { pair, bends: &bends, may_reflect };
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
                for bend in bends {
                    let found = bend.edge.planes.iter().any(|q| reflected.iter().any(|(plane, _)| plane == q));
                    send(bend, lit.is_some(), found, waves);
                }
            }
        }
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
        for (band, spectrum) in self.pair.spectra.iter().enumerate() {
            let (low, high) = (spectrum.low_k(), spectrum.high_k());
            // Only waves that add as pressures make the mean over the band hard.
            let phase = (high - low) * self.coherent_m(spectrum, direct.is_some());
            let count = if high > low { 5 + (0.7 * phase).ceil() as usize } else { 1 };
            let amplitude = direct.map(|d| (d[band] / free).sqrt());
            for (k, weight) in gauss_nodes(low, high, count) {
                let scale = weight * free / first.field.free(straight_m, k * first.sin_beta);
                let straight = amplitude.map(|a| Ray { length_m: first.straight_m, pressure: a * first.direct(k) });
                self.at(band, k, scale, straight, reflected, &mut changes);
            }
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

    /// Largest difference in m between ways that add as pressures.
    fn coherent_m(&self, spectrum: &Spectrum, lit: bool) -> f64 {
        let reach = COHERENT_FRESNEL[1] * 0.5 * spectrum.speed_m_s / spectrum.low_hz;
        let mut most = 0.0_f64;
        for (i, bend) in self.bends.iter().enumerate() {
            let direct = lit.then_some(bend.straight_m);
            let reflection = Some(bend.way_m(bend.field.lengths_m()[1]));
            let ends = bend.field.ways_m().map(|way| bend.way_m(way));
            let others = self.bends[..i].iter().map(|other| other.length_m);
            let ways = direct.into_iter().chain(reflection).chain(ends).chain(others);
            most = ways.map(|way| (bend.length_m - way).abs()).filter(|d| *d < reach).fold(most, f64::max);
        }
        most
    }

    /// Adds the changes at one wave number, times `scale`.
    fn at(
        &self,
        band: usize,
        k: f64,
        scale: f64,
        straight: Option<Ray>,
        reflected: &[(usize, &[f64])],
        changes: &mut Changes,
    ) {
        let spectrum = &self.pair.spectra[band];
        let coherent = |a_m: f64, b_m: f64| coherence(a_m - b_m, spectrum.low_hz, spectrum, COHERENT_FRESNEL);
        let product = |a: &Ray, b: &Ray| 2.0 * (a.pressure * b.pressure.conj()).re;
        let both = |a: &Ray, b: &Ray| coherent(a.length_m, b.length_m) * product(a, b);
        let alone = |rays: &[Ray]| {
            let pairs = rays.iter().enumerate().flat_map(|(i, a)| rays[..i].iter().map(move |b| (a, b)));
            let powers = rays.iter().map(|a| a.pressure.norm_sqr());
            powers.sum::<f64>() + pairs.map(|(a, b)| both(a, b)).sum::<f64>()
        };
        // What belongs to the direct way, and what to each reflection: the face's own wave with those of the edges.
        let mut about: Vec<Ray> = Vec::with_capacity(self.bends.len());
        let mut faces: Vec<(Option<Ray>, Vec<Ray>)> = vec![Default::default(); reflected.len()];
        for bend in self.bends {
            let found = |face: usize| reflected.iter().position(|(plane, _)| *plane == bend.edge.planes[face]);
            let share = |way_m: f64| coherent(bend.way_m(way_m), bend.length_m);
            let sent = bend.sent(band, k, straight.is_some(), found(0).or(found(1)).is_some(), share);
            let ray = |pressure| Ray { length_m: bend.length_m, pressure };
            let mut own = sent.incident;
            for (face, pressure) in sent.faces.into_iter().enumerate() {
                match found(face) {
                    Some(n) => {
                        let (reflection, rays) = &mut faces[n];
                        reflection.get_or_insert_with(|| bend.reflection_of(reflected[n].1[band], k));
                        rays.push(ray(pressure));
                    }
                    // Beyond the order a reflection is left to the traced rays, and so is what the edge changes of it.
                    None if !self.may_reflect && bend.field.reflects() => {}
                    None => own += pressure,
                }
            }
            about.push(ray(own));
        }
        let total = alone(&about);
        match &straight {
            Some(direct) => {
                let change = total + about.iter().map(|a| both(direct, a)).sum::<f64>();
                changes.straight[band] += scale * change;
            }
            None => {
                let powers: f64 = about.iter().map(|a| a.pressure.norm_sqr()).sum();
                for (over, a) in changes.over.iter_mut().zip(&about) {
                    over[band] += scale * total * a.pressure.norm_sqr() / powers.max(f64::MIN_POSITIVE);
                }
            }
        }
        for (n, (reflection, rays)) in faces.iter().enumerate() {
            let Some(reflection) = reflection else { continue };
            changes.faces[n][band] += scale * (alone(rays) + rays.iter().map(|r| both(reflection, r)).sum::<f64>());
            // Near the reflection boundary an edge joins the direct sound and the reflection.
            let hz = 0.5 * (spectrum.low_hz + spectrum.high_hz);
            let joined = |r: &Ray| coherence(r.length_m - reflection.length_m, hz, spectrum, JOINED_FRESNEL);
            let cross_with = |a: &Ray| {
                let (mut cross, mut most) = (0.0, 0.0_f64);
                for r in rays {
                    let weight = joined(r) * coherent(a.length_m, r.length_m);
                    cross += weight * product(a, r);
                    most = most.max(weight);
                }
                cross + most * product(a, reflection)
            };
            let cross: f64 = about.iter().chain(&straight).map(cross_with).sum();
            match &straight {
                Some(_) => changes.straight[band] += scale * cross,
                None => changes.faces[n][band] += scale * cross,
            }
        }
    }
}

/// Share in which waves over ways `apart_m` different add as pressures: 1 up to the first Fresnel number of `range` (half
/// wavelengths at `hz`), 0 from the second on, smooth between.
fn coherence(apart_m: f64, hz: f64, spectrum: &Spectrum, range: [f64; 2]) -> f64 {
    let fresnel = 2.0 * apart_m.abs() * hz / spectrum.speed_m_s;
    let t = ((fresnel - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}
