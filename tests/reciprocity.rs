//! Source and probe may change places; and a scene may be turned or described the other way round.

mod reference;

use reference::{SCREEN, level, levels, probe, source};

const HEAD: &str = "[air]\nspeed_of_sound_m_s = 343.0\nabsorption = false\n";
const ONE_SIDE: [[f64; 3]; 3] = [[0.7, 1.3, -0.4], [-1.9, 0.3, 0.9], [0.1, 4.0, 0.0]];
const OTHER_SIDE: [[f64; 3]; 4] = [[0.2, -0.4, 0.3], [2.2, -0.7, -0.5], [-1.0, -3.0, 1.5], [0.45, -1.0, 0.0]];

fn opening(x_m: &str, y_m: &str) -> String {
    let name = x_m.replace(|c: char| !c.is_ascii_digit(), "");
    let y_m = if y_m.is_empty() { String::new() } else { format!("y_m = {y_m}\n") };
    format!("[[opening]]\nname = \"{name}\"\nwall = \"screen\"\nx_m = {x_m}\n{y_m}")
}

fn assert_reciprocal(what: &str, geometry: &str) {
    for a in ONE_SIDE {
        for b in OTHER_SIDE {
            let room = |s, p| HEAD.to_owned() + geometry + &source("point", s, [0.0; 3]) + &probe("p", p);
            let (there, back) = (levels(&room(a, b)), levels(&room(b, a)));
            for (x, y) in there[0].iter().zip(&back[0]) {
                // 1e-6 of the intensity.
                assert!((x - y).abs() < 4e-6 || x == y, "{what}, {a:?} {b:?}: {x} {y}");
            }
        }
    }
}

#[test]
fn slits_pairs_of_slits_half_planes_and_rectangles_are_reciprocal() {
    assert_reciprocal("slit", &(SCREEN.to_owned() + &opening("[-0.2, 0.5]", "")));
    assert_reciprocal("two slits", &(SCREEN.to_owned() + &opening("[-0.2, 0.1]", "") + &opening("[0.3, 0.70]", "")));
    assert_reciprocal("half-plane", &(SCREEN.to_owned() + &opening("[-inf, 0.5]", "")));
    assert_reciprocal("rectangle", &(SCREEN.to_owned() + &opening("[-0.2, 0.5]", "[-0.3, 1.0]")));
}

#[test]
fn edges_are_reciprocal() {
    let wedge = "[[wall]]\nname = \"a\"\ncorners_m = [[0, 0, -50], [0, 0, 50], [50, 0, 50], [50, 0, -50]]\n\
                 [[wall]]\nname = \"b\"\ncorners_m = [[0, 0, -50], [0, 0, 50], [9, -50, 50], [9, -50, -50]]\n\
                 [simulation]\nmax_rays = 0\n";
    assert_reciprocal("wedge", wedge);
}

#[test]
fn levels_do_not_depend_on_how_the_screen_is_described_or_turned() {
    // Local x reversed: origin at x = 1.
    let reversed = "[[wall]]\nname = \"screen\"\ncorners_m = [[1, 0, 0], [0, 0, 0], [0, 0, 1]]\nunbounded = true\n";
    // x -> y, y -> z, z -> x.
    let turned = "[[wall]]\nname = \"screen\"\ncorners_m = [[0, 0, 0], [0, 1, 0], [1, 1, 0]]\nunbounded = true\n";
    let turn = |p: [f64; 3]| [p[2], p[0], p[1]];
    let (s, p) = (ONE_SIDE[0], OTHER_SIDE[1]);
    for (kind, toward) in [("point", [0.0; 3]), ("line", [0.0, 0.0, 2.0]), ("plane", [0.3, -0.8, 0.2])] {
        let from = |kind: &str, s, toward| source(kind, s, toward);
        let plain =
            level(&(HEAD.to_owned() + SCREEN + &opening("[-0.2, 0.5]", "") + &from(kind, s, toward) + &probe("p", p)));
        let mirror = HEAD.to_owned() + reversed + &opening("[0.5, 1.2]", "") + &from(kind, s, toward) + &probe("p", p);
        let away = toward.map(|c: f64| if kind == "line" { -c } else { c });
        let other = HEAD.to_owned()
            + turned
            + &opening("[-0.2, 0.5]", "")
            + &from(kind, turn(s), turn(away))
            + &probe("p", turn(p));
        for room in [mirror, other] {
            assert!((level(&room) - plain).abs() < 1e-9, "{kind}: {} {plain}", level(&room));
        }
    }
}
