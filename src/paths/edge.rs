//! Sound over edges: free edges of thin walls and convex wedges, of finite length, between one source image and one
//! probe image.
//!
//! The edges of one such pair belong together: where one of them hides the source, another may still let it be seen, and
//! what the first takes away the second gives. Their waves and the direct sound add as pressures while their ways differ
//! by less than a wavelength or two, as energies beyond; so do the waves of a face and its reflection. Waves whose ways are
//! equal at a boundary thus always add as pressures there, and levels are continuous across every shadow and reflection
//! boundary. Absorbing faces: the terms of a face carry its pressure reflection factor (Luebbers 1984).

use std::f64::consts::{FRAC_PI_4, PI, TAU};
use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex64;

use super::images::{Image, Origin};
use super::reach::{EdgeReach, FELT_FRESNEL, Place, angle_of, image_detour_m, place, way_m};
use super::wave::Wave;
use super::{Pair, Specular};
use crate::geometry::{Edge, Geometry, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Scene, SourceKind, Transport};
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::edge::{self, AboutEdge};
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::quadrature::RaySum;
use crate::wbsdf::slit::gauss_nodes;
use crate::wbsdf::utd::WedgeRays;
use crate::wbsdf::wedge::{self, Diffracted, WedgeField};

/// Differences of two ways, in half wavelengths of the lower band edge, between which pressures turn into energies.
const COHERENT_FRESNEL: [f64; 2] = [2.0, 4.0];
/// The same for direct sound and reflection, counted from the reflection boundary.
const JOINED_FRESNEL: [f64; 2] = [0.0, 1.0];
/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-4;

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

/// One edge between one source image and one probe image.
struct Ends<'p, 'a> {
    pair: &'p Pair<'a>,
    edge: &'a Edge,
    from: &'p Image,
    receiver: DVec3,
}

/// The way over an edge, in sight of both its ends.
struct Bend<'a> {
    edge: &'a Edge,
    from: Place,
    to: Place,
    field: WedgeField,
    /// Length in m (plane wave: along the wave) of the way over the edge and of the straight way.
    length_m: f64,
    straight_m: f64,
    /// Sine of the angle between a plane wave and the edge: across it the wave number is k sin(beta). 1 for other sources.
    sin_beta: f64,
    /// Share of the intensity that air and reflections leave, one a band.
    factors: Vec<f64>,
    /// Pressure reflection factors of the faces, one a band.
    faces: [Vec<f64>; 2],
    /// The second opinion, where it is asked for: the infinitely long rigid edge.
    rays: Option<WedgeRays>,
    /// Whether the source is a line.
    line: bool,
}

impl<'a> Ends<'_, 'a> {
    /// `None`: the edge is not in sight of source and probe image, or too far from the direct sound and the reflections to
    /// be felt. `lit`: whether the direct way is free.
    fn bend(&self, (s, p): (usize, usize), lit: bool) -> Option<Bend<'a>> {
        let &Pair { scene, geometry, spectra, kind, source, probe, .. } = self.pair;
        let edge = self.edge;
        let to = place(edge, self.receiver);
        let two_dimensional = *kind != SourceKind::Point;
        let (from, keller_m, mut sin_beta) = match self.from.origin {
            Origin::At(position) => {
                if let SourceKind::Line(axis) = kind
                    && axis.dot(edge.direction).abs() < 1.0 - 1e-9
                {
                    return None;
                }
                let from = place(edge, position);
                let keller = from.along_m + (to.along_m - from.along_m) * from.r_m / (from.r_m + to.r_m);
                (from, if two_dimensional { to.along_m } else { keller }, 1.0)
            }
            Origin::Along(direction) => {
                // The ray keeps its direction cosine along the edge.
                let cos_beta = direction.dot(edge.direction);
                let sin_beta = (1.0 - cos_beta * cos_beta).max(0.0).sqrt();
                let from = Place { r_m: f64::INFINITY, phi: angle_of(edge, direction), along_m: to.along_m };
                (from, to.along_m - to.r_m * cos_beta / sin_beta, sin_beta)
            }
        };
        let inside = |phi: f64| phi <= edge.exterior_angle + 1e-9;
        if !(inside(from.phi) && inside(to.phi) && from.r_m > 0.0 && to.r_m > 0.0 && keller_m.is_finite()) {
            return None;
        }
        let on_edge_m = if two_dimensional { keller_m } else { keller_m.clamp(0.0, edge.length_m) };
        // Beyond an end on a surface the edge's mirror image goes on: that way is one of the image sources.
        let [begin, end] = edge.on_surface;
        let utd = scene.simulation.transport == Transport::Utd;
        if ((utd || begin) && keller_m < on_edge_m) || ((utd || end) && keller_m > on_edge_m) {
            return None;
        }
        let (length_m, straight_m) = match self.from.origin {
            Origin::Along(direction) => {
                (edge.point(keller_m).dot(direction) + to.r_m / sin_beta, self.receiver.dot(direction))
            }
            Origin::At(_) if two_dimensional => {
                let half = 0.5 * (to.phi - from.phi);
                (from.r_m + to.r_m, ((to.r_m - from.r_m).powi(2) + 4.0 * from.r_m * to.r_m * half.sin().powi(2)).sqrt())
            }
            Origin::At(position) => (way_m(&from, &to, on_edge_m), (self.receiver - position).length()),
        };
        // An edge in sight is felt near its shadow boundary and near the reflection boundaries of its faces.
        let apart = if two_dimensional { 0.0 } else { to.along_m - from.along_m };
        let detour = (length_m - straight_m).min(image_detour_m(edge, &from, &to, length_m, apart));
        let low_hz = spectra.first()?.low_hz;
        if lit && !scene.adds_pressures() && 2.0 * detour * low_hz / scene.air.speed_of_sound_m_s > FELT_FRESNEL {
            return None;
        }
        // Just outside the edge, in the middle of the fluid; from an end a little into the edge.
        let (sin, cos) = (0.5 * edge.exterior_angle).sin_cos();
        let outwards = edge.face_a * cos + edge.normal_a * sin;
        let inset_m = 1e-6 * edge.length_m.min(1.0);
        let seen_m = if two_dimensional { on_edge_m } else { on_edge_m.clamp(inset_m, edge.length_m - inset_m) };
        let apex = edge.point(seen_m) + outwards * (1e-6 * (1.0 + to.r_m));
        let before = source.arrive(scene, geometry, s, apex, Skip::NONE)?;
        let after = probe.arrive(scene, geometry, p, apex, Skip::NONE)?;
        let losses = before.factors.iter().zip(&after.factors).zip(&scene.air.attenuation_per_m);
        let factors = losses.map(|((a, b), m)| a * b * (-m * length_m).exp()).collect();
        let wave = match kind {
            SourceKind::Line(_) => wedge::Wave::Line,
            SourceKind::Plane(_) => wedge::Wave::Plane,
            SourceKind::Point => wedge::Wave::Point(apart),
        };
        let ends_m = match kind {
            SourceKind::Point => [
                if begin { f64::NEG_INFINITY } else { -from.along_m },
                if end { f64::INFINITY } else { edge.length_m - from.along_m },
            ],
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        };
        sin_beta = if wave == wedge::Wave::Plane { sin_beta } else { 1.0 };
        let all = Spectrum {
            low_hz: low_hz * sin_beta,
            high_hz: spectra.last()?.high_hz * sin_beta,
            speed_m_s: scene.air.speed_of_sound_m_s,
        };
        let field = WedgeField::between(edge.exterior_angle, about(&from), about(&to), wave, ends_m, &all);
        let faces = [0, 1].map(|face| reflection_factors(scene, geometry, edge, face));
        let rays = utd.then(|| WedgeRays::new(edge.exterior_angle, about(&from), about(&to), wave));
        Some(Bend {
            edge,
            from,
            to,
            field,
            length_m,
            straight_m,
            sin_beta,
            factors,
            faces,
            rays,
            line: wave == wedge::Wave::Line,
        })
    }
}

/// Pressure reflection factor of a face, one a band: the root of the specularly reflected share.
fn reflection_factors(scene: &Scene, geometry: &Geometry, edge: &Edge, face: usize) -> Vec<f64> {
    let surfaces = &geometry.planes()[edge.planes[face]].surfaces;
    let own = surfaces.iter().find(|s| geometry.surfaces[**s].group == edge.groups[face]);
    let Some(surface) = own.or(surfaces.first()) else { return vec![1.0; scene.bands.len()] };
    let material = &scene.materials[geometry.surfaces[*surface].material];
    let shares = material.absorption.iter().zip(&material.scattering);
    shares.map(|(absorbed, scattered)| ((1.0 - absorbed) * (1.0 - scattered)).max(0.0).sqrt()).collect()
}

/// What an edge sends at one wave number, with the phase of the straight way taken out.
struct Sent {
    incident: Complex64,
    faces: [Complex64; 2],
}

impl Bend<'_> {
    /// The direct sound, as if it were free, with its phase taken out.
    fn direct(&self, k: f64) -> Complex64 {
        let k = k * self.sin_beta;
        let [straight, _] = self.field.lengths_m();
        self.field.undisturbed(straight, k) * self.turned(k)
    }

    /// The reflection by the nearer face, as if it were rigid and unbounded.
    fn reflection(&self, k: f64) -> Complex64 {
        let k = k * self.sin_beta;
        let [_, reflected] = self.field.lengths_m();
        self.field.undisturbed(reflected, k) * self.turned(k)
    }

    /// Length in m of a way that is `across_m` long in the plane across the edge of the field.
    fn way_m(&self, across_m: f64) -> f64 {
        self.straight_m + self.sin_beta * (across_m - self.field.lengths_m()[0])
    }

    /// The reflection by the nearer face with this intensity over a band.
    fn reflection_of(&self, intensity: f64, k: f64) -> Ray {
        let [_, reflected_m] = self.field.lengths_m();
        let amplitude = (intensity / self.field.free_intensity(reflected_m)).sqrt();
        Ray { length_m: self.way_m(reflected_m), pressure: amplitude * self.reflection(k) }
    }

    /// From the phase over the edge to that of the straight way.
    fn turned(&self, k: f64) -> Complex64 {
        let [straight, _] = self.field.lengths_m();
        Complex64::from_polar(1.0, k * (self.field.over_m() - straight))
    }

    /// What the edge sends in a band at wave number `k` in 1/m. `lit`, `reflected`: whether the direct sound and the
    /// reflection of a face are found (exactly on a boundary rounding decides that); `share`: of the ways over the edge's
    /// ends, by their length.
    fn sent(&self, band: usize, k: f64, lit: bool, reflected: bool, share: impl Fn(f64) -> f64) -> Sent {
        let d = match &self.rays {
            None => self.field.diffracted(k * self.sin_beta, &share),
            Some(rays) => {
                let k = k * self.sin_beta;
                // The rays of a line source lack the phase of H0.
                let turn = if self.line { -FRAC_PI_4 } else { 0.0 };
                let incident = rays.field(k).diffracted * Complex64::from_polar(1.0, turn - k * self.field.over_m());
                Diffracted { incident, faces: [Complex64::ZERO; 2] }
            }
        };
        let amplitude = self.factors[band].sqrt();
        let turn = self.turned(k * self.sin_beta) * amplitude;
        let mut sent =
            Sent { incident: d.incident * turn, faces: [0, 1].map(|f| d.faces[f] * turn * self.faces[f][band]) };
        // With the way over the edge itself, or over its end where that is the shortest.
        let first = self.field.ways_m().next().is_some_and(|way_m| share(way_m) > 0.0);
        let [direct, reflection] = if first { self.field.missing([lit, reflected]) } else { [0.0; 2] };
        if direct != 0.0 {
            sent.incident += direct * amplitude * self.direct(k);
        }
        if reflection != 0.0 {
            let nearer = usize::from(self.from.phi + self.to.phi > self.edge.exterior_angle);
            sent.faces[nearer] += reflection * amplitude * self.faces[nearer][band] * self.reflection(k);
        }
        sent
    }
}

impl Bend<'_> {
    /// The intensity by the published small-angle form, for the infinitely long edge.
    fn paraxial(&self, kind: &SourceKind, spectrum: &Spectrum) -> RaySum {
        let (edge, from, to) = (self.edge, &self.from, &self.to);
        let dy_m = (*kind == SourceKind::Point).then_some(to.along_m - from.along_m);
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

/// All that an edge sends, as pressures: over the edge and over either end. `lit`, `reflected`: as in [`Bend::sent`].
fn send<'a>(bend: Bend<'a>, lit: bool, reflected: bool, waves: &mut Vec<Wave<'a>>) {
    let bend = Arc::new(bend);
    for across_m in bend.field.ways_m() {
        let own = Arc::clone(&bend);
        waves.push(Wave {
            length_m: bend.way_m(across_m),
            wander_m: 0.0,
            pressure: Box::new(move |band, k| {
                let share = |way_m: f64| if way_m == across_m { 1.0 } else { 0.0 };
                let sent = own.sent(band, k, lit, reflected, share);
                (sent.incident + sent.faces[0] + sent.faces[1]) * Complex64::from_polar(1.0, k * own.straight_m)
            }),
        });
    }
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

/// One wave of a group at one wave number: length of its way in m and pressure.
#[derive(Clone, Copy)]
struct Ray {
    length_m: f64,
    pressure: Complex64,
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

fn about(p: &Place) -> AboutEdge {
    AboutEdge { r_m: p.r_m, phi: p.phi }
}
