//! The closed form for wide openings in one plane: signed rays from the openings, their jambs and the midpoints.
//!
//! A rigid jamb acts like the Kirchhoff opening (obliquity cos sigma) plus a line source of strength
//! -Lambda/(4 pi i cos sigma) on the jamb. The Wigner distribution of the sum over all openings P and jambs j is a
//! sum over pairs of these elements, each on the midpoints of its pair (docs/physics.md, eq. 5a-c and section 2):
//!
//! * opening and opening: `cos^2 sigma * [separations(h2) - separations(h1)]`,
//! * opening and jamb: `-mean sin(4 pi (x - x_j) nu) / (pi sin beta)`,
//! * jamb and jamb: `Lambda cos(k d) / (8 pi^2 sin^2 beta cos^2 sigma)` (half of it for a jamb with itself).
//!
//! For one opening these are eq. (5a), (5b) and (5c). Midpoints of two openings lie on the opaque parts between them:
//! signed rays leave there too (net power zero), and they are what makes two gaps interfere.

use std::f64::consts::PI;

use super::crossing::{Crossing, Incident, Ray, Spectrum};
use super::hankel::sin_cos;
use super::quadrature::{MOST_NODES, Panel, RaySum, Rule, integrate, nodes_for};

/// What an edge does besides cutting the field off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Jambs {
    /// Rigid jambs: eq. (5a-c).
    Rigid,
    /// The published small-angle form: no obliquity, no jamb rays.
    Paraxial,
}

/// Phase in radians, at the lower band edge, over which the rays of an unbounded opening fade out.
const FADE: [f64; 2] = [6.0 * PI, 18.0 * PI];
/// Phase per metre is finite everywhere, so this many doublings from a millionth of the geometry's size suffice.
const MAX_DOUBLINGS: usize = 80;

/// Most bisections of a piece for a source or receiver next to it.
const MAX_DEPTH: usize = 24;
/// Digits of the first sum over rays, relative to its absolute terms, and most of the second.
const DIGITS: f64 = 4.0;
const MOST_DIGITS: f64 = 12.0;
/// Distance of Gauss nodes in the outer quarters of a panel, relative to the middle: sqrt(1 - t^2) at t = 2/3.
const OUTER_QUARTER: f64 = 0.75;
/// Longest half length of a panel over the distance of the nearest singularity of the spreading.
const LONGEST_PANEL: f64 = 1.6;

/// Openings in one plane: disjoint open intervals along x in m, ascending; the outermost limits may be infinite.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    openings: Vec<[f64; 2]>,
    jambs: Vec<f64>,
    /// The pairs that integrals belong to, with rigid jambs.
    terms: Vec<Term>,
}

/// One pair of elements on a range of midpoints.
#[derive(Debug, Clone, PartialEq)]
struct Term {
    range: [f64; 2],
    /// Separations h2 and h1 as `slope * (x - x0)`; `None`: no opening-opening part.
    upper: Option<Line>,
    lower: Option<Line>,
    /// Jamb of an opening-jamb pair.
    jamb: Option<f64>,
    /// 1 for an element with itself, 2 for a pair of different ones.
    multiplicity: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    slope: f64,
    x0_m: f64,
}

impl Line {
    fn at(self, x: f64) -> f64 {
        self.slope * (x - self.x0_m)
    }
}

impl Mask {
    /// Sorts the openings and joins those that touch; empty ones are dropped.
    pub fn new(openings: &[[f64; 2]]) -> Self {
        let mut sorted: Vec<[f64; 2]> = openings.iter().copied().filter(|o| o[1] > o[0]).collect();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut joined: Vec<[f64; 2]> = Vec::with_capacity(sorted.len());
        for opening in sorted {
            match joined.last_mut() {
                Some(last) if opening[0] <= last[1] => last[1] = last[1].max(opening[1]),
                _ => joined.push(opening),
            }
        }
        let jambs = joined.iter().flatten().copied().filter(|x| x.is_finite()).collect();
        let mut mask = Self { openings: joined, jambs, terms: Vec::new() };
        mask.terms = mask.pairs(Jambs::Rigid);
        mask
    }

    /// The openings, disjoint and ascending.
    pub fn openings(&self) -> &[[f64; 2]] {
        &self.openings
    }

    /// Intensity behind the mask relative to the source's free field at 1 m, as the sum over signed rays.
    ///
    /// `tolerance` is the relative accuracy asked of the quadrature. Validity: every opening wider than about
    /// k a = 4 (rigid jambs; errors in docs/physics.md section 3); narrower ones need
    /// [`Aperture`](super::aperture::Aperture).
    pub fn intensity(&self, crossing: &Crossing, spectrum: &Spectrum, jambs: Jambs, tolerance: f64) -> RaySum {
        if self.jambs.is_empty() {
            let value = if self.openings.is_empty() { 0.0 } else { crossing.free_intensity() };
            return RaySum { value, absolute: value, ..RaySum::default() };
        }
        if jambs == Jambs::Rigid && self.openings.iter().flatten().all(|x| x.is_finite()) {
            return self.resolved(crossing, spectrum, tolerance);
        }
        let terms = self.pairs(jambs);
        let first = self.sum(&terms, crossing, spectrum, jambs, f64::INFINITY);
        if first.error <= tolerance * first.value.abs() {
            return first;
        }
        let bound = tolerance * first.value.abs().max(1e-9 * first.absolute);
        let second = self.sum(&terms, crossing, spectrum, jambs, bound);
        RaySum { rays: first.rays + second.rays, ..second }
    }

    /// Finite openings on Gauss nodes: as many as the phase asks for, and again with more where the sum is too small a
    /// difference of large terms.
    fn resolved(&self, crossing: &Crossing, spectrum: &Spectrum, tolerance: f64) -> RaySum {
        let jambs = self.jamb_pairs(crossing, spectrum);
        let add = |digits: f64| {
            let mut sum = jambs;
            for term in &self.terms {
                term.panels(term.range, crossing, spectrum, digits, MAX_DEPTH, &mut sum);
            }
            sum
        };
        let first = add(DIGITS);
        let missing = (first.error / (tolerance * first.value.max(1e-9 * first.absolute))).log10();
        if missing <= 0.0 {
            return first;
        }
        let second = add((DIGITS + missing.ceil()).min(MOST_DIGITS));
        RaySum { rays: first.rays + second.rays, ..second }
    }

    fn sum(&self, terms: &[Term], crossing: &Crossing, spectrum: &Spectrum, jambs: Jambs, tolerance: f64) -> RaySum {
        let mut sum = RaySum::default();
        let share = tolerance / terms.len() as f64;
        for term in terms {
            sum += term.integrate(crossing, spectrum, jambs, share);
        }
        if jambs == Jambs::Rigid {
            sum += self.jamb_pairs(crossing, spectrum);
        }
        sum
    }

    /// The pairs (opening, opening) and (opening, jamb) with the midpoints they live on.
    fn pairs(&self, jambs: Jambs) -> Vec<Term> {
        let rigid = jambs == Jambs::Rigid;
        let mut terms = Vec::new();
        for (i, p) in self.openings.iter().enumerate() {
            // An opening with itself and its own two jambs: the nearest jamb counts (eq. 5a).
            let middle = 0.5 * (p[0] + p[1]);
            for (jamb, other, slope) in [(p[0], p[1], 4.0), (p[1], p[0], -4.0)] {
                if jamb.is_finite() {
                    let end = if other.is_finite() { middle } else { other };
                    terms.push(Term {
                        range: [jamb.min(end), jamb.max(end)],
                        upper: Some(Line { slope: 0.5 * slope, x0_m: jamb }),
                        lower: None,
                        jamb: rigid.then_some(jamb),
                        multiplicity: 1.0,
                    });
                }
            }
            for q in &self.openings[i + 1..] {
                self.push_opening_pair(&mut terms, *p, *q);
            }
            if rigid {
                for &jamb in self.jambs.iter().filter(|j| !p.contains(j)) {
                    terms.push(Term {
                        range: [0.5 * (p[0] + jamb), 0.5 * (p[1] + jamb)],
                        upper: None,
                        lower: None,
                        jamb: Some(jamb),
                        multiplicity: 1.0,
                    });
                }
            }
        }
        terms
    }

    /// Midpoints x of a point of `q` and a point of `p` (left of it): h runs from h1 to h2 where x + h/2 lies in q and
    /// x - h/2 in p.
    fn push_opening_pair(&self, terms: &mut Vec<Term>, p: [f64; 2], q: [f64; 2]) {
        let nearer_q = Line { slope: -2.0, x0_m: q[0] };
        let nearer_p = Line { slope: 2.0, x0_m: p[1] };
        let farther_q = Line { slope: -2.0, x0_m: q[1] };
        let farther_p = Line { slope: 2.0, x0_m: p[0] };
        let lower_switch = 0.5 * (q[0] + p[1]);
        let upper_switch = 0.5 * (q[1] + p[0]);
        let mut breaks = [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), lower_switch, upper_switch];
        breaks.sort_by(f64::total_cmp);
        for w in breaks.windows(2).filter(|w| w[1] > w[0]) {
            let left_of = |limit: f64| w[1] <= limit;
            terms.push(Term {
                range: [w[0], w[1]],
                upper: Some(if left_of(upper_switch) { farther_p } else { farther_q }),
                lower: Some(if left_of(lower_switch) { nearer_q } else { nearer_p }),
                jamb: None,
                multiplicity: 2.0,
            });
        }
    }

    /// Jamb rays and the rays at the midpoints of two jambs, eq. (5b) and (5c).
    fn jamb_pairs(&self, crossing: &Crossing, spectrum: &Spectrum) -> RaySum {
        let mut sum = RaySum::default();
        let strengths: Vec<f64> = self
            .jambs
            .iter()
            .map(|&x| {
                let ray = crossing.ray(x);
                ray.spread.sqrt() / (4.0 * PI * ray.sin_beta * ray.cos_sigma().max(1e-9))
            })
            .collect();
        for (i, &a) in self.jambs.iter().enumerate() {
            let mut add = |value: f64| sum += RaySum { value, error: 0.0, absolute: value.abs(), rays: 1 };
            add(spectrum.mean_wavelength_m() * strengths[i].powi(2));
            for (j, &b) in self.jambs.iter().enumerate().skip(i + 1) {
                let detour = (crossing.length_m(b) - crossing.length_m(a)) * crossing.ray(0.5 * (a + b)).sin_beta;
                add(2.0 * spectrum.mean_wavelength_cos_m(detour) * strengths[i] * strengths[j]);
            }
        }
        sum
    }
}

impl Term {
    fn value(&self, x: f64, ray: &Ray, spectrum: &Spectrum, jambs: Jambs) -> f64 {
        let delta = ray.delta();
        let mut weight = 0.0;
        if let Some(upper) = self.upper {
            let lower = self.lower.map_or(0.0, |l| spectrum.separations(l.at(x), delta));
            // h runs over both signs: an opening with itself from -h2 to h2, two different ones as two ordered pairs.
            let both = if self.lower.is_none() { 2.0 } else { self.multiplicity };
            let obliquity = if jambs == Jambs::Rigid { ray.cos_sigma().powi(2) } else { 1.0 };
            weight += both * (spectrum.separations(upper.at(x), delta) - lower) * obliquity;
        }
        if let Some(jamb) = self.jamb {
            let a = 4.0 * PI * (x - jamb) * delta / spectrum.speed_m_s;
            weight -= spectrum.mean_sin(a) / (PI * ray.sin_beta);
        }
        weight * ray.spread
    }

    /// Phase 2 pi h nu in radians at wave number `k`, of the faster of the pair's terms.
    fn phase(&self, x: f64, crossing: &Crossing, k: f64) -> f64 {
        let h = match (self.upper, self.jamb) {
            (Some(upper), _) => upper.at(x),
            (None, Some(jamb)) => 2.0 * (x - jamb),
            (None, None) => 0.0,
        };
        k * h * crossing.ray(x).delta()
    }

    /// Adds the integral over `range`, bisected until one rule holds a panel's phase and the source and the receiver are
    /// not much nearer to it than it is long.
    fn panels(
        &self,
        [a, b]: [f64; 2],
        crossing: &Crossing,
        spectrum: &Spectrum,
        digits: f64,
        depth: usize,
        sum: &mut RaySum,
    ) {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        let k = spectrum.high_k();
        // Changes of phase over the quarters. Gauss nodes are denser towards the ends.
        let mut last = self.phase(a, crossing, k);
        let quarters = [-0.5, 0.0, 0.5, 1.0].map(|share| {
            let before = std::mem::replace(&mut last, self.phase(middle + share * half, crossing, k));
            (last - before).abs()
        });
        let [first, second, third, fourth] = quarters;
        let fastest = second.max(third).max(OUTER_QUARTER * first.max(fourth));
        let phase = (4.0 * fastest).max(first + second + third + fourth);
        let near = |x: f64, z: f64| (x - middle) * (x - middle) + z * z;
        let singular = match crossing.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => near(x_m, z_m),
            Incident::Plane { .. } => f64::INFINITY,
        };
        let distance = singular.min(near(crossing.x_m, crossing.z_m)).sqrt();
        let nodes = nodes_for(digits, phase, distance / half);
        if depth > 0 && (half > LONGEST_PANEL * distance || nodes > MOST_NODES as f64) {
            self.panels([a, middle], crossing, spectrum, digits, depth - 1, sum);
            self.panels([middle, b], crossing, spectrum, digits, depth - 1, sum);
        } else {
            *sum += self.gauss(Rule::of(nodes.ceil() as usize), [a, b], digits, crossing, spectrum);
        }
    }

    /// One panel. The kind of source and of term is chosen outside the loop over rays.
    fn gauss(&self, rule: &Rule, [a, b]: [f64; 2], digits: f64, crossing: &Crossing, spectrum: &Spectrum) -> RaySum {
        let panel = Panel { rule, a, b, accuracy: 10f64.powf(-digits) };
        let receiver = (crossing.x_m, crossing.z_m);
        match crossing.incident {
            Incident::Line { x_m, z_m } => {
                self.gauss_along(&panel, spectrum, |x| Ray::from_line((x_m, z_m), receiver, x))
            }
            Incident::Point { x_m, z_m, dy_m } => {
                let dy_square = dy_m * dy_m;
                self.gauss_along(&panel, spectrum, |x| Ray::from_point((x_m, z_m), receiver, dy_square, x))
            }
            Incident::Plane { s_x, s_y } => {
                let sin_beta = (1.0 - s_y * s_y).sqrt();
                let sin_i = s_x / sin_beta;
                self.gauss_along(&panel, spectrum, |x| Ray::from_plane(sin_i, sin_beta, receiver, x))
            }
        }
    }

    /// The terms of [`value`](Self::value) with their common factors and no branches.
    #[inline(always)]
    fn gauss_along(&self, panel: &Panel<'_>, spectrum: &Spectrum, ray: impl Fn(f64) -> Ray) -> RaySum {
        let centre = 0.5 * (spectrum.low_hz + spectrum.high_hz);
        let ratio = 0.5 * (spectrum.high_hz - spectrum.low_hz) / centre;
        let per_m = centre / spectrum.speed_m_s;
        // sin(A) and sin(B)/B for h metres, B = ratio A: the phase at the centre and half its change over the band. The
        // tiny number is the limit at 0.
        let sines = |h: f64, delta: f64| {
            let phase = 2.0 * PI * per_m * h * delta + 1e-150;
            let change = ratio * phase + 1e-150;
            (phase, sin_cos(phase).0, sin_cos(change).0 / change)
        };
        let separations = |h: f64, delta: f64| {
            let (phase, sine, change) = sines(h, delta);
            per_m * h * sine / phase * change
        };
        match (self.upper, self.lower, self.jamb) {
            (Some(upper), None, Some(jamb)) => {
                // An opening with itself and its nearest jamb: both have the phase of h = 2 L.
                let side = upper.slope.signum() / PI;
                panel.integrate(|x| {
                    let r = ray(x);
                    let h = 2.0 * (x - jamb).abs();
                    let (phase, sine, change) = sines(h, r.delta());
                    let area = 2.0 * per_m * h / phase * r.cos_sigma_square();
                    r.spread * sine * change * (area - side / r.sin_beta)
                })
            }
            (Some(upper), Some(lower), None) => panel.integrate(|x| {
                let r = ray(x);
                let delta = r.delta();
                let weight = separations(upper.at(x), delta) - separations(lower.at(x), delta);
                r.spread * self.multiplicity * weight * r.cos_sigma_square()
            }),
            (None, None, Some(jamb)) => panel.integrate(|x| {
                let r = ray(x);
                let (_, sine, change) = sines(2.0 * (x - jamb), r.delta());
                -r.spread * sine * change / (PI * r.sin_beta)
            }),
            // `pairs` makes no other kinds for rigid jambs; this one sums all parts that there may be.
            _ => panel.integrate(|x| self.value(x, &ray(x), spectrum, Jambs::Rigid)),
        }
    }

    fn integrate(&self, crossing: &Crossing, spectrum: &Spectrum, jambs: Jambs, tolerance: f64) -> RaySum {
        let [a, b] = self.range;
        let high = |x: f64| self.phase(x, crossing, spectrum.high_k());
        let straight = crossing.straight_x_m();
        let piece = |f: &mut dyn FnMut(f64) -> f64, a: f64, b: f64| {
            let mut sum = RaySum::default();
            let cut = straight.clamp(a, b);
            let mut f = f;
            sum += integrate(&mut f, &high, a, cut, 0.5 * tolerance);
            sum += integrate(&mut f, &high, cut, b, 0.5 * tolerance);
            sum
        };
        let mut plain = |x: f64| self.value(x, &crossing.ray(x), spectrum, jambs);
        if a.is_finite() && b.is_finite() {
            return piece(&mut plain, a, b);
        }
        // An unbounded opening: beyond the straight line the terms oscillate faster and faster. They are faded out
        // smoothly over phases FADE, which changes the integral by less than 1e-4 of its edge contribution.
        let (edge, sign) = if a.is_finite() { (a, 1.0) } else { (b, -1.0) };
        let low = |x: f64| self.phase(x, crossing, spectrum.low_k()).abs();
        let start = if sign * (straight - edge) > 0.0 { straight } else { edge };
        let reach = |phase: f64| {
            let mut step = 1e-6 * crossing.length_m(start).abs().max(crossing.z_m);
            for _ in 0..MAX_DOUBLINGS {
                if low(start + sign * step) >= phase {
                    break;
                }
                step *= 1.25;
            }
            start + sign * step
        };
        let end = reach(FADE[1]);
        let mut faded = |x: f64| {
            let beyond = sign * (x - start) > 0.0;
            let t = if beyond { ((low(x) - FADE[0]) / (FADE[1] - FADE[0])).clamp(0.0, 1.0) } else { 0.0 };
            let keep = 1.0 - t * t * t * (10.0 - t * (15.0 - 6.0 * t));
            keep * plain(x)
        };
        piece(&mut faded, edge.min(end), edge.max(end))
    }
}
