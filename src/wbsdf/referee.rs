//! The referee: every opening solved exactly at many frequencies, and its complex pressure.
//!
//! Nothing here is fast; it is what the signed rays are judged by (`transport = "exact"`), and what paths that interfere
//! are made of.

use std::f64::consts::{FRAC_PI_4, TAU};

use num_complex::Complex64;

use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::{Jambs, Mask};
use super::quadrature::RaySum;
use super::slit::{Solver, depths_of, half_plane, sin_beta, single_edge, spread};
use super::thick::blended;

/// Frequencies of a band, at the middles of equal parts: exact reference tables are made this way (docs/verification.md).
const FREQUENCIES: usize = 64;
/// Unknowns compared with the solver's usual number: the intensity is converged to 1e-4.
const FINER: usize = 2;

/// Intensity behind infinitely long openings relative to the source's free field at 1 m, by the integral equation (8)
/// or (8a) at 64 frequencies of a band, one of a tone, at any width; a half-plane by the exact wedge.
///
/// `thickness_m`: of the wall, in the middle of which the plane of `crossing` lies. Two unbounded openings (a strip) have no
/// equation here: the closed form (5a-c) with its stated error.
pub fn exact_intensity(mask: &Mask, thickness_m: f64, crossing: &Crossing, spectrum: &Spectrum) -> RaySum {
    if let Some((edge_m, side)) = single_edge(mask) {
        return half_plane(edge_m, side, crossing, spectrum);
    }
    if !bounded(mask) {
        return mask.intensity(crossing, spectrum, Jambs::Rigid, 1e-4);
    }
    let count = if spectrum.high_hz > spectrum.low_hz { FREQUENCIES } else { 1 };
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let sin_beta = sin_beta(mask, crossing);
    let sum: f64 = (0..count)
        .map(|i| low + (i as f64 + 0.5) / count as f64 * (high - low))
        .map(|k| transfer(mask, thickness_m, k * sin_beta, FINER, crossing).norm_sqr())
        .sum();
    let value = sum / count as f64 * spread(mask, crossing);
    RaySum { value, error: 1e-4 * value, absolute: value, rays: count }
}

/// p/|p_free| across the edges at wave number `k` across them, with `finer` times as many unknowns as usual.
fn transfer(mask: &Mask, thickness_m: f64, k: f64, finer: usize, crossing: &Crossing) -> Complex64 {
    let depths = depths_of(mask, thickness_m).into_iter();
    blended(depths.map(|(share, depth_m)| (share, Solver::new(mask, depth_m, k, finer).transfer(crossing))))
}

/// Complex pressure behind bounded openings at wave number `k` in 1/m: its square is the intensity relative to the source's
/// free field at 1 m; silence for unbounded ones, whose field [`WedgeField`](super::wedge::WedgeField) gives.
///
/// Where nothing is in the way it would be exp(i k R)/R for a point source, H0(k R) with the modulus 1/sqrt(R) for a line
/// source (a phase of k R - pi/4 far away), and exp(i k s.x) for a plane wave that has phase 0 at the origin of the frame.
pub fn pressure(mask: &Mask, thickness_m: f64, crossing: &Crossing, k: f64) -> Complex64 {
    if !bounded(mask) || mask.openings().is_empty() {
        return Complex64::ZERO;
    }
    let sin_beta = sin_beta(mask, crossing);
    let transfer = transfer(mask, thickness_m, k * sin_beta, 1, crossing) * spread(mask, crossing).sqrt();
    match crossing.incident {
        Incident::Plane { .. } => transfer,
        // The equation's source is (i/4) H0.
        Incident::Line { .. } => transfer * Complex64::new(0.0, -1.0),
        Incident::Point { dy_m, .. } => {
            // The whole phase is k times the length in space: across the edges (k sin beta) rho, along them (k cos beta) dy.
            let along = k * (1.0 - sin_beta * sin_beta).max(0.0).sqrt() * dy_m.abs();
            transfer * Complex64::from_polar(1.0, along - TAU / 4.0 + FRAC_PI_4)
        }
    }
}

fn bounded(mask: &Mask) -> bool {
    mask.openings().iter().flatten().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wbsdf::slit;

    const OCTAVE: Spectrum = Spectrum { low_hz: 707.106781, high_hz: 1414.213562, speed_m_s: 343.0 };

    #[test]
    fn the_square_of_the_pressure_is_the_intensity() {
        let mask = Mask::new(&[[-0.1, 0.05], [0.1, 0.2]]);
        let tone = Spectrum::tone(900.0, 343.0);
        for thickness_m in [0.0, 0.1] {
            for incident in [
                Incident::Line { x_m: -0.5, z_m: 1.0 },
                Incident::Point { x_m: -0.5, z_m: 1.0, dy_m: 0.8 },
                Incident::Plane { s_x: 0.4, s_y: 0.3 },
            ] {
                let crossing = Crossing { incident, x_m: 0.7, z_m: 1.4 };
                let p = pressure(&mask, thickness_m, &crossing, tone.high_k()).norm_sqr();
                let exact = exact_intensity(&mask, thickness_m, &crossing, &tone).value;
                assert!((p / exact - 1.0).abs() < 1e-3, "{thickness_m} {incident:?}: {p} {exact}");
            }
        }
    }

    #[test]
    fn through_a_wide_opening_the_pressure_has_the_free_field_s_phase() {
        let mask = Mask::new(&[[-4.0, 4.0]]);
        let (k, r) = (40.0, 0.3_f64.hypot(2.0));
        let at = |incident| pressure(&mask, 0.0, &Crossing { incident, x_m: 0.2, z_m: 1.0 }, k);
        let line =
            at(Incident::Line { x_m: -0.1, z_m: 1.0 }) / Complex64::from_polar(1.0 / r.sqrt(), k * r - FRAC_PI_4);
        let length = r.hypot(0.7);
        let point = at(Incident::Point { x_m: -0.1, z_m: 1.0, dy_m: -0.7 });
        let point = point / Complex64::from_polar(1.0 / length, k * length);
        let plane = at(Incident::Plane { s_x: 0.0, s_y: 0.0 }) / Complex64::from_polar(1.0, k);
        // The jambs are 4 m off: each adds about (2 pi k)^(-1/2) / 3 = 2 %.
        for (name, ratio) in [("line", line), ("point", point), ("plane", plane)] {
            assert!((ratio - 1.0).norm() < 0.05, "{name}: {ratio}");
        }
    }

    #[test]
    fn the_fast_forms_agree_with_the_referee() {
        for (width, thickness_m) in [(0.05, 0.0), (0.9, 0.0), (0.05, 0.1)] {
            let mask = Mask::new(&[[0.0, width]]);
            let crossing = Crossing { incident: Incident::Line { x_m: -1.0, z_m: 1.5 }, x_m: 1.0, z_m: 2.0 };
            let fast = slit::intensity(&mask, thickness_m, &crossing, &OCTAVE, || None, 1e-3).value;
            let exact = exact_intensity(&mask, thickness_m, &crossing, &OCTAVE).value;
            // 0.02 dB: the closed form's own error; and 64 midpoints are a mean to 1e-4.
            assert!((fast / exact - 1.0).abs() < 0.005, "{width} {thickness_m}: {fast} {exact}");
        }
    }
}
