//! Reflections by a wall beside and at its openings.
//!
//! What a thin rigid screen scatters is odd about its plane: on the source's side the sound is the incident wave and that of the mirror
//! image, less what the openings let through to the mirror image of the probe (exact). A reflection thus does not end at a
//! jamb: it is |p_image - p_through|^2, also where the point of reflection lies in the opening. Walls are taken as thin here, with the
//! opening in the face that reflects; away from the opening its share fades as that of an edge in sight does
//! (docs/physics.md section 3).

use std::f64::consts::FRAC_PI_4;

use glam::DVec3;
use num_complex::Complex64;

use super::edge::{COHERENT_FRESNEL, coherence};
use super::gap::{Gap, Shape};
use super::images::Origin;
use super::wave::{FEW, Sound, Wave, frequencies};
use super::{Pair, Specular};
use crate::geometry::Geometry;
use crate::probe::EarlyPath;
use crate::scene::{SourceKind, Transport};
use crate::wbsdf::aperture::Aperture;
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::mask::Mask;
use crate::wbsdf::rectangle::Passed;
use crate::wbsdf::rim::shortest_over;
use crate::wbsdf::slit::{self, gauss_nodes};
use crate::wbsdf::utd_opening::OpeningRays;

/// Share of an opening's width off its jambs at which sight is tested.
const JAMB: f64 = 0.02;

/// Adds what openings change of the reflections by their walls to `paths`, and as pressures to `waves` where these are asked for.
pub(super) fn add<'a>(pair: &Pair<'a>, gaps: &[Gap], paths: &mut Vec<Specular>, waves: &mut Vec<Wave<'a>>) {
    if matches!(pair.scene.simulation.transport, Transport::Paraxial | Transport::Geometric) {
        return;
    }
    for gap in gaps {
        for (plane, offset_m) in faces(pair.geometry, gap) {
            for s in 0..pair.source.images.len() {
                for p in 0..pair.probe.images.len() {
                    let reflections = pair.source.images[s].planes.len() + pair.probe.images[p].planes.len() + 1;
                    if reflections <= pair.order
                        && let Some(beside) = Beside::find(pair, gap, (plane, offset_m), (s, p))
                    {
                        beside.add(pair, gap, paths, waves);
                    }
                }
            }
        }
    }
}

/// Planes of the wall of `gap`, with their heights in its frame in m.
fn faces(geometry: &Geometry, gap: &Gap) -> Vec<(usize, f64)> {
    let own = |surface: &usize| Some(geometry.surfaces[*surface].group) == gap.skip.group;
    let parallel = |normal: DVec3| normal.dot(gap.frame.normal).abs() > 1.0 - 1e-9;
    let planes = geometry.planes().iter().enumerate();
    let faces = planes.filter(|(_, plane)| parallel(plane.normal) && plane.surfaces.iter().any(own));
    faces.map(|(id, plane)| (id, gap.frame.local(plane.point_m).z)).collect()
}

/// The way over an opening to the mirror image of a probe.
struct Crossed {
    /// Nearest place of the openings, and whether the straight way leads through them.
    over: DVec3,
    inside: bool,
    /// Lengths in m of the ways over it and straight on.
    over_m: f64,
    straight_m: f64,
}

impl Crossed {
    /// `None` for half-planes left open: their edges are edges like others.
    fn new(pair: &Pair<'_>, gap: &Gap, source: DVec3, receiver: DVec3) -> Option<Self> {
        let line = *pair.kind != SourceKind::Point;
        let across = |at: DVec3| if line { DVec3::new(at.x, 0.0, at.z) } else { at };
        let (from, to) = (across(source), across(receiver));
        let everywhere = Mask::new(&[[f64::NEG_INFINITY, f64::INFINITY]]);
        let (x, y) = match &gap.shape {
            Shape::Slits(tables) => (tables.mask(), &everywhere),
            Shape::Rectangles(rectangles) => rectangles.masks(),
        };
        if x.openings().iter().flatten().any(|x| x.is_infinite()) {
            return None;
        }
        let mut over = shortest_over(from, to, x, y)?;
        let straight_m = (to - from).length();
        let over_m = (over - from).length() + (to - over).length();
        let inside = over_m - straight_m < 1e-12 * straight_m;
        if line {
            over.y = receiver.y;
        }
        // Off the jamb itself, from where nothing is seen for sure.
        let inset = |at: f64, mask: &Mask| {
            let own = mask.openings().iter().find(|o| o[0] <= at && at <= o[1]);
            own.map_or(at, |o| {
                let off = if o[0].is_finite() && o[1].is_finite() { JAMB * (o[1] - o[0]) } else { 0.0 };
                at.clamp(o[0] + off, o[1] - off)
            })
        };
        (over.x, over.y) = (inset(over.x, x), inset(over.y, y));
        Some(Self { over, inside, over_m, straight_m })
    }
}

/// Pressures through slits, one a band: the exact aperture where it is narrow, else the uniform theory.
fn slit_passed(pair: &Pair<'_>, mask: &Mask, source: DVec3, receiver: DVec3) -> Vec<Passed> {
    let line = Incident::Line { x_m: source.x, z_m: source.z.abs() };
    let incident = match pair.kind {
        SourceKind::Point => Incident::Point { x_m: source.x, z_m: source.z.abs(), dy_m: receiver.y - source.y },
        _ => line,
    };
    let crossing = Crossing { incident, x_m: receiver.x, z_m: receiver.z.abs() };
    let across = Crossing { incident: line, ..crossing };
    let rays = OpeningRays::new(mask.openings(), &crossing);
    let wander_m = rays.detour_m();
    let sine = slit::sin_beta(mask, &crossing);
    let amplitude = slit::spread(mask, &crossing).sqrt();
    let over_m = slit::over_m(mask, &crossing);
    let narrowest = mask.openings().iter().map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min);
    let passed = |spectrum: &Spectrum| -> Passed {
        if 0.5 * (spectrum.low_k() + spectrum.high_k()) * narrowest > slit::NARROW_KA {
            let rays = rays.clone();
            return Passed { wander_m, pressure: Box::new(move |k| rays.pressure(k)) };
        }
        let openings = mask.openings().to_vec();
        let pressure = move |k: f64| {
            let transfer = Aperture::new(&openings, k * sine).transfer(&across);
            // It starts from i/4 H0; along the edges the way is longer.
            transfer * Complex64::from_polar(amplitude, k * over_m * (1.0 / sine - sine) - FRAC_PI_4)
        };
        Passed { wander_m, pressure: Box::new(pressure) }
    };
    pair.spectra.iter().map(passed).collect()
}

/// A source image and a probe image on the same side of an opening's wall.
struct Beside {
    /// All planes that reflect, in order.
    planes: Vec<usize>,
    /// Unit vector from the probe towards where the sound comes from.
    from: DVec3,
    /// Whether the point of reflection lies in an opening.
    inside: bool,
    /// Lengths in m of the ways from the mirror image and over the opening.
    image_m: f64,
    over_m: f64,
    /// Amplitude of the mirror image's wave.
    free: f64,
    /// Share of the intensity that reflections and air leave, one a band.
    factors: Vec<f64>,
    /// What passes through the opening to the mirror image of the probe, one a band.
    through: Vec<Passed>,
}

impl Beside {
    fn find(pair: &Pair<'_>, gap: &Gap, (plane, offset_m): (usize, f64), (s, p): (usize, usize)) -> Option<Self> {
        let &Pair { scene, geometry, source, probe, .. } = pair;
        let (from, to) = (&source.images[s], &probe.images[p]);
        let (Origin::At(source_m), Origin::At(probe_m)) = (from.origin, to.origin) else { return None };
        if from.planes.last() == Some(&plane) || to.planes.last() == Some(&plane) {
            return None;
        }
        let lift = |at: DVec3| gap.frame.local(at) - DVec3::Z * offset_m;
        let (source_m, probe_m) = (lift(source_m), lift(probe_m));
        // A thick wall's face has one side.
        let side = if offset_m.abs() > 1e-9 { offset_m } else { source_m.z };
        if source_m.z * side <= 0.0 || probe_m.z * side <= 0.0 {
            return None;
        }
        let mirrored = DVec3::new(probe_m.x, probe_m.y, -probe_m.z);
        let crossing = Crossed::new(pair, gap, source_m, mirrored)?;
        let over = gap.frame.point(crossing.over.x, crossing.over.y) + gap.frame.normal * offset_m;
        let before = source.arrive(scene, geometry, s, over, gap.skip)?;
        let after = probe.arrive(scene, geometry, p, over, gap.skip)?;
        let own = |surface: &&usize| Some(geometry.surfaces[**surface].group) == gap.skip.group;
        let surface = geometry.planes()[plane].surfaces.iter().find(own)?;
        let material = &scene.materials[geometry.surfaces[*surface].material];
        let reflected = material.absorption.iter().zip(&material.scattering).map(|(a, s)| (1.0 - a) * (1.0 - s));
        let losses = before.factors.iter().zip(&after.factors).zip(&scene.air.attenuation_per_m).zip(reflected);
        let factors = losses.map(|(((a, b), m), r)| a * b * r * (-m * crossing.over_m).exp()).collect();
        let through = match &gap.shape {
            Shape::Slits(tables) => slit_passed(pair, tables.mask(), source_m, mirrored),
            Shape::Rectangles(rectangles) => rectangles.passed(pair, source_m, mirrored, crossing.over_m)?,
        };
        let planes = from.planes.iter().chain([&plane]).chain(to.planes.iter().rev()).copied().collect();
        let (inside, image_m, over_m) = (crossing.inside, crossing.straight_m, crossing.over_m);
        let free = if *pair.kind == SourceKind::Point { 1.0 / image_m } else { 1.0 / image_m.sqrt() };
        let from = probe.heard_from(geometry, p, over);
        Some(Self { planes, from, inside, image_m, over_m, free, factors, through })
    }

    fn add<'a>(self, pair: &Pair<'a>, gap: &Gap, paths: &mut Vec<Specular>, waves: &mut Vec<Wave<'a>>) {
        let reflection = paths.iter().position(|path| !path.bent && path.planes == self.planes);
        if reflection.is_none() && !self.inside {
            return;
        }
        // Relative to the mirror image alone.
        let changed: Vec<f64> = pair
            .spectra
            .iter()
            .zip(&self.through)
            .map(|(spectrum, through)| {
                let (low, high) = (spectrum.low_k(), spectrum.high_k());
                let apart_m = through.wander_m + (self.over_m - self.image_m).abs();
                let nodes = gauss_nodes(low, high, frequencies(FEW, high - low, apart_m));
                let left = |k: f64| Complex64::from_polar(self.free, k * self.image_m) - (through.pressure)(k);
                nodes.map(|(k, weight)| weight * left(k).norm_sqr()).sum::<f64>() / (self.free * self.free)
            })
            .collect();
        match reflection {
            Some(reflection) => {
                let detour_m = self.over_m - self.image_m;
                let intensities = paths[reflection].path.intensity.iter_mut();
                for ((intensity, spectrum), changed) in intensities.zip(pair.spectra).zip(changed) {
                    let felt = coherence(detour_m, spectrum.low_hz, spectrum, COHERENT_FRESNEL);
                    *intensity *= 1.0 + felt * (changed - 1.0);
                }
            }
            None => {
                let intensity: Vec<f64> =
                    self.factors.iter().zip(changed).map(|(f, changed)| f * changed * self.free * self.free).collect();
                let names: Vec<String> = self.planes.iter().map(|p| super::plane_name(pair.geometry, *p)).collect();
                paths.push(Specular {
                    planes: self.planes.clone(),
                    bent: true,
                    path: EarlyPath {
                        course: Vec::new(),
                        label: format!("{} at {}", names.join(", "), gap.name),
                        reflections: self.planes.len(),
                        from: self.from,
                        delay_s: self.image_m / pair.scene.air.speed_of_sound_m_s,
                        error: intensity.iter().map(|i| 1e-4 * i).collect(),
                        intensity,
                    },
                });
            }
        }
        if pair.scene.adds_pressures() {
            let Self { image_m, over_m, free, factors, through, .. } = self;
            let image = if reflection.is_some() { 0.0 } else { free };
            let turn = if *pair.kind == SourceKind::Point { 0.0 } else { -FRAC_PI_4 };
            waves.push(Wave {
                length_m: image_m.min(over_m),
                wander_m: through.iter().map(|t| t.wander_m).fold((over_m - image_m).abs(), f64::max),
                sound: Sound::at(move |band, k| {
                    let left = Complex64::from_polar(image, k * image_m) - (through[band].pressure)(k);
                    left * Complex64::from_polar(factors[band].sqrt(), turn)
                }),
            });
        }
    }
}
