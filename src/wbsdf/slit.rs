//! Infinitely long openings in one plane: the exact aperture where they are narrow, the closed form where they are wide.

use std::f64::consts::TAU;
use std::num::NonZeroUsize;

use gauss_quad::legendre::GaussLegendre;

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::edge::AboutEdge;
use super::mask::{Jambs, Mask};
use super::quadrature::RaySum;
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
    /// Signed rays of the published small-angle form.
    Paraxial,
}

/// k times width below which the exact aperture is used. At 12 both forms agree within 0.06 dB up to 75 degrees off the
/// normal (docs/verification.md), so the hand-over is without a step.
pub const NARROW_KA: f64 = 12.0;
/// The same where the source or the receiver is so oblique that waves along the opening matter (multiple diffraction
/// is not in the closed form), or two openings are seen from too near for the midpoint rule.
pub const NARROW_KA_OBLIQUE: f64 = 40.0;
/// Cosine of the angle off the normal from which a direction is oblique: 72.5 degrees.
const OBLIQUE_COS: f64 = 0.3;

impl Form {
    /// The form for the narrowest of the `mask`'s openings in this band, whatever the directions.
    pub fn of(mask: &Mask, spectrum: &Spectrum) -> Self {
        if single_edge(mask).is_some() {
            return Self::Edge;
        }
        if narrowest_ka(mask, spectrum) < NARROW_KA { Self::Exact } else { Self::Closed }
    }

    /// The form for one pair: the exact aperture a little further up for directions along the screen.
    pub fn of_pair(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum) -> Self {
        if single_edge(mask).is_some() {
            return Self::Edge;
        }
        let ka = narrowest_ka(mask, spectrum);
        let openings = mask.openings();
        let (Some(first), Some(last)) = (openings.first(), openings.last()) else { return Self::Closed };
        let span = last[1] - first[0];
        let middle = crossing.ray(0.5 * (first[0] + last[1]));
        let oblique = middle.cos_i.min(middle.cos_o) < OBLIQUE_COS;
        let near = openings.len() > 1 && span > 0.25 * crossing.z_m;
        if ka < if oblique || near { NARROW_KA_OBLIQUE } else { NARROW_KA } { Self::Exact } else { Self::Closed }
    }
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

/// Factorised apertures at the Gauss nodes of a band: made once an opening and band, used for every pair with the same
/// angle beta between ray and edge.
pub struct BandApertures {
    nodes: Vec<(f64, Aperture)>,
}

impl BandApertures {
    /// `sin_beta`: sine of the angle between the rays and the edges.
    pub fn new(mask: &Mask, spectrum: &Spectrum, sin_beta: f64) -> Self {
        let openings = mask.openings();
        let span = openings.last().map_or(0.0, |o| o[1]) - openings.first().map_or(0.0, |o| o[0]);
        let (low, high) = (spectrum.low_k() * sin_beta, spectrum.high_k() * sin_beta);
        // |p|^2 varies over the band like cos(k d), d at most twice the span: Gauss nodes converge exponentially beyond
        // half that phase.
        let count = if high > low { 4 + (0.7 * (high - low) * span).ceil() as usize } else { 1 };
        let nodes = gauss_nodes(low, high, count).map(|(k, weight)| (weight, Aperture::new(openings, k))).collect();
        Self { nodes }
    }

    /// Band mean of the intensity relative to the source's free field at 1 m.
    pub fn intensity(&self, crossing: &Crossing) -> RaySum {
        let mean: f64 = self
            .nodes
            .iter()
            .map(|(weight, aperture)| weight * aperture.transfer(&aperture.solve_for(&crossing.incident), crossing))
            .sum();
        let value = mean * crossing.free_intensity();
        RaySum { value, error: 1e-5 * value, absolute: value, rays: self.nodes.len() }
    }
}

/// Gauss-Legendre nodes on [low, high] with weights that sum to 1.
pub(super) fn gauss_nodes(low: f64, high: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    let rule = GaussLegendre::new(NonZeroUsize::new(count).unwrap_or(NonZeroUsize::MIN));
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let nodes: Vec<(f64, f64)> = rule.iter().map(|&(x, w)| (middle + half * x, 0.5 * w)).collect();
    nodes.into_iter()
}

/// Intensity behind infinitely long openings relative to the source's free field at 1 m.
///
/// `tolerance`: relative accuracy asked of the quadrature.
pub fn intensity(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum, form: Form, tolerance: f64) -> RaySum {
    match form {
        Form::Exact => BandApertures::new(mask, spectrum, crossing.sin_beta()).intensity(crossing),
        Form::Edge => match single_edge(mask) {
            Some((edge_m, side)) => half_plane(edge_m, side, crossing, spectrum),
            None => mask.intensity(crossing, spectrum, Jambs::Rigid, tolerance),
        },
        Form::Closed => mask.intensity(crossing, spectrum, Jambs::Rigid, tolerance),
        Form::Paraxial => mask.intensity(crossing, spectrum, Jambs::Paraxial, tolerance),
    }
}
