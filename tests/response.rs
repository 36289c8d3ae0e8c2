//! Impulse responses: band energies, arrivals, silence, determinism.

mod filters;

use diffray::probe::{BandLevel, EarlyPath, Echogram, Reception};
use diffray::response::{RenderOptions, Response, render};
use diffray::scene::Band;
use filters::{band_means, class_1_means, octaves, third_octaves};

const RATE: u32 = 48_000;
const OPTIONS: RenderOptions = RenderOptions { sample_rate_hz: RATE, length_s: None, seed: 7 };

fn path(delay_s: f64, intensity: Vec<f64>) -> EarlyPath {
    let error = vec![0.0; intensity.len()];
    EarlyPath { label: "path".into(), reflections: 0, delay_s, intensity, error }
}

fn reception(bands: &[Band], paths: Vec<EarlyPath>, echogram: Option<Echogram>) -> Reception {
    let levels = (0..bands.len())
        .map(|b| {
            let early: f64 = paths.iter().map(|p| p.intensity[b]).sum();
            let late: f64 = echogram.as_ref().map_or(0.0, |e| e.energy[b].iter().sum());
            let intensity = early + late;
            BandLevel { band_hz: bands[b].nominal_hz, intensity, intensity_error: 0.0, early_share: early / intensity }
        })
        .collect();
    Reception { source: "talker".into(), probe: "mic-1".into(), paths, echogram, levels }
}

/// An exponential decay in every band: total energy, reverberation time, start, and a share of each bin as noise.
fn decay(energy: &[f64], t60_s: &[f64], start_s: f64, noise: f64) -> Echogram {
    let bin_s = 0.002;
    let mut state = 12345u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
    };
    let energy = energy
        .iter()
        .zip(t60_s)
        .map(|(total, t60)| {
            let rate = 6.0 * std::f64::consts::LN_10 / t60;
            let bins = ((start_s + 1.05 * t60) / bin_s) as usize;
            let mut bins: Vec<f64> = (0..bins)
                .map(|i| {
                    let t = |i: usize| (i as f64 * bin_s - start_s).max(0.0);
                    (-rate * t(i)).exp() - (-rate * t(i + 1)).exp()
                })
                .map(|e| e * (1.0 + noise * random()))
                .collect();
            let sum: f64 = bins.iter().sum();
            bins.iter_mut().for_each(|e| *e *= total / sum);
            bins
        })
        .collect::<Vec<_>>();
    let longest = energy.iter().map(Vec::len).max().unwrap_or(0);
    let energy = energy
        .into_iter()
        .map(|mut e| {
            e.resize(longest, 0.0);
            e
        })
        .collect::<Vec<_>>();
    Echogram { bin_s, std_error: vec![0.0; energy.len()], energy }
}

fn rendered(reception: &Reception, bands: &[Band], options: &RenderOptions) -> Response {
    match render(reception, bands, options) {
        Ok(response) => response,
        Err(warning) => panic!("{warning}"),
    }
}

fn peak(samples: &[f32]) -> usize {
    (0..samples.len()).max_by(|a, b| samples[*a].abs().total_cmp(&samples[*b].abs())).unwrap_or(0)
}

fn worst_db(means: &[f64], reception: &Reception) -> f64 {
    means.iter().zip(&reception.levels).map(|(m, l)| (10.0 * (m / l.intensity).log10()).abs()).fold(0.0, f64::max)
}

/// Rooms of increasing nastiness.
fn scenes(bands: &[Band]) -> Vec<(&'static str, Reception)> {
    let n = bands.len();
    let of = |f: &dyn Fn(f64) -> f64| bands.iter().map(|b| f((b.low_hz * b.high_hz).sqrt())).collect::<Vec<f64>>();
    let air = |r: f64, level: f64| of(&move |hz| level / (r * r) * (-1e-9 * hz * hz * r).exp());
    let shadow = |r: f64| of(&move |hz| 0.1 / (r * r) / (1.0 + hz / 200.0));
    let t60 = of(&|hz| 1.4 / (1.0 + hz / 6000.0));
    let flat = |r: f64| vec![1.0 / (r * r); n];
    let images: Vec<EarlyPath> = (0..40)
        .map(|i| {
            let r = 3.0 + 0.37 * f64::from(i) + 0.11 * f64::from(i * i % 7);
            path(r / 343.0, air(r, 0.97f64.powi(i)))
        })
        .collect();
    vec![
        ("floor reflection", reception(bands, vec![path(5.0 / 343.0, flat(5.0)), path(5.6 / 343.0, flat(5.6))], None)),
        ("shadow", reception(bands, vec![path(4.1 / 343.0, shadow(4.1)), path(4.4 / 343.0, shadow(4.4))], None)),
        ("images", reception(bands, images.clone(), None)),
        ("room", reception(bands, images.clone(), Some(decay(&of(&|hz| 0.2 / (1.0 + hz / 2000.0)), &t60, 0.03, 0.0)))),
        ("noisy room", reception(bands, images, Some(decay(&of(&|_| 0.05), &t60, 0.03, 3.0)))),
        ("reverberation only", reception(bands, vec![], Some(decay(&vec![0.01; n], &t60, 0.02, 0.5)))),
        (
            "through a wall",
            reception(
                bands,
                vec![path(3.0 / 343.0, of(&|hz| 1e-3 / 9.0 * (63.0 / hz).powi(2)))],
                Some(decay(&of(&|hz| 1e-3 * (63.0 / hz).powi(2)), &t60, 0.02, 1.0)),
            ),
        ),
    ]
}

#[test]
fn band_energies_equal_the_levels_whatever_interferes() {
    for bands in [octaves(63.0, 8000.0), third_octaves(63.0, 8000.0)] {
        for (name, reception) in scenes(&bands) {
            let response = rendered(&reception, &bands, &OPTIONS);
            let white = worst_db(&band_means(&response.samples, RATE, &bands), &reception);
            let class_1 =
                [3, 4].map(|order| worst_db(&class_1_means(&response.samples, RATE, &bands, order), &reception));
            let class_1 = class_1[0].max(class_1[1]);
            println!("{} bands, {name}: white mean {white:.3} dB, class 1 filters {class_1:.3} dB", bands.len());
            for warning in &response.warnings {
                println!("   {warning}");
            }
            assert!(white < 0.1, "{name}: {white} dB");
            assert!(class_1 < 0.3, "{name}: {class_1} dB");
        }
    }
}

#[test]
fn free_field_is_a_band_limited_impulse_of_one_over_r_at_r_over_c() {
    let bands = octaves(63.0, 8000.0);
    for r in [0.5, 1.0, 3.43, 5.0, 12.34567, 100.0] {
        let delay = r / 343.0;
        let response = rendered(&reception(&bands, vec![path(delay, vec![1.0 / (r * r); 8])], None), &bands, &OPTIONS);
        let arrival = delay * f64::from(RATE);
        for (n, sample) in response.samples.iter().enumerate() {
            let t = std::f64::consts::PI * (n as f64 - arrival);
            let ideal = if t.abs() < 1e-6 { 1.0 } else { t.sin() / t } / r;
            // 1.5e-4: the pulse is periodic over 8192 samples, which bends the sinc's far ends; f32 adds 1e-7.
            assert!((f64::from(*sample) - ideal).abs() < 1.5e-4 / r, "{r} m, sample {n}: {sample} {ideal}");
        }
        assert!((peak(&response.samples) as f64 - arrival).abs() <= 0.5 + 1e-6);
    }
}

#[test]
fn a_whole_number_of_samples_leaves_a_single_sample() {
    let bands = octaves(63.0, 8000.0);
    let response = rendered(&reception(&bands, vec![path(0.01, vec![0.25; 8])], None), &bands, &OPTIONS);
    for (n, sample) in response.samples.iter().enumerate() {
        assert_eq!(*sample, if n == 480 { 0.5 } else { 0.0 }, "{n}");
    }
}

#[test]
fn the_direct_sound_stays_at_its_time() {
    for bands in [octaves(63.0, 8000.0), third_octaves(63.0, 8000.0)] {
        for (name, reception) in scenes(&bands).into_iter().filter(|s| !s.1.paths.is_empty()) {
            let response = rendered(&reception, &bands, &OPTIONS);
            let arrival = reception.paths[0].delay_s * f64::from(RATE);
            let near = arrival as usize - 5..arrival as usize + 12;
            let found = near.start + peak(&response.samples[near]);
            assert!((found as f64 - arrival).abs() <= 1.0, "{name}: {found} {arrival}");
            let before: f64 = response.samples[..arrival as usize - 30].iter().map(|s| f64::from(*s).powi(2)).sum();
            let all: f64 = response.samples.iter().map(|s| f64::from(*s).powi(2)).sum();
            println!(
                "{} {name}: peak {found} of {arrival:.2}, before {:.1} dB",
                bands.len(),
                10.0 * (before / all).log10()
            );
            assert!(before < 1e-1 * all, "{name}: {before} {all}");
        }
    }
}
