//! What the depth of a wall changes of the sound that passes the edges of a wide opening.
//!
//! The faces inside an opening, its reveals, reflect: oblique sound is heard off them where the edges of a thin wall leave a shadow
//! (up to 30 dB louder), and it is missing where it goes straight through a thin one. Across each side that is the ratio of the
//! intensities which a slit of that width passes with its depth (thick.rs) and without (aperture.rs), both exact; both sides
//! between source and receiver at the distances that the shortest way has when it is unfolded.
//!
//! Of wide sides only the part about the shortest way is solved, at few wave numbers, as waves about it (multipole.rs).

use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::Mask;
use super::multipole::nearness;
use super::slit::{BandApertures, gauss_nodes};

/// k times the width of the part of a side that is solved, and its width in depths: the greater one counts. Found by trial: half of
/// the first adds 0.3 dB at the 90th percentile of the error behind tall openings, half of the other a tenth of a decibel.
const PART_KA: f64 = 80.0;
const PART_DEPTHS: f64 = 4.0;
/// Wave numbers of an octave; narrower bands have their share, from [`LEAST`] on. Twice as many take twice the time and leave
/// 0.7 instead of 0.9 dB (90th percentile). The same for all widths, so that none makes a step.
const WAVE_NUMBERS: f64 = 8.0;
const LEAST: f64 = 4.0;

/// One side of an opening through a wall, solved in one band.
pub(super) struct Reveals {
    limits_m: [f64; 2],
    /// The part as a slit about 0, with the wall's depth and without.
    part: Mask,
    thickness_m: f64,
    deep: BandApertures,
    thin: BandApertures,
}

impl Reveals {
    /// The side with the finite limits `limits_m` through a wall of `thickness_m` > 0.
    pub(super) fn new(limits_m: [f64; 2], thickness_m: f64, spectrum: &Spectrum) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let part_m = (2.0 * PART_KA / (low + high)).max(PART_DEPTHS * thickness_m);
        let width_m = part_m.min(limits_m[1] - limits_m[0]);
        let part = Mask::new(&[[-0.5 * width_m, 0.5 * width_m]]);
        let count = if high > low { (WAVE_NUMBERS * (high / low).log2()).max(LEAST).round() as usize } else { 1 };
        let solved = |thickness_m| BandApertures::at(&part, thickness_m, gauss_nodes(low, high, count)).prepared();
        Self { limits_m, thickness_m, deep: solved(thickness_m), thin: solved(0.0), part }
    }

    /// What the depth multiplies the intensity of `crossing` by, across this side, whose shortest way leads over `over_m`.
    pub(super) fn ratio(&self, over_m: f64, crossing: &Crossing) -> f64 {
        let Incident::Line { x_m, z_m } = crossing.incident else { return 1.0 };
        let ([low, high], half_m) = (self.limits_m, self.part.openings()[0][1]);
        let middle =
            if half_m < 0.5 * (high - low) { over_m.clamp(low + half_m, high - half_m) } else { 0.5 * (low + high) };
        let incident = Incident::Line { x_m: x_m - middle, z_m };
        let crossing = Crossing { incident, x_m: crossing.x_m - middle, z_m: crossing.z_m };
        let reach = nearness(self.part.openings(), self.thickness_m, (crossing.x_m, crossing.z_m));
        let passed = |slit: &BandApertures| {
            slit.intensity_of(slit.light_for(&crossing.incident, reach).as_ref(), &self.part, &crossing).value
        };
        let (deep, thin) = (passed(&self.deep), passed(&self.thin));
        if thin > 0.0 { deep / thin } else { 1.0 }
    }
}
