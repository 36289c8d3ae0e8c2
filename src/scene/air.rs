//! The medium: speed of sound and atmospheric absorption.

use super::{Band, Spacing};

/// 0 degrees Celsius in K.
const ZERO_CELSIUS_K: f64 = 273.15;
/// Reference temperature of ISO 9613-1 in K.
const T0_K: f64 = 293.15;
/// Triple point of water in K (ISO 9613-1, annex B).
const T01_K: f64 = 273.16;
/// Reference pressure of ISO 9613-1 in kPa.
const P0_KPA: f64 = 101.325;

/// Molar concentration of water vapour in percent (ISO 9613-1:1993, annex B, equations B.1 to B.3).
///
/// `temperature_c` in degrees Celsius, `relative_humidity_percent` in percent, `pressure_kpa` in kPa.
pub fn water_vapour_percent(temperature_c: f64, relative_humidity_percent: f64, pressure_kpa: f64) -> f64 {
    let t = temperature_c + ZERO_CELSIUS_K;
    let saturation = 10f64.powf(-6.8346 * (T01_K / t).powf(1.261) + 4.6151);
    relative_humidity_percent * saturation / (pressure_kpa / P0_KPA)
}

/// Speed of sound in m/s of humid air as a mixture of ideal gases, c^2 = gamma R T / M.
///
/// With h the molar fraction of water vapour, rigid molecules of two atoms (5 degrees of freedom) and of three (6)
/// give gamma = (7 + h)/(5 + h), and M = 28.9647 (1 - h) + 18.0153 h g/mol (D. A. Bohn, "Environmental effects on the
/// speed of sound", J. Audio Eng. Soc. 36(4), 1988). Within 0.1 % of the equation of O. Cramer (J. Acoust. Soc. Am. 93,
/// 1993, p. 2510) over the range of that equation, 0 to 30 degrees Celsius.
pub fn speed_of_sound_m_s(temperature_c: f64, relative_humidity_percent: f64, pressure_kpa: f64) -> f64 {
    const GAS_CONSTANT: f64 = 8.314_462_618;
    let h = (water_vapour_percent(temperature_c, relative_humidity_percent, pressure_kpa) / 100.0).clamp(0.0, 1.0);
    let gamma = (7.0 + h) / (5.0 + h);
    let molar_mass = 28.9647e-3 * (1.0 - h) + 18.0153e-3 * h;
    (gamma * GAS_CONSTANT * (temperature_c + ZERO_CELSIUS_K) / molar_mass).sqrt()
}

/// Pure-tone attenuation of sound in air in dB/m (ISO 9613-1:1993, equations 3 to 5).
///
/// Accurate to 10 % for -20 to 50 degrees Celsius, 0.05 to 5 % molar concentration of water vapour, below 200 kPa and
/// for frequency/pressure from 4e-4 to 10 Hz/Pa (section 7 of the standard).
pub fn attenuation_db_per_m(
    frequency_hz: f64,
    temperature_c: f64,
    relative_humidity_percent: f64,
    pressure_kpa: f64,
) -> f64 {
    let t = temperature_c + ZERO_CELSIUS_K;
    let (tr, pr) = (t / T0_K, pressure_kpa / P0_KPA);
    let h = water_vapour_percent(temperature_c, relative_humidity_percent, pressure_kpa);
    let oxygen_hz = pr * (24.0 + 4.04e4 * h * (0.02 + h) / (0.391 + h));
    let nitrogen_hz = pr * tr.powf(-0.5) * (9.0 + 280.0 * h * (-4.170 * (tr.powf(-1.0 / 3.0) - 1.0)).exp());
    let f2 = frequency_hz * frequency_hz;
    let classical = 1.84e-11 / pr * tr.sqrt();
    let oxygen = 0.01275 * (-2239.1 / t).exp() / (oxygen_hz + f2 / oxygen_hz);
    let nitrogen = 0.1068 * (-3352.0 / t).exp() / (nitrogen_hz + f2 / nitrogen_hz);
    8.686 * f2 * (classical + tr.powf(-2.5) * (oxygen + nitrogen))
}

/// The frequency in Hz at which a band's attenuation is taken: the exact midband frequency, 1000 * 10^(3n/10) for
/// octaves and 1000 * 10^(n/10) for third-octaves (ISO 9613-1, section 6; IEC 61260-1), and a tone itself.
pub fn midband_hz(band: &Band, spacing: Spacing) -> f64 {
    let decades = (band.nominal_hz / 1000.0).log10();
    match spacing {
        Spacing::Octave => 1000.0 * 10f64.powf(0.3 * (decades / 0.3).round()),
        Spacing::ThirdOctave => 1000.0 * 10f64.powf(0.1 * (decades / 0.1).round()),
        Spacing::Tones => band.nominal_hz,
    }
}

/// Turns dB/m into the intensity attenuation m in Np/m, exp(-m r): m = alpha / (10 lg e).
pub fn intensity_attenuation_per_m(db_per_m: f64) -> f64 {
    db_per_m / (10.0 * std::f64::consts::LOG10_E)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// dB/km at the exact octave midband frequencies 63 Hz to 8 kHz.
    fn octaves_db_per_km(temperature_c: f64, humidity: f64) -> [f64; 8] {
        std::array::from_fn(|i| {
            let midband = 1000.0 * 10f64.powf(0.3 * (i as f64 - 4.0));
            1000.0 * attenuation_db_per_m(midband, temperature_c, humidity, 101.325)
        })
    }

    #[test]
    fn attenuation_agrees_with_the_tables_of_iso_9613_1_within_one_percent() {
        // ISO 9613-1:1993, table 1, 20 degrees Celsius, 50 %, 63 Hz to 4 kHz: three digits, so 0.5 % of rounding at most.
        // 8 kHz is covered by the six climates of the next test.
        let table = [0.123, 0.445, 1.32, 2.73, 4.66, 9.89, 29.7];
        for (computed, printed) in octaves_db_per_km(20.0, 50.0).into_iter().zip(table) {
            assert!((computed / printed - 1.0).abs() < 0.01, "{computed} dB/km against {printed}");
        }
    }

    #[test]
    fn attenuation_agrees_with_table_2_of_iso_9613_2_to_its_last_digit() {
        let table = [
            (10.0, 70.0, [0.1, 0.4, 1.0, 1.9, 3.7, 9.7, 32.8, 117.0]),
            (20.0, 70.0, [0.1, 0.3, 1.1, 2.8, 5.0, 9.0, 22.9, 76.6]),
            (30.0, 70.0, [0.1, 0.3, 1.0, 3.1, 7.4, 12.7, 23.1, 59.3]),
            (15.0, 20.0, [0.3, 0.6, 1.2, 2.7, 8.2, 28.2, 88.8, 202.0]),
            (15.0, 50.0, [0.1, 0.5, 1.2, 2.2, 4.2, 10.8, 36.2, 129.0]),
            (15.0, 80.0, [0.1, 0.3, 1.1, 2.4, 4.1, 8.3, 23.7, 82.8]),
        ];
        for (temperature, humidity, row) in table {
            for (computed, printed) in octaves_db_per_km(temperature, humidity).into_iter().zip(row) {
                // One unit of the last printed digit, and 0.5 % where that digit is a whole dB/km.
                let tolerance = if printed >= 100.0 { 1.0 } else { 0.05 + 0.005 * printed };
                assert!((computed - printed).abs() < tolerance, "{temperature} C, {humidity} %: {computed} {printed}");
            }
        }
    }

    #[test]
    fn a_hand_computation_at_1_khz_gives_the_same_attenuation() {
        // 20 C, 50 %, 101.325 kPa, step by step with a pocket calculator: psat/p0 = 0.0230607, h = 1.15304 %,
        // frO = 24 + 40400*1.15304*1.17304/1.54404 = 35414 Hz, frN = 9 + 280*1.15304 = 331.85 Hz (exponent 0 at T0),
        // classical 1.84e-11, oxygen 0.01275*exp(-7.63807)/(35414 + 28.2) = 1.7331e-10,
        // nitrogen 0.1068*exp(-11.43442)/(331.85 + 3013.4) = 3.4533e-10; sum 5.3704e-10; 8.686e6 * sum = 4.6647e-3.
        let computed = attenuation_db_per_m(1000.0, 20.0, 50.0, 101.325);
        // Five digits were carried.
        assert!((computed / 4.6647e-3 - 1.0).abs() < 1e-4, "{computed}");
    }

    #[test]
    fn the_speed_of_sound_agrees_with_the_equation_of_cramer() {
        // Cramer (1993), equation 15, 0.04 % CO2, terms above 0.01 m/s.
        let cramer = |t: f64, humidity: f64| {
            let x = water_vapour_percent(t, humidity, 101.325) / 100.0;
            331.5024 + 0.603055 * t - 0.000528 * t * t
                + (51.471935 + 0.1495874 * t - 0.000782 * t * t) * x
                + (-1.82e-7 + 3.73e-8 * t - 2.93e-10 * t * t) * 101_325.0
                - (85.20931 + 0.228525 * t) * 4e-4
                - 2.835149 * x * x
        };
        for (t, humidity) in [(0.0, 0.0), (0.0, 100.0), (10.0, 50.0), (20.0, 0.0), (20.0, 50.0), (30.0, 90.0)] {
            let computed = speed_of_sound_m_s(t, humidity, 101.325);
            assert!((computed / cramer(t, humidity) - 1.0).abs() < 1e-3, "{t} C {humidity} %: {computed}");
        }
    }

    #[test]
    fn the_midband_frequency_is_exact_where_the_nominal_one_is_rounded() {
        let band = |nominal_hz| Band { nominal_hz, low_hz: nominal_hz, high_hz: nominal_hz };
        assert!((midband_hz(&band(8000.0), Spacing::Octave) - 7943.28).abs() < 0.01);
        assert!((midband_hz(&band(63.0), Spacing::Octave) - 63.0957).abs() < 1e-3);
        assert!((midband_hz(&band(1250.0), Spacing::ThirdOctave) - 1258.925).abs() < 1e-2);
        assert_eq!(midband_hz(&band(440.0), Spacing::Tones), 440.0);
    }

    #[test]
    fn one_neper_of_intensity_is_4_34_decibels() {
        assert!((intensity_attenuation_per_m(4.342_944_819) - 1.0).abs() < 1e-9);
    }
}
