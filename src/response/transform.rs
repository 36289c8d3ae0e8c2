//! Discrete Fourier transforms of real samples.

use std::sync::Arc;

use realfft::num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

/// The transforms of one length.
#[derive(Clone)]
pub(super) struct Transform {
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
}

impl Transform {
    /// Over at least `least` samples, and few more: as many as make the transform fast.
    pub(super) fn new(least: usize) -> Self {
        let length = smooth_length(least);
        let mut planner = RealFftPlanner::new();
        Self { forward: planner.plan_fft_forward(length), inverse: planner.plan_fft_inverse(length) }
    }

    /// Number of samples.
    pub(super) fn length(&self) -> usize {
        self.forward.len()
    }

    /// Number of frequencies from 0 to half the sample rate.
    pub(super) fn bins(&self) -> usize {
        self.length() / 2 + 1
    }

    /// Spectrum of samples (at most [`Self::length`]) and silence after them.
    pub(super) fn spectrum(&self, mut samples: Vec<f64>) -> Vec<Complex64> {
        samples.resize(self.length(), 0.0);
        let mut spectrum = self.forward.make_output_vec();
        // Buffers have the plan's own lengths, the only thing the transforms can object to.
        let done = self.forward.process(&mut samples, &mut spectrum);
        debug_assert!(done.is_ok());
        spectrum
    }

    /// All samples of a spectrum, which is used up; what is not real of its ends is left out.
    pub(super) fn samples(&self, spectrum: &mut [Complex64]) -> Vec<f64> {
        spectrum[0].im = 0.0;
        if let Some(last) = spectrum.last_mut() {
            last.im = 0.0;
        }
        let mut samples = self.inverse.make_output_vec();
        let done = self.inverse.process(spectrum, &mut samples);
        debug_assert!(done.is_ok());
        let scale = 1.0 / samples.len() as f64;
        samples.iter_mut().for_each(|s| *s *= scale);
        samples
    }
}

/// The smallest even product of 2, 3 and 5 that is not below `least`: a fast transform length.
pub(super) fn smooth_length(least: usize) -> usize {
    let mut n = least.max(2).next_multiple_of(2);
    loop {
        let mut rest = n;
        for p in [2, 3, 5] {
            while usize::is_multiple_of(rest, p) {
                rest /= p;
            }
        }
        if rest == 1 {
            return n;
        }
        n += 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_lengths_are_smooth_and_not_below_what_is_asked() {
        assert_eq!([1, 2, 7, 31, 72_000, 72_001].map(smooth_length), [2, 2, 8, 32, 72_000, 72_900]);
    }

    #[test]
    fn samples_come_back_from_their_spectrum() {
        let transform = Transform::new(59);
        let samples: Vec<f64> = (0..59).map(|n| f64::from(n * n % 17) - 8.0).collect();
        let back = transform.samples(&mut transform.spectrum(samples.clone()));
        assert_eq!(back.len(), 60);
        for (n, (was, is)) in samples.iter().chain([&0.0]).zip(&back).enumerate() {
            assert!((is - was).abs() < 1e-13, "{n}: {is}, not {was}");
        }
    }
}
