//! Complex symmetric matrices of apertures, factorised as L D L^T without exchanges of rows.
//!
//! Their imaginary part is what the opening radiates and never negative, and so is that of every remainder of the elimination: no
//! pivot vanishes. Real and imaginary parts lie apart, so that the loops become vector code.

use num_complex::Complex64;
use pulp::{Arch, Simd, WithSimd};

/// The upper triangle row after row; once factorised, D^-1 on the diagonal and D L^T beside it.
#[derive(Clone)]
pub(super) struct Symmetric {
    size: usize,
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Symmetric {
    /// The matrix with these entries `(row, column)`, asked for from the upper triangle row after row.
    pub(super) fn new(size: usize, entry: impl Fn(usize, usize) -> Complex64) -> Self {
        let (mut re, mut im) = (Vec::with_capacity(size * (size + 1) / 2), Vec::with_capacity(size * (size + 1) / 2));
        for row in 0..size {
            for column in row..size {
                let value = entry(row, column);
                re.push(value.re);
                im.push(value.im);
            }
        }
        Self { size, re, im }
    }

    pub(super) fn size(&self) -> usize {
        self.size
    }

    fn start(&self, row: usize) -> usize {
        row * self.size - row * row.saturating_sub(1) / 2
    }

    /// Imaginary part of an entry, before it is factorised.
    pub(super) fn imaginary(&self, row: usize, column: usize) -> f64 {
        let (row, column) = (row.min(column), row.max(column));
        self.im[self.start(row) + column - row]
    }

    pub(super) fn factorised(mut self) -> Self {
        Arch::new().dispatch(Eliminate(&mut self));
        self
    }

    #[inline(always)]
    fn eliminate(&mut self) {
        for k in 0..self.size {
            let (start, next) = (self.start(k), self.start(k + 1));
            let pivot = Complex64::new(self.re[start], self.im[start]).inv();
            let (re, below_re) = self.re.split_at_mut(next);
            let (im, below_im) = self.im.split_at_mut(next);
            let (row_re, row_im) = (&re[start + 1..], &im[start + 1..]);
            let mut from = 0;
            for i in 0..row_re.len() {
                let factor = Complex64::new(row_re[i], row_im[i]) * pivot;
                let length = row_re.len() - i;
                let target = (&mut below_re[from..from + length], &mut below_im[from..from + length]);
                subtract(target, factor, (&row_re[i..], &row_im[i..]));
                from += length;
            }
            (re[start], im[start]) = (pivot.re, pivot.im);
        }
    }

    /// Solves with the right side in place.
    pub(super) fn solve(&self, re: &mut [f64], im: &mut [f64]) {
        Arch::new().dispatch(Solve(self, re, im));
    }

    #[inline(always)]
    fn substitute(&self, re: &mut [f64], im: &mut [f64]) {
        let mut start = 0;
        for k in 0..self.size {
            let pivot = Complex64::new(self.re[start], self.im[start]);
            let next = start + self.size - k;
            let row = (&self.re[start + 1..next], &self.im[start + 1..next]);
            let value = Complex64::new(re[k], im[k]) * pivot;
            subtract((&mut re[k + 1..], &mut im[k + 1..]), value, row);
            (re[k], im[k]) = (value.re, value.im);
            start = next;
        }
        for k in (0..self.size).rev() {
            let next = start;
            start = next - (self.size - k);
            let pivot = Complex64::new(self.re[start], self.im[start]);
            let row = (&self.re[start + 1..next], &self.im[start + 1..next]);
            let value = pivot * dot(row, (&re[k + 1..], &im[k + 1..]));
            re[k] -= value.re;
            im[k] -= value.im;
        }
    }
}

/// [`Symmetric::eliminate`] in the widest vectors of the machine. A closure would be compiled without them.
struct Eliminate<'a>(&'a mut Symmetric);

impl WithSimd for Eliminate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.0.eliminate();
    }
}

/// [`Symmetric::substitute`] likewise.
struct Solve<'a>(&'a Symmetric, &'a mut [f64], &'a mut [f64]);

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.0.substitute(self.1, self.2);
    }
}

/// Complex numbers, their parts apart.
#[derive(Clone)]
pub(super) struct Parts {
    pub(super) re: Vec<f64>,
    pub(super) im: Vec<f64>,
}

impl Parts {
    pub(super) fn zeros(count: usize) -> Self {
        Self { re: vec![0.0; count], im: vec![0.0; count] }
    }

    /// `count` of them from `start` on.
    pub(super) fn part(&self, start: usize, count: usize) -> (&[f64], &[f64]) {
        (&self.re[start..start + count], &self.im[start..start + count])
    }

    pub(super) fn subtract(&mut self, other: &Self) {
        self.re.iter_mut().zip(&other.re).for_each(|(a, b)| *a -= b);
        self.im.iter_mut().zip(&other.im).for_each(|(a, b)| *a -= b);
    }
}

/// target -= factor * x.
#[inline(always)]
fn subtract((re, im): (&mut [f64], &mut [f64]), factor: Complex64, (x_re, x_im): (&[f64], &[f64])) {
    let (a, b) = (factor.re, factor.im);
    for (((re, im), x), y) in re.iter_mut().zip(im.iter_mut()).zip(x_re).zip(x_im) {
        *re -= a * x - b * y;
        *im -= a * y + b * x;
    }
}

/// Sum of products, without conjugation.
#[inline(always)]
pub(super) fn dot((a_re, a_im): (&[f64], &[f64]), (b_re, b_im): (&[f64], &[f64])) -> Complex64 {
    /// Sums side by side.
    const LANES: usize = 4;
    let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
    let chunks = a_re.chunks_exact(LANES).zip(a_im.chunks_exact(LANES));
    let mut done = 0;
    for ((a, b), (c, d)) in chunks.zip(b_re.chunks_exact(LANES).zip(b_im.chunks_exact(LANES))) {
        for i in 0..LANES {
            re[i] += a[i] * c[i] - b[i] * d[i];
            im[i] += a[i] * d[i] + b[i] * c[i];
        }
        done += LANES;
    }
    let mut sum = Complex64::new(re.iter().sum(), im.iter().sum());
    for i in done..a_re.len() {
        sum += Complex64::new(a_re[i], a_im[i]) * Complex64::new(b_re[i], b_im[i]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solutions_satisfy_their_equations() {
        for size in [1, 2, 5, 23] {
            // A real part with both signs beside an imaginary one that is only just positive.
            let entry = |i: usize, j: usize| {
                let apart = i.abs_diff(j) as f64;
                Complex64::new((1.3 * (i + j) as f64).cos() + f64::from(u8::from(i == j)), 1e-2 * (-apart).exp())
            };
            let right = Parts { re: (0..size).map(|i| i as f64).collect(), im: vec![1.0; size] };
            let mut x = right.clone();
            let matrix = Symmetric::new(size, entry);
            matrix.factorised().solve(&mut x.re, &mut x.im);
            for i in 0..size {
                let sum: Complex64 = (0..size).map(|j| entry(i, j) * Complex64::new(x.re[j], x.im[j])).sum();
                assert!((sum - Complex64::new(right.re[i], right.im[i])).norm() < 1e-9, "{size} {i}: {sum}");
            }
        }
    }
}
