//! The course of the strongest paths within the bands: what an opening or an edge passes changes from tone to tone, by interference of
//! its edges' waves, resonances of deep gaps, and the band's own absorption of air.
//!
//! The same paths are found again in finer bands, up to few reflections, and scaled to the intensities that are known.

use super::{Prepared, edge_reach};
use crate::geometry::Geometry;
use crate::probe::{EarlyPath, Reception, TableCost};
use crate::scene::{Band, Scene, Spacing, Transport};

/// Parts an octave.
const PARTS: usize = 6;
/// Most reflections on a path that is found again.
const ORDER: usize = 1;

/// Adds the courses within the bands to the paths of `receptions` (of all sources and probes of the scene, sources slowest) with at
/// most one of at most `reflection_order` reflections. Where nothing bends sound there are none, nor for tones.
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
    fine.simulation.interference = false;
    if scene.simulation.transport == Transport::Exact {
        // As good, and it takes no minutes.
        fine.simulation.transport = Transport::Wbsdf;
    }
    let prepared = Prepared::new(&fine, geometry, reflection_order.min(ORDER));
    let found = prepared.find();
    for (reception, found) in receptions.iter_mut().zip(found) {
        for path in &mut reception.paths {
            let same = |other: &&EarlyPath| {
                other.label == path.label && (other.delay_s - path.delay_s).abs() <= 1e-9 * path.delay_s.abs()
            };
            if let Some(other) = found.paths.iter().find(same) {
                path.course = scaled(&other.intensity, &path.intensity, &fine);
            }
        }
    }
    prepared.costs()
}

/// `course` with the white means over the bands that are `intensity`, flat where it has none.
fn scaled(course: &[f64], intensity: &[f64], fine: &Scene) -> Vec<f64> {
    let parts = course.len() / intensity.len();
    let in_band = |((course, bands), wanted): ((&[f64], &[Band]), &f64)| {
        let widths = || bands.iter().map(|band| band.high_hz - band.low_hz);
        let mean = course.iter().zip(widths()).map(|(e, width)| e * width).sum::<f64>() / widths().sum::<f64>();
        course.iter().map(|e| if mean > 0.0 { wanted * e / mean } else { *wanted }).collect::<Vec<f64>>()
    };
    course.chunks(parts).zip(fine.bands.chunks(parts)).zip(intensity).flat_map(in_band).collect()
}
