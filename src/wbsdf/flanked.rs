//! Openings with edges before or behind them: a door and then the corner of a wall, a barrier and then a window.
//!
//! With S the operator of the exact aperture (docs/physics.md, eq. 8, 8a), what a source sends through an opening is
//! p = g_r S^-1 g_s: g_s is the field of the source on the opening as if there were no wall, g_r that of a source in the
//! receiver. Edges on either side only change g_s or g_r: from a place x in the opening
//!
//! ```text
//! g(x) = [free field, where the end is in sight of x] + sum over the edges in sight of both of what each one diffracts
//! ```
//!
//! with the exact wedge (9), so that g is smooth over every shadow boundary, also one that lies across the opening. What is
//! left out are the waves that an edge returns to the wall of the opening, and from edge to edge. In space (a point source) the
//! field is that of a line source at k sin(beta), spread along the edges over the shortest way.

use std::f64::consts::PI;

use glam::DVec2;
use num_complex::Complex64;

use super::chain::Corner;
use super::crossing::Spectrum;
use super::edge::AboutEdge;
use super::mask::Mask;
use super::slit::{MOST_FREQUENCIES, Solver, depths_of, gauss_nodes, resonances};
use super::thick::blended;
use super::wedge::{Wave, WedgeField, free_wave};

/// Most frequencies a band for wide openings.
const MOST_OF_WIDE: usize = 48;

/// Where sound comes from or goes to, in the frame of the opening: x across its edges, z along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum End {
    /// A line along the edges, or a point.
    At(DVec2),
    /// A plane wave that travels along this unit vector.
    Along(DVec2),
}

impl End {
    fn about(&self, corner: &Corner) -> AboutEdge {
        match *self {
            Self::At(place) => corner.about(place),
            Self::Along(d) => AboutEdge { r_m: f64::INFINITY, phi: corner.angle(-d) },
        }
    }

    /// Length in m of the free way to a place; of a plane wave from the wave front through the origin.
    pub fn length_m(&self, to: DVec2) -> f64 {
        match *self {
            Self::At(place) => place.distance(to),
            Self::Along(d) => d.dot(to),
        }
    }
}

/// An edge on one side of the opening.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bend {
    /// The edge.
    pub corner: Corner,
    /// The end as this edge meets it.
    pub end: End,
    /// Whether the wave belongs to the path that makes the direct sound continuous, and those that belong to the reflections
    /// by face A and face B.
    pub parts: [bool; 3],
    /// Pressure reflection factors that the waves of face A and face B carry.
    pub faces: [f64; 2],
}

impl Bend {
    /// Angle between the end and a place about the edge: from pi on the place is in its shadow.
    pub fn span(&self, at: DVec2) -> f64 {
        (self.end.about(&self.corner).phi - self.corner.about(at).phi).abs()
    }

    /// Sum of both angles: below pi face A reflects; above twice the edge's angle less pi face B.
    pub fn sum(&self, at: DVec2) -> f64 {
        self.end.about(&self.corner).phi + self.corner.about(at).phi
    }

    /// Whether the end's mirror image in face A (0) or B (1) is in sight of a place past the edge.
    pub fn reflects(&self, at: DVec2, face: usize) -> bool {
        match face {
            0 => self.sum(at) < PI,
            _ => self.sum(at) > 2.0 * self.corner.exterior_angle - PI,
        }
    }

    /// By how much in m the way over the edge to a place is longer than that of the end's mirror image in face A (0) or B (1).
    pub fn past_face_m(&self, at: DVec2, face: usize) -> f64 {
        let (end, place) = (self.end.about(&self.corner), self.corner.about(at));
        let sum = end.phi + place.phi;
        let beside = 1.0 + [sum, 2.0 * self.corner.exterior_angle - sum][face].cos();
        if end.r_m.is_infinite() {
            return place.r_m * beside;
        }
        let over_m = end.r_m + place.r_m;
        over_m - (over_m * over_m - 2.0 * end.r_m * place.r_m * beside).max(0.0).sqrt()
    }

    /// The end's mirror image in face A (0) or B (1).
    pub fn mirrored(&self, face: usize) -> End {
        let Corner { at, face_a, normal_a, exterior_angle } = self.corner;
        let (sin, cos) = exterior_angle.sin_cos();
        let normal = [normal_a, normal_a * cos - face_a * sin][face];
        let mirror = |v: DVec2| v - normal * (2.0 * v.dot(normal));
        match self.end {
            End::At(place) => End::At(at + mirror(place - at)),
            End::Along(d) => End::Along(mirror(d)),
        }
    }

    /// Whether the shortest way to a place leads over the edge.
    fn hides(&self, at: DVec2) -> bool {
        match self.parts[0] {
            true => self.span(at) > PI,
            false => ![0, 1].into_iter().any(|face| self.parts[1 + face] && self.reflects(at, face)),
        }
    }

    /// Length in m of the way over the edge to a place; of a plane wave from the wave front through the origin.
    pub fn length_m(&self, to: DVec2) -> f64 {
        self.end.length_m(self.corner.at) + self.corner.at.distance(to)
    }
}

/// What a place in the opening sees of one side: the end itself, and its edges together with the end.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// The end.
    pub direct: bool,
    /// Its edges, in the order of [`Flank::bends`].
    pub bends: Vec<bool>,
}

/// One side of the opening.
#[derive(Debug, Clone, PartialEq)]
pub struct Flank {
    /// Where its sound comes from or goes to.
    pub end: End,
    /// Whether that is on this side of the wall; else nothing comes but over edges.
    pub faces: bool,
    /// The edges between that and the opening.
    pub bends: Vec<Bend>,
}

impl Flank {
    /// Length in m of the shortest way to a place in the opening, as if each edge stood there alone.
    pub fn length_m(&self, to: DVec2) -> f64 {
        let over = |bend: &Bend| if !self.faces || bend.hides(to) { bend.length_m(to) } else { f64::INFINITY };
        let shaded = self.bends.iter().map(over).fold(f64::INFINITY, f64::min);
        if shaded.is_finite() { shaded } else { self.end.length_m(to) }
    }
}

/// The field of one side at one place in the opening.
struct Known {
    direct_m: Option<f64>,
    wave: Wave,
    /// Field of the edge, factors of its three parts, length in m of the way its phases count from, and the share of the direct
    /// sound that belongs to it exactly on its boundary.
    bends: Vec<(WedgeField, [f64; 3], f64, f64)>,
}

impl Known {
    fn new(flank: &Flank, sight: &Sight, at: DVec2, spectrum: &Spectrum) -> Self {
        let wave = if let End::Along(_) = flank.end { Wave::Plane } else { Wave::Line };
        let seen = flank.bends.iter().zip(&sight.bends).filter(|(_, seen)| **seen);
        let bends = seen.map(|(bend, _)| {
            let to = bend.corner.about(at);
            let field = WedgeField::new(bend.corner.exterior_angle, bend.end.about(&bend.corner), to, wave, spectrum);
            let [missing, _] = field.missing([sight.direct, false]);
            let factors = [(0, 1.0), (1, bend.faces[0]), (2, bend.faces[1])];
            let parts = factors.map(|(part, factor)| if bend.parts[part] { factor } else { 0.0 });
            (field, parts, bend.length_m(at), missing)
        });
        Self { direct_m: sight.direct.then(|| flank.end.length_m(at)), wave, bends: bends.collect() }
    }

    fn at(&self, k: f64) -> Complex64 {
        let mut sum = self.direct_m.map_or(Complex64::ZERO, |length| free_wave(self.wave, length, k));
        for (field, parts, over_m, missing) in &self.bends {
            let sent = field.diffracted(k, |_| 1.0);
            let mut own = parts[0] * sent.incident + parts[1] * sent.faces[0] + parts[2] * sent.faces[1];
            if *missing != 0.0 && parts[0] > 0.0 {
                own += *missing * field.undisturbed(field.lengths_m()[0], k);
            }
            sum += own * Complex64::from_polar(1.0, k * over_m);
        }
        sum
    }
}

/// The factorised apertures of a band.
pub struct Apertures {
    /// Wave numbers in 1/m in space, and weights.
    nodes: Vec<(f64, f64)>,
    /// At each depth that counts.
    depths: Vec<AtDepth>,
    sin_beta: f64,
    /// The band as it is across the edges.
    across: Spectrum,
}

/// The apertures at one depth, all on the same places of the opening.
struct AtDepth {
    /// Its share of the intensity.
    share: f64,
    half_depth_m: f64,
    /// One a node, at its wave number across the edges.
    solvers: Vec<Solver>,
    /// Where the fields are asked for, in m across the opening.
    places_m: Vec<f64>,
}

impl AtDepth {
    fn places(&self, side: f64) -> impl Iterator<Item = DVec2> {
        self.places_m.iter().map(move |x| DVec2::new(*x, self.half_depth_m.copysign(side)))
    }
}

impl Apertures {
    /// `thickness_m`: of the wall, in the middle of which the frame's plane lies; `sin_beta`: sine of the angle between the rays
    /// and the edges. `None` for openings without an end.
    pub fn new(mask: &Mask, thickness_m: f64, spectrum: &Spectrum, sin_beta: f64) -> Option<Self> {
        let openings = mask.openings();
        if openings.is_empty() || openings.iter().flatten().any(|x| x.is_infinite()) {
            return None;
        }
        let depths = depths_of(mask, thickness_m);
        let deepest_m = depths.iter().fold(0.0_f64, |deepest, (_, depth_m)| deepest.max(*depth_m));
        let across = Spectrum { speed_m_s: spectrum.speed_m_s / sin_beta, ..*spectrum };
        let (low, high) = (across.low_k(), across.high_k());
        let span = openings[openings.len() - 1][1] - openings[0][0];
        // As for the opening alone, and some for edges in sight.
        let smooth = 0.5 * (high - low) * (span + deepest_m);
        let most = if deepest_m > 0.0 { MOST_FREQUENCIES } else { MOST_OF_WIDE };
        let count = match high > low {
            true => (8 + (smooth + resonances(openings, deepest_m, low, high)).ceil() as usize).min(most),
            false => 1,
        };
        let nodes: Vec<(f64, f64)> = gauss_nodes(spectrum.low_k(), spectrum.high_k(), count).collect();
        let at_depth = |(share, depth_m): (f64, f64)| {
            let solver = |(k, _): &(f64, f64)| Solver::resolved(mask, depth_m, k * sin_beta, high);
            let solvers: Vec<Solver> = nodes.iter().map(solver).collect();
            AtDepth { share, half_depth_m: 0.5 * depth_m, places_m: solvers[0].positions(), solvers }
        };
        let depths = depths.into_iter().map(at_depth).collect();
        Some(Self { nodes, depths, sin_beta, across })
    }

    /// The places in the mouths on the side of the sign of `side`.
    pub fn places(&self, side: f64) -> impl Iterator<Item = DVec2> {
        self.depths.iter().flat_map(move |depth| depth.places(side))
    }

    /// Pressures at the wave numbers of the band, of source and receiver: the sides of the wall where they meet it (sign of z)
    /// and what every place there sees of them.
    pub fn field(&self, flanks: [&Flank; 2], sides: [f64; 2], sights: [&[Sight]; 2]) -> FlankedField {
        let mut before = 0;
        let known = |depth: &AtDepth| {
            let first = before;
            before += depth.places_m.len();
            [0, 1].map(|n| -> Vec<Known> {
                let places = depth.places(sides[n]).zip(&sights[n][first..]);
                places.map(|(at, sight)| Known::new(flanks[n], sight, at, &self.across)).collect()
            })
        };
        let known: Vec<[Vec<Known>; 2]> = self.depths.iter().map(known).collect();
        let at = |(n, (k, weight)): (usize, &(f64, f64))| {
            let across = k * self.sin_beta;
            let pressure = |(depth, known): (&AtDepth, &[Vec<Known>; 2])| {
                let [into, out] = known.each_ref().map(|known| known.iter().map(|place| place.at(across)).collect());
                let out: Vec<Complex64> = out;
                // The receiver's field is in units of sqrt(pi k/2) H0.
                (depth.share, depth.solvers[n].couple(into, &out) / (0.5 * PI * across).sqrt())
            };
            (*k, *weight, blended(self.depths.iter().zip(&known).map(pressure)))
        };
        FlankedField { nodes: self.nodes.iter().enumerate().map(at).collect(), sin_beta: self.sin_beta }
    }
}

/// The pressure behind a flanked opening at the Gauss nodes of a band.
pub struct FlankedField {
    /// Wave number in 1/m in space, weight, and the pressure of a line source or plane wave across the edges.
    nodes: Vec<(f64, f64, Complex64)>,
    sin_beta: f64,
}

impl FlankedField {
    /// Band mean of |p/p_free|^2 across the edges, p_free over `straight_m`.
    pub fn mean(&self, wave: Wave, straight_m: f64) -> f64 {
        let free = |k: f64| free_wave(wave, straight_m, k * self.sin_beta).norm_sqr();
        self.nodes.iter().map(|(k, weight, p)| weight * p.norm_sqr() / free(*k)).sum()
    }

    /// The pressure at wave number `k` within the band without the phase of its way, `way_m` long across the edges:
    /// interpolated between the nodes. A line source's starts with -pi/4, as H0 does far away.
    pub fn envelope(&self, k: f64, way_m: f64) -> Complex64 {
        let value = |n: usize| {
            let (k, _, p) = self.nodes[n];
            p * Complex64::from_polar(1.0, -k * self.sin_beta * way_m)
        };
        let count = self.nodes.len();
        let (low, high) = (self.nodes[0].0, self.nodes[count - 1].0);
        let (mut sum, mut total) = (Complex64::ZERO, 0.0);
        for n in 0..count {
            let apart = k - self.nodes[n].0;
            if apart.abs() <= 1e-12 * k {
                return value(n);
            }
            // Barycentric weights of any nodes, scaled so that they do not overflow.
            let others =
                (0..count).filter(|m| *m != n).map(|m| 4.0 * (self.nodes[n].0 - self.nodes[m].0) / (high - low));
            let weight = 1.0 / (others.product::<f64>() * apart);
            sum += weight * value(n);
            total += weight;
        }
        sum / total
    }
}
