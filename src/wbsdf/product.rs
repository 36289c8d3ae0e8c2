//! The published small-angle form for rectangular openings: the product of its two directions, frequency by frequency.
//!
//! In each direction the opening is a slit, or several in one plane, between source and receiver at the distances that the
//! shortest way through the opening has when it is unfolded.

use std::f64::consts::TAU;

use glam::DVec3;

use super::crossing::{Crossing, Spectrum};
use super::mask::Mask;
use super::rim::{facing, span, unfolded};
use super::slit::{self, MOST_FREQUENCIES, gauss_nodes};

/// Gauss frequencies a band beyond those of the span of the edges.
const FREQUENCIES: usize = 16;
/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-4;

/// Intensity at `receiver` of a point source at `source`, on opposite sides of z = 0, behind the openings `x` by `y`, relative to
/// the free field at 1 m, band mean.
pub(super) fn paraxial_intensity(x: &Mask, y: &Mask, source: DVec3, receiver: DVec3, spectrum: &Spectrum) -> f64 {
    let (source, receiver) = facing(source, receiver);
    let Some([along_x, along_y]) = unfolded(x, y, source, receiver) else { return 0.0 };
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    // Each side is a sum of sines in f whose delays differ by the detours over its edges at most.
    let detour = |mask: &Mask, crossing: &Crossing| {
        let shortest = crossing.length_m(crossing.straight_x_m());
        let ends = span(mask).map(|x| if x.is_finite() { crossing.length_m(x) - shortest } else { 0.0 });
        ends[0].max(ends[1])
    };
    let smooth = 0.7 * (high - low) * (detour(x, &along_x) + detour(y, &along_y));
    let count = if high > low { FREQUENCIES + (smooth.ceil() as usize).min(MOST_FREQUENCIES) } else { 1 };
    // Spreads like a line source along either side: 1/r^2 where the straight way is free.
    let at = |k: f64| {
        let tone = Spectrum::tone(k * spectrum.speed_m_s / TAU, spectrum.speed_m_s);
        slit::paraxial_intensity(x, &along_x, &tone, TOLERANCE).value
            * slit::paraxial_intensity(y, &along_y, &tone, TOLERANCE).value
    };
    gauss_nodes(low, high, count).map(|(k, weight)| weight * at(k)).sum()
}
