//! Scattering of traced rays at an opening: drawing directions from the wave BSDF and evaluating it.
//!
//! A ray that crosses at (x, y) keeps its place and changes its direction cosines by (Delta_x, Delta_y). Per direction
//! the share of its power per unit Delta is the signed weight (4) times the obliquity ratio O^2/(cos theta_i cos theta_o);
//! where the opening is narrow it is the exact aperture's positive marginal, the same for every x. One ray carries all
//! bands: directions are drawn from a mixture over the bands and every band's weight is divided by the mixture's density.
//!
//! The product of two directions does not know that one takes room from the other: the part of a lobe beyond grazing is cut off, and
//! its integral fell short of what the opening passes by 6 to 17 %. One factor a band puts that right on the average over diffuse
//! incidence, and keeps the share symmetric in both directions (reciprocity).

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::crossing::Spectrum;
use super::marginal::Marginal;
use super::rectangle::{NARROW_KA, Sides, diffuse_transmission};
use super::weight::edge_distance;
use crate::scene::Transport;

/// Smallest cosine in the obliquity ratio: grazing rays carry no flux, and their weight stays bounded.
const MIN_COS: f64 = 0.05;
/// Share of the draws that go uniformly over the hemisphere: it bounds the weights of directions along the screen, where
/// the obliquity ratio grows.
const UNIFORM_SHARE: f64 = 0.2;

/// Pairs of directions behind the balance of a band: it is known to some 0.5 %.
const BALANCE_DRAWS: usize = 4096;

/// Which form of the wave BSDF a crossing uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// The signed weight of the place of crossing: for fields that differ from place to place over the opening.
    Signed,
    /// Its mean over the opening, the positive far field (sinc^2 lobe): all that matters once the incident field has no
    /// memory of position, and it has no sign problem.
    Marginal,
}

/// The scattering of one opening in all bands.
pub struct PortalScatter {
    x_m: [f64; 2],
    y_m: [f64; 2],
    bands: Vec<BandScatter>,
}

struct BandScatter {
    spectrum: Spectrum,
    model: Model,
    /// Factor on the transmission of the product of the two sides: that of a diffuse field is the exact rectangle's.
    intake: f64,
    /// Factor on the share: of a diffuse field it carries what the opening passes.
    balance: f64,
}

enum Model {
    Sides { x: Direction, y: Direction },
    SmallHole { transmission: f64 },
}

/// One direction of the opening in one band.
enum Direction {
    /// Unbounded: the direction cosine is kept.
    Kept,
    /// Signed weight of the nearest edge; `rigid`: with Keller's obliquity.
    Wide { rigid: bool },
    /// The exact marginal.
    Narrow(Marginal),
}

impl PortalScatter {
    /// The scattering of the opening `x_m` by `y_m` (limits in m in its frame) through a host of `thickness_m` in the given
    /// bands; the thickness counts where the opening is narrow.
    ///
    /// Narrow sides are solved and tabulated here, the power is balanced: a few milliseconds a side and band.
    pub fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, bands: &[Spectrum], transport: Transport) -> Self {
        let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
        let exact = transport == Transport::Wbsdf && width.is_finite() && height.is_finite();
        let new = |spectrum: &Spectrum| {
            let passes = exact.then(|| diffuse_transmission(width, height, thickness_m, spectrum)).flatten();
            let model = match passes {
                // All directions alike: half of what a diffuse field brings meets the hole at normal incidence.
                Some(passes) if Sides::of(width, height, spectrum) == Sides::SmallHole => {
                    Model::SmallHole { transmission: 0.5 * passes }
                }
                _ => {
                    // The smaller side alone: with two narrow ones the product of two slits takes in too much.
                    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
                    let narrow = k * width.min(height) < NARROW_KA;
                    let side = |limits, narrow| Direction::new(limits, thickness_m, spectrum, transport, narrow);
                    Model::Sides { x: side(x_m, narrow && width <= height), y: side(y_m, narrow && width > height) }
                }
            };
            let band = BandScatter { spectrum: *spectrum, model, intake: 1.0, balance: 1.0 };
            if exact { band.balanced([x_m, y_m], passes) } else { band }
        };
        Self { x_m, y_m, bands: bands.par_iter().map(new).collect() }
    }

    /// Transmitted power over incident power of a plane wave along `s_i`, one a band: 1 for a wide opening, more for a
    /// narrow one (it takes in more than meets its area).
    pub fn transmitted(&self, s_i: DVec3, out: &mut [f32]) {
        for (value, band) in out.iter_mut().zip(&self.bands) {
            *value = band.transmitted(s_i) as f32;
        }
    }

    /// Draws an outgoing direction for a ray that crosses at (`x_m`, `y_m`) with the unit direction `s_i` (local frame,
    /// z > 0 the direction of travel) and multiplies `weights` (one a band; further ones are left alone) by the signed
    /// share over the density. `u`: three uniform numbers. `None`: evanescent, the ray ends (its share is accounted for
    /// in the other draws).
    pub fn sample(
        &self,
        form: Form,
        (x_m, y_m): (f64, f64),
        s_i: DVec3,
        u: [f64; 3],
        weights: &mut [f32],
    ) -> Option<DVec3> {
        let count = self.bands.len();
        // Distance from the edge that gives the lobe's width: the mean lobe is as wide as that of the middle.
        let [l_x, l_y] = [(x_m, self.x_m), (y_m, self.y_m)].map(|(at, limits)| match form {
            Form::Signed => edge_distance(at, limits),
            Form::Marginal => 0.5 * (limits[1] - limits[0]),
        });
        let kept = self.keeps_a_direction();
        let uniform_share = if kept { 0.0 } else { UNIFORM_SHARE };
        let (s_x, s_y) = if u[0] < uniform_share {
            uniform([u[1], u[2]])
        } else {
            let pick = (u[0] - uniform_share) / (1.0 - uniform_share);
            let chosen = &self.bands[((pick * count as f64) as usize).min(count - 1)];
            chosen.draw(l_x, l_y, s_i, [u[1], u[2]])
        };
        let transverse = s_x * s_x + s_y * s_y;
        if transverse >= 1.0 - 1e-12 {
            return None;
        }
        let s_o = DVec3::new(s_x, s_y, (1.0 - transverse).sqrt());
        let lobes: f64 = self.bands.iter().map(|b| b.proposal(l_x, l_y, s_i, s_o)).sum::<f64>() / count as f64;
        let density = uniform_share / (TAU * s_o.z) + (1.0 - uniform_share) * lobes;
        let crossing = self.crossing(form, (x_m, y_m), s_i, s_o);
        for (weight, band) in weights.iter_mut().zip(&self.bands) {
            *weight *= (band.share(&crossing) / density) as f32;
        }
        Some(s_o)
    }

    fn crossing(&self, form: Form, (x_m, y_m): (f64, f64), s_i: DVec3, s_o: DVec3) -> Crossing {
        Crossing::new(form, [(x_m, self.x_m), (y_m, self.y_m)], s_i, s_o)
    }

    /// Whether the opening is unbounded in one direction: its lobe has no density over solid angle.
    fn keeps_a_direction(&self) -> bool {
        [self.x_m, self.y_m].iter().any(|l| l[0] == f64::NEG_INFINITY && l[1] == f64::INFINITY)
    }

    /// Signed share of the ray's power per steradian sent towards the unit direction `s_o`, one a band.
    pub fn density(&self, form: Form, at_m: (f64, f64), s_i: DVec3, s_o: DVec3, out: &mut [f64]) {
        let crossing = self.crossing(form, at_m, s_i, s_o);
        let kept = self.keeps_a_direction();
        for (value, band) in out.iter_mut().zip(&self.bands) {
            *value = if kept { 0.0 } else { band.share(&crossing) * s_o.z };
        }
    }

    /// Solid angle in sr of the scattered lobe in `band`: 2 pi for a hole much smaller than the wavelength, 0 for an
    /// unbounded opening.
    pub fn lobe_sr(&self, band: usize) -> f64 {
        let b = &self.bands[band];
        match &b.model {
            Model::SmallHole { .. } => TAU,
            Model::Sides { x, y } => {
                let width = |side: &Direction, limits: [f64; 2]| match side {
                    Direction::Kept => 0.0,
                    Direction::Wide { .. } => {
                        // Mean over the opening: L is a quarter of its width; full width at half height is 3.8 scales.
                        (3.8 * scale(0.25 * (limits[1] - limits[0]), &b.spectrum)).min(2.0)
                    }
                    Direction::Narrow(_) => 2.0,
                };
                (width(x, self.x_m) * width(y, self.y_m)).min(TAU)
            }
        }
    }
}

/// Direction cosines of a direction uniform over the hemisphere.
fn uniform(u: [f64; 2]) -> (f64, f64) {
    let (sin, turn) = ((1.0 - u[0] * u[0]).sqrt(), TAU * u[1]);
    (sin * turn.cos(), sin * turn.sin())
}

impl BandScatter {
    /// Transmitted power over incident power of a plane wave along `s_i`.
    fn transmitted(&self, s_i: DVec3) -> f64 {
        self.intake
            * match &self.model {
                Model::SmallHole { transmission } => transmission / s_i.z.max(MIN_COS),
                Model::Sides { x, y } => x.transmitted(s_i.x, s_i.z) * y.transmitted(s_i.y, s_i.z),
            }
    }

    /// Proposes direction cosines from this band's lobe.
    fn draw(&self, l_x: f64, l_y: f64, s_i: DVec3, u: [f64; 2]) -> (f64, f64) {
        match &self.model {
            Model::Sides { x, y } => {
                (x.draw(l_x, s_i.x, s_i.y, &self.spectrum, u[0]), y.draw(l_y, s_i.y, s_i.x, &self.spectrum, u[1]))
            }
            Model::SmallHole { .. } => (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0),
        }
    }

    /// With the factors [`Self::intake`] and [`Self::balance`]: `passes` is what the exact rectangle passes of a diffuse field, where it
    /// is known, and the share of the mean over the opening with these `limits` is summed over pairs of directions.
    fn balanced(self, limits: [[f64; 2]; 2], passes: Option<f64>) -> Self {
        let [l_x, l_y] = limits.map(|l| 0.5 * (l[1] - l[0]));
        let centre = [(limits[0][0] + l_x, limits[0]), (limits[1][0] + l_y, limits[1])];
        let (mut sent, mut passed) = (0.0, 0.0);
        for n in 1..=BALANCE_DRAWS {
            // A Kronecker sequence in four dimensions; incidence by Lambert's law, half of the directions from the lobe.
            let u = |step: f64| (0.5 + n as f64 * step).fract();
            let (sin, (turn_sin, turn_cos)) = (u(0.856_674_883_9).sqrt(), (TAU * u(0.733_891_856_6)).sin_cos());
            let s_i = DVec3::new(sin * turn_cos, sin * turn_sin, (1.0 - sin * sin).sqrt());
            passed += self.transmitted(s_i);
            let from = [u(0.628_706_721_0), u(0.538_597_257_2)];
            let (s_x, s_y) = if n % 2 == 0 { uniform(from) } else { self.draw(l_x, l_y, s_i, from) };
            let transverse = s_x * s_x + s_y * s_y;
            if transverse < 1.0 - 1e-12 {
                let s_o = DVec3::new(s_x, s_y, (1.0 - transverse).sqrt());
                let density = 0.5 / (TAU * s_o.z) + 0.5 * self.proposal(l_x, l_y, s_i, s_o);
                sent += self.share(&Crossing::new(Form::Marginal, centre, s_i, s_o)) / density;
            }
        }
        let passes = passes.map_or(passed, |passes| passes * BALANCE_DRAWS as f64);
        Self { intake: passes / passed, balance: passes / sent, ..self }
    }

    /// Share of the power per unit (Delta_x, Delta_y), signed.
    fn share(&self, crossing: &Crossing) -> f64 {
        self.balance
            * match &self.model {
                Model::SmallHole { transmission } => transmission * crossing.small,
                Model::Sides { x, y } => {
                    x.share(&crossing.x, &self.spectrum) * y.share(&crossing.y, &self.spectrum) * crossing.balance
                }
            }
    }

    /// Density per unit (Delta_x, Delta_y) with which this band's component of the mixture proposes `s_o`.
    fn proposal(&self, l_x: f64, l_y: f64, s_i: DVec3, s_o: DVec3) -> f64 {
        match &self.model {
            Model::SmallHole { .. } => 0.25,
            Model::Sides { x, y } => {
                x.proposal(l_x, s_i.x, s_i.y, s_o.x, &self.spectrum)
                    * y.proposal(l_y, s_i.y, s_i.x, s_o.y, &self.spectrum)
            }
        }
    }
}

/// What a pair of directions at a place of the opening means in every band.
struct Crossing {
    x: Turn,
    y: Turn,
    /// See [`grazing_balance`].
    balance: f64,
    /// Share of a small hole that transmits all: 1/(2 pi cos theta_i cos theta_o).
    small: f64,
}

/// The part of a pair of directions across one pair of edges.
struct Turn {
    /// Place and limits in m; without a place: the mean over the opening.
    at_m: Option<f64>,
    limits: [f64; 2],
    delta: f64,
    /// Sines of the angles in the plane across the edges.
    sin_i: f64,
    sin_o: f64,
    /// Sine of the angle with the edges, the geometric mean of both directions.
    sin_beta: f64,
    /// The product of the cosines of the angles in the plane across the edges.
    flux: f64,
    /// Keller's obliquity O^2.
    obliquity: f64,
}

impl Crossing {
    /// `places`: coordinate and limits in m for x and y.
    fn new(form: Form, places: [(f64, [f64; 2]); 2], s_i: DVec3, s_o: DVec3) -> Self {
        let [x, y] = places;
        Self {
            x: Turn::new(form, x, [s_i.x, s_i.z], [s_o.x, s_o.z]),
            y: Turn::new(form, y, [s_i.y, s_i.z], [s_o.y, s_o.z]),
            balance: grazing_balance(s_i, s_o),
            small: 1.0 / (TAU * s_i.z.max(MIN_COS) * s_o.z.max(MIN_COS)),
        }
    }
}

impl Turn {
    /// Directions as [across the edges, normal].
    fn new(form: Form, (at_m, limits): (f64, [f64; 2]), s_i: [f64; 2], s_o: [f64; 2]) -> Self {
        let project = |s: [f64; 2]| {
            let sin_beta = length(s[0], s[1]).max(1e-9);
            (s[0] / sin_beta, s[1] / sin_beta, sin_beta)
        };
        let (sin_i, cos_i, beta_i) = project(s_i);
        let (sin_o, cos_o, beta_o) = project(s_o);
        let cos_sigma = (0.5 * (1.0 + cos_o * cos_i - sin_o * sin_i)).max(0.0).sqrt();
        let sin_delta = (0.5 * (1.0 - cos_o * cos_i - sin_o * sin_i)).max(0.0).sqrt();
        let mean = form == Form::Marginal && limits[0].is_finite() && limits[1].is_finite();
        let obliquity = if mean {
            // The mean over the two halves of the opening.
            cos_sigma * cos_sigma + sin_delta * sin_delta
        } else {
            let sin_delta = sin_delta.copysign(sin_o - sin_i);
            let side = if at_m - limits[0] < limits[1] - at_m { -1.0 } else { 1.0 };
            (cos_sigma + side * sin_delta).powi(2)
        };
        Self {
            at_m: (!mean).then_some(at_m),
            limits,
            delta: s_o[0] - s_i[0],
            sin_i,
            sin_o,
            sin_beta: (beta_i * beta_o).sqrt(),
            flux: cos_i.max(MIN_COS) * cos_o.max(MIN_COS),
            obliquity,
        }
    }
}

/// Length of (a, b), neither near the limits of a float.
fn length(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}

/// The product of the two directions' ratios O^2/(cos theta_i cos theta_o) is 1 on the shadow boundary, as it must be,
/// but counts a grazing direction's small cosine twice. With C = cos theta / (cos theta_x cos theta_y) <= 1 of a
/// direction, C_i C_o takes one of them back; near the shadow boundary it is divided by C^2 of the mean direction,
/// near meaning a change of direction small against the cosines with the normal.
fn grazing_balance(s_i: DVec3, s_o: DVec3) -> f64 {
    let c = |s: DVec3| {
        let z = s.z.max(MIN_COS);
        z / (length(s.x, z) * length(s.y, z))
    };
    let mean = c((s_i + s_o).normalize()).powi(2);
    let change = (s_o.x - s_i.x).powi(2) + (s_o.y - s_i.y).powi(2);
    let far = change / (change + s_i.z.max(MIN_COS) * s_o.z.max(MIN_COS));
    c(s_i) * c(s_o) / (mean + (1.0 - mean) * far)
}

/// Delta over which the weight (4) falls off: kappa f_c = 1 at c/(4 pi L f_c).
fn scale(l_m: f64, spectrum: &Spectrum) -> f64 {
    spectrum.speed_m_s / (TAU * l_m.max(1e-9) * (spectrum.low_hz + spectrum.high_hz))
}

impl Direction {
    fn new(limits: [f64; 2], thickness_m: f64, spectrum: &Spectrum, transport: Transport, narrow: bool) -> Self {
        if limits[0] == f64::NEG_INFINITY && limits[1] == f64::INFINITY {
            Self::Kept
        } else if transport == Transport::Paraxial {
            Self::Wide { rigid: false }
        } else if narrow {
            Self::Narrow(Marginal::new(limits[1] - limits[0], thickness_m, spectrum))
        } else {
            Self::Wide { rigid: true }
        }
    }

    /// Transmitted over incident power of a direction with the given cosines, across the edges and along the normal.
    fn transmitted(&self, across: f64, normal: f64) -> f64 {
        match self {
            Self::Kept | Self::Wide { .. } => 1.0,
            Self::Narrow(marginal) => {
                let sin_beta = length(across, normal).max(1e-9);
                marginal.total(sin_beta, across / sin_beta) / (normal / sin_beta).max(MIN_COS)
            }
        }
    }

    /// Proposes a direction cosine: Cauchy about the incident one with the weight's scale, cut to [-1, 1]; uniform in
    /// the angle on Keller's cone for a narrow side. `along`: the incident direction cosine along the edges.
    fn draw(&self, l_m: f64, s_i: f64, along: f64, spectrum: &Spectrum, u: f64) -> f64 {
        match self {
            Self::Kept => s_i,
            Self::Wide { .. } => {
                let d = scale(l_m, spectrum);
                let (low, high) = (((-1.0 - s_i) / d).atan(), ((1.0 - s_i) / d).atan());
                (s_i + d * (low + u * (high - low)).tan()).clamp(-1.0, 1.0)
            }
            Self::Narrow(_) => (1.0 - along * along).max(0.0).sqrt() * (PI * (u - 0.5)).sin(),
        }
    }

    /// Density of [`Self::draw`] at `s_o`.
    fn proposal(&self, l_m: f64, s_i: f64, along: f64, s_o: f64, spectrum: &Spectrum) -> f64 {
        match self {
            Self::Kept => 1.0,
            Self::Wide { .. } => {
                let d = scale(l_m, spectrum);
                let (low, high) = (((-1.0 - s_i) / d).atan(), ((1.0 - s_i) / d).atan());
                let t = (s_o - s_i) / d;
                1.0 / (d * (1.0 + t * t) * (high - low))
            }
            Self::Narrow(_) => {
                let cos = (1.0 - along * along - s_o * s_o).max(0.0).sqrt();
                if cos > 0.0 { FRAC_1_PI / cos } else { 0.0 }
            }
        }
    }

    /// Signed share per unit Delta.
    fn share(&self, turn: &Turn, spectrum: &Spectrum) -> f64 {
        match self {
            Self::Kept => 1.0,
            Self::Wide { rigid } => {
                let weight = match turn.at_m {
                    None => spectrum.mean_weight(turn.limits[1] - turn.limits[0], turn.delta),
                    Some(at_m) => spectrum.weight(edge_distance(at_m, turn.limits).max(0.0), turn.delta),
                };
                if *rigid { weight * turn.obliquity / turn.flux } else { weight }
            }
            Self::Narrow(marginal) => marginal.at(turn.sin_beta, turn.sin_i, turn.sin_o) / turn.flux,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

    use super::*;

    fn octaves() -> Vec<Spectrum> {
        (0..8)
            .map(|i| {
                let f = 62.5 * f64::from(1 << i);
                Spectrum { low_hz: f * FRAC_1_SQRT_2, high_hz: f * SQRT_2, speed_m_s: 343.0 }
            })
            .collect()
    }

    /// Mean over the hemisphere of the share of a diffuse field's power that an opening lets through: its transmission
    /// coefficient for diffuse incidence.
    fn diffuse_transmission(scatter: &PortalScatter, form: Form, draws: usize) -> Vec<f64> {
        let bands = scatter.bands.len();
        // A Kronecker sequence over place, incidence (Lambert) and outgoing direction.
        let step = [
            0.819_172_513_396_164_4,
            0.671_043_606_703_789_1,
            0.549_700_477_901_970_2,
            0.450_305_001_312_8,
            0.368_883_0,
            0.302_184_5,
            0.247_543_6,
        ];
        let mut sum = vec![0.0; bands];
        for n in 0..draws {
            let u: [f64; 7] = std::array::from_fn(|i| (0.5 + (n + 1) as f64 * step[i]).fract());
            let (sin, turn) = (u[2].sqrt(), TAU * u[3]);
            let s_i = DVec3::new(sin * turn.cos(), sin * turn.sin(), (1.0 - u[2]).sqrt());
            let x = scatter.x_m[0] + u[0] * (scatter.x_m[1] - scatter.x_m[0]);
            let y = scatter.y_m[0] + u[1] * (scatter.y_m[1] - scatter.y_m[0]);
            let mut weights = vec![1.0_f32; bands];
            if scatter.sample(form, (x, y), s_i, [u[4], u[5], u[6]], &mut weights).is_some() {
                sum.iter_mut().zip(&weights).for_each(|(s, w)| *s += f64::from(*w));
            }
        }
        sum.iter().map(|s| s / draws as f64).collect()
    }

    #[test]
    fn a_wide_opening_lets_all_power_through() {
        let scatter = PortalScatter::new([0.0, 0.9], [0.0, 2.0], 0.0, &octaves(), Transport::Wbsdf);
        for form in [Form::Signed, Form::Marginal] {
            let transmission = diffuse_transmission(&scatter, form, 200_000);
            for (band, (t, octave)) in transmission.iter().zip(&octaves()).enumerate().skip(3) {
                // The exact value tends to 1, from 1.15 on where the narrower side is 10 rad wide.
                let exact =
                    crate::wbsdf::rectangle::diffuse_transmission(0.9, 2.0, 0.0, octave).expect("a wide opening");
                assert!((t / exact - 1.0).abs() < 0.02, "{form:?} band {band}: {t}, exact {exact}");
            }
        }
    }

    #[test]
    fn drawn_power_equals_the_integrated_density() {
        for form in [Form::Signed, Form::Marginal] {
            compare_draws_and_density(form);
        }
    }

    fn compare_draws_and_density(form: Form) {
        let scatter = PortalScatter::new([0.0, 0.3], [0.0, 2.0], 0.0, &octaves(), Transport::Wbsdf);
        let s_i = DVec3::new(0.4, -0.3, (1.0_f64 - 0.25).sqrt());
        let (x, y) = (0.11, 0.7);
        let n = 400;
        let mut integral = [0.0; 8];
        let mut out = vec![0.0; 8];
        let cell = 2.0 / f64::from(n);
        for i in 0..n {
            for j in 0..n {
                let (a, b) = (-1.0 + (f64::from(i) + 0.5) * cell, -1.0 + (f64::from(j) + 0.5) * cell);
                if a * a + b * b < 1.0 {
                    let s_o = DVec3::new(a, b, (1.0 - a * a - b * b).sqrt());
                    scatter.density(form, (x, y), s_i, s_o, &mut out);
                    integral.iter_mut().zip(&out).for_each(|(s, d)| *s += d / s_o.z * cell * cell);
                }
            }
        }
        let draws = 400_000;
        let (mut mean, mut square) = (vec![0.0; 8], vec![0.0; 8]);
        for m in 0..draws {
            let u = |a: f64| (0.5 + f64::from(m + 1) * a).fract();
            let mut weights = vec![1.0_f32; 8];
            if scatter
                .sample(form, (x, y), s_i, [u(0.819_172_5), u(0.671_043_6), u(0.549_700_5)], &mut weights)
                .is_some()
            {
                for band in 0..8 {
                    mean[band] += f64::from(weights[band]) / f64::from(draws);
                    square[band] += f64::from(weights[band]).powi(2) / f64::from(draws);
                }
            }
        }
        for band in 0..8 {
            let error = ((square[band] - mean[band] * mean[band]).max(0.0) / f64::from(draws)).sqrt();
            // 4 standard errors and 1 % for the grid.
            let bound = 4.0 * error + 0.01 * integral[band].abs();
            assert!((mean[band] - integral[band]).abs() < bound, "{band}: {} {}", mean[band], integral[band]);
        }
    }

    #[test]
    fn the_mean_square_weight_of_a_crossing_is_bounded() {
        let scatter = PortalScatter::new([0.0, 0.9], [0.0, 2.0], 0.0, &octaves(), Transport::Wbsdf);
        let draws = 100_000;
        let mut square = vec![0.0; 8];
        for m in 0..draws {
            let u = |a: f64| (0.5 + f64::from(m + 1) * a).fract();
            let mut weights = vec![1.0_f32; 8];
            let (x, y) = (0.9 * u(0.302_184_5), 2.0 * u(0.247_543_6));
            let draw = [u(0.819_172_5), u(0.671_043_6), u(0.549_700_5)];
            if scatter.sample(Form::Signed, (x, y), DVec3::new(0.3, 0.1, 0.9_f64.sqrt()), draw, &mut weights).is_some()
            {
                square.iter_mut().zip(&weights).for_each(|(s, w)| *s += f64::from(*w).powi(2) / f64::from(draws));
            }
        }
        // 8 bands share the draws: 10 for the mixture times 1.44^2 for the signs at least; 40 is twice that.
        assert!(square.iter().all(|s| (1.0..40.0).contains(s)), "{square:?}");
    }
}
