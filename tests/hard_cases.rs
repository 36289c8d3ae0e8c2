//! Numerically hard cases: grazing, on boundaries, tiny, huge, near, far. No NaN, no step, and the limit where one is known.

mod reference;

use diffray::scene::Scene;

use reference::{SCREEN, head, level, levels, probe, slit, source};

/// A line source and probes about openings in the screen y = 0, one octave band.
fn behind(openings: &str, from: [f64; 2], to: &[[f64; 2]], band_hz: f64) -> Vec<f64> {
    let mut room =
        head("octave", band_hz) + SCREEN + openings + &source("line", [from[0], from[1], 0.0], [0.0, 0.0, 1.0]);
    for (i, p) in to.iter().enumerate() {
        room += &probe(&format!("p{i}"), [p[0], p[1], 0.0]);
    }
    levels(&room).into_iter().map(|bands| bands[0]).collect()
}

fn half_plane() -> String {
    slit("edge", 0.0, f64::INFINITY)
}

/// Neighbours 1 mm apart differ by less than 0.1 dB more than the sweep's own slope.
fn assert_smooth(levels: &[f64], what: &str) {
    assert!(levels.iter().all(|l| l.is_finite()), "{what}: {levels:?}");
    for w in levels.windows(3) {
        let second = w[2] - 2.0 * w[1] + w[0];
        assert!(second.abs() < 0.1, "{what}: {w:?}");
    }
}

/// Places `count` steps of 1 mm along x about (x, y).
fn row(x: f64, y: f64, count: i32) -> Vec<[f64; 2]> {
    (-count..=count).map(|i| [x + 1e-3 * f64::from(i), y]).collect()
}

#[test]
fn a_wave_that_grazes_the_screen_at_a_tenth_of_a_degree_passes_smoothly() {
    let (sin, cos) = 0.1_f64.to_radians().sin_cos();
    for (gap, f) in [(0.02, 250.0), (0.3, 1000.0), (0.9, 4000.0)] {
        let opening = slit("a", -0.5 * gap, 0.5 * gap);
        let into = behind(&opening, [-2.0 * cos, 2.0 * sin], &row(0.3, -1.0, 3), f);
        assert_smooth(&into, "grazing incidence");
        let out = behind(&opening, [-0.3, 1.0], &row(2.0 * cos, -2.0 * sin, 3), f);
        assert_smooth(&out, "grazing emergence");
        // A rigid screen keeps up grazing waves: what comes out along it is within 20 dB of what leaves at 45 degrees.
        let slant = behind(&opening, [-0.3, 1.0], &[[2.0_f64.sqrt(), -(2.0_f64.sqrt())]], f)[0];
        assert!((out[3] - slant).abs() < 20.0, "{gap} m, {f} Hz: {} {slant}", out[3]);
    }
}

#[test]
fn source_or_probe_one_millimetre_from_a_jamb_is_finite_and_reciprocal() {
    for (gap, f) in [(0.02, 250.0), (0.3, 1000.0), (0.9, 4000.0)] {
        let opening = slit("a", 0.0, gap);
        let (near, far) = ([0.0, -1e-3], [-0.7, 1.3]);
        let there = behind(&opening, far, &[near], f)[0];
        let back = behind(&opening, [0.0, 1e-3], &[[-0.7, -1.3]], f)[0];
        assert!(there.is_finite() && (there - back).abs() < 0.01, "{gap} m, {f} Hz: {there} {back}");
    }
}

#[test]
fn levels_cross_the_shadow_boundary_of_a_half_plane_without_a_step() {
    for f in [125.0, 1000.0, 8000.0] {
        // The line from the source over the edge at 0 meets y = -2 at x = 1; exactly there the amplitude is half.
        let across = behind(&half_plane(), [-1.0, 2.0], &row(1.0, -2.0, 5), f);
        assert_smooth(&across, "shadow boundary");
        let half = -10.0 * 20.0_f64.sqrt().log10() - 6.0206;
        // The rigid screen adds to the half of order 1/sqrt(k r): 2.4 dB at 125 Hz, 0.3 dB at 8 kHz.
        assert!(
            (0.0..2.5 * (125.0_f64 / f).sqrt() + 0.1).contains(&(across[5] - half)),
            "{f} Hz: {} {half}",
            across[5]
        );
    }
}

#[test]
fn an_edge_hit_exactly_by_the_direct_ray_halves_the_amplitude_at_short_waves() {
    let at = behind(&half_plane(), [0.0, 3.0], &[[0.0, -3.0]], 16_000.0)[0];
    // Half of it, and what the rigid screen adds: exp(i pi/4)/(2 sqrt(2 pi k L)), L = 1.5 m (Kouyoumjian and Pathak).
    let k = std::f64::consts::TAU * 16_000.0 / 343.0;
    let extra = 0.5 / (std::f64::consts::TAU * k * 1.5).sqrt() * std::f64::consts::FRAC_1_SQRT_2;
    let expected = 10.0 * ((0.5 + extra).powi(2) + extra * extra).log10() - 10.0 * 6.0_f64.log10();
    assert!((at - expected).abs() < 0.01, "{at} {expected}");
}

#[test]
fn levels_cross_the_reflection_boundary_of_a_wall_without_a_step() {
    // The wall stands on x < 0 of y = 0 (half-plane); source and probes on its side. The image's ray over the edge at
    // 0 meets y = 2 at x = 1.
    for f in [125.0, 1000.0, 8000.0] {
        let wall = "[[wall]]\nname = \"w\"\ncorners_m = [[-30, 0, -30], [0, 0, -30], [0, 0, 30], [-30, 0, 30]]\n";
        let mut room = head("octave", f) + wall + &source("point", [-1.0, 2.0, 0.0], [0.0; 3]);
        for (i, p) in row(1.0, 2.0, 5).iter().enumerate() {
            room += &probe(&format!("p{i}"), [p[0], p[1], 0.0]);
        }
        let across: Vec<f64> = levels(&room).into_iter().map(|bands| bands[0]).collect();
        assert_smooth(&across, "reflection boundary");
    }
}

#[test]
fn a_slit_of_a_micrometre_radiates_like_a_line_source_of_vanishing_strength() {
    // Behind it the level falls by 10 lg r, whatever the direction, and with log^2 of the width.
    let at = |to: [f64; 2], width: f64| behind(&slit("a", -0.5 * width, 0.5 * width), [0.0, 2.0], &[to], 250.0)[0];
    let (front, side) = (at([0.0, -2.0], 1e-6), at([1.6, -1.2], 1e-6));
    assert!((front - side).abs() < 0.05, "{front} {side}");
    let k = std::f64::consts::TAU * 250.0 / 343.0;
    let strength = |a: f64| {
        let log = (8.0 / (k * a)).ln() - 0.577_216;
        -10.0 * (log * log + 0.25 * std::f64::consts::PI.powi(2)).log10()
    };
    let fall = at([0.0, -2.0], 1e-4) - front;
    assert!((fall - (strength(1e-4) - strength(1e-6))).abs() < 0.1, "{fall}");
}

#[test]
fn an_opening_of_a_thousand_wavelengths_is_free_field() {
    let width = 1000.0 * 343.0 / 8000.0;
    let got = behind(&slit("a", -0.5 * width, 0.5 * width), [0.3, 2.0], &[[-0.4, -3.0]], 8000.0)[0];
    let free = -10.0 * 5.0_f64.hypot(0.7).log10();
    assert!((got - free).abs() < 0.05, "{got} {free}");
}

#[test]
fn sixteen_kilohertz_over_100_m_and_20_hz_through_a_small_gap_are_finite() {
    let far = behind(&slit("a", -0.4, 0.4), [-20.0, 50.0], &row(22.0, -50.0, 2), 16_000.0);
    assert_smooth(&far, "16 kHz over 100 m");
    let at = |x: f64| {
        let room =
            head("tone", 20.0) + SCREEN + &slit("a", 0.0, 1e-3) + &source("line", [-0.5, 0.5, 0.0], [0.0, 0.0, 1.0]);
        level(&(room + &probe("p", [x, -0.5, 0.0])))
    };
    assert_smooth(&[at(0.499), at(0.5), at(0.501)], "20 Hz through 1 mm");
}

#[test]
fn deep_in_the_shadow_of_an_edge_levels_stay_exact() {
    // 10 cm behind the screen 300 m from its edge, 16 kHz: Keller's far field is exact to a hundredth of a decibel there.
    let (r_s, r_r) = (300.0, 300.0_f64);
    let got = behind(&half_plane(), [-r_s, 0.1], &[[-r_r, -0.1]], 16_000.0)[0];
    let (mut sum, n) = (0.0, 512);
    for i in 0..n {
        let f = 16_000.0 * (0.5_f64.sqrt() + (f64::from(i) + 0.5) / f64::from(n) * 0.5_f64.sqrt());
        let k = std::f64::consts::TAU * f / 343.0;
        // |D|^2 = (1/(8 pi k)) (sec((phi-phi')/2) + sec((phi+phi')/2))^2 = (2 ...)^2/(8 pi k) with phi = 2 pi, phi' = 0.
        sum += 4.0 / (8.0 * std::f64::consts::PI * k) / (r_s * r_r) / f64::from(n);
    }
    let keller = 10.0 * sum.log10();
    assert!(keller < -80.0 && (got - keller).abs() < 0.05, "{got} {keller}");
}

#[test]
fn gaps_with_fresnel_numbers_from_1e_4_to_1e4_are_smooth_and_right_at_both_ends() {
    // a^2/(4 Lambda r): 1e-4 is the far field of a narrow slit, 1e4 geometric.
    let lambda = 343.0 / 1000.0;
    for fresnel in [1e-4, 1e-2, 1.0, 1e2, 1e4] {
        let a = (4.0 * fresnel * lambda * 1.0_f64).sqrt();
        let got = behind(&slit("a", -0.5 * a, 0.5 * a), [0.0, 2.0], &row(0.1, -2.0, 2), 1000.0);
        assert_smooth(&got, "Fresnel number");
        if fresnel >= 1e2 {
            assert!((got[2] + 10.0 * 4.0_f64.hypot(0.1).log10()).abs() < 0.2, "{fresnel}: {got:?}");
        }
    }
}

#[test]
fn two_jambs_a_nanometre_apart_are_refused_with_the_smallest_width_that_is_not() {
    let room = head("octave", 1000.0) + SCREEN + &slit("a", 0.0, 1e-9);
    let room = room + &source("line", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]) + &probe("p", [0.2, -1.0, 0.0]);
    let error = Scene::from_str(&room, "room.toml", &[]).map(|_| ()).expect_err("a nanometre is no opening");
    assert!(error.to_string().contains("at least 0.000001 m"), "{error}");
}

#[test]
fn two_gaps_with_a_nanometre_of_screen_between_them_are_one() {
    let pair = slit("a", -0.05, -0.5e-9) + &slit("b", 0.5e-9, 0.05);
    let at = |gaps: &str| behind(gaps, [0.0, 1.0], &[[0.4, -1.0]], 500.0)[0];
    let (two, one) = (at(&pair), at(&slit("a", -0.05, 0.05)));
    assert!((two - one).abs() < 0.05, "{two} {one}");
}

#[test]
fn a_ray_through_a_corner_where_three_edges_meet_is_finite() {
    // The corner of a wall: top and side edge meet on the straight line from source to probe.
    let wall =
        "[[wall]]\nname = \"w\"\ncorners_m = [[0, -3, 0], [0, 0, 0], [0, 0, 2], [0, -3, 2]]\nthickness_m = 0.1\n";
    let mut room = head("octave", 1000.0) + wall + &source("point", [-2.0, -0.5, 1.5], [0.0; 3]);
    for i in -2..=2 {
        room += &probe(&format!("p{}", i + 2), [2.0, 0.5 + 1e-3 * f64::from(i), 2.5]);
    }
    let got: Vec<f64> = levels(&room).into_iter().map(|bands| bands[0]).collect();
    let free = -10.0 * 18.0_f64.log10();
    assert!(got.iter().all(|l| l.is_finite() && (l - free).abs() < 15.0), "{got:?} {free}");
}
