//! The stated standard errors against the scatter of many seeds: how often does the truth lie within one of them?

mod trace_rooms;

use diffray::geometry::Geometry;
use diffray::probe::Echogram;
use diffray::scene::*;
use diffray::trace::{TraceOutcome, TracePlan, trace};
use diffray::wbsdf::crossing::Spectrum;
use diffray::wbsdf::scatter::PortalScatter;
use trace_rooms::*;

/// Bands at 125 Hz, 1 kHz and 4 kHz.
fn three_bands() -> Scene {
    let mut scene = empty(3);
    for (band, f) in scene.bands.iter_mut().zip([125.0, 1000.0, 4000.0]) {
        *band = Band { nominal_hz: f, low_hz: f / 2f64.sqrt(), high_hz: f * 2f64.sqrt() };
    }
    scene
}

fn one_room() -> Scene {
    let mut scene = three_bands();
    let m = material(&mut scene, &[0.4, 0.6, 0.3], &[0.3, 0.2, 0.6], None);
    add_box(&mut scene, [0.0; 3], [5.0, 4.0, 3.0], [Some(m); 6]);
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_probe(&mut scene, [4.0, 3.0, 2.0]);
    scene
}

/// Two rooms of 5 x 4 x 3 m and an opening `width` wide and 2 m high between them.
fn two_rooms(width: f64) -> Scene {
    let mut scene = three_bands();
    let m = material(&mut scene, &[0.5, 0.6, 0.4], &[0.3, 0.3, 0.5], None);
    let w = Some(m);
    add_box(&mut scene, [0.0; 3], [5.0, 4.0, 3.0], [w, None, w, w, w, w]);
    add_box(&mut scene, [5.1, 0.0, 0.0], [10.1, 4.0, 3.0], [None, w, w, w, w, w]);
    let wall = add_partition(&mut scene, 5.05, 4.0, 3.0, m, 0.1);
    add_hole(&mut scene, wall, [1.0, 1.0 + width], [0.0, 2.0]);
    add_source(&mut scene, [1.0, 1.0, 1.0]);
    add_probe(&mut scene, [9.0, 3.0, 2.0]);
    scene
}

/// A scene with its geometry and the scattering of its openings.
struct Prepared {
    scene: Scene,
    geometry: Geometry,
    scatter: Vec<PortalScatter>,
}

impl Prepared {
    fn new(scene: Scene) -> Self {
        let geometry = Geometry::new(&scene).expect("a sound scene");
        let spectra: Vec<Spectrum> = scene.bands.iter().map(|b| Spectrum::new(b, SPEED)).collect();
        let scatter = geometry
            .portals
            .iter()
            .map(|p| PortalScatter::new(p.x_m, p.y_m, p.thickness_m, &spectra, Transport::Wbsdf))
            .collect();
        Self { scene, geometry, scatter }
    }

    fn run(&self, plan: &TracePlan) -> TraceOutcome {
        trace(&self.scene, &self.geometry, &self.scatter, plan, &|_| ()).expect("a sound plan")
    }
}

/// How often the truth lies within the stated errors.
struct Coverage {
    /// Share of the runs whose level is within one standard error, and within two.
    one: f64,
    two: f64,
    /// Mean of the runs minus the truth, in standard errors of that difference.
    bias: f64,
    /// Scatter of the runs over the error they state.
    scatter: f64,
    /// Stated error of a level in dB.
    error_db: f64,
    /// Share of the bins within one standard error, of those whose error is below their energy; their number.
    bins: (usize, usize),
}

const SEEDS: u64 = 200;

/// Runs `plan` with [`SEEDS`] seeds, and once with `rays` rays for the truth, whose own error is added. One entry a band.
fn coverage(prepared: &Prepared, plan: &TracePlan, rays: u64) -> Vec<Coverage> {
    let truth = prepared.run(&TracePlan { target_db: 0.0, max_rays: rays, seed: 1 << 40, ..plan.clone() });
    let truth = &truth.traced[0].echogram;
    let runs: Vec<TraceOutcome> = (0..SEEDS).map(|seed| prepared.run(&TracePlan { seed, ..plan.clone() })).collect();
    let n = SEEDS as f64;
    let mean_rays = runs.iter().map(|r| r.rays[0]).sum::<u64>() as f64 / n;
    println!("{mean_rays:.0} rays a run, {:.1} s", runs.iter().map(|r| r.seconds).sum::<f64>());
    let echograms: Vec<&Echogram> = runs.iter().map(|r| &r.traced[0].echogram).collect();
    (0..truth.energy.len())
        .map(|b| {
            let (expected, own) = (level(truth, b), truth.std_error[b]);
            let pairs: Vec<(f64, f64)> = echograms.iter().map(|e| (level(e, b) - expected, e.std_error[b])).collect();
            let share = |k: f64| pairs.iter().filter(|p| p.0.abs() < k * p.1.hypot(own)).count() as f64 / n;
            let mean = pairs.iter().map(|p| p.0).sum::<f64>() / n;
            let scatter = (pairs.iter().map(|p| (p.0 - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
            let stated = (pairs.iter().map(|p| p.1 * p.1).sum::<f64>() / n).sqrt();
            // Which bins are looked at must not depend on the runs.
            let to_run = (rays as f64 / mean_rays).sqrt();
            let known = |i: &usize| truth.bin_error[b][*i] * to_run < truth.energy[b][*i];
            let known: Vec<usize> = (0..truth.energy[b].len()).filter(known).collect();
            let within = |e: &Echogram, i: usize| {
                (e.energy[b][i] - truth.energy[b][i]).abs() < e.bin_error[b][i].hypot(truth.bin_error[b][i])
            };
            let inside = echograms.iter().map(|e| known.iter().filter(|&&i| within(e, i)).count()).sum();
            let found = Coverage {
                one: share(1.0),
                two: share(2.0),
                bias: mean / (scatter / n.sqrt()).hypot(own),
                scatter: scatter / stated,
                error_db: 10.0 / std::f64::consts::LN_10 * stated / expected,
                bins: (inside, known.len() * runs.len()),
            };
            println!(
                "  band {b}: error {:.2} dB, within one {:.3}, two {:.3}, bias {:+.1}, scatter/stated {:.2}, bins {:.3} of {}",
                found.error_db,
                found.one,
                found.two,
                found.bias,
                found.scatter,
                inside as f64 / found.bins.1 as f64,
                known.len()
            );
            found
        })
        .collect()
}

/// A room, two rooms with a doorway, two rooms with a gap of 10 mm.
fn rooms() -> [(&'static str, Prepared); 3] {
    [("shoebox", one_room()), ("doorway", two_rooms(0.9)), ("gap", two_rooms(0.01))]
        .map(|(name, scene)| (name, Prepared::new(scene)))
}

fn plan_of(prepared: &Prepared) -> TracePlan {
    TracePlan { portal_order: 1, reflection_order: 1, ..TracePlan::new(&prepared.scene, 0.15) }
}

/// 68.3 % are expected, which 200 seeds know to 3.3 %.
fn assert_covers(name: &str, c: &Coverage) {
    assert!((0.60..=0.76).contains(&c.one), "{name}: {:.3} within one standard error", c.one);
    // 95.4 % for a normal distribution; sums of few large contributions have a tail.
    assert!((0.82..=0.99).contains(&c.two), "{name}: {:.3} within two", c.two);
    assert!(c.bias.abs() < 4.0, "{name}: {:.1} standard errors off on average", c.bias);
    assert!((0.8..1.25).contains(&c.scatter), "{name}: scatter over stated error {:.2}", c.scatter);
}

#[test]
fn the_truth_lies_within_the_stated_error_in_two_runs_of_three() {
    for (name, prepared) in rooms() {
        println!("{name}");
        // Where a level or a bin is the sum of few large contributions its stated error covers less: with a quarter of these rays
        // (levels within 0.7 to 1.7 dB) 46 to 70 % of the bins.
        let rays = match name {
            "shoebox" => 2048,
            "doorway" => 8192,
            _ => 32_768,
        };
        let plan = TracePlan { target_db: 0.0, max_rays: rays, ..plan_of(&prepared) };
        // With 16 times the rays of a run, bins that one strong ray had lifted passed for known, and the truth for missed.
        for c in coverage(&prepared, &plan, 1 << 18) {
            assert_covers(name, &c);
            assert!(c.error_db > 0.05, "{name}: nothing to cover");
            let share = c.bins.0 as f64 / c.bins.1 as f64;
            assert!(
                c.bins.1 > 1000 && (0.60..=0.76).contains(&share),
                "{name}: bins: {share:.3} within one standard error"
            );
        }
    }
}

#[test]
#[ignore = "a measurement of minutes: its numbers are in docs/verification.md"]
fn stopping_at_the_target_does_not_spoil_the_stated_error() {
    for (name, prepared) in rooms() {
        for target_db in [0.5, 0.25] {
            println!("{name}, {target_db} dB");
            let plan = TracePlan { target_db, ..plan_of(&prepared) };
            // Runs behind the gap take 240,000 rays: a truth of as many would be no truth.
            for c in coverage(&prepared, &plan, 1 << 22) {
                assert_covers(name, &c);
            }
        }
    }
}
