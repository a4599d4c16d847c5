//! The covariance P of the joint filter: symmetric, stored whole, in rows of whole lanes.
//!
//! Every operation computes the two mirror images of an entry from the same numbers in the same order, so that P stays
//! symmetric to the bit. Rows and columns beyond the filter's own are 0 and stay 0.

use crate::space::factors::lanes::{VectorLoop, VectorUnit, whole_lanes};
use pulp::Simd;

/// P, n×n.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Covariance {
    /// Length of a row: n rounded up to whole lanes.
    stride: usize,
    entries: Vec<f64>,
}

impl Covariance {
    /// Zero.
    pub(crate) fn zero(n: usize) -> Self {
        let stride = whole_lanes(n);
        Self { stride, entries: vec![0.0; stride * stride] }
    }

    /// Becomes diagonal. The diagonal is of whole lanes.
    pub(crate) fn set_diagonal(&mut self, diagonal: &[f64]) {
        self.entries.fill(0.0);
        for (i, &variance) in diagonal.iter().enumerate() {
            self.entries[i * self.stride + i] = variance;
        }
    }

    /// Becomes equal to another one of the same size. No allocation.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.entries.copy_from_slice(&other.entries);
    }

    /// P_ij.
    pub(crate) fn at(&self, i: usize, j: usize) -> f64 {
        self.entries[i * self.stride + j]
    }

    /// Sets P_ij and P_ji.
    pub(crate) fn set(&mut self, i: usize, j: usize, value: f64) {
        self.entries[i * self.stride + j] = value;
        self.entries[j * self.stride + i] = value;
    }

    /// P_ii += `variance`.
    pub(crate) fn add_to_diagonal(&mut self, i: usize, variance: f64) {
        self.entries[i * self.stride + i] += variance;
    }

    /// Row i, which is column i.
    pub(crate) fn row(&self, i: usize) -> &[f64] {
        &self.entries[i * self.stride..][..self.stride]
    }

    /// Sets row and column i.
    pub(crate) fn set_cross(&mut self, i: usize, values: &[f64]) {
        self.entries[i * self.stride..][..self.stride].copy_from_slice(values);
        for (row, &value) in self.entries.chunks_exact_mut(self.stride).zip(values) {
            row[i] = value;
        }
    }

    /// `product = P f`.
    ///
    /// # Cost
    /// n² multiply-adds.
    pub(crate) fn times(&self, unit: VectorUnit, f: &[f64], product: &mut [f64]) {
        unit.run(Times { covariance: self, f, product });
    }

    /// `P −= g gᵀ`.
    ///
    /// # Cost
    /// n² multiply-adds.
    pub(crate) fn subtract_square(&mut self, unit: VectorUnit, g: &[f64]) {
        unit.run(SubtractSquare { stride: self.stride, entries: &mut self.entries, g });
    }

    /// `P := P ∘ s sᵀ`, then `P_kk += variances_k`.
    ///
    /// # Cost
    /// 2n² multiplications.
    pub(crate) fn scale(&mut self, unit: VectorUnit, s: &[f64], variances: &[f64]) {
        unit.run(Scale { stride: self.stride, entries: &mut self.entries, s });
        for (i, &variance) in variances.iter().enumerate() {
            self.entries[i * self.stride + i] += variance;
        }
    }
}

struct Times<'a> {
    covariance: &'a Covariance,
    f: &'a [f64],
    product: &'a mut [f64],
}

/// Rows that are added up at once: each sum is loaded and stored once for so many.
const ROWS: usize = 4;

impl VectorLoop for Times<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { covariance: Covariance { stride, entries }, f, product } = self;
        product.fill(0.0);
        let (sums, _) = S::as_mut_simd_f64s(product);
        for (rows, f) in entries.chunks_exact(ROWS * stride).zip(f.chunks_exact(ROWS)) {
            let (a, rest) = rows.split_at(*stride);
            let (b, rest) = rest.split_at(*stride);
            let (c, d) = rest.split_at(*stride);
            let ((a, _), (b, _)) = (S::as_simd_f64s(a), S::as_simd_f64s(b));
            let ((c, _), (d, _)) = (S::as_simd_f64s(c), S::as_simd_f64s(d));
            let [fa, fb, fc, fd] = [f[0], f[1], f[2], f[3]].map(|f| simd.splat_f64s(f));
            for ((((sum, &a), &b), &c), &d) in sums.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                let first = simd.mul_add_e_f64s(a, fa, simd.mul_add_e_f64s(b, fb, *sum));
                *sum = simd.mul_add_e_f64s(c, fc, simd.mul_add_e_f64s(d, fd, first));
            }
        }
    }
}

struct SubtractSquare<'a> {
    stride: usize,
    entries: &'a mut [f64],
    g: &'a [f64],
}

impl VectorLoop for SubtractSquare<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let (g, _) = S::as_simd_f64s(self.g);
        for (row, &g_i) in self.entries.chunks_exact_mut(self.stride).zip(self.g) {
            let (row, _) = S::as_mut_simd_f64s(row);
            let g_i = simd.splat_f64s(-g_i);
            for (entry, &g_j) in row.iter_mut().zip(g) {
                *entry = simd.mul_add_e_f64s(g_i, g_j, *entry);
            }
        }
    }
}

struct Scale<'a> {
    stride: usize,
    entries: &'a mut [f64],
    s: &'a [f64],
}

impl VectorLoop for Scale<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let (s, _) = S::as_simd_f64s(self.s);
        for (row, &s_i) in self.entries.chunks_exact_mut(self.stride).zip(self.s) {
            let (row, _) = S::as_mut_simd_f64s(row);
            let s_i = simd.splat_f64s(s_i);
            for (entry, &s_j) in row.iter_mut().zip(s) {
                *entry = simd.mul_f64s(*entry, simd.mul_f64s(s_i, s_j));
            }
        }
    }
}
