//! Paths through rectangular openings: sight of source and probe images at a grid of places, and the floor they stand on.
//!
//! Where a side of the opening lies in a reflecting plane at right angles to its wall there is no edge: the plane mirrors the
//! opening. The field is then that of the opening and its mirror image together, from the source and from its image, and a
//! way that would cross the image is another one's mirror image (docs/physics.md section 4).

use std::sync::OnceLock;

use glam::DVec3;
use num_complex::Complex64;

use super::Pair;
use super::gap::{Gap, SIGHT_PLACES};
use super::images::{ImageTree, Loss, Origin};
use super::wave::Wave;
use crate::geometry::{Element, Geometry, Portal, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Frame, Scene, Transport};
use crate::wbsdf::crossing::{Crossing, Spectrum};
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::rectangle::Rectangle;
use crate::wbsdf::rim::{shortest_over, span, unfolded};
use crate::wbsdf::utd;
use crate::wbsdf::utd_opening::OpeningRays;

/// Rectangular openings of one wall with the same limits along y.
pub(super) struct Rectangles {
    x: Mask,
    y: Mask,
    depth_m: f64,
    bands: Vec<OnceLock<Rectangle>>,
    mirrored: Option<Mirrored>,
}

/// The openings together with their images in the planes they stand on.
struct Mirrored {
    x: Mask,
    y: Mask,
    /// Pressure reflected by the planes, one factor a band.
    factors: Vec<f64>,
    bands: Vec<OnceLock<Rectangle>>,
}

/// How far in m a limit may lie off the plane that it stands on.
const ON_PLANE_M: f64 = 1e-6;
/// Distances before and behind the wall, in longer sides, to which the plane must reach.
const PLANE_REACHES: [f64; 2] = [0.02, 0.5];
/// Shares of the side along which it must lie in the plane.
const PLANE_PLACES: [f64; 3] = [0.1, 0.5, 0.9];

/// A source or probe image with what it sees of the openings.
struct Sight {
    image: usize,
    position: DVec3,
    loss: Loss,
    seen: Vec<bool>,
}

impl Rectangles {
    pub(super) fn new(scene: &Scene, portal: &Portal, depth_m: f64) -> Self {
        let (x, y) = (Mask::new(&[portal.x_m]), Mask::new(&[portal.y_m]));
        Self { x, y, depth_m, bands: unsolved(scene), mirrored: None }
    }

    /// Takes in another opening of the same wall if its limits along y are the same.
    pub(super) fn join(&mut self, portal: &Portal) -> bool {
        let same = self.y.openings() == [portal.y_m];
        if same {
            let all: Vec<[f64; 2]> = self.x.openings().iter().copied().chain([portal.x_m]).collect();
            self.x = Mask::new(&all);
        }
        same
    }

    /// Finds the planes that the openings stand on.
    pub(super) fn stand_on(&mut self, scene: &Scene, geometry: &Geometry, frame: &Frame) {
        let (Some(first), Some(last), [y_m]) =
            (self.x.openings().first().copied(), self.x.openings().last().copied(), self.y.openings())
        else {
            return;
        };
        let wall = Wall { scene, geometry, frame, depth_m: self.depth_m };
        let mut factors = vec![1.0; scene.bands.len()];
        let mut reflects = |along_y: bool, limits: [f64; 2], low: bool, across: [f64; 2]| {
            let found = wall.reflection(along_y, limits, low, across);
            if let Some(found) = &found {
                factors.iter_mut().zip(found).for_each(|(f, r)| *f *= r);
            }
            found.is_some()
        };
        let low_high = |limits: [f64; 2], (low, high): (bool, bool)| match (low, high) {
            (true, true) => [f64::NEG_INFINITY, f64::INFINITY],
            (true, false) => [2.0 * limits[0] - limits[1], limits[1]],
            (false, true) => [limits[0], 2.0 * limits[1] - limits[0]],
            (false, false) => limits,
        };
        let sides_y = (reflects(true, *y_m, true, first), reflects(true, *y_m, false, first));
        let sides_x = (reflects(false, first, true, *y_m), reflects(false, last, false, *y_m));
        let several = self.x.openings().len() > 1;
        // Several openings between two side walls would have images without end: the walls are then left to themselves.
        let sides_x = if several && sides_x == (true, true) { (false, false) } else { sides_x };
        if !(sides_y.0 || sides_y.1 || sides_x.0 || sides_x.1) {
            return;
        }
        let x = match (several, sides_x) {
            (false, _) => Mask::new(&[low_high(first, sides_x)]),
            (true, (false, false)) => self.x.clone(),
            (true, (low, _)) => {
                let plane = if low { first[0] } else { last[1] };
                let image = |o: &[f64; 2]| [2.0 * plane - o[1], 2.0 * plane - o[0]];
                let all: Vec<[f64; 2]> = self.x.openings().iter().flat_map(|o| [*o, image(o)]).collect();
                Mask::new(&all)
            }
        };
        self.mirrored = Some(Mirrored { x, y: Mask::new(&[low_high(*y_m, sides_y)]), factors, bands: unsolved(scene) });
    }

    /// All paths from the source's images to the probe's images through the openings with at most `order` reflections.
    ///
    /// Where pressures are asked for, the same as pressures to `waves`.
    pub(super) fn paths<'a>(&'a self, gap: &Gap, pair: &Pair<'a>, waves: &mut Vec<Wave<'a>>) -> Vec<EarlyPath> {
        let &Pair { scene, geometry, spectra, source, probe, order, .. } = pair;
        let places = self.places(gap, pair);
        let sources = sights(gap, scene, geometry, source, &places);
        let probes = sights(gap, scene, geometry, probe, &places);
        let jambs = if scene.simulation.transport == Transport::Paraxial { Jambs::Paraxial } else { Jambs::Rigid };
        let mut paths = Vec::new();
        for from in &sources {
            for to in &probes {
                let reflections = source.images[from.image].planes.len() + probe.images[to.image].planes.len();
                if reflections > order || from.position.z * to.position.z >= 0.0 {
                    continue;
                }
                let seen: Vec<bool> = from.seen.iter().zip(&to.seen).map(|(a, b)| *a && *b).collect();
                let Some(over) = shortest_over(from.position, to.position, &self.x, &self.y) else { continue };
                if !seen.contains(&true) {
                    continue;
                }
                let mirrored = self.mirrored.as_ref().map(|m| (m, self.first_of_images(m, from.position, to.position)));
                if mirrored.is_some_and(|(m, first)| !first && m.factors.iter().all(|f| *f == 1.0)) {
                    continue;
                }
                let (r1, r2) = ((over - from.position).length(), (to.position - over).length());
                let mut intensity = Vec::with_capacity(spectra.len());
                for (band, spectrum) in spectra.iter().enumerate() {
                    let own = || {
                        let new = || Rectangle::new(&self.x, &self.y, self.depth_m, spectrum, jambs);
                        self.seen_part(
                            self.bands[band].get_or_init(new),
                            spectrum,
                            (from, to),
                            (over, r1, r2),
                            (&seen, &places),
                        )
                    };
                    let value = match mirrored {
                        // Below, as pressures.
                        _ if scene.simulation.transport == Transport::Utd => 0.0,
                        None => own(),
                        Some((m, first)) => {
                            // A plane that absorbs mirrors the opening by the share of the pressure that it reflects.
                            let f = m.factors[band];
                            let both = || {
                                let new = || Rectangle::new(&m.x, &m.y, self.depth_m, spectrum, jambs);
                                let whole = m.bands[band].get_or_init(new);
                                let share = seen_share(&seen, &places, over, self.zone_m2(spectrum, r1, r2, &places));
                                share * whole.intensity(from.position, to.position).max(0.0)
                            };
                            let alone = if f < 1.0 { (1.0 - f) * own() } else { 0.0 };
                            alone + if first && f > 0.0 { f * both() } else { 0.0 }
                        }
                    };
                    let air = (-scene.air.attenuation_per_m[band] * (r1 + r2)).exp();
                    intensity.push(value * air * from.loss.factors[band] * to.loss.factors[band]);
                }
                if scene.simulation.transport == Transport::Utd {
                    let Some(rays) = DoorRays::new(&self.x, &self.y, from.position, to.position) else { continue };
                    let air = |m: &f64| (-m * (r1 + r2)).exp();
                    let factors = from.loss.factors.iter().zip(&to.loss.factors).zip(&scene.air.attenuation_per_m);
                    let amplitudes: Vec<f64> = factors.map(|((a, b), m)| (a * b * air(m)).sqrt()).collect();
                    for ((intensity, spectrum), amplitude) in intensity.iter_mut().zip(spectra).zip(&amplitudes) {
                        let nodes = utd::band_nodes(spectrum, rays.detour_m());
                        let mean = nodes.iter().map(|(k, weight)| weight * rays.pressure(*k).norm_sqr()).sum::<f64>();
                        *intensity = mean * amplitude * amplitude;
                    }
                    waves.push(Wave {
                        length_m: r1 + r2,
                        wander_m: rays.detour_m(),
                        pressure: Box::new(move |band, k| amplitudes[band] * rays.pressure(k)),
                    });
                } else if scene.adds_pressures() {
                    // The phase is that of the shortest way.
                    let amplitudes: Vec<f64> = intensity.iter().map(|i| i.sqrt()).collect();
                    waves.push(Wave {
                        length_m: r1 + r2,
                        wander_m: 0.0,
                        pressure: Box::new(move |band, k| Complex64::from_polar(amplitudes[band], k * (r1 + r2))),
                    });
                }
                // The frequency grid and the panels are converged to this; the model itself: docs/verification.md.
                let error = intensity.iter().map(|i| 1e-4 * i).collect();
                let label = gap.label(geometry, source, from.image, probe, to.image);
                let delay_s = (r1 + r2) / scene.air.speed_of_sound_m_s;
                let seen_from = probe.heard_from(geometry, to.image, gap.frame.point(over.x, over.y));
                paths.push(EarlyPath { label, reflections, delay_s, from: seen_from, intensity, error });
            }
        }
        paths
    }

    /// Whether the way from `from` to `to` crosses the openings and not their images: of two ways that are mirror images of each
    /// other, that is one.
    fn first_of_images(&self, mirrored: &Mirrored, from: DVec3, to: DVec3) -> bool {
        let Some(over) = shortest_over(from, to, &mirrored.x, &mirrored.y) else { return false };
        let first = |over: f64, to: f64, own: &Mask, image: &Mask| {
            let ([low, high], [image_low, image_high]) = (span(own), span(image));
            // On the plane itself the way that ends on this side of it is kept.
            let above = image_low == low || over > low + 1e-9 || (over > low - 1e-9 && to >= low);
            let below = image_high == high || over < high - 1e-9 || (over < high + 1e-9 && to <= high);
            above && below
        };
        first(over.x, to.x, &self.x, &mirrored.x) && first(over.y, to.y, &self.y, &mirrored.y)
    }

    /// Intensity through the openings themselves, by the share of places that see both ends.
    fn seen_part(
        &self,
        rectangle: &Rectangle,
        spectrum: &Spectrum,
        (from, to): (&Sight, &Sight),
        (over, r1, r2): (DVec3, f64, f64),
        (seen, places): (&[bool], &[DVec3]),
    ) -> f64 {
        let (from, to) = (from.position, to.position);
        let dark = |part: &[bool]| part.iter().all(|s| !s);
        if seen.chunks(25).any(dark) {
            // Openings that are hidden take no part.
            let lit = seen.chunks(25).zip(places.chunks(25)).enumerate().filter(|(_, (seen, _))| !dark(seen));
            return lit
                .map(|(i, (seen, places))| {
                    let zone = self.zone_m2(spectrum, r1, r2, places);
                    let value = rectangle.part(i).intensity(from, to).max(0.0);
                    value * seen_share(seen, places, over, zone)
                })
                .sum();
        }
        rectangle.intensity(from, to).max(0.0) * seen_share(seen, places, over, self.zone_m2(spectrum, r1, r2, places))
    }

    /// Area in m^2 about the shortest way that counts: the first Fresnel zone, or a cell between the places.
    fn zone_m2(&self, spectrum: &Spectrum, r1: f64, r2: f64, places: &[DVec3]) -> f64 {
        let cell = (places[1].x - places[0].x) * (places[5].y - places[0].y);
        (spectrum.mean_wavelength_m() * r1 * r2 / (r1 + r2)).max(cell.abs())
    }

    /// 5 x 5 places of every opening, x fastest; of an unbounded one the part within reach of source and probe.
    fn places(&self, gap: &Gap, pair: &Pair<'_>) -> Vec<DVec3> {
        let of = |tree: &ImageTree| match tree.images.first().map(|i| i.origin) {
            Some(Origin::At(position)) => gap.frame.local(position),
            _ => DVec3::ZERO,
        };
        let (source, probe) = (of(pair.source), of(pair.probe));
        let reach = 2.0 * (source - probe).length();
        let bounded = |limits: [f64; 2], s: f64, p: f64| {
            let (low, high) = (s.min(p) - reach, s.max(p) + reach);
            let low = if limits[0].is_finite() { limits[0] } else { low.min(limits[1] - reach) };
            [low, if limits[1].is_finite() { limits[1] } else { high.max(low + reach) }]
        };
        let along = |limits: [f64; 2], share: f64| limits[0] + share * (limits[1] - limits[0]);
        let mut places = Vec::new();
        for (x, y) in self.x.openings().iter().flat_map(|x| self.y.openings().iter().map(move |y| (x, y))) {
            let (x, y) = (bounded(*x, source.x, probe.x), bounded(*y, source.y, probe.y));
            places.extend(
                SIGHT_PLACES
                    .iter()
                    .flat_map(|b| SIGHT_PLACES.iter().map(move |a| DVec3::new(along(x, *a), along(y, *b), 0.0))),
            );
        }
        places
    }
}

/// Rectangular openings by the coherent second opinion: the product of the transfers of their two directions, each with the
/// distances that the shortest way has when it is unfolded.
struct DoorRays {
    sides: [(OpeningRays, f64); 2],
    straight_m: f64,
}

impl DoorRays {
    /// `None`: no straight way leads through the plane.
    fn new(x: &Mask, y: &Mask, from: DVec3, to: DVec3) -> Option<Self> {
        let [across_x, across_y] = unfolded(x, y, from, to)?;
        let side = |mask: &Mask, crossing: &Crossing| {
            (OpeningRays::new(mask.openings(), crossing), 1.0 / crossing.free_intensity())
        };
        Some(Self { sides: [side(x, &across_x), side(y, &across_y)], straight_m: (to - from).length() })
    }

    /// Pressure relative to the free field at 1 m, with phase.
    fn pressure(&self, k: f64) -> Complex64 {
        let without =
            |(rays, length_m): &(OpeningRays, f64)| rays.pressure(k) * Complex64::from_polar(1.0, -k * length_m);
        let [x, y] = &self.sides;
        without(x) * without(y) * Complex64::from_polar(1.0, k * self.straight_m)
    }

    fn detour_m(&self) -> f64 {
        self.sides.iter().map(|(rays, _)| rays.detour_m()).sum()
    }
}

fn unsolved(scene: &Scene) -> Vec<OnceLock<Rectangle>> {
    scene.bands.iter().map(|_| OnceLock::new()).collect()
}

/// The wall of the openings with what stands round it.
struct Wall<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    frame: &'a Frame,
    depth_m: f64,
}

impl Wall<'_> {
    /// Pressure reflected, one factor a band, by a surface in which the low or high one of `limits` lies on both sides of the wall,
    /// all along `across`, the limits in the other direction: sqrt(1 - absorption), the geometric mean of both sides.
    fn reflection(&self, along_y: bool, limits: [f64; 2], low: bool, across: [f64; 2]) -> Option<Vec<f64>> {
        let limit = limits[usize::from(!low)];
        if !limit.is_finite() || !across.iter().all(|x| x.is_finite()) {
            return None;
        }
        let other = if low { limits[1] } else { limits[0] };
        let side = if other.is_finite() { (other - limit).abs() } else { across[1] - across[0] };
        let longer = side.max(across[1] - across[0]);
        let normal = if along_y { self.frame.y } else { self.frame.x };
        let (outward, start) = if low { (-normal, 1e-3 * side) } else { (normal, -1e-3 * side) };
        let mut product = vec![1.0; self.scene.bands.len()];
        let mut count = 0;
        for (sign, reach) in [-1.0, 1.0].into_iter().flat_map(|s| PLANE_REACHES.map(|r| (s, r))) {
            for share in PLANE_PLACES {
                let (l, a) = (limit + start, across[0] + share * (across[1] - across[0]));
                let on_wall = if along_y { self.frame.point(a, l) } else { self.frame.point(l, a) };
                let from = on_wall + self.frame.normal * (sign * (0.5 * self.depth_m + reach * longer));
                let hit = self.geometry.closest(from, outward, start.abs() + 2.0 * ON_PLANE_M, Skip::NONE)?;
                let Element::Surface(id) = hit.element else { return None };
                let surface = &self.geometry.surfaces[id];
                let upright = surface.frame.normal.dot(normal).abs() > 1.0 - 1e-9;
                if !upright || (hit.t - start.abs()).abs() > ON_PLANE_M {
                    return None;
                }
                let absorption = &self.scene.materials[surface.material].absorption;
                product.iter_mut().zip(absorption).for_each(|(p, a)| *p *= (1.0 - a).max(0.0));
                count += 1;
            }
        }
        Some(product.iter().map(|p| p.powf(0.5 / f64::from(count))).collect())
    }
}

/// Images that see at least one of the places.
fn sights(gap: &Gap, scene: &Scene, geometry: &Geometry, tree: &ImageTree, places: &[DVec3]) -> Vec<Sight> {
    // Centre and the middles of the quarters first: most images see nothing at all.
    const FIRST: [usize; 5] = [12, 6, 8, 16, 18];
    let see = |image: usize, place: usize| {
        tree.arrive(scene, geometry, image, gap.frame.point(places[place].x, places[place].y), gap.skip)
    };
    let mut sights = Vec::new();
    for image in 0..tree.images.len() {
        let Origin::At(position) = tree.images[image].origin else { continue };
        let mut first = (0..places.len()).step_by(25).flat_map(|start| FIRST.map(|place| start + place));
        let Some(loss) = first.find_map(|place| see(image, place)) else { continue };
        let seen = (0..places.len()).map(|place| see(image, place).is_some()).collect();
        sights.push(Sight { image, position: gap.frame.local(position), loss, seen });
    }
    sights
}

/// Share of the places that are seen, weighted by a Gaussian of area `zone_m2` about `over`.
fn seen_share(seen: &[bool], places: &[DVec3], over: DVec3, zone_m2: f64) -> f64 {
    if seen.iter().all(|s| *s) {
        return 1.0;
    }
    let (mut sum, mut total) = (0.0, 0.0);
    for (place, seen) in places.iter().zip(seen) {
        let weight = (-(*place - over).length_squared() / zone_m2).exp().max(1e-12);
        total += weight;
        sum += if *seen { weight } else { 0.0 };
    }
    sum / total
}
