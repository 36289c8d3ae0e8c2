//! Factorised matrices of openings, with a quarter of the work where mirroring them changes nothing.
//!
//! They are symmetric: what a place sends to another it gets from there. L D L^T without exchanges of rows takes half of what L U
//! would; as for [`Symmetric`](super::symmetric::Symmetric) the radiation in their imaginary part, never negative, keeps pivots from vanishing.
//! Real and imaginary parts lie apart and blocks of unknowns are eliminated together, so that most of it is products of real matrices.

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, DVector};
use num_complex::Complex64;

/// Position in relative units within which openings count as mirrored.
const SAME: f64 = 1e-12;

/// What counts as zero relative to the largest part of a vector or matrix.
const ROUNDING: f64 = 1e-12;
/// Unknowns that are eliminated together.
const BLOCK: usize = 24;

/// Whether the openings are the same seen from the other side of their middle.
pub(super) fn mirrored(openings: &[[f64; 2]]) -> bool {
    let (Some(first), Some(last)) = (openings.first(), openings.last()) else { return false };
    let (sum, span) = (first[0] + last[1], last[1] - first[0]);
    openings.iter().zip(openings.iter().rev()).all(|(a, b)| (a[0] + b[1] - sum).abs() <= SAME * span)
}

/// A factorised symmetric matrix.
pub(super) enum Factors {
    Whole(Part),
    /// One that mirroring x leaves as it is: for symmetric and antisymmetric vectors, a quarter of the work.
    Mirrored(Part, Part),
}

/// Real and imaginary part.
pub(super) type Split = [DMatrix<f64>; 2];

/// One matrix, ready to be solved.
pub(super) struct Part {
    /// Below the diagonal: L, which has 1 on it.
    lower: Split,
    /// D^-1.
    pivots: Vec<Complex64>,
    /// Inverses of the blocks on the diagonal of L.
    inverses: Vec<Split>,
}

/// Limits of the blocks of `n` unknowns, of about the same size.
fn blocks(n: usize) -> impl Iterator<Item = (usize, usize)> {
    let count = n.div_ceil(BLOCK).max(1);
    (0..count).map(move |i| (i * n / count, (i + 1) * n / count))
}

fn split(matrix: &DMatrix<Complex64>) -> Split {
    [matrix.map(|c| c.re), matrix.map(|c| c.im)]
}

/// to = keep * to + share * a b, for complex matrices.
fn add_product(
    to: [DMatrixViewMut<f64>; 2],
    keep: f64,
    share: f64,
    a: [DMatrixView<f64>; 2],
    b: [DMatrixView<f64>; 2],
) {
    let [mut re, mut im] = to;
    re.gemm(share, &a[0], &b[0], keep);
    re.gemm(-share, &a[1], &b[1], 1.0);
    im.gemm(share, &a[0], &b[1], keep);
    im.gemm(share, &a[1], &b[0], 1.0);
}

fn product(a: &Split, b: &Split) -> Split {
    let mut product = [0, 1].map(|_| DMatrix::zeros(a[0].nrows(), b[0].ncols()));
    let [re, im] = &mut product;
    add_product([re.as_view_mut(), im.as_view_mut()], 0.0, 1.0, views(a), views(b));
    product
}

fn views(matrix: &Split) -> [DMatrixView<'_, f64>; 2] {
    [matrix[0].as_view(), matrix[1].as_view()]
}

/// The block of a few unknowns: its L with 1 on the diagonal, and D^-1.
fn eliminated(mut block: DMatrix<Complex64>) -> (DMatrix<Complex64>, Vec<Complex64>) {
    let n = block.nrows();
    let pivots = (0..n)
        .map(|k| {
            let pivot = block[(k, k)].inv();
            let (done, rest) = block.as_mut_slice().split_at_mut((k + 1) * n);
            let column = &mut done[k * n + k..];
            column[0] = Complex64::ONE;
            for j in 1..column.len() {
                let factor = column[j] * pivot;
                let below = &mut rest[(j - 1) * n + k + j..j * n];
                below.iter_mut().zip(&column[j..]).for_each(|(to, value)| *to -= factor * value);
            }
            column[1..].iter_mut().for_each(|value| *value *= pivot);
            pivot
        })
        .collect();
    (block, pivots)
}

/// The inverse of the lower triangle of `lower`, which has 1 on its diagonal.
fn inverse(lower: &DMatrix<Complex64>) -> DMatrix<Complex64> {
    let n = lower.nrows();
    let mut inverse = DMatrix::identity(n, n);
    for (j, column) in inverse.as_mut_slice().chunks_mut(n).enumerate() {
        for k in j..n {
            let value: Complex64 = column[k];
            let below = &lower.as_slice()[k * n + k + 1..(k + 1) * n];
            column[k + 1..].iter_mut().zip(below).for_each(|(to, l)| *to -= value * l);
        }
    }
    inverse
}

impl Part {
    fn new(mut matrix: Split) -> Self {
        let n = matrix[0].nrows();
        let (mut pivots, mut inverses) = (Vec::with_capacity(n), Vec::new());
        for (low, high) in blocks(n) {
            let (size, rest) = (high - low, n - high);
            let own = matrix.each_ref().map(|part| part.view((low, low), (size, size)));
            let (block, own_pivots) = eliminated(own[0].zip_map(&own[1], Complex64::new));
            let inverted = inverse(&block);
            // Rows below: A = (L D) L^T of the block.
            let below = matrix.each_ref().map(|part| part.view((high, low), (rest, size)));
            let mut scaled = [0, 1].map(|_| DMatrix::zeros(rest, size));
            let [re, im] = &mut scaled;
            let transposed = split(&inverted.transpose());
            add_product([re.as_view_mut(), im.as_view_mut()], 0.0, 1.0, below, views(&transposed));
            let mut lower = scaled.clone();
            let [re, im] = &mut lower;
            for ((re, im), pivot) in columns(re).zip(columns(im)).zip(&own_pivots) {
                scale(*pivot, re, im);
            }
            let across = [lower[0].transpose(), lower[1].transpose()];
            let trailing = matrix.each_mut().map(|part| part.view_mut((high, high), (rest, rest)));
            add_product(trailing, 1.0, -1.0, views(&scaled), views(&across));
            let block = split(&block);
            for (part, (block, lower)) in matrix.iter_mut().zip(block.iter().zip(&lower)) {
                part.view_mut((low, low), (size, size)).copy_from(block);
                part.view_mut((high, low), (rest, size)).copy_from(lower);
            }
            pivots.extend(own_pivots);
            inverses.push(split(&inverted));
        }
        Self { lower: matrix, pivots, inverses }
    }

    /// L^-1 of each column.
    fn forward(&self, mut right: Split) -> Split {
        let columns = right[0].ncols();
        for ((low, high), inverse) in blocks(self.pivots.len()).zip(&self.inverses) {
            let lower = self.lower.each_ref().map(|part| part.view((low, 0), (high - low, low)));
            let [re, im] = &mut right;
            let ((known_re, own_re), (known_im, own_im)) =
                (re.rows_range_pair_mut(0..low, low..high), im.rows_range_pair_mut(0..low, low..high));
            add_product([own_re, own_im], 1.0, -1.0, lower, [known_re.as_view(), known_im.as_view()]);
            let own = right.each_ref().map(|part| part.view((low, 0), (high - low, columns)));
            let mut solved = [0, 1].map(|_| DMatrix::zeros(high - low, columns));
            let [re, im] = &mut solved;
            add_product([re.as_view_mut(), im.as_view_mut()], 0.0, 1.0, views(inverse), own);
            for (part, solved) in right.iter_mut().zip(&solved) {
                part.view_mut((low, 0), (high - low, columns)).copy_from(solved);
            }
        }
        right
    }

    /// `shapes`^T times the solutions for all of its columns.
    fn moments(&self, shapes: DMatrix<f64>) -> Split {
        let imaginary = DMatrix::zeros(shapes.nrows(), shapes.ncols());
        let half = self.forward([shapes, imaginary]);
        let mut scaled = [half[0].transpose(), half[1].transpose()];
        let [re, im] = &mut scaled;
        for ((re, im), pivot) in columns(re).zip(columns(im)).zip(&self.pivots) {
            scale(*pivot, re, im);
        }
        product(&scaled, &half)
    }

    /// Solves with the right side in place.
    fn solve(&self, values: &mut DVector<Complex64>) {
        let n = self.pivots.len();
        let [re, im] = self.lower.each_ref().map(|part| part.as_slice());
        let below = |k: usize| re[k * n + k + 1..(k + 1) * n].iter().zip(&im[k * n + k + 1..(k + 1) * n]);
        let values = values.as_mut_slice();
        for k in 0..n {
            let value = values[k];
            for (to, (re, im)) in values[k + 1..].iter_mut().zip(below(k)) {
                *to -= value * Complex64::new(*re, *im);
            }
        }
        for k in (0..n).rev() {
            let known: Complex64 =
                values[k + 1..].iter().zip(below(k)).map(|(v, (re, im))| v * Complex64::new(*re, *im)).sum();
            values[k] = values[k] * self.pivots[k] - known;
        }
    }
}

fn columns(matrix: &mut DMatrix<f64>) -> std::slice::ChunksMut<'_, f64> {
    let rows = matrix.nrows().max(1);
    matrix.as_mut_slice().chunks_mut(rows)
}

/// Multiplies complex numbers, their parts apart.
fn scale(factor: Complex64, re: &mut [f64], im: &mut [f64]) {
    for (re, im) in re.iter_mut().zip(im) {
        (*re, *im) = (factor.re * *re - factor.im * *im, factor.re * *im + factor.im * *re);
    }
}

/// The sums (`sign` 1) or differences (-1) of the rows of `matrix` and those on the other side; a row in the middle counts once.
fn folded(matrix: &DMatrix<f64>, sign: f64) -> DMatrix<f64> {
    let (n, columns) = matrix.shape();
    let size = if sign > 0.0 { n - n / 2 } else { n / 2 };
    let mut values = Vec::with_capacity(size * columns);
    for column in matrix.as_slice().chunks(n.max(1)) {
        let (front, back) = column.split_at(n / 2);
        values.extend(front.iter().zip(back.iter().rev()).map(|(a, b)| a + sign * b));
        if sign > 0.0 && n % 2 == 1 {
            values.push(back[0]);
        }
    }
    DMatrix::from_vec(size, columns, values)
}

/// A mirrored matrix, [`folded`] along its rows and its columns.
fn twice_folded(matrix: &DMatrix<Complex64>, sign: f64) -> Split {
    let n = matrix.nrows();
    let size = if sign > 0.0 { n - n / 2 } else { n / 2 };
    let mut halves = [0, 1].map(|_| Vec::with_capacity(size * size));
    let column = |j: usize| &matrix.as_slice()[j * n..j * n + size];
    for j in 0..size {
        for (i, (near, far)) in column(j).iter().zip(column(n - 1 - j)).enumerate() {
            // Rows below the middle are those above, the row and the column in the middle count once.
            let rows = if 2 * i + 1 == n { 1.0 } else { 2.0 };
            let columns = if 2 * j + 1 == n { 0.5 } else { 1.0 };
            let value = (near + sign * far) * (rows * columns);
            halves[0].push(value.re);
            halves[1].push(value.im);
        }
    }
    halves.map(|values| DMatrix::from_vec(size, size, values))
}

/// The columns of `half` that are not zero within rounding: those of `whole`, of which it was folded, differ in size by many
/// powers of ten.
fn filled(half: &DMatrix<f64>, whole: &DMatrix<f64>) -> Vec<usize> {
    let largest = |column: &[f64]| column.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let of = |matrix: &DMatrix<f64>, j: usize| {
        let n = matrix.nrows();
        largest(&matrix.as_slice()[j * n..(j + 1) * n])
    };
    (0..half.ncols()).filter(|&j| of(half, j) > ROUNDING * of(whole, j)).collect()
}

impl Factors {
    /// Of a symmetric matrix. The equations are uniquely solvable.
    pub(super) fn new(matrix: &DMatrix<Complex64>, mirrored: bool) -> Self {
        match mirrored {
            true => Self::Mirrored(Part::new(twice_folded(matrix, 1.0)), Part::new(twice_folded(matrix, -1.0))),
            false => Self::Whole(Part::new(split(matrix))),
        }
    }

    /// Of one that mirroring leaves as it is, from what it does to symmetric and to antisymmetric vectors: between the unknowns of
    /// the first half, the sum of and the difference between the entries on the same side and on opposite ones.
    pub(super) fn of_halves([symmetric, antisymmetric]: [Split; 2]) -> Self {
        let both_rows = |half: Split| Part::new(half.map(|part| 2.0 * part));
        Self::Mirrored(both_rows(symmetric), both_rows(antisymmetric))
    }

    /// `shapes`^T times the solutions for all of its columns: real and imaginary part.
    pub(super) fn moments(&self, shapes: &DMatrix<f64>) -> Split {
        match self {
            Self::Whole(part) => part.moments(shapes.clone()),
            Self::Mirrored(symmetric, antisymmetric) => {
                let mut sum = [0, 1].map(|_| DMatrix::zeros(shapes.ncols(), shapes.ncols()));
                for (part, sign) in [(symmetric, 1.0), (antisymmetric, -1.0)] {
                    let half = folded(shapes, sign);
                    let columns = filled(&half, shapes);
                    let solved = part.moments(half.select_columns(&columns));
                    for (sum, solved) in sum.iter_mut().zip(&solved) {
                        for (j, column) in columns.iter().enumerate() {
                            for (i, row) in columns.iter().enumerate() {
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
            Self::Whole(part) => {
                let mut solution = right.clone();
                part.solve(&mut solution);
                solution
            }
            Self::Mirrored(symmetric, antisymmetric) => {
                let n = right.len();
                let mut even = DVector::from_fn(n - n / 2, |i, _| match n - 1 - i == i {
                    true => right[i],
                    false => right[i] + right[n - 1 - i],
                });
                let mut odd = DVector::from_fn(n / 2, |i, _| right[i] - right[n - 1 - i]);
                // A vector that is symmetric or antisymmetric within rounding takes one part only.
                let least = ROUNDING * even.camax().max(odd.camax());
                for (part, half) in [(symmetric, &mut even), (antisymmetric, &mut odd)] {
                    if half.camax() > least { part.solve(half) } else { half.fill(Complex64::ZERO) }
                }
                DVector::from_fn(n, |i, _| {
                    let mirror = n - 1 - i;
                    let odd = if i < n / 2 {
                        odd[i]
                    } else if mirror < n / 2 {
                        -odd[mirror]
                    } else {
                        Complex64::ZERO
                    };
                    even[i.min(mirror)] + odd
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
            let whole = Factors::new(&matrix, false).solve(&right);
            let folded = Factors::new(&matrix, true).solve(&right);
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
            let right = shape(4);
            let complex = |m: &DMatrix<f64>| m.map(Complex64::from);
            let exact = complex(&right).tr_mul(&matrix.clone().lu().solve(&complex(&right)).unwrap());
            for mirrored in [false, true] {
                let [re, im] = Factors::new(&matrix, mirrored).moments(&right);
                let got = re.zip_map(&im, Complex64::new);
                for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
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
