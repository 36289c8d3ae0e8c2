//! Scattering of traced rays at an opening: drawing directions from the wave BSDF and evaluating it.
//!
//! A ray that crosses at (x, y) keeps its place and changes its direction cosines by (Delta_x, Delta_y). Per direction
//! the share of its power per unit Delta is the signed weight (4) times the obliquity ratio O^2/(cos theta_i cos theta_o);
//! where the opening is narrow it is the exact aperture's positive marginal, the same for every x. One ray carries all
//! bands: directions are drawn from a mixture over the bands and every band's weight is divided by the mixture's density.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::DVec3;
use num_complex::Complex64;

use super::aperture::Aperture;
use super::crossing::{Incident, Spectrum};
use super::rectangle::{Sides, small_hole_transmission};
use super::slit::{gauss_nodes, resonant};
use super::thick::{ThickAperture, is_thick};
use super::weight::edge_distance;
use crate::scene::Transport;

/// Smallest cosine in the obliquity ratio: grazing rays carry no flux, and their weight stays bounded.
const MIN_COS: f64 = 0.05;
/// Share of the draws that go uniformly over the hemisphere: it bounds the weights of directions along the screen, where
/// the obliquity ratio grows.
const UNIFORM_SHARE: f64 = 0.2;

/// Which form of the wave BSDF a crossing uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// The signed weight of the place of crossing: for fields that differ from place to place over the opening.
    Signed,
    /// Its mean over the opening, the positive far field (sinc^2 lobe): all that matters once the incident field has no
    /// memory of position, and it has no sign problem.
    Marginal,
}

/// k times width below which a side scatters by the exact aperture: its far field is smooth enough for a small table.
const NARROW_KA: f64 = 5.0;

/// The scattering of one opening in all bands.
pub struct PortalScatter {
    x_m: [f64; 2],
    y_m: [f64; 2],
    bands: Vec<BandScatter>,
}

struct BandScatter {
    spectrum: Spectrum,
    model: Model,
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
    /// Narrow sides are solved and tabulated here: a few milliseconds a side and band.
    pub fn new(x_m: [f64; 2], y_m: [f64; 2], thickness_m: f64, bands: &[Spectrum], transport: Transport) -> Self {
        let bands = bands
            .iter()
            .map(|spectrum| {
                let sides = Sides::of(x_m[1] - x_m[0], y_m[1] - y_m[0], spectrum);
                let model = if sides == Sides::SmallHole && transport == Transport::Wbsdf {
                    let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
                    Model::SmallHole { transmission: small_hole_transmission(width, height, thickness_m, spectrum) }
                } else {
                    // The smaller side alone: with two narrow ones the product of two slits takes in too much.
                    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
                    let (width, height) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
                    let narrow = k * width.min(height) < NARROW_KA;
                    let side = |limits, narrow| Direction::new(limits, thickness_m, spectrum, transport, narrow);
                    Model::Sides { x: side(x_m, narrow && width <= height), y: side(y_m, narrow && width > height) }
                };
                BandScatter { spectrum: *spectrum, model }
            })
            .collect();
        Self { x_m, y_m, bands }
    }

    /// Transmitted power over incident power of a plane wave along `s_i`, one a band: 1 for a wide opening, more for a
    /// narrow one (it takes in more than meets its area).
    pub fn transmitted(&self, s_i: DVec3, out: &mut [f32]) {
        for (value, band) in out.iter_mut().zip(&self.bands) {
            *value = match &band.model {
                Model::SmallHole { transmission } => transmission / s_i.z.max(MIN_COS),
                Model::Sides { x, y } => x.transmitted([s_i.x, s_i.y, s_i.z]) * y.transmitted([s_i.y, s_i.x, s_i.z]),
            } as f32;
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
            let (sin, turn) = ((1.0 - u[1] * u[1]).sqrt(), TAU * u[2]);
            (sin * turn.cos(), sin * turn.sin())
        } else {
            let pick = (u[0] - uniform_share) / (1.0 - uniform_share);
            let chosen = &self.bands[((pick * count as f64) as usize).min(count - 1)];
            match &chosen.model {
                Model::Sides { x, y } => (
                    x.draw(l_x, s_i.x, s_i.y, &chosen.spectrum, u[1]),
                    y.draw(l_y, s_i.y, s_i.x, &chosen.spectrum, u[2]),
                ),
                Model::SmallHole { .. } => (2.0 * u[1] - 1.0, 2.0 * u[2] - 1.0),
            }
        };
        let transverse = s_x * s_x + s_y * s_y;
        if transverse >= 1.0 - 1e-12 {
            return None;
        }
        let s_o = DVec3::new(s_x, s_y, (1.0 - transverse).sqrt());
        let lobes: f64 = self.bands.iter().map(|b| b.proposal(l_x, l_y, s_i, s_o)).sum::<f64>() / count as f64;
        let density = uniform_share / (TAU * s_o.z) + (1.0 - uniform_share) * lobes;
        for (weight, band) in weights.iter_mut().zip(&self.bands) {
            *weight *= (band.share(form, (x_m, y_m), self, s_i, s_o) / density) as f32;
        }
        Some(s_o)
    }

    /// Whether the opening is unbounded in one direction: its lobe has no density over solid angle.
    fn keeps_a_direction(&self) -> bool {
        [self.x_m, self.y_m].iter().any(|l| l[0] == f64::NEG_INFINITY && l[1] == f64::INFINITY)
    }

    /// Signed share of the ray's power per steradian sent towards the unit direction `s_o`, one a band.
    pub fn density(&self, form: Form, at_m: (f64, f64), s_i: DVec3, s_o: DVec3, out: &mut [f64]) {
        for (value, band) in out.iter_mut().zip(&self.bands) {
            *value = if self.keeps_a_direction() { 0.0 } else { band.share(form, at_m, self, s_i, s_o) * s_o.z };
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

impl BandScatter {
    /// Share of the power per unit (Delta_x, Delta_y), signed.
    fn share(&self, form: Form, (x_m, y_m): (f64, f64), portal: &PortalScatter, s_i: DVec3, s_o: DVec3) -> f64 {
        match &self.model {
            Model::SmallHole { transmission } => transmission / (TAU * s_i.z.max(MIN_COS) * s_o.z.max(MIN_COS)),
            Model::Sides { x, y } => {
                let along = |s: DVec3| [s.x, s.y, s.z];
                let across = |s: DVec3| [s.y, s.x, s.z];
                x.share(form, x_m, portal.x_m, along(s_i), along(s_o), &self.spectrum)
                    * y.share(form, y_m, portal.y_m, across(s_i), across(s_o), &self.spectrum)
                    * grazing_balance(s_i, s_o)
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

/// The product of the two directions' ratios O^2/(cos theta_i cos theta_o) is 1 on the shadow boundary, as it must be,
/// but counts a grazing direction's small cosine twice. With C = cos theta / (cos theta_x cos theta_y) <= 1 of a
/// direction, C_i C_o takes one of them back; near the shadow boundary it is divided by C^2 of the mean direction,
/// near meaning a change of direction small against the cosines with the normal.
fn grazing_balance(s_i: DVec3, s_o: DVec3) -> f64 {
    let c = |s: DVec3| {
        let z = s.z.max(MIN_COS);
        z / (s.x.hypot(z) * s.y.hypot(z))
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

    /// Transmitted over incident power; direction as in [`Self::share`].
    fn transmitted(&self, s_i: [f64; 3]) -> f64 {
        match self {
            Self::Kept | Self::Wide { .. } => 1.0,
            Self::Narrow(marginal) => {
                let sin_beta = s_i[0].hypot(s_i[2]).max(1e-9);
                marginal.total(sin_beta, s_i[0] / sin_beta) / (s_i[2] / sin_beta).max(MIN_COS)
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

    /// Signed share per unit Delta; directions as [across the edges, along the edges, normal].
    fn share(&self, form: Form, at_m: f64, limits: [f64; 2], s_i: [f64; 3], s_o: [f64; 3], spectrum: &Spectrum) -> f64 {
        // Angles in the plane across the edges.
        let project = |s: [f64; 3]| {
            let sin_beta = s[0].hypot(s[2]).max(1e-9);
            (s[0] / sin_beta, s[2] / sin_beta, sin_beta)
        };
        let (sin_i, cos_i, beta_i) = project(s_i);
        let (sin_o, cos_o, beta_o) = project(s_o);
        let flux = cos_i.max(MIN_COS) * cos_o.max(MIN_COS);
        match self {
            Self::Kept => 1.0,
            Self::Wide { rigid } => {
                let delta = s_o[0] - s_i[0];
                let finite = limits[0].is_finite() && limits[1].is_finite();
                let weight = match form {
                    Form::Marginal if finite => spectrum.mean_weight(limits[1] - limits[0], delta),
                    _ => spectrum.weight(edge_distance(at_m, limits).max(0.0), delta),
                };
                if !rigid {
                    return weight;
                }
                let cos_sigma = (0.5 * (1.0 + cos_o * cos_i - sin_o * sin_i)).max(0.0).sqrt();
                let sin_delta = (0.5 * (1.0 - cos_o * cos_i - sin_o * sin_i)).max(0.0).sqrt();
                let obliquity = match form {
                    // The mean over the two halves of the opening.
                    Form::Marginal if finite => cos_sigma * cos_sigma + sin_delta * sin_delta,
                    _ => {
                        let sin_delta = sin_delta.copysign(sin_o - sin_i);
                        let side = if at_m - limits[0] < limits[1] - at_m { -1.0 } else { 1.0 };
                        (cos_sigma + side * sin_delta).powi(2)
                    }
                };
                weight * obliquity / flux
            }
            Self::Narrow(marginal) => marginal.at((beta_i * beta_o).sqrt(), sin_i, sin_o) / flux,
        }
    }
}

/// The exact aperture's far field Lambda |A|^2 / (width sin^2 beta), band mean, over sin(beta), sin(theta_i),
/// sin(theta_o): what the position-averaged weight times O^2 is for a wide opening.
struct Marginal {
    table: Vec<f64>,
    /// The integral of the table over the outgoing angle times sin(beta): transmitted power times cos(theta_i).
    totals: Vec<f64>,
    directions: usize,
}

/// Cell and fraction of `t` in 0..=1 on a table of `count` equidistant nodes.
fn place(t: f64, count: usize) -> (usize, f64) {
    let t = t.clamp(0.0, 1.0) * (count - 1) as f64;
    let low = (t as usize).min(count - 2);
    (low, t - low as f64)
}

const BETAS: usize = 7;
/// Most frequencies a band of the table, where a deep gap resonates.
const MOST_NODES: usize = 12;
const MIN_SIN_BETA: f64 = 0.1;

impl Marginal {
    fn new(width_m: f64, thickness_m: f64, spectrum: &Spectrum) -> Self {
        let ka = spectrum.high_k() * width_m;
        let directions = if ka < 1.5 { 9 } else { 17 };
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let deep = is_thick(width_m, thickness_m);
        let half = 0.5 * width_m;
        let resonances = if deep { resonant(&[[-half, half]], thickness_m, low, high) } else { 0.0 };
        let count = if high > low { (3 + resonances.ceil() as usize).min(MOST_NODES) } else { 1 };
        let sine = |i: usize| 2.0 * i as f64 / (directions - 1) as f64 - 1.0;
        let sines: Vec<f64> = (0..directions).map(sine).collect();
        let mut table = Vec::with_capacity(BETAS * directions * directions);
        for beta in 0..BETAS {
            let sin_beta = MIN_SIN_BETA + (1.0 - MIN_SIN_BETA) * beta as f64 / (BETAS - 1) as f64;
            let mut plane = vec![0.0; directions * directions];
            for (k, weight) in gauss_nodes(low, high, count) {
                let scale = weight * TAU / (k * width_m * sin_beta * sin_beta);
                let mut add = |i: usize, amplitudes: &[Complex64]| {
                    for (o, amplitude) in amplitudes.iter().enumerate() {
                        plane[i * directions + o] += scale * amplitude.norm_sqr();
                    }
                };
                if deep {
                    let aperture = ThickAperture::new(&[[-half, half]], thickness_m, k * sin_beta);
                    for (i, sin_i) in sines.iter().enumerate() {
                        add(i, &aperture.far_amplitude(*sin_i, &sines));
                    }
                } else {
                    let aperture = Aperture::new(&[[-half, half]], k * sin_beta);
                    for (i, sin_i) in sines.iter().enumerate() {
                        let solution = aperture.solve_for(&Incident::Plane { s_x: *sin_i, s_y: 0.0 });
                        add(i, &sines.iter().map(|sin_o| solution.far_amplitude(*sin_o)).collect::<Vec<_>>());
                    }
                }
            }
            table.extend_from_slice(&plane);
        }
        let mut marginal = Self { table, totals: Vec::with_capacity(BETAS * directions), directions };
        const ANGLES: usize = 48;
        for beta in 0..BETAS {
            let sin_beta = MIN_SIN_BETA + (1.0 - MIN_SIN_BETA) * beta as f64 / (BETAS - 1) as f64;
            for i in 0..directions {
                let outgoing = (0..ANGLES).map(|a| (PI * ((a as f64 + 0.5) / ANGLES as f64 - 0.5)).sin());
                let sum: f64 = outgoing.map(|sin_o| marginal.at(sin_beta, sine(i), sin_o)).sum();
                marginal.totals.push(sum * PI / ANGLES as f64 * sin_beta);
            }
        }
        marginal
    }

    /// Transmitted power over incident power, times cos(theta_i).
    fn total(&self, sin_beta: f64, sin_i: f64) -> f64 {
        let (b, fb) = place((sin_beta - MIN_SIN_BETA) / (1.0 - MIN_SIN_BETA), BETAS);
        let (i, fi) = place(0.5 * (sin_i + 1.0), self.directions);
        let row = |b: usize| {
            let at = |i: usize| self.totals[b * self.directions + i];
            at(i) * (1.0 - fi) + at(i + 1) * fi
        };
        row(b) * (1.0 - fb) + row(b + 1) * fb
    }

    fn at(&self, sin_beta: f64, sin_i: f64, sin_o: f64) -> f64 {
        let n = self.directions;
        let (b, fb) = place((sin_beta - MIN_SIN_BETA) / (1.0 - MIN_SIN_BETA), BETAS);
        let (i, fi) = place(0.5 * (sin_i + 1.0), n);
        let (o, fo) = place(0.5 * (sin_o + 1.0), n);
        let at = |b: usize, i: usize, o: usize| self.table[(b * n + i) * n + o];
        let row = |b: usize, i: usize| at(b, i, o) * (1.0 - fo) + at(b, i, o + 1) * fo;
        let plane = |b: usize| row(b, i) * (1.0 - fi) + row(b, i + 1) * fi;
        plane(b) * (1.0 - fb) + plane(b + 1) * fb
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
            for (band, t) in transmission.iter().enumerate().skip(3) {
                // The exact value tends to 1; the product of two directions loses up to 10 % where the door is 8 rad wide
                // and 3 % where it is 60 rad wide (the oblique incidences).
                let bound = if band < 6 { 0.12 } else { 0.03 };
                assert!((t - 1.0).abs() < bound, "{form:?} band {band}: {t}");
            }
        }
    }

    #[test]
    fn a_narrow_side_passes_what_the_exact_slit_does() {
        // Transmitted over incident power at normal incidence (Mathieu functions and Nystrom, 1e-6), k times width.
        for (ka, exact) in [(0.01, 12.409_153), (0.1, 2.914_241), (0.5, 1.375_599), (1.0, 1.110_264), (3.0, 0.982_622)]
        {
            let tone = Spectrum::tone(1000.0, 343.0);
            let marginal = Marginal::new(ka / tone.high_k(), 0.0, &tone);
            let total = marginal.total(1.0, 0.0);
            // 1 %: bilinear interpolation of the table.
            assert!((total / exact - 1.0).abs() < 0.01, "ka {ka}: {total} {exact}");
        }
    }

    #[test]
    fn a_deep_gap_passes_what_the_exact_one_does() {
        // Transmitted over incident power at normal incidence, octave bands (Nystrom on a graded mesh, 1e-7): width and depth
        // in m, band of `octaves`.
        let exact = [
            (0.002, 0.1, 1, 0.147_726),
            (0.01, 0.1, 3, 0.222_475),
            (0.01, 0.1, 5, 1.726_284),
            (0.005, 0.04, 4, 0.266_728),
            (0.05, 0.1, 4, 1.669_997),
        ];
        for (width, depth, band, exact) in exact {
            let spectrum = octaves()[band];
            let nominal = [63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0][band] / (62.5 * f64::from(1 << band));
            let spectrum =
                Spectrum { low_hz: spectrum.low_hz * nominal, high_hz: spectrum.high_hz * nominal, ..spectrum };
            let total = Marginal::new(width, depth, &spectrum).total(1.0, 0.0);
            // 2 %: table, and at most 12 frequencies over a resonance.
            assert!((total / exact - 1.0).abs() < 0.02, "{width} m by {depth} m: {total} {exact}");
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
