//! Rectangular openings in a rigid thin screen against boundary elements (tests/reference/rectangles.csv).

mod reference;

use reference::{Errors, Row, SCREEN, head, level, probe, source, table};

fn errors(mean: &str, chosen: impl Fn(&Row) -> bool) -> Errors {
    let mut errors = Errors::default();
    for row in table("rectangles").iter().filter(|r| r.text("mean") == mean && chosen(r)) {
        let (w, h) = (0.5 * row.number("width_m"), 0.5 * row.number("height_m"));
        let opening = format!(
            "[[opening]]\nname = \"door\"\nwall = \"screen\"\nx_m = [{:?}, {w:?}]\ny_m = [{:?}, {h:?}]\n",
            -w, -h
        );
        let at = |x: &str, y: &str, z: &str| [row.number(x), row.number(y), row.number(z)];
        let place = source("point", at("sx_m", "sy_m", "sz_m"), [0.0; 3]);
        let room = head(mean, row.number("band_hz")) + SCREEN + &opening + &place;
        errors.add(level(&(room + &probe("p", at("x_m", "y_m", "z_m")))), row.number("level_db"));
    }
    errors
}

/// Doors of 0.9 m by 2 m and ajar by 0.1 m, by boundary elements.
fn door(row: &Row) -> bool {
    let sides = (row.number("width_m"), row.number("height_m"));
    // The rows computed by boundary elements are those whose source lies on one of two places.
    (sides == (0.1, 2.0) || sides == (0.9, 2.0)) && [0.0, -1.0].contains(&row.number("sx_m"))
}

// The table is good to 0.005 dB where two meshes were run, as they were up to 500 Hz (0.1 m wide: 1 kHz).

#[test]
fn levels_behind_a_door_of_few_wavelengths_are_exact() {
    errors("octave", |r| door(r) && r.number("width_m") > 0.5 && r.number("band_hz") <= 500.0)
        .assert_within("0.9 m by 2 m", [0.003, 0.005, 0.01]);
    errors("octave", |r| door(r) && r.number("width_m") < 0.5 && r.number("band_hz") <= 1000.0)
        .assert_within("0.1 m by 2 m", [0.001, 0.002, 0.01]);
}

// Beyond, the product of two slits leaves the corners out.

#[test]
fn octave_levels_behind_doors_of_many_wavelengths_are_within_a_tenth_of_a_decibel() {
    errors("octave", |r| door(r) && r.number("width_m") > 0.5 && r.number("band_hz") > 500.0)
        .assert_within("0.9 m by 2 m", [0.05, 0.1, 0.12]);
    errors("octave", |r| door(r) && r.number("width_m") < 0.5 && r.number("band_hz") > 1000.0)
        .assert_within("0.1 m by 2 m", [0.03, 0.08, 0.1]);
}

#[test]
fn tones_behind_rectangles_are_within_a_quarter_decibel() {
    errors("tone", |_| true).assert_within("tones", [0.01, 0.2, 0.25]);
}

#[test]
fn hatches_gaps_and_squares_are_exact_at_oblique_and_near_places() {
    // Sides of 0.02 to 1.2 m, up to 75 degrees off the normal and 0.5 m near, both planes.
    errors("octave", |r| !door(r) && r.number("width_m") * r.number("height_m") * r.number("band_hz") < 1000.0)
        .assert_within("hatches", [0.002, 0.01, 0.05]);
}

#[test]
fn levels_oblique_to_both_sides_of_a_door_are_within_2_db_at_1_khz() {
    errors("octave", |r| !door(r) && r.number("width_m") * r.number("height_m") * r.number("band_hz") > 1000.0)
        .assert_within("doors, oblique", [0.35, 1.5, 1.5]);
}
