//! What the depth of a wall changes of the sound that passes the edges of a wide opening.
//!
//! The faces inside an opening, its reveals, reflect: oblique sound is heard off them where the edges of a thin wall leave a shadow
//! (up to 30 dB louder), and it is missing where it goes straight through a thin one. Across each side that is the ratio of the
//! intensities which a slit of that width passes with its depth, solved exactly (thick.rs), and without (slit.rs); both sides
//! between source and receiver at the distances that the shortest way has when it is unfolded.
//!
//! Of wide sides only the part about the shortest way is solved, at few wave numbers, as waves about it (multipole.rs).

use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::Mask;
use super::multipole::nearness;
use super::series::Panels;
use super::slit::{BandApertures, intensity};
use super::tables::Solved;
use super::timed::Timed;

/// k times the width of the part of a side that is solved, and its width in depths: the greater one counts. Found by trial: 80 adds
/// 0.2 dB at the 90th percentile of the error behind tall openings, half of the other a tenth of a decibel.
const PART_KA: f64 = 120.0;
const PART_DEPTHS: f64 = 4.0;
/// Wave numbers of an octave, evenly spaced, times k times the width of the part, their least and their most: the narrower a gap,
/// the more it resonates and the sooner it is solved. 8 leave levels 1 dB off (90th percentile), these 0.05 to 0.25 dB. Narrower
/// bands have their share, from [`LEAST`] on.
const OCTAVE_KA: f64 = 900.0;
const LEAST_OF_OCTAVE: f64 = 20.0;
const MOST_OF_OCTAVE: f64 = 48.0;
const LEAST: f64 = 8.0;
/// Relative accuracy of the sums over signed rays.
const TOLERANCE: f64 = 1e-3;

/// One side of an opening through a wall, solved in one band.
pub(super) struct Reveals {
    limits_m: [f64; 2],
    /// The part as a slit about 0.
    part: Mask,
    thickness_m: f64,
    spectrum: Spectrum,
    /// The part with the wall's depth, and without where it is narrow.
    deep: BandApertures,
    thin: Timed<BandApertures>,
}

impl Reveals {
    /// The side with the finite limits `limits_m` through a wall of `thickness_m` > 0.
    pub(super) fn new(limits_m: [f64; 2], thickness_m: f64, spectrum: &Spectrum) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let part_m = (2.0 * PART_KA / (low + high)).max(PART_DEPTHS * thickness_m);
        let width_m = part_m.min(limits_m[1] - limits_m[0]);
        let part = Mask::new(&[[-0.5 * width_m, 0.5 * width_m]]);
        let octave = (OCTAVE_KA / (0.5 * (low + high) * width_m)).clamp(LEAST_OF_OCTAVE, MOST_OF_OCTAVE);
        let count = if high > low { (octave * (high / low).log2()).max(LEAST).round() as usize } else { 1 };
        let nodes = Panels::even([low, high], count).nodes();
        let deep = BandApertures::at(&part, thickness_m, nodes.into_iter()).prepared();
        Self { limits_m, part, thickness_m, spectrum: *spectrum, deep, thin: Timed::default() }
    }

    /// What the depth multiplies the intensity of `crossing` by, across this side, whose shortest way leads over `over_m`.
    pub(super) fn ratio(&self, over_m: f64, crossing: &Crossing) -> f64 {
        let Incident::Line { x_m, z_m } = crossing.incident else { return 1.0 };
        let ([low, high], half_m) = (self.limits_m, self.part.openings()[0][1]);
        let middle =
            if half_m < 0.5 * (high - low) { over_m.clamp(low + half_m, high - half_m) } else { 0.5 * (low + high) };
        let incident = Incident::Line { x_m: x_m - middle, z_m };
        let crossing = Crossing { incident, x_m: crossing.x_m - middle, z_m: crossing.z_m };
        let lit = self.deep.light_for(
            &crossing.incident,
            nearness(self.part.openings(), self.thickness_m, (crossing.x_m, crossing.z_m)),
        );
        let deep = self.deep.intensity_of(lit.as_ref(), &self.part, &crossing).value;
        let thin = intensity(&self.part, 0.0, &crossing, &self.spectrum, || Some(self.thin()), TOLERANCE).value;
        // Way off both edges of the side those of the part are nearer than they.
        let apart_m = (over_m - low).min(high - over_m);
        let felt = if apart_m > half_m { half_m / apart_m } else { 1.0 };
        if thin > 0.0 { 1.0 + felt * (deep / thin - 1.0) } else { 1.0 }
    }

    fn thin(&self) -> Solved<'_> {
        let new = || BandApertures::new(&self.part, 0.0, &self.spectrum, 1.0);
        Solved { apertures: self.thin.get_or_make(new), lit: None }
    }
}
