//! Infinitely long openings in one plane: the exact aperture where they are narrow, the closed form where they are wide.

use std::num::NonZeroUsize;
use std::sync::{Arc, OnceLock};

use gauss_quad::legendre::GaussLegendre;
use nalgebra::DMatrix;
use num_complex::Complex64;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::{Jambs, Mask};
use super::multipole::{Lit, Multipoles};
use super::quadrature::RaySum;
use super::tables::Solved;
use super::thick::{ThickAperture, deep_share, shared};
use super::timed::{Cost, Timed};
use super::two_edges::{edge_field, two_edges};
use super::wedge::coherent;

/// How an opening is modelled in one band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// Integral equation at a few frequencies of the band.
    Exact,
    /// A single edge: the exact half-plane.
    Edge,
    /// Signed rays with the closed band mean, eq. (5a-c).
    Closed,
}

/// k times width below which the exact aperture is used; from three quarters of it on the closed form takes over
/// smoothly. There both agree within 0.06 dB in octave bands up to 60 degrees off the normal (docs/verification.md).
pub const NARROW_KA: f64 = 14.0;
/// The same where the source or the receiver is so oblique that waves along the opening matter.
pub const NARROW_KA_OBLIQUE: f64 = 50.0;
/// The same where sound runs along the opening before and behind, and crosses it more than twice.
const NARROW_KA_ALONG: f64 = 80.0;
/// k times width up to which the exact aperture replaces a sum over signed rays that came out negative: for bands, which
/// need many frequencies, and for tones.
const AFFORDABLE_KA: [f64; 2] = [200.0, 800.0];
/// Cosines of the angle off the normal, at any jamb, between which a direction turns oblique: 60 to 72.5 degrees.
const OBLIQUE_COS: [f64; 2] = [0.3, 0.5];
/// Distances from the screen over the width of the opening between which a place is near.
const NEAR: [f64; 2] = [0.4, 0.8];
/// Sums of the cosines of incidence and emergence, at either jamb, between which an opening is passed along the screen
/// before and behind. Such directions, and oblique ones, change so much over the opening that the closed form's
/// midpoints fail.
const GRAZING: [f64; 2] = [0.7, 1.0];
/// The same, at both jambs, between which sound runs along the opening: 81 to 76 degrees off the normal on both sides.
const ALONG: [f64; 2] = [0.3, 0.5];
/// k times the narrowest member, opening or strip, of several openings over which the closed form takes over from the exact
/// aperture: it has no waves over the strips, and midpoints of two openings are right from afar only.
const NARROW_MEMBER: [f64; 2] = [60.0, 100.0];
/// k times the open width of several openings between which solving them exactly takes too long.
const SOLVABLE: [f64; 2] = [300.0, 400.0];

impl Form {
    /// The form for the narrowest of the `mask`'s openings in this band, whatever the directions.
    pub fn of(mask: &Mask, spectrum: &Spectrum) -> Self {
        if single_edge(mask).is_some() {
            return Self::Edge;
        }
        let exact = match mask.openings().len() {
            0 | 1 => narrowest_ka(mask, spectrum) < NARROW_KA,
            _ => share_of_several(mask, spectrum) > 0.5,
        };
        if exact { Self::Exact } else { Self::Closed }
    }
}

/// Share of the exact aperture in the intensity of one pair, 0..=1; the closed form has the rest.
///
/// 1 below [`NARROW_KA`], further up for directions along the screen; it falls smoothly, so that no level jumps while
/// an opening widens or a probe moves.
pub fn exact_share(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum) -> f64 {
    let openings = mask.openings();
    if openings.len() > 1 {
        return share_of_several(mask, spectrum);
    }
    let ka = narrowest_ka(mask, spectrum);
    if ka >= NARROW_KA_ALONG {
        return 0.0;
    }
    let Some(opening) = openings.first() else { return 0.0 };
    let oblique = (NARROW_KA_OBLIQUE - NARROW_KA) * off_axis(opening, crossing);
    let along = (NARROW_KA_ALONG - NARROW_KA_OBLIQUE) * runs_along(opening, crossing);
    let limit = NARROW_KA + oblique + along;
    fade(ka, [0.75 * limit, limit])
}

/// The same for several openings, from any direction.
///
/// Strips between openings count, too: waves run over them from jamb to jamb, and the closed form has none of these.
fn share_of_several(mask: &Mask, spectrum: &Spectrum) -> f64 {
    let openings = mask.openings();
    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
    let strips = openings.windows(2).map(|w| k * (w[1][0] - w[0][1]));
    let narrowest = strips.fold(narrowest_ka(mask, spectrum), f64::min);
    let open: f64 = openings.iter().map(|o| o[1] - o[0]).sum();
    fade(narrowest, NARROW_MEMBER) * fade(k * open, SOLVABLE)
}

/// 1 up to `range[0]`, 0 from `range[1]` on, smooth between.
pub(super) fn fade(x: f64, range: [f64; 2]) -> f64 {
    let t = ((x - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}

/// The only jamb of a half-plane with the direction (sign of x) in which the screen lies; `None` for other masks.
pub(super) fn single_edge(mask: &Mask) -> Option<(f64, f64)> {
    match mask.openings() {
        [[low, high]] if low.is_finite() && high.is_infinite() => Some((*low, -1.0)),
        [[low, high]] if low.is_infinite() && high.is_finite() => Some((*high, 1.0)),
        _ => None,
    }
}

/// The exact half-plane with its edge at `edge_m` and its screen towards `side` of it.
pub(super) fn half_plane(edge_m: f64, side: f64, crossing: &Crossing, spectrum: &Spectrum) -> RaySum {
    let (field, across) = edge_field(edge_m, side, crossing, spectrum);
    let value = field.mean(&across, coherent);
    RaySum { value, error: 1e-5 * value, absolute: value, rays: 0 }
}

/// k a of the narrowest opening at the centre of the band; infinite when one is unbounded (then nothing is narrow).
fn narrowest_ka(mask: &Mask, spectrum: &Spectrum) -> f64 {
    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
    if mask.openings().iter().flatten().any(|x| x.is_infinite()) {
        return f64::INFINITY;
    }
    mask.openings().iter().map(|o| k * (o[1] - o[0])).fold(f64::INFINITY, f64::min)
}

/// Share of the deep gap for the narrowest of the mask's openings; unbounded ones are thin.
fn deep_share_of(mask: &Mask, thickness_m: f64) -> f64 {
    let finite = !mask.openings().iter().flatten().any(|x| x.is_infinite());
    let narrowest = mask.openings().iter().map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min);
    if finite { deep_share(narrowest, thickness_m) } else { 0.0 }
}

/// The depths in m as which the wall counts for the narrowest of the mask's openings (0: thin), with their shares of the intensity.
pub(super) fn depths_of(mask: &Mask, thickness_m: f64) -> Vec<(f64, f64)> {
    shared(deep_share_of(mask, thickness_m), thickness_m)
}

/// Length in m, across the edges, of the shortest way through the mask.
pub fn over_m(mask: &Mask, crossing: &Crossing) -> f64 {
    let straight = crossing.straight_x_m();
    let over = mask.openings().iter().map(|o| crossing.length_m(straight.clamp(o[0], o[1])));
    over.fold(f64::INFINITY, f64::min)
}

/// Sine of the angle between the edges and the shortest way through the mask.
pub fn sin_beta(mask: &Mask, crossing: &Crossing) -> f64 {
    match crossing.incident {
        Incident::Point { dy_m, .. } => {
            let over = over_m(mask, crossing);
            over / over.hypot(dy_m)
        }
        _ => crossing.sin_beta(),
    }
}

/// Factorised apertures at the Gauss nodes of a band: made once an opening and band, used for every pair with the same
/// angle beta between ray and edge.
pub struct BandApertures {
    nodes: Vec<(f64, Solver)>,
    openings: Vec<[f64; 2]>,
    thickness_m: f64,
    multipoles: Timed<Option<Multipoles>>,
}

/// An exact aperture, thin or deep, at one wave number.
pub(super) enum Solver {
    Thin(Box<Aperture>),
    Thick(Box<ThickAperture>),
}

/// Most frequencies a band for more than [`FEW`] openings, which take long to solve: path differences of the farthest pairs
/// alias, but of those there are few (twenty slats at 8 kHz: 0.12 dB).
const MOST_OF_MANY: usize = 48;
const FEW: usize = 4;
/// k times width from which a gap's resonances count less.
const WIDE_GAP_KA: f64 = 14.0;
/// What the phases and resonances of a deep gap ask for more: levels are within 0.01 dB (90th percentile; 0.04 without).
const DEEP_NODES: f64 = 1.25;
/// Most frequencies a band for the resonances of a deep gap.
pub(super) const MOST_FREQUENCIES: usize = 256;

impl BandApertures {
    /// `thickness_m`: of the wall; `sin_beta`: sine of the angle between the rays and the edges.
    pub fn new(mask: &Mask, thickness_m: f64, spectrum: &Spectrum, sin_beta: f64) -> Self {
        let thickness_m = if deep_share_of(mask, thickness_m) > 0.0 { thickness_m } else { 0.0 };
        let openings = mask.openings();
        let span = openings.last().map_or(0.0, |o| o[1]) - openings.first().map_or(0.0, |o| o[0]);
        let (low, high) = (spectrum.low_k() * sin_beta, spectrum.high_k() * sin_beta);
        // |p|^2 varies over the band like cos(k d), d at most twice the span and the depth: Gauss nodes converge
        // exponentially beyond a quarter of that phase.
        let smooth = 0.5 * (high - low) * (span + thickness_m);
        let resonances = resonances(openings, thickness_m, low, high);
        let share = if thickness_m > 0.0 { DEEP_NODES } else { 1.0 };
        let phase = Some(share * (smooth + resonances)).filter(|phase| *phase > 0.5);
        let count = least_nodes(low, high) + phase.map_or(0, |phase| phase.ceil() as usize);
        let most = if openings.len() > FEW && thickness_m == 0.0 { MOST_OF_MANY } else { MOST_FREQUENCIES };
        match thickness_m > 0.0 {
            true => Self::at(mask, thickness_m, spread_nodes(low, high, count.min(most))),
            false => Self::at(mask, thickness_m, gauss_nodes(low, high, count.min(most))),
        }
    }

    /// At these wave numbers across the edges, with their weights; `thickness_m` 0: a thin wall.
    pub(super) fn at(mask: &Mask, thickness_m: f64, nodes: impl Iterator<Item = (f64, f64)>) -> Self {
        let nodes = nodes.map(|(k, weight)| (weight, Solver::new(mask, thickness_m, k, 1))).collect();
        Self { nodes, openings: mask.openings().to_vec(), thickness_m, multipoles: Timed::default() }
    }

    /// With the waves about the openings, which the first source would ask for.
    pub(super) fn prepared(self) -> Self {
        self.multipoles.get_or_make(|| Multipoles::new(&self.openings, self.thickness_m, &self.nodes));
        self
    }

    /// What `incident` makes leave the openings, for many receivers; `None` if it is too near to one of them.
    pub fn light(&self, incident: &Incident) -> Option<Lit> {
        self.light_for(incident, 0)
    }

    /// The same for receivers of this [`nearness`](super::multipole::nearness) and beyond.
    pub(super) fn light_for(&self, incident: &Incident, reach: usize) -> Option<Lit> {
        let make = || Multipoles::new(&self.openings, self.thickness_m, &self.nodes);
        self.multipoles.get_or_make(make).as_ref()?.light(incident, reach)
    }

    /// Band mean of the intensity relative to the source's free field at 1 m, solved for the source's field in the openings.
    pub fn intensity(&self, mask: &Mask, crossing: &Crossing) -> RaySum {
        let mean: f64 = self.nodes.iter().map(|(weight, solver)| weight * solver.transfer(crossing).norm_sqr()).sum();
        self.sum(mean * spread(mask, crossing))
    }

    /// The same from what the source of `crossing` makes leave the openings, if the receiver is not too near to them.
    pub fn intensity_of(&self, lit: Option<&Lit>, mask: &Mask, crossing: &Crossing) -> RaySum {
        let far = || {
            let (lit, multipoles) = (lit?, self.multipoles.get()?.as_ref()?);
            let seen = multipoles.see_by(lit, crossing.x_m, crossing.z_m)?;
            Some(self.sum(multipoles.mean(lit, &seen, crossing) * spread(mask, crossing)))
        };
        far().unwrap_or_else(|| self.intensity(mask, crossing))
    }

    /// Its frequencies, and the seconds that the waves about the openings took.
    pub(super) fn cost(&self) -> Cost {
        Cost { frequencies: self.nodes.len(), seconds: self.multipoles.seconds() }
    }

    fn sum(&self, value: f64) -> RaySum {
        RaySum { value, error: 1e-5 * value, absolute: value, rays: self.nodes.len() }
    }
}

/// What |p/p_free|^2 in the plane across the edges is multiplied by to give the intensity.
///
/// A point source spreads across the edges like a line source; along them the way over the opening counts, not the
/// straight one.
pub fn spread(mask: &Mask, crossing: &Crossing) -> f64 {
    match crossing.incident {
        Incident::Point { x_m, z_m, dy_m } => {
            let straight = (crossing.x_m - x_m).hypot(crossing.z_m + z_m);
            let over = over_m(mask, crossing);
            over / ((over * over + dy_m * dy_m) * straight)
        }
        _ => crossing.free_intensity(),
    }
}

impl Solver {
    /// The equations at wave number `k` across the edges, with `finer` times as many unknowns as usual; `depth_m` 0: a thin wall.
    pub(super) fn new(mask: &Mask, depth_m: f64, k: f64, finer: usize) -> Self {
        match depth_m > 0.0 {
            true => Self::Thick(Box::new(ThickAperture::finer(mask.openings(), depth_m, k, finer))),
            false => Self::Thin(Box::new(Aperture::finer(mask.openings(), k, finer))),
        }
    }

    /// The equations at wave number `k` with as many unknowns as `resolved_k` asks for; `depth_m` 0: a thin wall.
    pub(super) fn resolved(mask: &Mask, depth_m: f64, k: f64, resolved_k: f64) -> Self {
        match depth_m > 0.0 {
            true => Self::Thick(Box::new(ThickAperture::resolved(mask.openings(), depth_m, k, resolved_k, 1))),
            false => Self::Thin(Box::new(Aperture::resolved(mask.openings(), k, resolved_k, 1))),
        }
    }

    /// Wave number across the edges in 1/m.
    pub(super) fn wave_number(&self) -> f64 {
        match self {
            Self::Thin(aperture) => aperture.wave_number(),
            Self::Thick(aperture) => aperture.wave_number(),
        }
    }

    /// Places of the unknowns across the openings in m.
    pub(super) fn positions(&self) -> Vec<f64> {
        match self {
            Self::Thin(aperture) => aperture.positions().to_vec(),
            Self::Thick(aperture) => aperture.positions(),
        }
    }

    /// What leaves the openings there, times the steps of its quadrature, for the incident pressure in them.
    pub(super) fn strengths(&self, p_inc: Vec<Complex64>) -> Vec<Complex64> {
        match self {
            Self::Thin(aperture) => aperture.strengths(p_inc).as_slice().to_vec(),
            Self::Thick(aperture) => aperture.strengths(p_inc),
        }
    }

    /// `shapes`^T times what leaves the openings for each of the columns of `shapes` as incident pressure at the places: real and
    /// imaginary part.
    pub(super) fn moments(&self, shapes: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        match self {
            Self::Thin(aperture) => aperture.moments(shapes),
            Self::Thick(aperture) => aperture.moments(shapes),
        }
    }

    /// What the incident pressures `into` at the places give where a source would send `out` to them: with H0(k r) for
    /// `out` the pressure there.
    pub(super) fn couple(&self, into: Vec<Complex64>, out: &[Complex64]) -> Complex64 {
        Complex64::new(0.0, 0.5) * self.strengths(into).iter().zip(out).map(|(s, o)| s * o).sum::<Complex64>()
    }

    /// p/|p_free| in the plane across the edges.
    pub(super) fn transfer(&self, crossing: &Crossing) -> Complex64 {
        match self {
            Self::Thin(aperture) => aperture.transfer(crossing),
            Self::Thick(aperture) => aperture.transfer(crossing),
        }
    }
}

/// Frequencies that the resonances of waves straight on through gaps of `thickness_m` ask for between the wave numbers `low` and `high`.
///
/// A mouth sends back 1 - k a of a wave in the gap, so that a resonance is k a / h wide (in k); Gauss nodes find it to 1 %
/// from three a width on.
pub(super) fn resonant(openings: &[[f64; 2]], thickness_m: f64, low: f64, high: f64) -> f64 {
    if high * thickness_m < 1.5 {
        return 0.0;
    }
    let first = low.max(0.5 * std::f64::consts::PI / thickness_m);
    let narrowest = openings.iter().map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min);
    // A wide gap sends back only modes near their cut-on, a share of 1/(k a) of the power.
    let share = (WIDE_GAP_KA / (first * narrowest)).min(1.0);
    3.0 * share * (high - low) * thickness_m / (first * narrowest).min(1.5)
}

/// Frequencies that all resonances of slits ask for between the wave numbers `low` and `high`.
pub(crate) fn resonances(openings: &[[f64; 2]], thickness_m: f64, low: f64, high: f64) -> f64 {
    let widths = openings.iter().map(|o| o[1] - o[0]);
    let (narrowest, widest) = widths.fold((f64::INFINITY, 0.0_f64), |(a, b), width| (a.min(width), b.max(width)));
    resonant(openings, thickness_m, low, high).max(standing([narrowest, widest], thickness_m, low, high))
}

/// Frequencies that the resonances of waves ask for which also stand across a gap with sides of `narrower_m` and `longer_m`.
///
/// With gamma along the depth h, a mouth sends back 1 - gamma a of such a wave, one that is wide across 1 - gamma sqrt(a/k), and gamma
/// changes with k like k/gamma: a resonance is as wide as what a mouth loses times gamma/(k h). The one next to a cut-on, at
/// gamma = pi/h, is the narrowest; where there are many, those below gamma = k/3 carry little. sqrt(a/k) and k/3 are what 100 gaps at random
/// asked for.
pub(super) fn standing([narrower_m, longer_m]: [f64; 2], thickness_m: f64, low: f64, high: f64) -> f64 {
    let gamma = (high / 3.0).max(std::f64::consts::PI / thickness_m);
    if thickness_m == 0.0 || high < gamma || high * longer_m < std::f64::consts::PI {
        return 0.0;
    }
    let share = (WIDE_GAP_KA / (low * narrower_m)).min(1.0);
    let lost = gamma * narrower_m / (high * narrower_m).sqrt().max(1.0);
    3.0 * share * (high - low) * thickness_m * high / (gamma * lost)
}

/// Gauss nodes that leave 1e-6 of the mean over [low, high] of what has its singularity at 0: 4 for an octave, 3 for a third.
pub(super) fn least_nodes(low: f64, high: f64) -> usize {
    if high <= low {
        return 1;
    }
    // N nodes leave exp(-2 N acosh(x)) of it, the singularity at x half widths from the middle.
    let x = (high + low) / (high - low);
    (1e6_f64.ln() / (2.0 * x.acosh())).ceil() as usize
}

/// Largest rule that is kept once it is found.
const MOST_KEPT: usize = 512;

/// Gauss-Legendre nodes on [low, high] with weights that sum to 1.
pub(crate) fn gauss_nodes(low: f64, high: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    type Rule = Arc<[(f64, f64)]>;
    static RULES: [OnceLock<Rule>; MOST_KEPT] = [const { OnceLock::new() }; MOST_KEPT];
    let new = || -> Rule {
        let rule = GaussLegendre::new(NonZeroUsize::new(count).unwrap_or(NonZeroUsize::MIN));
        rule.iter().map(|&(x, w)| (x, 0.5 * w)).collect()
    };
    let rule = RULES.get(count).map_or_else(new, |known| Arc::clone(known.get_or_init(new)));
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    (0..rule.len()).map(move |i| (middle + half * rule[i].0, rule[i].1))
}

/// Gauss nodes drawn together in the middle, where resonances find them sparse: x to asin(a x)/asin(a) (Kosloff and Tal-Ezer 1993), as far
/// as leaves 1e-6 of what is smooth.
fn spread_nodes(low: f64, high: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    let a = 1.0 / (7.0 / count as f64).cosh();
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let slope = move |x: f64| 1.0 / (1.0 - (a * x).powi(2)).sqrt();
    let whole: f64 = gauss_nodes(-1.0, 1.0, count).map(|(x, weight)| weight * slope(x)).sum();
    gauss_nodes(-1.0, 1.0, count)
        .map(move |(x, weight)| (middle + half * (a * x).asin() / a.asin(), weight * slope(x) / whole))
}

/// Intensity behind infinitely long openings relative to the source's free field at 1 m.
///
/// `thickness_m`: of the wall, in the middle of which the plane of `crossing` lies. `solved`: the factorised apertures of
/// this band, if they fit [`sin_beta`]. `tolerance`: relative accuracy asked of
/// the quadrature.
pub fn intensity<'a>(
    mask: &Mask,
    thickness_m: f64,
    crossing: &Crossing,
    spectrum: &Spectrum,
    solved: impl FnOnce() -> Option<Solved<'a>>,
    tolerance: f64,
) -> RaySum {
    if let Some((edge_m, side)) = single_edge(mask) {
        return half_plane(edge_m, side, crossing, spectrum);
    }
    let exact = || match solved() {
        Some(Solved { apertures, lit }) => apertures.intensity_of(lit, mask, crossing),
        None => BandApertures::new(mask, thickness_m, spectrum, sin_beta(mask, crossing)).intensity(mask, crossing),
    };
    match deep_share_of(mask, thickness_m) {
        0.0 => thin(mask, crossing, spectrum, exact, tolerance),
        1.0 => exact(),
        share => {
            let solved = || BandApertures::new(mask, 0.0, spectrum, sin_beta(mask, crossing)).intensity(mask, crossing);
            mix(share, exact(), thin(mask, crossing, spectrum, solved, tolerance))
        }
    }
}

/// Openings in a thin wall: the `exact` aperture where they are narrow for this pair.
fn thin(
    mask: &Mask,
    crossing: &Crossing,
    spectrum: &Spectrum,
    exact: impl FnOnce() -> RaySum,
    tolerance: f64,
) -> RaySum {
    let share = exact_share(mask, crossing, spectrum);
    if share == 1.0 {
        return exact();
    }
    let wide = wide(mask, crossing, spectrum, tolerance);
    // In the nulls of tones the closed form may miss more than there is.
    let affordable = AFFORDABLE_KA[usize::from(spectrum.low_hz == spectrum.high_hz)];
    let share = if wide.value <= 0.0 && narrowest_ka(mask, spectrum) < affordable { 1.0 } else { share };
    if share == 0.0 { wide } else { mix(share, exact(), wide) }
}

/// Wide openings: the closed form; its two edges where one opening is passed at oblique angles.
fn wide(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum, tolerance: f64) -> RaySum {
    let closed = || mask.intensity(crossing, spectrum, Jambs::Rigid, tolerance);
    let [opening] = mask.openings() else { return closed() };
    if opening.iter().any(|x| x.is_infinite()) {
        return closed();
    }
    let flattest = opening.map(|x| crossing.ray(x)).iter().fold(2.0_f64, |c, ray| c.min(ray.cos_i + ray.cos_o));
    let share = fade(flattest, GRAZING).max(off_axis(opening, crossing));
    match share {
        0.0 => closed(),
        1.0 => two_edges(*opening, crossing, spectrum),
        _ => mix(share, two_edges(*opening, crossing, spectrum), closed()),
    }
}

/// 1 where source or receiver are oblique or near to the opening, so that directions change much over it; 0 far about the
/// normal, smooth between.
fn off_axis(opening: &[f64; 2], crossing: &Crossing) -> f64 {
    let cosine = opening.map(|x| crossing.ray(x)).iter().fold(1.0_f64, |c, r| c.min(r.cos_i).min(r.cos_o));
    let before = match crossing.incident {
        Incident::Line { z_m, .. } | Incident::Point { z_m, .. } => z_m,
        Incident::Plane { .. } => f64::INFINITY,
    };
    fade(cosine, OBLIQUE_COS).max(fade(crossing.z_m.min(before) / (opening[1] - opening[0]), NEAR))
}

/// 1 where sound arrives along the screen and goes on along it past both jambs, 0 where it does not, smooth between.
fn runs_along(opening: &[f64; 2], crossing: &Crossing) -> f64 {
    let rays = opening.map(|x| crossing.ray(x));
    let sines = rays.iter().flat_map(|ray| [ray.sin_i, ray.sin_o]);
    // A direction that turns round from jamb to jamb is upright in between.
    let onward = sines.clone().all(|sine| sine > 0.0) || sines.clone().all(|sine| sine < 0.0);
    let steepest = rays.iter().fold(0.0_f64, |c, ray| c.max(ray.cos_i + ray.cos_o));
    if onward { fade(steepest, ALONG) } else { 0.0 }
}

/// `share` of the first sum and the rest of the second.
fn mix(share: f64, a: RaySum, b: RaySum) -> RaySum {
    let mixed = |a: f64, b: f64| share * a + (1.0 - share) * b;
    RaySum {
        value: mixed(a.value, b.value),
        error: mixed(a.error, b.error),
        absolute: mixed(a.absolute, b.absolute),
        rays: a.rays + b.rays,
    }
}

/// The same with the published small-angle form.
pub fn paraxial_intensity(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum, tolerance: f64) -> RaySum {
    mask.intensity(crossing, spectrum, Jambs::Paraxial, tolerance)
}
