//! Octave and third-octave bands with the nominal centres of IEC 61260-1, and tones.

use super::{Band, Spacing};

/// Nominal third-octave centres of one decade (IEC 61260-1:2014, annex E); every third one is an octave centre.
const DECADE: [f64; 10] = [1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0];
/// Exponents of ten for which [`DECADE`] is used: 10 Hz to 31.5 kHz.
const EXPONENTS: std::ops::RangeInclusive<i32> = 1..=4;
/// Highest nominal centre in Hz.
const HIGHEST_HZ: f64 = 31_500.0;

/// The nominal centres in Hz that a spacing has, ascending; empty for tones.
pub fn nominal_centres_hz(spacing: Spacing) -> Vec<f64> {
    let step = match spacing {
        Spacing::Octave => 3,
        Spacing::ThirdOctave => 1,
        Spacing::Tones => return Vec::new(),
    };
    let mut centres = Vec::new();
    for exponent in EXPONENTS {
        for (place, mantissa) in DECADE.iter().enumerate() {
            // 1000 Hz (place 0 of exponent 3) is a centre of both series.
            let from_1_khz = (exponent - 3) * 10 + place as i32;
            let centre = mantissa * 10f64.powi(exponent);
            if from_1_khz.rem_euclid(step) == 0 && centre <= HIGHEST_HZ {
                centres.push(centre);
            }
        }
    }
    centres
}

/// The band about a nominal centre: its edges lie at centre * 2^(+-1/2) (octave) or 2^(+-1/6) (third-octave).
pub fn band(nominal_hz: f64, spacing: Spacing) -> Band {
    let half_width = match spacing {
        Spacing::Octave => 2f64.powf(1.0 / 2.0),
        Spacing::ThirdOctave => 2f64.powf(1.0 / 6.0),
        Spacing::Tones => 1.0,
    };
    Band { nominal_hz, low_hz: nominal_hz / half_width, high_hz: nominal_hz * half_width }
}

/// All bands of a spacing whose nominal centre lies in `from_hz..=to_hz`, ascending.
pub fn bands_between(spacing: Spacing, from_hz: f64, to_hz: f64) -> Vec<Band> {
    nominal_centres_hz(spacing)
        .into_iter()
        .filter(|f| (from_hz..=to_hz).contains(f))
        .map(|f| band(f, spacing))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octave_centres_are_the_nominal_ones() {
        let centres: Vec<f64> =
            bands_between(Spacing::Octave, 16.0, 16_000.0).iter().map(|band| band.nominal_hz).collect();
        assert_eq!(centres, [16.0, 31.5, 63.0, 125.0, 250.0, 500.0, 1e3, 2e3, 4e3, 8e3, 16e3]);
    }

    #[test]
    fn third_octave_centres_are_the_nominal_ones() {
        let centres: Vec<f64> =
            bands_between(Spacing::ThirdOctave, 63.0, 630.0).iter().map(|band| band.nominal_hz).collect();
        assert_eq!(centres, [63.0, 80.0, 100.0, 125.0, 160.0, 200.0, 250.0, 315.0, 400.0, 500.0, 630.0]);
    }

    #[test]
    fn an_octave_band_spans_a_factor_of_two_about_its_nominal_centre() {
        let octave = band(1000.0, Spacing::Octave);
        assert!((octave.high_hz / octave.low_hz - 2.0).abs() < 1e-12);
        assert!((octave.low_hz * octave.high_hz - 1e6).abs() < 1e-6);
        let third = band(1000.0, Spacing::ThirdOctave);
        assert!(((third.high_hz / third.low_hz).powi(3) - 2.0).abs() < 1e-12);
        assert!(band(440.0, Spacing::Tones).is_tone());
    }
}
