//! The traced rays against statistical room acoustics, image sources and the laws of bookkeeping.

mod trace_rooms;

use diffray::trace::{CHUNK_RAYS, Ended, TracePlan};
use trace_rooms::*;

/// Kuttruff's decay time in s of a room with Lambert walls: Eyring's exponent corrected for the relative variance `gamma2` of
/// the free paths (Kuttruff, Room Acoustics, section 5.4: a'' = -ln(1-a) (1 + gamma2/2 ln(1-a))).
fn kuttruff(volume: f64, surface: f64, alpha: f64, gamma2: f64) -> f64 {
    let ln = (1.0 - alpha).ln();
    24.0 * 10f64.ln() / SPEED * volume / (surface * -ln * (1.0 + 0.5 * gamma2 * ln))
}

#[test]
fn diffuse_rooms_decay_as_eyring_and_kuttruff_say() {
    // gamma2 = 0.342 for a cube with Lambert walls (Kuttruff's table of Monte-Carlo results).
    let alphas = [0.05, 0.2, 0.5];
    let mut scene = shoebox([6.0; 3], &alphas, &[1.0; 3]);
    add_source(&mut scene, [1.5, 2.0, 2.5]);
    add_probe(&mut scene, [4.0, 4.5, 3.0]);
    let outcome = run(&scene, &plan(&scene, 2.5, 20_000));
    for (band, &alpha) in alphas.iter().enumerate() {
        let t30 = decay_time(&outcome.traced[0].echogram, band, -5.0, -35.0);
        let eyring = kuttruff(216.0, 216.0, alpha, 0.0);
        let expected = kuttruff(216.0, 216.0, alpha, 0.342);
        println!("alpha {alpha}: T30 {t30:.4} s, Eyring {eyring:.4} s, Kuttruff {expected:.4} s");
        // Kuttruff's formula is an expansion in ln(1-a), and 20 000 rays leave about 1 % in T30.
        assert!((t30 / expected - 1.0).abs() < 0.03, "alpha {alpha}: {t30} s against {expected} s");
    }
    let t30 = decay_time(&outcome.traced[0].echogram, 0, -5.0, -35.0);
    assert!((t30 / kuttruff(216.0, 216.0, 0.05, 0.0) - 1.0).abs() < 0.05, "Eyring");
}

#[test]
fn the_reverberant_level_is_that_of_the_diffuse_field() {
    // Mean over the room of the intensity after the first reflection: 16 pi/S (1-a)/a, as rays of mean free path 4V/S
    // carry 1-a, (1-a)^2, ... of a power of 4 pi.
    let alpha = 0.2;
    let mut scene = shoebox([6.0; 3], &[alpha], &[1.0]);
    add_source(&mut scene, [2.3, 3.1, 3.4]);
    // Probes on a lattice that fills the room evenly.
    for i in 0..64 {
        let f = |step: f64| (0.5 + step * i as f64).fract() * 6.0;
        add_probe(&mut scene, [f(0.819_172_5), f(0.671_043_6), f(0.549_700_5)]);
    }
    let outcome = run(&scene, &plan(&scene, 1.5, 4096));
    let mean = outcome.traced.iter().map(|t| level(&t.echogram, 0)).sum::<f64>() / 64.0;
    let expected = 16.0 * std::f64::consts::PI / 216.0 * (1.0 - alpha) / alpha;
    let difference = db(mean / expected);
    println!("mean level re diffuse field: {difference:.3} dB");
    // 64 points sample a field that rises by some dB towards walls and source, and a source in the middle of a cube
    // starts with flights shorter than the mean.
    assert!(difference.abs() < 0.3, "{difference} dB");
}

#[test]
fn every_energy_account_balances() {
    // A closed room: nothing escapes, and what was emitted is absorbed or still under way, to rounding.
    let mut scene = shoebox([5.0, 4.0, 3.0], &[0.1, 0.3, 0.9], &[0.1, 0.5, 0.9]);
    scene.air.attenuation_per_m = vec![0.0, 1e-3, 2e-2];
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_probe(&mut scene, [4.0, 3.0, 2.0]);
    let outcome = run(&scene, &plan(&scene, 0.5, 8192));
    let ledger = &outcome.ledger[0];
    println!("{ledger:?}");
    for band in 0..3 {
        assert!((ledger.emitted[band] - 1.0).abs() < 1e-12);
        assert!(ledger.imbalance(band).abs() < 1e-6, "band {band}: {}", ledger.imbalance(band));
        assert_eq!(ledger.escaped[band], 0.0);
        assert_eq!(ledger.transmitted[band], 0.0);
        // Random decisions are fair: a few parts in a thousand at this number of rays.
        assert!(ledger.resampling[band].abs() < 0.02, "band {band}: {}", ledger.resampling[band]);
    }
    assert_eq!(ledger.air[0], 0.0);
    assert!(ledger.air[2] > 0.01);
}

#[test]
fn an_open_room_loses_its_energy_to_the_outside() {
    let mut scene = shoebox([5.0, 4.0, 3.0], &[0.0], &[0.3]);
    scene.boxes[0].faces[1] = None;
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_probe(&mut scene, [4.0, 3.0, 2.0]);
    let outcome = run(&scene, &plan(&scene, 2.0, 2048));
    let ledger = &outcome.ledger[0];
    assert!(ledger.escaped[0] + ledger.timed_out[0] > 0.99 && ledger.escaped[0] > 0.9, "{ledger:?}");
    assert!(ledger.imbalance(0).abs() < 1e-6);
}

#[test]
fn source_and_probe_can_be_exchanged() {
    // Mixed scattering, different in every band, and different faces.
    let build = |source: [f64; 3], probe: [f64; 3]| {
        let mut scene = empty(3);
        let hard = material(&mut scene, &[0.05, 0.1, 0.1], &[0.1, 0.05, 0.1], None);
        let soft = material(&mut scene, &[0.3, 0.6, 0.5], &[0.1, 0.6, 0.9], None);
        add_box(
            &mut scene,
            [0.0; 3],
            [7.0, 5.0, 3.0],
            [Some(hard), Some(soft), Some(hard), Some(hard), Some(soft), Some(hard)],
        );
        add_source(&mut scene, source);
        add_probe(&mut scene, probe);
        scene
    };
    let (a, b) = ([1.0, 1.0, 0.7], [5.5, 3.5, 2.2]);
    let forth = build(a, b);
    let back = build(b, a);
    let forth = run(&forth, &plan(&forth, 1.2, 60_000));
    let back = run(&back, &plan(&back, 1.2, 60_000));
    for band in 0..3 {
        let (e, f) = (&forth.traced[0].echogram, &back.traced[0].echogram);
        let combined = e.std_error[band].hypot(f.std_error[band]);
        let difference = level(e, band) - level(f, band);
        println!(
            "band {band}: {:.4} dB, {:.2} standard errors",
            db(level(e, band) / level(f, band)),
            difference / combined
        );
        assert!(difference.abs() < 4.0 * combined, "band {band}");
        assert!(combined / level(e, band) < 0.03, "the comparison is sharp enough to mean something");
    }
}

#[test]
fn bands_traced_together_equal_bands_traced_alone() {
    // One decision serves all bands: with scattering from 0 to 0.9 every band must still be unbiased and its error finite.
    let scattering = [0.0, 0.05, 0.3, 0.9];
    let build = |scattering: &[f64]| {
        let mut scene = shoebox([6.0, 5.0, 3.0], &vec![0.15; scattering.len()], scattering);
        add_source(&mut scene, [1.0, 1.0, 1.0]);
        add_probe(&mut scene, [4.0, 3.0, 2.0]);
        scene
    };
    let together = build(&scattering);
    let together = run(&together, &plan(&together, 0.8, 40_960));
    for (band, &s) in scattering.iter().enumerate() {
        let alone = build(&[s]);
        let alone = run(&alone, &TracePlan { seed: 2, ..plan(&alone, 0.8, 40_960) });
        let (e, f) = (&together.traced[0].echogram, &alone.traced[0].echogram);
        let combined = e.std_error[band].hypot(f.std_error[0]);
        let deviation = (level(e, band) - level(f, 0)) / combined;
        println!(
            "s {s}: {deviation:.2} standard errors; hits {} {}; errors {:.4} {:.4} dB",
            together.hits,
            alone.hits,
            4.34 * e.std_error[band] / level(e, band),
            4.34 * f.std_error[0] / level(f, 0)
        );
        assert!(deviation.abs() < 4.0, "s {s}");
        // The price of one decision for four bands is at most that of a quarter of the rays, twice the error.
        assert!(e.std_error[band] < 2.2 * f.std_error[0], "s {s}");
    }
}

#[test]
fn a_probe_hears_the_same_alone_and_among_many() {
    // Where there are many probes weak rain is thinned at random.
    let build = |others: usize| {
        let mut scene = shoebox([6.0, 5.0, 3.0], &[0.2], &[0.6]);
        add_source(&mut scene, [1.0, 1.0, 1.0]);
        add_probe(&mut scene, [4.0, 3.0, 2.0]);
        for i in 0..others {
            add_probe(&mut scene, [0.5 + 5.0 * (i % 6) as f64 / 6.0, 0.4 + 4.0 * (i / 6) as f64 / 6.0, 1.2]);
        }
        scene
    };
    let (alone, among) = (build(0), build(35));
    let alone = run(&alone, &plan(&alone, 0.8, 65_536));
    let among = run(&among, &TracePlan { seed: 8, ..plan(&among, 0.8, 65_536) });
    let (a, b) = (&alone.traced[0].echogram, &among.traced[0].echogram);
    let combined = a.std_error[0].hypot(b.std_error[0]);
    let difference = level(b, 0) - level(a, 0);
    println!("{:.4} dB, {:.2} standard errors", db(level(b, 0) / level(a, 0)), difference / combined);
    assert!(difference.abs() < 4.0 * combined);
    assert!(combined / level(a, 0) < 0.01, "the comparison is sharp enough to mean something");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let mut scene = shoebox([5.0, 4.0, 3.0], &[0.2, 0.4], &[0.2, 0.4]);
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_source(&mut scene, [2.0, 3.0, 1.0]);
    add_probe(&mut scene, [4.0, 3.0, 2.0]);
    // Four chunks a thread go in one batch: the threads change how the chunks are dealt out too.
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| run(&scene, &TracePlan { target_db: 0.3, ..TracePlan::new(&scene, 0.4) }))
    };
    let one = with_threads(1);
    assert_eq!(one.ended, Ended::Target);
    for threads in [2, 3, 4, 7] {
        let several = with_threads(threads);
        assert_eq!(one.rays, several.rays);
        assert_eq!(one.traced, several.traced);
        assert_eq!(one.ledger, several.ledger);
    }
}

#[test]
fn the_standard_error_is_true() {
    // 300 runs of one chunk each: their deviations from the common mean, in their own standard errors, have variance 1.
    let mut scene = shoebox([5.0, 4.0, 3.0], &[0.3], &[0.3]);
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_probe(&mut scene, [4.0, 3.0, 2.0]);
    let runs: Vec<(f64, f64)> = (0..300)
        .map(|seed| {
            let outcome = run(&scene, &TracePlan { seed, ..plan(&scene, 0.4, CHUNK_RAYS) });
            let echogram = &outcome.traced[0].echogram;
            (level(echogram, 0), echogram.std_error[0])
        })
        .collect();
    let n = runs.len() as f64;
    let mean = runs.iter().map(|r| r.0).sum::<f64>() / n;
    let scatter = (runs.iter().map(|r| (r.0 - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let stated = (runs.iter().map(|r| r.1 * r.1).sum::<f64>() / n).sqrt();
    let inside = runs.iter().filter(|r| (r.0 - mean).abs() < 1.96 * r.1).count() as f64 / n;
    println!("scatter/stated {:.3}, inside 95 %: {inside:.3}", scatter / stated);
    // The scatter of 300 runs is itself known to 4 % (one standard error); the distribution has a tail.
    assert!((scatter / stated - 1.0).abs() < 0.15, "{}", scatter / stated);
    assert!((0.88..=0.99).contains(&inside), "{inside}");
}

#[test]
fn the_run_stops_at_its_target() {
    let mut scene = shoebox([5.0, 4.0, 3.0], &[0.2], &[0.5]);
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_probe(&mut scene, [4.0, 3.0, 2.0]);
    let strict = run(&scene, &TracePlan { target_db: 0.03, ..TracePlan::new(&scene, 0.4) });
    let worst = strict.worst.expect("something was traced");
    assert_eq!(strict.ended, Ended::Target);
    assert!(worst.std_error_db <= 0.03);
    // Strong deterministic paths make the rest unimportant.
    let early = vec![vec![vec![100.0]]];
    let easy = run(&scene, &TracePlan { target_db: 0.03, early, ..TracePlan::new(&scene, 0.4) });
    assert!(easy.rays[0] < strict.rays[0], "{} {}", easy.rays[0], strict.rays[0]);
    let short = run(&scene, &TracePlan { target_db: 0.001, max_rays: 5000, ..TracePlan::new(&scene, 0.4) });
    assert_eq!(short.ended, Ended::MaxRays);
    assert!(short.rays[0] <= 5000 && short.rays[0] > 4000, "{}", short.rays[0]);
}

/// Every image source of a shoebox with reflections in `orders`, at most `length` away: distance and (1-a)^n / d^2. Their number.
fn each_image(
    size: [f64; 3],
    source: [f64; 3],
    probe: [f64; 3],
    alpha: f64,
    orders: std::ops::Range<i64>,
    length: f64,
    mut with: impl FnMut(f64, f64),
) -> usize {
    let reach = size.map(|l| (length / l).ceil() as i64 + 1);
    // Image n along one axis: n l + s (n even) or (n+1) l - s (n odd), after |n| reflections.
    let at = |axis: usize, n: i64| {
        let (l, s) = (size[axis], source[axis]);
        if n % 2 == 0 { n as f64 * l + s } else { (n + 1) as f64 * l - s }
    };
    let mut images = 0;
    for i in -reach[0]..=reach[0] {
        for j in -reach[1]..=reach[1] {
            for k in -reach[2]..=reach[2] {
                let order = i.abs() + j.abs() + k.abs();
                let d2 = (at(0, i) - probe[0]).powi(2) + (at(1, j) - probe[1]).powi(2) + (at(2, k) - probe[2]).powi(2);
                if orders.contains(&order) && d2 < length * length {
                    with(d2.sqrt(), (1.0 - alpha).powi(order as i32) / d2);
                    images += 1;
                }
            }
        }
    }
    images
}

/// Sum over these image sources.
fn image_sources(
    size: [f64; 3],
    source: [f64; 3],
    probe: [f64; 3],
    alpha: f64,
    orders: std::ops::Range<i64>,
    length: f64,
) -> f64 {
    let mut sum = 0.0;
    each_image(size, source, probe, alpha, orders, length, |_, energy| sum += energy);
    sum
}

/// The echogram of a shoebox of mirrors in bins of 5 ms against its image sources, `length_s` long.
fn compare_specular_echogram(length_s: f64, rays: u64, least_images: usize) {
    let (size, source, probe, alpha) = ([6.0, 5.0, 3.0], [1.0, 1.5, 1.2], [3.2, 2.6, 1.6], 0.04);
    let mut scene = shoebox(size, &[alpha], &[0.0]);
    add_source(&mut scene, source);
    add_probe(&mut scene, probe);
    let bin_s = 5e-3;
    let outcome = run(&scene, &TracePlan { reflection_order: 0, bin_s, ..plan(&scene, length_s, rays) });
    let echogram = &outcome.traced[0].echogram;
    let bins = echogram.energy[0].len();
    let mut expected = vec![0.0; bins];
    let images = each_image(size, source, probe, alpha, 1..1 << 20, length_s * SPEED, |d, energy| {
        if let Some(bin) = expected.get_mut((d / SPEED / bin_s) as usize) {
            *bin += energy;
        }
    });
    // Before 40 ms a bin holds few images, and a ray that passes the probe at the edge of the ball comes up to 0.15 ms before its image:
    // from one bin to the next. In the last bin flights are cut off with the echogram.
    let rows: Vec<(f64, f64)> = (8..bins - 1)
        .map(|i| (db(echogram.energy[0][i] / expected[i]), 4.343 * echogram.bin_error[0][i] / expected[i]))
        .collect();
    let n = rows.len() as f64;
    let mean = rows.iter().map(|r| r.0).sum::<f64>() / n;
    let (spread, stated) = (
        (rows.iter().map(|r| r.0 * r.0).sum::<f64>() / n).sqrt(),
        (rows.iter().map(|r| r.1 * r.1).sum::<f64>() / n).sqrt(),
    );
    let worst = rows.iter().fold(0.0f64, |w, r| w.max(r.0.abs()));
    println!(
        "{images} images, {bins} bins: mean {mean:+.4} dB, root mean square {spread:.3} (stated {stated:.3}), largest {worst:.2}, {:.1} s",
        outcome.seconds
    );
    assert!(images >= least_images, "{images}");
    assert!(mean.abs() < 0.02 + 4.0 * stated / n.sqrt(), "{mean} dB on average");
    assert!(rows.iter().all(|r| r.0.abs() < 0.1 + 4.0 * r.1), "{rows:?}");
    assert!(stated < 0.15, "the bins are known well enough to mean something");
}

#[test]
fn the_specular_echogram_equals_its_image_sources_bin_by_bin() {
    compare_specular_echogram(0.3, 131_072, 50_000);
}

#[test]
fn the_specular_echogram_of_five_million_images_is_right_bin_by_bin() {
    compare_specular_echogram(1.45, 524_288, 5_000_000);
}

#[test]
fn specular_rooms_equal_the_sum_of_their_image_sources() {
    let (size, source, probe, alpha) = ([6.0, 5.0, 3.0], [1.0, 1.5, 1.2], [4.2, 3.1, 1.9], 0.1);
    for order in [0, 2] {
        let mut scene = shoebox(size, &[alpha], &[0.0]);
        add_source(&mut scene, source);
        add_probe(&mut scene, probe);
        let outcome = run(&scene, &TracePlan { reflection_order: order, ..plan(&scene, 0.3, 400_000) });
        let expected = image_sources(size, source, probe, alpha, order as i64 + 1..1000, 0.3 * SPEED);
        let echogram = &outcome.traced[0].echogram;
        let got = level(echogram, 0);
        println!(
            "orders > {order}: {:.3} dB, standard error {:.3} dB",
            db(got / expected),
            4.34 * echogram.std_error[0] / got
        );
        // The sphere (0.4 m) reads image sources 2 m away 0.04 dB too high, farther ones less.
        let bias = 0.01 * expected;
        assert!((got - expected).abs() < 4.0 * echogram.std_error[0] + bias, "{}", db(got / expected));
        assert!(echogram.std_error[0] < 0.02 * expected);
    }
}

#[test]
fn a_wall_near_the_probe_does_not_shade_its_sphere() {
    // 0.1 m from a specular wall the sphere is cut; the visible volume makes up for it.
    let (size, source, probe, alpha) = ([6.0, 5.0, 3.0], [1.0, 1.5, 1.2], [4.2, 3.1, 0.1], 0.1);
    let mut scene = shoebox(size, &[alpha], &[0.0]);
    add_source(&mut scene, source);
    add_probe(&mut scene, probe);
    let outcome = run(&scene, &TracePlan { reflection_order: 1, ..plan(&scene, 0.3, 400_000) });
    let expected = image_sources(size, source, probe, alpha, 2..1000, 0.3 * SPEED);
    let echogram = &outcome.traced[0].echogram;
    let got = level(echogram, 0);
    println!("{:.3} dB, standard error {:.3} dB", db(got / expected), 4.34 * echogram.std_error[0] / got);
    assert!((got - expected).abs() < 4.0 * echogram.std_error[0] + 0.015 * expected, "{}", db(got / expected));
}

#[test]
fn air_absorption_thins_each_arrival_by_its_own_path() {
    let mut scene = shoebox([6.0, 5.0, 3.0], &[0.1, 0.1], &[0.4, 0.4]);
    scene.air.attenuation_per_m = vec![0.0, 0.02];
    add_source(&mut scene, [1.0, 1.5, 1.2]);
    add_probe(&mut scene, [4.2, 3.1, 1.9]);
    let outcome = run(&scene, &plan(&scene, 0.3, 4096));
    let e = &outcome.traced[0].echogram;
    for (bin, (dry, damped)) in e.energy[0].iter().zip(&e.energy[1]).enumerate() {
        if *dry > 0.0 {
            // Both bands have the same rays; a bin is 1 ms = 0.343 m wide.
            let path = (bin as f64 + 0.5) * e.bin_s * SPEED;
            let m = -(damped / dry).ln();
            assert!((m - 0.02 * path).abs() < 0.02 * 0.5 * 0.343 + 1e-4, "bin {bin}: {m}");
        }
    }
}
