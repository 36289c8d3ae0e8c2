//! Infinitely long openings in one plane: the exact aperture where they are narrow, the closed form where they are wide.

use std::num::NonZeroUsize;

use gauss_quad::legendre::GaussLegendre;

use super::aperture::Aperture;
use super::crossing::{Crossing, Spectrum};
use super::mask::{Jambs, Mask};
use super::quadrature::RaySum;

/// How an opening is modelled in one band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// Integral equation at a few frequencies of the band.
    Exact,
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
        if narrowest_ka(mask, spectrum) < NARROW_KA { Self::Exact } else { Self::Closed }
    }

    /// The form for one pair: the exact aperture a little further up for directions along the screen.
    pub fn of_pair(mask: &Mask, crossing: &Crossing, spectrum: &Spectrum) -> Self {
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
        Form::Closed => mask.intensity(crossing, spectrum, Jambs::Rigid, tolerance),
        Form::Paraxial => mask.intensity(crossing, spectrum, Jambs::Paraxial, tolerance),
    }
}
