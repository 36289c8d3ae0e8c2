//! Volume, surface and absorption of the room round a point.

mod geometry_scenes;

use std::f64::consts::PI;

use diffray::geometry::{Enclosure, Geometry};
use diffray::scene::Scene;
use geometry_scenes::*;
use glam::DVec3;

/// Estimates stand on about 65,000 stops: their standard error is near 0.3 %.
const ESTIMATE: f64 = 0.02;

fn enclosure(scene: &Scene, point: DVec3) -> Option<Enclosure> {
    Geometry::new(scene).expect("the scene is valid").enclosure(point, &scene.materials)
}

fn near(value: f64, expected: f64, relative: f64) -> bool {
    (value - expected).abs() <= relative * expected
}

#[test]
fn a_shoebox_is_exact() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    scene.boxes[0].faces[diffray::scene::Face::Floor as usize] = Some(1);
    let e = enclosure(&scene, v(1.0, 1.0, 1.0)).expect("closed");
    assert!(e.exact);
    assert!(near(e.volume_m3, 120.0, 1e-12) && near(e.area_m2, 158.0, 1e-12));
    assert!(near(e.absorption[0], (118.0 * 0.1 + 40.0 * 0.3) / 158.0, 1e-12));
    assert_eq!(e.open_share, 0.0);
}

#[test]
fn an_l_shaped_room_of_walls_is_exact() {
    let e = enclosure(&l_corridor(), v(1.0, 5.0, 1.5)).expect("closed");
    assert!(e.exact, "{e:?}");
    assert!(near(e.volume_m3, 60.0, 1e-12) && near(e.area_m2, 2.0 * 20.0 + 24.0 * 3.0, 1e-12));
}

#[test]
fn a_closed_door_halves_the_room_and_an_open_one_joins_both() {
    let closed = enclosure(&partitioned(0.0, 0.0), v(1.0, 1.0, 1.0)).expect("closed");
    // 4 x 5 x 3 m: the long faces of the box belong to it by half
    assert!(near(closed.volume_m3, 60.0, ESTIMATE), "{closed:?}");
    assert!(near(closed.area_m2, 94.0, ESTIMATE), "{closed:?}");
    let open = enclosure(&partitioned(0.0, 1.2), v(1.0, 1.0, 1.0)).expect("closed");
    assert!(near(open.volume_m3, 120.0, ESTIMATE), "{open:?}");
    assert!(near(open.area_m2, 158.0 + 2.0 * (15.0 - 1.2 * 2.1), ESTIMATE), "{open:?}");
}

#[test]
fn a_round_room_has_the_volume_of_its_mesh() {
    let mut scene = empty();
    scene.meshes.push(ellipsoid(4, v(3.0, 3.0, 3.0), v(7.0, 8.0, 9.0)));
    let e = enclosure(&scene, v(7.5, 8.0, 9.0)).expect("closed");
    // the inscribed polyhedron is a little smaller than the sphere
    assert!(near(e.volume_m3, 36.0 * PI, 0.03), "{e:?}");
    assert!(near(e.area_m2, 36.0 * PI, 0.03), "{e:?}");
}

#[test]
fn a_wall_standing_in_the_room_adds_both_its_sides() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    scene.walls.push(upright("screen", [4.0, 0.0], [4.0, 3.5], [0.0, 2.0]));
    let e = enclosure(&scene, v(1.0, 1.0, 1.0)).expect("closed");
    assert!(near(e.volume_m3, 120.0, ESTIMATE) && near(e.area_m2, 172.0, ESTIMATE), "{e:?}");
}

#[test]
fn open_air_has_no_enclosure_and_an_open_window_absorbs() {
    let mut scene = empty();
    assert_eq!(enclosure(&scene, DVec3::ZERO), None);
    scene.walls.push(upright("barrier", [0.0, -4.0], [0.0, 6.0], [0.0, 3.0]));
    assert_eq!(enclosure(&scene, v(1.0, 1.0, 1.0)), None);
    let mut window = empty();
    window.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    window.boxes[0].faces[diffray::scene::Face::XMin as usize] = None;
    let e = enclosure(&window, v(1.0, 1.0, 1.0)).expect("one of six faces is open");
    assert!(e.open_share > 0.05 && e.open_share < 0.15, "15 of 158 m^2 are open: {e:?}");
    assert!(e.absorption[0] > 0.1 && e.absorption[0] < 0.25);
}
