//! Scenes built by hand for the tests of the traced rays, and the numbers to compare them with.
#![allow(dead_code, reason = "every test file uses its own part")]

use diffray::geometry::Geometry;
use diffray::probe::Echogram;
use diffray::scene::*;
use diffray::trace::{Scattering, TraceOutcome, TracePlan, trace};
use diffray::wbsdf::scatter::Form;
use glam::DVec3;

/// Speed of sound of all test rooms in m/s.
pub(crate) const SPEED: f64 = 343.0;

/// A scene with nothing in it and the given number of bands.
pub(crate) fn empty(bands: usize) -> Scene {
    let band = |i: usize| {
        let f = 125.0 * (2.0f64).powi(i as i32);
        Band { nominal_hz: f, low_hz: f / 2f64.sqrt(), high_hz: f * 2f64.sqrt() }
    };
    Scene {
        name: "test".into(),
        air: Air {
            temperature_c: 20.0,
            relative_humidity_percent: 50.0,
            pressure_kpa: 101.325,
            speed_of_sound_m_s: SPEED,
            absorption: false,
            attenuation_per_m: vec![0.0; bands],
        },
        spacing: Spacing::Octave,
        bands: (0..bands).map(band).collect(),
        materials: Vec::new(),
        boxes: Vec::new(),
        walls: Vec::new(),
        meshes: Vec::new(),
        openings: Vec::new(),
        sources: Vec::new(),
        probes: Vec::new(),
        simulation: Simulation {
            seed: 1,
            target_db: 0.1,
            max_rays: 10_000_000,
            max_time_s: 600.0,
            reflection_order: 0,
            diffraction_order: 1,
            edges: Edges::Auto,
            transport: Transport::Wbsdf,
            interference: false,
            ray_tolerance: 2e-3,
        },
        output: Output { sample_rate_hz: 48_000, response_length_s: None, signal_to_noise_db: None },
        sweep: None,
    }
}

/// A material with one value a band each; returns its index.
pub(crate) fn material(
    scene: &mut Scene,
    absorption: &[f64],
    scattering: &[f64],
    transmission: Option<&[f64]>,
) -> MaterialId {
    scene.materials.push(Material {
        name: format!("material {}", scene.materials.len()),
        absorption: absorption.to_vec(),
        scattering: scattering.to_vec(),
        transmission: transmission.map(<[f64]>::to_vec),
    });
    scene.materials.len() - 1
}

/// A box with faces of the given materials in the order of [`Face::ALL`].
pub(crate) fn add_box(scene: &mut Scene, min: [f64; 3], max: [f64; 3], faces: [Option<MaterialId>; 6]) {
    let name = format!("room {}", scene.boxes.len());
    scene.boxes.push(BoxRoom { name, min_m: min.into(), max_m: max.into(), faces });
}

pub(crate) fn add_source(scene: &mut Scene, position: [f64; 3]) {
    scene.sources.push(Source {
        name: format!("source {}", scene.sources.len()),
        position_m: position.into(),
        kind: SourceKind::Point,
        power_db: None,
        directivity: Directivity { omni_share: 1.0, axis: DVec3::X },
    });
}

pub(crate) fn add_probe(scene: &mut Scene, position: [f64; 3]) {
    scene.probes.push(Probe {
        name: format!("probe {}", scene.probes.len()),
        position_m: position.into(),
        format: ProbeFormat::Omni,
    });
}

/// A wall across the whole section of rooms of `size_y` x `size_z` at x, centred on it.
pub(crate) fn add_partition(
    scene: &mut Scene,
    x: f64,
    size_y: f64,
    size_z: f64,
    material: MaterialId,
    thickness: f64,
) -> usize {
    let corner = |y: f64, z: f64| DVec3::new(x, y, z);
    scene.walls.push(Wall {
        name: format!("wall {}", scene.walls.len()),
        corners_m: vec![corner(0.0, 0.0), corner(size_y, 0.0), corner(size_y, size_z), corner(0.0, size_z)],
        material,
        thickness_m: thickness,
        unbounded: false,
        frame: Frame { origin_m: corner(0.0, 0.0), x: DVec3::Y, y: DVec3::Z, normal: DVec3::X },
    });
    scene.walls.len() - 1
}

/// An open hole in a wall, local limits.
pub(crate) fn add_hole(scene: &mut Scene, wall: usize, x: [f64; 2], y: [f64; 2]) {
    scene.openings.push(Opening {
        name: format!("opening {}", scene.openings.len()),
        host: Host::Wall(wall),
        frame: scene.walls[wall].frame,
        hole_x_m: x,
        y_m: y,
        open_x_m: x,
        leaf: None,
    });
}

/// A shoebox from the origin with one material on all faces.
pub(crate) fn shoebox(size: [f64; 3], absorption: &[f64], scattering: &[f64]) -> Scene {
    let mut scene = empty(absorption.len());
    let m = material(&mut scene, absorption, scattering, None);
    add_box(&mut scene, [0.0; 3], size, [Some(m); 6]);
    scene
}

/// A portal that changes nothing.
#[derive(Clone)]
pub(crate) struct Nothing;

impl Scattering for Nothing {
    fn transmitted(&self, _: DVec3, out: &mut [f32]) {
        out.fill(1.0);
    }

    fn sample(&self, _: Form, _: (f64, f64), s_i: DVec3, _: [f64; 3], _: &mut [f32]) -> Option<DVec3> {
        Some(s_i)
    }
    fn density(&self, _: Form, _: (f64, f64), _: DVec3, _: DVec3, out: &mut [f64]) {
        out.fill(0.0);
    }
    fn lobe_sr(&self, _: usize) -> f64 {
        0.0
    }
}

/// Traces a scene that has no portals.
pub(crate) fn run(scene: &Scene, plan: &TracePlan) -> TraceOutcome {
    run_with::<Nothing>(scene, plan, &[])
}

/// Traces a scene with the given portal behaviour.
pub(crate) fn run_with<S: Scattering>(scene: &Scene, plan: &TracePlan, scatter: &[S]) -> TraceOutcome {
    let geometry = Geometry::new(scene).expect("a sound scene");
    trace(scene, &geometry, scatter, plan, &|_| ()).expect("a sound plan")
}

/// A plan that traces exactly `rays` rays a source into an echogram of `length_s`.
pub(crate) fn plan(scene: &Scene, length_s: f64, rays: u64) -> TracePlan {
    TracePlan { target_db: 0.0, max_rays: rays * scene.sources.len() as u64, ..TracePlan::new(scene, length_s) }
}

/// Sum of an echogram over time in one band.
pub(crate) fn level(echogram: &Echogram, band: usize) -> f64 {
    echogram.energy[band].iter().sum()
}

/// Decay time in s from the Schroeder curve between two levels in dB below its start, by least squares.
pub(crate) fn decay_time(echogram: &Echogram, band: usize, from_db: f64, to_db: f64) -> f64 {
    let energy = &echogram.energy[band];
    let mut sum = 0.0;
    let mut curve: Vec<f64> = energy
        .iter()
        .rev()
        .map(|e| {
            sum += e;
            sum
        })
        .collect();
    curve.reverse();
    let points: Vec<(f64, f64)> = curve
        .iter()
        .enumerate()
        .map(|(i, e)| (i as f64 * echogram.bin_s, 10.0 * (e / sum).log10()))
        .filter(|&(_, db)| db <= from_db && db >= to_db)
        .collect();
    let n = points.len() as f64;
    let (mt, md) = points.iter().fold((0.0, 0.0), |a, p| (a.0 + p.0 / n, a.1 + p.1 / n));
    let (cov, var) = points.iter().fold((0.0, 0.0), |a, p| (a.0 + (p.0 - mt) * (p.1 - md), a.1 + (p.0 - mt).powi(2)));
    -60.0 * var / cov
}

/// dB of a ratio.
pub(crate) fn db(ratio: f64) -> f64 {
    10.0 * ratio.log10()
}
