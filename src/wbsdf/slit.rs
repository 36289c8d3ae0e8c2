//! Infinitely long openings in one plane: the exact aperture where they are narrow, the closed form where they are wide.

use std::f64::consts::TAU;
use std::num::NonZeroUsize;

use gauss_quad::legendre::GaussLegendre;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::edge::AboutEdge;
use super::mask::{Jambs, Mask};
use super::quadrature::RaySum;
use super::thick::{ThickAperture, is_thick};
use super::wedge::{Wave, WedgeField, coherent};

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
/// The same where the source or the receiver is so oblique that waves along the opening matter (multiple diffraction
/// is not in the closed form), or two openings are seen from too near for the midpoint rule.
pub const NARROW_KA_OBLIQUE: f64 = 60.0;
/// k times width up to which the exact aperture replaces a sum over signed rays that came out negative: for bands, which
/// need many frequencies, and for tones.
const AFFORDABLE_KA: [f64; 2] = [200.0, 800.0];
/// Cosines of the angle off the normal, at any jamb, between which a direction turns oblique: 60 to 72.5 degrees.
const OBLIQUE_COS: [f64; 2] = [0.3, 0.5];
/// Distances over the span of several openings between which the midpoint rule of two openings turns good.
const NEAR: [f64; 2] = [2.0, 4.0];

impl Form {
    /// The form for the narrowest of the `mask`'s openings in this band, whatever the directions.
    pub fn of(mask: &Mask, spectrum: &Spectrum) -> Self {
        if single_edge(mask).is_some() {
            return Self::Edge;
        }
        if narrowest_ka(mask, spectrum) < NARROW_KA { Self::Exact } else { Self::Closed }
    }
}

/// Share of the exact aperture in the intensity of one pair, 0..=1; the closed form has the rest.
///
/// 1 below [`NARROW_KA`], further up for directions along the screen; it falls smoothly, so that no level jumps while
/// an opening widens or a probe moves.
pub fn exact_share(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum) -> f64 {
    let ka = narrowest_ka(mask, spectrum);
    if ka >= NARROW_KA_OBLIQUE {
        return 0.0;
    }
    let openings = mask.openings();
    let (Some(first), Some(last)) = (openings.first(), openings.last()) else { return 0.0 };
    let span = last[1] - first[0];
    let cosine = openings.iter().flatten().map(|&x| crossing.ray(x)).fold(1.0_f64, |c, r| c.min(r.cos_i).min(r.cos_o));
    let mut along = fade(cosine, OBLIQUE_COS);
    if openings.len() > 1 {
        let before = match crossing.incident {
            Incident::Line { z_m, .. } | Incident::Point { z_m, .. } => z_m,
            Incident::Plane { .. } => f64::INFINITY,
        };
        along = along.max(fade(crossing.z_m.min(before) / span, NEAR));
    }
    let limit = NARROW_KA + (NARROW_KA_OBLIQUE - NARROW_KA) * along;
    fade(ka, [0.75 * limit, limit])
}

/// 1 up to `range[0]`, 0 from `range[1]` on, smooth between.
pub(super) fn fade(x: f64, range: [f64; 2]) -> f64 {
    let t = ((x - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}

/// The only jamb of a half-plane with the direction (sign of x) in which the screen lies; `None` for other masks.
fn single_edge(mask: &Mask) -> Option<(f64, f64)> {
    match mask.openings() {
        [[low, high]] if low.is_finite() && high.is_infinite() => Some((*low, -1.0)),
        [[low, high]] if low.is_infinite() && high.is_finite() => Some((*high, 1.0)),
        _ => None,
    }
}

/// The exact half-plane with its edge at `edge_m` and its screen towards `side` of it.
fn half_plane(edge_m: f64, side: f64, crossing: &Crossing, spectrum: &Spectrum) -> RaySum {
    let mut across = *spectrum;
    let (source, wave) = match crossing.incident {
        Incident::Line { x_m, z_m } => (((x_m - edge_m) * side, z_m), Wave::Line),
        Incident::Point { x_m, z_m, dy_m } => (((x_m - edge_m) * side, z_m), Wave::Point(dy_m)),
        Incident::Plane { s_x, s_y } => {
            // Only k sin(beta) counts across the edge.
            let sin_beta = (1.0 - s_y * s_y).sqrt();
            across.speed_m_s /= sin_beta;
            let sin_i = s_x / sin_beta;
            ((-sin_i * side, (1.0 - sin_i * sin_i).max(0.0).sqrt()), Wave::Plane)
        }
    };
    // Angles from the face on the source's side, through the opening.
    let r_m = if wave == Wave::Plane { f64::INFINITY } else { source.0.hypot(source.1) };
    let source = AboutEdge { r_m, phi: source.1.atan2(source.0) };
    let x = (crossing.x_m - edge_m) * side;
    let receiver = AboutEdge { r_m: x.hypot(crossing.z_m), phi: TAU - crossing.z_m.atan2(x) };
    let value = WedgeField::new(TAU, source, receiver, wave, &across).mean(&across, coherent);
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

/// Whether the thickness of the wall counts for the narrowest of the mask's openings.
pub fn depth_counts(mask: &Mask, thickness_m: f64) -> bool {
    let finite = !mask.openings().iter().flatten().any(|x| x.is_infinite());
    let narrowest = mask.openings().iter().map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min);
    finite && is_thick(narrowest, thickness_m)
}

/// Length in m, across the edges, of the shortest way through the mask.
fn over_m(mask: &Mask, crossing: &Crossing) -> f64 {
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
}

enum Solver {
    Thin(Aperture),
    Thick(Box<ThickAperture>),
}

/// Most frequencies a band for the resonances of a deep gap.
pub(super) const MOST_FREQUENCIES: usize = 256;

impl BandApertures {
    /// `thickness_m`: of the wall; `sin_beta`: sine of the angle between the rays and the edges.
    pub fn new(mask: &Mask, thickness_m: f64, spectrum: &Spectrum, sin_beta: f64) -> Self {
        let openings = mask.openings();
        let span = openings.last().map_or(0.0, |o| o[1]) - openings.first().map_or(0.0, |o| o[0]);
        let (low, high) = (spectrum.low_k() * sin_beta, spectrum.high_k() * sin_beta);
        // |p|^2 varies over the band like cos(k d), d at most twice the span: Gauss nodes converge exponentially beyond
        // half that phase.
        let smooth = 0.7 * (high - low) * (span + thickness_m);
        let count =
            if high > low { 4 + (smooth + resonant(openings, thickness_m, low, high)).ceil() as usize } else { 1 };
        let solver = |k: f64| match depth_counts(mask, thickness_m) {
            true => Solver::Thick(Box::new(ThickAperture::new(openings, thickness_m, k))),
            false => Solver::Thin(Aperture::new(openings, k)),
        };
        let nodes =
            gauss_nodes(low, high, count.min(MOST_FREQUENCIES)).map(|(k, weight)| (weight, solver(k))).collect();
        Self { nodes }
    }

    /// Band mean of the intensity relative to the source's free field at 1 m.
    pub fn intensity(&self, mask: &Mask, crossing: &Crossing) -> RaySum {
        let spread = match crossing.incident {
            // Across the edges like a line source; along them the way over the opening spreads, not the straight one.
            Incident::Point { x_m, z_m, dy_m } => {
                let straight = (crossing.x_m - x_m).hypot(crossing.z_m + z_m);
                let over = over_m(mask, crossing);
                over / ((over * over + dy_m * dy_m) * straight)
            }
            _ => crossing.free_intensity(),
        };
        let mean: f64 = self.nodes.iter().map(|(weight, solver)| weight * solver.transfer(crossing)).sum();
        let value = mean * spread;
        RaySum { value, error: 1e-5 * value, absolute: value, rays: self.nodes.len() }
    }
}

impl Solver {
    fn transfer(&self, crossing: &Crossing) -> f64 {
        match self {
            Self::Thin(aperture) => aperture.transfer(crossing),
            Self::Thick(aperture) => aperture.transfer(crossing),
        }
    }
}

/// Frequencies that the resonances of gaps of `thickness_m` ask for between the wave numbers `low` and `high`.
///
/// A mouth sends back 1 - k a of a wave in the gap, so that a resonance is k a / h wide (in k); Gauss nodes find it to 1 %
/// from three a width on.
pub(super) fn resonant(openings: &[[f64; 2]], thickness_m: f64, low: f64, high: f64) -> f64 {
    if high * thickness_m < 1.5 {
        return 0.0;
    }
    let first = low.max(0.5 * std::f64::consts::PI / thickness_m);
    let narrowest = openings.iter().map(|o| o[1] - o[0]).fold(f64::INFINITY, f64::min);
    3.0 * (high - low) * thickness_m / (first * narrowest).min(1.5)
}

/// Gauss-Legendre nodes on [low, high] with weights that sum to 1.
pub(crate) fn gauss_nodes(low: f64, high: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    let rule = GaussLegendre::new(NonZeroUsize::new(count).unwrap_or(NonZeroUsize::MIN));
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let nodes: Vec<(f64, f64)> = rule.iter().map(|&(x, w)| (middle + half * x, 0.5 * w)).collect();
    nodes.into_iter()
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
    solved: impl FnOnce() -> Option<&'a BandApertures>,
    tolerance: f64,
) -> RaySum {
    if let Some((edge_m, side)) = single_edge(mask) {
        return half_plane(edge_m, side, crossing, spectrum);
    }
    let exact = || match solved() {
        Some(apertures) => apertures.intensity(mask, crossing),
        None => BandApertures::new(mask, thickness_m, spectrum, sin_beta(mask, crossing)).intensity(mask, crossing),
    };
    let share = if depth_counts(mask, thickness_m) { 1.0 } else { exact_share(mask, crossing, spectrum) };
    if share == 1.0 {
        return exact();
    }
    let closed = mask.intensity(crossing, spectrum, Jambs::Rigid, tolerance);
    // In the nulls of tones the closed form may miss more than there is.
    let affordable = AFFORDABLE_KA[usize::from(spectrum.low_hz == spectrum.high_hz)];
    let share = if closed.value <= 0.0 && narrowest_ka(mask, spectrum) < affordable { 1.0 } else { share };
    if share == 0.0 {
        return closed;
    }
    let exact = exact();
    let mix = |exact: f64, closed: f64| share * exact + (1.0 - share) * closed;
    RaySum {
        value: mix(exact.value, closed.value),
        error: mix(exact.error, closed.error),
        absolute: mix(exact.absolute, closed.absolute),
        rays: exact.rays + closed.rays,
    }
}

/// The same with the published small-angle form.
pub fn paraxial_intensity(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum, tolerance: f64) -> RaySum {
    mask.intensity(crossing, spectrum, Jambs::Paraxial, tolerance)
}
