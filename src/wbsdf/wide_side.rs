//! What the edges of a wide opening do not know of one of its sides, found by the slit of that width solved exactly.
//!
//! In a thick wall the faces inside, its reveals, reflect: oblique sound is heard off them where the edges of a thin wall leave a
//! shadow (up to 30 dB louder), and it is missing where it goes straight through a thin one. In a thin wall sound that runs along
//! the opening crosses it more than twice. Across each side that is the ratio of the intensities which a slit of that width (aperture.rs,
//! thick.rs) and its two edges (two_edges.rs) pass, both sides between source and receiver at the distances that the shortest way has when it is
//! unfolded.
//!
//! Of sides through thick walls only the part about the shortest way is solved, at few wave numbers; all of them as waves about it (multipole.rs).

use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::Mask;
use super::multipole::nearness;
use super::series::Panels;
use super::slit::{BandApertures, exact_share, fade};
use super::timed::Timed;
use super::two_edges::two_edges;

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

/// Distances from the middle of a side, in half widths, between which a place is near.
const NEAR: [f64; 2] = [1.5, 3.0];

/// One wide side of an opening in one band.
pub(super) struct WideSide {
    limits_m: [f64; 2],
    mask: Mask,
    spectrum: Spectrum,
    /// Share of the depth, and the side through the thick wall.
    deep: f64,
    reveals: Option<Reveals>,
    thin: Timed<BandApertures>,
}

/// A part of a side through a thick wall, as a slit about 0.
struct Reveals {
    part: Mask,
    thickness_m: f64,
    solved: BandApertures,
}

impl WideSide {
    /// The side with the finite limits `limits_m` in a wall of `thickness_m`, which has the share `deep` of the intensity; a thin one
    /// has the rest.
    pub(super) fn new(limits_m: [f64; 2], (deep, thickness_m): (f64, f64), spectrum: &Spectrum) -> Self {
        let reveals = (deep > 0.0).then(|| Reveals::new(limits_m[1] - limits_m[0], thickness_m, spectrum));
        let mask = Mask::new(&[limits_m]);
        Self { limits_m, mask, spectrum: *spectrum, deep, reveals, thin: Timed::default() }
    }

    /// What the intensity that its edges send for `crossing`, whose shortest way leads over `over_m`, is to be multiplied by.
    pub(super) fn ratio(&self, over_m: f64, crossing: &Crossing) -> f64 {
        let deep = self.reveals.as_ref().map_or(1.0, |r| r.ratio(self.limits_m, over_m, crossing, &self.spectrum));
        let thin = if self.deep < 1.0 { self.along(crossing) } else { 1.0 };
        self.deep * deep + (1.0 - self.deep) * thin
    }

    /// The same in a thin wall: 1 but for sound that runs along the opening, where it is not too wide.
    fn along(&self, crossing: &Crossing) -> f64 {
        let share = exact_share(&self.mask, crossing, &self.spectrum) * self.away(crossing);
        if share == 0.0 {
            return 1.0;
        }
        let solved = self.thin.get_or_make(|| BandApertures::new(&self.mask, 0.0, &self.spectrum, 1.0).prepared());
        share * over_edges(solved, &self.mask, 0.0, crossing, &self.spectrum) + 1.0 - share
    }

    /// 1 where source and receiver are away from the side, 0 where one is near, smooth between: there its edges have what runs along
    /// it, and its two edges as a slit do not.
    fn away(&self, crossing: &Crossing) -> f64 {
        let Incident::Line { x_m, z_m } = crossing.incident else { return 0.0 };
        let [low, high] = self.limits_m;
        let from_middle = |x: f64, z: f64| (x - 0.5 * (low + high)).hypot(z) / (0.5 * (high - low));
        1.0 - fade(from_middle(x_m, z_m).min(from_middle(crossing.x_m, crossing.z_m)), NEAR)
    }

    /// Seconds that its thin slit took.
    pub(super) fn seconds(&self) -> f64 {
        self.thin.seconds()
    }
}

impl Reveals {
    fn new(width_m: f64, thickness_m: f64, spectrum: &Spectrum) -> Self {
        let (low, high) = (spectrum.low_k(), spectrum.high_k());
        let part_m = (2.0 * PART_KA / (low + high)).max(PART_DEPTHS * thickness_m).min(width_m);
        let part = Mask::new(&[[-0.5 * part_m, 0.5 * part_m]]);
        let octave = (OCTAVE_KA / (0.5 * (low + high) * part_m)).clamp(LEAST_OF_OCTAVE, MOST_OF_OCTAVE);
        let count = if high > low { (octave * (high / low).log2()).max(LEAST).round() as usize } else { 1 };
        let nodes = Panels::even([low, high], count).nodes();
        let solved = BandApertures::at(&part, thickness_m, nodes.into_iter()).prepared();
        Self { part, thickness_m, solved }
    }

    /// The ratio of the part that is nearest to the shortest way within the side's limits.
    fn ratio(&self, [low, high]: [f64; 2], over_m: f64, crossing: &Crossing, spectrum: &Spectrum) -> f64 {
        let Incident::Line { x_m, z_m } = crossing.incident else { return 1.0 };
        let half_m = self.part.openings()[0][1];
        let middle =
            if half_m < 0.5 * (high - low) { over_m.clamp(low + half_m, high - half_m) } else { 0.5 * (low + high) };
        let incident = Incident::Line { x_m: x_m - middle, z_m };
        let crossing = Crossing { incident, x_m: crossing.x_m - middle, z_m: crossing.z_m };
        // Way off both edges of the side those of the part are nearer than they.
        let apart_m = (over_m - low).min(high - over_m);
        let felt = if apart_m > half_m { half_m / apart_m } else { 1.0 };
        1.0 + felt * (over_edges(&self.solved, &self.part, self.thickness_m, &crossing, spectrum) - 1.0)
    }
}

/// The intensity of the slit `mask` over what its two edges send through a thin wall.
fn over_edges(solved: &BandApertures, mask: &Mask, thickness_m: f64, crossing: &Crossing, spectrum: &Spectrum) -> f64 {
    let reach = nearness(mask.openings(), thickness_m, (crossing.x_m, crossing.z_m));
    let exact = solved.intensity_of(solved.light_for(&crossing.incident, reach).as_ref(), mask, crossing).value;
    let edges = two_edges(mask.openings()[0], crossing, spectrum).value;
    if edges > 0.0 { exact / edges } else { 1.0 }
}
