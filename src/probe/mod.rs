//! What a probe hears: early paths, band echograms, band levels and their standard errors.
//!
//! Intensities are relative to the source's free field at 1 m (on the axis of its directivity): a point source
//! gives 1/r^2, a line source 1/r, a plane wave 1.

use glam::DVec3;

/// One deterministic path from a source to a probe.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct EarlyPath {
    /// What the sound did on its way, for people: "direct", "floor, door", ...
    pub label: String,
    /// Number of specular reflections.
    pub reflections: usize,
    /// Arrival time in s: shortest unfolded way over the speed of sound.
    pub delay_s: f64,
    /// Unit vector from the probe towards where the sound comes from.
    pub from: DVec3,
    /// Relative intensity, one a band, air and materials included; never negative.
    pub intensity: Vec<f64>,
    /// Numerical error of `intensity` (quadrature), one a band, same unit.
    pub error: Vec<f64>,
    /// The course within the bands: intensity in equal parts of every band ([`crate::scene::Band::parts`]), as many a band; the white
    /// mean over those of a band is its `intensity`. Empty where nobody has asked, or the path is none of the strongest.
    pub course: Vec<f64>,
}

/// What it took to solve openings exactly, once for all sources and probes.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TableCost {
    /// Name of the opening, or of those that act as one.
    pub opening: String,
    /// Frequencies at which they were solved, all bands.
    pub frequencies: usize,
    /// Seconds of one thread.
    pub seconds: f64,
}

impl TableCost {
    /// Adds `more` to those of the same openings in `all`.
    pub fn add(all: &mut Vec<Self>, more: Vec<Self>) {
        for cost in more {
            match all.iter_mut().find(|known| known.opening == cost.opening) {
                Some(known) => {
                    known.frequencies += cost.frequencies;
                    known.seconds += cost.seconds;
                }
                None => all.push(cost),
            }
        }
    }
}

/// Energy of the traced rays over time: relative intensity summed per bin.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Echogram {
    /// Bin width in s.
    pub bin_s: f64,
    /// `energy[band][bin]`; signed rays may make a bin negative.
    pub energy: Vec<Vec<f64>>,
    /// Standard error of each entry of `energy`, from the scatter of batches of rays; infinite for a single batch, empty where
    /// not known. Bins share their rays, so that these do not add up to `std_error`.
    pub bin_error: Vec<Vec<f64>>,
    /// Standard error of the sum over all bins, one a band.
    pub std_error: Vec<f64>,
    /// Reflections a second, divided by the square of the time since emission: 4 pi c^3/V in a room of the volume V, whatever its shape
    /// (Kuttruff, Room Acoustics, on image sources); `None` where there is no closed room.
    pub reflections_per_s3: Option<f64>,
}

/// Everything one probe received from one source.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Reception {
    /// Name of the source.
    pub source: String,
    /// Name of the probe.
    pub probe: String,
    /// Deterministic paths in order of arrival.
    pub paths: Vec<EarlyPath>,
    /// Traced rays; `None` where the plan traces none.
    pub echogram: Option<Echogram>,
    /// Total per band.
    pub levels: Vec<BandLevel>,
}

/// The level in one band with its error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct BandLevel {
    /// Nominal centre in Hz.
    pub band_hz: f64,
    /// Relative intensity (paths + echogram); may be 0.
    pub intensity: f64,
    /// Standard error of `intensity`: traced part (statistics) and deterministic part (quadrature) in quadrature.
    pub intensity_error: f64,
    /// Share of the deterministic paths in `intensity`, 0..=1.
    pub early_share: f64,
}

impl BandLevel {
    /// Level in dB re the free field at 1 m; negative infinity where nothing arrives.
    pub fn level_db(&self) -> f64 {
        if self.intensity > 0.0 { 10.0 * self.intensity.log10() } else { f64::NEG_INFINITY }
    }

    /// Standard error in dB, 10/ln(10) times the relative error; 0 where nothing arrives and nothing is uncertain.
    pub fn std_error_db(&self) -> f64 {
        if self.intensity > 0.0 {
            10.0 / std::f64::consts::LN_10 * self.intensity_error / self.intensity
        } else if self.intensity_error > 0.0 {
            f64::INFINITY
        } else {
            0.0
        }
    }
}
