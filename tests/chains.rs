//! Thick barriers and pairs of barriers against exact solutions (tests/reference/barriers.csv).

mod reference;

use reference::{Errors, Row, head, level, probe, source, table};

/// Faces 200 m long along z and 200 m deep below y = 0; `mouth`: the top of a thick barrier.
fn barrier(kind: &str, width_m: f64) -> String {
    let wall = |name: &str, corners: [[f64; 3]; 4]| format!("[[wall]]\nname = \"{name}\"\ncorners_m = {corners:?}\n");
    let side = |x: f64| [[x, 0.0, -200.0], [x, 0.0, 200.0], [x, -200.0, 200.0], [x, -200.0, -200.0]];
    let (a, b) = (-0.5 * width_m, 0.5 * width_m);
    let mut room = wall("front", side(a)) + &wall("rear", side(b));
    if kind == "thick" {
        room += &wall("top", [[a, 0.0, -200.0], [b, 0.0, -200.0], [b, 0.0, 200.0], [a, 0.0, 200.0]]);
    }
    room + "[simulation]\nmax_rays = 0\nreflection_order = 0\n"
}

fn room(row: &Row) -> String {
    let from = [row.number("source_x"), row.number("source_y"), 0.0];
    head("octave", row.number("band_hz"))
        + &barrier(row.text("case"), row.number("width_m"))
        + &source("line", from, [0.0, 0.0, 1.0])
        + &probe("p", [row.number("x_m"), row.number("y_m"), 0.0])
}

fn errors(case: &str) -> Errors {
    let mut errors = Errors::default();
    for row in table("barriers").iter().filter(|row| row.text("case") == case) {
        let (got, expected) = (level(&room(row)), row.number("level_db"));
        if (got - expected).abs() > 0.3 {
            println!(
                "{}",
                room(row).lines().filter(|l| l.contains("_m") || l.contains("hz")).collect::<Vec<_>>().join(" ")
            );
            println!("  {got} {expected}");
        }
        errors.add(got, expected);
    }
    errors
}

#[test]
fn levels_behind_a_thick_barrier_are_exact() {
    errors("thick").assert_within("thick barrier", [0.3, 1.0, 2.5]);
}

#[test]
fn levels_behind_two_barriers_are_exact() {
    errors("two").assert_within("two barriers", [0.3, 1.0, 2.5]);
}
