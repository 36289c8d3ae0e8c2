//! Slits through rigid walls of some thickness against exact solutions (src/verify/reference/thick_slits.csv).

mod reference;

use diffray::wbsdf::crossing::{Crossing, Incident, Spectrum};
use diffray::wbsdf::mask::Mask;
use diffray::wbsdf::slit::{BandApertures, intensity};
use reference::{Errors, Row, SCREEN, head, level, levels, probe, slit, source, table};

/// A wall that fills `-thickness_m` < y < 0.
fn wall(thickness_m: f64) -> String {
    let y = -0.5 * thickness_m;
    format!(
        "[[wall]]\nname = \"screen\"\ncorners_m = [[0, {y:?}, 0], [1, {y:?}, 0], [1, {y:?}, 1]]\nunbounded = true\n\
         thickness_m = {thickness_m:?}\n"
    )
}

fn room(row: &Row) -> String {
    let (x, y) = (row.number("source_x"), row.number("source_y"));
    let half = 0.5 * row.number("width_m");
    let room = head("octave", row.number("band_hz")) + &wall(row.number("thickness_m")) + &slit("a", -half, half);
    let source = match row.text("source") {
        "plane" => source("plane", [0.0, 5.0, 0.0], [x, y, 0.0]),
        _ => source("line", [x, y, 0.0], [0.0, 0.0, 1.0]),
    };
    room + &source + &probe("p", [row.number("x_m"), row.number("y_m"), 0.0])
}

#[test]
fn octave_levels_behind_a_gap_of_any_width_and_depth_are_exact_within_0_2_db() {
    let mut errors = Errors::default();
    for row in table("thick_slits") {
        errors.add(level(&room(&row)), row.number("level_db"));
    }
    // All 5376 levels of the full table: 0.0000 / 0.0008 / 0.10 dB, where its 64 frequencies see too little of a resonance.
    errors.assert_within("thick slits", [0.001, 0.01, 0.15]);
}

/// Level of a tone 2 m behind a slit of `width_m` in a wall, point source 2 m before it and 0.5 m beside it.
fn tone(width_m: f64, wall: &str, thickness_m: f64, frequency_hz: f64) -> f64 {
    let room = head("tone", frequency_hz) + wall + &slit("a", -0.5 * width_m, 0.5 * width_m);
    let place = source("point", [-0.5, 2.0, 0.0], [0.0; 3]) + &probe("p", [0.3, -2.0 - thickness_m, 0.4]);
    level(&(room + &place))
}

#[test]
fn a_thin_wall_is_the_limit_of_a_thick_one() {
    for (width, f) in [(0.005, 250.0), (0.05, 1000.0), (0.3, 500.0)] {
        let thin = tone(width, SCREEN, 0.0, f);
        // From a depth of 1/100 of the width on the deep form alone is used; an added mass makes the level fall.
        let depth = width / 99.0;
        let thick = tone(width, &wall(depth), depth, f);
        let fall = thin - thick;
        assert!((0.0..0.1).contains(&fall), "{width} m, {f} Hz: {thin} {thick}");
    }
}

#[test]
fn levels_do_not_jump_where_a_slit_becomes_wide_enough_to_count_as_thin() {
    let spectrum = Spectrum { low_hz: 707.106781, high_hz: 1414.213562, speed_m_s: 343.0 };
    let at = |degrees: f64, r: f64| (r * degrees.to_radians().sin(), r * degrees.to_radians().cos());
    // k a 3, 13 and 26; source and probe also along the screen, on one side of the slit and on both.
    for thickness_m in [0.002, 0.008, 0.016] {
        for (before, behind) in [(-84.0, -86.0), (82.0, 87.0), (85.0, -83.0), (-20.0, 84.0), (10.0, -30.0)] {
            let ((x_m, z_m), receiver) = (at(before, 3.0), at(behind, 4.0));
            let crossing = Crossing { incident: Incident::Line { x_m, z_m }, x_m: receiver.0, z_m: receiver.1 };
            let level = |width_m: f64| {
                let mask = Mask::new(&[[-0.5 * width_m, 0.5 * width_m]]);
                10.0 * intensity(&mask, thickness_m, &crossing, &spectrum, || None, 2e-3).value.log10()
            };
            // From 95 to 130 times the thickness in steps of 0.4 %.
            let sweep: Vec<f64> = (0..=78).map(|i| level(95.0 * thickness_m * 1.004_f64.powi(i))).collect();
            let largest = sweep.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
            println!("{thickness_m} {before} {behind}: {largest:.4} dB, {:.2} to {:.2} dB", sweep[0], sweep[78]);
            assert!(largest < 0.1, "{thickness_m} m, {before}, {behind} degrees: a step of {largest} dB");
        }
    }
}

#[test]
fn a_deep_gap_resonates_where_depth_and_end_corrections_are_half_a_wavelength() {
    let (width, depth) = (0.01, 0.1);
    let at = |f: f64| tone(width, &wall(depth), depth, f);
    let sweep: Vec<(f64, f64)> = (0..120).map(|i| 1100.0 + 5.0 * f64::from(i)).map(|f| (f, at(f))).collect();
    let peak = sweep.iter().copied().fold((0.0, f64::NEG_INFINITY), |a, b| if b.1 > a.1 { b } else { a });
    // End correction of a flanged slit, both mouths together: (2 a/pi) [ln(8/(k a)) ...], 0.02 to 0.03 m here. Without it
    // the gap would resonate at 1715 Hz.
    let effective = 0.5 * 343.0 / peak.0;
    assert!((depth + 0.01..depth + 0.04).contains(&effective), "resonance at {} Hz: {effective} m", peak.0);
    assert!(peak.1 - at(0.5 * peak.0) > 6.0, "the resonance stands out: {peak:?}");
}

#[test]
fn source_and_probe_may_change_places_across_a_thick_wall() {
    for (width, f) in [(0.004, 500.0), (0.06, 4000.0), (0.4, 1000.0)] {
        let at = |from: [f64; 3], to: [f64; 3]| {
            let room = head("octave", f) + &wall(0.1) + &slit("a", -0.02, width - 0.02);
            level(&(room + &source("point", from, [0.0; 3]) + &probe("p", to)))
        };
        let (a, b) = ([-0.7, 0.9, 0.2], [1.1, -1.6, 0.9]);
        let (there, back) = (at(a, b), at(b, a));
        assert!((there - back).abs() < 1e-6, "{width} m, {f} Hz: {there} {back}");
    }
}

#[test]
fn gaps_of_one_thick_wall_act_together() {
    // Halves of one gap with no wall between them are the gap: the mouths know of each other.
    let place = source("line", [-0.4, 1.0, 0.0], [0.0, 0.0, 1.0]) + &probe("p", [0.6, -1.1, 0.0]);
    let at = |gaps: &str| levels(&(head("octave", 500.0) + &wall(0.02) + gaps + &place))[0][0];
    let (one, other) = (slit("a", -0.101, -0.001), slit("b", 0.001, 0.101));
    let together = at(&(one.clone() + &other));
    let whole = at(&slit("a", -0.101, 0.101));
    let energies = 10.0 * (10f64.powf(0.1 * at(&one)) + 10f64.powf(0.1 * at(&other))).log10();
    // A slat of 2 mm on the axis changes next to nothing; gaps that ignore each other miss half a decibel.
    assert!((together - whole).abs() < 0.02 && (together - energies).abs() > 0.3, "{together} {whole} {energies}");
}

#[test]
fn deep_slits_have_the_frequencies_that_waves_standing_across_them_ask_for() {
    // Octaves against the means of their 24 parts.
    let mut errors = Errors::default();
    for (depth_m, hz) in [(0.1, 4000.0), (0.3, 1000.0), (0.3, 2000.0), (0.5, 1000.0)] {
        let [low_hz, high_hz] = [hz / 2f64.sqrt(), hz * 2f64.sqrt()];
        let part = |from: f64, to: f64| {
            let at = |share: f64| low_hz + share * (high_hz - low_hz);
            Spectrum { low_hz: at(from), high_hz: at(to), speed_m_s: 343.0 }
        };
        for width_m in [0.05, 0.07, 0.1, 0.14, 0.2, 0.27] {
            let slit = Mask::new(&[[-0.5 * width_m, 0.5 * width_m]]);
            let solved = |from: f64, to: f64| BandApertures::new(&slit, depth_m, &part(from, to), 1.0);
            let whole = solved(0.0, 1.0);
            let parts: Vec<BandApertures> =
                (0..24).map(|i| solved(f64::from(i) / 24.0, f64::from(i + 1) / 24.0)).collect();
            for (before, behind) in [(0.0, 0.0), (20.0, 40.0), (60.0, 50.0), (-70.0, 60.0), (80.0, 75.0)] {
                let [before, behind] = [before, behind].map(f64::to_radians);
                let incident = Incident::Line { x_m: -3.0 * before.sin(), z_m: 3.0 * before.cos() };
                let crossing = Crossing { incident, x_m: 4.0 * behind.sin(), z_m: 4.0 * behind.cos() };
                let level = |bands: &[BandApertures]| {
                    let sum: f64 = bands.iter().map(|band| band.intensity(&slit, &crossing).value).sum();
                    10.0 * (sum / bands.len() as f64).log10()
                };
                errors.add(level(std::slice::from_ref(&whole)), level(&parts));
            }
        }
    }
    errors.assert_within("deep slits", [0.002, 0.01, 0.05]);
}
