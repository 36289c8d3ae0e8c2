//! Factorised matrices of openings, with a quarter of the work where mirroring them changes nothing.

use nalgebra::{DMatrix, DVector, Dyn, PermutationSequence};
use num_complex::Complex64;

/// Position in relative units within which openings count as mirrored.
const SAME: f64 = 1e-12;

/// What counts as zero relative to the largest part of a vector or matrix.
const ROUNDING: f64 = 1e-12;
/// Unknowns that are substituted together.
const BLOCK: usize = 24;

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

/// Real and imaginary part: products of real matrices are vector code.
type Split = [DMatrix<f64>; 2];

/// One matrix, ready to be solved: L (with 1 on its diagonal) and U in one matrix. Both substitutions go block by block.
pub(super) struct Part {
    factors: Split,
    /// Which rows changed places.
    order: PermutationSequence<Dyn>,
    /// Inverses of the blocks on the diagonal of L and of U.
    inverses: Vec<[Split; 2]>,
}

/// Limits of the blocks of `n` unknowns, of about the same size.
fn blocks(n: usize) -> impl DoubleEndedIterator<Item = (usize, usize)> + ExactSizeIterator {
    let count = n.div_ceil(BLOCK).max(1);
    (0..count).map(move |i| (i * n / count, (i + 1) * n / count))
}

/// The `rows` x `columns` of `matrix`, copied.
fn copied(matrix: &Split, rows: (usize, usize), columns: (usize, usize)) -> Split {
    let part = |m: &DMatrix<f64>| m.view((rows.0, columns.0), (rows.1 - rows.0, columns.1 - columns.0)).into_owned();
    [part(&matrix[0]), part(&matrix[1])]
}

fn split(matrix: &DMatrix<Complex64>) -> Split {
    [matrix.map(|c| c.re), matrix.map(|c| c.im)]
}

fn product(a: &Split, b: &Split) -> Split {
    [&a[0] * &b[0] - &a[1] * &b[1], &a[0] * &b[1] + &a[1] * &b[0]]
}

/// Adds `share` * `a` to `to` from (row, column) on.
fn put(to: &mut Split, (row, column): (usize, usize), keep: f64, share: f64, a: &Split) {
    for (to, a) in to.iter_mut().zip(a) {
        let mut view = to.view_mut((row, column), a.shape());
        view.zip_apply(a, |to, a| *to = keep * *to + share * a);
    }
}

impl Part {
    /// The equations are uniquely solvable; a failed factorisation means empty openings: silence.
    fn new(matrix: DMatrix<Complex64>) -> Self {
        let n = matrix.nrows();
        let decomposed = matrix.lu();
        let (both, order) = (decomposed.lu_internal(), decomposed.p().clone());
        let inverses = blocks(n)
            .map(|(low, high)| {
                let own = both.view((low, low), (high - low, high - low));
                let one = DMatrix::<Complex64>::identity(high - low, high - low);
                let mut lower = one.clone();
                own.solve_lower_triangular_with_diag_mut(&mut lower, Complex64::ONE);
                let upper = own.solve_upper_triangular(&one).unwrap_or_else(|| DMatrix::zeros(high - low, high - low));
                [split(&lower), split(&upper)]
            })
            .collect();
        Self { factors: split(both), order, inverses }
    }

    /// For each column of `right`.
    fn solve(&self, mut right: Split) -> Split {
        let (n, columns) = right[0].shape();
        right.iter_mut().for_each(|part| self.order.permute_rows(part));
        // L, then U: the rows of a block once those before (behind) it are known.
        let mut substitute =
            |which: usize, (low, high): (usize, usize), known: (usize, usize), inverse: &[Split; 2]| {
                if known.1 > known.0 {
                    let change =
                        product(&copied(&self.factors, (low, high), known), &copied(&right, known, (0, columns)));
                    put(&mut right, (low, 0), 1.0, -1.0, &change);
                }
                let solved = product(&inverse[which], &copied(&right, (low, high), (0, columns)));
                put(&mut right, (low, 0), 0.0, 1.0, &solved);
            };
        for (block, inverse) in blocks(n).zip(&self.inverses) {
            substitute(0, block, (0, block.0), inverse);
        }
        for (block, inverse) in blocks(n).zip(&self.inverses).rev() {
            substitute(1, block, (block.1, n), inverse);
        }
        right
    }

    fn solve_one(&self, right: &DVector<Complex64>) -> DVector<Complex64> {
        let n = right.len();
        let column = |part: fn(&Complex64) -> f64| DMatrix::from_iterator(n, 1, right.iter().map(part));
        let [re, im] = self.solve([column(|c| c.re), column(|c| c.im)]);
        DVector::from_iterator(n, re.iter().zip(&im).map(|(re, im)| Complex64::new(*re, *im)))
    }
}

/// Half of the rows of `matrix`: their mean with (`sign` 1) or half of their difference to (-1) those on the other side.
fn folded(matrix: &DMatrix<f64>, sign: f64) -> DMatrix<f64> {
    let (n, columns) = matrix.shape();
    let size = if sign > 0.0 { n - n / 2 } else { n / 2 };
    DMatrix::from_fn(size, columns, |i, j| 0.5 * (matrix[(i, j)] + sign * matrix[(n - 1 - i, j)]))
}

/// The columns of `half` that are not zero within rounding: those of `whole`, of which it was folded, differ in size by many
/// powers of ten.
fn filled(half: &DMatrix<f64>, whole: &DMatrix<f64>) -> Vec<usize> {
    (0..half.ncols()).filter(|&j| half.column(j).amax() > ROUNDING * whole.column(j).amax()).collect()
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

    /// `left`^T times the solutions for all columns of `right`: real and imaginary part.
    pub(super) fn moments(&self, left: &DMatrix<f64>, right: &DMatrix<f64>) -> Split {
        let imaginary = |right: &DMatrix<f64>| DMatrix::zeros(right.nrows(), right.ncols());
        match self {
            Self::Whole(part) => part.solve([right.clone(), imaginary(right)]).map(|solved| left.tr_mul(&solved)),
            Self::Mirrored(symmetric, antisymmetric) => {
                let count = left.nrows();
                let mut sum = [left, left].map(|left| DMatrix::zeros(left.ncols(), right.ncols()));
                for (part, sign) in [(symmetric, 1.0), (antisymmetric, -1.0)] {
                    let (mut weights, half) = (2.0 * folded(left, sign), folded(right, sign));
                    if sign > 0.0 && count % 2 == 1 {
                        // The node in the middle is there once.
                        weights.row_mut(count / 2).scale_mut(0.5);
                    }
                    let (rows, columns) = (filled(&weights, left), filled(&half, right));
                    let (weights, half) = (weights.select_columns(&rows), half.select_columns(&columns));
                    let solved = part.solve([half.clone(), imaginary(&half)]).map(|solved| weights.tr_mul(&solved));
                    for (sum, solved) in sum.iter_mut().zip(&solved) {
                        for (j, column) in columns.iter().enumerate() {
                            for (i, row) in rows.iter().enumerate() {
                                sum[(*row, *column)] += solved[(i, j)];
                            }
                        }
                    }
                }
                sum
            }
        }
    }

    pub(super) fn solve(&self, right: &DVector<Complex64>) -> DVector<Complex64> {
        match self {
            Self::Whole(part) => part.solve_one(right),
            Self::Mirrored(symmetric, antisymmetric) => {
                let n = right.len();
                let half =
                    |size: usize, sign: f64| DVector::from_fn(size, |i, _| 0.5 * (right[i] + sign * right[n - 1 - i]));
                let (even, odd) = (half(n - n / 2, 1.0), half(n / 2, -1.0));
                // A vector that is symmetric or antisymmetric within rounding takes one part only.
                let least = ROUNDING * even.camax().max(odd.camax());
                let solve = |part: &Part, right: &DVector<Complex64>| match right.camax() > least {
                    true => part.solve_one(right),
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
    fn many_blocks_solve_like_pivoted_elimination() {
        let kernel = |i: usize, j: usize| {
            let apart = i.abs_diff(j) as f64;
            Complex64::new(-(0.05 + 0.1 * apart).ln(), (0.3 * apart).cos())
        };
        for n in [5, 24, 25, 90] {
            let matrix = DMatrix::from_fn(n, n, kernel);
            // Columns as different in size as high orders of waves.
            let size = |j: usize| 1e-9_f64.powi(j as i32);
            let shape = |m: usize| DMatrix::from_fn(n, m, |i, j| size(j) * (0.1 * (i * (j + 1)) as f64).cos());
            let (left, right) = (shape(3), shape(4));
            let complex = |m: &DMatrix<f64>| m.map(Complex64::from);
            let exact = complex(&left).tr_mul(&matrix.clone().lu().solve(&complex(&right)).unwrap());
            for mirrored in [false, true] {
                let [re, im] = Factors::new(matrix.clone(), mirrored).moments(&left, &right);
                let got = re.zip_map(&im, Complex64::new);
                for (i, j) in (0..3).flat_map(|i| (0..4).map(move |j| (i, j))) {
                    let error = (got[(i, j)] - exact[(i, j)]).norm() / (size(i) * size(j));
                    assert!(error < 1e-9 * exact.camax(), "{n} {mirrored} {i} {j}: {error}");
                }
            }
        }
    }

    #[test]
    fn slats_of_one_pitch_are_mirrored_and_others_are_not() {
        assert!(mirrored(&[[0.0, 0.1], [0.3, 0.5], [0.7, 0.8]]));
        assert!(!mirrored(&[[0.0, 0.1], [0.3, 0.5], [0.7, 0.81]]));
    }
}
