//! Room-acoustic parameters and the speech transmission index of a rendered response, as one would measure them.
//!
//! Band filters have no phase, so that nothing is delayed, and narrow flanks beyond which they pass nothing: where the level falls
//! steeply from band to band, the skirts of a Butterworth filter of order 6 let a band hear its neighbour's later decay (T30 up to
//! 7 % too long). They keep the limits of IEC 61260-1:2014 class 1: half the power at the edges, and at three quarters of the way
//! to them less than 0.2 dB lost.

use std::ops::Range;

use realfft::num_complex::Complex64;

use super::energy::EnergyCurve;
use super::metrics::{Metrics, of_curve};
use super::transform::Transform;
use super::{Response, earliest_shift_s};
use crate::probe::Reception;
use crate::scene::{Band, Spacing, bands_between};

/// Silence in s about the response in which filters ring.
const RINGING_S: f64 = 0.5;
/// Half width of a filter's flank in Hz, where that lies within [`FLANK_SHARES`]: rings for some 20 ms.
const FLANK_HZ: f64 = 25.0;
/// Narrowest and widest half width of a flank, as shares of the band's width in octaves.
const FLANK_SHARES: [f64; 2] = [1.0 / 48.0, 1.0 / 6.0];
/// Modulation frequencies of the speech transmission index in Hz (IEC 60268-16:2011, 4.2).
const MODULATION_HZ: [f64; 14] = [0.63, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0, 10.0, 12.5];
/// Weights of the octaves 125 Hz to 8 kHz for male speech, and of neighbours' redundancy (IEC 60268-16:2011, table A.1).
const MALE: ([f64; 7], [f64; 6]) =
    ([0.085, 0.127, 0.230, 0.233, 0.309, 0.224, 0.173], [0.085, 0.078, 0.065, 0.011, 0.047, 0.095]);
/// Threshold of reception of the same octaves in dB re 20 uPa (IEC 60268-16:2011, table A.3).
const RECEPTION_DB: [f64; 7] = [46.0, 27.0, 12.0, 6.5, 7.5, 8.0, 12.0];

/// The parameters of the rendered response of `reception`, one entry a band; time 0 is the reception's first arrival.
/// Bands that reach beyond half the sample rate have none.
pub fn response_metrics(reception: &Reception, response: &Response, bands: &[Band]) -> Vec<Metrics> {
    let curves = (0..bands.len()).map(|b| EnergyCurve::new(reception, b));
    let starts: Vec<Option<f64>> = curves.map(|c| c.first_arrival_s()).collect();
    let traced = reception.echogram.is_some();
    let shift_s = earliest_shift_s(reception);
    let measured = Measured::new(response);
    let one = |(band, start): (&Band, Option<f64>)| {
        let start_s = start? + shift_s;
        let energy = measured.energy(band)?;
        let sum: f64 = energy.iter().sum();
        // A band-pass rings before the sound too: that energy arrives with it.
        let first = ((start_s * measured.rate_hz) as usize).min(energy.len());
        let before: f64 = energy[..first].iter().sum();
        let mut bins = energy;
        bins[..first].fill(0.0);
        // To the scale of relative intensities: the mean of |H|^2 over the band.
        let scale = measured.unit(band);
        bins.iter_mut().for_each(|e| *e *= scale);
        let arrivals = vec![(start_s, before * scale)];
        (sum > 0.0)
            .then(|| of_curve(EnergyCurve::of_parts(arrivals, bins, 1.0 / measured.rate_hz), band.nominal_hz, traced))
    };
    bands.iter().zip(starts).map(|b| one(b).unwrap_or_else(|| Metrics::silent(b.0.nominal_hz))).collect()
}

/// Speech transmission index 0..=1 (IEC 60268-16:2011, full, male) of a response at a signal-to-noise ratio in dB that holds in
/// every octave; `None` if the response does not reach 8 kHz or an octave from 125 Hz on is silent. `speech_db`: levels of the speech
/// in the octaves 125 Hz to 8 kHz in dB re 20 uPa (see [`octave_levels_db`]); without them masking and threshold are left out.
///
/// Modulation transfer by Schroeder (1981): m(F) = |int h^2 exp(-i 2 pi F t) dt| / int h^2 dt, times I_s / (I_s + I_n + I_m + I_t):
/// intensities of speech, of noise, of what the octave below masks, and of the threshold of reception (A.4.2, A.4.3).
pub fn speech_transmission_index(
    response: &Response,
    signal_to_noise_db: f64,
    speech_db: Option<[f64; 7]>,
) -> Option<f64> {
    let measured = Measured::new(response);
    // Modulation is slow: samples are taken together in milliseconds, which changes m by 3e-4 at most.
    let group = (0.001 * measured.rate_hz).ceil() as usize;
    let mut octaves = Vec::new();
    for band in bands_between(Spacing::Octave, 125.0, 8000.0) {
        let energy = measured.energy(&band)?;
        let sum: f64 = energy.iter().sum();
        if sum <= 0.0 {
            return None;
        }
        octaves.push(energy.chunks(group).map(|e| e.iter().sum::<f64>() / sum).collect::<Vec<f64>>());
    }
    let noise = 10f64.powf(-0.1 * signal_to_noise_db);
    let heard: [f64; 7] = std::array::from_fn(|k| {
        let Some(speech_db) = speech_db else { return 1.0 / (1.0 + noise) };
        let total = |k: usize| (1.0 + noise) * 10f64.powf(0.1 * speech_db[k]);
        let masking =
            if k > 0 { total(k - 1) * 10f64.powf(0.1 * masking_db(10.0 * total(k - 1).log10())) } else { 0.0 };
        10f64.powf(0.1 * speech_db[k]) / (total(k) + masking + 10f64.powf(0.1 * RECEPTION_DB[k]))
    });
    let transfer: Vec<f64> = octaves
        .iter()
        .zip(heard)
        .map(|(energy, heard)| {
            let index = |hz: f64| {
                let turn = Complex64::cis(-std::f64::consts::TAU * hz * group as f64 / measured.rate_hz);
                let (mut phase, mut sum) = (Complex64::new(1.0, 0.0), Complex64::ZERO);
                for e in energy {
                    sum += phase * e;
                    phase *= turn;
                }
                let m = (sum.norm() * heard).min(1.0);
                let apparent_db = 10.0 * (m / (1.0 - m)).log10();
                (apparent_db.clamp(-15.0, 15.0) + 15.0) / 30.0
            };
            MODULATION_HZ.map(index).iter().sum::<f64>() / MODULATION_HZ.len() as f64
        })
        .collect();
    let (alpha, beta) = MALE;
    let own: f64 = alpha.iter().zip(&transfer).map(|(a, m)| a * m).sum();
    let shared: f64 = beta.iter().zip(transfer.windows(2)).map(|(b, m)| b * (m[0] * m[1]).sqrt()).sum();
    Some((own - shared).clamp(0.0, 1.0))
}

/// Level in dB of what masks an octave, re the level `below_db` of the octave below it (IEC 60268-16:2011, table A.2).
fn masking_db(below_db: f64) -> f64 {
    match below_db {
        l if l < 63.0 => 0.5 * l - 65.0,
        l if l < 67.0 => 1.8 * l - 146.9,
        l if l < 100.0 => 0.5 * l - 59.8,
        _ => -10.0,
    }
}

/// Levels of a reception in the octaves 125 Hz to 8 kHz in dB re 20 uPa, from those of the source's free field at 1 m, one a band of
/// `bands`; `None` if these do not cover the octaves.
pub fn octave_levels_db(reception: &Reception, bands: &[Band], at_1m_db: &[f64]) -> Option<[f64; 7]> {
    let octave = |octave: Band| {
        let inside = |band: &Band| (octave.low_hz..octave.high_hz).contains(&(band.low_hz * band.high_hz).sqrt());
        let levels = reception.levels.iter().zip(at_1m_db);
        let (mut energy, mut covered_hz) = (0.0, 0.0);
        for (band, (level, at_1m_db)) in bands.iter().zip(levels).filter(|(band, _)| inside(band)) {
            energy += level.intensity * 10f64.powf(0.1 * at_1m_db);
            covered_hz += band.high_hz - band.low_hz;
        }
        let covered = covered_hz > 0.95 * (octave.high_hz - octave.low_hz);
        (covered && energy > 0.0).then(|| 10.0 * energy.log10())
    };
    let levels: Option<Vec<f64>> = bands_between(Spacing::Octave, 125.0, 8000.0).into_iter().map(octave).collect();
    levels?.try_into().ok()
}

/// A response and its spectrum.
struct Measured {
    rate_hz: f64,
    length: usize,
    transform: Transform,
    spectrum: Vec<Complex64>,
}

impl Measured {
    fn new(response: &Response) -> Self {
        let rate_hz = f64::from(response.sample_rate_hz);
        let length = response.samples.len();
        let transform = Transform::new(length + (RINGING_S * rate_hz) as usize);
        let spectrum = transform.spectrum(response.samples.iter().map(|s| f64::from(*s)).collect());
        Self { rate_hz, length, transform, spectrum }
    }

    /// The bins that a band's filter passes, with |F|^2.
    fn filter(&self, band: &Band) -> impl Iterator<Item = (usize, f64)> {
        let step_hz = self.rate_hz / self.transform.length() as f64;
        passed(band, step_hz, self.spectrum.len()).map(move |k| (k, pass(band, k as f64 * step_hz)))
    }

    /// Energy of each sample in a band; what rings beyond the end counts with the last, and before 0 with the first one.
    fn energy(&self, band: &Band) -> Option<Vec<f64>> {
        if band.high_hz > 0.49 * self.rate_hz {
            return None;
        }
        let mut filtered = vec![Complex64::ZERO; self.spectrum.len()];
        for (k, power) in self.filter(band) {
            filtered[k] = self.spectrum[k] * power.sqrt();
        }
        let mut energy: Vec<f64> = self.transform.samples(&mut filtered).iter().map(|x| x * x).collect();
        let before: f64 = energy[(self.length + energy.len()) / 2..].iter().sum();
        energy.truncate(self.length);
        energy[0] += before;
        Some(energy)
    }

    /// From a band's energy to the mean of |H|^2 as the filter sees it.
    fn unit(&self, band: &Band) -> f64 {
        let power: f64 = self.filter(band).map(|(_, power)| power).sum();
        self.transform.length() as f64 / (2.0 * power)
    }
}

/// Of `bins` frequencies `step_hz` apart, from 0 on, those that the analysis filter of `band` can pass.
pub(super) fn passed(band: &Band, step_hz: f64, bins: usize) -> Range<usize> {
    let flank = (band.high_hz / band.low_hz).powf(FLANK_SHARES[1]);
    let bin = |hz: f64| ((hz / step_hz).ceil() as usize).clamp(1, bins);
    bin(band.low_hz / flank)..bin(band.high_hz * flank)
}

/// |F|^2 at `hz` > 0 of the analysis filter of `band`: 1 inside, 0 outside, half a sine period across each flank.
pub(super) fn pass(band: &Band, hz: f64) -> f64 {
    let width = (band.high_hz / band.low_hz).ln();
    let rise = |inside: f64, edge_hz: f64| {
        let half = (FLANK_HZ / edge_hz).clamp(FLANK_SHARES[0] * width, FLANK_SHARES[1] * width);
        0.5 + 0.5 * (std::f64::consts::FRAC_PI_2 * (inside / half).clamp(-1.0, 1.0)).sin()
    };
    rise((hz / band.low_hz).ln(), band.low_hz) * rise((band.high_hz / hz).ln(), band.high_hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filters_keep_the_limits_of_class_1() {
        // IEC 61260-1:2014, table 1, class 1: distance from the centre in widths of the band, least and greatest
        // loss in dB.
        let limits = [
            (0.0, -0.4, 0.4),
            (0.125, -0.4, 0.5),
            (0.25, -0.4, 0.7),
            (0.375, -0.4, 1.4),
            (0.4999, -0.4, 5.3),
            (0.5001, 2.0, f64::INFINITY),
            (1.0, 16.6, f64::INFINITY),
            (2.0, 40.5, f64::INFINITY),
            (3.0, 60.0, f64::INFINITY),
            (4.0, 70.0, f64::INFINITY),
        ];
        for spacing in [Spacing::Octave, Spacing::ThirdOctave] {
            for band in bands_between(spacing, 31.5, 16_000.0) {
                let centre_hz = (band.low_hz * band.high_hz).sqrt();
                for (octaves, least, greatest) in limits {
                    for side in [-1.0, 1.0] {
                        let hz = centre_hz * (side * octaves * (band.high_hz / band.low_hz).log2()).exp2();
                        let loss_db = -10.0 * pass(&band, hz).log10();
                        assert!((least..=greatest).contains(&loss_db), "{band:?} {hz}: {loss_db}");
                    }
                }
            }
        }
    }
}
