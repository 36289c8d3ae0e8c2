//! The complex envelope of what passes a band's analysis filter, at the low rate that the band's width needs.

use std::ops::Range;
use std::sync::Arc;

use realfft::num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

use super::analysis::{pass, passed};
use super::transform::smooth_length;
use crate::scene::Band;

/// The analysis filter of a band on the bins of a transform.
pub(super) struct BandFilter {
    /// First bin that passes.
    first: usize,
    /// The filter's amplitude at each bin from there on.
    amplitudes: Vec<f64>,
    inverse: Arc<dyn Fft<f64>>,
    forward: Arc<dyn Fft<f64>>,
    /// From |z|^2 of the envelope to intensity.
    unit: f64,
}

impl BandFilter {
    /// For spectra of `grid` samples; `None` where the band reaches beyond half the sample rate.
    pub(super) fn new(band: &Band, sample_rate_hz: f64, grid: usize, fast: &mut FftPlanner<f64>) -> Option<Self> {
        if band.high_hz > 0.49 * sample_rate_hz {
            return None;
        }
        let step_hz = sample_rate_hz / grid as f64;
        let bins = passed(band, step_hz, grid / 2 + 1);
        let first = bins.start;
        let powers: Vec<f64> = bins.map(|k| pass(band, k as f64 * step_hz)).collect();
        let length = smooth_length(powers.len());
        Some(Self {
            first,
            inverse: fast.plan_fft_inverse(length),
            forward: fast.plan_fft_forward(length),
            unit: 1.0 / (length as f64 * powers.iter().sum::<f64>()),
            amplitudes: powers.iter().map(|p| p.sqrt()).collect(),
        })
    }

    /// Number of samples of an envelope.
    pub(super) fn length(&self) -> usize {
        self.inverse.len()
    }

    /// The envelope of what passes of a spectrum.
    pub(super) fn envelope(&self, spectrum: &[Complex64]) -> Vec<Complex64> {
        let mut values: Vec<Complex64> =
            spectrum[self.first..].iter().zip(&self.amplitudes).map(|(h, f)| h * f).collect();
        values.resize(self.length(), Complex64::ZERO);
        self.inverse.process(&mut values);
        values
    }

    /// Adds to a spectrum what an envelope brings through the filter; `change` is used up.
    pub(super) fn add(&self, mut change: Vec<Complex64>, spectrum: &mut [Complex64]) {
        self.forward.process(&mut change);
        let share = 1.0 / self.length() as f64;
        let bins = spectrum[self.first..].iter_mut().zip(&self.amplitudes).zip(&change);
        bins.for_each(|((h, f), c)| *h += f * c * share);
    }

    /// Energies, one a sample of an envelope, as they are when the filter has rung: what it makes of impulses at random.
    pub(super) fn smeared(&self, energies: &[f64]) -> Vec<f64> {
        let mut ringing: Vec<Complex64> = self.amplitudes.iter().map(|f| Complex64::new(*f, 0.0)).collect();
        ringing.resize(self.length(), Complex64::ZERO);
        self.inverse.process(&mut ringing);
        let all: f64 = ringing.iter().map(|z| z.norm_sqr()).sum();
        ringing.iter_mut().for_each(|z| *z = Complex64::new(z.norm_sqr() / all, 0.0));
        self.forward.process(&mut ringing);
        let mut values: Vec<Complex64> = energies.iter().map(|e| Complex64::new(*e, 0.0)).collect();
        values.resize(self.length(), Complex64::ZERO);
        self.forward.process(&mut values);
        let share = 1.0 / self.length() as f64;
        values.iter_mut().zip(&ringing).for_each(|(v, r)| *v *= r * share);
        self.inverse.process(&mut values);
        values.iter().map(|v| v.re.max(0.0)).collect()
    }

    /// Root mean square of |z| of noise whose bins have these amplitudes.
    pub(super) fn modulus(&self, amplitudes: &[f64]) -> f64 {
        let bins = amplitudes[self.first..].iter().zip(&self.amplitudes);
        bins.map(|(a, f)| (a * f).powi(2)).sum::<f64>().sqrt()
    }

    /// Energy of a piece of an envelope, as intensity.
    pub(super) fn power(&self, envelope: &[Complex64]) -> f64 {
        self.unit * envelope.iter().map(|z| z.norm_sqr()).sum::<f64>()
    }

    /// What two envelopes of the samples in `window` have in common, as intensity.
    pub(super) fn cross(&self, a: &[Complex64], b: &[Complex64], window: Range<usize>) -> f64 {
        let pairs = a[window.clone()].iter().zip(&b[window]);
        self.unit * pairs.map(|(a, b)| a.re * b.re + a.im * b.im).sum::<f64>()
    }
}
