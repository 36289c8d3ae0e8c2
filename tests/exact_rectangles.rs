//! Rectangular openings in a rigid thin screen against boundary elements (src/verify/reference/rectangles.csv).

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

// The product of two slits leaves the corners out: felt where the long side is less than a wavelength or two.

#[test]
fn from_500_hz_octave_levels_behind_a_door_are_within_a_quarter_decibel() {
    errors("octave", |r| r.number("width_m") > 0.5 && r.number("band_hz") >= 500.0)
        .assert_within("0.9 m by 2 m", [0.06, 0.18, 0.25]);
}

#[test]
fn at_125_and_250_hz_octave_levels_behind_a_door_are_within_0_6_db() {
    errors("octave", |r| r.number("width_m") > 0.5 && r.number("band_hz") < 500.0)
        .assert_within("0.9 m by 2 m", [0.3, 0.55, 0.6]);
}

#[test]
fn octave_levels_behind_a_door_ajar_are_within_0_7_db_and_0_4_from_1_khz() {
    errors("octave", |r| r.number("width_m") < 0.5 && r.number("band_hz") >= 1000.0)
        .assert_within("0.1 m by 2 m", [0.05, 0.25, 0.4]);
    errors("octave", |r| r.number("width_m") < 0.5 && r.number("band_hz") < 1000.0)
        .assert_within("0.1 m by 2 m", [0.5, 0.65, 0.7]);
}

#[test]
fn tones_behind_rectangles_are_within_1_db() {
    errors("tone", |_| true).assert_within("tones", [0.3, 0.7, 1.0]);
}
