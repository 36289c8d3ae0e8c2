//! Reflections by a wall at its openings: source and probe on one side of a rigid thin screen.
//!
//! Exact levels: p_direct + p_image - (what the opening passes to the probe's mirror image), by the aperture equation (Galerkin, written
//! apart from the program; two or three dimensions).

mod reference;

use reference::{SCREEN, head, level, probe, slit, source};

/// Before the head's tables: one reflection, pressures or energies.
fn room(band_hz: f64, interference: bool) -> String {
    head("octave", band_hz)
        + &format!(
            "[simulation]\nreflection_order = 1\ninterference = {interference}\n[material.rigid]\nabsorption = 0.0\n"
        )
        + &SCREEN.replace("unbounded", "material = \"rigid\"\nunbounded")
}

fn at(place: [f64; 2]) -> [f64; 3] {
    [place[0], place[1], 0.0]
}

#[test]
fn what_a_slit_leaves_of_a_reflection_is_the_exact_field() {
    let ends =
        [([0.3, 1.5], [-0.2, 1.1]), ([1.2, 1.5], [-0.1, 0.8]), ([0.9, 1.0], [0.5, 1.3]), ([2.0, 1.0], [1.0, 1.5])];
    for (width, band_hz, expected) in [
        (1.0, 500.0, [1.8869, -1.6114, 3.5060, 1.6458]),
        (1.0, 2000.0, [1.9494, -1.5644, 4.1682, 1.0313]),
        (0.1, 500.0, [2.5848, -0.2561, 4.0408, 1.7253]),
        (0.4, 1000.0, [2.0860, -0.9244, 3.9503, 0.8665]),
    ] {
        for ((s, p), expected) in ends.into_iter().zip(expected) {
            let gap = slit("gap", -0.5 * width, 0.5 * width);
            let place = source("line", at(s), [0.0, 0.0, 1.0]);
            let got = level(&(room(band_hz, true) + &gap + &place + &probe("p", at(p))));
            println!("slit {width} {band_hz} {s:?} {p:?}: {:.3}", got - expected);
            assert!((got - expected).abs() < 0.1, "{width} {band_hz} {s:?} {p:?}: {got} {expected}");
        }
    }
}

#[test]
fn what_a_door_leaves_of_a_reflection_is_the_exact_field() {
    let door = "[[opening]]\nname = \"door\"\nwall = \"screen\"\nx_m = [-0.45, 0.45]\ny_m = [-1, 1]\n";
    // As in the table: across, up, off the screen.
    let ends = [
        ([0.3, 0.2, 1.5], [-0.2, 0.1, 1.1]),
        ([0.8, 0.1, 1.5], [0.3, -0.2, 0.8]),
        ([1.2, 0.5, 1.0], [0.1, 0.3, 1.3]),
        ([0.9, 1.5, 1.0], [-0.3, -0.2, 1.4]),
    ];
    for (band_hz, expected) in
        [(125.0, [4.0531, -0.0420, -3.0304, -8.6510]), (500.0, [3.7472, 0.9009, -1.2420, -5.9622])]
    {
        for ((s, p), expected) in ends.into_iter().zip(expected) {
            let turned = |p: [f64; 3]| [p[0], p[2], p[1]];
            let place = source("point", turned(s), [0.0; 3]);
            let got = level(&(room(band_hz, true) + door + &place + &probe("p", turned(p))));
            println!("door {band_hz} {s:?} {p:?}: {:.3}", got - expected);
            assert!((got - expected).abs() < 0.1, "{band_hz} {s:?} {p:?}: {got} {expected}");
        }
    }
}

#[test]
fn levels_are_continuous_where_the_point_of_reflection_enters_an_opening() {
    let door = "[[opening]]\nname = \"door\"\nwall = \"screen\"\nx_m = [-0.45, 0.45]\ny_m = [-1, 1]\n";
    for (opening, kind) in
        [(slit("gap", -0.45, 0.45), "line"), (slit("gap", -0.05, 0.05), "line"), (door.into(), "point")]
    {
        for band_hz in [250.0, 2000.0] {
            let level_at = |x: f64| {
                let place = source(kind, [1.2, 1.0, 0.1], [0.0, 0.0, 1.0]);
                level(&(room(band_hz, false) + &opening + &place + &probe("p", [x, 1.0, 0.2])))
            };
            // The point of reflection lies half way: on the jamb for x = 0.9 - 1.2 or 0.1 - 1.2.
            for jamb in [0.9 - 1.2, 0.1 - 1.2] {
                let levels: Vec<f64> = (-3..=3).map(|i| level_at(jamb + 0.001 * (f64::from(i) + 0.5))).collect();
                for w in levels.windows(2) {
                    assert!((w[1] - w[0]).abs() < 0.1, "{opening} {band_hz}: {levels:?}");
                }
            }
        }
    }
}
