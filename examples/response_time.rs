//! How long it takes to render an impulse response of 1.5 s at 48 kHz: 60 early paths and a traced decay.

use std::time::Instant;

use diffray::probe::{BandLevel, EarlyPath, Echogram, Reception};
use diffray::response::{RenderOptions, metrics, render};
use diffray::scene::Band;

fn bands(per_octave: f64) -> Vec<Band> {
    let count = (7.0 * per_octave) as i32;
    (0..=count)
        .map(|i| {
            let centre = 62.5 * (f64::from(i) / per_octave).exp2();
            let half = (0.5 / per_octave).exp2();
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
            EarlyPath { label: format!("path {i}"), reflections: 1, delay_s: r / 343.0, intensity, error }
        })
        .collect();
    let bins: Vec<f64> = (0..300).map(|i| 1e-3 * (-13.8 * 0.005 * f64::from(i) / 1.2).exp()).collect();
    let echogram = Echogram { bin_s: 0.005, energy: vec![bins; bands.len()], std_error: vec![0.0; bands.len()] };
    let levels = bands
        .iter()
        .enumerate()
        .map(|(b, band)| {
            let early: f64 = paths.iter().map(|p| p.intensity[b]).sum();
            let intensity = early + echogram.energy[b].iter().sum::<f64>();
            BandLevel { band_hz: band.nominal_hz, intensity, intensity_error: 0.0, early_share: early / intensity }
        })
        .collect();
    Reception { source: "source".into(), probe: "probe".into(), paths, echogram: Some(echogram), levels }
}

fn main() {
    for per_octave in [1.0, 3.0] {
        let bands = bands(per_octave);
        let reception = reception(&bands);
        let options = RenderOptions { sample_rate_hz: 48_000, length_s: Some(1.5), seed: 1 };
        let best = |run: &dyn Fn()| {
            (0..10)
                .map(|_| {
                    let start = Instant::now();
                    run();
                    start.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min)
        };
        let rendering = best(&|| drop(std::hint::black_box(render(&reception, &bands, &options))));
        let evaluating = best(&|| drop(std::hint::black_box(metrics(&reception, &bands))));
        println!("{} bands: response {:.1} ms, metrics {:.2} ms", bands.len(), 1e3 * rendering, 1e3 * evaluating);
    }
}
