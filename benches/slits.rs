//! Levels per second behind slits by every form, and what their tables cost: `cargo bench --bench slits`.

use diffray::wbsdf::crossing::{Crossing, Incident, Spectrum};
use diffray::wbsdf::mask::{Jambs, Mask};
use diffray::wbsdf::referee::exact_intensity;
use diffray::wbsdf::slit::{BandApertures, intensity};
use diffray::wbsdf::tables::{SlitTables, Solved};
use diffray::wbsdf::utd::band_nodes;
use diffray::wbsdf::utd_opening::OpeningRays;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};

const TOLERANCE: f64 = 2e-3;
/// The octave about 1 kHz.
const OCTAVE: Spectrum = Spectrum { low_hz: 707.106781, high_hz: 1414.213562, speed_m_s: 343.0 };

fn slit(width_m: f64) -> Mask {
    Mask::new(&[[-0.5 * width_m, 0.5 * width_m]])
}

/// An opening of this k times width in the octave about 1 kHz.
fn of_ka(ka: f64) -> Mask {
    slit(2.0 * ka / (OCTAVE.low_k() + OCTAVE.high_k()))
}

/// Line sources and receivers between these angles (degrees) off the normal, 0.5 to 8 m away.
fn crossings(angles: [f64; 2]) -> Vec<Crossing> {
    (0..64)
        .map(|i| {
            // Steps of the golden ratio: spread evenly, the same in every run.
            let share = |n: f64| (n * 0.618_033_988_749_895 * f64::from(i + 1)).fract();
            let place = |a: f64, r: f64, side: f64| {
                let angle = (angles[0] + share(a) * (angles[1] - angles[0])).to_radians() * side;
                let distance_m = 0.5 * 16.0_f64.powf(share(r));
                (distance_m * angle.sin(), distance_m * angle.cos())
            };
            let (source, receiver) = (place(1.0, 2.0, -1.0), place(3.0, 5.0, if i % 2 == 0 { 1.0 } else { -1.0 }));
            let incident = Incident::Line { x_m: source.0, z_m: source.1 };
            Crossing { incident, x_m: receiver.0, z_m: receiver.1 }
        })
        .collect()
}

#[divan::bench(args = [14.0, 30.0, 100.0, 300.0])]
fn signed_rays_of_an_octave(bencher: Bencher, ka: f64) {
    let (mask, crossings) = (of_ka(ka), crossings([0.0, 60.0]));
    bencher.counter(ItemsCount::new(crossings.len())).bench_local(|| {
        crossings.iter().map(|c| mask.intensity(black_box(c), &OCTAVE, Jambs::Rigid, TOLERANCE).value).sum::<f64>()
    });
}

#[divan::bench(args = [1.0, 8.0, 14.0, 40.0, 100.0])]
fn levels_along_the_screen(bencher: Bencher, ka: f64) {
    let (mask, crossings) = (of_ka(ka), crossings([75.0, 85.0]));
    let tables = BandApertures::new(&mask, 0.0, &OCTAVE, 1.0);
    bencher.counter(ItemsCount::new(crossings.len())).bench_local(|| {
        let solved = Solved { apertures: &tables, lit: None };
        let level = |c: &Crossing| intensity(&mask, 0.0, black_box(c), &OCTAVE, || Some(solved), TOLERANCE).value;
        crossings.iter().map(level).sum::<f64>()
    });
}

#[divan::bench(args = [0.1, 1.0, 5.0, 10.0])]
fn exact_apertures(bencher: Bencher, ka: f64) {
    let (mask, crossings) = (of_ka(ka), crossings([0.0, 60.0]));
    let tables = BandApertures::new(&mask, 0.0, &OCTAVE, 1.0);
    bencher
        .counter(ItemsCount::new(crossings.len()))
        .bench_local(|| crossings.iter().map(|c| tables.intensity(&mask, black_box(c)).value).sum::<f64>());
}

/// One thin or deep (0.1 m) opening, or two of them, with k times width `ka` at 1 kHz; source and probes up to 60 degrees off.
#[derive(Debug)]
struct Scene {
    kind: &'static str,
    ka: f64,
    probes: usize,
}

impl Scene {
    fn mask(&self) -> (Mask, f64) {
        let a = 2.0 * self.ka / (OCTAVE.low_k() + OCTAVE.high_k());
        match self.kind {
            "two" => (Mask::new(&[[-2.5 * a, -1.5 * a], [1.5 * a, 2.5 * a]]), 0.0),
            "deep" => (slit(a), 0.1),
            _ => (slit(a), 0.0),
        }
    }

    fn crossings(&self) -> Vec<Crossing> {
        let incident = Incident::Line { x_m: -1.2, z_m: 3.1 };
        crossings([0.0, 60.0]).iter().cycle().take(self.probes).map(|c| Crossing { incident, ..*c }).collect()
    }
}

const SCENES: [Scene; 14] = {
    const fn of(kind: &'static str, ka: f64, probes: usize) -> Scene {
        Scene { kind, ka, probes }
    }
    [
        of("thin", 0.1, 1),
        of("thin", 0.1, 10),
        of("thin", 0.1, 100),
        of("thin", 1.0, 100),
        of("thin", 10.0, 100),
        of("thin", 100.0, 100),
        of("deep", 0.1, 1),
        of("deep", 0.1, 100),
        of("deep", 1.0, 100),
        of("deep", 10.0, 100),
        of("two", 0.1, 1),
        of("two", 0.1, 100),
        of("two", 1.0, 100),
        of("two", 5.0, 100),
    ]
};

/// Eight octaves, the source's part included, with the tables in place.
#[divan::bench(args = SCENES)]
fn levels_with_tables(bencher: Bencher, scene: &Scene) {
    let ((mask, thickness_m), crossings, bands) = (scene.mask(), scene.crossings(), octaves());
    let tables = SlitTables::new(mask, thickness_m, &bands);
    let level = |c: &Crossing| -> f64 {
        let lit = tables.source(c);
        let of_band = |(i, band)| {
            intensity(tables.mask(), thickness_m, c, band, || Some(tables.band(i, &lit, &c.incident)), TOLERANCE).value
        };
        bands.iter().enumerate().map(of_band).sum()
    };
    crossings.iter().for_each(|c| {
        black_box(level(c));
    });
    bencher.counter(ItemsCount::new(8 * crossings.len())).bench_local(|| {
        tables.forget_sources();
        crossings.iter().map(|c| level(black_box(c))).sum::<f64>()
    });
}

/// The same by the uniform theory of diffraction (which knows thin screens only).
#[divan::bench(args = SCENES)]
fn the_same_by_uniform_theory(bencher: Bencher, scene: &Scene) {
    let ((mask, _), crossings, bands) = (scene.mask(), scene.crossings(), octaves());
    let level = |c: &Crossing| -> f64 {
        let rays = OpeningRays::new(mask.openings(), c);
        let mean = |band: &Spectrum| {
            let nodes = band_nodes(band, rays.detour_m());
            nodes.iter().map(|(k, weight)| weight * rays.pressure(*k).norm_sqr()).sum::<f64>()
        };
        bands.iter().map(mean).sum()
    };
    bencher
        .counter(ItemsCount::new(8 * crossings.len()))
        .bench_local(|| crossings.iter().map(|c| level(black_box(c))).sum::<f64>());
}

#[divan::bench(args = [1.0, 14.0, 100.0], sample_count = 3, sample_size = 1)]
fn referee(bencher: Bencher, ka: f64) {
    let (mask, crossing) = (of_ka(ka), crossings([0.0, 60.0])[0]);
    bencher
        .counter(ItemsCount::new(1usize))
        .bench_local(|| exact_intensity(&mask, 0.0, black_box(&crossing), &OCTAVE).value);
}

fn octaves() -> [Spectrum; 8] {
    std::array::from_fn(|i| {
        let centre = 62.5 * f64::powi(2.0, i as i32);
        Spectrum { low_hz: centre / 2f64.sqrt(), high_hz: centre * 2f64.sqrt(), speed_m_s: 343.0 }
    })
}

fn tables(mask: &Mask, thickness_m: f64) -> Vec<BandApertures> {
    let of_band = |spectrum: &Spectrum| {
        let tables = BandApertures::new(black_box(mask), thickness_m, spectrum, 1.0);
        // The waves about the openings are made for the first source.
        black_box(tables.light(&Incident::Line { x_m: -1.0, z_m: 4.0 }));
        tables
    };
    octaves().iter().map(of_band).collect()
}

#[divan::bench(args = [0.005, 0.1, 0.3, 0.9], sample_count = 5, sample_size = 1)]
fn tables_of_a_gap_in_a_wall_of_0_1_m(bencher: Bencher, width_m: f64) {
    let mask = slit(width_m);
    bencher.bench_local(|| tables(&mask, 0.1));
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn tables_of_twenty_slats(bencher: Bencher) {
    let gaps: Vec<[f64; 2]> = (0..21).map(|i| [0.1 * f64::from(i), 0.1 * f64::from(i) + 0.05]).collect();
    let mask = Mask::new(&gaps);
    bencher.bench_local(|| tables(&mask, 0.0));
}

fn main() {
    divan::main();
}
