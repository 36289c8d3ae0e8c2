//! Small scenes for the geometry tests, built directly (no room file).
#![allow(dead_code, reason = "each test file uses some of the scenes")]

use std::path::PathBuf;

use diffray::geometry::{Geometry, Skip};
use diffray::scene::{
    Air, Band, BoxRoom, Edges, Frame, Host, Leaf, Material, Mesh, Opening, Output, Scene, Simulation, Spacing,
    Transport, Wall,
};
use glam::DVec3;

/// An empty scene with two materials: 0 absorbs 0.1, 1 absorbs 0.3.
pub(crate) fn empty() -> Scene {
    let material = |name: &str, absorption: f64| Material {
        name: name.into(),
        absorption: vec![absorption],
        scattering: vec![0.1],
        transmission: None,
    };
    Scene {
        name: "test".into(),
        air: Air {
            temperature_c: 20.0,
            relative_humidity_percent: 50.0,
            pressure_kpa: 101.325,
            speed_of_sound_m_s: 343.0,
            absorption: false,
            attenuation_per_m: vec![0.0],
        },
        spacing: Spacing::Octave,
        bands: vec![Band { nominal_hz: 1000.0, low_hz: 707.0, high_hz: 1414.0 }],
        materials: vec![material("plaster", 0.1), material("wood", 0.3)],
        boxes: Vec::new(),
        walls: Vec::new(),
        meshes: Vec::new(),
        openings: Vec::new(),
        sources: Vec::new(),
        probes: Vec::new(),
        simulation: Simulation {
            seed: 1,
            target_db: 0.5,
            max_rays: 1000,
            max_time_s: 1.0,
            reflection_order: 3,
            diffraction_order: 2,
            edges: Edges::Auto,
            transport: Transport::Wbsdf,
            interference: false,
            ray_tolerance: 2e-3,
        },
        output: Output { sample_rate_hz: 48000, response_length_s: None, signal_to_noise_db: None },
        sweep: None,
    }
}

pub(crate) fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A closed box of material 0.
pub(crate) fn room(name: &str, min_m: DVec3, max_m: DVec3) -> BoxRoom {
    BoxRoom { name: name.into(), min_m, max_m, faces: [Some(0); 6] }
}

/// A thin wall of material 0; the frame as the room file defines it.
pub(crate) fn wall(name: &str, corners: &[[f64; 3]]) -> Wall {
    let corners_m: Vec<DVec3> = corners.iter().map(|&c| DVec3::from_array(c)).collect();
    let x = (corners_m[1] - corners_m[0]).normalize();
    let middle = corners_m.iter().sum::<DVec3>() / corners_m.len() as f64 - corners_m[0];
    let y = (middle - x * middle.dot(x)).normalize();
    let frame = Frame { origin_m: corners_m[0], x, y, normal: x.cross(y) };
    Wall { name: name.into(), corners_m, material: 0, thickness_m: 0.0, unbounded: false, frame }
}

/// An upright wall from floor level `z[0]` to `z[1]` over the ground line a-b.
pub(crate) fn upright(name: &str, a: [f64; 2], b: [f64; 2], z: [f64; 2]) -> Wall {
    wall(name, &[[a[0], a[1], z[0]], [b[0], b[1], z[0]], [b[0], b[1], z[1]], [a[0], a[1], z[1]]])
}

/// A hole in wall `index`, all of it open.
pub(crate) fn hole(scene: &Scene, index: usize, x_m: [f64; 2], y_m: [f64; 2]) -> Opening {
    Opening {
        name: "door".into(),
        host: Host::Wall(index),
        frame: scene.walls[index].frame,
        hole_x_m: x_m,
        y_m,
        open_x_m: x_m,
        leaf: None,
    }
}

/// The same hole with a leaf that leaves `open_m` beside x_min.
pub(crate) fn door(scene: &Scene, index: usize, x_m: [f64; 2], y_m: [f64; 2], open_m: f64) -> Opening {
    let edge = x_m[0] + open_m;
    let leaf = (edge < x_m[1]).then_some(Leaf { x_m: [edge, x_m[1]], material: 1, thickness_m: 0.04 });
    Opening { open_x_m: [x_m[0], edge], leaf, ..hole(scene, index, x_m, y_m) }
}

/// A box 8 x 5 x 3 m with a partition at x = 4 m and a door in it, open by `open_m` of 1.2 m.
pub(crate) fn partitioned(thickness_m: f64, open_m: f64) -> Scene {
    let mut scene = empty();
    scene.boxes.push(room("hall", v(0.0, 0.0, 0.0), v(8.0, 5.0, 3.0)));
    let mut partition = upright("partition", [4.0, 0.0], [4.0, 5.0], [0.0, 3.0]);
    partition.thickness_m = thickness_m;
    scene.walls.push(partition);
    let opening = door(&scene, 0, [1.0, 2.2], [0.0, 2.1], open_m);
    scene.openings.push(opening);
    scene
}

/// An L-shaped prism of eight walls: 6 x 6 m without the quadrant x, y > 2 m, 3 m high.
pub(crate) fn l_corridor() -> Scene {
    let ring = [[0.0, 0.0], [6.0, 0.0], [6.0, 2.0], [2.0, 2.0], [2.0, 6.0], [0.0, 6.0]];
    let mut scene = empty();
    for (i, a) in ring.iter().enumerate() {
        scene.walls.push(upright(&format!("side {i}"), *a, ring[(i + 1) % ring.len()], [0.0, 3.0]));
    }
    for z in [0.0, 3.0] {
        let corners: Vec<[f64; 3]> = ring.iter().map(|c| [c[0], c[1], z]).collect();
        scene.walls.push(wall(&format!("level {z}"), &corners));
    }
    scene
}

/// An icosahedron refined `levels` times and scaled to an ellipsoid: 20 * 4^levels triangles.
pub(crate) fn ellipsoid(levels: usize, radii: DVec3, centre: DVec3) -> Mesh {
    let g = 0.5 * (1.0 + 5.0_f64.sqrt());
    let raw = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let ids = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let unit = |i: usize| DVec3::from_array(raw[i]).normalize();
    let mut triangles: Vec<[DVec3; 3]> = ids.iter().map(|t: &[usize; 3]| t.map(unit)).collect();
    for _ in 0..levels {
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let triangles_m: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|p| centre + p * radii)).collect();
    let materials = vec![0; triangles_m.len()];
    Mesh { file: PathBuf::from("ellipsoid.obj"), triangles_m, materials }
}

/// The 12 triangles of a cuboid, outward winding.
pub(crate) fn cuboid(min: DVec3, max: DVec3) -> Mesh {
    let p = |i: usize| {
        let pick = |bit: usize, a: f64, b: f64| if i >> bit & 1 == 1 { b } else { a };
        v(pick(0, min.x, max.x), pick(1, min.y, max.y), pick(2, min.z, max.z))
    };
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles_m: Vec<[DVec3; 3]> =
        quads.iter().flat_map(|q| [[p(q[0]), p(q[1]), p(q[2])], [p(q[0]), p(q[2]), p(q[3])]]).collect();
    Mesh { file: PathBuf::from("cuboid.obj"), triangles_m, materials: vec![0; 12] }
}

/// The whole scene moved by `by`.
pub(crate) fn moved(mut scene: Scene, by: DVec3) -> Scene {
    for room in &mut scene.boxes {
        room.min_m += by;
        room.max_m += by;
    }
    for wall in &mut scene.walls {
        wall.frame.origin_m += by;
        wall.corners_m.iter_mut().for_each(|c| *c += by);
    }
    for mesh in &mut scene.meshes {
        mesh.triangles_m.iter_mut().flatten().for_each(|c| *c += by);
    }
    for opening in &mut scene.openings {
        opening.frame.origin_m += by;
    }
    scene
}

/// Reproducible numbers in [0, 1) (splitmix64).
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn within(&mut self, low: DVec3, high: DVec3) -> DVec3 {
        low + (high - low) * v(self.unit(), self.unit(), self.unit())
    }

    pub(crate) fn direction(&mut self) -> DVec3 {
        let z = 2.0 * self.unit() - 1.0;
        let phi = std::f64::consts::TAU * self.unit();
        let r = (1.0 - z * z).max(0.0).sqrt();
        v(r * phi.cos(), r * phi.sin(), z)
    }
}

/// Closest hit without limits or skips.
pub(crate) fn first(geometry: &Geometry, origin: DVec3, direction: DVec3) -> Option<diffray::geometry::Hit> {
    geometry.closest(origin, direction, f64::INFINITY, Skip::NONE)
}
