//! Half-planes and wedges against exact solutions (src/verify/reference/edges.csv), in shadow and on its boundary.

mod reference;

use reference::{Errors, Row, SCREEN, head, level, levels, probe, source, table};

/// Faces 400 m long along the edge (the z axis) and 200 m deep.
fn faces(exterior_deg: f64) -> String {
    let face = |name: &str, angle: f64| {
        let (y, x) = angle.to_radians().sin_cos();
        let (x, y) = (200.0 * x, 200.0 * y);
        format!(
            "[[wall]]\nname = \"{name}\"\ncorners_m = [[0, 0, -200], [0, 0, 200], [{x:?}, {y:?}, 200], [{x:?}, {y:?}, -200]]\n"
        )
    };
    let mut walls = face("a", 0.0);
    if exterior_deg < 360.0 {
        walls += &face("b", exterior_deg);
    }
    walls + "[simulation]\nmax_rays = 0\n"
}

fn polar(r_m: f64, degrees: f64, z_m: f64) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [r_m * cos, r_m * sin, z_m]
}

fn ends(row: &Row) -> String {
    let from = polar(1.0, row.number("source_deg"), 0.0);
    let source = match row.text("source") {
        "plane" => source("plane", [0.0, 5.0, 0.0], from.map(|c| -c)),
        kind => source(kind, polar(row.number("source_r_m"), row.number("source_deg"), 0.0), [0.0, 0.0, 1.0]),
    };
    source + &probe("p", polar(row.number("r_m"), row.number("angle_deg"), row.number("dz_m")))
}

fn errors(walls: impl Fn(&Row) -> Option<String>) -> Errors {
    let mut errors = Errors::default();
    for row in &table("edges") {
        // Beside the faces the exact levels are those of direct and reflected sound as pressures.
        let behind = row.number("angle_deg") >= row.number("source_deg") + 180.0;
        if let Some(walls) = walls(row).filter(|_| behind) {
            errors.add(level(&(head("octave", row.number("band_hz")) + &walls + &ends(row))), row.number("level_db"));
        }
    }
    errors
}

// 0.005 dB: twice the largest error on the full tables (0.002 dB: faces that end, Hankel's function).
const BOUNDS: [f64; 3] = [0.001, 0.003, 0.005];

#[test]
fn wedges_of_walls_that_share_an_edge_are_exact_in_shadow() {
    for exterior in [270.0, 300.0, 350.0, 360.0] {
        // A plane wave also comes over the far ends of these faces.
        let chosen = |row: &Row| row.number("exterior_deg") == exterior && row.text("source") != "plane";
        errors(|row| chosen(row).then(|| faces(exterior))).assert_within(&format!("{exterior} degrees"), BOUNDS);
    }
}

#[test]
fn an_opening_that_leaves_a_half_plane_is_exact() {
    let screen = SCREEN.to_owned() + "[[opening]]\nname = \"rest\"\nwall = \"screen\"\nx_m = [-inf, 0.0]\n";
    errors(|row| (row.number("exterior_deg") == 360.0).then(|| screen.clone())).assert_within("half-plane", BOUNDS);
}

#[test]
fn levels_are_continuous_across_shadow_and_reflection_boundaries() {
    let at = |degrees: f64| {
        let place = source("point", polar(1.5, 50.0, 0.0), [0.0; 3]);
        level(&(head("octave", 250.0) + &faces(270.0) + &place + &probe("p", polar(2.0, degrees, 0.4))))
    };
    // 50 + 180 degrees: shadow; 180 - 50: reflection by the first face.
    for boundary in [230.0, 130.0] {
        let (before, on, after) = (at(boundary - 1e-4), at(boundary), at(boundary + 1e-4));
        assert!((before - after).abs() < 1e-3 && (on - after).abs() < 1e-3, "{boundary}: {before} {on} {after}");
    }
}

#[test]
fn the_insertion_loss_of_a_4_m_screen_rises_3_db_an_octave() {
    // Point source 2 m before and 2.5 m below the edge, receiver its mirror image behind (exact: Macdonald's integral at
    // 24 frequencies a band, equally spaced on the logarithm).
    let exact = [13.99, 16.65, 19.54, 22.52, 25.52, 28.52, 31.53, 34.54];
    let screen = SCREEN.to_owned() + "[[opening]]\nname = \"above\"\nwall = \"screen\"\nx_m = [0.0, inf]\n";
    let place = source("point", [-2.5, 2.0, 0.0], [0.0; 3]) + &probe("p", [-2.5, -2.0, 0.0]);
    for (loss, f) in exact.iter().zip([63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0]) {
        let tones: Vec<f64> = (0..24).map(|i| f * 2f64.powf((f64::from(i) + 0.5) / 24.0 - 0.5)).collect();
        let head = head("tone", 1.0).replace("[1]", &format!("{tones:?}"));
        let intensities = levels(&(head + &screen + &place))[0].iter().map(|l| 10f64.powf(0.1 * l)).sum::<f64>() / 24.0;
        let got = -20.0 * 4f64.log10() - 10.0 * intensities.log10();
        // The table is rounded to 0.01 dB.
        assert!((got - loss).abs() < 0.01, "{f} Hz: {got} {loss}");
    }
}
