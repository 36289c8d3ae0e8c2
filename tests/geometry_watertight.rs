//! No ray leaves a closed room, least of all one aimed exactly at an edge, corner or diagonal; and every distance
//! equals that of a plain f64 loop over triangles.

mod geometry_scenes;

use diffray::geometry::{Geometry, Hit, Skip};
use diffray::scene::Scene;
use geometry_scenes::*;
use glam::DVec3;

/// Rays aimed at boundaries, one room, one place.
const AIMED_RAYS: usize = 80_000;

/// A closed room, the points rays start from, and segments on its boundary to aim at.
struct Case {
    scene: Scene,
    inside: fn(&mut Numbers) -> DVec3,
    targets: Vec<[DVec3; 2]>,
}

fn pairs(corners: &[DVec3]) -> Vec<[DVec3; 2]> {
    corners.iter().enumerate().flat_map(|(i, a)| corners[i + 1..].iter().map(move |b| [*a, *b])).collect()
}

fn box_corners(min: DVec3, max: DVec3) -> Vec<DVec3> {
    (0..8).map(|i| DVec3::select(glam::BVec3::new(i & 1 == 1, i & 2 == 2, i & 4 == 4), max, min)).collect()
}

fn shoebox() -> Case {
    let mut scene = empty();
    let (min, max) = (v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0));
    scene.boxes.push(room("hall", min, max));
    let inside = |n: &mut Numbers| n.within(v(0.1, 0.1, 0.1), v(7.9, 4.9, 2.9));
    Case { scene, inside, targets: pairs(&box_corners(min, max)) }
}

fn l_prism() -> Case {
    let scene = l_corridor();
    let mut corners: Vec<DVec3> = scene.walls.iter().flat_map(|w| w.corners_m.clone()).collect();
    corners.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).expect("finite"));
    corners.dedup();
    let inside = |n: &mut Numbers| {
        let p = n.within(v(0.1, 0.1, 0.1), v(5.9, 1.9, 2.9));
        if n.unit() < 0.5 { p } else { v(p.y, p.x, p.z) }
    };
    Case { scene, inside, targets: pairs(&corners) }
}

fn door_in_a_box() -> Case {
    let scene = partitioned(0.0, 0.7);
    let mut corners = box_corners(v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0));
    let wall = &scene.walls[0];
    corners.extend(&wall.corners_m);
    for x in [1.0, 1.7, 2.2] {
        corners.extend([wall.frame.point(x, 0.0), wall.frame.point(x, 2.1), wall.frame.point(x, 3.0)]);
    }
    let inside = |n: &mut Numbers| n.within(v(0.1, 0.1, 0.1), v(7.9, 4.9, 2.9));
    Case { scene, inside, targets: pairs(&corners) }
}

fn round_room() -> Case {
    let mut scene = empty();
    scene.meshes.push(ellipsoid(3, v(5.0, 4.0, 3.0), DVec3::ZERO));
    let targets = scene.meshes[0].triangles_m.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
    let inside = |n: &mut Numbers| n.within(v(-2.0, -2.0, -1.5), v(2.0, 2.0, 1.5));
    Case { scene, inside, targets }
}

/// How far along its segment a ray aims: the ends, the middle and anywhere.
fn place(n: &mut Numbers) -> f64 {
    match (n.unit() * 8.0) as usize {
        0 => 0.0,
        1 => 1.0,
        2 => 0.5,
        _ => n.unit(),
    }
}

/// Aims at the boundary of `case`, moved by `shift` and scaled; answers how many rays were tested.
fn aim(case: &Case, shift: DVec3, seed: u64) -> usize {
    let scene = moved(case.scene.clone(), shift);
    let g = Geometry::new(&scene).expect("the room is valid");
    // of all segments between corners those that lie on the boundary
    let on_boundary = |s: &&[DVec3; 2]| {
        [0.25, 0.5, 0.77].iter().all(|&f| {
            let p = s[0].lerp(s[1], f) + shift;
            g.closest_surface_distance(p) < 1e-9 * (1.0 + shift.length())
        })
    };
    let targets: Vec<&[DVec3; 2]> = case.targets.iter().filter(on_boundary).collect();
    assert!(targets.len() >= 24);
    let mut n = Numbers(seed);
    for _ in 0..AIMED_RAYS {
        let target = targets[(n.unit() * targets.len() as f64) as usize];
        let goal = target[0].lerp(target[1], place(&mut n)) + shift;
        let origin = (case.inside)(&mut n) + shift;
        let length = (goal - origin).length();
        let hit = first(&g, origin, (goal - origin) / length);
        let limit = length + 1e-9 * (1.0 + length) + 1e-9 * shift.length();
        assert!(hit.is_some_and(|h| h.t <= limit), "escaped from {origin} towards {goal}: {hit:?}");
    }
    AIMED_RAYS
}

#[test]
fn no_ray_aimed_at_an_edge_corner_or_diagonal_escapes() {
    let mut tested = 0;
    for (i, case) in [shoebox(), l_prism(), door_in_a_box(), round_room()].iter().enumerate() {
        tested += aim(case, DVec3::ZERO, i as u64);
        tested += aim(case, v(1e4, -1e4, 1e4 / 3.0), 10 + i as u64);
    }
    assert!(tested >= 500_000);
}

#[test]
fn no_ray_escapes_from_a_room_of_one_kilometre() {
    let mut scene = empty();
    let (min, max) = (v(-500.0, -500.0, 0.0), v(500.0, 500.0, 1000.0 / 3.0));
    scene.boxes.push(room("hangar", min, max));
    let inside = |n: &mut Numbers| n.within(v(-499.0, -499.0, 1.0), v(499.0, 499.0, 333.0));
    aim(&Case { scene, inside, targets: pairs(&box_corners(min, max)) }, DVec3::ZERO, 3);
    let mut dome = empty();
    dome.meshes.push(ellipsoid(4, v(500.0, 400.0, 300.0), DVec3::ZERO));
    let targets = dome.meshes[0].triangles_m.iter().map(|t| [t[0], t[1]]).collect();
    let inside = |n: &mut Numbers| n.within(v(-200.0, -200.0, -150.0), v(200.0, 200.0, 150.0));
    aim(&Case { scene: dome, inside, targets }, DVec3::ZERO, 4);
}

#[test]
fn rays_parallel_to_the_axes_and_negative_zeros_do_not_escape() {
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let with_zero = |d: DVec3, zero: f64| DVec3::from_array(d.to_array().map(|c| if c == 0.0 { zero } else { c }));
    let mut n = Numbers(5);
    for (i, case) in [shoebox(), l_prism(), door_in_a_box(), round_room()].iter().enumerate() {
        let g = Geometry::new(&case.scene).expect("the room is valid");
        let check = |origin: DVec3, d: DVec3| {
            let plus = first(&g, origin, with_zero(d, 0.0));
            let minus = first(&g, origin, with_zero(d, -0.0));
            assert!(plus.is_some_and(|h| h.t < 20.0), "room {i}: escaped from {origin} along {d}: {plus:?}");
            assert_eq!(plus.map(|h| h.t), minus.map(|h| h.t));
        };
        for _ in 0..5_000 {
            let start = (case.inside)(&mut n);
            axes.iter().for_each(|d| check(start, *d));
            // from a point exactly in line with a corner or a point of an edge: the ray ends on it, or runs along the
            // boundary
            let target = case.targets[(n.unit() * case.targets.len() as f64) as usize];
            let goal = target[0].lerp(target[1], place(&mut n));
            let prism = i == 1; // the L keeps its cross-section only along z
            for axis in if prism { 2..3 } else { 0..3 } {
                let mut origin = goal;
                origin[axis] = if i == 3 { 0.5 * goal[axis] } else { start[axis] };
                if g.closest_surface_distance(goal) < 1e-9 {
                    check(origin, axes[2 * axis]);
                    check(origin, axes[2 * axis + 1]);
                }
            }
        }
    }
    let case = door_in_a_box();
    let g = Geometry::new(&case.scene).expect("the room is valid");
    for y in [1.0, 1.7, 2.2] {
        for z in [1e-3, 1.0, 2.1] {
            let hit = first(&g, v(1.0, y, z), v(1.0, -0.0, 0.0)).expect("closed");
            assert!((hit.t - 3.0).abs() < 1e-12, "a ray along the jamb at y = {y} meets the partition");
        }
    }
}

#[test]
fn a_ray_that_all_but_grazes_a_wall_meets_the_far_wall() {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(30.0, 20.0, 8.0)));
    scene.meshes.push(ellipsoid(2, v(0.5, 0.5, 0.5), v(15.0, 10.0, 4.0))); // enough facets for the tree
    let g = Geometry::new(&scene).expect("the room is valid");
    for height in [1e-3, 1e-6, 1e-9] {
        for slope in [0.0, -1e-8, 1e-8, -1e-5, 1e-12] {
            let d = v(1.0, 0.0, slope).normalize();
            let hit = first(&g, v(1e-3, 1.0, height), d).expect("closed");
            let to_floor = if slope < 0.0 { height / -slope } else { f64::INFINITY };
            let expected = to_floor.min(30.0 - 1e-3);
            assert!((hit.t - expected).abs() < 1e-6 * expected, "{height} {slope}: {} {expected}", hit.t);
        }
    }
    // a wall very near the origin is not missed either
    let near = g.closest(v(30.0 - 5e-8, 1.0, 1.0), DVec3::X, f64::INFINITY, Skip::NONE).expect("closed");
    assert!((near.t - 5e-8).abs() < 1e-13);
}

#[test]
fn mirror_reflections_stay_inside_for_a_hundred_bounces() {
    let mut n = Numbers(9);
    for case in [shoebox(), door_in_a_box(), round_room()] {
        let mut scene = case.scene.clone();
        scene.openings.clear();
        let g = Geometry::new(&scene).expect("the room is valid");
        for _ in 0..2_000 {
            let (mut p, mut d, mut skip) = ((case.inside)(&mut n), n.direction(), Skip::NONE);
            for bounce in 0..100 {
                let hit = g.closest(p, d, f64::INFINITY, skip);
                let Some(hit) = hit else { panic!("lost after {bounce} bounces at {p} towards {d}") };
                let normal = g.planes()[hit.plane].normal;
                d -= normal * (2.0 * d.dot(normal));
                (p, skip) = (hit.point, Skip::reflected(&hit));
            }
        }
    }
}

/// Moller and Trumbore's test in f64, borders included.
fn meet(t: &[DVec3; 3], origin: DVec3, d: DVec3) -> Option<f64> {
    let (e1, e2) = (t[1] - t[0], t[2] - t[0]);
    let p = d.cross(e2);
    let det = e1.dot(p);
    let s = (origin - t[0]) / det;
    let u = s.dot(p);
    let q = s.cross(e1);
    let w = d.dot(q);
    let distance = e2.dot(q);
    (u >= 0.0 && w >= 0.0 && u + w <= 1.0 && distance > 0.0).then_some(distance)
}

fn rectangle(corner: DVec3, u: DVec3, w: DVec3) -> [[DVec3; 3]; 2] {
    [[corner, corner + u, corner + u + w], [corner, corner + u + w, corner + w]]
}

/// The same rooms as plain triangles, put together by hand.
fn oracle_triangles() -> Vec<(Case, Vec<[DVec3; 3]>)> {
    let hall = cuboid(v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)).triangles_m;
    let mut with_door = hall.clone(); // the portal and the leaf close the hole: the partition is whole
    with_door.extend(rectangle(v(4.0, 0.0, 0.0), v(0.0, 5.0, 0.0), v(0.0, 0.0, 3.0)));
    let mut with_hole = hall.clone();
    for [y, z, width, height] in [[0.0, 0.0, 1.0, 3.0], [1.7, 0.0, 3.3, 3.0], [1.0, 2.1, 0.7, 0.9]] {
        with_hole.extend(rectangle(v(4.0, y, z), v(0.0, width, 0.0), v(0.0, 0.0, height)));
    }
    let hole = {
        let mut case = door_in_a_box();
        case.scene.simulation.transport = diffray::scene::Transport::Geometric;
        case
    };
    let mut l = Vec::new();
    let ring = [[0.0, 0.0], [6.0, 0.0], [6.0, 2.0], [2.0, 2.0], [2.0, 6.0], [0.0, 6.0]];
    for (i, a) in ring.iter().enumerate() {
        let b = ring[(i + 1) % 6];
        l.extend(rectangle(v(a[0], a[1], 0.0), v(b[0] - a[0], b[1] - a[1], 0.0), v(0.0, 0.0, 3.0)));
    }
    for z in [0.0, 3.0] {
        l.extend(rectangle(v(0.0, 0.0, z), v(6.0, 0.0, 0.0), v(0.0, 2.0, 0.0)));
        l.extend(rectangle(v(0.0, 2.0, z), v(2.0, 0.0, 0.0), v(0.0, 4.0, 0.0)));
    }
    let round = round_room();
    let sphere = round.scene.meshes[0].triangles_m.clone();
    vec![(shoebox(), hall), (door_in_a_box(), with_door), (hole, with_hole), (l_prism(), l), (round, sphere)]
}

#[test]
fn random_rays_are_as_long_as_a_plain_loop_over_triangles_says() {
    let mut n = Numbers(11);
    for (i, (case, triangles)) in oracle_triangles().into_iter().enumerate() {
        let g = Geometry::new(&case.scene).expect("the room is valid");
        for _ in 0..10_000 {
            let (origin, d) = ((case.inside)(&mut n), n.direction());
            let expected = triangles.iter().filter_map(|t| meet(t, origin, d)).fold(f64::INFINITY, f64::min);
            let t = first(&g, origin, d).map_or(f64::INFINITY, |h: Hit| h.t);
            assert!((t - expected).abs() <= 1e-9 * expected, "case {i}: {t} for {expected} from {origin} along {d}");
            let end = origin + d * (expected * 0.999_999);
            assert!(!g.blocked(origin, end, Skip::NONE, Skip::NONE));
            assert!(g.blocked(origin, origin + d * (expected * 1.000_001), Skip::NONE, Skip::NONE));
        }
    }
}

#[test]
fn far_outside_origins_meet_the_same_points() {
    let mut scene = empty();
    scene.meshes.push(ellipsoid(3, v(5.0, 4.0, 3.0), DVec3::ZERO));
    let g = Geometry::new(&scene).expect("the mesh is valid");
    let mut n = Numbers(13);
    for _ in 0..5_000 {
        let (goal, d) = (n.within(v(-1.0, -1.0, -1.0), v(1.0, 1.0, 1.0)), n.direction());
        let near = first(&g, goal - d * 9.0, d).expect("the ray passes through the ellipsoid");
        let far = first(&g, goal - d * 1e6, d).expect("the ray passes through the ellipsoid");
        // 1e6 m is known to 1e-10 m
        assert!((near.point - far.point).length() < 1e-8);
        assert!(first(&g, goal + d * 1e6, d).is_none());
    }
}
