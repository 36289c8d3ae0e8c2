//! Openings in a thin rigid screen by the uniform theory of diffraction: rays over every jamb, and from jamb to jamb.
//!
//! Every jamb is the edge of a rigid half-plane ([`super::utd`]). What a thin screen scatters is odd about its plane, so
//! a ray from jamb to jamb across an opening has no pressure in the plane, only a slope: it diffracts by
//! (i/k) dD/dphi'. Along the strip between two openings it runs on both faces with opposite signs, each of which counts
//! half (incident and reflected in one). With h(c) = F(2 k L c^2)/c, h' = 4 i k L (1 - F) and D = C [h(c-) + h(c+)] of a
//! half-plane, C = -exp(i pi/4)/(2 sqrt(2 pi k)), such a ray is a product of these factors (derived for this program):
//!
//! ```text
//!                        across an opening                along a strip
//! leaves a jamb          -C cos(phi'/2) h'(sin phi'/2)    2 C h(cos phi'/2)          times exp(i k w)/w^(3/2), /w^(1/2)
//! from opening to        (i/k) C h'(1)/2                  -(i/k) C h'(0)             at a jamb in between
//! from strip to          -C h'(0)                         2 C h(1)
//! to the receiver        -(i/k) C cos(phi/2) h'(sin phi/2)    2 C h(cos phi/2)
//! ```

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use glam::DVec3;
use num_complex::Complex64;

use super::crossing::{Crossing, Incident};
use super::mask::Mask;
use super::rim::unfolded;
use super::utd::{Diffracted, Spread, Straight, THIN, distance_parameter, seen, transition};

/// The rays from one source through the openings of a screen to one receiver, ready for any wave number.
#[derive(Debug, Clone)]
pub struct OpeningRays {
    direct: Straight,
    single: Vec<Diffracted>,
    /// Factors of the rays over two and three jambs.
    factors: Vec<Factor>,
    multiple: Vec<Multiple>,
    /// sin(beta) of the shortest way over a jamb, for the factors.
    sin_beta: f64,
}

/// A ray over two or three jambs: its factors, its spreading and its length.
#[derive(Debug, Clone, Copy)]
struct Multiple {
    factors: [usize; 3],
    amplitude: f64,
    length_m: f64,
}

/// One factor: `constant` times k^(power/2) times a form of F at s = sqrt(k) `root`, k across the edges.
#[derive(Debug, Clone, Copy)]
struct Factor {
    constant: Complex64,
    power: i32,
    form: Form,
    root: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    One,
    OverRoot,
    Rest,
}

impl Factor {
    /// 2 C h(c), with h(c) = sign(c) sqrt(2 k L) F(s^2)/s.
    fn along_strip(cosine: f64, parameter_m: f64) -> Self {
        let root = (2.0 * parameter_m).sqrt();
        let constant = 2.0 * half_plane() * root * cosine.signum();
        Self { constant, power: 0, form: Form::OverRoot, root: root * cosine.abs() }
    }

    /// `weight` C h'(c), `weight` without k; `power`: of sqrt(k) in all.
    fn slope(weight: Complex64, sine: f64, parameter_m: f64, power: i32) -> Self {
        let constant = weight * half_plane() * 4.0 * Complex64::I * parameter_m;
        // 1 - F(0) = 1
        let form = if sine == 0.0 { Form::One } else { Form::Rest };
        Self { constant, power, form, root: (2.0 * parameter_m).sqrt() * sine.abs() }
    }

    fn at(&self, root_k: f64) -> Complex64 {
        let value = match self.form {
            Form::One => self.constant,
            Form::OverRoot => self.constant * transition(root_k * self.root).over_root,
            Form::Rest => self.constant * transition(root_k * self.root).rest,
        };
        match self.power {
            0 => value,
            power if power < 0 => value / root_k,
            _ => value * root_k,
        }
    }
}

/// C sqrt(k) of a half-plane.
fn half_plane() -> Complex64 {
    Complex64::from_polar(-0.5 * FRAC_1_SQRT_2 / PI.sqrt(), 0.25 * PI)
}

/// One jamb as source and receiver see it.
struct Jamb {
    x_m: f64,
    /// Distances across the edges in m; infinite from a plane wave.
    before_m: f64,
    behind_m: f64,
    /// Angles from the screen's face on the source's side, through the opening.
    from: f64,
    to: f64,
    /// Phase of the incident wave at the jamb as a length in space, relative to that of the way across the edges.
    ahead_m: f64,
}

/// A leg from jamb to neighbouring jamb.
#[derive(Clone, Copy)]
struct Leg {
    start: usize,
    end: usize,
    width_m: f64,
    /// Across an opening, not along a strip.
    open: bool,
}

impl Leg {
    /// Spreading over the leg; a slope falls with 1/w more.
    fn spread(&self) -> f64 {
        1.0 / self.width_m.sqrt() / if self.open { self.width_m } else { 1.0 }
    }
}

impl OpeningRays {
    /// `openings`: disjoint intervals along x in m, ascending ([`Mask::openings`](super::mask::Mask::openings)); the
    /// outermost limits may be infinite. Without any jamb the field is free.
    ///
    /// Validity: k times width above about 5 (octaves: median 0.003 dB, 90th percentile 0.04 dB, below 1 dB along the
    /// screen); at 1.5 to 5 the median is 0.02 dB, at 0.3 to 1.5 it is 0.13 dB; not for narrower openings. Rays over two
    /// and three jambs are in it; a point source's obliquity is taken over the nearest jamb for those.
    pub fn new(openings: &[[f64; 2]], crossing: &Crossing) -> Self {
        let (dy, s_y) = match crossing.incident {
            Incident::Point { dy_m, .. } => (Some(dy_m), 0.0),
            Incident::Plane { s_y, .. } => (None, s_y),
            Incident::Line { .. } => (None, 0.0),
        };
        let plane_sine = (1.0 - s_y * s_y).sqrt();
        let way = |across_m: f64| match crossing.incident {
            Incident::Plane { .. } => Spread { factor: 1.0, sin_beta: plane_sine, length_m: plane_sine * across_m },
            _ => Spread::new(across_m, dy),
        };
        // Jambs, and what each of the openings shows of the direct wave.
        let mut jambs = Vec::new();
        let mut shown = 0.0;
        // Whether the leg to the next jamb lies across an opening.
        let mut open = Vec::new();
        for opening in openings {
            let mut share = 1.0_f64;
            for (&x, side) in opening.iter().zip([1.0, -1.0]) {
                if x.is_finite() {
                    let jamb = Jamb::new(x, side, crossing, plane_sine);
                    share = share.min(seen(PI - (jamb.to - jamb.from)));
                    jambs.push(jamb);
                    open.push(side > 0.0);
                }
            }
            shown += share;
        }
        let single: Vec<Diffracted> = jambs
            .iter()
            .map(|j| {
                let spread = way(j.across_m(0.0));
                let parameter = distance_parameter(j.before_m, j.behind_m);
                let angles = (j.from, j.to);
                let length = spread.length_m + j.ahead_m;
                Diffracted::new(
                    THIN,
                    angles,
                    parameter,
                    spread.sin_beta,
                    length,
                    spread.factor * j.arrives() * j.leaves(),
                )
            })
            .collect();
        let nearest = jambs.iter().map(|j| j.across_m(0.0)).fold(f64::INFINITY, f64::min);
        let mut rays = Self {
            direct: straight(crossing, shown),
            single,
            factors: Vec::new(),
            multiple: Vec::new(),
            sin_beta: if jambs.is_empty() { 1.0 } else { way(nearest).sin_beta },
        };
        let mut legs = Vec::new();
        for (i, pair) in jambs.windows(2).enumerate() {
            let width_m = pair[1].x_m - pair[0].x_m;
            legs.push(Leg { start: i, end: i + 1, width_m, open: open[i] });
            legs.push(Leg { start: i + 1, end: i, width_m, open: open[i] });
        }
        rays.add_multiple(&jambs, &legs, way);
        rays
    }

    fn add_multiple(&mut self, jambs: &[Jamb], legs: &[Leg], way: impl Fn(f64) -> Spread) {
        // Factors 2i and 2i + 1: leaving the first jamb on leg i, reaching the receiver from its end.
        for leg in legs {
            let (start, end) = (&jambs[leg.start], &jambs[leg.end]);
            let out = distance_parameter(start.before_m, leg.width_m);
            let back = distance_parameter(leg.width_m, end.behind_m);
            let (leaves, reaches) = if leg.open {
                let ((sine, cosine), (sine_o, cosine_o)) = ((0.5 * start.from).sin_cos(), (0.5 * end.to).sin_cos());
                let reaches = Factor::slope(-Complex64::I * cosine_o, sine_o, back, -1);
                (Factor::slope(Complex64::from(-cosine), sine, out, 1), reaches)
            } else {
                (Factor::along_strip((0.5 * start.from).cos(), out), Factor::along_strip((0.5 * end.to).cos(), back))
            };
            self.factors.extend([leaves, reaches]);
        }
        for (i, leg) in legs.iter().enumerate() {
            let (start, end) = (&jambs[leg.start], &jambs[leg.end]);
            let spread = way(start.across_to(end, leg.width_m));
            let amplitude = spread.factor * start.arrives() * leg.spread() * end.leaves();
            let factors = [2 * i, usize::MAX, 2 * i + 1];
            self.multiple.push(Multiple { factors, amplitude, length_m: spread.length_m + start.ahead_m });
            for (j, next) in legs.iter().enumerate().filter(|(_, next)| next.start == leg.end) {
                let parameter = distance_parameter(leg.width_m, next.width_m);
                let turn = match (leg.open, next.open) {
                    (true, true) => Factor::slope(0.5 * Complex64::I, 1.0, parameter, -1),
                    (true, false) => Factor::slope(-Complex64::I, 0.0, parameter, -1),
                    (false, true) => Factor::slope(Complex64::from(-1.0), 0.0, parameter, 1),
                    (false, false) => Factor::along_strip(1.0, parameter),
                };
                self.factors.push(turn);
                let last = &jambs[next.end];
                let spread = way(start.across_to(last, leg.width_m + next.width_m));
                let amplitude = spread.factor * start.arrives() * leg.spread() * next.spread() * last.leaves();
                let factors = [2 * i, self.factors.len() - 1, 2 * j + 1];
                self.multiple.push(Multiple { factors, amplitude, length_m: spread.length_m + start.ahead_m });
            }
        }
    }

    /// Pressure behind the screen at wave number `k` in 1/m, relative to the free field's modulus over 1 m, with phase
    /// (plane wave: relative to its front through the portal's origin).
    pub fn pressure(&self, k: f64) -> Complex64 {
        let root_k = k.sqrt();
        let mut sum = self.direct.at(k);
        for ray in &self.single {
            sum += ray.at(k, root_k);
        }
        let across = root_k * self.sin_beta.sqrt();
        let factors: Vec<Complex64> = self.factors.iter().map(|f| f.at(across)).collect();
        for ray in &self.multiple {
            let [first, middle, last] = ray.factors;
            let product = factors[first] * factors[last] * factors.get(middle).copied().unwrap_or(Complex64::ONE);
            sum += product * Complex64::from_polar(ray.amplitude, k * ray.length_m);
        }
        sum
    }

    /// Largest difference in length between two rays over up to two jambs in m: how fast |p|^2 beats with k.
    pub fn detour_m(&self) -> f64 {
        let direct = (self.direct.amplitude > 0.0).then_some(self.direct.length_m);
        let twice = self.multiple.iter().filter(|ray| ray.factors[1] == usize::MAX).map(|ray| ray.length_m);
        let lengths = self.single.iter().map(|ray| ray.length_m).chain(twice).chain(direct);
        let range = |(low, high): (f64, f64), length: f64| (low.min(length), high.max(length));
        let (low, high) = lengths.fold((f64::INFINITY, f64::NEG_INFINITY), range);
        (high - low).max(0.0)
    }
}

impl Jamb {
    /// `side`: 1 where the opening lies towards growing x.
    fn new(x_m: f64, side: f64, crossing: &Crossing, plane_sine: f64) -> Self {
        let out = (x_m - crossing.x_m) * side;
        let to = TAU - crossing.z_m.atan2(out);
        let (before_m, from, ahead_m) = match crossing.incident {
            Incident::Line { x_m: x, z_m } | Incident::Point { x_m: x, z_m, .. } => {
                let back = (x_m - x) * side;
                (back.hypot(z_m), z_m.atan2(back), 0.0)
            }
            Incident::Plane { s_x, .. } => {
                let sin_i = s_x / plane_sine;
                (f64::INFINITY, (1.0 - sin_i * sin_i).max(0.0).sqrt().atan2(sin_i * side), s_x * x_m)
            }
        };
        Self { x_m, before_m, behind_m: out.hypot(crossing.z_m), from, to, ahead_m }
    }

    /// Length of the way across the edges from the source over this jamb, `between_m` and `last` to the receiver; from a
    /// plane wave's front through the jamb.
    fn across_to(&self, last: &Jamb, between_m: f64) -> f64 {
        between_m + last.behind_m + if self.before_m.is_finite() { self.before_m } else { 0.0 }
    }

    fn across_m(&self, between_m: f64) -> f64 {
        self.across_to(self, between_m)
    }

    /// 1/sqrt of the leg to the jamb; 1 for a plane wave.
    fn arrives(&self) -> f64 {
        if self.before_m.is_finite() { 1.0 / self.before_m.sqrt() } else { 1.0 }
    }

    fn leaves(&self) -> f64 {
        1.0 / self.behind_m.sqrt()
    }
}

/// The straight wave, of which the share `shown` is seen.
fn straight(crossing: &Crossing, shown: f64) -> Straight {
    let length_m = match crossing.incident {
        Incident::Line { x_m, z_m } => (crossing.x_m - x_m).hypot(crossing.z_m + z_m),
        Incident::Point { x_m, z_m, dy_m } => (crossing.x_m - x_m).hypot(crossing.z_m + z_m).hypot(dy_m),
        Incident::Plane { s_x, s_y } => {
            s_x * crossing.x_m + (1.0 - s_x * s_x - s_y * s_y).max(0.0).sqrt() * crossing.z_m
        }
    };
    Straight { length_m, amplitude: shown * crossing.free_intensity().sqrt() }
}

/// Rectangular openings by the coherent second opinion: the product of the transfers of their two directions, each with the
/// distances that the shortest way has when it is unfolded.
pub struct DoorRays {
    sides: [(OpeningRays, f64); 2],
    straight_m: f64,
}

impl DoorRays {
    /// From `from` to `to` (in m, in the frame of the openings `x` by `y`). `None`: no straight way leads through the plane.
    pub fn new(x: &Mask, y: &Mask, from: DVec3, to: DVec3) -> Option<Self> {
        let [across_x, across_y] = unfolded(x, y, from, to)?;
        let side = |mask: &Mask, crossing: &Crossing| {
            (OpeningRays::new(mask.openings(), crossing), 1.0 / crossing.free_intensity())
        };
        Some(Self { sides: [side(x, &across_x), side(y, &across_y)], straight_m: (to - from).length() })
    }

    /// Pressure relative to the free field at 1 m, with phase.
    pub fn pressure(&self, k: f64) -> Complex64 {
        let without =
            |(rays, length_m): &(OpeningRays, f64)| rays.pressure(k) * Complex64::from_polar(1.0, -k * length_m);
        let [x, y] = &self.sides;
        without(x) * without(y) * Complex64::from_polar(1.0, k * self.straight_m)
    }

    /// By how much in m its ways differ at most, along both sides together.
    pub fn detour_m(&self) -> f64 {
        self.sides.iter().map(|(rays, _)| rays.detour_m()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::super::aperture::Aperture;
    use super::super::edge::AboutEdge;
    use super::super::utd::{Turn, WedgeRays, two_edges};
    use super::super::wedge::Wave;
    use super::*;

    const LINE: Incident = Incident::Line { x_m: -0.4, z_m: 1.7 };
    const TWO: [[f64; 2]; 2] = [[-0.5, -0.1], [0.2, 0.9]];

    fn pressure(openings: &[[f64; 2]], incident: Incident, x_m: f64, z_m: f64, k: f64) -> Complex64 {
        OpeningRays::new(openings, &Crossing { incident, x_m, z_m }).pressure(k)
    }

    #[test]
    fn a_screen_with_one_jamb_is_a_half_plane() {
        let point = Incident::Point { x_m: 0.4, z_m: 1.7, dy_m: 0.8 };
        let got = pressure(&[[0.0, f64::INFINITY]], point, -0.9, 2.0, 6.0);
        let source = AboutEdge { r_m: 0.4_f64.hypot(1.7), phi: PI - 1.7_f64.atan2(0.4) };
        let receiver = AboutEdge { r_m: 0.9_f64.hypot(2.0), phi: TAU - 2.0_f64.atan2(0.9) };
        let rays = WedgeRays::new(TAU, source, receiver, Wave::Point(0.8)).field(6.0);
        // The same rays, but for the reflection, which no receiver behind the screen sees.
        assert!((got - rays.sum()).norm() < 1e-12 * got.norm(), "{got} {}", rays.sum());
    }

    #[test]
    fn source_and_receiver_may_change_places() {
        for openings in [&TWO[..1], &TWO[..]] {
            for dy in [None, Some(0.9)] {
                let at = |x_m: f64, z_m: f64| match dy {
                    Some(dy_m) => Incident::Point { x_m, z_m, dy_m },
                    None => Incident::Line { x_m, z_m },
                };
                let there = pressure(openings, at(-0.4, 1.7), 1.6, 0.5, 9.0);
                let back = pressure(openings, at(1.6, 0.5), -0.4, 1.7, 9.0);
                assert!((there - back).norm() < 1e-12 * there.norm(), "{openings:?} {dy:?}: {there} {back}");
            }
        }
    }

    #[test]
    fn the_field_is_continuous_where_an_opening_goes_out_of_sight() {
        // The straight line over the jamb at 0.9.
        let x = 0.9 + 1.3 * 2.0 / 1.7;
        let [before, on, after] = [-1e-8, 0.0, 1e-8].map(|dx| pressure(&TWO, LINE, x + dx, 2.0, 9.0));
        assert!((before - after).norm() < 1e-6 * on.norm() && (before - on).norm() < 1e-6 * on.norm());
    }

    #[test]
    fn rays_from_jamb_to_jamb_are_those_over_two_half_planes() {
        let crossing = Crossing { incident: LINE, x_m: 1.6, z_m: 0.5 };
        let rays = OpeningRays::new(&TWO, &crossing);
        let jambs: Vec<Jamb> =
            TWO.iter().flatten().zip([1.0, -1.0, 1.0, -1.0]).map(|(&x, s)| Jamb::new(x, s, &crossing, 1.0)).collect();
        let k = 9.0_f64;
        for (i, (a, b)) in [(0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2)].into_iter().enumerate() {
            let (start, end) = (&jambs[a], &jambs[b]);
            let legs = [start.before_m, (end.x_m - start.x_m).abs(), end.behind_m];
            let over = |way: f64, shared: bool| {
                let turn = |from, to| Turn { exterior_angle: TAU, from, to };
                two_edges([turn(start.from, way), turn(way, end.to)], legs, shared, Wave::Line, k)
            };
            // Across an opening, or along both faces of the strip.
            let expected = if a / 2 == b / 2 { over(PI, false) } else { over(0.0, true) + over(TAU, true) };
            let ray = rays.multiple.iter().filter(|r| r.factors[1] == usize::MAX).nth(i);
            let got = ray.map_or(Complex64::ZERO, |r| {
                let [first, _, last] = r.factors;
                let product = rays.factors[first].at(k.sqrt()) * rays.factors[last].at(k.sqrt());
                product * Complex64::from_polar(r.amplitude, k * r.length_m)
            });
            // D1 D2, zero across an opening, leaves rounding.
            assert!((got - expected).norm() < 1e-9 * expected.norm(), "{a} to {b}: {got} {expected}");
        }
    }

    #[test]
    fn tones_behind_openings_agree_with_the_exact_aperture() {
        // Amplitude re free field, not dB: tones have nulls in shadow. Rays of the next order, over four jambs and of higher
        // slopes, are about (k w)^(-5/2) each for the narrower opening's width w, and there are two openings.
        for k in [20.0_f64, 10.0] {
            let bound = 2.0 * (0.4 * k).powf(-2.5);
            for openings in [&TWO[..1], &TWO[..]] {
                let aperture = Aperture::new(openings, k);
                for incident in [LINE, Incident::Plane { s_x: 0.5, s_y: 0.0 }] {
                    for x_m in [-1.5, -0.4, 0.6, 1.8] {
                        let crossing = Crossing { incident, x_m, z_m: 1.2 };
                        let free = crossing.free_intensity().sqrt();
                        let got = OpeningRays::new(openings, &crossing).pressure(k).norm() / free;
                        let error = got - aperture.transfer(&crossing).norm();
                        assert!(error.abs() < bound, "k {k}, {incident:?}, {x_m}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn an_oblique_plane_wave_is_a_straight_one_of_lower_frequency() {
        let s_y = 0.6;
        let oblique = pressure(&TWO, Incident::Plane { s_x: 0.4, s_y }, 0.7, 1.2, 15.0);
        let straight = pressure(&TWO, Incident::Plane { s_x: 0.5, s_y: 0.0 }, 0.7, 1.2, 12.0);
        assert!((oblique - straight).norm() < 1e-12 * straight.norm(), "{oblique} {straight}");
    }

    #[test]
    fn no_jamb_leaves_the_free_field() {
        let free = pressure(&[[f64::NEG_INFINITY, f64::INFINITY]], LINE, 1.6, 0.5, 9.0);
        let length = 2.0_f64.hypot(2.2);
        assert!((free - Complex64::from_polar(1.0 / length.sqrt(), 9.0 * length)).norm() < 1e-12);
        assert_eq!(pressure(&[], LINE, 1.6, 0.5, 9.0), Complex64::ZERO);
    }
}
