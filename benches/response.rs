//! Impulse responses of 1.5 s at 48 kHz from 60 early paths and a traced decay, and their metrics:
//! `cargo bench --bench response`.

use diffray::probe::{BandLevel, EarlyPath, Echogram, Reception};
use diffray::response::{RenderOptions, metrics, render};
use diffray::scene::{Band, ProbeFormat};
use divan::{Bencher, black_box};

/// Bands an octave.
const SPACINGS: [i32; 2] = [1, 3];

fn main() {
    divan::main();
}

fn bands(per_octave: i32) -> Vec<Band> {
    (0..=7 * per_octave)
        .map(|i| {
            let centre = 62.5 * (f64::from(i) / f64::from(per_octave)).exp2();
            let half = (0.5 / f64::from(per_octave)).exp2();
            Band { nominal_hz: centre, low_hz: centre / half, high_hz: centre * half }
        })
        .collect()
}

fn reception(bands: &[Band]) -> Reception {
    let spectrum =
        |r: f64| -> Vec<f64> { bands.iter().map(|b| (-2e-9 * b.low_hz * b.high_hz * r).exp() / (r * r)).collect() };
    let paths: Vec<EarlyPath> = (0..60)
        .map(|i| {
            let r = 3.0 + 0.41 * f64::from(i) + 0.13 * f64::from(i * i % 11);
            let intensity = spectrum(r);
            let error = vec![0.0; bands.len()];
            // The paths of a room with a door have their course in sixths of an octave.
            let parts = 48 / bands.len();
            let comb = |e: &f64| (0..parts).map(|n| e * (1.0 + 0.5 * (-1.0_f64).powi(n as i32))).collect::<Vec<_>>();
            let course = intensity.iter().flat_map(comb).collect();
            EarlyPath {
                label: format!("path {i}"),
                reflections: 1,
                from: glam::DVec3::X,
                delay_s: r / 343.0,
                intensity,
                error,
                course,
            }
        })
        .collect();
    let bins: Vec<f64> = (0..300).map(|i| 1e-3 * (-13.8 * 0.005 * f64::from(i) / 1.2).exp()).collect();
    let echogram = Echogram {
        bin_s: 0.005,
        bin_error: Vec::new(),
        reflections_per_s3: None,
        energy: vec![bins; bands.len()],
        std_error: vec![0.0; bands.len()],
    };
    let level = |(b, band): (usize, &Band)| {
        let early: f64 = paths.iter().map(|p| p.intensity[b]).sum();
        let intensity = early + echogram.energy[b].iter().sum::<f64>();
        BandLevel { band_hz: band.nominal_hz, intensity, intensity_error: 0.0, early_share: early / intensity }
    };
    let levels = bands.iter().enumerate().map(level).collect();
    Reception { source: "source".into(), probe: "probe".into(), paths, echogram: Some(echogram), levels }
}

#[divan::bench(args = SPACINGS)]
fn rendering(bencher: Bencher, per_octave: i32) {
    let bands = bands(per_octave);
    let reception = reception(&bands);
    let options = RenderOptions { sample_rate_hz: 48_000, length_s: Some(1.5), seed: 1, format: ProbeFormat::Omni };
    bencher.bench(|| render(black_box(&reception), &bands, &options));
}

#[divan::bench(args = SPACINGS)]
fn evaluating(bencher: Bencher, per_octave: i32) {
    let bands = bands(per_octave);
    let reception = reception(&bands);
    bencher.bench(|| metrics(black_box(&reception), &bands));
}
