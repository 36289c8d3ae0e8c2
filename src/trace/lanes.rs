//! Arithmetic on the bands of one ray: fixed-size arrays of f32 that the compiler turns into vector instructions.
//!
//! A ray carries all bands at once, padded with zeros to one of a few widths. A padded lane starts at zero and is
//! only ever multiplied by finite factors, so it stays zero.

/// One value a band, padded.
pub(super) type Lanes<const N: usize> = [f32; N];

/// Copies one f64 a band into padded lanes.
pub(super) fn lanes<const N: usize>(values: impl IntoIterator<Item = f64>) -> Lanes<N> {
    let mut out = [0.0; N];
    for (slot, value) in out.iter_mut().zip(values) {
        *slot = value as f32;
    }
    out
}

/// Largest absolute value.
pub(super) fn peak<const N: usize>(weights: &Lanes<N>) -> f32 {
    let mut largest = [0.0f32; N];
    for b in 0..N {
        largest[b] = weights[b].abs();
    }
    largest.iter().fold(0.0, |a, &b| if b > a { b } else { a })
}

/// Mean absolute value over the lanes. Its expectation at a portal is what the portal passes, while that of the largest grows
/// with every crossing, because one direction serves all bands.
#[inline]
pub(super) fn mean<const N: usize>(weights: &Lanes<N>) -> f32 {
    // Four sums side by side: one would wait for itself in every step.
    let mut sums = [0.0f32; 4];
    for four in weights.chunks_exact(4) {
        for (sum, w) in sums.iter_mut().zip(four) {
            *sum += w.abs();
        }
    }
    (sums[0] + sums[1] + (sums[2] + sums[3])) * (1.0 / N as f32)
}

/// Multiplies lane by lane.
#[inline]
pub(super) fn multiply<const N: usize>(weights: &mut Lanes<N>, factors: &Lanes<N>) {
    for (weight, factor) in weights.iter_mut().zip(factors) {
        *weight *= factor;
    }
}

/// Adds lane by lane.
#[inline]
pub(super) fn add<const N: usize>(sums: &mut Lanes<N>, terms: &Lanes<N>) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// The absorption of the air over short distances from a table, over long ones computed.
pub(super) struct Air<const N: usize> {
    attenuation_per_m: Lanes<N>,
    steps_per_m: f32,
    table: Vec<Lanes<N>>,
}

impl<const N: usize> Air<N> {
    /// `attenuation_per_m` in Np/m. The steps are so fine that linear interpolation errs by 1e-7 at most.
    pub(super) fn new(attenuation_per_m: Lanes<N>) -> Self {
        const MOST_STEPS: usize = 512;
        // Interpolating exp(-m r) linearly over a step h errs by (m h)^2/8.
        let steps_per_m = peak(&attenuation_per_m) / (8.0e-7f32).sqrt();
        let table = (0..=MOST_STEPS).map(|i| air_factors(&attenuation_per_m, i as f32 / steps_per_m)).collect();
        Self { attenuation_per_m, steps_per_m, table }
    }

    /// exp(-m_b r), one a band, for a distance `r_m` >= 0.
    #[inline(always)]
    pub(super) fn factors(&self, r_m: f32) -> Lanes<N> {
        let at = r_m * self.steps_per_m;
        let step = at as u32 as usize;
        let Some([low, high]) = self.table.get(step..step + 2) else { return self.far_factors(r_m) };
        let rest = at - step as f32;
        let mut out = [0.0; N];
        for b in 0..N {
            out[b] = low[b] + rest * (high[b] - low[b]);
        }
        out
    }

    #[inline(never)]
    fn far_factors(&self, r_m: f32) -> Lanes<N> {
        air_factors(&self.attenuation_per_m, r_m)
    }
}

/// exp(-m_b r) for attenuations `m_b` in Np/m and a distance `r_m` >= 0: relative error 1e-6 (more by the
/// rounding of m_b r where that is large), and no less than 1e-37.
///
/// 2^y = 2^k 2^f with k the nearest integer and a polynomial for f in +-1/2 (Taylor series to the sixth order: remainder
/// 1.2e-7); k is read from the low mantissa bits of y + 1.5 * 2^23. No branch and no table, so that all lanes go at once.
#[inline]
pub(super) fn air_factors<const N: usize>(attenuation_per_m: &Lanes<N>, r_m: f32) -> Lanes<N> {
    const MAGIC: f32 = 12_582_912.0;
    let mut out = [0.0; N];
    for b in 0..N {
        let y = (attenuation_per_m[b] * r_m * -std::f32::consts::LOG2_E).max(-123.0);
        let shifted = y + MAGIC;
        let f = (y - (shifted - MAGIC)) * std::f32::consts::LN_2;
        let series =
            1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0 + f * (1.0 / 720.0))))));
        let exponent = shifted.to_bits().wrapping_sub(MAGIC.to_bits()).wrapping_add(127);
        out[b] = series * f32::from_bits(exponent << 23);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_factors_equal_the_exponential() {
        for i in 0..20_000 {
            let x = i as f64 * 0.004;
            let got = air_factors::<8>(&lanes([x, 0.0]), 1.0);
            let exact = f64::from(x as f32);
            // The argument itself is rounded to f32: relative error x * 2^-24 times a few roundings.
            assert!((f64::from(got[0]) / (-exact).exp() - 1.0).abs() < 1e-6 + 1.5e-7 * exact, "x = {x}");
            assert_eq!(got[1], 1.0);
        }
        assert!(air_factors::<8>(&lanes([1e9]), 1e9)[0] < 1e-36);
    }

    #[test]
    fn the_table_of_the_air_equals_the_exponential() {
        let attenuation = lanes::<8>([3e-5, 1e-3, 0.027]);
        let air = Air::new(attenuation);
        for i in 0..30_000 {
            let r = i as f32 * 1.3e-3;
            let (table, exact) = (air.factors(r), air_factors(&attenuation, r));
            // 1e-7 of interpolation and two roundings of the table and the sum.
            assert!(table.iter().zip(&exact).all(|(t, e)| (t - e).abs() < 4e-7), "r = {r}: {table:?} {exact:?}");
        }
        assert_eq!(air.factors(0.0), [1.0; 8]);
    }

    #[test]
    fn the_peak_sees_negative_weights() {
        assert_eq!(peak::<8>(&lanes([0.1, -0.7, 0.3])), 0.7);
    }
}
