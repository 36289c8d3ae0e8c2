//! `interference = true`: direct, reflected and diffracted sound add as pressures.

mod reference;

use reference::{SCREEN, head, level, probe, source};

const INTERFERENCE: &str = "[simulation]\ninterference = true\nmax_rays = 0\n";

#[test]
fn a_source_over_a_rigid_floor_interferes_with_its_image() {
    let floor = "[[wall]]\nname = \"floor\"\nunbounded = true\ncorners_m = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\n";
    let (low, high) = (250.0 / 2f64.sqrt(), 250.0 * 2f64.sqrt());
    let place = source("point", [0.0, 0.0, 1.2], [0.0; 3]) + &probe("p", [5.0, 0.0, 1.5]);
    let (direct, image) = (5.0_f64.hypot(0.3), 5.0_f64.hypot(2.7));
    let phase = |f: f64| std::f64::consts::TAU * f / 343.0 * (image - direct);
    // Mean of cos over the band in closed form.
    let cos = (phase(high).sin() - phase(low).sin()) / (phase(high) - phase(low));
    let expected = 10.0 * (direct.powi(-2) + image.powi(-2) + 2.0 * cos / (direct * image)).log10();
    let got = level(&(head("octave", 250.0) + floor + INTERFERENCE + &place));
    assert!((got - expected).abs() < 1e-6, "{got} {expected}");
    let energies = level(&(head("octave", 250.0) + floor + &place));
    assert!((energies - 10.0 * (direct.powi(-2) + image.powi(-2)).log10()).abs() < 1e-9);
}

#[test]
fn in_front_of_a_half_plane_all_waves_add_up_to_the_exact_field() {
    // Exact levels (Macdonald's integral, docs/verification.md, case A, point source, octave bands; source 1 m from the edge at
    // 60 degrees, receiver 0.5 m): 15 degrees off the face, on the face's side, and behind.
    let screen = SCREEN.to_owned() + "[[opening]]\nname = \"rest\"\nwall = \"screen\"\nx_m = [-inf, 0.0]\n";
    let polar = |r: f64, degrees: f64, z: f64| [r * degrees.to_radians().cos(), r * degrees.to_radians().sin(), z];
    let rows = include_str!("reference/lit.csv").lines().filter(|l| !l.starts_with('#')).skip(1);
    let mut count = 0;
    for row in rows {
        let v: Vec<f64> = row.split(',').map(|x| x.parse().expect("a number")).collect();
        let [r_s, deg_s, r, deg, dz, f, exact] = v[..] else { panic!("{row}") };
        let place = source("point", polar(r_s, deg_s, 0.0), [0.0; 3]) + &probe("p", polar(r, deg, dz));
        let got = level(&(head("octave", f) + &screen + INTERFERENCE + &place));
        // 0.02 dB: the tables' 64 frequencies a band, where the ways differ by many wavelengths.
        assert!((got - exact).abs() < 0.02, "{row}: {got}");
        count += 1;
    }
    assert!(count > 20);
}

#[test]
fn the_second_opinion_agrees_in_a_room_of_its_own_kind() {
    // Over a barrier on rigid ground: four ways, each over the top, and the two ends.
    let room = |transport: &str| {
        head("octave", 1000.0)
            + "[[wall]]\nname = \"ground\"\nunbounded = true\ncorners_m = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\n\
               [[wall]]\nname = \"barrier\"\ncorners_m = [[0, -60, 0], [0, 60, 0], [0, 60, 4], [0, -60, 4]]\n"
            + &source("point", [-2.0, 0.0, 1.5], [0.0; 3])
            + &probe("p", [2.0, 0.0, 1.0])
            + INTERFERENCE
            + &format!("transport = \"{transport}\"\n")
    };
    let (signed, utd) = (level(&room("wbsdf")), level(&room("utd")));
    assert!((signed - utd).abs() < 0.05, "{signed} {utd}");
}
