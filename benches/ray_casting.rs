//! Closest-hit, occlusion and segment rates in rooms of few and many triangles: `cargo bench --bench ray_casting`.

#[path = "../tests/geometry_scenes/mod.rs"]
mod geometry_scenes;

use diffray::geometry::{Geometry, Skip};
use diffray::scene::Scene;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use geometry_scenes::*;
use glam::DVec3;

const RAYS: usize = 10_000;

/// A shoebox; a box with a thick partition and a door; a shoebox as a mesh; a hall with 24 free walls; a round body
/// in a hall.
const ROOMS: [&str; 6] =
    ["6 faces", "box with a door", "12 triangles", "6 faces and 24 walls", "5 k triangles", "82 k triangles"];

fn scene(name: &str) -> Scene {
    let mut scene = if name == "box with a door" { partitioned(0.1, 0.3) } else { empty() };
    let (low, high) = (v(0.0, 0.0, 0.0), v(30.0, 20.0, 8.0));
    match name {
        "box with a door" => {}
        "12 triangles" => scene.meshes.push(cuboid(low, high)),
        _ => scene.boxes.push(room("hall", low, high)),
    }
    match name {
        "6 faces and 24 walls" => {
            for i in 0..24 {
                let (x, y) = (2.0 + 4.5 * (i % 6) as f64, 2.0 + 4.5 * (i / 6) as f64);
                scene.walls.push(upright("wall", [x, y], [x + 1.0, y + 1.0], [0.0, 3.0]));
            }
        }
        "5 k triangles" => scene.meshes.push(ellipsoid(4, v(6.0, 5.0, 2.0), v(15.0, 10.0, 4.0))),
        "82 k triangles" => scene.meshes.push(ellipsoid(6, v(6.0, 5.0, 2.0), v(15.0, 10.0, 4.0))),
        _ => {}
    }
    scene
}

fn rays(name: &str) -> Vec<(DVec3, DVec3)> {
    let mut n = Numbers(1);
    let far = if name == "box with a door" { v(7.9, 4.9, 2.9) } else { v(29.9, 19.9, 7.9) };
    (0..RAYS).map(|_| (n.within(v(0.1, 0.1, 0.1), far), n.direction())).collect()
}

fn geometry(name: &str) -> Geometry {
    Geometry::new(&scene(name)).expect("the room is valid")
}

#[divan::bench(args = ROOMS)]
fn closest(bencher: Bencher, name: &str) {
    let (g, rays) = (geometry(name), rays(name));
    bencher.counter(ItemsCount::new(RAYS)).bench_local(|| {
        rays.iter()
            .filter_map(|(o, d)| g.closest(black_box(*o), *d, f64::INFINITY, Skip::NONE))
            .map(|h| h.t)
            .sum::<f64>()
    });
}

#[divan::bench(args = ROOMS)]
fn blocked(bencher: Bencher, name: &str) {
    let (g, rays) = (geometry(name), rays(name));
    bencher.counter(ItemsCount::new(RAYS)).bench_local(|| {
        rays.windows(2).filter(|w| g.blocked(black_box(w[0].0), w[1].0, Skip::NONE, Skip::NONE)).count()
    });
}

#[divan::bench(args = ROOMS)]
fn segment(bencher: Bencher, name: &str) {
    let (g, rays) = (geometry(name), rays(name));
    bencher.counter(ItemsCount::new(RAYS)).bench_local(|| {
        rays.windows(2).map(|w| g.segment(black_box(w[0].0), w[1].0, Skip::NONE, Skip::NONE).len()).sum::<usize>()
    });
}

#[divan::bench(args = ROOMS, sample_count = 5)]
fn build(bencher: Bencher, name: &str) {
    let scene = scene(name);
    bencher.bench_local(|| geometry_of(&scene));
}

fn geometry_of(scene: &Scene) -> usize {
    Geometry::new(scene).map_or(0, |g| g.facet_count())
}

fn main() {
    divan::main();
}
