//! A rectangular opening between two points: the product of its two directions, frequency by frequency.
//!
//! In each direction the opening is a slit between source and receiver at the distances that the shortest way through
//! the opening has when it is unfolded, and its transfer |p/p_free|^2 is that of the slit: signed rays with eq. (5a-c) where it is wide, the exact aperture where it
//! is narrow. The transfers of a single frequency are sums of sines in f, so a whole grid of frequencies costs one
//! evaluation of the rays and a rotation a frequency; their product is then averaged over the band. Where the opening is
//! narrow both ways the product of two slits fails (each of them has the slit's logarithm): there it radiates like the
//! hole of equal area, with the exact transmission of the circular hole.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use num_complex::Complex64;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::Jambs;
use super::quadrature::{PHASE_PER_PANEL, panel_nodes};
use super::slit::{MOST_FREQUENCIES, fade, gauss_nodes, resonant};
use super::thick::{ThickAperture, is_thick};

/// k times width up to which a side is solved exactly.
const NARROW_SIDE_KA: f64 = 12.0;
/// k times width between which the depth of the gap along the narrower side loses its weight.
const DEEP_KA: [f64; 2] = [6.0, NARROW_SIDE_KA];
/// k times width of both sides up to which the opening is a small hole.
const SMALL_HOLE_KA: f64 = 3.0;

/// How the two sides of a rectangular opening are modelled in a band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sides {
    /// Signed rays both ways.
    WideBoth,
    /// Exact aperture along x, signed rays along y.
    NarrowX,
    /// Signed rays along x, exact aperture along y.
    NarrowY,
    /// Exact aperture both ways.
    NarrowBoth,
    /// Hole of equal area.
    SmallHole,
    /// Signed rays of the published small-angle form both ways.
    Paraxial,
}

impl Sides {
    /// The model for an opening of `width_m` by `height_m`.
    pub fn of(width_m: f64, height_m: f64, spectrum: &Spectrum) -> Self {
        let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
        let (x, y) = (k * width_m, k * height_m);
        if x.max(y) < SMALL_HOLE_KA {
            Self::SmallHole
        } else {
            match (x < NARROW_SIDE_KA, y < NARROW_SIDE_KA) {
                (true, true) => Self::NarrowBoth,
                (true, false) => Self::NarrowX,
                (false, true) => Self::NarrowY,
                (false, false) => Self::WideBoth,
            }
        }
    }
}

/// A rectangular opening of a rigid thin screen in one band: what is the same for all sources and receivers.
pub struct Rectangle {
    x_m: [f64; 2],
    y_m: [f64; 2],
    spectrum: Spectrum,
    sides: Sides,
    /// Wave numbers and weights where a side is solved exactly.
    nodes: Vec<(f64, f64)>,
    /// Factorised sides at the nodes; empty for wide ones.
    across_x: Vec<ExactSide>,
    across_y: Vec<ExactSide>,
    /// What the depth of a small hole leaves of its transmission.
    tube: f64,
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
            Some((share, deep)) if *share == 1.0 => deep.transfer(crossing).norm_sqr(),
            Some((share, deep)) => {
                let [deep, thin] = [deep.transfer(crossing), self.thin.transfer(crossing)].map(|t| t.norm_sqr());
                share * deep + (1.0 - share) * thin
            }
            None => self.thin.transfer(crossing).norm_sqr(),
        }
    }
}

impl Rectangle {
    /// Prepares the opening `x_m` by `y_m` (limits along its sides in m) through a wall of `thickness_m` for the band.
    ///
    /// Its depth counts across the narrower side only, where it makes a resonating gap; that of a wide opening is left out.
    pub fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, spectrum: &Spectrum, sides: Sides) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let (narrow_x, narrow_y) = match sides {
            Sides::NarrowBoth => (true, true),
            Sides::NarrowX => (true, false),
            Sides::NarrowY => (false, true),
            Sides::WideBoth | Sides::SmallHole | Sides::Paraxial => (false, false),
        };
        let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
        let depth = if width <= height { [thickness_m, 0.0] } else { [0.0, thickness_m] };
        let mut nodes = Vec::new();
        if narrow_x || narrow_y {
            // |p|^2 varies over the band like cos(k d), d at most twice the diagonal (see slit.rs).
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
        let (across_x, across_y) = (solve(narrow_x, x_m, depth[0]), solve(narrow_y, y_m, depth[1]));
        let tube =
            if sides == Sides::SmallHole { tube_transmission(width, height, thickness_m, spectrum) } else { 1.0 };
        Self { x_m, y_m, spectrum: *spectrum, sides, nodes, across_x, across_y, tube }
    }

    /// Intensity at `receiver` of a point source at `source` through the opening, relative to the free field at 1 m, band
    /// mean. Both in the opening's frame (x and y along its sides, z the normal, in m), on opposite sides of z = 0.
    /// Swapping them changes nothing.
    pub fn intensity(&self, source: DVec3, receiver: DVec3) -> f64 {
        let (source, receiver) = facing(source, receiver);
        let (x_m, y_m, spectrum) = (self.x_m, self.y_m, &self.spectrum);
        if self.sides == Sides::SmallHole {
            return self.tube * small_hole(x_m, y_m, source, receiver, spectrum);
        }
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
        let jambs = if self.sides == Sides::Paraxial { Jambs::Paraxial } else { Jambs::Rigid };
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

/// Transmission coefficient of a circular hole in a thin rigid screen at normal incidence, `ka` = k times radius:
/// exact values (Bouwkamp 1954; rounded to 1e-6), interpolated.
pub fn hole_transmission(ka: f64) -> f64 {
    const TABLE: [(f64, f64); 8] = [
        (0.0, 0.810_569),
        (0.01, 0.810_573),
        (0.5, 0.818_464),
        (1.0, 0.841_502),
        (2.0, 0.917_343),
        (3.0, 0.976_083),
        (5.0, 0.987_723),
        (10.0, 0.997_927),
    ];
    let after = TABLE.partition_point(|row| row.0 <= ka);
    if after == TABLE.len() {
        return 1.0;
    }
    let (low, high) = (TABLE[after - 1], TABLE[after]);
    low.1 + (high.1 - low.1) * (ka - low.0) / (high.0 - low.0)
}

/// Transmission coefficient of a rectangular hole smaller than the wavelength, `k` in 1/m: that of the circular hole of
/// equal area times the square of the ratio of their conductivities, sqrt(p/q) AGM(1, q/p) for an ellipse with
/// semi-axes p >= q (Rayleigh 1897).
pub fn small_hole_transmission(width_m: f64, height_m: f64, k: f64) -> f64 {
    let ratio = width_m.min(height_m) / width_m.max(height_m);
    let (mut a, mut g) = (1.0, ratio);
    for _ in 0..8 {
        (a, g) = (0.5 * (a + g), f64::sqrt(a * g));
    }
    hole_transmission(k * (width_m * height_m / PI).sqrt()) * a * a / ratio
}

/// What a depth of `thickness_m` leaves of a small hole's transmission, band mean: a tube between its two mouths.
///
/// A mouth has half the hole's resistance to flow, 1/(2 K), and radiates like a monopole on a baffle; K is the conductivity
/// that belongs to [`small_hole_transmission`]. As k -> 0 this is K/(1 + K h/A) in place of K (Rayleigh 1897).
pub fn tube_transmission(width_m: f64, height_m: f64, thickness_m: f64, spectrum: &Spectrum) -> f64 {
    let (low, high, area) = (spectrum.low_k(), spectrum.high_k(), width_m * height_m);
    let count = if high > low { 16 } else { 1 };
    let at = |k: f64| {
        let conductivity = (small_hole_transmission(width_m, height_m, k) * area * 0.5 * PI).sqrt();
        let mouth = Complex64::new(0.5 / conductivity, k / TAU);
        let (sin, cos) = (k * thickness_m).sin_cos();
        let deep = 2.0 * mouth * cos + sin / (k * area) - mouth * mouth * k * area * sin;
        (2.0 * mouth).norm_sqr() / deep.norm_sqr()
    };
    gauss_nodes(low, high, count).map(|(k, weight)| weight * at(k)).sum()
}

/// A hole much smaller than the wavelength: a monopole on the far side, whatever the incidence.
fn small_hole(x_m: [f64; 2], y_m: [f64; 2], source: DVec3, receiver: DVec3, spectrum: &Spectrum) -> f64 {
    let area = (x_m[1] - x_m[0]) * (y_m[1] - y_m[0]);
    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
    let centre = DVec3::new(0.5 * (x_m[0] + x_m[1]), 0.5 * (y_m[0] + y_m[1]), 0.0);
    let transmission = small_hole_transmission(x_m[1] - x_m[0], y_m[1] - y_m[0], k);
    transmission * area / TAU / ((centre - source).length_squared() * (receiver - centre).length_squared())
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
