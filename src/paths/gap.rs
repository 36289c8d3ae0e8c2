//! Paths through openings: every pair of a source image and a probe image on either side of one.

use std::f64::consts::FRAC_PI_4;

use glam::DVec3;
use num_complex::Complex64;

use super::Pair;
use super::flanked::{Solved, View};
use super::images::{ImageTree, Origin};
use super::joined::{Keyed, replace};
use super::rectangle::Rectangles;
use super::wave::{Sound, Wave};
use crate::geometry::{Geometry, Skip};
use crate::probe::{EarlyPath, TableCost};
use crate::scene::{Frame, Scene, SourceKind, Transport};
use crate::wbsdf::crossing::{Crossing, Incident, Spectrum};
use crate::wbsdf::mask::Mask;
use crate::wbsdf::quadrature::RaySum;
use crate::wbsdf::referee;
use crate::wbsdf::rim::span;
use crate::wbsdf::slit;
use crate::wbsdf::tables::SlitTables;
use crate::wbsdf::timed::Cost;
use crate::wbsdf::utd;
use crate::wbsdf::utd_opening::OpeningRays;

/// Openings that act as one: rectangles of one wall side by side, or all infinitely long slits of one plane.
pub struct Gap {
    /// Name of the opening(s).
    pub name: String,
    pub(super) frame: Frame,
    pub(super) shape: Shape,
    /// What a ray that stands in the opening cannot meet.
    pub(super) skip: Skip,
    /// Whether there is nothing but the openings' own wall, so that no straight way to them is blocked.
    alone: bool,
    /// Apertures for ways past edges before and behind.
    solved: Solved,
}

pub(super) enum Shape {
    Slits(Box<SlitTables>),
    Rectangles(Box<Rectangles>),
}

/// Places across an opening (shares of its width) where sight of source and probe is tested.
pub(super) const SIGHT_PLACES: [f64; 5] = [0.02, 0.26, 0.5, 0.74, 0.98];

impl Gap {
    /// All gaps of the geometry: slits of one plane with parallel edges are joined, and rectangles of one wall with the same
    /// limits along y.
    pub fn find(scene: &Scene, geometry: &Geometry) -> Vec<Self> {
        let spectra: Vec<Spectrum> =
            scene.bands.iter().map(|b| Spectrum::new(b, scene.air.speed_of_sound_m_s)).collect();
        let mut gaps: Vec<Self> = Vec::new();
        for portal in &geometry.portals {
            let opening = &scene.openings[portal.opening];
            let (name, depth_m) = (&opening.name, scene.gap_depth_m(opening));
            let skip = Skip { plane: None, group: Some(portal.group) };
            let slit = portal.y_m[0].is_infinite() && portal.y_m[1].is_infinite();
            if slit
                && let Some(other) = gaps.iter_mut().find(|g| g.skip == skip)
                && let Shape::Slits(tables) = &mut other.shape
            {
                let all: Vec<[f64; 2]> = tables.mask().openings().iter().copied().chain([portal.x_m]).collect();
                **tables = SlitTables::new(Mask::new(&all), tables.thickness_m(), &spectra);
                other.name = format!("{} + {name}", other.name);
                continue;
            }
            if let Some(other) = gaps.iter_mut().find(|g| g.skip == skip)
                && let Shape::Rectangles(rectangles) = &mut other.shape
                && rectangles.join(portal)
            {
                other.name = format!("{} + {name}", other.name);
                continue;
            }
            let shape = if slit {
                Shape::Slits(Box::new(SlitTables::new(Mask::new(&[portal.x_m]), depth_m, &spectra)))
            } else {
                Shape::Rectangles(Box::new(Rectangles::new(scene, portal, depth_m)))
            };
            let alone = geometry.surfaces.iter().all(|s| s.group == portal.group)
                && geometry.portals.iter().all(|p| p.group == portal.group);
            gaps.push(Self { name: name.clone(), frame: portal.frame, shape, skip, alone, solved: Solved::default() });
        }
        for gap in &mut gaps {
            if let Shape::Rectangles(rectangles) = &mut gap.shape {
                rectangles.stand_on(scene, geometry, &gap.frame);
            }
        }
        gaps
    }

    /// Drops what depends on the points met, so that the next pass takes as long as the first one with new points.
    pub(super) fn forget_points(&self) {
        match &self.shape {
            Shape::Slits(tables) => tables.forget_sources(),
            Shape::Rectangles(rectangles) => rectangles.forget_points(),
        }
    }

    /// What has been solved exactly so far, for all pairs.
    pub(super) fn cost(&self) -> TableCost {
        let Cost { frequencies, seconds } = match &self.shape {
            Shape::Slits(tables) => tables.cost(),
            Shape::Rectangles(rectangles) => rectangles.cost(),
        };
        TableCost { opening: self.name.clone(), frequencies, seconds }
    }

    /// All paths from the source's images to the probe's images through this gap with at most `order` reflections.
    ///
    /// Where pressures are asked for, the same as pressures to `waves`.
    pub(super) fn paths<'a>(&'a self, pair: &Pair<'a>, waves: &mut Vec<Wave<'a>>) -> Vec<EarlyPath> {
        let view = |across, along_m, depth_m, turned| {
            let Frame { origin_m, x, y, normal } = self.frame;
            let frame = if turned { Frame { origin_m, x: y, y: x, normal } } else { self.frame };
            View { frame, across, along_m, depth_m, skip: self.skip, turned, solved: &self.solved }
        };
        let first = waves.len();
        let label = |s: usize, p: usize| self.label(pair.geometry, pair.source, s, pair.probe, p);
        let rigid = matches!(pair.scene.simulation.transport, Transport::Wbsdf | Transport::Exact);
        let mut begun = Vec::new();
        let mut paths;
        match &self.shape {
            Shape::Slits(tables) => {
                paths = self.slit_paths(pair, tables, waves);
                if rigid {
                    let views = [view(tables.mask(), [f64::NEG_INFINITY, f64::INFINITY], tables.thickness_m(), false)];
                    replace(&views, pair, &mut paths, (waves, first), &mut begun, None, &label);
                }
            }
            Shape::Rectangles(rectangles) => {
                paths = rectangles.paths(self, pair, waves);
                if rigid && *pair.kind == SourceKind::Point {
                    let (x, y) = rectangles.masks();
                    let views =
                        [view(x, span(y), rectangles.depth_m(), false), view(y, span(x), rectangles.depth_m(), true)];
                    for view in views {
                        let turned = view.turned;
                        let whole = |band: usize, ends: [DVec3; 2]| {
                            let [from, to] = ends.map(|e| if turned { DVec3::new(e.y, e.x, e.z) } else { e });
                            rectangles.whole(pair, band, from, to)
                        };
                        replace(&[view], pair, &mut paths, (waves, first), &mut begun, Some(&whole), &label);
                    }
                }
            }
        }
        waves.append(&mut begun);
        paths.into_iter().map(|(_, path)| path).collect()
    }

    fn slit_paths<'a>(&self, pair: &Pair<'a>, tables: &'a SlitTables, waves: &mut Vec<Wave<'a>>) -> Keyed {
        let &Pair { scene, geometry, spectra, kind, source, probe, order, .. } = pair;
        let (mask, depth_m) = (tables.mask(), tables.thickness_m());
        let mut paths = Vec::new();
        for (s, from) in source.images.iter().enumerate() {
            for (p, to) in
                probe.images.iter().enumerate().filter(|(_, to)| from.planes.len() + to.planes.len() <= order)
            {
                let Origin::At(receiver) = to.origin else { continue };
                let receiver = self.frame.local(receiver);
                let Some((incident, before)) = self.incident(&from.origin, kind, receiver) else { continue };
                if before * receiver.z >= 0.0 {
                    continue;
                }
                let crossing = Crossing { incident, x_m: receiver.x, z_m: receiver.z.abs() };
                let Some((share, loss)) = self.slit_sight(pair, (s, p), &crossing, mask) else {
                    continue;
                };
                let ahead_m = self.ahead_m(&from.origin, receiver.y);
                let length = ahead_m + shortest(&crossing, mask);
                let rays = scene.adds_pressures().then(|| OpeningRays::new(mask.openings(), &crossing));
                let lit = (slit::sin_beta(mask, &crossing) == 1.0).then(|| tables.source(&crossing));
                let mut intensity = Vec::with_capacity(spectra.len());
                let mut error = Vec::with_capacity(spectra.len());
                let mut factors = Vec::with_capacity(spectra.len());
                for (band, spectrum) in spectra.iter().enumerate() {
                    let solved = || lit.as_deref().map(|lit| tables.band(band, lit, &incident));
                    let tolerance = scene.simulation.ray_tolerance;
                    let sum = match scene.simulation.transport {
                        Transport::Paraxial => slit::paraxial_intensity(mask, &crossing, spectrum, tolerance),
                        Transport::Exact => referee::exact_intensity(mask, depth_m, &crossing, spectrum),
                        Transport::Utd => rays.as_ref().map_or_else(RaySum::default, |r| utd_mean(r, spectrum)),
                        _ => slit::intensity(mask, depth_m, &crossing, spectrum, solved, tolerance),
                    };
                    let air = (-scene.air.attenuation_per_m[band] * length).exp();
                    let factor = share * loss[band] * air;
                    factors.push(factor);
                    intensity.push(sum.value.max(0.0) * factor);
                    error.push((sum.error + (-sum.value).max(0.0)) * factor);
                }
                waves.extend(rays.map(|rays| as_pressure(rays, (&intensity, &factors), pair, (length, ahead_m))));
                let path = EarlyPath {
                    course: Vec::new(),
                    label: self.label(geometry, source, s, probe, p),
                    reflections: from.planes.len() + to.planes.len(),
                    from: probe.heard_from(geometry, p, self.midpoint(&crossing, mask, receiver.y)),
                    delay_s: length / scene.air.speed_of_sound_m_s,
                    intensity,
                    error,
                };
                paths.push(((s, p), path));
            }
        }
        paths
    }

    /// Way in m of a plane wave to the middle of the frame, at the receiver's place along the edges, from where on rays count it; 0 of
    /// other sources.
    fn ahead_m(&self, origin: &Origin, receiver_y_m: f64) -> f64 {
        match origin {
            Origin::Along { .. } => origin.length_m(self.frame.point(0.0, receiver_y_m)),
            Origin::At(_) => 0.0,
        }
    }

    /// The incident wave in the gap's frame and the side it comes from (sign of z).
    fn incident(&self, origin: &Origin, kind: &SourceKind, receiver: DVec3) -> Option<(Incident, f64)> {
        match *origin {
            Origin::At(position) => {
                let s = self.frame.local(position);
                let z_m = s.z.abs();
                Some(match kind {
                    SourceKind::Line(_) => (Incident::Line { x_m: s.x, z_m }, s.z),
                    _ => (Incident::Point { x_m: s.x, z_m, dy_m: receiver.y - s.y }, s.z),
                })
            }
            Origin::Along { direction, .. } => {
                let d = self.frame.turn(direction);
                (d.z != 0.0).then_some((Incident::Plane { s_x: d.x, s_y: d.y }, -d.z))
            }
        }
    }

    /// Share of the places in the gap that see both ends, and the loss of both chains, one factor a band.
    fn slit_sight(
        &self,
        pair: &Pair<'_>,
        (s, p): (usize, usize),
        crossing: &Crossing,
        mask: &Mask,
    ) -> Option<(f64, Vec<f64>)> {
        let &Pair { scene, geometry, source, probe, .. } = pair;
        let Origin::At(receiver) = probe.images[p].origin else { return None };
        let receiver = self.frame.local(receiver);
        let (mut seen, mut tried) = (0, 0);
        let mut loss = None;
        let straight = crossing.straight_x_m();
        let reach = crossing.length_m(straight).abs().max(crossing.z_m);
        // With nothing in the way all places are like the first.
        let free = self.alone && source.images[s].planes.is_empty() && probe.images[p].planes.is_empty();
        let (openings, places) = if free { (1, 1) } else { (mask.openings().len(), SIGHT_PLACES.len()) };
        for opening in &mask.openings()[..openings] {
            let low = if opening[0].is_finite() { opening[0] } else { straight.min(opening[1]) - reach };
            let high = if opening[1].is_finite() { opening[1] } else { straight.max(opening[0]) + reach };
            for share in &SIGHT_PLACES[..places] {
                let x = low + share * (high - low);
                let y = along_m(crossing, x, receiver.y);
                let at = self.frame.point(x, y);
                tried += 1;
                let (Some(a), Some(b)) =
                    (source.arrive(scene, geometry, s, at, self.skip), probe.arrive(scene, geometry, p, at, self.skip))
                else {
                    continue;
                };
                seen += 1;
                loss = loss.or_else(|| Some(a.factors.iter().zip(&b.factors).map(|(a, b)| a * b).collect()));
            }
        }
        loss.map(|loss| (f64::from(seen) / f64::from(tried), loss))
    }

    /// Where the shortest way crosses the gap, in m.
    fn midpoint(&self, crossing: &Crossing, mask: &Mask, receiver_y_m: f64) -> DVec3 {
        let straight = crossing.straight_x_m();
        let nearest = mask.openings().iter().map(|o| straight.clamp(o[0], o[1]));
        let x = nearest.min_by(|a, b| (a - straight).abs().total_cmp(&(b - straight).abs())).unwrap_or(straight);
        self.frame.point(x, along_m(crossing, x, receiver_y_m))
    }

    pub(super) fn label(
        &self,
        geometry: &Geometry,
        source: &ImageTree,
        s: usize,
        probe: &ImageTree,
        p: usize,
    ) -> String {
        let name = |plane: &usize| super::plane_name(geometry, *plane);
        let before = source.images[s].planes.iter().map(name);
        let after = probe.images[p].planes.iter().rev().map(name);
        let parts: Vec<String> = before.chain([self.name.clone()]).chain(after).collect();
        parts.join(", ")
    }
}

/// Where the ray over `x` crosses the plane along the edges, in m: it keeps its direction cosine along y, which therefore divides
/// like the distances across.
fn along_m(crossing: &Crossing, x: f64, receiver_y_m: f64) -> f64 {
    match crossing.incident {
        Incident::Point { x_m, z_m, dy_m } => {
            let (into, out) = ((x - x_m).hypot(z_m), (crossing.x_m - x).hypot(crossing.z_m));
            receiver_y_m - dy_m * out / (into + out)
        }
        Incident::Plane { s_y, .. } => {
            receiver_y_m - s_y * (crossing.x_m - x).hypot(crossing.z_m) / crossing.sin_beta()
        }
        Incident::Line { .. } => receiver_y_m,
    }
}

/// The sound through openings as a pressure over `length_m`, of which rays leave out the first `ahead_m`: the phase is that of the
/// uniform theory of diffraction, the band means of |p|^2 are `intensity`.
fn as_pressure<'a>(
    rays: OpeningRays,
    (intensity, factors): (&[f64], &[f64]),
    pair: &Pair<'_>,
    (length_m, ahead_m): (f64, f64),
) -> Wave<'a> {
    let scale = |(spectrum, intensity): (&Spectrum, &f64)| {
        (intensity / utd_mean(&rays, spectrum).value.max(f64::MIN_POSITIVE)).sqrt()
    };
    let amplitudes: Vec<f64> = match pair.scene.simulation.transport {
        Transport::Utd => factors.iter().map(|factor| factor.sqrt()).collect(),
        _ => pair.spectra.iter().zip(intensity).map(scale).collect(),
    };
    // Rays of a line source lack the phase of H0.
    let turn = if let SourceKind::Line(_) = pair.kind { -FRAC_PI_4 } else { 0.0 };
    Wave {
        length_m,
        wander_m: rays.detour_m(),
        sound: Sound::at(move |band, k| rays.pressure(k) * Complex64::from_polar(amplitudes[band], k * ahead_m + turn)),
    }
}

/// Band mean of the intensity by the coherent second opinion.
fn utd_mean(rays: &OpeningRays, spectrum: &Spectrum) -> RaySum {
    let nodes = utd::band_nodes(spectrum, rays.detour_m());
    let value = nodes.iter().map(|(k, weight)| weight * rays.pressure(*k).norm_sqr()).sum();
    RaySum { value, error: 0.0, absolute: value, rays: nodes.len() }
}

/// Length in m of the shortest way through the mask; of a plane wave from its front through the middle of the frame at the
/// receiver's place along the edges.
fn shortest(crossing: &Crossing, mask: &Mask) -> f64 {
    let straight = crossing.straight_x_m();
    let over = mask.openings().iter().map(|o| straight.clamp(o[0], o[1]));
    let length = |x: f64| match crossing.incident {
        Incident::Point { dy_m, .. } => crossing.length_m(x).hypot(dy_m),
        Incident::Plane { .. } => crossing.length_m(x) * crossing.sin_beta(),
        Incident::Line { .. } => crossing.length_m(x),
    };
    over.map(length).fold(f64::INFINITY, f64::min)
}
