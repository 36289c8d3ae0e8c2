//! Paths through rectangular openings: sight of source and probe images at a grid of places, and the floor they stand on.
//!
//! Where a side of the opening lies in a reflecting plane at right angles to its wall there is no edge: the plane mirrors the
//! opening. The field is then that of the opening and its mirror image together, from the source and from its image, and a
//! way that would cross the image is another one's mirror image (docs/physics.md section 4).

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::Pair;
use super::gap::{Gap, SIGHT_PLACES};
use super::images::{ImageTree, Loss, Origin};
use super::joined::Keyed;
use super::wave::{FEW, Sound, Wave, frequencies};
use crate::geometry::{Element, Geometry, Portal, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Frame, Scene, Transport};
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::mask::{Jambs, Mask};
use crate::wbsdf::rectangle::{Corners, Ends, Passed, Rectangle};
use crate::wbsdf::rim::{shortest_over, span};
use crate::wbsdf::slit::gauss_nodes;
use crate::wbsdf::thick::is_thick;
use crate::wbsdf::timed::{Cost, Timed};
use crate::wbsdf::utd;
use crate::wbsdf::utd_opening::DoorRays;

/// Rectangular openings of one wall with the same limits along y.
pub(super) struct Rectangles {
    x: Mask,
    y: Mask,
    depth_m: f64,
    bands: Vec<Timed<Rectangle>>,
    mirrored: Option<Mirrored>,
    corners: Arc<Corners>,
}

/// The openings together with their images in the planes they stand on.
struct Mirrored {
    x: Mask,
    y: Mask,
    /// Pressure reflected by the planes, one factor a band.
    factors: Vec<f64>,
    bands: Vec<Timed<Rectangle>>,
}

/// How far in m a limit may lie off the plane that it stands on.
const ON_PLANE_M: f64 = 1e-6;
/// Distances before and behind the wall, in longer sides, to which the plane must reach.
const PLANE_REACHES: [f64; 2] = [0.02, 0.5];
/// Shares of the side along which it must lie in the plane.
const PLANE_PLACES: [f64; 3] = [0.1, 0.5, 0.9];

/// Up to so many ways none is guessed.
const FEW_WAYS: usize = 4;
/// k times the narrower side of an opening from which the rule for screens tells weak ways: a narrow one radiates everywhere.
const SCREENS_KA: f64 = 6.0;

/// A source or probe image with what it sees of the openings.
struct Sight {
    image: usize,
    position: DVec3,
    loss: Loss,
    seen: Vec<bool>,
}

/// A way from a source image through the openings to a probe image.
struct Way<'a> {
    from: &'a Sight,
    to: &'a Sight,
    /// Place in the openings on the shortest way, and its length in m.
    over: DVec3,
    length_m: f64,
    /// The places that see both ends.
    seen: Vec<bool>,
    /// The openings with their images, and whether the way crosses the openings themselves.
    mirrored: Option<(&'a Mirrored, bool)>,
    /// What surfaces and air leave of the energy, one factor a band.
    factors: Vec<f64>,
    reflections: usize,
}

impl Way<'_> {
    /// Intensity but for a common factor: the free field, behind a jamb by Maekawa's (1968) rule for screens, or what a strip
    /// `reveal_m` wide reflects.
    fn rough(&self, reveal_m: f64, band: usize, spectrum: &Spectrum) -> f64 {
        let straight_m = (self.to.position - self.from.position).length();
        let detour_m = self.length_m - straight_m;
        let wavelength_m = spectrum.mean_wavelength_m();
        let screened = match detour_m > 1e-9 * straight_m {
            true => {
                let ways = [self.over - self.from.position, self.to.position - self.over];
                let [r1, r2] = ways.map(DVec3::length);
                let cosines = ways.map(|way| way.z.abs() / way.length());
                let [width_1, width_2] = cosines.map(|c| reveal_m * (1.0 - c * c).max(0.0).sqrt());
                let turn = std::f64::consts::PI * reveal_m / wavelength_m * (cosines[0] - cosines[1]);
                let reflected = width_1 * width_2 * (r1 + r2) / (wavelength_m * r1 * r2 * (1.0 + turn * turn));
                (1.0 / (3.0 + 40.0 * detour_m / wavelength_m)).max(reflected.min(1.0))
            }
            false => 1.0,
        };
        let alone = match self.mirrored {
            Some((m, false)) => 1.0 - m.factors[band],
            _ => 1.0,
        };
        alone * screened * self.factors[band] / (self.length_m * self.length_m)
    }
}

impl Rectangles {
    pub(super) fn new(scene: &Scene, portal: &Portal, depth_m: f64) -> Self {
        let (x, y) = (Mask::new(&[portal.x_m]), Mask::new(&[portal.y_m]));
        Self { x, y, depth_m, bands: unsolved(scene), mirrored: None, corners: Arc::default() }
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

    /// Drops what the exact rectangles know of single points.
    pub(super) fn forget_points(&self) {
        self.all_bands().filter_map(Timed::get).for_each(Rectangle::forget_points);
    }

    /// What has been solved so far.
    pub(super) fn cost(&self) -> Cost {
        let making = |made: &Timed<Rectangle>| Cost { frequencies: 0, seconds: made.seconds() };
        self.all_bands().map(making).chain(self.all_bands().filter_map(Timed::get).map(Rectangle::cost)).sum()
    }

    /// With and without images.
    fn all_bands(&self) -> impl Iterator<Item = &Timed<Rectangle>> {
        self.bands.iter().chain(self.mirrored.iter().flat_map(|m| &m.bands))
    }

    /// All paths from the source's images to the probe's images through the openings with at most `order` reflections.
    ///
    /// Where pressures are asked for, the same as pressures to `waves`.
    pub(super) fn paths<'a>(&'a self, gap: &Gap, pair: &Pair<'a>, waves: &mut Vec<Wave<'a>>) -> Keyed {
        let &Pair { scene, geometry, spectra, source, probe, order, .. } = pair;
        let places = self.places(gap, pair);
        let sources = sights(gap, scene, geometry, source, &places);
        let probes = sights(gap, scene, geometry, probe, &places);
        let mut ways = Vec::new();
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
                let length_m = (over - from.position).length() + (to.position - over).length();
                let air = scene.air.attenuation_per_m.iter().map(|m| (-m * length_m).exp());
                let factors = from.loss.factors.iter().zip(&to.loss.factors).zip(air).map(|((a, b), air)| a * b * air);
                let factors = factors.collect();
                ways.push(Way { from, to, over, length_m, seen, mirrored, factors, reflections });
            }
        }
        let mut intensities = self.intensities(pair, &ways, &places);
        let mut paths = Vec::new();
        for (way, intensity) in ways.iter().zip(&mut intensities) {
            let (from, to, length_m) = (way.from.position, way.to.position, way.length_m);
            if scene.simulation.transport == Transport::Utd {
                let Some(rays) = DoorRays::new(&self.x, &self.y, from, to) else { continue };
                let amplitudes: Vec<f64> = way.factors.iter().map(|factor| factor.sqrt()).collect();
                for ((intensity, spectrum), amplitude) in intensity.iter_mut().zip(spectra).zip(&amplitudes) {
                    let nodes = utd::band_nodes(spectrum, rays.detour_m());
                    let mean = nodes.iter().map(|(k, weight)| weight * rays.pressure(*k).norm_sqr()).sum::<f64>();
                    *intensity = mean * amplitude * amplitude;
                }
                waves.push(Wave {
                    length_m,
                    wander_m: rays.detour_m(),
                    sound: Sound::at(move |band, k| amplitudes[band] * rays.pressure(k)),
                });
            } else if scene.adds_pressures() {
                waves.push(self.as_pressure(pair, way, intensity));
            }
            // The frequency grid and the panels are converged to this; the model itself: docs/verification.md.
            let error = intensity.iter().map(|i| 1e-4 * i).collect();
            let label = gap.label(geometry, source, way.from.image, probe, way.to.image);
            let delay_s = length_m / scene.air.speed_of_sound_m_s;
            let intensity = std::mem::take(intensity);
            let key = (way.from.image, way.to.image);
            let from = probe.heard_from(geometry, way.to.image, gap.frame.point(way.over.x, way.over.y));
            paths.push((
                key,
                EarlyPath { label, reflections: way.reflections, delay_s, from, intensity, error, course: Vec::new() },
            ));
        }
        paths
    }

    /// Intensities, one list a way, one value a band.
    ///
    /// Through openings that are not narrow the weakest ways, by a rule for screens, keep what the rule says, scaled to the others:
    /// together they bring less than the pair's estimated share of the whole.
    fn intensities(&self, pair: &Pair<'_>, ways: &[Way<'_>], places: &[DVec3]) -> Vec<Vec<f64>> {
        let &Pair { scene, spectra, estimated, .. } = pair;
        if scene.simulation.transport == Transport::Utd {
            // As pressures later.
            return vec![vec![0.0; spectra.len()]; ways.len()];
        }
        let reveal_m = if is_thick(self.narrowest_m(), self.depth_m) { self.depth_m } else { 0.0 };
        let rough = |(band, spectrum)| ways.iter().map(|way| way.rough(reveal_m, band, spectrum)).collect();
        let rough: Vec<Vec<f64>> = spectra.iter().enumerate().map(rough).collect();
        let strong = |(rough, spectrum): (&Vec<f64>, &Spectrum)| {
            let all_exact = ways.len() <= FEW_WAYS || self.narrowest_m() * spectrum.high_k() < SCREENS_KA;
            if all_exact { vec![true; ways.len()] } else { strongest(rough, estimated) }
        };
        let strong: Vec<Vec<bool>> = rough.iter().zip(spectra).map(strong).collect();
        let all = covering(spectra);
        let of_way = |(n, way): (usize, &Way<'_>)| {
            let crossed = Crossed::new(self, way.from.position, way.to.position, &all);
            let mut values = vec![0.0; spectra.len()];
            // Each way starts with another band, so that their tables are made side by side.
            for band in (0..spectra.len()).map(|i| (i + n) % spectra.len()).filter(|band| strong[*band][n]) {
                values[band] = self.intensity(scene, (band, &spectra[band]), (way, &crossed), places);
            }
            values
        };
        let mut values: Vec<Vec<f64>> = ways.par_iter().enumerate().map(of_way).collect();
        self.all_bands().filter_map(Timed::get).for_each(Rectangle::forget_receivers);
        for (band, (rough, strong)) in rough.iter().zip(&strong).enumerate() {
            let heard = || (0..ways.len()).filter(|n| strong[*n]);
            let guessed = heard().map(|n| rough[n]).sum::<f64>();
            let scale = if guessed > 0.0 { heard().map(|n| values[n][band]).sum::<f64>() / guessed } else { 0.0 };
            (0..ways.len()).filter(|n| !strong[*n]).for_each(|n| values[n][band] = scale * rough[n]);
        }
        values
    }

    fn narrowest_m(&self) -> f64 {
        let openings = self.x.openings().iter().chain(self.y.openings());
        openings.map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min)
    }

    /// Intensity of a way in a band.
    fn intensity(
        &self,
        scene: &Scene,
        (band, spectrum): (usize, &Spectrum),
        (way, crossed): (&Way<'_>, &Crossed),
        places: &[DVec3],
    ) -> f64 {
        let own = || self.seen_part(self.alone(scene, band, spectrum), spectrum, (way, &crossed.alone), places);
        let value = match way.mirrored {
            None => own(),
            Some((m, first)) => {
                // A plane that absorbs mirrors the opening by the share of the pressure that it reflects.
                let f = m.factors[band];
                let both = || {
                    let whole = self.with_images(scene, m, band, spectrum);
                    let share = seen_share(&way.seen, places, way.over, self.zone_m2(spectrum, way, places));
                    share * whole.intensity_between(&crossed.with_images).max(0.0)
                };
                let alone = if f < 1.0 { (1.0 - f) * own() } else { 0.0 };
                alone + if first && f > 0.0 { f * both() } else { 0.0 }
            }
        };
        value * way.factors[band]
    }

    /// The openings without images.
    fn alone(&self, scene: &Scene, band: usize, spectrum: &Spectrum) -> &Rectangle {
        self.bands[band].get_or_make(|| self.rectangle(scene, &self.x, &self.y, spectrum))
    }

    /// The openings with their images.
    fn with_images<'a>(&self, scene: &Scene, m: &'a Mirrored, band: usize, spectrum: &Spectrum) -> &'a Rectangle {
        m.bands[band].get_or_make(|| self.rectangle(scene, &m.x, &m.y, spectrum))
    }

    fn rectangle(&self, scene: &Scene, x: &Mask, y: &Mask, spectrum: &Spectrum) -> Rectangle {
        Rectangle::new(x, y, self.depth_m, spectrum, jambs(scene)).sharing(&self.corners)
    }

    /// A way as a pressure: its course is that of the openings together with the images that they mostly have, the band means of
    /// |p|^2 are `intensity`.
    fn as_pressure<'a>(&self, pair: &Pair<'_>, way: &Way<'_>, intensity: &[f64]) -> Wave<'a> {
        let crossed = Crossed::new(self, way.from.position, way.to.position, &covering(pair.spectra));
        let mut wander_m = 0.0_f64;
        let mut pressures = Vec::new();
        for (band, (spectrum, intensity)) in pair.spectra.iter().zip(intensity).enumerate() {
            let (rectangle, ends) = self.mostly(pair.scene, way.mirrored, (band, spectrum), &crossed);
            let passed = rectangle.pressure(ends, way.length_m);
            wander_m = wander_m.max(passed.wander_m);
            let (low, high) = (spectrum.low_k(), spectrum.high_k());
            let nodes = gauss_nodes(low, high, frequencies(FEW, high - low, passed.wander_m));
            let mean: f64 = nodes.map(|(k, weight)| weight * (passed.pressure)(k).norm_sqr()).sum();
            pressures.push((passed.pressure, (intensity / mean.max(f64::MIN_POSITIVE)).sqrt()));
        }
        let pressure = move |band: usize, k: f64| pressures[band].0(k) * pressures[band].1;
        Wave { length_m: way.length_m, wander_m, sound: Sound::at(pressure) }
    }

    /// The openings with the images that they mostly have.
    fn mostly<'a>(
        &'a self,
        scene: &Scene,
        mirrored: Option<(&'a Mirrored, bool)>,
        (band, spectrum): (usize, &Spectrum),
        crossed: &'a Crossed,
    ) -> (&'a Rectangle, &'a Ends) {
        match mirrored {
            Some((m, true)) if m.factors[band] > 0.5 => {
                (self.with_images(scene, m, band, spectrum), &crossed.with_images)
            }
            _ => (self.alone(scene, band, spectrum), &crossed.alone),
        }
    }

    /// Pressures through the openings between two places in their frame, one a band; `None` if that way is another's mirror image.
    pub(super) fn passed(&self, pair: &Pair<'_>, from: DVec3, to: DVec3, length_m: f64) -> Option<Vec<Passed>> {
        let mirrored = self.mirrored.as_ref().map(|m| (m, self.first_of_images(m, from, to)));
        if mirrored.is_some_and(|(m, first)| !first && m.factors.iter().any(|f| *f > 0.5)) {
            return None;
        }
        let crossed = Crossed::new(self, from, to, &covering(pair.spectra));
        let passed = |band: (usize, &Spectrum)| {
            let (rectangle, ends) = self.mostly(pair.scene, mirrored, band, &crossed);
            rectangle.pressure(ends, length_m)
        };
        Some(pair.spectra.iter().enumerate().map(passed).collect())
    }

    /// Limits along x and along y.
    pub(super) fn masks(&self) -> (&Mask, &Mask) {
        (&self.x, &self.y)
    }

    pub(super) fn depth_m(&self) -> f64 {
        self.depth_m
    }

    /// Intensity in a band between two places in the openings' frame, as if nothing else stood in the way.
    pub(super) fn whole(&self, pair: &Pair<'_>, band: usize, from: DVec3, to: DVec3) -> f64 {
        let (scene, spectrum) = (pair.scene, &pair.spectra[band]);
        let own = || self.alone(scene, band, spectrum).intensity(from, to).max(0.0);
        let Some(mirrored) = &self.mirrored else { return own() };
        let f = mirrored.factors[band];
        let alone = if f < 1.0 { (1.0 - f) * own() } else { 0.0 };
        if f == 0.0 || !self.first_of_images(mirrored, from, to) {
            return alone;
        }
        let both = self.with_images(scene, mirrored, band, spectrum);
        alone + f * both.intensity(from, to).max(0.0)
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
        (way, ends): (&Way<'_>, &Ends),
        places: &[DVec3],
    ) -> f64 {
        let dark = |part: &[bool]| part.iter().all(|s| !s);
        if way.seen.chunks(25).any(dark) {
            // Openings that are hidden take no part.
            let lit = way.seen.chunks(25).zip(places.chunks(25)).enumerate().filter(|(_, (seen, _))| !dark(seen));
            return lit
                .map(|(i, (seen, places))| {
                    let zone = self.zone_m2(spectrum, way, places);
                    let value = rectangle.part(i).intensity_between(ends.part(i)).max(0.0);
                    value * seen_share(seen, places, way.over, zone)
                })
                .sum();
        }
        let share = seen_share(&way.seen, places, way.over, self.zone_m2(spectrum, way, places));
        rectangle.intensity_between(ends).max(0.0) * share
    }

    /// Area in m^2 about the shortest way that counts: the first Fresnel zone, or a cell between the places.
    fn zone_m2(&self, spectrum: &Spectrum, way: &Way<'_>, places: &[DVec3]) -> f64 {
        let cell = (places[1].x - places[0].x) * (places[5].y - places[0].y);
        let (r1, r2) = ((way.over - way.from.position).length(), (way.to.position - way.over).length());
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

/// Source and receiver of a way, for all bands: what the edges of the openings send, and those of the openings with their images.
struct Crossed {
    alone: Ends,
    with_images: Ends,
}

impl Crossed {
    fn new(openings: &Rectangles, from: DVec3, to: DVec3, all: &Spectrum) -> Self {
        let (x, y) = openings.mirrored.as_ref().map_or((&openings.x, &openings.y), |m| (&m.x, &m.y));
        let ends = |x, y| Ends::new(x, y, [from, to], all);
        Self { alone: ends(&openings.x, &openings.y), with_images: ends(x, y) }
    }
}

/// Of the ways with these `rough` intensities the strongest, but for the weakest that bring less than the share `weak` of the whole.
fn strongest(rough: &[f64], weak: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..rough.len()).collect();
    order.sort_by(|a, b| rough[*b].total_cmp(&rough[*a]));
    let mut left: f64 = rough.iter().sum();
    let (weak, mut strong) = (weak * left, vec![false; rough.len()]);
    for (rank, way) in order.into_iter().enumerate() {
        strong[way] = rank == 0 || left > weak;
        left -= rough[way];
    }
    strong
}

/// From the lowest band's lower edge to the highest one's upper edge.
fn covering(spectra: &[Spectrum]) -> Spectrum {
    let low_hz = spectra.iter().map(|s| s.low_hz).fold(f64::INFINITY, f64::min);
    let high_hz = spectra.iter().map(|s| s.high_hz).fold(0.0, f64::max);
    Spectrum { low_hz, high_hz, ..spectra[0] }
}

fn jambs(scene: &Scene) -> Jambs {
    if scene.simulation.transport == Transport::Paraxial { Jambs::Paraxial } else { Jambs::Rigid }
}

fn unsolved(scene: &Scene) -> Vec<Timed<Rectangle>> {
    scene.bands.iter().map(|_| Timed::default()).collect()
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
