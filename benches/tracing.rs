//! Traced rays: hits per second beside what the search tree alone could do, and the time a standard error takes:
//! `cargo bench --bench tracing [small|rates|errors|rooms|sweep]`. One thread and its own processor time (Linux; else
//! the clock on the wall); of repetitions the shortest counts.

use std::sync::LazyLock;
use std::time::Instant;

use diffray::geometry::{Element, Geometry, Portal, Skip};
use diffray::paths;
use diffray::plan::Plan;
use diffray::response;
use diffray::scene::{Edges, Mesh, Scene};
use diffray::trace::{Scattering, TracePlan, trace};
use diffray::wbsdf::crossing::Spectrum;
use diffray::wbsdf::scatter::{Form, PortalScatter};
use glam::DVec3;

/// 10 x 6 x 3 m, eight octave bands, probe 4 m from the source.
const SHOEBOX: &str = r#"
name = "shoebox"
[material.even]
absorption = 0.2
scattering = 0.1
[[box]]
name = "room"
min_m = [0, 0, 0]
max_m = [10, 6, 3]
material = "even"
[[source]]
name = "source"
position_m = [2.5, 2.5, 1.5]
[[probe]]
name = "probe"
position_m = [6.3, 3.7, 1.2]
[simulation]
target_db = 0.04
max_time_s = 60.0
"#;

/// Two rooms of 5 x 4 x 3 m with a sliding door in the wall of 0.1 m between them; the probe does not see the source.
const TWO_ROOMS: &str = r#"
name = "two rooms"
[material.even]
absorption = 0.2
scattering = 0.1
[[box]]
name = "first"
min_m = [0, 0, 0]
max_m = [5, 4, 3]
material = "even"
faces = { x_max = "none" }
[[box]]
name = "second"
min_m = [5.1, 0, 0]
max_m = [10.1, 4, 3]
material = "even"
faces = { x_min = "none" }
[[wall]]
name = "partition"
corners_m = [[5.05, 0, 0], [5.05, 4, 0], [5.05, 4, 3], [5.05, 0, 3]]
thickness_m = 0.1
material = "even"
[[opening]]
name = "door"
wall = "partition"
x_m = [1.0, 1.9]
y_m = [0.0, 2.0]
door = { kind = "sliding", open_m = 0.9, fixed_jamb = "x_min", material = "even", thickness_m = 0.1 }
[[source]]
name = "source"
position_m = [1.5, 3.2, 1.5]
[[probe]]
name = "probe"
position_m = [8.0, 3.4, 1.4]
[simulation]
target_db = 0.2
max_time_s = 100.0
"#;

fn scene(text: &str, set: &[&str]) -> Scene {
    let set: Vec<_> = set.iter().map(|s| diffray::scene::Override::parse(s).expect("an override")).collect();
    Scene::from_str(text, "bench.toml", &set).unwrap_or_else(|e| panic!("{e}")).scene
}

/// No scene here has portals.
#[derive(Clone)]
struct Nothing;

impl Scattering for Nothing {
    fn sample(&self, _: Form, _: (f64, f64), s_i: DVec3, _: [f64; 3], _: &mut [f32]) -> Option<DVec3> {
        Some(s_i)
    }
    fn density(&self, _: Form, _: (f64, f64), _: DVec3, _: DVec3, out: &mut [f64]) {
        out.fill(0.0);
    }
    fn transmitted(&self, _: DVec3, out: &mut [f32]) {
        out.fill(1.0);
    }
    fn lobe_sr(&self, _: usize) -> f64 {
        0.0
    }
}

/// Numbers in 0..1 that fill it evenly but in no visible order.
fn scramble(i: usize) -> f64 {
    let mut z = (i as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// The shoebox as a mesh whose faces are grids of about `triangles` triangles in all; inner vertices of the grids are
/// moved along the face's normal by up to 0.1 m, so that no two triangles lie in one plane. Twelve triangles are flat.
fn mesh_room(triangles: usize) -> Scene {
    let mut scene = scene(SHOEBOX, &[]);
    scene.boxes.clear();
    scene.simulation.edges = Edges::Off;
    let size = [10.0, 6.0, 3.0];
    let n = ((triangles as f64 / 12.0).sqrt().round() as usize).max(1);
    let mut mesh = Mesh { file: "bumpy".into(), triangles_m: Vec::new(), materials: Vec::new() };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in 0..2 {
            let vertex = |i: usize, j: usize| {
                let mut p = [0.0; 3];
                p[u] = size[u] * i as f64 / n as f64;
                p[v] = size[v] * j as f64 / n as f64;
                let inner = i > 0 && j > 0 && i < n && j < n;
                let bump = if inner { 0.1 * scramble((i * 4096 + j) * 6 + axis * 2 + side) } else { 0.0 };
                p[axis] = if side == 0 { bump } else { size[axis] - bump };
                DVec3::from_array(p)
            };
            for i in 0..n {
                for j in 0..n {
                    let (a, b, c, d) = (vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1));
                    mesh.triangles_m.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    mesh.materials = vec![0; mesh.triangles_m.len()];
    scene.meshes.push(mesh);
    scene
}

/// The queries of rays that are reflected as the material says: origin, direction, skip.
fn queries(geometry: &Geometry, origin: DVec3, count: usize) -> Vec<(DVec3, DVec3, Skip)> {
    let mut numbers = (0..).map(scramble);
    let mut next = || numbers.next().unwrap_or_default();
    let mut out = Vec::with_capacity(count);
    while out.len() < count {
        let (z, turn) = (1.0 - 2.0 * next(), std::f64::consts::TAU * next());
        let r = (1.0 - z * z).sqrt();
        let (mut p, mut d, mut skip) = (origin, DVec3::new(r * turn.cos(), r * turn.sin(), z), Skip::NONE);
        for _ in 0..40 {
            out.push((p, d, skip));
            let Some(hit) = geometry.closest(p, d, f64::INFINITY, skip) else { break };
            let Element::Surface(surface) = hit.element else { break };
            let normal = geometry.surfaces[surface].frame.normal;
            let normal = if normal.dot(d) > 0.0 { -normal } else { normal };
            d = if next() < 0.1 {
                let (z, turn) = (1.0 - 2.0 * next(), std::f64::consts::TAU * next());
                let r = (1.0 - z * z).sqrt();
                (normal + DVec3::new(r * turn.cos(), r * turn.sin(), z)).normalize()
            } else {
                (d - normal * (2.0 * d.dot(normal))).normalize()
            };
            p = hit.point;
            skip = Skip::reflected(&hit);
        }
    }
    out
}

/// Processor time of this thread in s, to a few milliseconds.
fn now_s() -> f64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next().and_then(|word| word.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

/// Time in s of one run and its result.
fn timed<T>(run: impl FnOnce() -> T) -> (f64, T) {
    let start = now_s();
    let result = run();
    (now_s() - start, result)
}

/// Shortest time in s of `n` runs.
fn shortest(n: usize, mut run: impl FnMut()) -> f64 {
    (0..n).map(|_| timed(&mut run).0).fold(f64::INFINITY, f64::min)
}

/// Hits a second with rain against bare closest-hit queries of the same kind of rays.
fn rates(name: &str, scene: &Scene) {
    let (built, geometry) = timed(|| Geometry::new(scene).expect("a sound scene"));
    let queries = queries(&geometry, scene.sources[0].position_m, 100_000);
    let mut sum = 0.0;
    let rounds = if queries.len() * 20 < 100 * geometry.facet_count() { 1 } else { 20 };
    let bare = shortest(5, || {
        for _ in 0..rounds {
            sum = queries
                .iter()
                .filter_map(|(o, d, skip)| geometry.closest(*o, *d, f64::INFINITY, *skip))
                .map(|hit| hit.t)
                .sum::<f64>();
        }
    }) / (rounds * queries.len()) as f64;
    let run = |max_rays: u64| {
        let plan = TracePlan { target_db: 0.0, max_rays, ..TracePlan::new(scene, 0.8) };
        timed(|| trace::<Nothing>(scene, &geometry, &[], &plan, &|_| ()).expect("a sound plan"))
    };
    let rays = 16_384;
    let traced = (0..5)
        .map(|_| {
            // Differences leave out what has to be set up.
            let ((few_s, few), (many_s, many)) = (run(256), run(rays));
            (many_s - few_s) / (many.hits - few.hits) as f64
        })
        .fold(f64::INFINITY, f64::min);
    println!(
        "{name:>18}: {:6.2} M hits/s traced, {:6.2} M/s bare closest hit, share {:3.0} %, built in {built:.2} s, mean flight {:.2} m",
        1e-6 / traced,
        1e-6 / bare,
        100.0 * bare / traced,
        sum / queries.len() as f64,
    );
}

/// Time of the traced part to the target error.
fn to_target(name: &str, text: &str, set: &[&str]) -> f64 {
    let scene = scene(text, set);
    let geometry = Geometry::new(&scene).expect("a sound scene");
    let plan = Plan::new(&scene, &geometry);
    let (paths_s, early) = timed(|| paths::find(&scene, &geometry, plan.reflection_order));
    let part = plan.traced.as_ref().expect("surfaces scatter");
    let (tables_s, scatter) = timed(|| {
        let spectra: Vec<Spectrum> =
            scene.bands.iter().map(|b| Spectrum::new(b, scene.air.speed_of_sound_m_s)).collect();
        let portal = |p: &Portal| {
            let depth_m = scene.gap_depth_m(&scene.openings[p.opening]);
            PortalScatter::new(p.x_m, p.y_m, depth_m, &spectra, scene.simulation.transport)
        };
        geometry.portals.iter().map(portal).collect::<Vec<_>>()
    });
    let trace_plan = TracePlan {
        reflection_order: plan.reflection_order,
        portal_order: 1,
        bin_s: part.bin_s,
        early: vec![vec![early[0].intensity.clone()]],
        ..TracePlan::new(&scene, part.length_s)
    };
    let (seconds, outcome) = timed(|| trace(&scene, &geometry, &scatter, &trace_plan, &|_| ()).expect("a sound plan"));
    let echogram = &outcome.traced[0].echogram;
    let errors: Vec<String> = (0..scene.bands.len())
        .map(|b| {
            let level = early[0].intensity[b] + echogram.energy[b].iter().sum::<f64>();
            format!("{:.3}", 4.343 * echogram.std_error[b] / level)
        })
        .collect();
    let rays = outcome.rays[0];
    println!(
        "{name:>18}: {seconds:6.3} s tracing, {paths_s:6.3} s paths, {tables_s:.3} s tables; {rays} rays, {:.1} hits a ray, {:.2} M hits/s; errors {} dB",
        outcome.hits as f64 / rays as f64,
        1e-6 * outcome.hits as f64 / seconds,
        errors.join(" "),
    );
    seconds
}

/// Spread of T30 between seeds with `rays` rays, and the time of one run.
fn decay_times(rays: u64) {
    let mut scene = scene(SHOEBOX, &[]);
    let geometry = Geometry::new(&scene).expect("a sound scene");
    let plan = Plan::new(&scene, &geometry);
    let early = paths::find(&scene, &geometry, plan.reflection_order);
    let part = plan.traced.as_ref().expect("surfaces scatter");
    let bands = scene.bands.len();
    let (mut sum, mut square, mut seconds) = (vec![0.0; bands], vec![0.0; bands], 0.0);
    const SEEDS: u64 = 24;
    for seed in 0..SEEDS {
        scene.simulation.seed = seed;
        let trace_plan = TracePlan {
            reflection_order: plan.reflection_order,
            bin_s: part.bin_s,
            target_db: 0.0,
            max_rays: rays,
            ..TracePlan::new(&scene, part.length_s)
        };
        let (took, outcome) =
            timed(|| trace::<Nothing>(&scene, &geometry, &[], &trace_plan, &|_| ()).expect("a sound plan"));
        seconds += took / SEEDS as f64;
        let reception = diffray::probe::Reception {
            source: String::new(),
            probe: String::new(),
            paths: early[0].paths.clone(),
            echogram: Some(outcome.traced[0].echogram.clone()),
            levels: Vec::new(),
        };
        for (b, m) in response::metrics(&reception, &scene.bands).iter().enumerate() {
            let t = m.t30.seconds.unwrap_or(f64::NAN);
            sum[b] += t / SEEDS as f64;
            square[b] += t * t / SEEDS as f64;
        }
    }
    let spread: Vec<String> = sum
        .iter()
        .zip(&square)
        .map(|(m, s)| {
            format!("{:.2}", 100.0 * ((s / (m * m) - 1.0).max(0.0) * SEEDS as f64 / (SEEDS - 1) as f64).sqrt())
        })
        .collect();
    println!("T30 of {rays} rays: {seconds:.3} s a run, {:.3} s, spread {} %", sum[3], spread.join(" "));
}

fn main() {
    let wanted = std::env::args().skip(1).find(|a| !a.starts_with("--")).unwrap_or_default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    pool.install(|| {
        if wanted.is_empty() || wanted == "small" || wanted == "rates" {
            rates("box", &scene(SHOEBOX, &[]));
        }
        if wanted.is_empty() || wanted == "rates" {
            for triangles in [12, 5_000, 50_000, 500_000] {
                rates(&format!("{triangles} triangles"), &mesh_room(triangles));
            }
        }
        if wanted.is_empty() || wanted == "small" || wanted == "errors" {
            to_target("shoebox 0.04 dB", SHOEBOX, &[]);
            for rays in [8192, 81_920] {
                decay_times(rays);
            }
        }
        if wanted.is_empty() || wanted == "rooms" || wanted == "errors" {
            to_target("door 0.9 m 0.2 dB", TWO_ROOMS, &[]);
            for gap in ["0.05", "0.01", "0.001"] {
                let open = format!("opening.door.door.open_m={gap}");
                to_target(&format!("gap {gap} m 0.3 dB"), TWO_ROOMS, &[&open, "simulation.target_db=0.3"]);
            }
        }
        if wanted.is_empty() || wanted == "sweep" || wanted == "errors" {
            let total: f64 = (0..20)
                .map(|i| {
                    let open = format!("opening.door.door.open_m={:.4}", 0.02 * 45f64.powf(f64::from(i) / 19.0));
                    to_target("sweep", TWO_ROOMS, &[&open, "simulation.target_db=0.3"])
                })
                .sum();
            println!("sweep of 20 openings: {total:.1} s tracing");
        }
    });
}
