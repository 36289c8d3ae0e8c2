//! Noise that keeps its level in narrow bands.
//!
//! Over a period of its width a band of Gaussian noise swells and fades, and a decay made of it carries that: decay times from a single
//! response would be off by 10 % at 125 Hz. Low-noise noise (Pumplin 1985) has the constant envelope of a frequency-modulated tone
//! instead. It is found as Kohlrausch and others (1997) do: the envelope is divided by its modulus, what that scatters out of the band is
//! filtered off, and so on; here as the analysis filters see it, neighbours included.

use realfft::num_complex::Complex64;
use rustfft::FftPlanner;

use super::envelope::BandFilter;
use crate::scene::Band;

/// Bands wider than this (in Hz) are steady enough as they are, and fine enough in time to tell single reflections.
const WIDEST_HZ: f64 = 800.0;
/// Rounds over all bands.
const ROUNDS: usize = 10;

/// The filters of the narrow ones of `bands`, for spectra of `grid` samples.
pub(super) fn narrow(bands: &[Band], sample_rate_hz: f64, grid: usize) -> Vec<BandFilter> {
    let mut fast = FftPlanner::new();
    let narrow = bands.iter().filter(|band| band.high_hz - band.low_hz < WIDEST_HZ);
    narrow.filter_map(|band| BandFilter::new(band, sample_rate_hz, grid, &mut fast)).collect()
}

/// Makes noise with this spectrum, whose bins have the `amplitudes` in the mean, steady behind the `filters`.
pub(super) fn steady(spectrum: &mut [Complex64], amplitudes: &[f64], filters: &[BandFilter]) {
    let moduli: Vec<f64> = filters.iter().map(|filter| filter.modulus(amplitudes)).collect();
    for _ in 0..ROUNDS {
        for (filter, modulus) in filters.iter().zip(&moduli) {
            let mut change = filter.envelope(spectrum);
            for z in &mut change {
                *z *= modulus / z.norm_sqr().sqrt().max(f64::MIN_POSITIVE) - 1.0;
            }
            filter.add(change, spectrum);
        }
    }
}
