//! Openings of many wavelengths: the direct sound and what each of their edges sends, as pressures.
//!
//! Each edge is that of a rigid half-plane, exact up to its ends (Biot and Tolstoy's integral between limits, wedge.rs),
//! whatever the angle between ray and edge; so are strips with one end and openings side by side. What is diffracted by two
//! opposite jambs in turn are the waves of two_edges.rs over both of them, which fade where that way passes beside their
//! ends; where a side is narrow, the transfer of the slit of that width by the exact aperture over the sum of its two edges alone, both
//! between source and receiver at the distances that the shortest way has when it is unfolded. What depth changes across wide sides
//! stands in wide_side.rs. The corners themselves stay out: see rectangle.rs.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex64;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::edge::AboutEdge;
use super::mask::Mask;
use super::series::Panels;
use super::slit::{MOST_FREQUENCIES, fade, gauss_nodes, least_nodes, resonant, standing};
use super::thick::{ThickAperture, blended};
use super::two_edges::Run;
use super::wedge::{Between, Wave, WedgeField, free_wave};
use super::wide_side::WideSide;

/// k times width from which the exact aperture across a side loses its weight, and at which it has none.
pub(super) const NARROW_SIDE_KA: [f64; 2] = [8.0, 12.0];
/// Distance in m from the boundary of the shadow within which half of the direct sound is seen.
const ON_BOUNDARY_M: f64 = 1e-9;

/// Openings `x` by `y` (any of the limits infinite) in one band.
pub(super) struct Rim {
    x: Mask,
    y: Mask,
    spectrum: Spectrum,
    /// Wave numbers and weights where a side is narrow.
    nodes: Vec<(f64, f64)>,
    panels: Panels,
    across_x: Option<NarrowSide>,
    across_y: Option<NarrowSide>,
    /// Across x and y where they are wide.
    wide: [Option<WideSide>; 2],
}

/// The share of a narrow side, and at the nodes the weight, the exact transfer and that of the two edges alone, both relative to the
/// free field.
type Changes = (f64, Vec<(f64, Complex64, Complex64)>);

/// A narrow side, solved at the nodes.
struct NarrowSide {
    /// Its weight: the rest is left to single diffraction.
    share: f64,
    solved: Vec<ExactSide>,
}

/// A narrow side at one wave number: the share of the gap with its depth and the gap, and the thin one.
struct ExactSide {
    deep: Option<(f64, ThickAperture)>,
    thin: Aperture,
}

impl ExactSide {
    fn new(mask: &Mask, (share, thickness_m): (f64, f64), k: f64) -> Self {
        let deep = (share > 0.0).then(|| (share, ThickAperture::new(mask.openings(), thickness_m, k)));
        Self { deep, thin: Aperture::new(mask.openings(), k) }
    }

    /// p/|p_free|.
    fn transfer(&self, crossing: &Crossing) -> Complex64 {
        match &self.deep {
            Some((share, deep)) if *share == 1.0 => deep.transfer(crossing),
            Some((share, deep)) => {
                let both = [(*share, deep.transfer(crossing)), (1.0 - share, self.thin.transfer(crossing))];
                blended(both.into_iter())
            }
            None => self.thin.transfer(crossing),
        }
    }
}

/// Width in m of the narrowest opening.
pub(super) fn narrowest_m(mask: &Mask) -> f64 {
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

/// The two directions of openings `x` by `y` as slits, each between a line source and a receiver at the distances that the
/// shortest way has when it is unfolded: the other direction only makes it longer.
pub fn unfolded(x: &Mask, y: &Mask, source: DVec3, receiver: DVec3) -> Option<[Crossing; 2]> {
    let over = shortest_over(source, receiver, x, y)?;
    let (into, out) = (over - source, receiver - over);
    let crossing = |s: f64, r: f64, z_in: f64, z_out: f64| Crossing {
        incident: Incident::Line { x_m: s, z_m: z_in },
        x_m: r,
        z_m: z_out,
    };
    Some([
        crossing(source.x, receiver.x, into.z.hypot(into.y), out.z.hypot(out.y)),
        crossing(source.y, receiver.y, into.z.hypot(into.x), out.z.hypot(out.x)),
    ])
}

/// What one edge sends.
struct Edge(WedgeField);

impl Edge {
    /// The edge at `edge_m` along x with its screen towards `side` of it, from `ends_m[0]` to `ends_m[1]` along y; without ends
    /// the source is a line along it.
    fn new(edge_m: f64, side: f64, ends_m: Option<[f64; 2]>, ends: [DVec3; 2], spectrum: &Spectrum) -> Self {
        let [source, receiver] = ends;
        let about = |p: DVec3| ((p.x - edge_m) * side, p.z.abs());
        let ((x_s, z_s), (x_r, z_r)) = (about(source), about(receiver));
        let from = AboutEdge { r_m: x_s.hypot(z_s), phi: z_s.atan2(x_s) };
        let to = AboutEdge { r_m: x_r.hypot(z_r), phi: TAU - z_r.atan2(x_r) };
        match ends_m {
            Some(ends_m) => {
                let dy = receiver.y - source.y;
                let between = ends_m.map(|y| y - source.y);
                Self(WedgeField::between(TAU, from, to, Wave::Point(dy), between, spectrum))
            }
            None => Self(WedgeField::new(TAU, from, to, Wave::Line, spectrum)),
        }
    }

    /// What it sends at wave number `k`, whose place in the table of its spectrum is `between`, with its phase.
    fn sent(&self, k: f64, between: Option<&Between>) -> Complex64 {
        let over_way = |(way, length_m): (usize, f64)| {
            self.0.over_way(way, k, between).into_iter().sum::<Complex64>() * Complex64::from_polar(1.0, k * length_m)
        };
        self.0.ways_m().enumerate().map(over_way).sum()
    }
}

/// The wave over two opposite jambs in turn, with the share of it that the ends of the jambs leave.
struct Twice {
    run: Run,
    /// Distances in m by which it passes their ends (negative: beside them), and the lengths of its way before and behind.
    past: [(f64, f64, f64); 2],
    sin_beta: f64,
}

impl Twice {
    /// Over the jamb at `near` along x, then that at `far`, both between `ends_m` along y.
    fn new(near: f64, far: f64, ends_m: [f64; 2], [source, receiver]: [DVec3; 2]) -> Self {
        let dy_m = receiver.y - source.y;
        let incident = Incident::Point { x_m: source.x, z_m: source.z.abs(), dy_m };
        let run = Run::new(near, far, &Crossing { incident, x_m: receiver.x, z_m: receiver.z.abs() });
        let before = (source.x - near).hypot(source.z);
        let behind = (receiver.x - far).hypot(receiver.z);
        let width = (far - near).abs();
        let across = before + width + behind;
        let past = [before, before + width].map(|way| {
            let y = source.y + dy_m * way / across;
            ((y - ends_m[0]).min(ends_m[1] - y), way, across - way)
        });
        Self { run, past, sin_beta: across / across.hypot(dy_m) }
    }

    fn sent(&self, k: f64) -> Complex64 {
        // Half of it is left where it meets an end, all of it a Fresnel zone inside.
        let left = |(past, before, behind): (f64, f64, f64)| {
            let zone = (TAU / k * before * behind / (before + behind)).sqrt() / self.sin_beta;
            0.5 * (1.0 + (2.0 * past / zone).tanh())
        };
        self.run.pressure(k) * (left(self.past[0]) * left(self.past[1]))
    }
}

/// Share of the direct sound that passes a mask at `at_m`: half on an edge, whose own part vanishes there.
fn passes(at_m: f64, mask: &Mask) -> f64 {
    let through = |o: &[f64; 2]| match (at_m - o[0]).min(o[1] - at_m) {
        inside if inside.abs() < ON_BOUNDARY_M => 0.5,
        inside if inside > 0.0 => 1.0,
        _ => 0.0,
    };
    mask.openings().iter().map(through).sum()
}

/// The finite edges of a mask with the direction (sign) in which the screen lies.
fn edges(mask: &Mask) -> impl Iterator<Item = (f64, f64)> {
    mask.openings().iter().flat_map(|o| [(o[0], -1.0), (o[1], 1.0)]).filter(|(x, _)| x.is_finite())
}

impl Rim {
    /// For a wall of `thickness_m`, which has the share `deep` of the intensity; a thin one has the rest.
    pub(super) fn new(x: &Mask, y: &Mask, (deep, thickness_m): (f64, f64), spectrum: &Spectrum) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let share = |mask: &Mask| match span(mask).iter().all(|limit| limit.is_finite()) {
            true => fade(0.5 * (low + high) * narrowest_m(mask), NARROW_SIDE_KA),
            false => 0.0,
        };
        let narrower = if narrowest_m(x) <= narrowest_m(y) { x } else { y };
        let shares = [x, y].map(share);
        let mut panels = Panels::new(Vec::new());
        if shares.iter().any(|s| *s > 0.0) {
            let extent = |mask: &Mask, share: f64| if share > 0.0 { span(mask)[1] - span(mask)[0] } else { 0.0 };
            let diagonal = extent(x, shares[0]).hypot(extent(y, shares[1]));
            // A side that is solved exactly is the narrower one, or both are.
            let width = narrowest_m(narrower);
            panels = gap_panels(0.7 * (diagonal + thickness_m), thickness_m, ([width; 2], width), [low, high]);
        }
        let nodes = panels.nodes();
        let side = |mask: &Mask, share: f64| {
            (share > 0.0).then(|| {
                let solved = nodes.iter().map(|(k, _)| ExactSide::new(mask, (deep, thickness_m), *k)).collect();
                NarrowSide { share, solved }
            })
        };
        let (across_x, across_y) = (side(x, shares[0]), side(y, shares[1]));
        let alone = [x, y].iter().all(|mask| mask.openings().len() == 1);
        let wide = [(x, shares[0]), (y, shares[1])].map(|(mask, narrow)| {
            let limits = only(mask).filter(|_| alone && narrow < 1.0);
            limits.map(|limits| WideSide::new(limits, (deep, thickness_m), spectrum))
        });
        Self { x: x.clone(), y: y.clone(), spectrum: *spectrum, nodes, panels, across_x, across_y, wide }
    }

    /// Intensity of a point source, relative to the free field at 1 m, where the edges send `field`.
    pub(super) fn intensity(&self, field: &Field) -> f64 {
        self.with(self.changes(field.source, field.receiver), field)
    }

    /// The same of wide sides as their edges have it.
    pub(super) fn intensity_of_edges(&self, field: &Field) -> f64 {
        self.with([1.0; 2], field)
    }

    /// The same where what passes wide sides is multiplied by `wide`.
    fn with(&self, wide: [f64; 2], field: &Field) -> f64 {
        let single = field.mean(&self.spectrum, self.twice_shares());
        let change = |(narrow, wide): (Option<Changes>, f64)| {
            let Some((share, changes)) = narrow else { return wide };
            let mean = |of: &dyn Fn(&(f64, Complex64, Complex64)) -> f64| changes.iter().map(of).sum::<f64>();
            let (exact, single) = (mean(&|c| c.0 * c.1.norm_sqr()), mean(&|c| c.0 * c.2.norm_sqr()));
            if single > 0.0 { share * exact / single + (1.0 - share) * wide } else { 1.0 }
        };
        let sides = self.narrow_sides(field.source, field.receiver);
        sides.into_iter().zip(wide).map(change).product::<f64>() * single
    }

    /// The same as a pressure at any wave number of the band, and by how much in m its ways differ at most. What wide sides
    /// change of its edges has no phase.
    pub(super) fn pressure(&self, field: &Arc<Field>) -> (impl Fn(f64) -> Complex64 + Send + Sync + use<>, f64) {
        let wide = self.changes(field.source, field.receiver).map(f64::sqrt);
        let mut scale = 1.0;
        let mut changes = Vec::new();
        for (narrow, wide) in self.narrow_sides(field.source, field.receiver).into_iter().zip(wide) {
            let Some((share, narrow)) = narrow else {
                scale *= wide;
                continue;
            };
            let value =
                |(_, exact, single): &(f64, Complex64, Complex64)| share * exact / single + (1.0 - share) * wide;
            changes.push(self.panels.through(&narrow.iter().map(value).collect::<Vec<_>>()));
        }
        let shares = self.twice_shares();
        let (wander_m, field) = (field.wander_m(shares), Arc::clone(field));
        (
            move |k| scale * changes.iter().map(|change| change(k)).product::<Complex64>() * field.pressure(k, shares),
            wander_m,
        )
    }

    /// What the wide sides across x and across y multiply the intensity by.
    fn changes(&self, source: DVec3, receiver: DVec3) -> [f64; 2] {
        if self.wide.iter().all(Option::is_none) {
            return [1.0; 2];
        }
        let (source, receiver) = facing(source, receiver);
        let unfolded = unfolded(&self.x, &self.y, source, receiver);
        let (Some([x, y]), Some(over)) = (unfolded, shortest_over(source, receiver, &self.x, &self.y)) else {
            return [1.0; 2];
        };
        let [across_x, across_y] = self.wide.each_ref().map(Option::as_ref);
        [(across_x, x, over.x), (across_y, y, over.y)]
            .map(|(side, crossing, over_m)| side.map_or(1.0, |side| side.ratio(over_m, &crossing)))
    }

    /// Seconds that slits took which only some ways asked for.
    pub(super) fn seconds(&self) -> f64 {
        self.wide.iter().flatten().map(WideSide::seconds).sum()
    }

    /// What the sides that are not narrow leave to waves from jamb to opposite jamb, across x and across y.
    fn twice_shares(&self) -> [f64; 2] {
        [&self.across_x, &self.across_y].map(|narrow| 1.0 - narrow.as_ref().map_or(0.0, |narrow| narrow.share))
    }

    /// What repeated diffraction between the jambs changes across x and y where they are narrow.
    fn narrow_sides(&self, source: DVec3, receiver: DVec3) -> [Option<Changes>; 2] {
        let (source, receiver) = facing(source, receiver);
        let crossings = if self.nodes.is_empty() { None } else { unfolded(&self.x, &self.y, source, receiver) };
        let Some([x, y]) = crossings else { return [None, None] };
        [(&self.x, &self.across_x, x), (&self.y, &self.across_y, y)].map(|(mask, narrow, crossing)| {
            let narrow = narrow.as_ref()?;
            Some((narrow.share, self.repeated(mask, narrow, &crossing)?))
        })
    }

    fn repeated(
        &self,
        mask: &Mask,
        narrow: &NarrowSide,
        crossing: &Crossing,
    ) -> Option<Vec<(f64, Complex64, Complex64)>> {
        let Incident::Line { x_m, z_m } = crossing.incident else { return None };
        let ends = [DVec3::new(x_m, 0.0, -z_m), DVec3::new(crossing.x_m, 0.0, crossing.z_m)];
        let straight_m = (ends[1] - ends[0]).length();
        let direct = passes(crossing.straight_x_m(), mask);
        let edges: Vec<Edge> = edges(mask).map(|(x, side)| Edge::new(x, side, None, ends, &self.spectrum)).collect();
        let at = |((k, weight), side): (&(f64, f64), &ExactSide)| {
            let free = free_wave(Wave::Line, straight_m, *k);
            let between = Between::new(&self.spectrum, *k);
            let sent: Complex64 = edges.iter().map(|edge| edge.sent(*k, between.as_ref())).sum();
            // The exact one starts from i/4 H0.
            let turn = Complex64::from_polar(1.0, -free.arg() - FRAC_PI_2);
            (*weight, side.transfer(crossing) * turn, direct + sent / free)
        };
        Some(self.nodes.iter().zip(&narrow.solved).map(at).collect())
    }
}

/// Panels of the band `low_high` for what passes an opening through a wall of `thickness_m` (0: thin) and varies with the wave number
/// like exp(i k d), d up to a few times `smooth_m`.
///
/// `widths_m` of the narrower and of the longer side across which its waves stand. `mouth_m`: width of a slit whose waves lose as
/// much at its mouth. A gap resonates from half a wavelength of its depth on, each mouth counted with twice its width: below, the
/// panel has no nodes for resonances.
pub(super) fn gap_panels(
    smooth_m: f64,
    thickness_m: f64,
    (widths_m, mouth_m): ([f64; 2], f64),
    [low, high]: [f64; 2],
) -> Panels {
    let width_m = widths_m[0];
    if high <= low {
        return Panels::new(vec![([low, high], 1)]);
    }
    let first = if thickness_m > 0.0 { 0.9 * PI / (thickness_m + 4.0 * width_m) } else { f64::INFINITY };
    let panel = |from: f64, to: f64, resonances: f64| {
        let count =
            least_nodes(low, high) + ((smooth_m * (to - from) + resonances).ceil() as usize).min(MOST_FREQUENCIES);
        ([from, to], count)
    };
    let resonances = |from: f64| {
        resonant(&[[0.0, mouth_m]], thickness_m, from, high).max(standing(widths_m, thickness_m, from, high))
    };
    Panels::new(match first {
        _ if first >= high => vec![panel(low, high, 0.0)],
        _ if first <= low => vec![panel(low, high, resonances(low))],
        _ => vec![panel(low, first, 0.0), panel(first, high, resonances(first))],
    })
}

/// The direct sound from one point to another on the other side of z = 0, and what the edges of the openings send, whatever the band.
pub(super) struct Field {
    source: DVec3,
    receiver: DVec3,
    /// Wave numbers of its tables.
    spectrum: Spectrum,
    /// Amplitude of the direct sound.
    direct: f64,
    straight_m: f64,
    once: Vec<Edge>,
    /// Between the jambs across x, and across y.
    twice: [Vec<Twice>; 2],
}

impl Field {
    /// For the openings `x` by `y` and all wave numbers of `spectrum`.
    pub(super) fn new(x: &Mask, y: &Mask, [source, receiver]: [DVec3; 2], spectrum: &Spectrum) -> Self {
        let turned = |p: DVec3| DVec3::new(p.y, p.x, p.z);
        let (ends, turned) = ([source, receiver], [turned(source), turned(receiver)]);
        let mut once = Vec::new();
        for o in y.openings() {
            once.extend(edges(x).map(|(x, side)| Edge::new(x, side, Some(*o), ends, spectrum)));
        }
        for o in x.openings() {
            once.extend(edges(y).map(|(y, side)| Edge::new(y, side, Some(*o), turned, spectrum)));
        }
        let twice = |across: &Mask, along: &Mask, ends: [DVec3; 2]| match (only(across), along.openings()) {
            (Some([low, high]), [ends_m]) => {
                [(low, high), (high, low)].map(|(near, far)| Twice::new(near, far, *ends_m, ends)).into()
            }
            _ => Vec::new(),
        };
        let twice = [twice(x, y, ends), twice(y, x, turned)];
        let straight_m = (receiver - source).length();
        let at = source + (receiver - source) * (source.z / (source.z - receiver.z));
        let direct = passes(at.x, x) * passes(at.y, y) / straight_m;
        Self { source, receiver, spectrum: *spectrum, direct, straight_m, once, twice }
    }

    /// Of waves from jamb to jamb it takes the `shares`, across x and across y.
    fn pressure(&self, k: f64, shares: [f64; 2]) -> Complex64 {
        let between = Between::new(&self.spectrum, k);
        let once: Complex64 = self.once.iter().map(|edge| edge.sent(k, between.as_ref())).sum();
        let twice: Complex64 = self.twice_of(shares).map(|(share, twice)| share * twice.sent(k)).sum();
        Complex64::from_polar(self.direct, k * self.straight_m) + once + twice
    }

    fn twice_of(&self, shares: [f64; 2]) -> impl Iterator<Item = (f64, &Twice)> {
        let heard = self.twice.iter().zip(shares).filter(|(_, share)| *share > 0.0);
        heard.flat_map(|(twice, share)| twice.iter().map(move |twice| (share, twice)))
    }

    /// By how much in m its ways differ at most.
    fn wander_m(&self, shares: [f64; 2]) -> f64 {
        let twice = self.twice_of(shares).map(|(_, twice)| twice.run.length_m);
        let ways = self.once.iter().flat_map(|edge| edge.0.ways_m()).chain(twice);
        let direct = (self.direct > 0.0).then_some(self.straight_m);
        let (first, last) =
            ways.chain(direct).fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), way| (a.min(way), b.max(way)));
        (last - first).max(0.0)
    }

    /// Mean of |p|^2 over a band: it varies like cos(k d), d the differences of the ways.
    fn mean(&self, band: &Spectrum, shares: [f64; 2]) -> f64 {
        let (low, high) = (band.low_k(), band.high_k());
        let phase = (high - low) * self.wander_m(shares);
        let count = if high > low {
            1 + least_nodes(low, high) + ((0.35 * phase).ceil() as usize).min(MOST_FREQUENCIES)
        } else {
            1
        };
        gauss_nodes(low, high, count).map(|(k, weight)| weight * self.pressure(k, shares).norm_sqr()).sum()
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
pub(super) fn facing(source: DVec3, receiver: DVec3) -> (DVec3, DVec3) {
    let turn = |p: DVec3| DVec3::new(p.x, p.y, -p.z);
    if source.z > receiver.z { (turn(source), turn(receiver)) } else { (source, receiver) }
}
