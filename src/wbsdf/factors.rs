//! Factorised matrices of openings, with a quarter of the work where mirroring them changes nothing.

use nalgebra::{DMatrix, DVector, Dyn, LU};
use num_complex::Complex64;

/// Position in relative units within which openings count as mirrored.
const SAME: f64 = 1e-12;

/// What counts as zero relative to the largest part of a vector.
const ROUNDING: f64 = 1e-14;

/// Whether the openings are the same seen from the other side of their middle.
pub(super) fn mirrored(openings: &[[f64; 2]]) -> bool {
    let (Some(first), Some(last)) = (openings.first(), openings.last()) else { return false };
    let (sum, span) = (first[0] + last[1], last[1] - first[0]);
    openings.iter().zip(openings.iter().rev()).all(|(a, b)| (a[0] + b[1] - sum).abs() <= SAME * span)
}

/// A factorised matrix.
pub(super) enum Factors {
    Whole(Part),
    /// One that mirroring x leaves as it is: for symmetric and antisymmetric vectors, a quarter of the work.
    Mirrored(Part, Part),
}

/// One matrix, ready to be solved: the inverse of a small one, where a product is faster than two substitutions.
pub(super) enum Part {
    Factors(LU<Complex64, Dyn, Dyn>),
    Inverse(DMatrix<Complex64>),
}

/// Most unknowns of a matrix that is inverted.
const SMALL: usize = 40;

impl Part {
    /// The equations are uniquely solvable; a failed factorisation means empty openings: silence.
    fn new(matrix: DMatrix<Complex64>) -> Self {
        let n = matrix.nrows();
        let factors = matrix.lu();
        if n > SMALL {
            return Self::Factors(factors);
        }
        Self::Inverse(factors.try_inverse().unwrap_or_else(|| DMatrix::zeros(n, n)))
    }

    fn solve(&self, right: &DVector<Complex64>) -> DVector<Complex64> {
        match self {
            Self::Factors(factors) => factors.solve(right).unwrap_or_else(|| DVector::zeros(right.len())),
            Self::Inverse(inverse) => inverse * right,
        }
    }
}

impl Factors {
    pub(super) fn new(matrix: DMatrix<Complex64>, mirrored: bool) -> Self {
        if !mirrored {
            return Self::Whole(Part::new(matrix));
        }
        let (n, half) = (matrix.nrows(), matrix.nrows() / 2);
        let part = |size: usize, sign: f64| {
            let folded = |i: usize, j: usize| match n - 1 - j == j {
                true => matrix[(i, j)],
                false => matrix[(i, j)] + sign * matrix[(i, n - 1 - j)],
            };
            Part::new(DMatrix::from_fn(size, size, folded))
        };
        Self::Mirrored(part(n - half, 1.0), part(half, -1.0))
    }

    pub(super) fn solve(&self, right: &DVector<Complex64>) -> DVector<Complex64> {
        match self {
            Self::Whole(part) => part.solve(right),
            Self::Mirrored(symmetric, antisymmetric) => {
                let n = right.len();
                let half =
                    |size: usize, sign: f64| DVector::from_fn(size, |i, _| 0.5 * (right[i] + sign * right[n - 1 - i]));
                let (even, odd) = (half(n - n / 2, 1.0), half(n / 2, -1.0));
                // A vector that is symmetric or antisymmetric within rounding takes one part only.
                let least = ROUNDING * even.camax().max(odd.camax());
                let solve = |part: &Part, right: &DVector<Complex64>| match right.camax() > least {
                    true => part.solve(right),
                    false => DVector::zeros(right.len()),
                };
                let (same, opposite) = (solve(symmetric, &even), solve(antisymmetric, &odd));
                DVector::from_fn(n, |i, _| {
                    let mirror = n - 1 - i;
                    let odd = if i < n / 2 {
                        opposite[i]
                    } else if mirror < n / 2 {
                        -opposite[mirror]
                    } else {
                        Complex64::ZERO
                    };
                    same[i.min(mirror)] + odd
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_matrix_solves_like_the_whole_one() {
        for n in [6, 7] {
            let value = |i: usize, j: usize| Complex64::new(1.0 / (1.0 + i.abs_diff(j) as f64), 0.1 * (i * j) as f64);
            let matrix = DMatrix::from_fn(n, n, |i, j| value(i, j) + value(n - 1 - i, n - 1 - j));
            let right = DVector::from_fn(n, |i, _| Complex64::new(i as f64, 1.0));
            let whole = Factors::new(matrix.clone(), false).solve(&right);
            let folded = Factors::new(matrix, true).solve(&right);
            assert!((whole - folded).norm() < 1e-10);
        }
    }

    #[test]
    fn slats_of_one_pitch_are_mirrored_and_others_are_not() {
        assert!(mirrored(&[[0.0, 0.1], [0.3, 0.5], [0.7, 0.8]]));
        assert!(!mirrored(&[[0.0, 0.1], [0.3, 0.5], [0.7, 0.81]]));
    }
}
