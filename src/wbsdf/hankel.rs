//! Hankel's function: fast for real arguments, of which the exact aperture takes thousands a level, and for the complex
//! ones that steepest descent needs. Sine and cosine without a call, for loops over many rays.

use std::f64::consts::{FRAC_1_PI, FRAC_1_SQRT_2, FRAC_2_PI, FRAC_PI_4, PI};

use num_complex::Complex64;

/// Argument from which P and Q are used.
const SPLIT: f64 = 8.0;
// Chebyshev interpolation of the exact functions (40 digits), written in powers.
/// P of Abramowitz and Stegun 9.2.9 for x >= 8, in powers of 2 (8/x)^2 - 1; error 4e-13.
const FAR_P: [f64; 8] = [
    0.9994572757882093,
    -0.0005363673191684473,
    6.137417432053801e-06,
    -2.0527506887046807e-07,
    1.2797095113528345e-08,
    -1.2100433370147669e-09,
    1.6538439639517417e-10,
    -2.7549304767522505e-11,
];
/// Q x/8 likewise.
const FAR_Q: [f64; 8] = [
    -0.01555511387948075,
    6.833149095616623e-05,
    -1.4771398709162144e-06,
    7.106263902364419e-08,
    -5.6636088732852175e-09,
    6.41550679343059e-10,
    -1.0261591747189231e-10,
    1.923932880225092e-11,
];
/// J0 for x < 8 in powers of x^2/32 - 1; error 1e-15.
const NEAR_J: [f64; 16] = [
    0.045829664859813754,
    0.9303012472958572,
    -0.6484692830871821,
    -0.8080888076696872,
    1.0383794611436883,
    -0.5074680458471,
    0.14598884856785538,
    -0.028472718610882047,
    0.004058078988108771,
    -0.0004435459224311503,
    3.847320005801417e-05,
    -2.717749223632098e-06,
    1.5955848859935914e-07,
    -7.91532308295207e-09,
    3.3794626319436793e-10,
    -1.243301171273326e-11,
];
/// Y0 - (2/pi) ln(x) J0 likewise; error 2e-15.
const NEAR_Y: [f64; 16] = [
    -0.38225065445942497,
    -0.8284358903604587,
    1.6470964788745432,
    0.14412632369302475,
    -1.077547733821527,
    0.6721770783431679,
    -0.21895747096229642,
    0.046367047681375125,
    -0.0070257410549918785,
    0.000806158605961636,
    -7.279542368660281e-05,
    5.3213188103997145e-06,
    -3.218450383864968e-07,
    1.6390875014077404e-08,
    -7.165821913752182e-10,
    2.6926938054524057e-11,
];

/// P of order 1, as [`FAR_P`].
const FAR_P1: [f64; 8] = [
    1.0009070262781276,
    0.000898804941660262,
    -7.95969614966971e-06,
    2.453679909602863e-07,
    -1.4701327061280622e-08,
    1.3586817885205127e-09,
    -1.825325287137717e-10,
    2.972588010402764e-11,
];
/// Q x/8 of order 1 likewise.
const FAR_Q1: [f64; 8] = [
    0.046776874027414277,
    -9.6214588212007e-05,
    1.8212029592924738e-06,
    -8.291987957703484e-08,
    6.414655258308794e-09,
    -7.137670717602362e-10,
    1.1246617493324094e-10,
    -2.0599700162259184e-11,
];
/// J1/x for x < 8, as [`NEAR_J`].
const NEAR_J1: [f64; 16] = [
    -0.05814382795599107,
    0.08105866038589796,
    0.15151665143806637,
    -0.2595948652859303,
    0.1585837643272184,
    -0.05474581821284725,
    0.012456814392263375,
    -0.0020290394945704575,
    0.00024949458135972766,
    -2.404574866003479e-05,
    1.8684526037182737e-06,
    -1.196708182234105e-07,
    6.43119017895857e-09,
    -2.943016833829492e-10,
    1.1658971884036516e-11,
    -4.003763281579675e-13,
];
/// [Y1 - (2/pi) (ln(x) J1 - 1/x)]/x likewise.
const NEAR_Y1: [f64; 16] = [
    0.07075985882118005,
    -0.24337743079193114,
    0.02336757172099348,
    0.23507209206669754,
    -0.19639839859930204,
    0.07854786922242538,
    -0.01962875683311711,
    0.0034224907399185272,
    -0.00044381734344201834,
    4.4674330127252e-05,
    -3.6010000225850993e-06,
    2.3804930317310603e-07,
    -1.3153147370992128e-08,
    6.169694909376002e-10,
    -2.4995314348224964e-11,
    8.758166378734063e-13,
];

/// sum of c_n x^n.
#[inline(always)]
fn polynomial<const N: usize>(c: &[f64; N], x: f64) -> f64 {
    let mut sum = c[N - 1];
    for n in (0..N - 1).rev() {
        sum = sum * x + c[n];
    }
    sum
}

/// sin(x) and cos(x) in plain arithmetic, so that loops over rays become vector code.
///
/// Taylor series about the nearest multiple of pi/2 (in two parts: Cody and Waite); absolute error below 1e-13 up to
/// |x| = 1e4 and 1e-17 |x| beyond; |x| < 1e9.
#[inline(always)]
pub(super) fn sin_cos(x: f64) -> (f64, f64) {
    /// Adding it rounds to an integer, which then stands in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    /// pi/2 in 33 bits and the rest.
    const HALF_PI: [f64; 2] = [1.570_796_326_734_125_6, 6.077_100_506_506_192e-11];
    let shifted = x * FRAC_2_PI + ROUND;
    let quarter = shifted.to_bits();
    let turns = shifted - ROUND;
    let r = (x - turns * HALF_PI[0]) - turns * HALF_PI[1];
    let q = r * r;
    let sine = r + r
        * q
        * polynomial(
            &[-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0, 1.0 / 6_227_020_800.0],
            q,
        );
    let cosine = 1.0
        + q * polynomial(
            &[
                -0.5,
                1.0 / 24.0,
                -1.0 / 720.0,
                1.0 / 40_320.0,
                -1.0 / 3_628_800.0,
                1.0 / 479_001_600.0,
                -1.0 / 87_178_291_200.0,
            ],
            q,
        );
    // An odd quarter swaps the two; the sine changes sign in the quarters 2 and 3, the cosine in 1 and 2.
    let swap = 0u64.wrapping_sub(quarter & 1);
    let (s, c) = (sine.to_bits(), cosine.to_bits());
    let sign_s = (quarter & 2) << 62;
    let sign_c = (quarter.wrapping_add(1) & 2) << 62;
    (f64::from_bits(((s & !swap) | (c & swap)) ^ sign_s), f64::from_bits(((c & !swap) | (s & swap)) ^ sign_c))
}

/// Hankel function of the first kind and order 0 for x > 0; relative error below 1e-11.
///
/// sqrt(2/(pi x)) (P + i Q) exp(i (x - pi/4)) (Abramowitz and Stegun 9.2.9) from 8 on, J0 and the part of Y0 without its
/// logarithm as polynomials below.
#[inline]
pub(super) fn hankel0(x: f64) -> Complex64 {
    if x >= SPLIT {
        let (re, im) = hankel0_far(x);
        Complex64::new(re, im)
    } else {
        let j0 = bessel0_near(x);
        Complex64::new(j0, polynomial(&NEAR_Y, x * x / 32.0 - 1.0) + FRAC_2_PI * x.ln() * j0)
    }
}

/// The same for many arguments, in vector code where all of a block are far.
pub(super) fn hankel0_each(arguments: &[f64]) -> Vec<Complex64> {
    const BLOCK: usize = 8;
    let mut values = Vec::with_capacity(arguments.len());
    for block in arguments.chunks(BLOCK) {
        match <&[f64; BLOCK]>::try_from(block) {
            Ok(block) if block.iter().all(|x| *x >= SPLIT) => {
                let (mut re, mut im) = ([0.0; BLOCK], [0.0; BLOCK]);
                for ((re, im), x) in re.iter_mut().zip(&mut im).zip(block) {
                    (*re, *im) = hankel0_far(*x);
                }
                values.extend(re.iter().zip(&im).map(|(re, im)| Complex64::new(*re, *im)));
            }
            _ => values.extend(block.iter().map(|x| hankel0(*x))),
        }
    }
    values
}

/// Real and imaginary part for x >= 8.
#[inline(always)]
fn hankel0_far(x: f64) -> (f64, f64) {
    let inverse = SPLIT / x;
    let t = 2.0 * inverse * inverse - 1.0;
    let (p, q) = (polynomial(&FAR_P, t), inverse * polynomial(&FAR_Q, t));
    let (sin, cos) = sin_cos(x - FRAC_PI_4);
    let amplitude = (2.0 * FRAC_1_PI / x).sqrt();
    (amplitude * (p * cos - q * sin), amplitude * (p * sin + q * cos))
}

#[inline]
fn bessel0_near(x: f64) -> f64 {
    polynomial(&NEAR_J, x * x / 32.0 - 1.0)
}

/// H0 and H1 (real and imaginary parts) of several x > 0 side by side; relative error below 1e-11.
#[inline(always)]
pub(super) fn hankel01<const N: usize>(x: &[f64; N]) -> [[[f64; N]; 2]; 2] {
    let mut values = [[[0.0; N]; 2]; 2];
    if x.iter().all(|x| *x >= SPLIT) {
        for i in 0..N {
            let inverse = SPLIT / x[i];
            let t = 2.0 * inverse * inverse - 1.0;
            let (p, q) = (polynomial(&FAR_P, t), inverse * polynomial(&FAR_Q, t));
            let (p1, q1) = (polynomial(&FAR_P1, t), inverse * polynomial(&FAR_Q1, t));
            let (sin, cos) = sin_cos(x[i] - FRAC_PI_4);
            let amplitude = (2.0 * FRAC_1_PI / x[i]).sqrt();
            values[0][0][i] = amplitude * (p * cos - q * sin);
            values[0][1][i] = amplitude * (p * sin + q * cos);
            // A quarter turn behind.
            values[1][0][i] = amplitude * (p1 * sin + q1 * cos);
            values[1][1][i] = amplitude * (q1 * sin - p1 * cos);
        }
        return values;
    }
    if x.iter().all(|x| *x < SPLIT) {
        let logarithms = x.map(f64::ln);
        for i in 0..N {
            let t = x[i] * x[i] / 32.0 - 1.0;
            let (j0, j1) = (polynomial(&NEAR_J, t), x[i] * polynomial(&NEAR_J1, t));
            let logarithm = FRAC_2_PI * logarithms[i];
            values[0][0][i] = j0;
            values[0][1][i] = polynomial(&NEAR_Y, t) + logarithm * j0;
            values[1][0][i] = j1;
            values[1][1][i] = x[i] * polynomial(&NEAR_Y1, t) + logarithm * j1 - FRAC_2_PI / x[i];
        }
        return values;
    }
    for i in 0..N {
        let [zero, one] = hankel01_of(x[i]);
        (values[0][0][i], values[0][1][i], values[1][0][i], values[1][1][i]) = (zero.re, zero.im, one.re, one.im);
    }
    values
}

/// H0 and H1 of one x > 0.
fn hankel01_of(x: f64) -> [Complex64; 2] {
    let [zero, one] = hankel01(&[x]);
    [zero, one].map(|[re, im]| Complex64::new(re[0], im[0]))
}

/// |H0|^2 of several x > 0 side by side.
#[inline(always)]
pub(super) fn hankel0_square<const N: usize>(x: &[f64; N]) -> [f64; N] {
    if x.iter().all(|x| *x >= SPLIT) {
        return x.map(|x| {
            let inverse = SPLIT / x;
            let t = 2.0 * inverse * inverse - 1.0;
            let (p, q) = (polynomial(&FAR_P, t), inverse * polynomial(&FAR_Q, t));
            2.0 * FRAC_1_PI / x * (p * p + q * q)
        });
    }
    x.map(|x| hankel0(x).norm_sqr())
}

/// Poles p and residues d of H0^(1)(z) exp(-i z) = sqrt(2/(pi z)) exp(-i pi/4) [1 - sum d/(p - i z)]. The bracket is a Stieltjes
/// function of i/z (Abramowitz and Stegun 9.1.24 turned to steepest descent), so poles on one half axis do for the whole
/// quadrant: least squares on 910 points with 0.1 < |z| < 200 against Amos' algorithm.
const POLES: [(f64, f64); 7] = [
    (0.012433832780856453, 0.003340068007134073),
    (0.05377343539348263, 0.009705923787589148),
    (0.13231413194087063, 0.0182714857767035),
    (0.2790937614235941, 0.029176521148750002),
    (0.5636940993537409, 0.03515899611400154),
    (1.1293084281284789, 0.024161314482526515),
    (2.3157447774830073, 0.005181112106904951),
];

/// |z| from which three terms of the asymptotic series do: the fourth is 1e-6 there.
const FAR: f64 = 40.0;

/// H0^(1)(z) exp(-i z) for Re z >= 0, Im z >= 0; relative error below 1.5e-6 for |z| > 0.15 and below 1e-7 from 50 on.
pub(super) fn scaled_hankel0(z: Complex64) -> Complex64 {
    sqrt_right(2.0 / (PI * z)) * Complex64::new(FRAC_1_SQRT_2, -FRAC_1_SQRT_2) * hankel0_ratio(z)
}

/// The same over its limit for large |z|, sqrt(2/(pi z)) exp(-i pi/4).
#[inline]
pub(super) fn hankel0_ratio(z: Complex64) -> Complex64 {
    if z.norm_sqr() > FAR * FAR {
        let y = Complex64::I / z;
        return 1.0 + y * (-0.125 + y * 0.070_312_5);
    }
    let (mut re, mut im) = (1.0, 0.0);
    for (pole, residue) in POLES {
        // 1/(pole - i z)
        let (a, b) = (pole + z.im, z.re);
        let share = residue / (a * a + b * b);
        re -= share * a;
        im -= share * b;
    }
    Complex64::new(re, im)
}

/// The square root of a number with a positive real part, without angles.
#[inline]
fn sqrt_right(z: Complex64) -> Complex64 {
    let re = (0.5 * (z.norm_sqr().sqrt() + z.re)).sqrt();
    Complex64::new(re, 0.5 * z.im / re)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fast_functions_are_the_library_s_within_rounding() {
        for i in 0..4000 {
            let x = 1e-7 * 1.0075_f64.powi(i) + 1e-3 * f64::from(i);
            let (exact, got) = (Complex64::new(libm::j0(x), libm::y0(x)), hankel0(x));
            // The phase x itself is only known to 1e-16 x.
            assert!((got - exact).norm() < (1e-11 + 1e-15 * x) * exact.norm(), "{x}: {got} {exact}");
            for x in [x, -x] {
                let (sin, cos) = sin_cos(x);
                assert!((sin - x.sin()).abs() + (cos - x.cos()).abs() < 1e-13 + 1e-15 * x.abs(), "{x}: {sin} {cos}");
            }
        }
    }

    #[test]
    fn both_orders_side_by_side_are_the_library_s() {
        for i in 0..2000 {
            let x = [1e-6, 1.0, 1.1, 1.2].map(|f| f * 1e-3 * 1.0075_f64.powi(i));
            let [zero, one] = hankel01(&x);
            let squares = hankel0_square(&x);
            for lane in 0..4 {
                let x = x[lane];
                let exact = [Complex64::new(libm::j0(x), libm::y0(x)), Complex64::new(libm::j1(x), libm::y1(x))];
                for ([re, im], exact) in [zero, one].iter().zip(exact) {
                    let got = Complex64::new(re[lane], im[lane]);
                    assert!((got - exact).norm() < (1e-11 + 1e-15 * x) * exact.norm(), "{x}: {got} {exact}");
                }
                assert!((squares[lane] / exact[0].norm_sqr() - 1.0).abs() < 1e-10, "{x}");
            }
        }
    }

    #[test]
    fn many_arguments_at_once_are_the_same_one_by_one() {
        let arguments: Vec<f64> = (1..40).map(|i| 0.7 * f64::from(i)).collect();
        for (x, value) in arguments.iter().zip(hankel0_each(&arguments)) {
            assert!((value - hankel0(*x)).norm() < 1e-14);
        }
    }

    #[test]
    fn real_arguments_agree_with_bessels_functions() {
        for x in [0.5, 1.0, 3.0, 11.9, 12.1, 40.0] {
            let expected = Complex64::new(libm::j0(x), libm::y0(x)) * Complex64::from_polar(1.0, -x);
            let got = scaled_hankel0(Complex64::from(x));
            assert!((got - expected).norm() < 1.5e-6 * expected.norm(), "{x}: {got} {expected}");
        }
    }

    #[test]
    fn complex_arguments_agree_with_the_integral_of_steepest_descent() {
        // sqrt(2/(pi z)) exp(-i pi/4) (2/sqrt(pi)) int_0^inf exp(-x^2) (1 + i x^2/(2 z))^(-1/2) dx by the trapezoidal rule.
        for (r, angle) in [(0.3, 0.0), (0.3, 1.5), (1.0, 0.7), (4.0, 1.57), (11.0, 0.3), (60.0, 1.2)] {
            let z = Complex64::from_polar(r, angle);
            let n = 20_000;
            let step = 8.0 / f64::from(n);
            let term = |i: i32| {
                let x = (f64::from(i) + 0.5) * step;
                (-x * x).exp() / (1.0 + Complex64::I / (2.0 * z) * (x * x)).sqrt() * step
            };
            let expected = (0..n).map(term).sum::<Complex64>() * 2.0 / PI.sqrt();
            let got = hankel0_ratio(z);
            assert!((got - expected).norm() < 1.5e-6 * expected.norm(), "{r} {angle}: {got} {expected}");
            let whole = (2.0 / (PI * z)).sqrt() * Complex64::from_polar(1.0, -FRAC_PI_4) * got;
            assert!((scaled_hankel0(z) - whole).norm() < 1e-14 * whole.norm());
        }
    }
}
