//! The far field of the exact slit as a table: how a narrow side of an opening scatters where the incident field has no memory of
//! its place.

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use super::aperture::Aperture;
use super::crossing::{Incident, Spectrum};
use super::slit::{gauss_nodes, resonant};
use super::thick::{ThickAperture, depths};

/// The exact aperture's far field Lambda |A|^2 / (width sin^2 beta), band mean, over sin(beta), sin(theta_i),
/// sin(theta_o): what the position-averaged weight times O^2 is for a wide opening.
pub(super) struct Marginal {
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
    pub(super) fn new(width_m: f64, thickness_m: f64, spectrum: &Spectrum) -> Self {
        let ka = spectrum.high_k() * width_m;
        let directions = if ka < 1.5 { 9 } else { 17 };
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let depths = depths(width_m, thickness_m);
        let deep = depths.iter().any(|(_, depth_m)| *depth_m > 0.0);
        let half = 0.5 * width_m;
        let resonances = if deep { resonant(&[[-half, half]], thickness_m, low, high) } else { 0.0 };
        let count = if high > low { (3 + resonances.ceil() as usize).min(MOST_NODES) } else { 1 };
        let sine = |i: usize| 2.0 * i as f64 / (directions - 1) as f64 - 1.0;
        let sines: Vec<f64> = (0..directions).map(sine).collect();
        let mut table = Vec::with_capacity(BETAS * directions * directions);
        for beta in 0..BETAS {
            let sin_beta = MIN_SIN_BETA + (1.0 - MIN_SIN_BETA) * beta as f64 / (BETAS - 1) as f64;
            let mut plane = vec![0.0; directions * directions];
            let nodes = gauss_nodes(low, high, count).flat_map(|node| depths.iter().map(move |depth| (node, *depth)));
            for ((k, weight), (share, depth_m)) in nodes {
                let scale = share * weight * TAU / (k * width_m * sin_beta * sin_beta);
                let mut add = |i: usize, amplitudes: &[Complex64]| {
                    for (o, amplitude) in amplitudes.iter().enumerate() {
                        plane[i * directions + o] += scale * amplitude.norm_sqr();
                    }
                };
                if depth_m > 0.0 {
                    let aperture = ThickAperture::new(&[[-half, half]], depth_m, k * sin_beta);
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
    pub(super) fn total(&self, sin_beta: f64, sin_i: f64) -> f64 {
        let (b, fb) = place((sin_beta - MIN_SIN_BETA) / (1.0 - MIN_SIN_BETA), BETAS);
        let (i, fi) = place(0.5 * (sin_i + 1.0), self.directions);
        let row = |b: usize| {
            let at = |i: usize| self.totals[b * self.directions + i];
            at(i) * (1.0 - fi) + at(i + 1) * fi
        };
        row(b) * (1.0 - fb) + row(b + 1) * fb
    }

    pub(super) fn at(&self, sin_beta: f64, sin_i: f64, sin_o: f64) -> f64 {
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
        // in m, octave band from 63 Hz.
        let exact = [
            (0.002, 0.1, 1, 0.147_726),
            (0.01, 0.1, 3, 0.222_475),
            (0.01, 0.1, 5, 1.726_284),
            (0.005, 0.04, 4, 0.266_728),
            (0.05, 0.1, 4, 1.669_997),
        ];
        for (width, depth, band, exact) in exact {
            let f = [63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0][band];
            let spectrum = Spectrum { low_hz: f * FRAC_1_SQRT_2, high_hz: f * SQRT_2, speed_m_s: 343.0 };
            let total = Marginal::new(width, depth, &spectrum).total(1.0, 0.0);
            // 2 %: table, and at most 12 frequencies over a resonance.
            assert!((total / exact - 1.0).abs() < 0.02, "{width} m by {depth} m: {total} {exact}");
        }
    }
}
