//! What the depth of a wall changes of the sound that passes the edges of a wide opening.
//!
//! The faces inside an opening, its reveals, reflect: oblique sound is heard off them where the edges of a thin wall leave a shadow
//! (up to 30 dB louder), and it is missing where it goes straight through a thin one. Across each side that is the ratio of the
//! intensities which a slit of that width passes with its depth (thick.rs) and without (aperture.rs), both exact; both sides
//! between source and receiver at the distances that the shortest way has when it is unfolded.
//!
//! Of wide sides only the part about the shortest way is solved, and waves from jamb to jamb are met at few wave numbers.

use super::aperture::Aperture;
use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::Mask;
use super::slit::gauss_nodes;
use super::thick::ThickAperture;

/// k times the width of the part of a side that is solved, and its width in depths: the greater one counts. Found by trial: half of
/// the first adds 0.02 dB to the median error and 0.2 dB to the 90th percentile; the second keeps sound that crosses the gap in it.
const PART_KA: f64 = 100.0;
const PART_DEPTHS: f64 = 4.0;
/// Wave numbers of a narrow band, and how many more of an octave: more change levels by less than the form itself is wrong. The same for
/// all widths, so that none makes a step.
const WAVE_NUMBERS: f64 = 4.0;
const WAVE_NUMBERS_OCTAVE: f64 = 16.0;

/// One side of an opening through a wall, solved in one band.
pub(super) struct Reveals {
    limits_m: [f64; 2],
    half_m: f64,
    /// The part as a slit about 0, deep and thin, with weights.
    solved: Vec<(f64, ThickAperture, Aperture)>,
}

impl Reveals {
    /// The side with the finite limits `limits_m` through a wall of `thickness_m` > 0.
    pub(super) fn new(limits_m: [f64; 2], thickness_m: f64, spectrum: &Spectrum) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let part_m = (2.0 * PART_KA / (low + high)).max(PART_DEPTHS * thickness_m);
        let width_m = part_m.min(limits_m[1] - limits_m[0]);
        let slit = [[-0.5 * width_m, 0.5 * width_m]];
        let count =
            if high > low { (WAVE_NUMBERS + WAVE_NUMBERS_OCTAVE * (high / low).log2()).round() as usize } else { 1 };
        let solved =
            |(k, weight): (f64, f64)| (weight, ThickAperture::new(&slit, thickness_m, k), Aperture::new(&slit, k));
        let solved = gauss_nodes(low, high, count).map(solved).collect();
        Self { limits_m, half_m: 0.5 * width_m, solved }
    }

    /// What the depth multiplies the intensity of `crossing` by, across this side, whose shortest way leads over `over_m`.
    pub(super) fn ratio(&self, over_m: f64, crossing: &Crossing) -> f64 {
        let Incident::Line { x_m, z_m } = crossing.incident else { return 1.0 };
        let [low, high] = self.limits_m;
        let middle = if self.half_m < 0.5 * (high - low) {
            over_m.clamp(low + self.half_m, high - self.half_m)
        } else {
            0.5 * (low + high)
        };
        let incident = Incident::Line { x_m: x_m - middle, z_m };
        let crossing = Crossing { incident, x_m: crossing.x_m - middle, z_m: crossing.z_m };
        let sum = |(deep, thin): (f64, f64), (weight, with_depth, without): &(f64, ThickAperture, Aperture)| {
            let [of_deep, of_thin] = [with_depth.transfer(&crossing), without.transfer(&crossing)];
            (deep + weight * of_deep.norm_sqr(), thin + weight * of_thin.norm_sqr())
        };
        let (deep, thin) = self.solved.iter().fold((0.0, 0.0), sum);
        if thin > 0.0 { deep / thin } else { 1.0 }
    }
}

/// The reveals across `x` and across `y`, if both are one opening each.
pub(super) fn of_rectangle(x: &Mask, y: &Mask) -> [Option<[f64; 2]>; 2] {
    match (x.openings(), y.openings()) {
        ([x], [y]) => [*x, *y].map(|limits| limits.iter().all(|x| x.is_finite()).then_some(limits)),
        _ => [None, None],
    }
}
