//! Edges that end, and edges of absorbing walls.

mod reference;

use reference::{head, level, levels, probe, source};

/// A thin wall in the plane y = 0, between these limits along x and z.
fn wall(x: [f64; 2], z: [f64; 2], material: &str) -> String {
    let ([a, b], [c, d]) = (x, z);
    format!(
        "[material.soft]\nabsorption = 1.0\n[[wall]]\nname = \"w\"\nmaterial = \"{material}\"\n\
         corners_m = [[{a:?}, 0, {c:?}], [{b:?}, 0, {c:?}], [{b:?}, 0, {d:?}], [{a:?}, 0, {d:?}]]\n"
    )
}

/// Levels at places 1 mm apart from `from` along the unit vector `step`.
fn walk(room: &str, from: [f64; 3], step: [f64; 3], count: usize) -> Vec<f64> {
    let place = |i: usize| std::array::from_fn::<f64, 3, _>(|c| from[c] + 1e-3 * i as f64 * step[c]);
    let probes: String = (0..count).map(|i| probe(&format!("p{i}"), place(i))).collect();
    levels(&(room.to_owned() + &probes)).into_iter().map(|bands| bands[0]).collect()
}

#[test]
fn levels_round_a_barrier_that_ends_have_no_steps() {
    // A wall 4 m long and 3 m high in the open; the source 1.5 m before it, 0.5 m from its end and 0.6 m below its top.
    let from = [1.5, 1.5, 2.4];
    for interference in [false, true] {
        for f in [125.0, 1000.0, 4000.0] {
            let room = head("octave", f)
                + &wall([-2.0, 2.0], [0.0, 3.0], "rigid")
                + &format!("[simulation]\ninterference = {interference}\n")
                + &source("point", from, [0.0; 3]);
            // The straight line from the source over the corner (2, 0, 3) meets y = -1.5 at (2.5, -1.5, 3.6): the shadow's
            // corner. Across its sides, through it, where Keller's point leaves the top (x = 2.5), and in front of the
            // wall across the reflection's end (2.5, 1.5, z).
            let ways = [
                ([2.45, -1.5, 2.0], [1.0, 0.0, 0.0]),
                ([1.0, -1.5, 3.55], [0.0, 0.0, 1.0]),
                ([2.4703, -1.5, 3.5604], [0.6, 0.0, 0.8]),
                ([2.45, -1.5, 2.9], [1.0, 0.0, 0.0]),
                ([2.45, -1.5, 4.4], [1.0, 0.0, 0.0]),
                ([2.45, 1.5, 2.0], [1.0, 0.0, 0.0]),
                ([2.48, 1.5, 3.57], [0.6, 0.0, 0.8]),
            ];
            for (start, step) in ways {
                let levels = walk(&room, start, step, 100);
                assert!(levels.iter().all(|l| l.is_finite()));
                for (i, w) in levels.windows(3).enumerate() {
                    // A step of 0.1 dB shows in the second difference; smooth interference of an octave is far below.
                    let second = w[2] - 2.0 * w[1] + w[0];
                    assert!(second.abs() < 0.1, "{f} Hz, interference {interference}, {start:?} + {i} mm: {w:?}");
                }
            }
        }
    }
}

#[test]
fn a_ray_that_hits_a_corner_exactly_is_no_louder_than_its_neighbours() {
    let room =
        head("octave", 1000.0) + &wall([-2.0, 2.0], [0.0, 3.0], "rigid") + &source("point", [1.5, 1.5, 2.4], [0.0; 3]);
    let walk = walk(&room, [2.499, -1.5, 3.6], [1.0, 0.0, 0.0], 3);
    // Three quarters of the sound are seen past a square corner; past one that is seen obliquely a little more or less.
    assert!((walk[1] - 0.5 * (walk[0] + walk[2])).abs() < 0.5, "{walk:?}");
}

#[test]
fn a_barrier_much_longer_than_the_fresnel_zone_is_a_half_plane() {
    // 60 m: the ends' ways are 20 m longer. They add a wave of -40 dB of the edge's at 125 Hz: 0.1 dB, in octaves much less.
    for f in [125.0, 1000.0] {
        let place = source("point", [0.0, 2.0, 2.0], [0.0; 3]) + &probe("p", [1.0, -2.0, 2.0]);
        let at = |half: f64| level(&(head("octave", f) + &wall([-half, half], [-60.0, 3.0], "rigid") + &place));
        let (finite, endless) = (at(30.0), at(400.0));
        assert!((finite - endless).abs() < 0.02, "{f} Hz: {finite} {endless}");
    }
}

#[test]
fn a_short_barrier_lets_more_sound_round_its_ends_than_a_long_one() {
    // Three sides: the top alone carries -20 lg |D|; with ends 1 m beside the axis, sound comes round them as well.
    let place = source("point", [0.0, 2.0, 1.0], [0.0; 3]) + &probe("p", [0.0, -2.0, 1.0]);
    let at = |half: f64| {
        let ground = "[[wall]]\nname = \"ground\"\nunbounded = true\ncorners_m = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\n";
        level(&(head("octave", 2000.0) + ground + &wall([-half, half], [0.0, 3.0], "rigid") + &place))
    };
    let (long, short) = (at(50.0), at(1.0));
    // Each end stands half as far from the straight line as the top: Keller gives 5 dB more for one of them in deep shadow.
    assert!(short - long > 5.0 && short - long < 15.0, "{long} {short}");
}

#[test]
fn a_black_screen_leaves_half_the_amplitude_on_its_shadow_boundary() {
    // Without the terms of the faces only the incident pair is left: exactly half of the direct sound on the boundary.
    let place = |y: f64| source("point", [-1.0, 2.0, 0.0], [0.0; 3]) + &probe("p", [1.0, y, 0.3]);
    for f in [125.0, 2000.0] {
        let room =
            |material: &str, y: f64| head("octave", f) + &wall([-300.0, 0.0], [-300.0, 300.0], material) + &place(y);
        let free = -10.0 * (4.0 + 16.0 + 0.09_f64).log10();
        let soft = level(&room("soft", -2.0));
        assert!((soft - free + 20.0 * 2f64.log10()).abs() < 2e-3, "{f} Hz: {soft} {free}");
        // In front of it nothing is reflected: the edge's incident pair is half of Keller's 1/(2 pi sqrt N), N = 1.8 at 125 Hz.
        let (before, free_before) = (level(&room("soft", 2.0)), -10.0 * 4.09_f64.log10());
        assert!((before - free_before).abs() < 0.5, "{f} Hz: {before} {free_before}");
        if f > 1000.0 {
            // On the reflection boundary of a rigid one a quarter of the reflection's energy is heard: 4.1 m against 20 m2.
            let quarter = 10.0 * (1.0 + 0.25 * 4.09 / 20.09_f64).log10();
            assert!((level(&room("rigid", 2.0)) - before - quarter).abs() < 0.3);
        }
    }
}
