//! Band measurements independent of the crate: Butterworth band filters (IEC 61260-1 class 1) and plain spectral means.
#![allow(dead_code)] // each test file uses its share

use diffray::scene::Band;
use rustfft::num_complex::Complex64;

/// Octave bands with exact base-2 centres and nominal names.
pub(crate) fn octaves(from_hz: f64, to_hz: f64) -> Vec<Band> {
    fractional(1.0, from_hz, to_hz)
}

/// Third-octave bands.
pub(crate) fn third_octaves(from_hz: f64, to_hz: f64) -> Vec<Band> {
    fractional(3.0, from_hz, to_hz)
}

fn fractional(per_octave: f64, from_hz: f64, to_hz: f64) -> Vec<Band> {
    let index = |hz: f64| ((hz / 1000.0).log2() * per_octave).round() as i32;
    (index(from_hz)..=index(to_hz))
        .map(|i| {
            let centre = 1000.0 * (f64::from(i) / per_octave).exp2();
            let half = (0.5 / per_octave).exp2();
            Band { nominal_hz: centre.round(), low_hz: centre / half, high_hz: centre * half }
        })
        .collect()
}

/// White mean of |H|^2 over each band, from a transform eight times as long as the response.
pub(crate) fn band_means(samples: &[f32], rate: u32, bands: &[Band]) -> Vec<f64> {
    let length = (8 * samples.len()).next_power_of_two().max(1 << 18);
    let mut h: Vec<Complex64> = samples.iter().map(|s| Complex64::new(f64::from(*s), 0.0)).collect();
    h.resize(length, Complex64::new(0.0, 0.0));
    rustfft::FftPlanner::new().plan_fft_forward(length).process(&mut h);
    let step = f64::from(rate) / length as f64;
    bands
        .iter()
        .map(|b| {
            let bins: Vec<f64> = (1..length / 2)
                .filter(|k| (b.low_hz..=b.high_hz).contains(&(*k as f64 * step)))
                .map(|k| h[k].norm_sqr())
                .collect();
            bins.iter().sum::<f64>() / bins.len() as f64
        })
        .collect()
}

/// One second-order section: b0, b1, b2, a1, a2.
type Section = [f64; 5];

/// Butterworth band-pass with `order` pole pairs (IEC class 1 from 3 on at these rates), bilinear with prewarped edges.
fn butterworth(band: &Band, rate: f64, order: usize) -> Vec<Section> {
    let warp = |hz: f64| 2.0 * rate * (std::f64::consts::PI * hz / rate).tan();
    let (low, high) = (warp(band.low_hz), warp(band.high_hz));
    let (width, centre) = (high - low, (high * low).sqrt());
    let mut sections = Vec::new();
    for i in 0..order {
        let angle = std::f64::consts::PI * (2 * i + order + 1) as f64 / (2 * order) as f64;
        let prototype = Complex64::from_polar(1.0, angle);
        let root = ((prototype * width).powi(2) - 4.0 * centre * centre).sqrt();
        for sign in [1.0, -1.0] {
            let pole = (prototype * width + root * sign) / 2.0;
            let z = (2.0 * rate + pole) / (2.0 * rate - pole);
            if z.im > 0.0 {
                // Zeros at z = 1 and z = -1, one of each a pair of poles.
                sections.push([1.0, 0.0, -1.0, -2.0 * z.re, z.norm_sqr()]);
            }
        }
    }
    assert_eq!(sections.len(), order);
    sections
}

fn filtered_energy(samples: impl Iterator<Item = f64>, sections: &[Section]) -> f64 {
    let mut state = vec![[0.0; 2]; sections.len()];
    samples
        .map(|x| {
            let mut x = x;
            for (s, z) in sections.iter().zip(&mut state) {
                let y = s[0] * x + z[0];
                z[0] = s[1] * x - s[3] * y + z[1];
                z[1] = s[2] * x - s[4] * y;
                x = y;
            }
            x * x
        })
        .sum()
}

/// |H|^2 in each band as a Butterworth filter of `order` measures it, relative to what it measures of a unit impulse.
pub(crate) fn class_1_means(samples: &[f32], rate: u32, bands: &[Band], order: usize) -> Vec<f64> {
    let silence = || std::iter::repeat_n(0.0, rate as usize);
    bands
        .iter()
        .map(|b| {
            let sections = butterworth(b, f64::from(rate), order);
            let one = filtered_energy(std::iter::once(1.0).chain(silence()), &sections);
            filtered_energy(samples.iter().map(|s| f64::from(*s)).chain(silence()), &sections) / one
        })
        .collect()
}

/// The class 1 filter's output for a band, for decay analysis.
pub(crate) fn class_1_output(samples: &[f32], rate: u32, band: &Band) -> Vec<f64> {
    let sections = butterworth(band, f64::from(rate), 4);
    let mut state = vec![[0.0; 2]; sections.len()];
    samples
        .iter()
        .map(|x| {
            let mut x = f64::from(*x);
            for (s, z) in sections.iter().zip(&mut state) {
                let y = s[0] * x + z[0];
                z[0] = s[1] * x - s[3] * y + z[1];
                z[1] = s[2] * x - s[4] * y;
                x = y;
            }
            x
        })
        .collect()
}
