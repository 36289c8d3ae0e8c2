//! Impulse responses and room-acoustic metrics from what a probe received.
//!
//! # Scale
//! Samples are sound pressure relative to the peak of the same source's free field at 1 m, the propagation delay kept: free
//! field at distance r is a band-limited impulse of amplitude 1/r at r/c. With H(f) = sum of `h[n]` exp(-i 2 pi f n / rate)
//! (no factor) the white mean of |H|^2 over a band is the band's relative intensity.
//!
//! # Construction
//! 1. Early paths: one pulse each, at its exact delay (the fraction of a sample as a phase in the frequency domain). The magnitude is a polygon
//!    in ln |H| over ln f whose white band means are the path's intensities, or those in parts of the bands where its course is
//!    known; below the lowest and above the highest band centre the value there is held, to 0 Hz and to half the sample rate. The phase is the minimum phase
//!    (nothing before the arrival but the band limit's own ripple), reduced where the peak would otherwise be more than one
//!    sample late. Equal intensities in all bands give a pure delayed impulse.
//! 2. Late part: noise shaped by the echogram band by band; see the `noise` module. It starts with the echogram, is held an
//!    octave below the lowest band and half an octave above the highest, and fades out beyond.
//! 3. A smooth minimum-phase gain on the early part, and factors on the noise (see the `late` module), make the band energies of the
//!    sum those of [`Reception::levels`], because pressures interfere where intensities add. A band with intensity 0 is silenced.

mod analysis;
mod auralise;
mod balance;
mod directional;
mod energy;
mod envelope;
mod gain;
mod late;
pub mod metrics;
mod noise;
mod spectrum;
mod steady;
mod transform;

use std::path::Path;

pub use analysis::{octave_levels_db, response_metrics, speech_transmission_index};
pub use auralise::{Dry, heard};
pub use metrics::{DecayTime, Metrics, metrics};

use crate::error::{Error, Result, Warning};
use crate::probe::Reception;
use crate::scene::{Band, ProbeFormat};
use energy::EnergyCurve;
use gain::Matcher;
use noise::TimeAxis;
use spectrum::{Shaper, centres_hz, ln_magnitude};

/// Time in s that a response lasts beyond its last sound, for the lowest band's pulse and for a filter to ring down.
const TAIL_S: f64 = 0.1;
/// The same where some bands are silent and others not: steep flanks ring longer.
const TAIL_BESIDE_SILENCE_S: f64 = 0.3;
/// Share of a band's energy at which the decay counts as over: 60 dB.
const DECAYED: f64 = 1e-6;
/// Largest number of samples (about 1.5 hours at 48 kHz; the WAV stays below its format's 4 GiB).
const MAX_SAMPLES: f64 = 268_435_456.0;
/// Error of a band's energy in dB from which on it is reported.
const REPORTED_DB: f64 = 0.1;

/// How an impulse response is rendered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// Sample rate in Hz.
    pub sample_rate_hz: u32,
    /// Length in s; `None`: [`suggested_length_s`].
    pub length_s: Option<f64>,
    /// Seed of the late part's noise; the names of source and probe are mixed in.
    pub seed: u64,
    /// What the probe records.
    pub format: ProbeFormat,
}

/// An impulse response: pressure relative to the free-field peak at 1 m, time 0 = emission.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// Sample rate in Hz.
    pub sample_rate_hz: u32,
    /// The samples of the first channel.
    pub samples: Vec<f32>,
    /// Those of the other channels, as many each; none but for Ambisonics.
    pub others: Vec<Vec<f32>>,
    /// What it is, for the file's INFO chunk.
    pub title: String,
    /// What the listener should know.
    pub warnings: Vec<Warning>,
}

impl Response {
    /// Writes a WAV file of 32-bit floats with the title and the program in its INFO chunk, whole or not at all: into a new file in the same folder, which then takes the
    /// name `path`.
    ///
    /// # Errors
    /// [`Error::File`] if the folder does not exist or cannot be written to.
    pub fn write_wav(&self, path: &Path) -> Result<()> {
        let failed = |source| Error::File { path: path.to_path_buf(), action: "write", source };
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".response-").suffix(".wav");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // A temporary file is private by default; the result gets what the process' umask gives any new file.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder).map_err(failed)?;
        self.write_samples(std::io::BufWriter::new(file.as_file_mut())).map_err(failed)?;
        file.persist(path).map_err(|e| failed(e.error))?;
        Ok(())
    }

    /// The WAV file's bytes into `writer`.
    fn write_samples(&self, mut writer: impl std::io::Write + std::io::Seek) -> std::io::Result<()> {
        let spec = hound::WavSpec {
            // At most 16.
            channels: 1 + self.others.len() as u16,
            sample_rate: self.sample_rate_hz,
            bits_per_sample: 32,
            sample_format: hound::SampleFormat::Float,
        };
        let io = |e| match e {
            hound::Error::IoError(e) => e,
            other => std::io::Error::other(other),
        };
        let mut wav = hound::WavWriter::new(&mut writer, spec).map_err(io)?;
        for (n, sample) in self.samples.iter().enumerate() {
            wav.write_sample(*sample).map_err(io)?;
            for other in &self.others {
                wav.write_sample(other[n]).map_err(io)?;
            }
        }
        wav.finalize().map_err(io)?;
        let mut info = b"INFO".to_vec();
        for (name, text) in [(b"INAM", self.title.as_str()), (b"ISFT", concat!("diffray ", env!("CARGO_PKG_VERSION")))]
        {
            let text = [text.as_bytes(), b"\0"].concat();
            info.extend(name);
            info.extend((text.len() as u32).to_le_bytes());
            info.extend(&text);
            // Chunks begin at even places.
            info.resize(info.len().next_multiple_of(2), 0);
        }
        writer.seek(std::io::SeekFrom::End(0))?;
        writer.write_all(b"LIST")?;
        writer.write_all(&(info.len() as u32).to_le_bytes())?;
        writer.write_all(&info)?;
        // Below 4 GiB: the number of samples is limited.
        let size = writer.stream_position()? - 8;
        writer.seek(std::io::SeekFrom::Start(4))?;
        writer.write_all(&(size as u32).to_le_bytes())?;
        writer.flush()
    }
}

/// Length in s that holds a reception: until in every band 60 dB of the energy have decayed, or the last path or the
/// echogram has ended, and 0.1 s (0.3 s where some bands are silent) to ring down.
pub fn suggested_length_s(reception: &Reception) -> f64 {
    let bands = reception.levels.len().max(reception.paths.first().map_or(0, |p| p.intensity.len()));
    let shift_s = earliest_shift_s(reception);
    let decayed_s = (0..bands)
        .map(|b| EnergyCurve::new(reception, b))
        .filter(|c| c.total() > 0.0)
        .map(|c| c.time_of_share(DECAYED) + shift_s)
        .fold(0.0, f64::max);
    let silent = reception.levels.iter().filter(|l| l.intensity <= 0.0).count();
    decayed_s + if silent == 0 || silent == reception.levels.len() { TAIL_S } else { TAIL_BESIDE_SILENCE_S }
}

/// What must be added to all delays so that none is negative (a plane wave's may be), in s.
fn earliest_shift_s(reception: &Reception) -> f64 {
    reception.paths.iter().map(|p| -p.delay_s).fold(0.0, f64::max)
}

/// Renders the impulse response of a reception; `bands` are those of its levels and spectra.
///
/// Silence is a response too: all zeros. A given length that cuts sound off leaves the rest as it is, and says so.
///
/// # Errors
/// A [`Warning`] that says why there is no response: the bands are single tones (what happens between them is not known),
/// a value is not finite, sizes disagree, or the sample rate or length is impossible.
pub fn render(
    reception: &Reception,
    bands: &[Band],
    options: &RenderOptions,
) -> std::result::Result<Response, Warning> {
    check(reception, bands)?;
    let rate = f64::from(options.sample_rate_hz);
    let length_s = options.length_s.unwrap_or_else(|| suggested_length_s(reception));
    let length = (length_s * rate).ceil();
    if !(1.0..=MAX_SAMPLES).contains(&(length * (directional::order(options.format) + 1).pow(2) as f64)) {
        return Err(refusal(
            reception,
            format!("{length_s} s at {rate} Hz is no possible length"),
            "Choose output.response_length_s and output.sample_rate_hz so that 1 to 2^28 samples result.",
        ));
    }
    let length = length as usize; // 1..=2^28: checked above
    let end_s = length as f64 / rate;
    let mut warnings = Vec::new();

    let heard = bands.iter().take_while(|b| centre(b) < 0.5 * rate).count();
    if bands.last().is_some_and(|b| b.high_hz > 0.5 * rate) {
        warnings.push(Warning {
            observation: format!(
                "The sample rate of {rate} Hz holds frequencies up to {} Hz only; the bands reach {} Hz.",
                0.5 * rate,
                bands[bands.len() - 1].high_hz
            ),
            remedy: "Raise output.sample_rate_hz, or lower bands.to_hz.".into(),
        });
    }
    let bands = &bands[..heard];
    let shift_s = earliest_shift_s(reception);
    if shift_s > 0.0 {
        warnings.push(Warning {
            observation: format!(
                "The wave reaches {} before the source; time 0 of the response is {shift_s} s before its emission.",
                reception.probe
            ),
            remedy: "Place a plane wave's source upstream of all probes.".into(),
        });
    }

    let curves: Vec<EnergyCurve> = (0..heard).map(|b| EnergyCurve::new(reception, b)).collect();
    let cut: Vec<f64> = curves.iter().map(|c| c.remaining(end_s - shift_s)).collect();
    let target: Vec<f64> =
        reception.levels.iter().zip(&cut).map(|(level, cut)| (level.intensity - cut).max(0.0)).collect();
    let worst_cut = cut.iter().zip(&reception.levels).map(|(c, l)| c / l.intensity.max(f64::MIN_POSITIVE));
    let worst_cut = worst_cut.filter(|c| c.is_finite()).fold(0.0, f64::max);
    if worst_cut > 0.01 {
        warnings.push(Warning {
            observation: format!(
                "The response ends after {end_s:.3} s; {:.1} % of the energy of a band arrives later and is missing.",
                100.0 * worst_cut
            ),
            remedy: "Raise output.response_length_s, or leave it out.".into(),
        });
    }

    let mut channels = vec![vec![0.0; length]; (directional::order(options.format) + 1).pow(2)];
    if target.iter().any(|t| *t > 0.0) {
        let mut shaper = Shaper::new(bands, rate);
        add_paths(reception, &target, &mut shaper, shift_s, &mut channels);
        // Band levels are those of the pressure; the other channels go through the same gain.
        let errors = if curves.iter().any(|c| c.remaining_in_bins(0.0) > 0.0) {
            match_early(reception, &mut channels, (end_s, shift_s), &mut shaper);
            let axis = TimeAxis { sample_rate_hz: rate, length, shift_s };
            let late = (reception, &curves[..]);
            late::join(&mut channels, late, (axis, options.seed), &target, &mut shaper)
        } else {
            Matcher::new(&shaper, length).match_bands(&mut channels, &target, 0.0, &mut shaper)
        };
        for (band, error) in bands.iter().zip(errors).filter(|(_, e)| e.is_nan() || e.abs() > REPORTED_DB) {
            warnings.push(Warning {
                observation: format!(
                    "The response of {} at {} misses the level of the {} Hz band by {error:.2} dB.",
                    reception.source, reception.probe, band.nominal_hz
                ),
                remedy: "Trust bands.csv for this band; a longer response may help.".into(),
            });
        }
    }
    if channels[0].iter().all(|s| *s == 0.0) {
        warnings.push(Warning {
            observation: format!(
                "The response of {} at {} is silent: nothing arrives.",
                reception.source, reception.probe
            ),
            remedy: "Is there a way for the sound, and is the response long enough for it?".into(),
        });
    }
    let recorded = directional::recorded(options.format, channels);
    let mut recorded = recorded.iter().map(|c| c.iter().map(|s| *s as f32).collect::<Vec<f32>>());
    Ok(Response {
        sample_rate_hz: options.sample_rate_hz,
        samples: recorded.next().unwrap_or_default(),
        others: recorded.collect(),
        title: format!("{} at {}", reception.source, reception.probe),
        warnings,
    })
}

/// Geometric centre of a band in Hz.
fn centre(band: &Band) -> f64 {
    spectrum::centre_hz(band)
}

/// Adds one pulse a path. Bands that are silent altogether (`target` 0) are left to the gain at the end.
fn add_paths(reception: &Reception, target: &[f64], shaper: &mut Shaper<'_>, shift_s: f64, channels: &mut [Vec<f64>]) {
    let length = channels[0].len();
    let bands = shaper.bands();
    for path in &reception.paths {
        let intensity = &path.intensity[..bands.len()];
        let arrival = (path.delay_s + shift_s) * shaper.sample_rate_hz();
        if intensity.iter().all(|e| *e <= 0.0) || arrival >= length as f64 {
            continue;
        }
        let weights = directional::harmonics(channels.len().isqrt() - 1, path.from);
        // Delays are sums of rounded lengths: a billionth of a sample is no delay.
        let whole = (arrival + 1e-9).floor();
        let fraction = (arrival - whole).max(0.0);
        let whole = whole as usize; // at least 0 (shifted), below samples.len()
        if flat(intensity) && flat(&path.course) && fraction < 1e-9 {
            for (samples, weight) in channels.iter_mut().zip(&weights) {
                samples[whole] += weight * intensity[0].sqrt();
            }
            continue;
        }
        let silent: Vec<bool> = intensity.iter().zip(target).map(|(e, t)| *e <= 0.0 && *t > 0.0).collect();
        let pulse = if path.course.is_empty() {
            shaper.pulse(&ln_magnitude(bands, intensity), &silent, fraction)
        } else {
            let parts = path.course.len() / path.intensity.len();
            let fine: Vec<Band> = bands.iter().flat_map(|band| band.parts(parts)).collect();
            let (ln, centres) = (ln_magnitude(&fine, &path.course[..fine.len()]), centres_hz(&fine));
            shaper.pulse_of(&silent, &centres, &ln, fraction)
        };
        let half = pulse.len() / 2;
        for (samples, weight) in channels.iter_mut().zip(&weights) {
            for (n, p) in pulse[..half].iter().enumerate().take(length - whole) {
                samples[whole + n] += weight * p;
            }
            for (n, p) in pulse[half..].iter().rev().enumerate().take(whole) {
                samples[whole - 1 - n] += weight * p;
            }
        }
    }
}

/// Gives the early paths their own band energies before late sound is added, so that the ratio of early to late energy is that
/// of the reception.
fn match_early(
    reception: &Reception,
    channels: &mut [Vec<f64>],
    (end_s, shift_s): (f64, f64),
    shaper: &mut Shaper<'_>,
) {
    let beyond = |b: usize| -> f64 {
        let late = reception.paths.iter().filter(|p| p.delay_s + shift_s >= end_s);
        late.map(|p| p.intensity[b]).sum()
    };
    let levels = reception.levels.iter().take(shaper.bands().len()).enumerate();
    let target: Vec<f64> = levels.map(|(b, l)| (l.early_share * l.intensity - beyond(b)).max(0.0)).collect();
    let length = channels[0].len();
    let used = channels[0].iter().rposition(|s| *s != 0.0).map_or(0, |last| last + 1);
    if used == 0 || target.iter().all(|t| *t <= 0.0) {
        return;
    }
    // Room for the gain to ring.
    let used = (used + shaper.length() / 2).min(length);
    channels.iter_mut().for_each(|samples| samples.truncate(used));
    Matcher::new(shaper, used).match_bands(channels, &target, 0.0, shaper);
    channels.iter_mut().for_each(|samples| samples.resize(length, 0.0));
}

/// Whether all bands have the same intensity.
fn flat(intensity: &[f64]) -> bool {
    intensity.iter().all(|e| (e - intensity[0]).abs() <= 1e-12 * intensity[0])
}

/// What makes a response impossible.
fn check(reception: &Reception, bands: &[Band]) -> std::result::Result<(), Warning> {
    if bands.is_empty() || bands.iter().any(Band::is_tone) {
        return Err(refusal(
            reception,
            "single frequencies do not determine an impulse response".into(),
            "Choose bands.spacing = \"octave\" or \"third-octave\" for impulse responses.",
        ));
    }
    let whole = bands.iter().all(|b| 0.0 < b.low_hz && b.low_hz < b.high_hz && b.high_hz.is_finite())
        && bands.windows(2).all(|w| centre(&w[0]) < centre(&w[1]))
        && reception.levels.len() == bands.len()
        && reception.levels.iter().all(|l| l.intensity.is_finite())
        && reception.paths.iter().all(|p| {
            p.intensity.len() == bands.len()
                && p.course.len().is_multiple_of(bands.len())
                && p.course.iter().all(|e| e.is_finite() && *e >= 0.0)
                && p.delay_s.is_finite()
                && p.intensity.iter().all(|e| e.is_finite() && *e >= 0.0)
        })
        && reception.echogram.as_ref().is_none_or(|e| {
            e.bin_s > 0.0
                && e.bin_s.is_finite()
                && e.energy.len() == bands.len()
                && e.energy.iter().flatten().all(|e| e.is_finite())
        });
    if whole {
        return Ok(());
    }
    Err(refusal(
        reception,
        "its bands, paths, echogram and levels disagree in size or hold values that are not finite".into(),
        "This is a fault of the simulation before it, not of the room: please report it with the room file.",
    ))
}

/// The warning that there is no response, and why.
fn refusal(reception: &Reception, why: String, remedy: &str) -> Warning {
    Warning {
        observation: format!("No impulse response of {} at {}: {why}.", reception.source, reception.probe),
        remedy: remedy.into(),
    }
}
