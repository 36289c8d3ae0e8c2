//! The way over one edge between one source image and one probe image, and what the edge sends along it.

use std::f64::consts::{FRAC_PI_4, PI, TAU};
use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex64;

use super::Pair;
use super::images::{Image, Origin};
use super::reach::{FELT_FRESNEL, Place, angle_of, image_detour_m, place, way_m};
use super::wave::Wave;
use crate::geometry::{Edge, Geometry, Skip};
use crate::scene::{Scene, SourceKind, Transport};
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::edge::{self, AboutEdge};
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::quadrature::RaySum;
use crate::wbsdf::utd::WedgeRays;
use crate::wbsdf::wedge::{self, Diffracted, WedgeField};

/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-4;

/// One wave of a group at one wave number: length of its way in m and pressure.
#[derive(Clone, Copy)]
pub(super) struct Ray {
    pub(super) length_m: f64,
    pub(super) pressure: Complex64,
}

/// One edge between one source image and one probe image.
pub(super) struct Ends<'p, 'a> {
    pub(super) pair: &'p Pair<'a>,
    pub(super) edge: &'a Edge,
    pub(super) from: &'p Image,
    pub(super) receiver: DVec3,
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

impl<'a> Ends<'_, 'a> {
    /// `None`: the edge is not in sight of source and probe image, or too far from the direct sound and the reflections to
    /// be felt. `lit`: whether the direct way is free.
    pub(super) fn bend(&self, (s, p): (usize, usize), lit: bool) -> Option<Bend<'a>> {
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
fn reflection_factors(scene: &Scene, geometry: &Geometry, edge: &Edge, face: usize) -> Vec<f64> {
    let surfaces = &geometry.planes()[edge.planes[face]].surfaces;
    let own = surfaces.iter().find(|s| geometry.surfaces[**s].group == edge.groups[face]);
    let Some(surface) = own.or(surfaces.first()) else { return vec![1.0; scene.bands.len()] };
    let material = &scene.materials[geometry.surfaces[*surface].material];
    let shares = material.absorption.iter().zip(&material.scattering);
    shares.map(|(absorbed, scattered)| ((1.0 - absorbed) * (1.0 - scattered)).max(0.0).sqrt()).collect()
}

/// What an edge sends at one wave number, with the phase of the straight way taken out.
pub(super) struct Sent {
    pub(super) incident: Complex64,
    pub(super) faces: [Complex64; 2],
}

impl Bend<'_> {
    /// The direct sound, as if it were free, with its phase taken out.
    pub(super) fn direct(&self, k: f64) -> Complex64 {
        let k = k * self.sin_beta;
        let [straight, _] = self.field.lengths_m();
        self.field.undisturbed(straight, k) * self.turned(k)
    }

    /// The reflection by the nearer face, as if it were rigid and unbounded.
    pub(super) fn reflection(&self, k: f64) -> Complex64 {
        let k = k * self.sin_beta;
        let [_, reflected] = self.field.lengths_m();
        self.field.undisturbed(reflected, k) * self.turned(k)
    }

    /// Length in m of a way that is `across_m` long in the plane across the edge of the field.
    pub(super) fn way_m(&self, across_m: f64) -> f64 {
        self.straight_m + self.sin_beta * (across_m - self.field.lengths_m()[0])
    }

    /// The reflection by the nearer face with this intensity over a band.
    pub(super) fn reflection_of(&self, intensity: f64, k: f64) -> Ray {
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
    pub(super) fn sent(&self, band: usize, k: f64, lit: bool, reflected: bool, share: impl Fn(f64) -> f64) -> Sent {
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
        // With the shortest way: over the edge itself, or over its end.
        let first = share(self.field.ways_m().fold(f64::INFINITY, f64::min)) > 0.0;
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

/// All that an edge sends, as pressures: over the edge and over either end. `lit`, `reflected`: as in [`Bend::sent`].
pub(super) fn send<'a>(bend: Bend<'a>, lit: bool, reflected: bool, waves: &mut Vec<Wave<'a>>) {
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

fn about(p: &Place) -> AboutEdge {
    AboutEdge { r_m: p.r_m, phi: p.phi }
}
