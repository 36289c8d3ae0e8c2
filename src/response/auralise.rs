//! Recordings as they sound in a room: convolution with an impulse response.

use std::path::Path;

use rubato::audioadapter_buffers::owned::InterleavedOwned;
use rubato::{Fft, FixedSync, Resampler};

use super::Response;
use super::transform::Transform;
use crate::error::{Error, Result};

/// Frames that the resampler takes at a time.
const CHUNK: usize = 4096;

/// A recording without a room, one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Dry {
    /// Sample rate in Hz.
    pub sample_rate_hz: u32,
    /// The samples, full scale 1.
    pub samples: Vec<f64>,
}

impl Dry {
    /// Reads a WAV file of 8 to 32 bits or 32-bit floats; several channels are averaged.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read or is no such file, [`Error::Input`] if it is empty or not finite.
    pub fn read(path: &Path) -> Result<Self> {
        let failed = |e: hound::Error| {
            let source = match e {
                hound::Error::IoError(e) => e,
                other => std::io::Error::other(other),
            };
            Error::File { path: path.to_path_buf(), action: "read", source }
        };
        let reader = hound::WavReader::open(path).map_err(failed)?;
        let spec = reader.spec();
        let full_scale = 2f64.powi(i32::from(spec.bits_per_sample) - 1);
        let all: Vec<f64> = match spec.sample_format {
            hound::SampleFormat::Float => {
                reader.into_samples::<f32>().map(|s| s.map(f64::from)).collect::<std::result::Result<_, _>>()
            }
            hound::SampleFormat::Int => reader
                .into_samples::<i32>()
                .map(|s| s.map(|s| f64::from(s) / full_scale))
                .collect::<std::result::Result<_, _>>(),
        }
        .map_err(failed)?;
        let channels = usize::from(spec.channels.max(1));
        let samples: Vec<f64> =
            all.chunks_exact(channels).map(|frame| frame.iter().sum::<f64>() / channels as f64).collect();
        if samples.is_empty() || spec.sample_rate == 0 || samples.iter().any(|s| !s.is_finite()) {
            return Err(Error::input(
                format!("{}: there is no sound in it", path.display()),
                "a WAV file with at least one sample, all of them finite",
            ));
        }
        Ok(Self { sample_rate_hz: spec.sample_rate, samples })
    }

    /// The same sound at another sample rate.
    ///
    /// # Errors
    /// [`Error::Run`] if the resampler refuses the ratio.
    pub fn at_rate(&self, sample_rate_hz: u32) -> Result<Self> {
        if sample_rate_hz == self.sample_rate_hz {
            return Ok(self.clone());
        }
        let failed = |e: &dyn std::fmt::Display| Error::Run(format!("cannot resample to {sample_rate_hz} Hz: {e}"));
        let (from, to) = (self.sample_rate_hz as usize, sample_rate_hz as usize);
        let mut resampler = Fft::<f64>::new(from, to, CHUNK, 1, FixedSync::Both).map_err(|e| failed(&e))?;
        let frames = self.samples.len();
        let input = InterleavedOwned::new_from(self.samples.clone(), 1, frames).map_err(|e| failed(&e))?;
        let output = resampler.process_all(&input, frames, None).map_err(|e| failed(&e))?;
        let mut samples = output.take_data();
        // The resampler rounds up, by one sample too many where the ratio is not exact.
        samples.truncate((frames as f64 * to as f64 / from as f64).round() as usize);
        Ok(Self { sample_rate_hz, samples })
    }
}

/// The convolution of a recording with every channel of a response, at the response's rate.
///
/// # Errors
/// As [`Dry::at_rate`].
pub fn heard(dry: &Dry, response: &Response) -> Result<Vec<Vec<f64>>> {
    let dry = dry.at_rate(response.sample_rate_hz)?;
    let length = dry.samples.len() + response.samples.len().max(1) - 1;
    let transform = Transform::new(length);
    let voice = transform.spectrum(dry.samples);
    let channels = std::iter::once(&response.samples).chain(&response.others);
    Ok(channels
        .map(|samples| {
            let mut product = transform.spectrum(samples.iter().map(|s| f64::from(*s)).collect());
            product.iter_mut().zip(&voice).for_each(|(h, v)| *h *= v);
            let mut time = transform.samples(&mut product);
            time.truncate(length);
            time
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delayed_impulse_delays_the_recording() {
        let mut samples = vec![0.0; 101];
        samples[100] = 0.5;
        let response =
            Response { sample_rate_hz: 48_000, samples, others: vec![], title: String::new(), warnings: vec![] };
        let dry = Dry { sample_rate_hz: 48_000, samples: (0..500).map(|i| f64::from(i * i % 17)).collect() };
        let heard = heard(&dry, &response).unwrap_or_default();
        assert_eq!(heard[0].len(), 600);
        for (n, s) in heard[0].iter().enumerate() {
            let expected = if n >= 100 { 0.5 * dry.samples[n - 100] } else { 0.0 };
            assert!((s - expected).abs() < 1e-12, "{n}: {s} {expected}");
        }
    }

    #[test]
    fn a_tone_keeps_its_pitch_level_and_time_at_another_rate() {
        let tone = |rate: f64, n: usize| (std::f64::consts::TAU * 1000.0 * n as f64 / rate).sin();
        for rate in [16_000, 44_100, 96_000] {
            let samples = (0..rate as usize).map(|n| tone(f64::from(rate), n)).collect();
            let there = Dry { sample_rate_hz: rate, samples }.at_rate(48_000).map(|d| d.samples).unwrap_or_default();
            assert_eq!(there.len(), 48_000);
            for (n, s) in there.iter().enumerate().take(40_000).skip(8_000) {
                // -80 dB: the resampler's pass band and alias.
                assert!((s - tone(48_000.0, n)).abs() < 1e-4, "{rate} Hz, {n}: {s}");
            }
        }
    }
}
