//! Hankel's function for the complex arguments that steepest descent needs.

use std::f64::consts::PI;
use std::num::NonZeroUsize;
use std::sync::LazyLock;

use gauss_quad::hermite::GaussHermite;
use num_complex::Complex64;

/// |z| from which the asymptotic series is used: its fifth term is 1e-6 there.
const FAR: f64 = 12.0;

/// Positive nodes of a Gauss-Hermite rule with their weights doubled.
static HERMITE: LazyLock<Vec<(f64, f64)>> = LazyLock::new(|| {
    let rule = GaussHermite::new(NonZeroUsize::new(40).unwrap_or(NonZeroUsize::MIN));
    rule.iter().filter(|(x, _)| *x > 0.0).map(|&(x, w)| (x, 2.0 * w)).collect()
});

/// H0^(1)(z) exp(-i z) for Re z > 0, Im z >= 0.
///
/// sqrt(2/(pi z)) exp(-i pi/4) / sqrt(pi) int_0^inf exp(-u) u^(-1/2) (1 + i u/(2 z))^(-1/2) du (Abramowitz and Stegun
/// 9.1.24 turned to steepest descent), u = x^2 on Gauss-Hermite nodes; its asymptotic series for large |z|. Relative
/// error below 1e-5 for |z| > 0.5.
pub(super) fn scaled_hankel0(z: Complex64) -> Complex64 {
    let amplitude = (2.0 / (PI * z)).sqrt() * Complex64::from_polar(1.0, -0.25 * PI);
    if z.norm() > FAR {
        // 1 + sum of i^m a_m / z^m, a_m = (-1)^m (1^2 3^2 ... (2m-1)^2) / (m! 8^m).
        let y = Complex64::I / z;
        return amplitude
            * (1.0 + y * (-0.125 + y * (0.070_312_5 + y * (-0.073_242_187_5 + y * 0.112_152_099_609_375))));
    }
    let half = Complex64::I / (2.0 * z);
    let sum: Complex64 = HERMITE.iter().map(|&(x, weight)| weight / (1.0 + half * (x * x)).sqrt()).sum();
    amplitude * sum / PI.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_arguments_agree_with_bessels_functions() {
        for x in [0.5, 1.0, 3.0, 11.9, 12.1, 40.0] {
            let expected = Complex64::new(libm::j0(x), libm::y0(x)) * Complex64::from_polar(1.0, -x);
            let got = scaled_hankel0(Complex64::from(x));
            assert!((got - expected).norm() < 1e-5 * expected.norm(), "{x}: {got} {expected}");
        }
    }

    #[test]
    fn both_forms_agree_where_they_meet_in_the_complex_plane() {
        for angle in [0.0, 0.5, 1.0, 1.5] {
            let at = |r: f64| scaled_hankel0(Complex64::from_polar(r, angle));
            let (near, far) = (at(FAR * (1.0 - 1e-9)), at(FAR * (1.0 + 1e-9)));
            assert!((near - far).norm() < 3e-6 * far.norm(), "{angle}: {near} {far}");
        }
    }
}
