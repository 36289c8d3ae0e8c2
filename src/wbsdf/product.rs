//! The product of the two directions of a rectangular opening, frequency by frequency.
//!
//! In each direction the opening is a slit, or several in one plane, between source and receiver at the distances that the shortest way through
//! the opening has when it is unfolded, and its transfer |p/p_free|^2 is that of the slit: signed rays with eq. (5a-c) where
//! it is wide, the exact aperture where it is narrow, the exact half-plane where it has one edge, 1 where it has none. The transfers of a
//! single frequency are sums of sines in f, so a whole grid of frequencies costs one evaluation of the rays and a rotation a
//! frequency; their product is then averaged over the band.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::{Jambs, Mask};
use super::quadrature::{PHASE_PER_PANEL, panel_nodes};
use super::slit::{self, MOST_FREQUENCIES, fade, gauss_nodes, resonant};
use super::thick::{ThickAperture, is_thick};

/// k times width up to which a side is solved exactly.
pub(super) const NARROW_SIDE_KA: f64 = 12.0;
/// k times width between which the depth of the gap along the narrower side loses its weight.
const DEEP_KA: [f64; 2] = [6.0, NARROW_SIDE_KA];
/// Gauss frequencies a band beyond those of the span of the edges, for edges far from the straight way.
const FREQUENCIES: usize = 4;
/// The same where a side is summed frequency by frequency.
const FREQUENCIES_OF_MASKS: usize = 16;
/// Relative accuracy of the sums over several slits.
const TOLERANCE: f64 = 1e-4;

/// The product of the two directions of openings `x` by `y` in one band.
pub(super) struct Product {
    x: Mask,
    y: Mask,
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
    fn new(mask: &Mask, thickness_m: f64, k: f64) -> Self {
        let width = narrowest_m(mask);
        let share = if is_thick(width, thickness_m) { fade(k * width, DEEP_KA) } else { 0.0 };
        let deep = (share > 0.0).then(|| (share, ThickAperture::new(mask.openings(), thickness_m, k)));
        Self { deep, thin: Aperture::new(mask.openings(), k) }
    }

    fn transfer(&self, crossing: &Crossing) -> f64 {
        match &self.deep {
            Some((share, deep)) if *share == 1.0 => deep.transfer(crossing),
            Some((share, deep)) => share * deep.transfer(crossing) + (1.0 - share) * self.thin.transfer(crossing),
            None => self.thin.transfer(crossing),
        }
    }
}

/// Width in m of the narrowest opening.
fn narrowest_m(mask: &Mask) -> f64 {
    mask.openings().iter().map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min)
}

/// Lowest and highest limit in m.
pub fn span(mask: &Mask) -> [f64; 2] {
    let limits = |first: usize| mask.openings().iter().map(move |o| o[first]);
    [limits(0).fold(f64::INFINITY, f64::min), limits(1).fold(f64::NEG_INFINITY, f64::max)]
}

/// The only opening of a mask, if it has two edges.
pub(super) fn only(mask: &Mask) -> Option<[f64; 2]> {
    match mask.openings() {
        [limits] if limits.iter().all(|x| x.is_finite()) => Some(*limits),
        _ => None,
    }
}

impl Product {
    /// For a wall of `thickness_m`, which counts across the narrower side only, where it makes a resonating gap.
    pub(super) fn new(x: &Mask, y: &Mask, thickness_m: f64, spectrum: &Spectrum, jambs: Jambs) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let (width, height) = (narrowest_m(x), narrowest_m(y));
        let finite = |mask: &Mask| span(mask).iter().all(|limit| limit.is_finite());
        let narrow = |mask: &Mask| {
            jambs == Jambs::Rigid && finite(mask) && 0.5 * (low + high) * narrowest_m(mask) < NARROW_SIDE_KA
        };
        let (narrower, depth) = if width <= height { (x, [thickness_m, 0.0]) } else { (y, [0.0, thickness_m]) };
        let mut nodes = Vec::new();
        // Two wide single sides go by a grid instead.
        if narrow(x) || narrow(y) || only(x).is_none() || only(y).is_none() {
            let extent = |mask: &Mask| if finite(mask) { span(mask)[1] - span(mask)[0] } else { 0.0 };
            // A side that is solved exactly is the narrower one, or both are.
            let resonances = if finite(narrower) { resonant(narrower.openings(), thickness_m, low, high) } else { 0.0 };
            let smooth = 0.7 * (high - low) * (extent(x).hypot(extent(y)) + thickness_m) + resonances;
            let least = if only(x).is_some() && only(y).is_some() { FREQUENCIES } else { FREQUENCIES_OF_MASKS };
            let count = if high > low { least + (smooth.ceil() as usize).min(MOST_FREQUENCIES) } else { 1 };
            nodes = gauss_nodes(low, high, count).collect();
        }
        let solve = |mask: &Mask, depth: f64| -> Vec<ExactSide> {
            nodes.iter().filter(|_| narrow(mask)).map(|(k, _)| ExactSide::new(mask, depth, *k)).collect()
        };
        let (across_x, across_y) = (solve(x, depth[0]), solve(y, depth[1]));
        Self { x: x.clone(), y: y.clone(), spectrum: *spectrum, jambs, nodes, across_x, across_y }
    }

    /// Intensity at `receiver` of a point source at `source`, on opposite sides of z = 0, relative to the free field at 1 m.
    pub(super) fn intensity(&self, source: DVec3, receiver: DVec3) -> f64 {
        let (source, receiver) = facing(source, receiver);
        let (spectrum, jambs) = (&self.spectrum, self.jambs);
        let Some(over) = shortest_over(source, receiver, &self.x, &self.y) else { return 0.0 };
        let (into, out) = (over - source, receiver - over);
        // Along each side the way is unfolded about the shortest one: the other direction only makes it longer.
        let crossing = |s: f64, r: f64, z_in: f64, z_out: f64| Crossing {
            incident: Incident::Line { x_m: s, z_m: z_in },
            x_m: r,
            z_m: z_out,
        };
        let x = crossing(source.x, receiver.x, into.z.hypot(into.y), out.z.hypot(out.y));
        let y = crossing(source.y, receiver.y, into.z.hypot(into.x), out.z.hypot(out.x));
        // Cylindrical spreading along either side: 1/r^2 where the straight way is free.
        let spread = x.free_intensity() * y.free_intensity();
        if self.nodes.is_empty()
            && let (Some(x_m), Some(y_m)) = (only(&self.x), only(&self.y))
        {
            let (x, y) = (Side { limits: x_m, crossing: x }, Side { limits: y_m, crossing: y });
            let width = spectrum.high_k() - spectrum.low_k();
            let phase = width * (x.detour_m() + y.detour_m());
            let count = if width > 0.0 { 8 + (phase / PI * 1.5).ceil() as usize } else { 1 };
            let grid = Grid::midpoints(spectrum, count);
            let along_x = x.samples(spectrum, jambs).on(&grid);
            let along_y = y.samples(spectrum, jambs).on(&grid);
            return along_x.iter().zip(&along_y).map(|(a, b)| a * b).sum::<f64>() / count as f64 * spread;
        }
        let transfers = |mask: &Mask, crossing: Crossing, solved: &[ExactSide]| -> Vec<f64> {
            if !solved.is_empty() {
                return solved.iter().map(|solved| solved.transfer(&crossing)).collect();
            }
            if let Some(limits) = only(mask) {
                let samples = Side { limits, crossing }.samples(spectrum, jambs);
                return self.nodes.iter().map(|(k, _)| samples.at(*k)).collect();
            }
            let tone = |k: f64| Spectrum::tone(k * spectrum.speed_m_s / TAU, spectrum.speed_m_s);
            let sum = |k: f64| match jambs {
                Jambs::Rigid => slit::intensity(mask, 0.0, &crossing, &tone(k), || None, TOLERANCE),
                Jambs::Paraxial => slit::paraxial_intensity(mask, &crossing, &tone(k), TOLERANCE),
            };
            self.nodes.iter().map(|(k, _)| sum(*k).value / crossing.free_intensity()).collect()
        };
        let (along_x, along_y) = (transfers(&self.x, x, &self.across_x), transfers(&self.y, y, &self.across_y));
        let products = along_x.iter().zip(&along_y).zip(&self.nodes);
        products.map(|((a, b), (_, weight))| a * b * weight).sum::<f64>() * spread
    }
}

/// Point of the openings on the shortest way from `a` to `b` (opposite sides of z = 0): the straight line's crossing,
/// moved to the nearest opening, then the shortest along each side in turn.
pub fn shortest_over(a: DVec3, b: DVec3, x: &Mask, y: &Mask) -> Option<DVec3> {
    let t = a.z / (a.z - b.z);
    if !(0.0..=1.0).contains(&t) {
        return None;
    }
    let nearest = |at: f64, mask: &Mask| {
        let places = mask.openings().iter().map(|o| at.clamp(o[0], o[1]));
        places.min_by(|p, q| (p - at).abs().total_cmp(&(q - at).abs()))
    };
    let straight = a + (b - a) * t;
    let mut over = DVec3::new(nearest(straight.x, x)?, nearest(straight.y, y)?, 0.0);
    for _ in 0..3 {
        // With the other coordinate fixed the shortest way divides like the distances across it.
        let divide =
            |a: f64, b: f64, into: f64, out: f64, mask: &Mask| nearest(a + (b - a) * into / (into + out), mask);
        let across =
            |p: DVec3, over: DVec3, along_x: bool| (if along_x { p.y - over.y } else { p.x - over.x }).hypot(p.z);
        over.x = divide(a.x, b.x, across(a, over, true), across(b, over, true), x)?;
        over.y = divide(a.y, b.y, across(a, over, false), across(b, over, false), y)?;
    }
    Some(over)
}

/// Puts the source before the plane (z < 0) and the receiver behind it.
fn facing(source: DVec3, receiver: DVec3) -> (DVec3, DVec3) {
    let turn = |p: DVec3| DVec3::new(p.x, p.y, -p.z);
    if source.z > receiver.z { (turn(source), turn(receiver)) } else { (source, receiver) }
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
