//! `interference = true`: direct, reflected and diffracted sound add as pressures.

mod reference;

use std::f64::consts::TAU;

use glam::DVec3;
use reference::{SCREEN, head, level, outcome, probe, source};

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

/// Lengths in m of the paths of a room with one source, probe and band, by their delays, and its level.
fn ways_and_level(room: &str) -> (Vec<f64>, f64) {
    let outcome = outcome(room);
    let reception = &outcome.receptions[0];
    (reception.paths.iter().map(|path| path.delay_s * 343.0).collect(), reception.levels[0].level_db())
}

/// 10 lg of the band mean of |sum of plane waves of amplitude 1 over these ways in m|^2.
fn together(ways_m: &[f64], mean: &str, hz: f64) -> f64 {
    let half = if mean == "tone" { 1.0 } else { 2f64.sqrt() };
    let [low, high] = [hz / half, hz * half].map(|f| TAU * f / 343.0);
    let cos = |d: f64| {
        let phase = 0.5 * (high - low) * d;
        let sinc = if phase == 0.0 { 1.0 } else { phase.sin() / phase };
        sinc * (0.5 * (high + low) * d).cos()
    };
    let sum: f64 = ways_m.iter().flat_map(|a| ways_m.iter().map(move |b| cos(a - b))).sum();
    10.0 * sum.log10()
}

#[test]
fn a_plane_wave_and_its_reflections_interfere_by_the_places_of_their_mirrors() {
    let floor =
        "[[wall]]\nname = \"floor\"\nunbounded = true\ncorners_m = [[0, 0, -0.7], [1, 0, -0.7], [1, 1, -0.7]]\n";
    let wall = "[[wall]]\nname = \"wall\"\nunbounded = true\ncorners_m = [[2.3, 0, 0], [2.3, 1, 0], [2.3, 0, 1]]\n";
    let order = INTERFERENCE.to_owned() + "reflection_order = 2\n";
    let direction = DVec3::new(0.8, 0.3, -0.5).normalize();
    let mirrored = |v: DVec3, at: DVec3, normal: DVec3| v - normal * (2.0 * (v - at).dot(normal));
    let below = |p: DVec3| mirrored(p, DVec3::new(0.0, 0.0, -0.7), DVec3::Z);
    let behind = |p: DVec3| mirrored(p, DVec3::new(2.3, 0.0, 0.0), DVec3::X);
    let from = DVec3::new(-4.0, 1.0, 2.5);
    for height_m in [0.05, 0.3, 0.7, 1.9] {
        let at = DVec3::new(1.1, 0.4, height_m - 0.7);
        let place = source("plane", from.to_array(), direction.to_array()) + &probe("p", at.to_array());
        // A reflection comes to the probe as the wave itself to its mirror image.
        let way_m = |image: DVec3| (image - from).dot(direction);
        let over_floor = vec![way_m(at), way_m(below(at))];
        let in_corner = vec![way_m(at), way_m(below(at)), way_m(behind(at)), way_m(below(behind(at)))];
        for (walls, mut expected_m) in [(floor.to_owned(), over_floor), (floor.to_owned() + wall, in_corner)] {
            expected_m.sort_by(f64::total_cmp);
            for (mean, hz) in [("tone", 100.0), ("tone", 437.0), ("octave", 125.0), ("octave", 1000.0)] {
                let (ways_m, got) = ways_and_level(&(head(mean, hz) + &walls + &order + &place));
                assert_eq!(ways_m.len(), expected_m.len());
                let far = ways_m.iter().zip(&expected_m).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(far < 1e-9, "{height_m}: {ways_m:?} {expected_m:?}");
                let expected = together(&expected_m, mean, hz);
                assert!((got - expected).abs() < 0.001, "{height_m} m, {mean} {hz}: {got} {expected}");
            }
        }
    }
}

/// A wall parallel to z through two places (x, y in m): the whole plane, or the strip between them, 10 km long.
type Upright = (&'static str, bool, [[f64; 2]; 2]);

/// Walls, an opening, and a probe in a plane wave.
struct InPlaneWave {
    name: &'static str,
    walls: Vec<Upright>,
    opening: &'static str,
    direction: [f64; 3],
    at: [f64; 3],
}

impl InPlaneWave {
    /// With edges and openings on the way, and mirrors.
    fn all() -> [Self; 4] {
        let ground = ("ground", true, [[0.0, -1.5], [1.0, -1.5]]);
        let screen = ("screen", true, [[0.0, 0.0], [1.0, 0.0]]);
        let side = ("side", true, [[2.5, 0.0], [2.5, 1.0]]);
        let leaf = ("leaf", false, [[1.3, -0.7], [1.3, -9.0]]);
        let [one, two] = [("one", 0.0), ("two", 0.6)].map(|(name, x)| (name, false, [[x, -1.0], [x, 0.4]]));
        let opening = "[[opening]]\nname = \"slit\"\nwall = \"screen\"\nx_m = [0.6, 1.1]\n";
        let over = |name, walls, at| Self { name, walls, opening: "", direction: [0.8, -0.3, 0.4], at };
        let through = |name, walls, at| Self { name, walls, opening, direction: [0.3, -0.8, 0.4], at };
        [
            over("edges", vec![ground, one], [1.5, 0.1, 1.5]),
            over("two barriers", vec![ground, one, two], [2.0, -0.2, 1.5]),
            through("slit", vec![screen, side], [1.4, -1.2, 1.5]),
            through("slit and edge", vec![screen, side, leaf], [2.0, -1.2, 1.5]),
        ]
    }

    /// The room with another source, moved by a vector but for the source.
    fn room(&self, (mean, hz, transport): (&str, f64, &str), by: DVec3, source: &str) -> String {
        let wall = |(name, unbounded, [a, b]): &Upright| {
            let corner = |[x, y]: [f64; 2], z: f64| format!("{:?}", (DVec3::new(x, y, z) + by).to_array());
            let corners = [corner(*a, -5e3), corner(*b, -5e3), corner(*b, 5e3), corner(*a, 5e3)];
            let corners = corners[..if *unbounded { 3 } else { 4 }].join(", ");
            format!("[[wall]]\nname = \"{name}\"\nunbounded = {unbounded}\ncorners_m = [{corners}]\n")
        };
        head(mean, hz)
            + INTERFERENCE
            + &format!("reflection_order = 2\ntransport = \"{transport}\"\n")
            + &self.walls.iter().map(wall).collect::<String>()
            + self.opening
            + source
            + &probe("p", (DVec3::from(self.at) + by).to_array())
    }

    fn direction(&self) -> DVec3 {
        DVec3::from(self.direction).normalize()
    }
}

const HEARD: [(&str, f64, &str); 3] = [("tone", 250.0, "wbsdf"), ("octave", 250.0, "wbsdf"), ("octave", 250.0, "utd")];

#[test]
fn what_a_plane_wave_does_in_a_room_moves_with_the_room() {
    for case in InPlaneWave::all() {
        for heard in HEARD {
            let moved = |by: DVec3, from: DVec3| {
                ways_and_level(&case.room(heard, by, &source("plane", from.to_array(), case.direction)))
            };
            let (ways_m, level) = moved(DVec3::ZERO, DVec3::ZERO);
            let by = DVec3::new(3.1, -0.77, 1.3);
            let later_m = by.dot(case.direction());
            // The room with its source; the front alone from which delays are counted; the room alone.
            for (by, from, later_m) in [(by, by, 0.0), (DVec3::ZERO, by, -later_m), (by, DVec3::ZERO, later_m)] {
                let (moved_m, moved) = moved(by, from);
                assert_eq!(moved_m.len(), ways_m.len(), "{}", case.name);
                let far = moved_m.iter().zip(&ways_m).map(|(a, b)| (a - b - later_m).abs()).fold(0.0, f64::max);
                assert!(far < 1e-9, "{}: {moved_m:?} {ways_m:?} {later_m}", case.name);
                assert!((moved - level).abs() < 1e-6, "{}, {heard:?}: {moved} {level}", case.name);
            }
        }
    }
}

#[test]
fn a_plane_wave_does_in_a_room_what_a_point_source_does_from_afar() {
    const FAR_M: f64 = 1e5;
    for case in InPlaneWave::all() {
        for heard in HEARD {
            let plane = case.room(heard, DVec3::ZERO, &source("plane", [0.0; 3], case.direction));
            let from = DVec3::from(case.at) - FAR_M * case.direction();
            let point = case.room(heard, DVec3::ZERO, &source("point", from.to_array(), [0.0; 3]));
            let ((ways_m, plane), (afar_m, point)) = (ways_and_level(&plane), ways_and_level(&point));
            let error = plane - point - 20.0 * FAR_M.log10();
            // The second opinion leaves out ways that end beside an edge; edges at the strips' ends are endless in a plane wave.
            for way_m in ways_m.iter().filter(|way_m| heard.2 == "wbsdf" && way_m.abs() < 100.0) {
                let later_m = afar_m.iter().map(|afar_m| afar_m - FAR_M + case.direction().dot(DVec3::from(case.at)));
                let nearest = later_m.map(|m| (m - way_m).abs()).fold(f64::INFINITY, f64::min);
                assert!(nearest < 1e-3, "{}, {heard:?}: {way_m} in {afar_m:?}", case.name);
            }
            println!("{}, {heard:?}: {error:.4} dB", case.name);
            // Tones hear the ends of the strips, which those of a plane wave do not have.
            let most = if heard.0 == "tone" { 0.05 } else { 0.002 };
            assert!(error.abs() < most, "{}, {heard:?}: {error}", case.name);
        }
    }
}
