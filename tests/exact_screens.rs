//! Slits, sliding doors and pairs of slits in a rigid thin screen against exact solutions (src/verify/reference/screens.csv).

mod reference;

use diffray::wbsdf::crossing::{Crossing, Incident, Spectrum};
use diffray::wbsdf::mask::Mask;
use diffray::wbsdf::referee::exact_intensity;
use diffray::wbsdf::slit::{BandApertures, intensity};
use diffray::wbsdf::tables::Solved;
use reference::{Errors, Row, SCREEN, head, level, probe, slit, source, table};

fn room(row: &Row, mean: &str) -> String {
    let (x, y) = (row.number("source_x"), row.number("source_y"));
    let mut room = head(mean, row.number("band_hz")) + SCREEN + &slit("a", row.number("low_m"), row.number("high_m"));
    if !row.text("low2_m").is_empty() {
        room += &slit("b", row.number("low2_m"), row.number("high2_m"));
    }
    room += &match row.text("source") {
        "plane" => source("plane", [0.0, 5.0, 0.0], [x, y, 0.0]),
        _ => source("line", [x, y, 0.0], [0.0, 0.0, -1.0]),
    };
    room + &probe("p", [row.number("x_m"), row.number("y_m"), 0.0])
}

/// Errors of the rows of a case with this mean and source.
fn errors(case: &str, mean: &str, source: &str) -> Errors {
    let mut errors = Errors::default();
    let chosen = |r: &&Row| r.text("case") == case && r.text("mean") == mean && r.text("source") == source;
    for row in table("screens").iter().filter(chosen) {
        errors.add(level(&room(row, mean)), row.number("level_db"));
    }
    errors
}

// Bounds: about 1.5 times what the full tables give (docs/verification.md); these rows are spread evenly over bands and
// regions, so the hard ones weigh more. They are two-sided: the errors are absolute.

#[test]
fn octave_levels_behind_a_sliding_door_are_exact_within_0_08_db() {
    errors("door", "octave", "line").assert_within("door", [0.01, 0.04, 0.08]);
}

#[test]
fn tones_behind_a_sliding_door_are_within_1_db_even_in_nulls() {
    errors("door", "tone", "line").assert_within("door", [0.03, 0.5, 1.0]);
}

#[test]
fn octave_levels_behind_a_slit_are_exact_within_half_a_decibel() {
    errors("slit", "octave", "line").assert_within("slit, line source", [0.01, 0.1, 0.5]);
    errors("slit", "octave", "plane").assert_within("slit, plane wave", [0.01, 0.25, 0.6]);
}

#[test]
fn tones_behind_a_slit_below_20_khz_are_within_1_db() {
    errors("slit", "tone", "line").assert_within("slit, line source", [0.05, 0.5, 1.0]);
    errors("slit", "tone", "plane").assert_within("slit, plane wave", [0.05, 0.5, 1.0]);
}

#[test]
fn two_narrow_slits_interfere_exactly() {
    for source in ["line", "plane"] {
        errors("two", "octave", source).assert_within("two slits", [0.002, 0.005, 0.01]);
    }
}

#[test]
fn levels_do_not_jump_where_the_closed_form_takes_over_from_the_exact_aperture() {
    let (f, k) = (1000.0, std::f64::consts::TAU * 1000.0 / 343.0);
    // The last one runs along the screen on both sides, where the exact aperture is used up to k a 80.
    for (source_x, probe_x, from_ka, steps) in
        [(0.0, 0.5, 8.0, 500), (-2.0, 1.5, 8.0, 500), (-1.0, 4.0, 8.0, 500), (-9.0, 15.0, 54.0, 120)]
    {
        let to_ka = if from_ka < 50.0 { 65.0_f64 } else { 86.0 };
        let at = |ka: f64| {
            let place = source("line", [source_x, 1.0, 0.0], [0.0, 0.0, 1.0]);
            level(&(head("octave", f) + SCREEN + &slit("a", 0.0, ka / k) + &place + &probe("p", [probe_x, -1.0, 0.0])))
        };
        let sweep: Vec<f64> =
            (0..=steps).map(|i| at(from_ka * (to_ka / from_ka).powf(f64::from(i) / f64::from(steps)))).collect();
        for (i, w) in sweep.windows(4).enumerate() {
            // Third difference: a jump of 0.1 dB gives 0.3 dB, smooth interference of an octave below 0.1 dB.
            let third = w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0];
            assert!(third.abs() < 0.1, "{source_x} {probe_x}, step {i}: {w:?}");
        }
    }
}

#[test]
fn openings_from_a_micrometre_to_two_metres_give_finite_levels() {
    for exponent in -22..=2 {
        let width = 2.0 * 10f64.powf(f64::from(exponent) / 4.0 - 0.5);
        for f in [31.5, 1000.0, 16_000.0] {
            let place = source("line", [-1.7, 0.3, 0.0], [0.0, 0.0, 1.0]);
            let room = head("octave", f) + SCREEN + &slit("a", 0.0, width) + &place;
            let level = level(&(room + &probe("p", [1.7, -0.3, 0.0])));
            // Never above the free field over the same distance by more than an edge can add.
            assert!(level.is_finite() && level < 3.0 - 10.0 * 3.45_f64.log10(), "{width} m, {f} Hz: {level}");
        }
    }
}

#[test]
fn beside_an_opening_the_field_tends_to_the_incident_one() {
    // 1 mm behind the middle of a wide opening the incident field is disturbed by waves along the screen only.
    for f in [125.0, 1000.0] {
        let place = source("line", [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]);
        let room = head("octave", f) + SCREEN + &slit("a", -0.5, 0.5) + &place + &probe("p", [0.1, -1e-3, 0.0]);
        let free = -10.0 * 0.1_f64.hypot(2.001).log10();
        let got = level(&room);
        assert!((got - free).abs() < 0.02, "{f} Hz: {got} {free}");
    }
}

fn octave(centre_hz: f64) -> Spectrum {
    Spectrum { low_hz: centre_hz / 2f64.sqrt(), high_hz: centre_hz * 2f64.sqrt(), speed_m_s: 343.0 }
}

/// A place at `degrees` off the normal, as (x, distance from the screen).
fn place(degrees: f64, distance_m: f64) -> (f64, f64) {
    let angle = degrees.to_radians();
    (distance_m * angle.sin(), distance_m * angle.cos())
}

#[test]
fn sound_that_grazes_the_screen_before_and_behind_a_slit_is_right() {
    let spectrum = octave(1000.0);
    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
    let mut errors = Errors::default();
    for (i, ka) in [16.0, 36.0, 45.0, 52.0, 70.0, 90.0].into_iter().enumerate() {
        let mask = Mask::new(&[[-0.5 * ka / k, 0.5 * ka / k]]);
        for (before, behind) in [(-76.0, 85.0), (87.0, 78.0), (84.0, 84.0), (-82.0, 40.0), (-79.0, 76.0)] {
            let ((x_m, z_m), receiver) = (place(before, 0.7 + 0.6 * i as f64), place(behind, 3.2 - 0.4 * i as f64));
            for incident in [
                Incident::Line { x_m, z_m },
                Incident::Point { x_m, z_m, dy_m: 0.8 },
                Incident::Plane { s_x: -before.to_radians().sin(), s_y: 0.0 },
            ] {
                let crossing = Crossing { incident, x_m: receiver.0, z_m: receiver.1 };
                let db = |intensity: f64| 10.0 * intensity.log10();
                let exact = exact_intensity(&mask, 0.0, &crossing, &spectrum).value;
                errors.add(db(intensity(&mask, 0.0, &crossing, &spectrum, || None, 2e-3).value), db(exact));
            }
        }
    }
    // These choose the hard ones. The closed form alone misses by some dB.
    errors.assert_within("grazing", [0.002, 0.015, 0.05]);
}

#[test]
fn sound_that_runs_along_the_screen_past_both_jambs_is_right_where_two_edges_take_over() {
    let spectrum = octave(1000.0);
    let k = 0.5 * (spectrum.low_k() + spectrum.high_k());
    let share = |i: usize, step: f64| (step * 0.618_033_988_749_895 * (i + 1) as f64).fract();
    let mut errors = Errors::default();
    for ka in [45.0, 52.0, 60.0, 66.0, 72.0, 80.0] {
        let mask = Mask::new(&[[-0.5 * ka / k, 0.5 * ka / k]]);
        let tables = BandApertures::new(&mask, 0.0, &spectrum, 1.0);
        for i in 0..60 {
            // 75 to 87 degrees off the normal, 0.6 to 6 widths away.
            let at = |a: f64, r: f64| place(75.0 + 12.0 * share(i, a), 0.6 * ka / k * 10f64.powf(share(i, r)));
            let ((x_m, z_m), receiver) = (at(2.0, 5.0), at(3.0, 7.0));
            let plane = Incident::Plane { s_x: x_m / x_m.hypot(z_m), s_y: 0.0 };
            let incident = if i % 3 == 0 { plane } else { Incident::Line { x_m: -x_m, z_m } };
            let crossing = Crossing { incident, x_m: receiver.0, z_m: receiver.1 };
            let lit = tables.light(&incident);
            let solved = Solved { apertures: &tables, lit: lit.as_ref() };
            let got = intensity(&mask, 0.0, &crossing, &spectrum, || Some(solved), 2e-3).value;
            errors.add(10.0 * got.log10(), 10.0 * tables.intensity_of(lit.as_ref(), &mask, &crossing).value.log10());
        }
    }
    // Two edges alone up to k a 45: 0.4 and 1.5 dB. Hard cases all of them: from 83 degrees on k a 80 leaves 0.4 and 0.7 dB.
    errors.assert_within("along the screen", [0.01, 0.06, 0.6]);
}

#[test]
fn a_screen_of_twenty_slats_is_solved_as_a_whole() {
    let gaps: Vec<[f64; 2]> = (0..21).map(|i| [0.1 * f64::from(i) - 1.0, 0.1 * f64::from(i) - 0.95]).collect();
    let mask = Mask::new(&gaps);
    let mut errors = Errors::default();
    for centre_hz in [63.0, 500.0, 4000.0] {
        let spectrum = octave(centre_hz);
        let tables = BandApertures::new(&mask, 0.0, &spectrum, 1.0);
        for (before, behind) in [(0.0, 30.0), (-50.0, 60.0)] {
            let ((x_m, z_m), receiver) = (place(before, 2.0), place(behind, 3.0));
            let crossing = Crossing { incident: Incident::Line { x_m, z_m }, x_m: receiver.0, z_m: receiver.1 };
            let exact = exact_intensity(&mask, 0.0, &crossing, &spectrum).value;
            let lit = tables.light(&crossing.incident);
            let solved = Solved { apertures: &tables, lit: lit.as_ref() };
            let got = intensity(&mask, 0.0, &crossing, &spectrum, || Some(solved), 2e-3).value;
            errors.add(10.0 * got.log10(), 10.0 * exact.log10());
        }
    }
    // At 8 kHz, where 48 frequencies are fewer than the farthest pairs ask for, 0.12 dB.
    errors.assert_within("slats", [0.005, 0.05, 0.05]);
}
