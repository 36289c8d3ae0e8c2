//! Two edges in a row: the exact field of the first wedge meets the exact field of the second on a portal between them.
//!
//! In the plane across two parallel edges the portal is the line at right angles to the way from edge to edge, in its
//! middle. Behind it the field is Green's integral over the portal of the field u of the source about the first edge,
//! with v, the field of a line source in the receiver about the second edge, as Green's function:
//!
//! ```text
//! p(receiver) = (i/4) sqrt(2/(pi k)) int [u dv/dn - v du/dn] dy ,   u, v in units of sqrt(pi k/2) H0(k r)
//! ```
//!
//! Nothing is assumed about the angles: slopes, both shadow boundaries, and a receiver or an edge in sight of the source are
//! in it, and u and v are doubled on a common face, so that grazing sound and its reflection need no factor. What it
//! leaves out are the waves that return from the second edge to the first: 0.3 dB at k times distance 0.1, 0.15 dB at 1
//! and 0.05 dB at 4 over a common face; up to 0.4 dB between two thin screens. In space (a point source) the field is that of
//! a line source at k sin(beta) times the ratio of the single edges' exact fields in space and plane.
//!
//! The integrand turns with the way over the portal, which fades out over some periods. Pierce's (1974) product of two
//! wedges is its stationary value: within 0.3 dB deep in the shadow of edges more than two wavelengths apart, and up to
//! 3 dB wrong for nearer ones (6 dB for thin screens).

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use glam::DVec2;
use num_complex::Complex64;

use super::crossing::Spectrum;
use super::edge::{AboutEdge, cotangents};
use super::hankel::scaled_hankel0;
use super::slit::gauss_nodes;
use super::utd::{Turn, band_nodes, two_edges};
use super::wedge::{Wave, WedgeField};

/// Phase in radians at the lower band edge over which the portal fades out.
const FADE: [f64; 2] = [3.0 * PI, 11.0 * PI];
/// Largest phase in radians at the upper band edge over one panel of eight Gauss nodes, which miss 1e-5 of it.
const PANEL_PHASE: f64 = 4.0 * PI;
/// Step of the normal derivative relative to the shorter of wavelength / 2 pi and distance to the edge: central
/// differences are then exact to 2e-6.
const SLOPE: f64 = 3e-3;

/// An edge across its plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Where it is, in m.
    pub at: DVec2,
    /// Unit vector along face A, away from the edge.
    pub face_a: DVec2,
    /// Unit normal of face A into the air.
    pub normal_a: DVec2,
    /// Angle of air between its faces.
    pub exterior_angle: f64,
}

impl Corner {
    /// Distance and angle of a point about the edge.
    pub fn about(&self, point: DVec2) -> AboutEdge {
        let d = point - self.at;
        AboutEdge { r_m: d.length(), phi: self.angle(d) }
    }

    /// Angle from face A through the air of a direction: on a face, that of the face.
    pub fn angle(&self, direction: DVec2) -> f64 {
        let phi = direction.dot(self.normal_a).atan2(direction.dot(self.face_a)).rem_euclid(TAU);
        match phi > 0.5 * (self.exterior_angle + TAU) {
            true => 0.0,
            false => phi.min(self.exterior_angle),
        }
    }

    /// Whether a direction from the edge points into the air or along a face.
    pub fn has_air(&self, direction: DVec2) -> bool {
        let phi = direction.dot(self.normal_a).atan2(direction.dot(self.face_a)).rem_euclid(TAU);
        phi <= self.exterior_angle + 1e-9 || phi > TAU - 1e-9
    }

    /// Unit vector into the middle of the air.
    pub fn outwards(&self) -> DVec2 {
        let (sin, cos) = (0.5 * self.exterior_angle).sin_cos();
        self.face_a * cos + self.normal_a * sin
    }
}

/// Where the sound comes from, across the edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum From {
    /// A line source along the edges.
    Line(DVec2),
    /// A point source; receiver minus source along the edges in m.
    Point(DVec2, f64),
    /// A plane wave along this unit vector; sine of its angle with the edges.
    Plane(DVec2, f64),
}

/// How a chain passes its two edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Passage {
    /// Neither is the second edge in sight of the source, nor the first in sight of the receiver.
    Shadow,
    /// The source sees the second edge past the first.
    FirstLit,
    /// The receiver sees the first edge past the second.
    SecondLit,
    /// Both: the edges do not stand between source and receiver.
    Lit,
}

/// Source, first edge, second edge and receiver, across the edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chain {
    /// The source.
    pub from: From,
    /// The edges in the order of passage, apart from each other.
    pub corners: [Corner; 2],
    /// Whether the way from edge to edge runs along a face of both.
    pub common_face: bool,
    /// The receiver in m.
    pub to: DVec2,
}

/// By how much in m the way from one end over an edge to the other is longer than the straight one.
fn past_m([end, other]: [AboutEdge; 2]) -> f64 {
    let span = (end.phi - other.phi).abs();
    let straight = (end.r_m - other.r_m).powi(2) + 4.0 * end.r_m * other.r_m * (0.5 * span).sin().powi(2);
    if end.r_m.is_infinite() { other.r_m * (1.0 + span.cos()) } else { end.r_m + other.r_m - straight.sqrt() }
}

impl Chain {
    fn source_about(&self, corner: &Corner) -> AboutEdge {
        match self.from {
            From::Line(s) | From::Point(s, _) => corner.about(s),
            From::Plane(d, _) => AboutEdge { r_m: f64::INFINITY, phi: corner.angle(-d) },
        }
    }

    /// Source and second edge about the first edge; first edge and receiver about the second.
    fn about(&self) -> [[AboutEdge; 2]; 2] {
        let [first, second] = self.corners;
        [[self.source_about(&first), first.about(second.at)], [second.about(first.at), second.about(self.to)]]
    }

    /// Which of the edges shade.
    pub fn passage(&self) -> Passage {
        Self::passage_of(&self.about())
    }

    fn passage_of(about: &[[AboutEdge; 2]; 2]) -> Passage {
        match about.each_ref().map(|[a, b]| (a.phi - b.phi).abs() < PI) {
            [false, false] => Passage::Shadow,
            [true, false] => Passage::FirstLit,
            [false, true] => Passage::SecondLit,
            [true, true] => Passage::Lit,
        }
    }

    /// Distances in m before, between and behind the edges; a plane wave has none before.
    pub fn legs_m(&self) -> [f64; 3] {
        let [[source, between], [_, receiver]] = self.about();
        [if source.r_m.is_finite() { source.r_m } else { 0.0 }, between.r_m, receiver.r_m]
    }

    /// By how much in m the way over both edges is longer than that past the one in sight; 0 in the shadow of both.
    pub fn detour_m(&self) -> f64 {
        let about = self.about();
        let [first, [edge, receiver]] = about;
        match Self::passage_of(&about) {
            Passage::FirstLit => past_m(first),
            Passage::SecondLit => past_m([receiver, edge]),
            _ => 0.0,
        }
    }

    /// Where only one edge may shade: by how much in m the way over it is longer than the straight one.
    pub fn beyond_m(&self) -> f64 {
        self.single().map_or(0.0, |(ends, _)| past_m(ends))
    }

    /// Upper bound of |p/p_free|^2 over the whole way at wave number `k` across the edges, in the shadow of both: each edge by
    /// Keller's 1/(2 pi sqrt N) of its own detour, twice as much for a face and twice for another, and by Keller's coefficient
    /// with all its terms of one sign.
    pub fn bound(&self, k: f64) -> f64 {
        let ratio = |([a, b], corner): ([AboutEdge; 2], &Corner)| {
            let fresnel = k * past_m([a, b]).max(0.0) / PI;
            let cotangents = cotangents(corner.exterior_angle, a.phi, b.phi);
            let n = corner.exterior_angle / PI;
            let parameter_m = 1.0 / (1.0 / a.r_m + 1.0 / b.r_m);
            let keller = (0.5 * cotangents / n).powi(2) / (TAU * k * parameter_m);
            (4.0 / (PI * PI * fresnel.max(1e-9))).min(16.0).min(keller)
        };
        self.about().into_iter().zip(&self.corners).map(ratio).product()
    }

    /// Source and receiver about the edge that shades if only one does, and that edge's angle of air.
    fn single(&self) -> Option<([AboutEdge; 2], f64)> {
        let [first, second] = self.corners;
        match self.passage() {
            Passage::FirstLit => Some(([self.source_about(&second), second.about(self.to)], second.exterior_angle)),
            Passage::SecondLit => Some(([self.source_about(&first), first.about(self.to)], first.exterior_angle)),
            _ => None,
        }
    }

    /// Way in m of a plane wave across the edges from the first one, which it passes in sight, to the one that shades; else 0.
    fn ahead_m(&self) -> f64 {
        match (self.from, self.passage()) {
            (From::Plane(d, _), Passage::FirstLit) => d.dot(self.corners[1].at - self.corners[0].at),
            _ => 0.0,
        }
    }

    /// Length in m of the shortest way across the edges, past the edge in sight (plane wave: from the edge on).
    fn over_m(&self) -> f64 {
        match self.single() {
            Some(([source, receiver], _)) if source.r_m.is_finite() => source.r_m + receiver.r_m,
            Some(([_, receiver], _)) => receiver.r_m,
            None => self.legs_m().iter().sum(),
        }
    }

    /// What the shortest way does at either edge, with angles that grow to the same side of the way between them
    /// (for [`two_edges`]).
    fn turns(&self) -> [Turn; 2] {
        let [[source, second], [first, receiver]] = self.about();
        let [a, b] = self.corners;
        let growth = |corner: &Corner, phi: f64| corner.normal_a * phi.cos() - corner.face_a * phi.sin();
        let opposite = growth(&a, second.phi).dot(growth(&b, first.phi)) < 0.0;
        let mirrored = |phi: f64| if opposite { b.exterior_angle - phi } else { phi };
        [
            Turn { exterior_angle: a.exterior_angle, from: source.phi, to: second.phi },
            Turn { exterior_angle: b.exterior_angle, from: mirrored(first.phi), to: mirrored(receiver.phi) },
        ]
    }

    /// The kind of wave in space, and the factor of the wave number across the edges.
    fn space_wave(&self) -> (Wave, f64) {
        match self.from {
            From::Line(_) => (Wave::Line, 1.0),
            From::Point(_, dz_m) => (Wave::Point(dz_m), 1.0),
            From::Plane(_, sin_beta) => (Wave::Plane, sin_beta),
        }
    }

    fn wave(&self) -> Wave {
        if matches!(self.from, From::Plane(..)) { Wave::Plane } else { Wave::Line }
    }
}

/// A chain by the uniform theory of diffraction, in the unit of [`ChainField::pressure`].
#[derive(Debug, Clone, Copy)]
pub struct ChainRays {
    turns: [Turn; 2],
    legs_m: [f64; 3],
    shared_face: bool,
    wave: Wave,
    sin_beta: f64,
    /// Phase of a line source's free field far away.
    phase: f64,
}

impl ChainRays {
    /// For a chain in the shadow of both edges.
    pub fn new(chain: &Chain) -> Self {
        let (wave, sin_beta) = chain.space_wave();
        let phase = if wave == Wave::Line { -FRAC_PI_4 } else { 0.0 };
        let (turns, legs_m, shared_face) = (chain.turns(), chain.legs_m(), chain.common_face);
        Self { turns, legs_m, shared_face, wave, sin_beta, phase }
    }

    /// The pressure at the receiver at wave number `k` in 1/m: see [`two_edges`] for its validity.
    pub fn pressure(&self, k: f64) -> Complex64 {
        let pressure = two_edges(self.turns, self.legs_m, self.shared_face, self.wave, k * self.sin_beta);
        pressure * Complex64::from_polar(1.0, self.phase)
    }

    /// Band mean of |p|^2 relative to the free field at 1 m.
    pub fn mean(&self, spectrum: &Spectrum) -> f64 {
        band_nodes(spectrum, 0.0).iter().map(|(k, weight)| weight * self.pressure(*k).norm_sqr()).sum()
    }
}

/// A wedge field and the way over its edge, in m, to which its phases are relative.
struct Phased(WedgeField, f64);

impl Phased {
    fn new(angle: f64, source: AboutEdge, receiver: AboutEdge, wave: Wave, spectrum: &Spectrum) -> Self {
        let across = if source.r_m.is_finite() { source.r_m + receiver.r_m } else { receiver.r_m };
        let over_m = if let Wave::Point(dz_m) = wave { across.hypot(dz_m) } else { across };
        Self(WedgeField::new(angle, source, receiver, wave, spectrum), over_m)
    }

    fn total(&self, k: f64) -> Complex64 {
        let parts = self.0.parts(k);
        (parts.incident + parts.reflected) * Complex64::from_polar(1.0, k * self.1)
    }
}

/// The fields of source and receiver at one place of the portal.
struct Node {
    /// Weight in m over twice the step of the derivative in m.
    weight: f64,
    /// u before and behind the portal.
    source: [Phased; 2],
    /// v before and behind the portal.
    receiver: [Phased; 2],
}

/// A chain's fields on its portal, at any wave number within a band.
pub struct ChainField {
    chain: Chain,
    over_m: f64,
    sin_beta: f64,
    nodes: Vec<Node>,
    /// The field over the only edge that shades, for a point source in space and for a line source.
    single: Option<(Option<Phased>, Phased)>,
    /// For a point source in the shadow of both: each edge's field with the ways of the whole chain, in space and for
    /// a line source.
    each: Vec<(Phased, Phased)>,
}

impl ChainField {
    /// The fields for wave numbers of `spectrum`; `None` where nothing stands between source and receiver, or no
    /// portal fits between them.
    pub fn new(chain: Chain, spectrum: &Spectrum) -> Option<Self> {
        if chain.passage() == Passage::Lit {
            return None;
        }
        let over_m = chain.over_m();
        let sin_beta = match chain.from {
            From::Line(_) => 1.0,
            From::Point(_, dz_m) => over_m / over_m.hypot(dz_m),
            From::Plane(_, sin_beta) => sin_beta,
        };
        let across = Spectrum { speed_m_s: spectrum.speed_m_s / sin_beta, ..*spectrum };
        let nodes = Portal::new(&chain)?.nodes(&across);
        let both = |angle: f64, source: AboutEdge, receiver: AboutEdge| {
            let space = match chain.from {
                From::Point(_, dz_m) => Some(Phased::new(angle, source, receiver, Wave::Point(dz_m), spectrum)),
                _ => None,
            };
            (space, Phased::new(angle, source, receiver, chain.wave(), &across))
        };
        let single = chain.single().map(|([source, receiver], angle)| {
            let (space, plane) = both(angle, source, receiver);
            (space, Phased(plane.0, plane.1 + chain.ahead_m()))
        });
        let mut each = Vec::new();
        if single.is_none() && matches!(chain.from, From::Point(..)) {
            let [[source, second], [first, receiver]] = chain.about();
            let far = |end: AboutEdge, own_m: f64| AboutEdge { r_m: over_m - own_m, ..end };
            for (corner, source, receiver) in [
                (chain.corners[0], source, far(second, source.r_m)),
                (chain.corners[1], far(first, receiver.r_m), receiver),
            ] {
                if let (Some(space), plane) = both(corner.exterior_angle, source, receiver) {
                    each.push((space, plane));
                }
            }
        }
        Some(Self { chain, over_m, sin_beta, nodes, single, each })
    }

    /// Length in m of the shortest way (plane wave: across the edges, from the first edge that shades).
    pub fn length_m(&self) -> f64 {
        if let From::Point(_, dz_m) = self.chain.from { self.over_m.hypot(dz_m) } else { self.over_m }
    }

    /// The pressure at the receiver at wave number `k` in 1/m, relative to the free field's modulus at 1 m.
    ///
    /// Phases are exp(i k length) from the source on (from the first edge on for a plane wave). The free field of a line
    /// source is sqrt(pi k/2) H0(k r), which tends to exp(i k r - i pi/4)/sqrt(r).
    pub fn pressure(&self, k: f64) -> Complex64 {
        let plane = self.across(k * self.sin_beta);
        if matches!(self.chain.from, From::Point(..)) { plane * self.to_space(k) } else { plane }
    }

    /// Where only one edge shades: what the other one adds to the pressure over this edge alone; `None` in the shadow of both.
    pub fn correction(&self, k: f64) -> Option<Complex64> {
        let (space, plane) = self.single.as_ref()?;
        let across = k * self.sin_beta;
        let change = self.across(across) - plane.total(across);
        Some(space.as_ref().map_or(change, |space| change * space.total(k) / plane.total(across)))
    }

    /// Green's integral over the portal: the pressure of a line source or plane wave at `k` across the edges.
    fn across(&self, k: f64) -> Complex64 {
        let sum: Complex64 = self
            .nodes
            .iter()
            .map(|node| {
                let [u, v] = [&node.source, &node.receiver].map(|fields| [fields[0].total(k), fields[1].total(k)]);
                // u dv/dn - v du/dn by central differences: the products of one side cancel.
                node.weight * (u[0] * v[1] - u[1] * v[0])
            })
            .sum();
        sum * Complex64::new(0.0, 0.25) / (0.5 * PI * k).sqrt()
    }

    /// The field of a point source over that of a line source at k sin(beta): as over the only edge that shades, or the
    /// ratio of the free fields over the way and what the single edges add to that.
    fn to_space(&self, k: f64) -> Complex64 {
        let across = k * self.sin_beta;
        if let Some((Some(space), plane)) = &self.single {
            return space.total(k) / plane.total(across);
        }
        let line = (0.5 * PI * across).sqrt() * scaled_hankel0(Complex64::from(across * self.over_m));
        let length = self.length_m();
        let free =
            Complex64::from_polar(1.0 / length, k * length) / (line * Complex64::from_polar(1.0, across * self.over_m));
        self.each.iter().fold(free, |ratio, (space, plane)| ratio * space.total(k) / plane.total(across) / free)
    }

    /// |p|^2 of the source's free field over `length_m`, and its intensity relative to 1 m.
    fn free(&self, length_m: f64, k: f64) -> [f64; 2] {
        match self.chain.from {
            From::Plane(..) => [1.0, 1.0],
            From::Point(..) => [1.0 / length_m.powi(2); 2],
            From::Line(_) => [scaled_hankel0(Complex64::from(k * length_m)).norm_sqr() * 0.5 * PI * k, 1.0 / length_m],
        }
    }

    fn frequencies(&self, spectrum: &Spectrum) -> impl Iterator<Item = (f64, f64)> {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let phase = (high - low) * self.chain.detour_m();
        gauss_nodes(low, high, if high > low { 5 + (0.7 * phase).ceil() as usize } else { 1 })
    }

    /// Band mean of |p|^2 relative to the free field at 1 m (for a line source of |p/p_free|^2 times 1/r).
    pub fn mean(&self, spectrum: &Spectrum) -> f64 {
        let straight = match self.chain.from {
            From::Line(s) => s.distance(self.chain.to),
            From::Point(s, dz_m) => s.distance(self.chain.to).hypot(dz_m),
            From::Plane(..) => 1.0,
        };
        let power = |k: f64| {
            let [free, intensity] = self.free(straight, k);
            self.pressure(k).norm_sqr() * intensity / free
        };
        self.frequencies(spectrum).map(|(k, weight)| weight * power(k)).sum()
    }

    /// Where only one edge shades: band mean of |p|^2 over that of this edge alone; `None` in the shadow of both.
    pub fn change(&self, spectrum: &Spectrum) -> Option<f64> {
        let (_, single) = self.single.as_ref()?;
        let (mut both, mut alone) = (0.0, 0.0);
        for (k, weight) in self.frequencies(spectrum) {
            let k = k * self.sin_beta;
            both += weight * self.across(k).norm_sqr();
            alone += weight * single.total(k).norm_sqr();
        }
        (alone > 0.0).then_some(both / alone)
    }
}

/// The line between two edges on which their fields meet.
struct Portal<'a> {
    chain: &'a Chain,
    /// Where the way from edge to edge crosses it.
    middle: DVec2,
    /// From edge to edge, and along the portal into the air.
    forth: DVec2,
    up: DVec2,
    /// Where it meets a face, in m along `up`.
    limits: [f64; 2],
}

impl<'a> Portal<'a> {
    /// At right angles to the way from edge to edge, in the middle of what of this lies between source and receiver.
    fn new(chain: &'a Chain) -> Option<Self> {
        let [first, second] = chain.corners;
        let between = first.at.distance(second.at);
        let forth = (second.at - first.at) / between;
        let outwards = first.outwards() + second.outwards();
        let up = if forth.perp().dot(outwards) > 0.0 { forth.perp() } else { -forth.perp() };
        let start = match chain.from {
            From::Line(s) | From::Point(s, _) => (s - first.at).dot(forth).max(0.0),
            From::Plane(..) => 0.0,
        };
        let end = (chain.to - first.at).dot(forth).min(between);
        if end - start <= 1e-3 * between {
            return None;
        }
        let middle = first.at + forth * (0.5 * (start + end));
        let mut limits = [if chain.common_face { 0.0 } else { f64::NEG_INFINITY }, f64::INFINITY];
        for corner in &chain.corners {
            let (sin, cos) = corner.exterior_angle.sin_cos();
            for face in [corner.face_a, corner.face_a * cos + corner.normal_a * sin] {
                let way = (middle - corner.at).dot(forth) / face.dot(forth);
                let y = (corner.at + face * way - middle).dot(up);
                if way > 0.0 && y < -1e-9 * between {
                    limits[0] = limits[0].max(y);
                } else if way > 0.0 && y > 1e-9 * between {
                    limits[1] = limits[1].min(y);
                }
            }
        }
        Some(Self { chain, middle, forth, up, limits })
    }

    fn at(&self, y: f64) -> DVec2 {
        self.middle + self.up * y
    }

    /// Ways over `y` from source or first edge to second edge or receiver.
    fn ways(&self, y: f64) -> [f64; 4] {
        let point = self.at(y);
        let [first, second] = self.chain.corners;
        let source = match self.chain.from {
            From::Line(s) | From::Point(s, _) => s.distance(point),
            From::Plane(d, _) => d.dot(point - first.at),
        };
        let (edge, next, end) = (first.at.distance(point), second.at.distance(point), self.chain.to.distance(point));
        [edge + next, edge + end, source + next, source + end]
    }

    /// Where the straight lines of `ways` cross the portal, but not below the edges.
    fn crossings(&self) -> [f64; 4] {
        let [first, second] = self.chain.corners;
        let local = |p: DVec2| ((p - self.middle).dot(self.forth), (p - self.middle).dot(self.up));
        let cross = |(x1, y1): (f64, f64), to: DVec2| {
            let (x2, y2) = local(to);
            y1 - x1 * (y2 - y1) / (x2 - x1)
        };
        let source = |to: DVec2| match self.chain.from {
            From::Line(s) | From::Point(s, _) => cross(local(s), to),
            From::Plane(d, _) => {
                let (x, y) = local(to);
                if d.dot(self.forth) > 1e-6 { y - x * d.dot(self.up) / d.dot(self.forth) } else { 0.0 }
            }
        };
        let to = self.chain.to;
        [0.0, cross(local(first.at), to), source(second.at), source(to)].map(|y| y.clamp(0.0, self.limits[1]))
    }

    /// Distance in m to the nearest of edges, source and receiver.
    fn clearance(&self, y: f64) -> f64 {
        let point = self.at(y);
        let [first, second] = self.chain.corners;
        let near = first.at.distance(point).min(second.at.distance(point)).min(self.chain.to.distance(point));
        match self.chain.from {
            From::Line(s) | From::Point(s, _) => near.min(s.distance(point)),
            From::Plane(..) => near,
        }
    }

    /// Gauss nodes on panels that follow the phase, upwards and, without a common face, downwards.
    fn nodes(&self, spectrum: &Spectrum) -> Vec<Node> {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let crossings = self.crossings();
        let least = std::array::from_fn::<f64, 4, _>(|n| self.ways(crossings[n])[n]);
        // The slowest phase; below the edges only their own waves arrive.
        let phase = |y: f64| {
            let ways = self.ways(y);
            let count = if y < 0.0 { 1 } else { 4 };
            (0..count)
                .map(|n| if y < crossings[n] && y >= 0.0 { 0.0 } else { low * (ways[n] - least[n]) })
                .fold(f64::INFINITY, f64::min)
        };
        let rule: Vec<(f64, f64)> = gauss_nodes(0.0, 1.0, 8).collect();
        let mut nodes = Vec::new();
        for (sign, limit) in [(1.0, self.limits[1]), (-1.0, -self.limits[0])] {
            let mut y = 0.0_f64;
            while y < limit && phase(sign * y) < FADE[1] {
                let mut length = self.clearance(sign * y).min(limit - y);
                let now = self.ways(sign * y);
                let turn = |length: f64| {
                    let then = self.ways(sign * (y + length));
                    (0..4).map(|n| (then[n] - now[n]).abs()).fold(0.0, f64::max) * high
                };
                while turn(length) > PANEL_PHASE {
                    length *= 0.8;
                }
                for (share, weight) in &rule {
                    let at = y + share * length;
                    let t = ((phase(sign * at) - FADE[0]) / (FADE[1] - FADE[0])).clamp(0.0, 1.0);
                    let fade = 1.0 - t * t * t * (10.0 - t * (15.0 - 6.0 * t));
                    if fade > 0.0 {
                        nodes.push(self.node(sign * at, weight * length * fade, spectrum));
                    }
                }
                y += length;
            }
        }
        nodes
    }

    fn node(&self, y: f64, weight_m: f64, spectrum: &Spectrum) -> Node {
        let step = SLOPE * self.clearance(y).min(1.0 / spectrum.high_k());
        let [first, second] = self.chain.corners;
        let sides = [self.at(y) - self.forth * step, self.at(y) + self.forth * step];
        let source = self.chain.source_about(&first);
        let receiver = second.about(self.chain.to);
        let (wave, spectrum) = (self.chain.wave(), spectrum);
        Node {
            weight: weight_m / (2.0 * step),
            source: sides.map(|p| Phased::new(first.exterior_angle, source, first.about(p), wave, spectrum)),
            receiver: sides
                .map(|p| Phased::new(second.exterior_angle, receiver, second.about(p), Wave::Line, spectrum)),
        }
    }
}
