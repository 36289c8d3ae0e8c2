//! What rays meet: planes, groups, portals, leaves, thick walls, coincident faces.

mod geometry_scenes;

use diffray::geometry::{Element, Geometry, Skip};
use diffray::scene::{Edges, Transport};
use geometry_scenes::*;
use glam::DVec3;

const EXACT_M: f64 = 1e-12;

fn build(scene: &diffray::scene::Scene) -> Geometry {
    Geometry::new(scene).expect("the scene is valid")
}

fn name(g: &Geometry, e: Element) -> &str {
    match e {
        Element::Surface(i) => &g.surfaces[i].name,
        Element::Portal(_) => "portal",
    }
}

#[test]
fn a_shoebox_has_six_faces_of_exact_area_that_face_inward() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    let g = build(&scene);
    assert_eq!(g.surfaces.len(), 6);
    let total: f64 = g.surfaces.iter().map(|s| s.area_m2).sum();
    assert!((total - 158.0).abs() < 1e-12);
    for s in &g.surfaces {
        assert!((v(4.0, 2.5, 1.5) - s.frame.origin_m).dot(s.frame.normal) > 0.0, "{}", s.name);
        assert!((s.frame.x.cross(s.frame.y) - s.frame.normal).length() < 1e-15);
    }
    for (d, t, n) in [
        (DVec3::X, 7.0, "hall.x_max"),
        (DVec3::NEG_X, 1.0, "hall.x_min"),
        (DVec3::Y, 3.0, "hall.y_max"),
        (DVec3::NEG_Y, 2.0, "hall.y_min"),
        (DVec3::Z, 2.0, "hall.ceiling"),
        (DVec3::NEG_Z, 1.0, "hall.floor"),
    ] {
        let hit = first(&g, v(1.0, 2.0, 1.0), d).expect("closed");
        assert!((hit.t - t).abs() < EXACT_M);
        assert_eq!(name(&g, hit.element), n);
    }
}

#[test]
fn the_nearest_surface_of_a_shoebox_is_as_far_as_its_nearest_face() {
    let g = build(&partitioned(0.0, 1.2));
    assert!((g.closest_surface_distance(v(2.0, 2.5, 0.25)) - 0.25).abs() < EXACT_M);
    // in the middle of the door, 2.1 m high from y = 1.0 to 2.2: the jambs are 0.6 m away
    assert!((g.closest_surface_distance(v(4.0, 1.6, 1.2)) - 0.6).abs() < EXACT_M);
}

#[test]
fn a_door_is_wall_leaf_and_portal_in_one_plane_and_group() {
    let g = build(&partitioned(0.0, 0.3));
    let at = |y: f64, z: f64| first(&g, v(1.0, y, z), DVec3::X).expect("closed");
    let (wall, portal, leaf) = (at(0.5, 1.0), at(1.2, 1.0), at(1.8, 1.0));
    assert_eq!(name(&g, wall.element), "partition");
    assert_eq!(portal.element, Element::Portal(0));
    assert_eq!(name(&g, leaf.element), "door leaf");
    assert_eq!(g.surfaces[g.surfaces.len() - 1].material, 1);
    for hit in [portal, leaf] {
        assert_eq!((hit.plane, hit.group), (wall.plane, wall.group));
        assert!((hit.t - 3.0).abs() < EXACT_M);
    }
    let beyond = g.closest(portal.point, DVec3::X, f64::INFINITY, Skip::passed(&portal)).expect("closed");
    assert_eq!(name(&g, beyond.element), "hall.x_max");
    assert!((beyond.t - 4.0).abs() < EXACT_M);
}

#[test]
fn a_closed_door_has_no_portal_and_an_open_one_no_leaf() {
    let closed = build(&partitioned(0.0, 0.0));
    assert!(closed.portals.is_empty());
    assert_eq!(name(&closed, first(&closed, v(1.0, 1.6, 1.0), DVec3::X).expect("closed").element), "door leaf");
    let open = build(&partitioned(0.0, 1.2));
    assert!(open.surfaces.iter().all(|s| s.name != "door leaf"));
    assert_eq!(first(&open, v(1.0, 1.6, 1.0), DVec3::X).expect("closed").element, Element::Portal(0));
    let partition = open.surfaces.iter().find(|s| s.name == "partition").expect("it is there");
    assert!((partition.area_m2 - (15.0 - 1.2 * 2.1)).abs() < 1e-12);
}

#[test]
fn without_diffraction_openings_are_plain_holes() {
    for (transport, edges) in [(Transport::Geometric, Edges::Auto), (Transport::Wbsdf, Edges::Off)] {
        let mut scene = partitioned(0.1, 0.3);
        scene.simulation.transport = transport;
        scene.simulation.edges = edges;
        let g = build(&scene);
        assert!(g.portals.is_empty());
        let hit = first(&g, v(1.0, 1.2, 1.0), DVec3::X).expect("closed");
        assert_eq!(name(&g, hit.element), "hall.x_max");
        assert_eq!(name(&g, first(&g, v(1.0, 1.8, 1.0), DVec3::X).expect("closed").element), "door leaf");
    }
}

#[test]
fn a_thick_wall_is_met_on_both_faces_and_its_group_counts_once() {
    let g = build(&partitioned(0.2, 0.3));
    for (y, what) in [(0.5, "partition"), (1.2, "portal"), (1.8, "door leaf")] {
        for (x, d, t) in [(1.0, DVec3::X, 2.9), (7.0, DVec3::NEG_X, 2.9)] {
            let hit = first(&g, v(x, y, 1.0), d).expect("closed");
            assert!((hit.t - t).abs() < EXACT_M, "{what}: {}", hit.t);
            assert_eq!(name(&g, hit.element), what);
            let beyond = g.closest(hit.point, d, f64::INFINITY, Skip::passed(&hit)).expect("closed");
            assert!((beyond.t - 4.1).abs() < EXACT_M, "the far face of the same wall counts no second time");
        }
        let hits = g.segment(v(1.0, y, 1.0), v(7.0, y, 1.0), Skip::NONE, Skip::NONE);
        assert_eq!(hits.len(), 1, "{what}");
        assert!((hits[0].t - 2.9).abs() < EXACT_M);
    }
}

#[test]
fn a_ray_that_crosses_a_thick_wall_s_portal_downwards_meets_the_sill_and_then_the_other_room() {
    // two boxes, facing sides open, a thick wall between them: below its door there is nothing but the sill
    let mut scene = empty();
    scene.boxes.push(room("left", v(0.0, 0.0, 0.0), v(3.9, 5.0, 3.0)));
    scene.boxes.push(room("right", v(4.1, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    scene.boxes[0].faces[diffray::scene::Face::XMax as usize] = None;
    scene.boxes[1].faces[diffray::scene::Face::XMin as usize] = None;
    let mut partition = upright("partition", [4.0, 0.0], [4.0, 5.0], [0.0, 3.0]);
    partition.thickness_m = 0.2;
    scene.walls.push(partition);
    scene.openings.push(door(&scene, 0, [1.0, 2.2], [0.0, 2.1], 1.2));
    let one_box = partitioned(0.2, 1.2);
    for (scene, what) in [(scene, "two boxes"), (one_box, "one box")] {
        let g = build(&scene);
        let d = v(1.0, 0.0, -0.1).normalize();
        let portal = first(&g, v(3.8, 1.6, 0.02), d).expect("the door stands there");
        assert_eq!(portal.element, Element::Portal(0));
        let sill = g.closest(portal.point, d, f64::INFINITY, Skip::passed(&portal)).expect("the sill");
        assert_eq!(name(&g, sill.element), "partition rim 1", "{what}");
        assert!(sill.point.z.abs() < EXACT_M && sill.point.x > 3.9 && sill.point.x < 4.1);
        let up = v(d.x, d.y, -d.z);
        let beyond = g.closest(sill.point, up, f64::INFINITY, Skip::reflected(&sill)).expect("closed");
        assert!((beyond.point.x - 8.0).abs() < EXACT_M, "{what}: the portal is crossed once: {beyond:?}");
        // exactly over the sill as well
        let low = g.closest(v(3.9, 1.6, 0.0), d, f64::INFINITY, Skip::passed(&portal)).expect("the sill");
        assert_eq!((name(&g, low.element), low.t), ("partition rim 1", 0.0), "{what}");
    }
}

#[test]
fn whatever_passes_thick_walls_and_their_doors_stays_in_the_two_rooms() {
    let mut two_boxes = empty();
    two_boxes.boxes.push(room("left", v(0.0, 0.0, 0.0), v(3.9, 5.0, 3.0)));
    two_boxes.boxes.push(room("right", v(4.1, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    two_boxes.boxes[0].faces[diffray::scene::Face::XMax as usize] = None;
    two_boxes.boxes[1].faces[diffray::scene::Face::XMin as usize] = None;
    let mut partition = upright("partition", [4.0, 0.0], [4.0, 5.0], [0.0, 3.0]);
    partition.thickness_m = 0.2;
    two_boxes.walls.push(partition);
    two_boxes.openings.push(door(&two_boxes, 0, [1.0, 2.2], [0.0, 2.1], 0.3));
    let mut n = Numbers(17);
    for (transport, scene) in [
        (Transport::Wbsdf, two_boxes.clone()),
        (Transport::Geometric, two_boxes),
        (Transport::Wbsdf, partitioned(0.2, 0.3)),
        (Transport::Geometric, partitioned(0.2, 0.3)),
    ] {
        let mut scene = scene;
        scene.simulation.transport = transport;
        let g = build(&scene);
        let (mut crossings, mut in_wall) = (0, 0);
        for _ in 0..1_000 {
            let (mut p, mut d) = (n.within(v(0.1, 0.1, 0.1), v(3.8, 4.9, 2.9)), n.direction());
            let mut skip = Skip::NONE;
            for _ in 0..200 {
                let hit =
                    g.closest(p, d, f64::INFINITY, skip).unwrap_or_else(|| panic!("lost at {p} along {d}, {skip:?}"));
                assert!(hit.point.x > -1e-9 && hit.point.x < 8.0 + 1e-9 && hit.point.z > -1e-9);
                let is_face = name(&g, hit.element) == "partition";
                let passes = matches!(hit.element, Element::Portal(_)) || (is_face && n.unit() < 0.1);
                in_wall += usize::from(hit.inside.is_some());
                p = hit.point;
                if passes {
                    // a portal sends rays on in any direction across it
                    d = n.direction().with_x(n.unit().copysign(d.x)).normalize();
                    crossings += 1;
                    skip = Skip::passed(&hit);
                } else {
                    let normal = g.planes()[hit.plane].normal;
                    d -= normal * (2.0 * d.dot(normal));
                    skip = Skip::reflected(&hit);
                }
            }
        }
        assert!(crossings > 100);
        assert!(in_wall > 10, "some rays run steeply inside the wall");
    }
}

#[test]
fn segments_are_blocked_strictly_between_their_ends() {
    let g = build(&partitioned(0.0, 0.3));
    let (a, b, on_wall) = (v(1.0, 4.0, 1.0), v(7.0, 4.0, 1.0), v(4.0, 4.0, 1.0));
    assert!(g.blocked(a, b, Skip::NONE, Skip::NONE));
    assert!(!g.blocked(a, on_wall, Skip::NONE, Skip::NONE));
    assert!(!g.blocked(on_wall, b, Skip::NONE, Skip::NONE));
    assert!(!g.blocked(a, a, Skip::NONE, Skip::NONE));
    assert!(g.blocked(v(1.0, 1.2, 1.0), v(7.0, 1.2, 1.0), Skip::NONE, Skip::NONE), "a portal blocks");
    let group = Skip { plane: None, group: Some(g.portals[0].group) };
    assert!(!g.blocked(a, b, group, Skip::NONE) && !g.blocked(a, b, Skip::NONE, group));
    assert!(g.blocked(a, v(1.0, 9.0, 1.0), Skip::NONE, Skip::NONE));
}

#[test]
fn a_segment_lists_walls_in_order() {
    let mut scene = empty();
    for (i, x) in [3.0, 1.0, 2.0].iter().enumerate() {
        scene.walls.push(upright(&format!("wall {i}"), [*x, -1.0], [*x, 1.0], [-1.0, 1.0]));
    }
    let g = build(&scene);
    let hits = g.segment(v(0.0, 0.1, 0.2), v(4.0, 0.1, 0.2), Skip::NONE, Skip::NONE);
    let names: Vec<&str> = hits.iter().map(|h| name(&g, h.element)).collect();
    assert_eq!(names, ["wall 1", "wall 2", "wall 0"]);
    assert!(hits.iter().zip([1.0, 2.0, 3.0]).all(|(h, t)| (h.t - t).abs() < EXACT_M));
}

#[test]
fn of_two_touching_boxes_the_face_of_the_ray_s_own_box_is_met() {
    let mut scene = empty();
    scene.boxes.push(room("left", v(0.0, 0.0, 0.0), v(4.0, 5.0, 3.0)));
    scene.boxes.push(room("right", v(4.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    let g = build(&scene);
    let a = first(&g, v(1.0, 2.0, 1.0), DVec3::X).expect("closed");
    let b = first(&g, v(7.0, 2.0, 1.0), DVec3::NEG_X).expect("closed");
    assert_eq!((name(&g, a.element), name(&g, b.element)), ("left.x_max", "right.x_min"));
    assert_eq!(a.plane, b.plane);
    let through = g.closest(a.point, DVec3::X, f64::INFINITY, Skip::passed(&a)).expect("closed");
    assert_eq!(name(&g, through.element), "right.x_max");
    let hits = g.segment(v(1.0, 2.0, 1.0), v(7.0, 2.0, 1.0), Skip::NONE, Skip::NONE);
    assert_eq!(hits.iter().map(|h| name(&g, h.element)).collect::<Vec<_>>(), ["left.x_max"]);
}

#[test]
fn an_opening_in_one_of_two_touching_faces_goes_through_both() {
    let mut scene = empty();
    scene.boxes.push(room("left", v(0.0, 0.0, 0.0), v(4.0, 5.0, 3.0)));
    scene.boxes.push(room("right", v(4.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    let frame = diffray::geometry::face_frame(&scene.boxes[0], diffray::scene::Face::XMax);
    scene.walls.push(upright("unused", [20.0, 0.0], [20.0, 5.0], [0.0, 3.0]));
    let mut opening = hole(&scene, 0, [1.0, 2.0], [0.5, 2.0]);
    scene.walls.clear();
    opening.host = diffray::scene::Host::BoxFace(0, diffray::scene::Face::XMax);
    opening.frame = frame;
    scene.openings.push(opening);
    let g = build(&scene);
    let middle = frame.point(1.5, 1.0);
    for (x, d) in [(1.0, DVec3::X), (7.0, DVec3::NEG_X)] {
        let hit = first(&g, v(x, middle.y, middle.z), d).expect("closed");
        assert_eq!(hit.element, Element::Portal(0));
        let beyond = g.closest(hit.point, d, f64::INFINITY, Skip::passed(&hit)).expect("closed");
        assert!((beyond.t - 4.0).abs() < EXACT_M);
    }
    for s in g.surfaces.iter().filter(|s| s.name.ends_with("left.x_max") || s.name.ends_with("right.x_min")) {
        assert!((s.area_m2 - 13.5).abs() < 1e-12);
    }
}

#[test]
fn a_wall_on_a_box_face_replaces_that_part_of_it() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    let mut curtain = upright("curtain", [8.0, 1.0], [8.0, 3.0], [0.0, 2.0]);
    curtain.material = 1;
    scene.walls.push(curtain);
    let g = build(&scene);
    let face = g.surfaces.iter().find(|s| s.name == "hall.x_max").expect("it is there");
    assert!((face.area_m2 - 11.0).abs() < 1e-12);
    assert_eq!(name(&g, first(&g, v(1.0, 2.0, 1.0), DVec3::X).expect("closed").element), "curtain");
    assert_eq!(name(&g, first(&g, v(1.0, 4.0, 1.0), DVec3::X).expect("closed").element), "hall.x_max");
}

#[test]
fn an_unbounded_wall_has_no_border_and_its_slit_no_ends() {
    let mut scene = empty();
    let mut screen = upright("screen", [0.0, -1.0], [0.0, 1.0], [0.0, 1.0]);
    screen.unbounded = true;
    scene.walls.push(screen);
    // local x runs along y from y = -1
    scene.openings.push(door(&scene, 0, [1.0, 1.5], [f64::NEG_INFINITY, f64::INFINITY], 0.25));
    let g = build(&scene);
    let at = |y: f64, z: f64| first(&g, v(-2.0, y, z), DVec3::X).expect("unbounded");
    for z in [-1e6, 0.5, 1e7] {
        assert_eq!(name(&g, at(-1e6, z).element), "screen");
        assert_eq!(at(0.1, z).element, Element::Portal(0));
        assert_eq!(name(&g, at(0.4, z).element), "door leaf");
        assert!((at(0.1, z).t - 2.0).abs() < EXACT_M);
    }
    assert!(g.surfaces[0].area_m2.is_infinite());
    let half_plane = {
        let mut scene = scene.clone();
        scene.openings = vec![hole(&scene, 0, [f64::NEG_INFINITY, 1.0], [f64::NEG_INFINITY, f64::INFINITY])];
        build(&scene)
    };
    // What a half-plane leaves open is a plain hole; its border is an edge.
    assert!(first(&half_plane, v(-2.0, -1e9, 3.0), DVec3::X).is_none() && half_plane.portals.is_empty());
    let [edge] = &half_plane.edges[..] else { panic!("one edge: {:?}", half_plane.edges) };
    assert!(edge.face_a.y == 1.0 && edge.start.y.abs() < EXACT_M && edge.exterior_angle == std::f64::consts::TAU);
    assert_eq!(name(&half_plane, first(&half_plane, v(-2.0, 1e9, 3.0), DVec3::X).expect("screen").element), "screen");
    assert!(!half_plane.blocked(v(-1.0, -5.0, 0.0), v(1.0, -5.0, 0.0), Skip::NONE, Skip::NONE));
    assert_eq!(half_plane.segment(v(-1.0, 5.0, 0.0), v(1.0, 5.0, 0.0), Skip::NONE, Skip::NONE).len(), 1);
}

#[test]
fn a_thick_screen_has_its_portal_on_both_faces() {
    let mut scene = empty();
    let mut screen = upright("screen", [0.0, 0.0], [0.0, 1.0], [0.0, 1.0]);
    (screen.unbounded, screen.thickness_m) = (true, 0.3);
    scene.walls.push(screen);
    scene.openings.push(hole(&scene, 0, [0.0, 0.5], [f64::NEG_INFINITY, f64::INFINITY]));
    let g = build(&scene);
    for (x, d) in [(-2.0, DVec3::X), (2.0, DVec3::NEG_X)] {
        let portal = first(&g, v(x, 0.2, 9.0), d).expect("slit");
        assert_eq!(portal.element, Element::Portal(0));
        assert!((portal.t - 1.85).abs() < EXACT_M);
        assert!(g.closest(portal.point, d, f64::INFINITY, Skip::passed(&portal)).is_none());
        assert_eq!(name(&g, first(&g, v(x, 0.7, 9.0), d).expect("screen").element), "screen");
    }
}

#[test]
fn the_element_at_a_point_of_a_plane_is_what_a_ray_meets_there() {
    let mut touching = partitioned(0.2, 0.3);
    touching.boxes.push(room("next", v(8.0, 0.0, 0.0), v(12.0, 5.0, 3.0)));
    let mut screens = empty();
    let mut screen = upright("screen", [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]);
    screen.unbounded = true;
    screens.walls.push(screen);
    screens.openings.push(door(&screens, 0, [0.5, 2.5], [0.0, 2.0], 1.0));
    let mut n = Numbers(3);
    for scene in [touching, screens] {
        let g = build(&scene);
        for _ in 0..5_000 {
            let (origin, d) = (n.within(v(0.1, 0.1, 0.1), v(11.9, 4.9, 2.9)), n.direction());
            if let Some(hit) = first(&g, origin, d) {
                assert_eq!(g.element_at(hit.plane, hit.point, d), Some(hit.element), "{origin} {d}");
            }
        }
    }
    let mut plain = partitioned(0.0, 0.3);
    plain.simulation.transport = Transport::Geometric;
    let g = build(&plain);
    let plane = g.surfaces.iter().find(|s| s.name == "partition").expect("it is there").plane;
    assert_eq!(g.element_at(plane, v(4.0, 1.1, 1.0), DVec3::X), None, "a plain hole");
    assert_eq!(g.element_at(plane, v(4.0, 9.0, 1.0), DVec3::X), None, "beyond the wall");
}

#[test]
fn crossing_sides_of_a_wall_are_an_error_and_an_empty_scene_is_none() {
    let mut scene = empty();
    let g = build(&scene);
    assert!(first(&g, DVec3::ZERO, DVec3::X).is_none());
    assert!(!g.blocked(DVec3::ZERO, DVec3::X, Skip::NONE, Skip::NONE));
    assert!(g.closest_surface_distance(DVec3::ZERO).is_infinite());
    for odd in [DVec3::NAN, DVec3::INFINITY, DVec3::ZERO] {
        let room = build(&partitioned(0.0, 0.3));
        let _ = room.closest(odd, DVec3::X, f64::INFINITY, Skip::NONE);
        assert!(room.closest(v(1.0, 1.0, 1.0), odd, f64::INFINITY, Skip::NONE).is_none());
        assert!(!room.blocked(odd, odd, Skip::NONE, Skip::NONE));
    }
    scene.walls.push(wall("bow", &[[0.0, 0.0, 0.0], [2.0, 2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    assert!(Geometry::new(&scene).is_err());
}
