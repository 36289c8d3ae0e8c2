//! Closing a sliding door raises levels behind it: how much and where, against the exact solution.

mod reference;

use reference::{Row, SCREEN, head, level, probe, source, table};

fn at(row: &Row, open_m: f64) -> f64 {
    let door = format!(
        "[[opening]]\nname = \"door\"\nwall = \"screen\"\nx_m = [0.0, 1.2]\ndoor = {{ kind = \"sliding\", open_m = {open_m:?} }}\n"
    );
    let place = source("line", [row.number("sx_m"), row.number("sy_m"), 0.0], [0.0, 0.0, 1.0]);
    let room = head(row.text("mean"), row.number("band_hz")) + SCREEN + &door + &place;
    level(&(room + &probe("p", [row.number("x_m"), row.number("y_m"), 0.0])))
}

/// Largest errors in dB of the rise, and in m of the widths at which it begins and ends.
fn worst(mean: &str, step_m: f64) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    for row in table("sliding_door").iter().filter(|r| r.text("mean") == mean) {
        let (low, high) = (row.number("low_m"), row.number("high_m"));
        let exact = row.number("level_low_db") - row.number("level_high_db");
        // Highest level near the low end, lowest near the high end.
        let near = |width: f64| -> Vec<(f64, f64)> {
            let widths = (-4..=4).map(|i| width + f64::from(i) * step_m).filter(|w| (0.005..=1.2 + 1e-9).contains(w));
            widths.map(|w| (w.min(1.2), at(row, w.min(1.2)))).collect()
        };
        let by_level = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (lows, highs) = (near(low), near(high));
        let top = lows.iter().max_by(by_level).expect("widths were tried");
        let bottom = highs.iter().min_by(by_level).expect("widths were tried");
        worst[0] = worst[0].max((top.1 - bottom.1 - exact).abs());
        worst[1] = worst[1].max((top.0 - low).abs()).max((bottom.0 - high).abs());
    }
    worst
}

#[test]
fn octave_levels_rise_as_much_and_at_the_same_widths_as_in_the_exact_solution() {
    let [rise_db, width_m] = worst("octave", 0.02);
    println!("octaves: rise within {rise_db:.3} dB, widths within {width_m:.3} m");
    assert!(rise_db < 0.1, "{rise_db} dB");
    // One step of the exact table's grid.
    assert!(width_m < 0.021, "{width_m} m");
}

#[test]
fn tones_rise_within_0_7_db_of_the_exact_solution() {
    let [rise_db, width_m] = worst("tone", 0.005);
    println!("tones: rise within {rise_db:.3} dB, widths within {width_m:.3} m");
    assert!(rise_db < 0.7, "{rise_db} dB");
    assert!(width_m < 0.021, "{width_m} m");
}

#[test]
fn a_closed_rigid_door_is_silent_and_a_fully_open_one_has_no_leaf() {
    let rows = table("sliding_door");
    assert_eq!(at(&rows[0], 0.0), f64::NEG_INFINITY);
    let (open, nearly) = (at(&rows[0], 1.2), at(&rows[0], 1.199_999));
    assert!((open - nearly).abs() < 1e-3, "{open} {nearly}");
}
