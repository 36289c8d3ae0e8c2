//! Slits through rigid walls of some thickness against exact solutions (src/verify/reference/thick_slits.csv).

mod reference;

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
    // All 5376 levels of the full table: 0.0001 / 0.004 / 0.15 dB.
    errors.assert_within("thick slits", [0.001, 0.03, 0.2]);
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
        // From a depth of 1/100 of the width on the thick form is used; an added mass makes the level fall.
        let depth = width / 99.0;
        let thick = tone(width, &wall(depth), depth, f);
        let fall = thin - thick;
        assert!((0.0..0.1).contains(&fall), "{width} m, {f} Hz: {thin} {thick}");
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
