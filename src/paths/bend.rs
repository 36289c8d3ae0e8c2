//! The way over one edge between one source image and one probe image, and what the edge sends along it.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use glam::DVec3;
use num_complex::Complex64;

use super::Pair;
use super::images::{Image, Origin};
use super::reach::{FELT_FRESNEL, Place, angle_of, image_detour_m, way_m};
use super::smooth::{NODES, Nodes, SILENT, Smooth, turn};
use super::wave::{Sound, Wave};
use crate::geometry::{Edge, Geometry, Skip};
use crate::scene::{Scene, SourceKind, Transport};
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::edge::{self, AboutEdge};
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::quadrature::RaySum;
use crate::wbsdf::utd::WedgeRays;
use crate::wbsdf::wedge::{self, WedgeField};

/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-4;

/// Ways over one edge at most: over itself and over its ends.
const WAYS: usize = 3;

/// One wave of a group in a band: the length of its way in m, and what it is made of, each with its own way.
#[derive(Clone)]
pub(super) struct Ray {
    pub(super) length_m: f64,
    parts: [(f64, Smooth); WAYS],
    count: usize,
}

impl Ray {
    pub(super) fn new(length_m: f64) -> Self {
        Self { length_m, parts: [(0.0, SILENT); WAYS], count: 0 }
    }

    /// A wave over a single way.
    pub(super) fn single(length_m: f64, values: Smooth) -> Self {
        let mut ray = Self::new(length_m);
        ray.add(length_m, values);
        ray
    }

    /// Adds what comes over a way `length_m` long.
    pub(super) fn add(&mut self, length_m: f64, values: Smooth) {
        if let Some(part) = self.parts.get_mut(self.count) {
            *part = (length_m, values);
            self.count += 1;
        }
    }

    fn parts(&self) -> &[(f64, Smooth)] {
        &self.parts[..self.count]
    }

    /// Mean of `scale` |p|^2.
    pub(super) fn power(&self, nodes: &Nodes, scale: &[f64; NODES]) -> f64 {
        let mut sum = 0.0;
        for (i, (length_m, values)) in self.parts().iter().enumerate() {
            sum += nodes.power(values, scale);
            for (other_m, others) in &self.parts[..i] {
                sum += 2.0 * nodes.product(values, others, length_m - other_m, scale);
            }
        }
        sum
    }

    /// Mean of 2 `scale` Re[p q*].
    pub(super) fn cross(&self, other: &Self, nodes: &Nodes, scale: &[f64; NODES]) -> f64 {
        let pairs = self.parts().iter().flat_map(|a| other.parts().iter().map(move |b| (a, b)));
        2.0 * pairs.map(|((a_m, a), (b_m, b))| nodes.product(a, b, a_m - b_m, scale)).sum::<f64>()
    }
}

/// One edge between one source image and one probe image.
pub(super) struct Ends<'p, 'a> {
    pub(super) pair: &'p Pair<'a>,
    pub(super) edge: &'a Edge,
    pub(super) from: &'p Image,
    pub(super) receiver: DVec3,
    /// Where the source's image (not a plane wave's) and the probe's stand about the edge.
    pub(super) places: [Place; 2],
}

/// The way over an edge, in sight of both its ends.
pub(super) struct Bend<'a> {
    pub(super) edge: &'a Edge,
    pub(super) from: Place,
    pub(super) to: Place,
    pub(super) field: WedgeField,
    /// Length in m (plane wave: along the wave) of the way over the edge and of the straight way.
    pub(super) length_m: f64,
    pub(super) straight_m: f64,
    /// Where the way meets the edge, in m.
    pub(super) apex: DVec3,
    /// Sine of the angle between a plane wave and the edge: across it the wave number is k sin(beta). 1 for other sources.
    pub(super) sin_beta: f64,
    /// Share of the intensity that air and reflections leave, one a band.
    pub(super) factors: Vec<f64>,
    /// Pressure reflection factors of the faces, one a band.
    pub(super) faces: [Vec<f64>; 2],
    /// The second opinion, where it is asked for: the infinitely long rigid edge.
    pub(super) rays: Option<WedgeRays>,
    /// Whether the source is a line.
    pub(super) line: bool,
}

/// The way over an edge as if nothing stood in it.
#[derive(Clone, Copy)]
pub(super) struct Way {
    from: Place,
    to: Place,
    /// Where along the edge the shortest way passes.
    on_edge_m: f64,
    sin_beta: f64,
    pub(super) length_m: f64,
    straight_m: f64,
    apart_m: f64,
}

impl<'a> Ends<'_, 'a> {
    /// `None`: there is no way over the edge, or it is too far from the direct sound and the reflections to be felt. `lit`:
    /// whether the direct way is free.
    pub(super) fn way(&self, lit: bool) -> Option<Way> {
        let &Pair { scene, spectra, kind, .. } = self.pair;
        let edge = self.edge;
        let [source, to] = self.places;
        let inside = |phi: f64| phi <= edge.exterior_angle + 1e-9;
        if !inside(to.phi) {
            return None;
        }
        let two_dimensional = *kind != SourceKind::Point;
        let (from, keller_m, sin_beta) = match self.from.origin {
            Origin::At(_) => {
                if let SourceKind::Line(axis) = kind
                    && axis.dot(edge.direction).abs() < 1.0 - 1e-9
                {
                    return None;
                }
                let from = source;
                let keller = from.along_m + (to.along_m - from.along_m) * from.r_m / (from.r_m + to.r_m);
                (from, if two_dimensional { to.along_m } else { keller }, 1.0)
            }
            Origin::Along { direction, .. } => {
                // The ray keeps its direction cosine along the edge.
                let cos_beta = direction.dot(edge.direction);
                let sin_beta = (1.0 - cos_beta * cos_beta).max(0.0).sqrt();
                let from = Place { r_m: f64::INFINITY, phi: angle_of(edge, direction), along_m: to.along_m };
                (from, to.along_m - to.r_m * cos_beta / sin_beta, sin_beta)
            }
        };
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
            wave @ Origin::Along { .. } => {
                (wave.length_m(edge.point(keller_m)) + to.r_m / sin_beta, wave.length_m(self.receiver))
            }
            Origin::At(_) if two_dimensional => {
                let half = 0.5 * (to.phi - from.phi);
                (from.r_m + to.r_m, ((to.r_m - from.r_m).powi(2) + 4.0 * from.r_m * to.r_m * half.sin().powi(2)).sqrt())
            }
            point @ Origin::At(_) => (way_m(&from, &to, on_edge_m), point.length_m(self.receiver)),
        };
        let apart_m = if two_dimensional { 0.0 } else { to.along_m - from.along_m };
        // An edge in sight is felt near its shadow boundary and near the reflection boundaries of its faces.
        if lit && !scene.adds_pressures() {
            let detour = (length_m - straight_m).min(image_detour_m(edge, &from, &to, length_m, apart_m));
            if 2.0 * detour * spectra.first()?.low_hz / scene.air.speed_of_sound_m_s > FELT_FRESNEL {
                return None;
            }
        }
        Some(Way { from, to, on_edge_m, sin_beta, length_m, straight_m, apart_m })
    }

    /// Amplitude at the wave number `k` that comes over the edge at most, by Keller's coefficient with all its terms of one sign;
    /// the free field over the way where that is less.
    pub(super) fn bound(&self, way: &Way, k: f64) -> f64 {
        let Way { from, to, length_m, sin_beta, .. } = way;
        let cotangents = edge::cotangents(self.edge.exterior_angle, from.phi, to.phi);
        let n = self.edge.exterior_angle / PI;
        let (spread_m, free) = match self.pair.kind {
            SourceKind::Point => (from.r_m * to.r_m * length_m, 1.0 / length_m),
            SourceKind::Line(_) => (from.r_m * to.r_m, 1.0 / length_m.sqrt()),
            SourceKind::Plane(_) => (sin_beta * to.r_m, 1.0),
        };
        (cotangents / (2.0 * n * (TAU * k * spread_m).sqrt())).min(free)
    }

    /// `None`: the edge is not in sight of source and probe image.
    pub(super) fn bend(&self, (s, p): (usize, usize), way: &Way) -> Option<Bend<'a>> {
        let &Pair { scene, geometry, spectra, kind, source, probe, .. } = self.pair;
        let (edge, two_dimensional) = (self.edge, *kind != SourceKind::Point);
        let &Way { from, to, on_edge_m, sin_beta, length_m, straight_m, apart_m, .. } = way;
        let ([begin, end], utd) = (edge.on_surface, scene.simulation.transport == Transport::Utd);
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
            SourceKind::Point => wedge::Wave::Point(apart_m),
        };
        let ends_m = match kind {
            SourceKind::Point => [
                if begin { f64::NEG_INFINITY } else { -from.along_m },
                if end { f64::INFINITY } else { edge.length_m - from.along_m },
            ],
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        };
        let sin_beta = if wave == wedge::Wave::Plane { sin_beta } else { 1.0 };
        let all = Spectrum {
            low_hz: spectra.first()?.low_hz * sin_beta,
            high_hz: spectra.last()?.high_hz * sin_beta,
            speed_m_s: scene.air.speed_of_sound_m_s,
        };
        let field = if utd {
            WedgeField::silent(edge.exterior_angle, about(&from), about(&to), wave, &all)
        } else {
            WedgeField::between(edge.exterior_angle, about(&from), about(&to), wave, ends_m, &all)
        };
        let faces = [0, 1].map(|face| reflection_factors(scene, geometry, edge, face));
        let rays = utd.then(|| WedgeRays::new(edge.exterior_angle, about(&from), about(&to), wave));
        Some(Bend {
            edge,
            from,
            to,
            field,
            length_m,
            straight_m,
            apex,
            sin_beta,
            factors,
            faces,
            rays,
            line: wave == wedge::Wave::Line,
        })
    }
}

/// Pressure reflection factor of a face, one a band: the root of the specularly reflected share.
pub(super) fn reflection_factors(scene: &Scene, geometry: &Geometry, edge: &Edge, face: usize) -> Vec<f64> {
    let surfaces = &geometry.planes()[edge.planes[face]].surfaces;
    let own = surfaces.iter().find(|s| geometry.surfaces[**s].group == edge.groups[face]);
    let Some(surface) = own.or(surfaces.first()) else { return vec![1.0; scene.bands.len()] };
    let material = &scene.materials[geometry.surfaces[*surface].material];
    let shares = material.absorption.iter().zip(&material.scattering);
    shares.map(|(absorbed, scattered)| ((1.0 - absorbed) * (1.0 - scattered)).max(0.0).sqrt()).collect()
}

/// What an edge sends in a band over one way, without the phase of its length.
#[derive(Clone)]
pub(super) struct Sent {
    /// Length of the way in m.
    pub(super) length_m: f64,
    pub(super) incident: Smooth,
    pub(super) faces: [Smooth; 2],
}

impl Bend<'_> {
    /// The direct sound, as if it were free, without its phase.
    pub(super) fn direct(&self, nodes: &Nodes) -> Smooth {
        let [straight_m, _] = self.field.lengths_m();
        nodes.map(|k| self.field.amplitude(straight_m, k * self.sin_beta))
    }

    /// Amplitude that comes over the edge between rigid faces at the first of the nodes, which belong to the lowest band.
    pub(super) fn strength(&self, nodes: &Nodes) -> f64 {
        let (Some(k), Some(between)) = (nodes.k.first(), nodes.between.first()) else { return 0.0 };
        match &self.rays {
            Some(rays) => self.by_rays(rays, *k).norm(),
            None => self.field.over_way(0, k * self.sin_beta, between.as_ref()).iter().sum::<Complex64>().norm(),
        }
    }

    /// Length in m of a way that is `across_m` long in the plane across the edge of the field.
    pub(super) fn way_m(&self, across_m: f64) -> f64 {
        self.straight_m + self.sin_beta * (across_m - self.field.lengths_m()[0])
    }

    /// The reflection by the nearer face with this intensity over a band.
    pub(super) fn reflection_of(&self, intensity: f64, nodes: &Nodes) -> Ray {
        let [_, reflected_m] = self.field.lengths_m();
        let amplitude = (intensity / self.field.free_intensity(reflected_m)).sqrt();
        let values = nodes.map(|k| amplitude * self.field.amplitude(reflected_m, k * self.sin_beta));
        Ray::single(self.way_m(reflected_m), values)
    }

    /// The face whose reflection is nearer.
    fn nearer_face(&self) -> usize {
        usize::from(self.from.phi + self.to.phi > self.edge.exterior_angle)
    }

    /// The ray theory's pressure at wave number `k` over the edge, without the phase of its length.
    fn by_rays(&self, rays: &WedgeRays, k: f64) -> Complex64 {
        let k = k * self.sin_beta;
        // The rays of a line source lack the phase of H0.
        let phase = if self.line { Complex64::new(FRAC_1_SQRT_2, -FRAC_1_SQRT_2) } else { Complex64::ONE };
        rays.diffracted(k) * phase
    }

    /// What the edge sends in a band, one for each of the field's ways. `found`: whether the direct sound and the reflection of a
    /// face are found (exactly on a boundary rounding decides that).
    pub(super) fn sent(&self, band: usize, nodes: &Nodes, found: [bool; 2]) -> impl Iterator<Item = Sent> {
        let amplitude = self.factors[band].sqrt();
        let faces = [amplitude * self.faces[0][band], amplitude * self.faces[1][band]];
        let shortest = self.field.ways_m().fold(f64::INFINITY, f64::min);
        self.field.ways_m().enumerate().map(move |(way, across_m)| {
            let mut sent = Sent { length_m: self.way_m(across_m), incident: SILENT, faces: [SILENT; 2] };
            for (q, (k, between)) in nodes.k.iter().zip(&nodes.between).enumerate() {
                let [incident, a, b] = match &self.rays {
                    None => self.field.over_way(way, k * self.sin_beta, between.as_ref()),
                    Some(rays) => [self.by_rays(rays, *k), Complex64::ZERO, Complex64::ZERO],
                };
                sent.incident[q] = incident * amplitude;
                sent.faces[0][q] = a * faces[0];
                sent.faces[1][q] = b * faces[1];
            }
            // On a boundary both ways are equally long: with the shortest way, over the edge itself or over its end.
            let [direct, reflection] = if across_m == shortest { self.field.missing(found) } else { [0.0; 2] };
            if direct != 0.0 {
                let missing = self.direct(nodes);
                sent.incident.iter_mut().zip(missing).for_each(|(sum, value)| *sum += direct * amplitude * value);
            }
            if reflection != 0.0 {
                let nearer = self.nearer_face();
                let [_, reflected_m] = self.field.lengths_m();
                let missing = nodes.map(|k| self.field.amplitude(reflected_m, k * self.sin_beta));
                let share = reflection * faces[nearer];
                sent.faces[nearer].iter_mut().zip(missing).for_each(|(sum, value)| *sum += share * value);
            }
            sent
        })
    }
}

impl Bend<'_> {
    /// The intensity by the published small-angle form, for the infinitely long edge.
    pub(super) fn paraxial(&self, kind: &SourceKind, spectrum: &Spectrum) -> RaySum {
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

/// All that an edge sends, as pressures: over the edge and over either end. `sent`: for each band and way.
/// `found`: as in [`Bend::sent`].
pub(super) fn send<'a>(bend: Bend<'a>, sent: &[Vec<Sent>], found: [bool; 2], waves: &mut Vec<Wave<'a>>) {
    if bend.rays.is_some() {
        let shares = bend.field.missing(found);
        let nearer = bend.nearer_face();
        let wave = Wave {
            length_m: bend.length_m,
            wander_m: 0.0,
            sound: Sound::at(move |band, k| {
                let mut pressure = bend.rays.as_ref().map_or(Complex64::ZERO, |rays| bend.by_rays(rays, k));
                if shares != [0.0; 2] {
                    let weights = [shares[0], shares[1] * bend.faces[nearer][band]];
                    for (weight, length_m) in weights.into_iter().zip(bend.field.lengths_m()) {
                        pressure += weight * bend.field.amplitude(length_m, k * bend.sin_beta);
                    }
                }
                pressure * turn(k * bend.length_m) * bend.factors[band].sqrt()
            }),
        };
        waves.push(wave);
        return;
    }
    for (way, across_m) in bend.field.ways_m().enumerate() {
        let sum = |sent: &Vec<Sent>| {
            let Sent { incident, faces: [a, b], .. } = &sent[way];
            let mut sum = *incident;
            sum.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a + b);
            sum
        };
        let sound = Sound::Smooth(sent.iter().map(sum).collect());
        waves.push(Wave { length_m: bend.way_m(across_m), wander_m: 0.0, sound });
    }
}

fn about(p: &Place) -> AboutEdge {
    AboutEdge { r_m: p.r_m, phi: p.phi }
}
