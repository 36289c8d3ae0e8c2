//! The signed weights: the Wigner distribution of an opening and its band means in closed form.
//!
//! Everything an opening does to a ray is a sum of terms sin(2 pi h nu) with nu = Delta/Lambda: the frequency stands
//! only in the sine, so the mean over a band (white spectrum) is elementary (docs/physics.md, eq. 4).

use std::f64::consts::{PI, TAU};

use spec_math::SiCi;

use super::crossing::Spectrum;

/// sin(x)/x with its limit.
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-4 { 1.0 - x * x / 6.0 } else { x.sin() / x }
}

impl Spectrum {
    /// Band mean of sin(a f), `a` in s.
    pub fn mean_sin(&self, a: f64) -> f64 {
        (0.5 * a * (self.low_hz + self.high_hz)).sin() * sinc(0.5 * a * (self.high_hz - self.low_hz))
    }

    /// Band mean of sin(2 pi h nu)/(2 pi nu Lambda) with nu = Delta/Lambda: the share of the weight (1/Lambda) W that
    /// the separations below h of two points of the opening contribute; `h_m` in m, dimensionless result.
    ///
    /// In closed form (h f_c/c) sinc(a f_c) sinc(a B/2), a = 2 pi h Delta/c, with f_c, B the band's arithmetic
    /// centre and width: eq. (4) without its cancellation at Delta -> 0. A tone has B = 0.
    pub fn separations(&self, h_m: f64, delta: f64) -> f64 {
        let centre = 0.5 * (self.low_hz + self.high_hz);
        let a = TAU * h_m * delta / self.speed_m_s;
        h_m * centre / self.speed_m_s * sinc(a * centre) * sinc(0.5 * a * (self.high_hz - self.low_hz))
    }

    /// Eq. (3) and (4): (1/Lambda) W(L, Delta) for a point at distance `l_m` from the nearest edge, band mean.
    pub fn weight(&self, l_m: f64, delta: f64) -> f64 {
        2.0 * self.separations(2.0 * l_m, delta)
    }

    /// The mean of the weight (3) over an opening of `width_m`: (1/Lambda) a sinc^2(pi a Delta/Lambda), positive, its
    /// integral over Delta 1. Mean over the band by three Gauss nodes (the lobe's side lobes need no more).
    pub fn mean_weight(&self, width_m: f64, delta: f64) -> f64 {
        const NODE: f64 = 0.774_596_669_241_483_4;
        const WEIGHTS: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
        let per_wavelength = |hz: f64| width_m * hz / self.speed_m_s;
        let centre = per_wavelength(0.5 * (self.low_hz + self.high_hz));
        let step = per_wavelength(0.5 * NODE * (self.high_hz - self.low_hz));
        let widths = [centre - step, centre, centre + step];
        let ((sin, cos), (sin_step, cos_step)) = ((PI * centre * delta).sin_cos(), (PI * step * delta).sin_cos());
        let (shared, apart) = (sin * cos_step, cos * sin_step);
        let sines = [shared - apart, sin, shared + apart];
        let lobe = |i: usize| {
            let x = PI * widths[i] * delta;
            let sinc = if x.abs() < 1e-4 { sinc(x) } else { sines[i] / x };
            WEIGHTS[i] * widths[i] * sinc * sinc
        };
        (0..3).map(lobe).sum()
    }

    /// Band mean of the wavelength in m: c ln(f2/f1)/(f2 - f1).
    pub fn mean_wavelength_m(&self) -> f64 {
        let width = self.high_hz - self.low_hz;
        if width < 1e-9 * self.high_hz {
            self.speed_m_s / self.high_hz
        } else {
            self.speed_m_s * (self.high_hz / self.low_hz).ln() / width
        }
    }

    /// Band mean of wavelength * cos(k d) in m: c [Ci(2 pi f2 d/c) - Ci(2 pi f1 d/c)]/(f2 - f1).
    pub fn mean_wavelength_cos_m(&self, d_m: f64) -> f64 {
        let d = d_m.abs();
        let width = self.high_hz - self.low_hz;
        let high = self.high_k() * d;
        if width < 1e-9 * self.high_hz {
            return self.speed_m_s / self.high_hz * high.cos();
        }
        if high < 1e-6 {
            return self.mean_wavelength_m();
        }
        self.speed_m_s * (high.sici().ci - (self.low_k() * d).sici().ci) / width
    }
}

/// Distance from `x` to the nearest end of the interval, negative outside.
pub fn edge_distance(x: f64, interval: [f64; 2]) -> f64 {
    (x - interval[0]).min(interval[1] - x)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OCTAVE: Spectrum = Spectrum { low_hz: 707.106781, high_hz: 1414.213562, speed_m_s: 343.0 };

    /// Oracle: the mean over 20,000 frequencies of the single-frequency form.
    fn mean(f: impl Fn(f64) -> f64) -> f64 {
        let n = 20_000;
        let b = OCTAVE.high_hz - OCTAVE.low_hz;
        (0..n).map(|i| f(OCTAVE.low_hz + (i as f64 + 0.5) / n as f64 * b)).sum::<f64>() / n as f64
    }

    #[test]
    fn band_means_equal_the_mean_over_frequencies() {
        for (l, delta) in [(0.3, 0.4), (1e-3, 1.2), (0.5, 1e-9), (2.0, -0.7)] {
            let expected = mean(|f| {
                let nu_lambda: f64 = delta;
                (4.0 * PI * l * nu_lambda * f / 343.0).sin() / (PI * nu_lambda)
            });
            let got = OCTAVE.weight(l, delta);
            assert!((got - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{l} {delta}: {got} {expected}");
        }
        for d in [0.0, 0.01, 0.3, 5.0] {
            let expected = mean(|f| 343.0 / f * (TAU * f * d / 343.0).cos());
            // 1e-5: the midpoint rule's own error at d = 5 m.
            assert!((OCTAVE.mean_wavelength_cos_m(d) - expected).abs() < 1e-5, "{d}");
        }
        assert!((OCTAVE.mean_wavelength_m() - mean(|f| 343.0 / f)).abs() < 1e-8);
    }

    #[test]
    fn a_tone_is_the_limit_of_a_narrow_band() {
        let narrow = Spectrum { low_hz: 999.999, high_hz: 1000.001, speed_m_s: 343.0 };
        let tone = Spectrum::tone(1000.0, 343.0);
        assert!((narrow.weight(0.4, 0.3) - tone.weight(0.4, 0.3)).abs() < 1e-6);
        assert!((narrow.mean_wavelength_cos_m(0.2) - tone.mean_wavelength_cos_m(0.2)).abs() < 1e-6);
    }

    /// Upper bound of the absolute mass of the band-mean weight over Delta at a distance of `l_m` from an edge: how much a
    /// sampled ray's weight can grow in a crossing. 1.44 for an octave at any distance.
    fn absolute_mass(spectrum: &Spectrum, l_m: f64) -> f64 {
        // Substitute u = kappa f_c: the integrand depends on u alone, up to the range |Delta| <= 2.
        let centre = 0.5 * (spectrum.low_hz + spectrum.high_hz);
        let ratio = 0.5 * (spectrum.high_hz - spectrum.low_hz) / centre;
        let range = 8.0 * PI * l_m * centre / spectrum.speed_m_s;
        let step = 0.02;
        let n = (range / step).ceil().min(200_000.0);
        let step = range / n;
        (0..n as usize)
            .map(|i| {
                let u = (i as f64 + 0.5) * step;
                (u.sin() / u * sinc(ratio * u)).abs() * step
            })
            .sum::<f64>()
            * 2.0
            / PI
    }

    #[test]
    fn the_absolute_mass_of_an_octave_is_bounded_by_1_44() {
        for l in [0.01, 0.1, 1.0, 10.0] {
            let mass = absolute_mass(&OCTAVE, l);
            assert!(mass < 1.445, "{l} m: {mass}");
        }
        // The bound is reached: it is not a generous one.
        assert!(absolute_mass(&OCTAVE, 10.0) > 1.42);
    }
}
