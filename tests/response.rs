//! Impulse responses: band energies, arrivals, silence, determinism.

mod filters;

use diffray::probe::{BandLevel, EarlyPath, Echogram, Reception};
use diffray::response::{RenderOptions, Response, render, suggested_length_s};
use diffray::scene::{Band, ProbeFormat};
use filters::{band_means, class_1_means, octaves, third_octaves};

const RATE: u32 = 48_000;
const OPTIONS: RenderOptions =
    RenderOptions { sample_rate_hz: RATE, length_s: None, seed: 7, format: ProbeFormat::Omni };

fn path(delay_s: f64, intensity: Vec<f64>) -> EarlyPath {
    let error = vec![0.0; intensity.len()];
    EarlyPath {
        label: "path".into(),
        reflections: 0,
        from: glam::DVec3::X,
        delay_s,
        intensity,
        error,
        course: Vec::new(),
    }
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
    Echogram { bin_s, bin_error: Vec::new(), reflections_per_s3: None, std_error: vec![0.0; energy.len()], energy }
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
            assert!(class_1 < 0.2, "{name}: {class_1} dB");
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

/// Energy up to sample `end` of the mean of neighbouring samples, which lacks the band limit's own ripple at half the rate.
fn energy_before(samples: &[f32], end: usize) -> f64 {
    samples[..end].windows(2).map(|w| f64::from(0.5 * (w[0] + w[1])).powi(2)).sum()
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
            let before = energy_before(&response.samples, arrival as usize - 5);
            let all = energy_before(&response.samples, response.samples.len());
            println!(
                "{} {name}: peak {found} of {arrival:.2}, before {:.1} dB",
                bands.len(),
                10.0 * (before / all).log10()
            );
            assert!(before < 1e-3 * all, "{name}: {before} {all}");
        }
    }
}

/// Uniform random numbers in 0..1.
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[test]
fn band_energies_equal_the_levels_in_random_scenes() {
    let mut random = Uniform(5);
    for case in 0..16 {
        let bands = if case % 2 == 0 { octaves(63.0, 8000.0) } else { third_octaves(63.0, 8000.0) };
        let centres: Vec<f64> = bands.iter().map(|b| (b.low_hz * b.high_hz).sqrt()).collect();
        // Up to 12 dB an octave down or 3 up, and up to +-6 dB from band to band.
        let (slope, scatter_db) = (4.0 * random.next() - 1.0, [0.0, 1.0, 3.0, 6.0][case / 2 % 4]);
        let nearest = 0.5 + 20.0 * random.next();
        let count = (30.0 * random.next()) as usize;
        let paths: Vec<EarlyPath> = (0..count)
            .map(|_| {
                let r = nearest * (1.0 + 2.0 * random.next().powi(2));
                let own = 1.5 * slope * random.next();
                let scattered = |hz: &f64| {
                    let scatter = 10f64.powf(0.1 * scatter_db * (2.0 * random.next() - 1.0));
                    (hz / 500.0).powf(-own) * scatter / (r * r)
                };
                path(r / 343.0, centres.iter().map(scattered).collect())
            })
            .collect();
        let late = (random.next() < 0.7 || count == 0).then(|| {
            let level = 10f64.powf(-3.0 * random.next()) / nearest;
            let energy: Vec<f64> = centres.iter().map(|hz| level * (hz / 500.0).powf(-slope)).collect();
            let t60 = 0.2 + 2.0 * random.next();
            let t60: Vec<f64> = centres.iter().map(|hz| t60 / (1.0 + hz / 8000.0)).collect();
            decay(&energy, &t60, nearest / 343.0, 3.0 * random.next())
        });
        let reception = reception(&bands, paths, late);
        let response = rendered(&reception, &bands, &OPTIONS);
        let white = worst_db(&band_means(&response.samples, RATE, &bands), &reception);
        assert!(white < 0.15, "case {case}: {white} dB");
        // Late noise of a band below 100 Hz keeps its own energy, but not what filters hear of its neighbours.
        let (low, high): (Vec<usize>, Vec<usize>) = (0..bands.len()).partition(|b| bands[*b].high_hz < 100.0);
        let bound_db = if reception.echogram.is_some() { 0.4 } else { 0.2 };
        for order in [3, 4] {
            let means = class_1_means(&response.samples, RATE, &bands, order);
            for (which, bound_db) in [(&low, bound_db), (&high, 0.2)] {
                let error_db = |b: &usize| 10.0 * (means[*b] / reception.levels[*b].intensity).log10();
                let worst = which.iter().map(error_db).fold(0.0, |worst: f64, e| worst.max(e.abs()));
                assert!(worst < bound_db, "case {case}, order {order}: {worst} dB");
            }
        }
    }
}

#[test]
fn a_band_without_energy_is_silent() {
    let bands = octaves(63.0, 8000.0);
    for silent in [0, 3, 7] {
        let with_hole = |level: f64| (0..8).map(|b| if b == silent { 0.0 } else { level }).collect::<Vec<_>>();
        let t60 = [0.6; 8];
        // 50 dB: what the length of the response (0.33 s) leaves of the lowest band's flank.
        for late in [None, Some(decay(&with_hole(0.02), &t60, 0.03, 0.0))] {
            let paths = vec![path(0.0305, with_hole(0.01)), path(0.0341, with_hole(0.008))];
            let reception = reception(&bands, paths, late);
            let response = rendered(&reception, &bands, &OPTIONS);
            let means = band_means(&response.samples, RATE, &bands);
            for (b, mean) in means.iter().enumerate() {
                let level_db = 10.0 * (mean / reception.levels[(silent + 2) % 7].intensity).log10();
                if b == silent {
                    assert!(level_db < -50.0, "{b}: {level_db} dB");
                } else {
                    assert!(level_db.abs() < 0.15, "{b}: {level_db} dB");
                }
            }
            let found = peak(&response.samples) as f64;
            assert!((found - 0.0305 * f64::from(RATE)).abs() <= 1.0, "{silent}: {found}");
        }
    }
}

#[test]
fn negative_bins_keep_the_band_energy() {
    let bands = octaves(63.0, 8000.0);
    let mut late = decay(&[0.01; 8], &[0.5; 8], 0.01, 0.0);
    for (b, bins) in late.energy.iter_mut().enumerate() {
        for i in (20 + b..200).step_by(3) {
            let moved = 2.5 * bins[i];
            bins[i] -= moved;
            bins[i + 1] += moved;
        }
    }
    let reception = reception(&bands, vec![path(0.01, vec![0.02; 8])], Some(late));
    let response = rendered(&reception, &bands, &OPTIONS);
    assert!(worst_db(&band_means(&response.samples, RATE, &bands), &reception) < 0.05);
    assert!(response.warnings.is_empty(), "{:?}", response.warnings);
}

#[test]
fn nothing_precedes_the_first_arrival_and_the_late_part_follows_its_echogram() {
    let bands = octaves(63.0, 8000.0);
    let mut late = Echogram {
        bin_s: 0.005,
        bin_error: Vec::new(),
        reflections_per_s3: None,
        energy: vec![vec![0.0; 100]; 8],
        std_error: vec![0.0; 8],
    };
    late.energy.iter_mut().for_each(|bins| bins[20..40].fill(0.001));
    let reception = reception(&bands, vec![], Some(late));
    let response = rendered(&reception, &bands, &OPTIONS);
    let energy = |from_s: f64, to_s: f64| -> f64 {
        let sample = |s: f64| ((s * f64::from(RATE)) as usize).min(response.samples.len());
        response.samples[sample(from_s)..sample(to_s)].iter().map(|s| f64::from(*s).powi(2)).sum()
    };
    let all = energy(0.0, 1.0);
    // The band gain rings for some milliseconds after, not before.
    assert!(energy(0.0, 0.0999) < 1e-4 * all, "{}", energy(0.0, 0.0999) / all);
    assert!(energy(0.205, 1.0) < 0.02 * all, "{}", energy(0.205, 1.0) / all);
    // Random signs have the same energy everywhere, so the halves agree within the few low-frequency beats.
    let half = energy(0.1, 0.15) / all;
    assert!((half - 0.5).abs() < 0.05, "{half}");
}

#[test]
fn reflections_become_denser_as_the_volume_of_the_room_says() {
    // A hall of 10,000 m^3: 4 pi c^3 t^2/V = 507 reflections a second after 0.1 s, 2028 after 0.2 s, more than samples after 1 s.
    let bands = octaves(63.0, 8000.0);
    let growth = 4.0 * std::f64::consts::PI * 343.0_f64.powi(3) / 10_000.0;
    let mut late = decay(&[0.01; 8], &[2.0; 8], 0.05, 0.0);
    late.reflections_per_s3 = Some(growth);
    let hall = reception(&bands, vec![], Some(late));
    let response = rendered(&hall, &bands, &OPTIONS);
    assert!(worst_db(&band_means(&response.samples, RATE, &bands), &hall) < 0.05);
    // Pulses of the same height: all of a time have the same power together.
    let at = |n: usize| n as f64 / f64::from(RATE);
    let pulses = |from: usize, to: usize| -> Vec<f64> {
        let decay = |t: f64| (3.0 * std::f64::consts::LN_10 * t / 2.0).exp();
        (from..to).map(|n| f64::from(response.samples[n]).abs() * at(n) * decay(at(n))).collect()
    };
    let early = pulses(4800, 9600);
    let mut sorted = early.clone();
    sorted.sort_by(f64::total_cmp);
    let threshold = 0.4 * sorted[sorted.len() - 100];
    let (mut count, mut last) = (0, None);
    for (n, _) in early.iter().enumerate().filter(|(_, p)| **p > threshold) {
        count += usize::from(last.is_none_or(|last| n > last + 10));
        last = Some(n);
    }
    let expected = growth * (at(9600).powi(3) - at(4800).powi(3)) / 3.0;
    println!("{count} pulses, {expected:.0} expected");
    // Some overlap, some ring.
    assert!((count as f64 / expected - 1.0).abs() < 0.15, "{count}, {expected}");
    // Single pulses stand out, noise of random signs has a kurtosis of 3 at most.
    let kurtosis = |values: &[f64]| {
        let moment = |n: i32| values.iter().map(|v| v.powi(n)).sum::<f64>() / values.len() as f64;
        moment(4) / moment(2).powi(2)
    };
    let (early, dense) = (kurtosis(&early), kurtosis(&pulses(48_000, 57_600)));
    println!("kurtosis {early:.2}, then {dense:.2}");
    assert!(early > 8.0 && dense < 3.2, "{early}, {dense}");
}

#[test]
fn the_same_seed_gives_the_same_samples_and_names_and_seeds_change_only_the_noise() {
    let bands = octaves(63.0, 8000.0);
    let late = decay(&[0.01; 8], &[0.4; 8], 0.05, 0.0);
    let first = reception(&bands, vec![path(0.01, vec![0.02; 8])], Some(late));
    let mut other_probe = first.clone();
    other_probe.probe = "mic-2".into();
    let original = rendered(&first, &bands, &OPTIONS);
    assert_eq!(original, rendered(&first, &bands, &OPTIONS));
    let seeded = rendered(&first, &bands, &RenderOptions { seed: 8, ..OPTIONS });
    for other in [seeded, rendered(&other_probe, &bands, &OPTIONS)] {
        let (mut both, mut one, mut two) = (0.0, 0.0, 0.0);
        for (a, b) in original.samples[4000..].iter().zip(&other.samples[4000..]) {
            both += f64::from(a * b);
            one += f64::from(a * a);
            two += f64::from(b * b);
        }
        let correlation = both / (one * two).sqrt();
        assert!(correlation.abs() < 0.1, "{correlation}");
        assert!((other.samples[480] / original.samples[480] - 1.0).abs() < 0.05);
    }
}

#[test]
fn silence_is_a_valid_response() {
    let bands = octaves(63.0, 8000.0);
    for late in [
        None,
        Some(Echogram {
            bin_s: 0.01,
            bin_error: Vec::new(),
            reflections_per_s3: None,
            energy: vec![vec![0.0; 10]; 8],
            std_error: vec![0.0; 8],
        }),
    ] {
        let reception = reception(&bands, vec![], late);
        let response = rendered(&reception, &bands, &OPTIONS);
        assert!(!response.samples.is_empty() && response.samples.iter().all(|s| *s == 0.0));
    }
}

#[test]
fn the_length_holds_sixty_decibels_of_decay_or_is_what_was_asked_for() {
    let bands = octaves(63.0, 8000.0);
    let decaying = reception(&bands, vec![], Some(decay(&[0.01; 8], &[0.8; 8], 0.05, 0.0)));
    // 0.05 s to the first sound; the decay by 60 dB of an exponential that ends at 1.05 T; 0.1 s for the lowest band to ring
    // down. Within a bin.
    let end = 10f64.powf(-6.3);
    let decayed_s = -0.8 / 6.0 * (end + 1e-6 * (1.0 - end)).log10();
    let length_s = suggested_length_s(&decaying);
    assert!((length_s - 0.15 - decayed_s).abs() < 0.002, "{length_s}");
    let free = reception(&bands, vec![path(0.02, vec![0.1; 8])], None);
    assert!((suggested_length_s(&free) - 0.12).abs() < 1e-6, "{}", suggested_length_s(&free));

    let short = RenderOptions { length_s: Some(0.3), ..OPTIONS };
    let response = rendered(&decaying, &bands, &short);
    assert_eq!(response.samples.len(), 14_400);
    assert!(response.warnings.iter().any(|w| w.observation.contains("arrives later")), "{:?}", response.warnings);
    // What is cut off is missing: 10^(-6 * 0.25 / 0.8) of the energy.
    let kept_db = 10.0 * (1.0 - 10f64.powf(-6.0 * 0.25 / 0.8)).log10();
    for (mean, level) in band_means(&response.samples, RATE, &bands).iter().zip(&decaying.levels) {
        let db = 10.0 * (mean / level.intensity).log10();
        assert!((db - kept_db).abs() < 0.05, "{db} {kept_db}");
    }
    // Noise that carries on to the last sample loses a beat or two of it, no more.
    let long = rendered(&decaying, &bands, &RenderOptions { length_s: Some(2.0), ..OPTIONS });
    assert_eq!(long.samples.len(), 96_000);
    assert!(long.warnings.is_empty(), "{:?}", long.warnings);
}

#[test]
fn tones_and_impossible_input_are_refused_with_a_reason() {
    let bands = octaves(63.0, 8000.0);
    let good = reception(&bands, vec![path(0.01, vec![1.0; 8])], None);
    let refused = |reception: &Reception, bands: &[Band], options: &RenderOptions, part: &str| {
        let Err(warning) = render(reception, bands, options) else { panic!("rendered: {part}") };
        assert!(warning.observation.contains(part), "{warning}");
    };
    let tones: Vec<Band> =
        bands.iter().map(|b| Band { nominal_hz: b.nominal_hz, low_hz: b.nominal_hz, high_hz: b.nominal_hz }).collect();
    refused(&good, &tones, &OPTIONS, "single frequencies");
    refused(&good, &bands[1..], &OPTIONS, "disagree in size");
    let mut bad = good.clone();
    bad.paths[0].intensity[2] = f64::NAN;
    refused(&bad, &bands, &OPTIONS, "not finite");
    for length_s in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
        refused(&good, &bands, &RenderOptions { length_s: Some(length_s), ..OPTIONS }, "no possible length");
    }
    refused(&good, &bands, &RenderOptions { sample_rate_hz: 0, ..OPTIONS }, "no possible length");
}

#[test]
fn low_sample_rates_keep_the_bands_they_hold_and_say_so() {
    let bands = octaves(63.0, 8000.0);
    let reception = reception(&bands, vec![path(0.02, vec![0.04; 8])], Some(decay(&[0.01; 8], &[0.5; 8], 0.03, 0.0)));
    for rate in [8000, 16_000, 44_100, 96_000, 192_000] {
        let response = rendered(&reception, &bands, &RenderOptions { sample_rate_hz: rate, ..OPTIONS });
        let held = bands.iter().take_while(|b| b.high_hz < 0.5 * f64::from(rate)).count();
        assert_eq!(response.warnings.len(), usize::from(held < 8), "{rate}: {:?}", response.warnings);
        let means = band_means(&response.samples, rate, &bands[..held]);
        assert!(worst_db(&means, &reception) < 0.1, "{rate}: {means:?}");
    }
}

#[test]
fn wav_files_read_back_as_written_and_replace_older_ones() {
    let bands = octaves(63.0, 8000.0);
    let response = rendered(&reception(&bands, vec![path(0.01234, vec![4.0; 8])], None), &bands, &OPTIONS);
    let Ok(folder) = tempfile::tempdir() else { panic!("no folder for the test") };
    let file = folder.path().join("talker-mic-1.wav");
    for _ in 0..2 {
        assert!(response.write_wav(&file).is_ok());
    }
    let Ok(reader) = hound::WavReader::open(&file) else { panic!("not a WAV file") };
    assert_eq!(
        reader.spec(),
        hound::WavSpec {
            channels: 1,
            sample_rate: RATE,
            bits_per_sample: 32,
            sample_format: hound::SampleFormat::Float
        }
    );
    let samples: Vec<f32> = reader.into_samples().filter_map(Result::ok).collect();
    assert_eq!(samples, response.samples);
    assert_eq!(std::fs::read_dir(folder.path()).map(Iterator::count).ok(), Some(1), "a temporary file is left");

    let nowhere = folder.path().join("missing").join("a.wav");
    let Err(error) = response.write_wav(&nowhere) else { panic!("written to nowhere") };
    assert!(error.to_string().contains("cannot write"), "{error}");
}
