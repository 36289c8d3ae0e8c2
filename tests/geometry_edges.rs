//! Which edges of a scene diffract.

mod geometry_scenes;

use std::f64::consts::{PI, TAU};

use diffray::geometry::{Edge, Geometry};
use diffray::scene::{Directivity, Edges, Host, Probe, ProbeFormat, Scene, Source, SourceKind, Transport};
use geometry_scenes::*;
use glam::DVec3;

const WEDGE: f64 = 1.5 * PI;

fn with_source(mut scene: Scene, position_m: DVec3) -> Scene {
    let directivity = Directivity { omni_share: 1.0, axis: DVec3::X };
    scene.sources.push(Source { name: "s".into(), position_m, kind: SourceKind::Point, power_db: None, directivity });
    scene
}

fn edges(scene: &Scene) -> Vec<Edge> {
    let edges = Geometry::new(scene).expect("the scene is valid").edges;
    for e in &edges {
        assert!((e.face_a.cross(e.normal_a) - e.direction).length() < 1e-9, "right-handed: {e:?}");
        assert!((e.direction.length() - 1.0).abs() < 1e-12);
        assert!(e.exterior_angle > PI && e.exterior_angle <= TAU);
    }
    edges
}

fn ground(scene: &mut Scene) {
    let mut ground = wall("ground", &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    ground.unbounded = true;
    scene.walls.push(ground);
}

/// Counts the edges of this exterior angle, and their length together.
fn count(edges: &[Edge], exterior_angle: f64) -> (usize, f64) {
    let of_angle = edges.iter().filter(|e| (e.exterior_angle - exterior_angle).abs() < 1e-6);
    of_angle.fold((0, 0.0), |(n, sum), e| (n + 1, sum + e.length_m))
}

#[test]
fn a_barrier_on_the_ground_has_a_free_top_and_two_free_sides() {
    let mut scene = empty();
    ground(&mut scene);
    scene.walls.push(upright("barrier", [0.0, -4.0], [0.0, 6.0], [0.0, 3.0]));
    let found = edges(&with_source(scene, v(-5.0, 0.0, 1.0)));
    assert_eq!(found.len(), 3, "{found:?}");
    let (n, length) = count(&found, TAU);
    assert_eq!(n, 3);
    assert!((length - 16.0).abs() < 1e-9);
    for e in &found {
        assert_eq!(e.groups[0], e.groups[1]);
        assert_eq!(e.planes[0], e.planes[1]);
        assert!(e.name.starts_with("barrier edge"), "{}", e.name);
        // face A runs from the edge into the barrier
        assert!((v(0.0, 1.0, 1.5) - e.point(0.5 * e.length_m)).dot(e.face_a) > 0.0);
    }
    let top = found.iter().find(|e| e.direction.y.abs() > 0.5).expect("one edge runs along y");
    assert!((top.start.z - 3.0).abs() < 1e-12 && (top.length_m - 10.0).abs() < 1e-9);
}

#[test]
fn angles_about_an_edge_start_at_face_a_and_run_through_the_air() {
    let mut scene = empty();
    scene.walls.push(upright("barrier", [0.0, -4.0], [0.0, 6.0], [0.0, 3.0]));
    for e in edges(&scene) {
        assert!(e.angle(e.start + e.face_a) < 1e-12);
        assert!((e.angle(e.start + e.normal_a) - 0.5 * PI).abs() < 1e-12);
        assert!((e.angle(e.start - e.face_a) - PI).abs() < 1e-12);
    }
}

#[test]
fn an_l_shaped_corridor_has_one_edge_of_270_degrees_from_floor_to_ceiling() {
    let found = edges(&with_source(l_corridor(), v(1.0, 5.0, 1.5)));
    assert_eq!(found.len(), 1, "{found:?}");
    let e = &found[0];
    assert!((e.exterior_angle - WEDGE).abs() < 1e-9);
    assert!((e.length_m - 3.0).abs() < 1e-9);
    assert!((e.start.x - 2.0).abs() < 1e-12 && (e.start.y - 2.0).abs() < 1e-12);
    assert_ne!(e.groups[0], e.groups[1]);
    // both legs of the corridor lie in the sector of air, the solid corner does not
    for (p, inside) in
        [(v(1.0, 5.0, 1.0), true), (v(5.0, 1.0, 1.0), true), (v(1.0, 1.0, 1.0), true), (v(3.0, 3.0, 1.0), false)]
    {
        let angle = e.angle(p);
        assert_eq!(angle > 0.0 && angle < e.exterior_angle, inside, "{p}: {angle}");
    }
    // from outside the same walls show their five outer corners and the borders of floor and ceiling
    let outside = edges(&with_source(l_corridor(), v(-5.0, 1.0, 1.0)));
    assert_eq!(count(&outside, WEDGE).0, 5 + 12);
    assert_eq!(outside.len(), 17);
}

#[test]
fn a_thick_barrier_has_wedges_of_270_degrees_where_it_does_not_touch_the_ground() {
    let mut scene = empty();
    let mut barrier = upright("barrier", [0.0, -4.0], [0.0, 6.0], [0.0, 3.0]);
    barrier.thickness_m = 0.2;
    scene.walls.push(barrier);
    let free = edges(&with_source(scene.clone(), v(-5.0, 0.0, 1.0)));
    assert_eq!((free.len(), count(&free, WEDGE).0), (12, 12));
    assert!((count(&free, WEDGE).1 - 4.0 * (10.0 + 3.0 + 0.2)).abs() < 1e-9);
    ground(&mut scene);
    let standing = edges(&with_source(scene, v(-5.0, 0.0, 1.0)));
    assert_eq!((standing.len(), count(&standing, WEDGE).0), (8, 8));
    assert!((count(&standing, WEDGE).1 - 2.0 * (10.0 + 0.2) - 4.0 * 3.0).abs() < 1e-9);
}

#[test]
fn a_closed_box_has_none_and_a_box_with_a_door_in_a_full_partition_has_none() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    assert!(edges(&scene).is_empty());
    assert!(edges(&with_source(scene, v(1.0, 1.0, 1.0))).is_empty());
    for thickness_m in [0.0, 0.1] {
        let found = edges(&with_source(partitioned(thickness_m, 0.3), v(1.0, 1.0, 1.0)));
        assert!(found.is_empty(), "{found:?}");
    }
}

#[test]
fn a_partition_is_free_only_where_it_touches_nothing() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    scene.walls.push(upright("screen", [4.0, 0.0], [4.0, 3.5], [0.0, 2.0]));
    let found = edges(&with_source(scene, v(1.0, 1.0, 1.0)));
    assert_eq!(count(&found, TAU).0, 2);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!((count(&found, TAU).1 - 5.5).abs() < 1e-9);
}

#[test]
fn an_edge_that_abuts_in_part_is_free_in_the_rest() {
    // the barrier's end stands against a cabinet wall that is half as high
    let mut scene = empty();
    ground(&mut scene);
    scene.walls.push(upright("barrier", [0.0, 0.0], [0.0, 6.0], [0.0, 3.0]));
    scene.walls.push(upright("cabinet", [-2.0, 0.0], [2.0, 0.0], [0.0, 1.25]));
    let found = edges(&with_source(scene, v(-5.0, 0.5, 1.0)));
    let upper = found.iter().find(|e| e.direction.z.abs() > 0.5 && e.start.y.abs() < 1e-9 && e.start.x.abs() < 1e-9);
    let upper = upper.expect("the upper part is free");
    assert!((upper.length_m - 1.75).abs() < 1e-9);
    // barrier: top, far side, upper near side; cabinet: top (one, though the barrier divides it), two sides. Where the
    // barrier passes the cabinet's top, three half-planes of 90 degrees leave no wedge but at a point
    assert_eq!(found.len(), 6, "{found:?}");
    let cabinet = found.iter().filter(|e| e.name.starts_with("cabinet edge")).map(|e| e.length_m).sum::<f64>();
    assert!((cabinet - 6.5).abs() < 1e-9);
}

#[test]
fn three_thin_walls_meeting_have_a_wedge_only_in_a_sector_above_180_degrees() {
    let mut tee = empty();
    tee.walls.push(upright("left", [-3.0, 0.0], [0.0, 0.0], [0.0, 2.0]));
    tee.walls.push(upright("right", [0.0, 0.0], [3.0, 0.0], [0.0, 2.0]));
    tee.walls.push(upright("stem", [0.0, 0.0], [0.0, 3.0], [0.0, 2.0]));
    let at_joint = |scene: &Scene| -> Vec<f64> {
        let mut found = edges(scene);
        found.retain(|e| e.direction.z.abs() > 0.5 && e.start.truncate().length() < 1e-9);
        found.iter().map(|e| e.exterior_angle).collect()
    };
    assert!(at_joint(&tee).is_empty());
    // bend the right arm towards the stem: 225 degrees remain below
    let mut bent = tee.clone();
    bent.walls[1] = upright("right", [0.0, 0.0], [2.0, 2.0], [0.0, 2.0]);
    let angles = at_joint(&bent);
    assert_eq!(angles.len(), 1);
    assert!((angles[0] - 1.25 * PI).abs() < 1e-9);
}

#[test]
fn two_walls_that_share_an_edge_form_one_wedge_from_either_side() {
    let mut scene = empty();
    scene.walls.push(upright("a", [0.0, 0.0], [4.0, 0.0], [0.0, 2.0]));
    scene.walls.push(upright("b", [0.0, 0.0], [0.0, 4.0], [0.0, 3.0]));
    let found = edges(&scene);
    let joint: Vec<&Edge> =
        found.iter().filter(|e| e.direction.z.abs() > 0.5 && e.start.truncate().length() < 1e-9).collect();
    assert_eq!(joint.len(), 2, "the shared part and the free rest of the higher wall: {joint:?}");
    let wedge = joint.iter().find(|e| (e.exterior_angle - WEDGE).abs() < 1e-9).expect("shared part");
    let free = joint.iter().find(|e| (e.exterior_angle - TAU).abs() < 1e-9).expect("free part");
    assert!((wedge.length_m - 2.0).abs() < 1e-9 && (free.length_m - 1.0).abs() < 1e-9);
    assert_eq!(wedge.name, "a / b");
}

#[test]
fn a_mesh_cube_seen_from_outside_has_twelve_edges_of_270_degrees_and_none_from_inside() {
    let mut scene = empty();
    scene.meshes.push(cuboid(v(0.0, 0.0, 0.0), v(1.0, 2.0, 3.0)));
    let outside = edges(&with_source(scene.clone(), v(5.0, 5.0, 5.0)));
    assert_eq!((outside.len(), count(&outside, WEDGE).0), (12, 12));
    assert!((count(&outside, WEDGE).1 - 24.0).abs() < 1e-9);
    assert!(edges(&with_source(scene.clone(), v(0.5, 0.5, 0.5))).is_empty());
    assert_eq!(edges(&scene).len(), 12, "without a source both sides count");
}

#[test]
fn a_mesh_cube_standing_on_an_unrelated_floor_loses_its_lower_edges() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(-5.0, -5.0, 0.0), v(5.0, 5.0, 6.0)));
    scene.meshes.push(cuboid(v(0.0, 0.0, 0.0), v(1.0, 2.0, 3.0)));
    let found = edges(&with_source(scene, v(3.0, 3.0, 3.0)));
    assert_eq!((found.len(), count(&found, WEDGE).0), (8, 8));
    // the same with the floor in the mesh, sharing no corners
    let mut scene = empty();
    let mut mesh = cuboid(v(-5.0, -5.0, 0.0), v(5.0, 5.0, 6.0));
    mesh.triangles_m.extend(cuboid(v(0.0, 0.0, 0.0), v(1.0, 2.0, 3.0)).triangles_m);
    mesh.materials = vec![0; mesh.triangles_m.len()];
    scene.meshes.push(mesh);
    let found = edges(&with_source(scene, v(3.0, 3.0, 3.0)));
    assert_eq!((found.len(), count(&found, WEDGE).0), (8, 8), "{found:?}");
}

#[test]
fn a_finely_divided_cube_has_the_same_twelve_edges() {
    let mut mesh = cuboid(v(0.0, 0.0, 0.0), v(1.0, 1.0, 1.0));
    for _ in 0..4 {
        mesh.triangles_m = mesh
            .triangles_m
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = ((a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    mesh.materials = vec![0; mesh.triangles_m.len()];
    let mut scene = empty();
    scene.meshes.push(mesh);
    let found = edges(&with_source(scene, v(5.0, 5.0, 5.0)));
    assert_eq!((found.len(), count(&found, WEDGE).0), (12, 12));
    assert!((count(&found, WEDGE).1 - 12.0).abs() < 1e-9);
}

#[test]
fn a_smooth_mesh_has_no_edges_and_a_coarse_one_has_all_of_its_own() {
    let mut scene = empty();
    scene.meshes.push(ellipsoid(4, v(1.0, 1.0, 1.0), DVec3::ZERO));
    assert!(edges(&with_source(scene.clone(), v(3.0, 0.0, 0.0))).is_empty(), "4 degrees between neighbours");
    scene.meshes[0] = ellipsoid(0, v(1.0, 1.0, 1.0), DVec3::ZERO);
    let found = edges(&with_source(scene, v(3.0, 0.0, 0.0)));
    assert_eq!(found.len(), 30);
    // dihedral angle of the icosahedron: arccos(-sqrt(5)/3)
    let expected = TAU - (-5.0_f64.sqrt() / 3.0).acos();
    assert!(found.iter().all(|e| (e.exterior_angle - expected).abs() < 1e-9));
}

#[test]
fn the_mouth_of_an_open_box_is_made_of_four_free_edges() {
    let mut scene = empty();
    let mut tunnel = room("tunnel", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0));
    tunnel.faces[diffray::scene::Face::XMax as usize] = None;
    scene.boxes.push(tunnel);
    let mut scene = with_source(scene, v(1.0, 1.0, 1.0));
    scene.probes.push(Probe { name: "p".into(), position_m: v(12.0, 1.0, 1.0), format: ProbeFormat::Omni });
    let found = edges(&scene);
    assert_eq!((found.len(), count(&found, TAU).0), (4, 4));
    assert!((count(&found, TAU).1 - 16.0).abs() < 1e-9);
}

#[test]
fn two_boxes_joined_by_a_thick_wall_have_no_edges() {
    let mut scene = empty();
    scene.boxes.push(room("left", v(0.0, 0.0, 0.0), v(3.9, 5.0, 3.0)));
    scene.boxes.push(room("right", v(4.1, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    scene.boxes[0].faces[diffray::scene::Face::XMax as usize] = None;
    scene.boxes[1].faces[diffray::scene::Face::XMin as usize] = None;
    let mut partition = upright("partition", [4.0, 0.0], [4.0, 5.0], [0.0, 3.0]);
    partition.thickness_m = 0.2;
    scene.walls.push(partition);
    let opening = door(&scene, 0, [1.0, 2.2], [0.0, 2.1], 0.3);
    scene.openings.push(opening);
    let found = edges(&with_source(scene, v(1.0, 1.0, 1.0)));
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn openings_have_no_edges_of_their_own_and_the_options_turn_edges_off() {
    let mut scene = partitioned(0.0, 0.3);
    scene.walls[0] = upright("partition", [4.0, 0.0], [4.0, 4.0], [0.0, 3.0]);
    scene.openings[0].host = Host::Wall(0);
    scene.openings[0].frame = scene.walls[0].frame;
    let scene = with_source(scene, v(1.0, 1.0, 1.0));
    assert_eq!(edges(&scene).len(), 1, "the free side only, not the jambs");
    for option in [Edges::Openings, Edges::Off] {
        let mut scene = scene.clone();
        scene.simulation.edges = option;
        assert!(edges(&scene).is_empty());
    }
    let mut geometric = scene;
    geometric.simulation.transport = Transport::Geometric;
    assert!(edges(&geometric).is_empty());
}

#[test]
fn a_closed_shell_shows_its_inner_edges_inside_and_its_outer_edges_outside() {
    // the coarse ellipsoid pushed in at every other corner: wedges on both sides; large, so that no face is a fine one
    let mut scene = empty();
    let mut mesh = ellipsoid(1, v(1.0, 1.0, 1.0), DVec3::ZERO);
    for p in mesh.triangles_m.iter_mut().flatten() {
        if (p.x * 1e3).round() as i64 % 2 == 0 {
            *p *= 0.7;
        }
        *p *= 4.0;
    }
    scene.meshes.push(mesh);
    let both = edges(&scene);
    let inner = edges(&with_source(scene.clone(), v(0.2, 0.08, 0.04)));
    let outer = edges(&with_source(scene, v(12.0, 0.4, 0.8)));
    assert!(!inner.is_empty() && !outer.is_empty());
    assert_eq!(inner.len() + outer.len(), both.len(), "every edge has air on one side only");
    assert!(inner.iter().all(|e| !outer.contains(e)));
}

#[test]
fn edges_move_with_the_scene() {
    let scene = with_source(l_corridor(), v(1.0, 5.0, 1.5));
    let by = v(1e4, -2e4, 500.0);
    let mut far = moved(scene.clone(), by);
    far.sources[0].position_m += by;
    let (near, far) = (edges(&scene), edges(&far));
    assert_eq!(near.len(), far.len());
    // coordinates of 2e4 m are known to 4e-12 m
    assert!((far[0].start - by - near[0].start).length() < 1e-10);
}

#[test]
fn edges_between_small_faces_of_a_mesh_are_left_to_scattering() {
    let mut fine = empty();
    fine.meshes.push(ellipsoid(1, v(0.5, 0.5, 0.5), DVec3::ZERO));
    let fine = Geometry::new(&with_source(fine, v(3.0, 0.1, 0.2))).unwrap();
    let mut coarse = empty();
    coarse.meshes.push(ellipsoid(1, v(4.0, 4.0, 4.0), DVec3::ZERO));
    let coarse = Geometry::new(&with_source(coarse, v(9.0, 0.1, 0.2))).unwrap();
    assert!(fine.edges.is_empty() && fine.fine_edges > 0, "{} {}", fine.edges.len(), fine.fine_edges);
    assert_eq!((coarse.edges.len(), coarse.fine_edges), (fine.fine_edges, 0));
}
