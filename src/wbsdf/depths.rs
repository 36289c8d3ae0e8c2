//! The exact rectangle as deep as its wall counts: thin, deep, or a share of both in between.

use std::f64::consts::PI;

use glam::DVec3;
use num_complex::Complex64;

use super::crossing::Spectrum;
use super::hatch::{Driven, Hatch, View};
use super::rim::gap_panels;
use super::series::Panels;
use super::thick::blended;

/// A rectangle solved at the depths that count, each with its share of the intensity.
pub(super) struct Depths(Vec<Depth>);

struct Depth {
    share: f64,
    hatch: Hatch,
    panels: Panels,
}

impl Depths {
    /// The opening `x_m` by `y_m` (finite limits in m) at `depths`: shares, which sum to 1, depths in m (0: thin), and the number of
    /// wave numbers; `None`: as many as it asks for.
    pub(super) fn new(x_m: [f64; 2], y_m: [f64; 2], depths: &[(f64, f64, Option<usize>)], spectrum: &Spectrum) -> Self {
        let depth = |&(share, depth_m, count): &(f64, f64, Option<usize>)| {
            let panels = match count {
                Some(count) => Panels::even([spectrum.low_k(), spectrum.high_k()], count),
                None => wave_numbers(x_m[1] - x_m[0], y_m[1] - y_m[0], depth_m, spectrum),
            };
            Depth { share, hatch: Hatch::new(x_m, y_m, depth_m, &panels.nodes()), panels }
        };
        Self(depths.iter().map(depth).collect())
    }

    /// Number of all its wave numbers.
    pub(super) fn frequencies(&self) -> usize {
        self.0.iter().map(|depth| depth.hatch.frequencies()).sum()
    }

    /// How it sees a point in its frame (in m, on either side), at each of the depths.
    pub(super) fn view(&self, point: DVec3) -> Vec<View> {
        self.0.iter().map(|depth| depth.hatch.view(point)).collect()
    }

    /// What a source in its frame drives in it, at each of the depths.
    pub(super) fn driven(&self, source: DVec3) -> Vec<Driven> {
        self.0.iter().map(|depth| depth.hatch.driven(&depth.hatch.view(source))).collect()
    }

    /// Band mean of the intensity at a receiver relative to the source's free field at 1 m.
    pub(super) fn intensity(&self, driven: &[Driven], seen: &[View]) -> f64 {
        let one =
            |((depth, driven), seen): ((&Depth, &Driven), &View)| depth.share * depth.hatch.intensity(driven, seen);
        self.0.iter().zip(driven).zip(seen).map(one).sum()
    }

    /// The pressure at any wave number of the band without the phase of a way `way_m` long.
    pub(super) fn envelope(
        &self,
        driven: &[Driven],
        seen: &[View],
        way_m: f64,
    ) -> impl Fn(f64) -> Complex64 + Send + Sync + use<> {
        let one = |((depth, driven), seen): ((&Depth, &Driven), &View)| {
            let pressures = depth.hatch.pressures(driven, seen).zip(depth.panels.nodes());
            let values = pressures.map(|(p, (k, _))| p * Complex64::from_polar(1.0, -k * way_m));
            (depth.share, depth.panels.through(&values.collect::<Vec<_>>()))
        };
        let all: Vec<_> = self.0.iter().zip(driven).zip(seen).map(one).collect();
        move |k| blended(all.iter().map(|(share, pressure)| (*share, pressure(k))))
    }
}

/// Wave numbers for the mean over a band through an opening of `width_m` by `height_m` and `depth_m`.
///
/// |p|^2 varies over the band like cos(k d), d at most twice the diagonal, and little of it beyond one and a half (octave levels are
/// within 0.002 dB). A mouth of area A sends back
/// 1 - k^2 A/pi of a wave in the gap (a piston's radiation), one that is wide across 1 - k a: so wide are the resonances.
fn wave_numbers(width_m: f64, height_m: f64, depth_m: f64, spectrum: &Spectrum) -> Panels {
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let (narrower, longer) = (width_m.min(height_m), width_m.max(height_m));
    let mouth = narrower.min(low * width_m * height_m / PI);
    gap_panels(0.35 * width_m.hypot(height_m) + 0.7 * depth_m, depth_m, ([narrower, longer], mouth), [low, high])
}
