//! A rectangular opening between two points: exact where its longer side is a few wavelengths, beyond the product of its two
//! directions, frequency by frequency.
//!
//! The exact form is hatch.rs. For the product the opening is, in each direction, a slit between source and receiver at the distances that the
//! shortest way through the opening has when it is unfolded, and its transfer |p/p_free|^2 is that of the slit: signed rays with eq. (5a-c) where
//! it is wide, the exact aperture where it is narrow. The transfers of a single frequency are sums of sines in f, so a
//! whole grid of frequencies costs one evaluation of the rays and a rotation a frequency; their product is then averaged over
//! the band.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::DVec3;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::hatch::{Driven, Hatch, View, transmission, unknowns};
use super::mask::Jambs;
use super::quadrature::{PHASE_PER_PANEL, panel_nodes};
use super::slit::{MOST_FREQUENCIES, fade, gauss_nodes, resonant};
use super::thick::{ThickAperture, is_thick};

/// k times width up to which a side is solved exactly.
const NARROW_SIDE_KA: f64 = 12.0;
/// k times width between which the depth of the gap along the narrower side loses its weight in the product.
const DEEP_KA: [f64; 2] = [6.0, NARROW_SIDE_KA];
/// k times width of both sides up to which traced rays meet a small hole.
const SMALL_HOLE_KA: f64 = 3.0;
/// Unknowns of the exact rectangle between which the product takes over from it: k times the side 16 to 25 for squares, more
/// for slender openings. A band costs up to 0.1 s there, and eight times that an octave further.
const EXACT_UNKNOWNS: [f64; 2] = [260.0, 420.0];
/// Distances of the farther of source and receiver from the opening, in longer sides, between which the exact rectangle
/// takes over from the product: its functions do not resolve the field between two points that are nearer.
const EXACT_FROM: [f64; 2] = [0.08, 0.16];

/// How a rectangular opening is modelled in a band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sides {
    /// Signed rays both ways.
    WideBoth,
    /// Exact aperture along x, signed rays along y.
    NarrowX,
    /// Signed rays along x, exact aperture along y.
    NarrowY,
    /// The exact rectangle.
    Exact,
    /// The exact rectangle, for traced rays a hole that radiates evenly.
    SmallHole,
    /// Signed rays of the published small-angle form both ways.
    Paraxial,
}

impl Sides {
    /// The model for an opening of `width_m` by `height_m`.
    pub fn of(width_m: f64, height_m: f64, spectrum: &Spectrum) -> Self {
        let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
        let (x, y) = (k * width_m, k * height_m);
        match x.max(y) {
            ka if ka < SMALL_HOLE_KA => Self::SmallHole,
            _ if unknowns(x, y) < EXACT_UNKNOWNS[1] => Self::Exact,
            _ => match (x < NARROW_SIDE_KA, y < NARROW_SIDE_KA) {
                (true, _) => Self::NarrowX,
                (false, true) => Self::NarrowY,
                (false, false) => Self::WideBoth,
            },
        }
    }
}

/// A rectangular opening of a rigid screen in one band: what is the same for all sources and receivers.
pub struct Rectangle {
    x_m: [f64; 2],
    y_m: [f64; 2],
    thickness_m: f64,
    spectrum: Spectrum,
    sides: Sides,
    exact: Option<Hatch>,
    /// Points that the exact rectangle has met, by the bits of their coordinates.
    met: Mutex<HashMap<[u64; 3], Arc<Met>>>,
    product: OnceLock<Product>,
}

/// A point as the exact rectangle sees it, and what it does there as a source.
struct Met {
    view: View,
    driven: OnceLock<Driven>,
}

/// Most points that are kept: some 100 kB each.
const MOST_MET: usize = 500;

impl Rectangle {
    /// Prepares the opening `x_m` by `y_m` (limits along its sides in m) through a wall of `thickness_m` for the band.
    ///
    /// In the product its depth counts across the narrower side only, where it makes a resonating gap.
    pub fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, spectrum: &Spectrum, sides: Sides) -> Self {
        let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
        let narrow = width.min(height);
        let exact = (matches!(sides, Sides::Exact | Sides::SmallHole) && narrow > 0.0).then(|| {
            let depth = if is_thick(narrow, thickness_m) { thickness_m } else { 0.0 };
            Hatch::new(x_m, y_m, depth, &wave_numbers(width, height, depth, spectrum))
        });
        Self {
            x_m,
            y_m,
            thickness_m,
            spectrum: *spectrum,
            sides,
            exact,
            met: Mutex::default(),
            product: OnceLock::new(),
        }
    }

    /// Intensity at `receiver` of a point source at `source` through the opening, relative to the free field at 1 m, band
    /// mean. Both in the opening's frame (x and y along its sides, z the normal, in m), on opposite sides of z = 0.
    /// Swapping them changes nothing.
    pub fn intensity(&self, source: DVec3, receiver: DVec3) -> f64 {
        let share = self.exact_share(source, receiver);
        let exact = match &self.exact {
            Some(hatch) if share > 0.0 => {
                let (from, to) = (self.meet(hatch, source), self.meet(hatch, receiver));
                hatch.intensity(from.driven.get_or_init(|| hatch.driven(&from.view)), &to.view)
            }
            _ => 0.0,
        };
        if share == 1.0 {
            return exact;
        }
        let product = self.product.get_or_init(|| {
            Product::new(self.x_m, self.y_m, self.thickness_m, &self.spectrum, self.sides == Sides::Paraxial)
        });
        share * exact + (1.0 - share) * product.intensity(source, receiver)
    }

    fn meet(&self, hatch: &Hatch, point: DVec3) -> Arc<Met> {
        let key = point.to_array().map(f64::to_bits);
        // A lock is poisoned by a panic only, and what it guards is whole even then.
        let met = || self.met.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(met) = met().get(&key) {
            return Arc::clone(met);
        }
        let new = Arc::new(Met { view: hatch.view(point), driven: OnceLock::new() });
        let mut met = met();
        if met.len() < MOST_MET {
            met.insert(key, Arc::clone(&new));
        }
        new
    }

    /// Share of the exact rectangle: it falls smoothly where the opening grows wide and where both points come near.
    fn exact_share(&self, source: DVec3, receiver: DVec3) -> f64 {
        if self.exact.is_none() {
            return 0.0;
        }
        let k = 0.5 * (self.spectrum.low_k() + self.spectrum.high_k());
        let (width, height) = (self.x_m[1] - self.x_m[0], self.y_m[1] - self.y_m[0]);
        let longer = width.max(height);
        let away = |p: DVec3| {
            let beyond = |x: f64, limits: [f64; 2]| x - x.clamp(limits[0], limits[1]);
            DVec3::new(beyond(p.x, self.x_m), beyond(p.y, self.y_m), p.z).length()
        };
        let farther = away(source).max(away(receiver));
        fade(unknowns(k * width, k * height), EXACT_UNKNOWNS) * (1.0 - fade(farther / longer, EXACT_FROM))
    }
}

/// Wave numbers and weights for the mean over a band through an opening of `width_m` by `height_m` and `depth_m`.
///
/// |p|^2 varies over the band like cos(k d), d at most twice the diagonal (see slit.rs). A mouth of area A sends back
/// 1 - k^2 A/pi of a wave in the gap (a piston's radiation), one that is wide across 1 - k a: so wide are the resonances.
fn wave_numbers(width_m: f64, height_m: f64, depth_m: f64, spectrum: &Spectrum) -> Vec<(f64, f64)> {
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let smooth = 0.7 * (high - low) * (width_m.hypot(height_m) + depth_m);
    let mouth = width_m.min(height_m).min(low * width_m * height_m / PI);
    let resonances = if depth_m > 0.0 { resonant(&[[0.0, mouth]], depth_m, low, high) } else { 0.0 };
    let count = if high > low { 4 + ((smooth + resonances).ceil() as usize).min(MOST_FREQUENCIES) } else { 1 };
    gauss_nodes(low, high, count).collect()
}

/// The product of the two directions.
struct Product {
    x_m: [f64; 2],
    y_m: [f64; 2],
    spectrum: Spectrum,
    jambs: Jambs,
    /// Wave numbers and weights where a side is solved exactly.
    nodes: Vec<(f64, f64)>,
    /// Factorised sides at the nodes; empty for wide ones.
    across_x: Vec<ExactSide>,
    across_y: Vec<ExactSide>,
}

/// A narrow side at one wave number: the share of the gap with its depth, and without.
struct ExactSide {
    deep: Option<(f64, ThickAperture)>,
    thin: Aperture,
}

impl ExactSide {
    fn new(limits: [f64; 2], thickness_m: f64, k: f64) -> Self {
        let width = limits[1] - limits[0];
        let share = if is_thick(width, thickness_m) { fade(k * width, DEEP_KA) } else { 0.0 };
        let deep = (share > 0.0).then(|| (share, ThickAperture::new(&[limits], thickness_m, k)));
        Self { deep, thin: Aperture::new(&[limits], k) }
    }

    fn transfer(&self, crossing: &Crossing) -> f64 {
        match &self.deep {
            Some((share, deep)) if *share == 1.0 => deep.transfer(crossing),
            Some((share, deep)) => share * deep.transfer(crossing) + (1.0 - share) * self.thin.transfer(crossing),
            None => self.thin.transfer(crossing),
        }
    }
}

impl Product {
    fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, spectrum: &Spectrum, paraxial: bool) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
        let narrow = |width: f64| !paraxial && 0.5 * (low + high) * width < NARROW_SIDE_KA;
        let depth = if width <= height { [thickness_m, 0.0] } else { [0.0, thickness_m] };
        let mut nodes = Vec::new();
        if narrow(width) || narrow(height) {
            let diagonal = width.hypot(height);
            // A side that is solved exactly is the narrower one, or both are.
            let resonances = resonant(&[if width <= height { x_m } else { y_m }], thickness_m, low, high);
            let smooth = 0.7 * (high - low) * (diagonal + thickness_m) + resonances;
            let count = if high > low { 4 + (smooth.ceil() as usize).min(MOST_FREQUENCIES) } else { 1 };
            nodes = gauss_nodes(low, high, count).collect();
        }
        let solve = |narrow: bool, limits: [f64; 2], depth: f64| -> Vec<ExactSide> {
            nodes.iter().filter(|_| narrow).map(|(k, _)| ExactSide::new(limits, depth, *k)).collect()
        };
        let (across_x, across_y) = (solve(narrow(width), x_m, depth[0]), solve(narrow(height), y_m, depth[1]));
        let jambs = if paraxial { Jambs::Paraxial } else { Jambs::Rigid };
        Self { x_m, y_m, spectrum: *spectrum, jambs, nodes, across_x, across_y }
    }

    fn intensity(&self, source: DVec3, receiver: DVec3) -> f64 {
        let (source, receiver) = facing(source, receiver);
        let (x_m, y_m, spectrum, jambs) = (self.x_m, self.y_m, &self.spectrum, self.jambs);
        let Some(over) = shortest_over(source, receiver, x_m, y_m) else { return 0.0 };
        let (into, out) = (over - source, receiver - over);
        // Along each side the way is unfolded about the shortest one: the other direction only makes it longer.
        let side = |limits: [f64; 2], s: f64, r: f64, z_in: f64, z_out: f64| Side {
            limits,
            crossing: Crossing { incident: Incident::Line { x_m: s, z_m: z_in }, x_m: r, z_m: z_out },
        };
        let x = side(x_m, source.x, receiver.x, into.z.hypot(into.y), out.z.hypot(out.y));
        let y = side(y_m, source.y, receiver.y, into.z.hypot(into.x), out.z.hypot(out.x));
        // Cylindrical spreading along either side: 1/r^2 where the straight way is free.
        let spread = x.crossing.free_intensity() * y.crossing.free_intensity();
        if self.nodes.is_empty() {
            let width = spectrum.high_k() - spectrum.low_k();
            let phase = width * (x.detour_m() + y.detour_m());
            let count = if width > 0.0 { 8 + (phase / PI * 1.5).ceil() as usize } else { 1 };
            let grid = Grid::midpoints(spectrum, count);
            let along_x = x.samples(spectrum, jambs).on(&grid);
            let along_y = y.samples(spectrum, jambs).on(&grid);
            return along_x.iter().zip(&along_y).map(|(a, b)| a * b).sum::<f64>() / count as f64 * spread;
        }
        let transfers = |side: &Side, solved: &[ExactSide]| -> Vec<f64> {
            if solved.is_empty() {
                let samples = side.samples(spectrum, jambs);
                return self.nodes.iter().map(|(k, _)| samples.at(*k)).collect();
            }
            let exact = |solved: &ExactSide| solved.transfer(&side.crossing);
            solved.iter().map(exact).collect()
        };
        let (along_x, along_y) = (transfers(&x, &self.across_x), transfers(&y, &self.across_y));
        let products = along_x.iter().zip(&along_y).zip(&self.nodes);
        products.map(|((a, b), (_, weight))| a * b * weight).sum::<f64>() * spread
    }
}

/// Point of the rectangle on the shortest way from `a` to `b` (opposite sides of z = 0): the straight line's crossing,
/// clamped, then the shortest along each side in turn.
pub fn shortest_over(a: DVec3, b: DVec3, x_m: [f64; 2], y_m: [f64; 2]) -> Option<DVec3> {
    let t = a.z / (a.z - b.z);
    if !(0.0..=1.0).contains(&t) {
        return None;
    }
    let straight = a + (b - a) * t;
    let mut over = DVec3::new(straight.x.clamp(x_m[0], x_m[1]), straight.y.clamp(y_m[0], y_m[1]), 0.0);
    for _ in 0..3 {
        // With the other coordinate fixed the shortest way divides like the distances across it.
        let divide = |a: f64, b: f64, into: f64, out: f64, limits: [f64; 2]| {
            (a + (b - a) * into / (into + out)).clamp(limits[0], limits[1])
        };
        let across =
            |p: DVec3, over: DVec3, along_x: bool| (if along_x { p.y - over.y } else { p.x - over.x }).hypot(p.z);
        over.x = divide(a.x, b.x, across(a, over, true), across(b, over, true), x_m);
        over.y = divide(a.y, b.y, across(a, over, false), across(b, over, false), y_m);
    }
    Some(over)
}

/// Puts the source before the plane (z < 0) and the receiver behind it.
fn facing(source: DVec3, receiver: DVec3) -> (DVec3, DVec3) {
    let turn = |p: DVec3| DVec3::new(p.x, p.y, -p.z);
    if source.z > receiver.z { (turn(source), turn(receiver)) } else { (source, receiver) }
}

/// Transmission coefficient at normal incidence of an opening smaller than the wavelength, `thickness_m` deep, band mean: exact.
pub fn small_hole_transmission(width_m: f64, height_m: f64, thickness_m: f64, spectrum: &Spectrum) -> f64 {
    let depth = if is_thick(width_m.min(height_m), thickness_m) { thickness_m } else { 0.0 };
    transmission(width_m, height_m, depth, &wave_numbers(width_m, height_m, depth, spectrum))
}

/// One direction of the opening.
struct Side {
    limits: [f64; 2],
    crossing: Crossing,
}

/// Wave numbers in 1/m at the midpoints of equal parts of a band.
struct Grid {
    first_k: f64,
    step_k: f64,
    count: usize,
}

impl Grid {
    fn midpoints(spectrum: &Spectrum, count: usize) -> Self {
        let step_k = (spectrum.high_k() - spectrum.low_k()) / count as f64;
        Self { first_k: spectrum.low_k() + 0.5 * step_k, step_k, count }
    }
}

/// The transfer |p/p_free|^2 of a side as a sum of sines (rays) and cosines (jambs) of k.
struct Samples {
    /// (delay in m, amplitude): amplitude * sin(k * delay).
    sines: Vec<(f64, f64)>,
    /// Jamb and middle rays: amplitude/k, amplitude * cos(k * delay)/k.
    constant: f64,
    cosine: (f64, f64),
}

impl Side {
    fn detour_m(&self) -> f64 {
        (self.crossing.length_m(self.limits[1]) - self.crossing.length_m(self.limits[0])).abs()
            + 0.25 * (self.limits[1] - self.limits[0])
    }

    /// The signed rays of the closed form as amplitudes of sin(k delay).
    fn samples(&self, spectrum: &Spectrum, jambs: Jambs) -> Samples {
        let [a, b] = self.limits;
        let middle = 0.5 * (a + b);
        let straight = self.crossing.straight_x_m();
        let mut cuts = vec![a, middle, b];
        if straight > a && straight < b {
            cuts.push(straight);
        }
        cuts.sort_by(f64::total_cmp);
        let rigid = jambs == Jambs::Rigid;
        let scale = 1.0 / self.crossing.free_intensity();
        let k = spectrum.high_k();
        let separation = |x: f64| if x < middle { 2.0 * (x - a) } else { 2.0 * (b - x) };
        let mut sines = Vec::new();
        for cut in cuts.windows(2) {
            let phase = |x: f64| k * separation(x) * self.crossing.ray(x).delta();
            let quarter = |i: f64| phase(cut[0] + 0.25 * i * (cut[1] - cut[0]));
            let total: f64 = (0..4).map(|i| (quarter(i as f64 + 1.0) - quarter(i as f64)).abs()).sum();
            let panels = 1 + (total / PHASE_PER_PANEL) as usize;
            let width = (cut[1] - cut[0]) / panels as f64;
            for panel in 0..panels {
                let start = cut[0] + panel as f64 * width;
                for (x, weight) in panel_nodes(start, start + width) {
                    let ray = self.crossing.ray(x);
                    let delta = match ray.delta() {
                        d if d.abs() < 1e-9 => 1e-9,
                        d => d,
                    };
                    let h = separation(x);
                    let mut amplitude = 1.0 / (PI * delta);
                    if rigid {
                        let side = if x < middle { -1.0 } else { 1.0 };
                        amplitude = amplitude * ray.cos_sigma().powi(2) + side / PI;
                    }
                    sines.push((h * delta, amplitude * ray.spread * weight * scale));
                }
            }
        }
        let (mut constant, mut cosine) = (0.0, (0.0, 0.0));
        if rigid {
            let strength = |x: f64| {
                let ray = self.crossing.ray(x);
                ray.spread.sqrt() / (4.0 * PI * ray.cos_sigma().max(1e-9)) * (scale * TAU).sqrt()
            };
            let (low, high) = (strength(a), strength(b));
            let detour = self.crossing.length_m(b) - self.crossing.length_m(a);
            constant = low * low + high * high;
            cosine = (detour, 2.0 * low * high);
        }
        Samples { sines, constant, cosine }
    }
}

impl Samples {
    /// The transfer at one wave number.
    fn at(&self, k: f64) -> f64 {
        self.sines.iter().map(|(delay, amplitude)| amplitude * (k * delay).sin()).sum::<f64>()
            + (self.constant + self.cosine.1 * (k * self.cosine.0).cos()) / k
    }

    /// The transfer on a grid of frequencies, by rotation.
    fn on(&self, grid: &Grid) -> Vec<f64> {
        let mut transfer = vec![0.0; grid.count];
        for &(delay, amplitude) in &self.sines {
            let (mut sin, mut cos) = (grid.first_k * delay).sin_cos();
            let (turn_sin, turn_cos) = (grid.step_k * delay).sin_cos();
            for value in &mut transfer {
                *value += amplitude * sin;
                (sin, cos) = (sin * turn_cos + cos * turn_sin, cos * turn_cos - sin * turn_sin);
            }
        }
        for (i, value) in transfer.iter_mut().enumerate() {
            let k = grid.first_k + i as f64 * grid.step_k;
            *value += (self.constant + self.cosine.1 * (k * self.cosine.0).cos()) / k;
        }
        transfer
    }
}
