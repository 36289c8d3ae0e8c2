//! The course of the paths within the bands: what an opening or an edge passes changes from tone to tone, by interference of
//! its edges' waves, resonances of deep gaps, and the band's own absorption of air.
//!
//! The same paths are found again at the centres of finer bands, or as means over them where the centre may not tell, and scaled to the
//! intensities that are known.

use super::{Prepared, edge_reach};
use crate::geometry::{Geometry, Portal};
use crate::probe::{EarlyPath, Reception, TableCost};
use crate::scene::{Host, Scene, Spacing, Transport};
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::slit::resonances;

/// Parts an octave.
const PARTS: usize = 6;
/// Radians of phase, or nodes for resonances, over a part of a band up to which its centre tells it: the mean of the paths, each
/// as strong as it is, is then 0.1 dB off their means over the parts.
const EVEN: f64 = 3.0;
/// Share of the sum through an opening up to which the courses of its weakest ways are those of the rule for screens.
const ESTIMATED: f64 = 0.03;
/// Width of an opening in depths of its wall from which the course is that of a thin wall: its first resonance, half a wavelength deep,
/// has k times width 9, and hardly any of it comes back from the mouths.
const SHALLOW: f64 = 3.0;

/// Adds the courses within the bands to the paths of `receptions` (of all sources and probes of the scene, sources slowest) with at
/// most `reflection_order` reflections. Where nothing bends sound there are none, nor for tones.
/// Returns what the openings cost.
pub fn add_courses(
    scene: &Scene,
    geometry: &Geometry,
    reflection_order: usize,
    receptions: &mut [Reception],
) -> Vec<TableCost> {
    let parts = match scene.spacing {
        Spacing::Octave => PARTS,
        Spacing::ThirdOctave => PARTS / 3,
        Spacing::Tones => return Vec::new(),
    };
    let bends = !geometry.portals.is_empty() || edge_reach(scene, geometry).iter().any(|reach| reach.felt);
    if scene.simulation.diffraction_order == 0 || !bends {
        return Vec::new();
    }
    let mut fine = scene.divided(parts);
    let widths_hz: Vec<f64> = fine.bands.iter().map(|band| band.high_hz - band.low_hz).collect();
    for (host, wall) in fine.walls.iter_mut().enumerate() {
        let mut openings = geometry.portals.iter().filter(|p| scene.openings[p.opening].host == Host::Wall(host));
        if openings.all(|p| narrower_m(p) > SHALLOW * scene.gap_depth_m(&scene.openings[p.opening])) {
            wall.thickness_m = 0.0;
        }
    }
    for i in 0..fine.bands.len() {
        let spectrum = Spectrum::new(&fine.bands[i], fine.air.speed_of_sound_m_s);
        if geometry.portals.iter().all(|portal| is_even(&fine, geometry, portal, &spectrum)) {
            let band = &mut fine.bands[i];
            (band.low_hz, band.high_hz) = (band.nominal_hz, band.nominal_hz);
        }
    }
    fine.simulation.interference = false;
    if scene.simulation.transport == Transport::Exact {
        // As good, and it takes no minutes.
        fine.simulation.transport = Transport::Wbsdf;
    }
    let prepared = Prepared::new(&fine, geometry, reflection_order).estimating(ESTIMATED);
    for (reception, found) in receptions.iter_mut().zip(prepared.find()) {
        for path in &mut reception.paths {
            let same = |other: &&EarlyPath| {
                (other.delay_s - path.delay_s).abs() <= 1e-9 * path.delay_s.abs() && other.label == path.label
            };
            if let Some(other) = found.paths.iter().find(same) {
                path.course = scaled(&other.intensity, &path.intensity, &widths_hz);
            }
        }
    }
    prepared.costs()
}

/// Whether what an opening passes changes so little over a band that its centre tells it: the phases between its edges across, or
/// from it to others in its wall, and its resonances.
fn is_even(scene: &Scene, geometry: &Geometry, portal: &Portal, spectrum: &Spectrum) -> bool {
    let others = geometry.portals.iter().filter(|other| other.group == portal.group);
    let reach_m = others.map(|other| apart_m(other, portal)).fold(narrower_m(portal), f64::max);
    let depth_m = scene.gap_depth_m(&scene.openings[portal.opening]);
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    (high - low) * reach_m <= EVEN && resonances(&[[0.0, narrower_m(portal)]], depth_m, low, high) <= EVEN
}

/// Length in m of the narrower side.
fn narrower_m(portal: &Portal) -> f64 {
    (portal.x_m[1] - portal.x_m[0]).min(portal.y_m[1] - portal.y_m[0])
}

/// Distance in m between two openings of one wall.
fn apart_m(a: &Portal, b: &Portal) -> f64 {
    let between = |a: [f64; 2], b: [f64; 2]| (a[0].max(b[0]) - a[1].min(b[1])).max(0.0);
    between(a.x_m, b.x_m).hypot(between(a.y_m, b.y_m))
}

/// `course` over parts of bands that are `widths_hz` wide, with the white means over the bands that are `intensity`, flat where it has
/// none.
fn scaled(course: &[f64], intensity: &[f64], widths_hz: &[f64]) -> Vec<f64> {
    let parts = course.len() / intensity.len();
    let in_band = |((course, widths), wanted): ((&[f64], &[f64]), &f64)| {
        let mean = course.iter().zip(widths).map(|(e, width)| e * width).sum::<f64>() / widths.iter().sum::<f64>();
        course.iter().map(|e| if mean > 0.0 { wanted * e / mean } else { *wanted }).collect::<Vec<f64>>()
    };
    course.chunks(parts).zip(widths_hz.chunks(parts)).zip(intensity).flat_map(in_band).collect()
}
