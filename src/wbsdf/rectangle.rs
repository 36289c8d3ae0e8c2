//! A rectangular opening between two points: exact (hatch.rs) where its longer side is a few wavelengths, beyond that the
//! pressures of its edges (rim.rs).
//!
//! Edges that end know nothing of the corner between them. In the shadow of a corner, where the way over it is the
//! shortest, it alone is heard and a corner has no length of its own: what the edges miss is what they miss of a smaller opening with
//! the same corner, small enough to be solved exactly. There the edges' intensity is multiplied by the ratio of the exact solution to
//! the edges of that smaller opening.
//!
//! Through a thick wall the corner's opening is as deep as the wall, and what depth changes across either side stands in wide_side.rs.

use std::cell::OnceCell;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::DVec3;
use num_complex::Complex64;

use super::crossing::Spectrum;
use super::depths::Depths;
use super::hatch::{Driven, View, unknowns};
use super::mask::{Jambs, Mask};
use super::product::paraxial_intensity;
use super::rim::{Field, NARROW_SIDE_KA, Rim, facing, narrowest_m, only, shortest_over, span};
use super::slit::{MOST_FREQUENCIES, fade, gauss_nodes, resonant};
use super::thick::{deep_share, depths};
use super::timed::{Cost, Timed};

/// k times width of both sides up to which traced rays meet a small hole.
const SMALL_HOLE_KA: f64 = 3.0;
/// Unknowns of the exact rectangle between which the edges take over from it: k times the side 16 to 25 for squares, more
/// for slender openings.
const EXACT_UNKNOWNS: [f64; 2] = [220.0, 360.0];
/// k times width below which a side of an opening scatters traced rays by the exact aperture: its far field is smooth enough for a
/// small table.
pub(super) const NARROW_KA: f64 = 5.0;
/// Unknowns up to which the transmission of a diffuse field is solved: a few milliseconds a band.
const TABLE_UNKNOWNS: f64 = 120.0;
/// Unknowns of the smaller opening that stands for a corner: k times the side 17.
const CORNER_UNKNOWNS: f64 = 210.0;
/// Wave numbers of one that is deep and square, evenly spaced: more change levels by less than the form is wrong.
const SQUARE_WAVE_NUMBERS: usize = 16;
/// Wave numbers of one that is as narrow as the opening itself over k times its depth, and the most: across these sound resonates, and
/// the level varies with the width.
const SLENDER_WAVE_NUMBERS: f64 = 4.1;
const MOST_WAVE_NUMBERS: f64 = 48.0;
/// k times the narrower side between which a square one takes over from it.
const CORNER_NARROW: [f64; 2] = [14.5, 16.9];
/// Distances of the farther of source and receiver from the opening, in longer sides, between which the exact rectangle
/// takes over from the edges: its functions do not resolve the field between two points that are nearer.
const EXACT_FROM: [f64; 2] = [0.08, 0.16];

/// Radians by which the way over a corner is longer than those over either of its edges (without ends), between which
/// the corner is heard alone.
const CORNER_ALONE: [f64; 2] = [0.0, 1.0];

/// How a rectangular opening is modelled in a band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sides {
    /// Its four edges.
    WideBoth,
    /// Its edges, with the exact aperture across x.
    NarrowX,
    /// Its edges, with the exact aperture across y.
    NarrowY,
    /// The exact rectangle.
    Exact,
    /// The exact rectangle, for traced rays a hole that radiates evenly.
    SmallHole,
}

impl Sides {
    /// The model for an opening of `width_m` by `height_m`.
    pub fn of(width_m: f64, height_m: f64, spectrum: &Spectrum) -> Self {
        let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
        let (x, y) = (k * width_m, k * height_m);
        match x.max(y) {
            ka if ka < SMALL_HOLE_KA => Self::SmallHole,
            _ if unknowns(x, y) < EXACT_UNKNOWNS[1] => Self::Exact,
            _ => match (x < NARROW_SIDE_KA[0], y < NARROW_SIDE_KA[0]) {
                (true, _) => Self::NarrowX,
                (false, true) => Self::NarrowY,
                (false, false) => Self::WideBoth,
            },
        }
    }
}

/// Openings `x` by `y` of a rigid screen in one band: what is the same for all sources and receivers.
pub struct Rectangle {
    x: Mask,
    y: Mask,
    thickness_m: f64,
    spectrum: Spectrum,
    jambs: Jambs,
    exact: Option<Depths>,
    /// What sources do in the exact rectangle, and how it sees receivers, by the bits of their coordinates.
    sources: Known<Vec<Driven>>,
    receivers: Known<Vec<View>>,
    rim: Timed<Rim>,
    /// Openings of the same corners that are small enough to be solved exactly.
    corners: Timed<Vec<Small>>,
    shared: Arc<Corners>,
    /// The openings one by one where there are several.
    parts: Vec<Self>,
}

/// An opening about the origin that is solved exactly, and its edges. All lengths are multiplied by the wave number in the middle of
/// the band.
struct Corner {
    sides: [f64; 2],
    depth: f64,
    /// Share of the depth.
    deep: f64,
    spectrum: Spectrum,
    exact: Depths,
    x: Mask,
    y: Mask,
    rim: Rim,
}

/// The small openings that stand for corners. Those of openings wider than themselves are the same at all wave numbers.
#[derive(Default)]
pub struct Corners(Mutex<Vec<Arc<Corner>>>);

impl Corners {
    /// `deep`: the share of the depth.
    fn of(&self, sides: [f64; 2], (deep, thickness): (f64, f64), spectrum: &Spectrum) -> Arc<Corner> {
        let depth = if deep > 0.0 { thickness } else { 0.0 };
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b;
        let is_this = |c: &&Arc<Corner>| {
            same(c.sides[0], sides[0])
                && same(c.sides[1], sides[1])
                && same(c.depth, depth)
                && same(c.deep, deep)
                && same(c.spectrum.low_k(), spectrum.low_k())
                && same(c.spectrum.high_k(), spectrum.high_k())
        };
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = all.iter().find(is_this) {
            return Arc::clone(known);
        }
        let limits = sides.map(|side| [-0.5 * side, 0.5 * side]);
        let tone = spectrum.high_k() <= spectrum.low_k();
        let square = (sides[0] - sides[1]).abs() <= 1e-6 * sides[0];
        let count = match (tone, square) {
            (true, _) => 1,
            (_, true) => SQUARE_WAVE_NUMBERS,
            _ => (SLENDER_WAVE_NUMBERS * depth).clamp(SQUARE_WAVE_NUMBERS as f64, MOST_WAVE_NUMBERS).round() as usize,
        };
        let depths = [(deep, depth, Some(count)), (1.0 - deep, 0.0, None)];
        let depths: Vec<_> = depths.into_iter().filter(|(share, ..)| *share > 0.0).collect();
        let exact = Depths::new(limits[0], limits[1], &depths, spectrum);
        let [x, y] = limits.map(|limits| Mask::new(&[limits]));
        let rim = Rim::new(&x, &y, (deep, depth), spectrum);
        let new = Arc::new(Corner { sides, depth, deep, spectrum: *spectrum, exact, x, y, rim });
        all.push(Arc::clone(&new));
        new
    }
}

/// One that stands for the corners of an opening, with its share, and what it knows of points about it.
struct Small {
    share: f64,
    corner: Arc<Corner>,
    sources: Known<Vec<Driven>>,
    receivers: Known<Vec<View>>,
}

impl Small {
    /// What the corner changes of the intensity that its edges send between these points, in its frame.
    fn change(&self, [source, receiver]: [DVec3; 2]) -> f64 {
        let Corner { x, y, rim, exact, spectrum, .. } = &*self.corner;
        let edges = rim.intensity(&Field::new(x, y, [source, receiver], spectrum));
        let driven = self.sources.of(source, || exact.driven(source));
        let seen = self.receivers.of(receiver, || exact.view(receiver));
        if edges > 0.0 { exact.intensity(&driven, &seen) / edges } else { 1.0 }
    }
}

/// What is known of points, by the bits of their coordinates.
struct Known<T>(Mutex<HashMap<[u64; 3], Arc<T>>>);

impl<T> Default for Known<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> Known<T> {
    fn of(&self, point: DVec3, new: impl FnOnce() -> T) -> Arc<T> {
        let key = point.to_array().map(f64::to_bits);
        if let Some(known) = self.all().get(&key) {
            return Arc::clone(known);
        }
        let new = Arc::new(new());
        let mut all = self.all();
        if all.len() < MOST_KNOWN {
            all.insert(key, Arc::clone(&new));
        }
        new
    }

    /// A lock is poisoned by a panic only, and what it guards is whole even then.
    fn all(&self) -> MutexGuard<'_, HashMap<[u64; 3], Arc<T>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Most points that are kept: up to 100 kB each.
const MOST_KNOWN: usize = 500;

impl Rectangle {
    /// Prepares the openings `x` by `y` (limits along their sides in m, any of them infinite) through a wall of `thickness_m`
    /// for the band.
    pub fn new(x: &Mask, y: &Mask, thickness_m: f64, spectrum: &Spectrum, jambs: Jambs) -> Self {
        let exact = only(x).zip(only(y)).and_then(|(x_m, y_m)| {
            let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
            let few = matches!(Sides::of(width, height, spectrum), Sides::Exact | Sides::SmallHole);
            (few && jambs == Jambs::Rigid).then(|| {
                let depths = depths(width.min(height), thickness_m);
                let all: Vec<_> = depths.into_iter().map(|(share, depth_m)| (share, depth_m, None)).collect();
                Depths::new(x_m, y_m, &all, spectrum)
            })
        });
        let several = x.openings().len() > 1;
        let part = |o: &[f64; 2]| Self::new(&Mask::new(&[*o]), y, thickness_m, spectrum, jambs);
        let parts = if several { x.openings().iter().map(part).collect() } else { Vec::new() };
        Self {
            x: x.clone(),
            y: y.clone(),
            thickness_m,
            spectrum: *spectrum,
            jambs,
            exact,
            sources: Known::default(),
            receivers: Known::default(),
            rim: Timed::default(),
            corners: Timed::default(),
            shared: Arc::default(),
            parts,
        }
    }

    /// The same with the corners' small openings taken from, and left for, `corners`.
    pub fn sharing(self, corners: &Arc<Corners>) -> Self {
        let parts = self.parts.into_iter().map(|part| part.sharing(corners)).collect();
        Self { shared: Arc::clone(corners), parts, ..self }
    }

    /// Intensity at `receiver` of a point source at `source` through the opening, relative to the free field at 1 m, band
    /// mean. Both in the opening's frame (x and y along its sides, z the normal, in m), on opposite sides of z = 0.
    /// Swapping them changes nothing.
    pub fn intensity(&self, source: DVec3, receiver: DVec3) -> f64 {
        self.intensity_between(&Ends::new(&self.x, &self.y, [source, receiver], &self.spectrum))
    }

    /// The same between the points of `ends`, which several bands may share.
    ///
    /// Several openings: what they pass one by one, times what their edges say
    /// that they pass together.
    pub fn intensity_between(&self, ends: &Ends) -> f64 {
        let [source, receiver] = ends.points;
        if self.jambs == Jambs::Paraxial {
            return paraxial_intensity(&self.x, &self.y, source, receiver, &self.spectrum);
        }
        if !self.parts.is_empty() {
            let sum =
                |f: &dyn Fn(&Self, &Ends) -> f64| self.parts.iter().zip(&ends.parts).map(|(p, e)| f(p, e)).sum::<f64>();
            let apart = sum(&|part, ends| part.edges().intensity_of_edges(ends.field()));
            let together = self.edges().intensity_of_edges(ends.field());
            return if apart > 0.0 { together * sum(&Self::intensity_between) / apart } else { 0.0 };
        }
        let share = self.exact_share(source, receiver);
        let exact = if share > 0.0 { self.exactly(source, receiver) } else { 0.0 };
        if share == 1.0 {
            return exact;
        }
        let edges = self.edges().intensity(ends.field()) * self.corner(source, receiver);
        share * exact + (1.0 - share) * edges
    }

    /// The pressure at the receiver relative to the modulus of the free field at 1 m at any wave number of the band, with the phase
    /// of the whole way, which is `length_m` at least.
    pub fn pressure(&self, ends: &Ends, length_m: f64) -> Passed {
        let [source, receiver] = ends.points;
        let way = move |k: f64| Complex64::from_polar(1.0, k * length_m);
        if self.jambs == Jambs::Paraxial {
            return Passed { wander_m: 0.0, pressure: Box::new(way) };
        }
        let share = self.exact_share(source, receiver);
        let rim = (share < 1.0).then(|| self.edges().pressure(ends.field()));
        // Half a diagonal more than the shortest way is the middle of the others.
        let middle_m = length_m + 0.5 * diagonal_m(&self.x, &self.y);
        let exact = self
            .exact
            .as_ref()
            .filter(|_| share > 0.0)
            .map(|exact| exact.envelope(&self.drive(exact, source), &self.see(exact, receiver), middle_m));
        let exact_m = exact.as_ref().map_or(0.0, |_| diagonal_m(&self.x, &self.y));
        let wander_m = rim.as_ref().map_or(0.0, |(_, wander_m)| *wander_m).max(exact_m);
        let pressure = move |k: f64| {
            let exact = exact.as_ref().map_or(Complex64::ZERO, |e| e(k) * Complex64::from_polar(share, k * middle_m));
            exact + rim.as_ref().map_or(Complex64::ZERO, |(rim, _)| rim(k) * (1.0 - share))
        };
        Passed { wander_m, pressure: Box::new(pressure) }
    }

    /// By the exact rectangle, 0 where it is not solved.
    fn exactly(&self, source: DVec3, receiver: DVec3) -> f64 {
        let Some(exact) = &self.exact else { return 0.0 };
        exact.intensity(&self.drive(exact, source), &self.see(exact, receiver))
    }

    /// What a corner changes of the intensity that its edges send.
    fn corner(&self, source: DVec3, receiver: DVec3) -> f64 {
        let (Some(x_m), Some(y_m)) = (only(&self.x), only(&self.y)) else { return 1.0 };
        let k = 0.5 * (self.spectrum.low_k() + self.spectrum.high_k());
        let sides = [x_m[1] - x_m[0], y_m[1] - y_m[0]];
        let Some((corner, detour_m)) = self.in_shadow_of(source, receiver) else { return 1.0 };
        let alone = 1.0 - fade(k * detour_m, CORNER_ALONE);
        if alone == 0.0 {
            return 1.0;
        }
        let smalls = self.corners.get_or_make(|| self.smalls(sides, k));
        let change = |small: &Small| {
            let half = small.corner.sides.map(|side| 0.5 * side / k);
            let inward = |at: f64, limits: [f64; 2], half: f64| if at == limits[0] { at + half } else { at - half };
            let middle = DVec3::new(inward(corner.x, x_m, half[0]), inward(corner.y, y_m, half[1]), 0.0);
            small.share * small.change([source, receiver].map(|point| k * (point - middle)))
        };
        alone * smalls.iter().map(change).sum::<f64>() + 1.0 - alone
    }

    /// The openings that stand for its corners: as narrow as it is itself, and through thick walls a square one where it is about as
    /// wide.
    fn smalls(&self, sides: [f64; 2], k: f64) -> Vec<Small> {
        let Spectrum { low_hz, high_hz, speed_m_s } = self.spectrum;
        let spectrum = Spectrum { low_hz, high_hz, speed_m_s: k * speed_m_s };
        let small = |share: f64, sides: [f64; 2]| Small {
            share,
            corner: self.shared.of(sides.map(|side| k * side), (self.deep(), k * self.thickness_m), &spectrum),
            sources: Known::default(),
            receivers: Known::default(),
        };
        let own = solvable(sides, k, CORNER_UNKNOWNS);
        let narrow = fade(k * own[0].min(own[1]), CORNER_NARROW);
        if self.deep() == 0.0 || narrow == 1.0 {
            return vec![small(1.0, own)];
        }
        let longer = sides[0].max(sides[1]);
        let square = small(1.0 - narrow, solvable([longer; 2], k, CORNER_UNKNOWNS));
        if narrow > 0.0 { vec![small(narrow, own), square] } else { vec![square] }
    }

    /// The corner over which the shortest way leads, and by how much in m it is longer than over the edges without ends.
    fn in_shadow_of(&self, source: DVec3, receiver: DVec3) -> Option<(DVec3, f64)> {
        let (source, receiver) = facing(source, receiver);
        let over = shortest_over(source, receiver, &self.x, &self.y)?;
        let at_limit = |x: f64, mask: &Mask| span(mask).contains(&x);
        if !at_limit(over.x, &self.x) || !at_limit(over.y, &self.y) {
            return None;
        }
        let way = (over - source).length() + (receiver - over).length();
        let (into, out) = (over - source, receiver - over);
        let over_x = (into.x.hypot(into.z) + out.x.hypot(out.z)).hypot(receiver.y - source.y);
        let over_y = (into.y.hypot(into.z) + out.y.hypot(out.z)).hypot(receiver.x - source.x);
        Some((over, (way - over_x).min(way - over_y)))
    }

    /// The opening number `i` alone, all of them if there is no such one.
    pub fn part(&self, i: usize) -> &Self {
        self.parts.get(i).unwrap_or(self)
    }

    fn edges(&self) -> &Rim {
        self.rim.get_or_make(|| Rim::new(&self.x, &self.y, (self.deep(), self.thickness_m), &self.spectrum))
    }

    /// Share of the wall's depth in the intensity.
    fn deep(&self) -> f64 {
        deep_share(narrowest_m(&self.x).min(narrowest_m(&self.y)), self.thickness_m)
    }

    fn drive(&self, exact: &Depths, source: DVec3) -> Arc<Vec<Driven>> {
        self.sources.of(source, || exact.driven(source))
    }

    fn see(&self, exact: &Depths, receiver: DVec3) -> Arc<Vec<View>> {
        self.receivers.of(receiver, || exact.view(receiver))
    }

    /// The frequencies at which it is solved exactly, and the seconds that its edges and its corners' small openings took.
    pub fn cost(&self) -> Cost {
        let frequencies = self.exact.as_ref().map_or(0, Depths::frequencies);
        let sides = self.rim.get().map_or(0.0, Rim::seconds);
        let own = Cost { frequencies, seconds: self.rim.seconds() + sides + self.corners.seconds() };
        [own].into_iter().chain(self.parts.iter().map(Self::cost)).sum()
    }

    /// Drops what it knows of the points it has met.
    pub fn forget_points(&self) {
        self.sources.all().clear();
        self.corners.get().into_iter().flatten().for_each(|small| small.sources.all().clear());
        self.forget_receivers();
        self.parts.iter().for_each(Self::forget_points);
    }

    /// Gives the memory back that is kept for receivers met so far; those of the sources stay.
    pub fn forget_receivers(&self) {
        self.receivers.all().clear();
        self.corners.get().into_iter().flatten().for_each(|small| small.receivers.all().clear());
        self.parts.iter().for_each(Self::forget_receivers);
    }

    /// Share of the exact rectangle: it falls smoothly where the opening grows wide and where both points come near.
    fn exact_share(&self, source: DVec3, receiver: DVec3) -> f64 {
        let (Some(_), Some(x_m), Some(y_m)) = (&self.exact, only(&self.x), only(&self.y)) else { return 0.0 };
        let k = 0.5 * (self.spectrum.low_k() + self.spectrum.high_k());
        let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
        let longer = width.max(height);
        let away = |p: DVec3| {
            let beyond = |x: f64, limits: [f64; 2]| x - x.clamp(limits[0], limits[1]);
            DVec3::new(beyond(p.x, x_m), beyond(p.y, y_m), p.z).length()
        };
        let farther = away(source).max(away(receiver));
        fade(unknowns(k * width, k * height), EXACT_UNKNOWNS) * (1.0 - fade(farther / longer, EXACT_FROM))
    }
}

/// Two points in the frame of openings, on opposite sides of z = 0, and what the edges send from one to the other: for many bands,
/// found when the first of them asks for it.
pub struct Ends {
    points: [DVec3; 2],
    x: Mask,
    y: Mask,
    spectrum: Spectrum,
    field: OnceCell<Arc<Field>>,
    /// For each of several openings alone.
    parts: Vec<Self>,
}

impl Ends {
    /// `points`: source and receiver, in m; the openings `x` by `y`; `spectrum` covers all bands.
    pub fn new(x: &Mask, y: &Mask, points: [DVec3; 2], spectrum: &Spectrum) -> Self {
        let part = |o: &[f64; 2]| Self::new(&Mask::new(&[*o]), y, points, spectrum);
        let parts = if x.openings().len() > 1 { x.openings().iter().map(part).collect() } else { Vec::new() };
        Self { points, x: x.clone(), y: y.clone(), spectrum: *spectrum, field: OnceCell::new(), parts }
    }

    /// Those of the opening number `i` alone, of all of them if there is no such one.
    pub fn part(&self, i: usize) -> &Self {
        self.parts.get(i).unwrap_or(self)
    }

    fn field(&self) -> &Arc<Field> {
        self.field.get_or_init(|| Arc::new(Field::new(&self.x, &self.y, self.points, &self.spectrum)))
    }
}

/// A pressure at any wave number of a band.
pub struct Passed {
    /// By how much in m the ways differ that it is made of.
    pub wander_m: f64,
    /// The pressure at a wave number in 1/m.
    pub pressure: Box<dyn Fn(f64) -> Complex64 + Send + Sync>,
}

/// Diagonal in m of the finite sides.
fn diagonal_m(x: &Mask, y: &Mask) -> f64 {
    let side = |mask: &Mask| if let Some([low, high]) = only(mask) { high - low } else { 0.0 };
    side(x).hypot(side(y))
}

/// The sides in m, shortened to what k times them allows to be solved with `most` unknowns.
fn solvable(sides: [f64; 2], k: f64, most: f64) -> [f64; 2] {
    let (mut low, mut high) = (0.0, sides[0].max(sides[1]));
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let [x, y] = sides.map(|side| k * side.min(middle));
        if unknowns(x, y) < most { low = middle } else { high = middle }
    }
    sides.map(|side| side.min(low))
}

/// Share of the power that meets an opening, `thickness_m` deep, which it passes of a diffuse field, band mean. `None` for a slit
/// longer than what is solved at the cost of a table.
///
/// Exact up to 120 unknowns. A wider opening takes in what meets it and a strip along its edges: as wide a strip as that of one
/// shortened to what is solved (k times side 10 passes 1.153; the strip grows by a tenth to k times side 20: 0.02 dB).
pub fn diffuse_transmission(width_m: f64, height_m: f64, thickness_m: f64, spectrum: &Spectrum) -> Option<f64> {
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let sides = [width_m, height_m];
    let narrow = width_m.min(height_m);
    let solved = match unknowns(high * width_m, high * height_m) {
        count if count <= TABLE_UNKNOWNS => sides,
        _ if 0.5 * (low + high) * narrow < NARROW_KA => return None,
        _ => solvable(sides, high, TABLE_UNKNOWNS),
    };
    let passes = |(share, depth): (f64, f64)| {
        let resonances = if depth > 0.0 { resonant(&[[0.0, narrow]], depth, low, high) } else { 0.0 };
        // Of all directions together little varies over a band but the gap's resonances.
        let count = if high > low { 2 + (resonances.ceil() as usize).min(MOST_FREQUENCIES) } else { 1 };
        let nodes: Vec<(f64, f64)> = gauss_nodes(low, high, count).collect();
        share * super::hatch::diffuse_transmission(solved[0], solved[1], depth, &nodes)
    };
    let passes: f64 = depths(narrow, thickness_m).into_iter().map(passes).sum();
    let edges_over_area = |[x, y]: [f64; 2]| 1.0 / x + 1.0 / y;
    Some(1.0 + (passes - 1.0) * edges_over_area(sides) / edges_over_area(solved))
}
