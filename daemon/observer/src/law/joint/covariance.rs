//! The covariance P of the joint filter: symmetric, stored whole, in rows of whole lanes.
//!
//! Every operation computes the two mirror images of an entry from the same numbers in the same order, so that P stays
//! symmetric to the bit. Rows and columns beyond the filter's own are 0 and stay 0.

use crate::space::factors::lanes::{LANES, Lanes, VectorLoop, VectorUnit, whole_lanes};
use pulp::Simd;

/// P, n×n.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Covariance {
    /// Lanes of a row.
    width: usize,
    /// Row after row, each beginning on a cache line.
    entries: Vec<Lanes>,
}

impl Covariance {
    /// Zero.
    pub(crate) fn zero(n: usize) -> Self {
        let stride = whole_lanes(n);
        let width = stride / LANES;
        Self { width, entries: vec![Lanes([0.0; LANES]); stride * width] }
    }

    /// Becomes diagonal. The diagonal is of whole lanes.
    pub(crate) fn set_diagonal(&mut self, diagonal: &[f64]) {
        self.entries.fill(Lanes([0.0; LANES]));
        for (i, &variance) in diagonal.iter().enumerate() {
            *self.entry_mut(i, i) = variance;
        }
    }

    /// Becomes equal to another one of the same size. No allocation.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.entries.copy_from_slice(&other.entries);
    }

    /// P_ij.
    pub(crate) fn at(&self, i: usize, j: usize) -> f64 {
        self.entries[i * self.width + j / LANES].0[j % LANES]
    }

    fn entry_mut(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.entries[i * self.width + j / LANES].0[j % LANES]
    }

    /// Sets P_ij and P_ji.
    pub(crate) fn set(&mut self, i: usize, j: usize, value: f64) {
        *self.entry_mut(i, j) = value;
        *self.entry_mut(j, i) = value;
    }

    /// P_ii += `variance`.
    pub(crate) fn add_to_diagonal(&mut self, i: usize, variance: f64) {
        *self.entry_mut(i, i) += variance;
    }

    /// Row i, which is column i.
    pub(crate) fn row(&self, i: usize) -> impl Iterator<Item = f64> {
        self.entries[i * self.width..][..self.width].iter().flat_map(|lanes| lanes.0)
    }

    /// Sets row and column i.
    pub(crate) fn set_cross(&mut self, i: usize, values: &[f64]) {
        let (lanes, lane) = (i / LANES, i % LANES);
        for (row, &value) in self.entries.chunks_exact_mut(self.width).zip(values) {
            row[lanes].0[lane] = value;
        }
        let row = &mut self.entries[i * self.width..][..self.width];
        for (entry, &values) in row.iter_mut().zip(values.as_chunks().0) {
            entry.0 = values;
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
        unit.run(SubtractSquare { width: self.width, entries: &mut self.entries, g });
    }

    /// `P := P ∘ s sᵀ`, then `P_kk += variances_k`.
    ///
    /// # Cost
    /// 2n² multiplications.
    pub(crate) fn scale(&mut self, unit: VectorUnit, s: &[f64], variances: &[f64]) {
        unit.run(Scale { width: self.width, entries: &mut self.entries, s });
        for (i, &variance) in variances.iter().enumerate() {
            *self.entry_mut(i, i) += variance;
        }
    }
}

/// The widths of 27, 64 and 125 centers, in lanes: with these as constants a row stays in registers.
macro_rules! with_width {
    ($width:expr, $fixed:ident($($argument:expr),*), $general:expr) => {
        match $width {
            6 => $fixed::<S, 6>($($argument),*),
            10 => $fixed::<S, 10>($($argument),*),
            18 => $fixed::<S, 18>($($argument),*),
            _ => $general,
        }
    };
}

/// The lanes as vectors of the unit.
#[inline(always)]
fn vectors<S: Simd>(lanes: &[f64; LANES]) -> &[S::f64s] {
    S::as_simd_f64s(lanes).0
}

#[inline(always)]
fn vectors_mut<S: Simd>(lanes: &mut [f64; LANES]) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(lanes).0
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
        let Self { covariance: Covariance { width, entries }, f, product } = self;
        product.fill(0.0);
        let (sums, _) = product.as_chunks_mut::<LANES>();
        with_width!(*width, times_fixed(simd, entries, f, sums), times(simd, *width, entries, f, sums));
    }
}

#[inline(always)]
fn times_fixed<S: Simd, const W: usize>(simd: S, entries: &[Lanes], f: &[f64], sums: &mut [[f64; LANES]]) {
    let (Some(sums), (rows, _)) = (sums.first_chunk_mut::<W>(), entries.as_chunks::<W>()) else { return };
    let mut kept = *sums;
    for (rows, f) in rows.chunks_exact(ROWS).zip(f.chunks_exact(ROWS)) {
        add_rows(simd, [&rows[0], &rows[1], &rows[2], &rows[3]], f, &mut kept);
    }
    *sums = kept;
}

#[inline(always)]
fn times<S: Simd>(simd: S, width: usize, entries: &[Lanes], f: &[f64], sums: &mut [[f64; LANES]]) {
    for (rows, f) in entries.chunks_exact(ROWS * width).zip(f.chunks_exact(ROWS)) {
        let (a, rest) = rows.split_at(width);
        let (b, rest) = rest.split_at(width);
        let (c, d) = rest.split_at(width);
        add_rows(simd, [a, b, c, d], f, sums);
    }
}

/// sums += f_a a + f_b b + f_c c + f_d d.
#[inline(always)]
fn add_rows<S: Simd>(simd: S, [a, b, c, d]: [&[Lanes]; ROWS], f: &[f64], sums: &mut [[f64; LANES]]) {
    let [fa, fb, fc, fd] = [f[0], f[1], f[2], f[3]].map(|f| simd.splat_f64s(f));
    for ((((sums, a), b), c), d) in sums.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        let rows = [a, b, c, d].map(|lanes| vectors::<S>(&lanes.0));
        for (k, sum) in vectors_mut::<S>(sums).iter_mut().enumerate() {
            let first = simd.mul_add_e_f64s(rows[0][k], fa, simd.mul_add_e_f64s(rows[1][k], fb, *sum));
            *sum = simd.mul_add_e_f64s(rows[2][k], fc, simd.mul_add_e_f64s(rows[3][k], fd, first));
        }
    }
}

struct SubtractSquare<'a> {
    width: usize,
    entries: &'a mut [Lanes],
    g: &'a [f64],
}

impl VectorLoop for SubtractSquare<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { width, entries, g } = self;
        let (lanes, _) = g.as_chunks::<LANES>();
        with_width!(width, subtract_fixed(simd, entries, g, lanes), {
            for (row, &g_i) in entries.chunks_exact_mut(width).zip(g) {
                subtract_from_row(simd, row, g_i, lanes);
            }
        });
    }
}

#[inline(always)]
fn subtract_fixed<S: Simd, const W: usize>(
    simd: S,
    entries: &mut [Lanes],
    g: &[f64],
    lanes: &[[f64; LANES]],
) {
    let (Some(lanes), (rows, _)) = (lanes.first_chunk::<W>(), entries.as_chunks_mut::<W>()) else { return };
    let lanes = *lanes;
    for (row, &g_i) in rows.iter_mut().zip(g) {
        subtract_from_row(simd, row, g_i, &lanes);
    }
}

/// row −= g_i gᵀ.
#[inline(always)]
fn subtract_from_row<S: Simd>(simd: S, row: &mut [Lanes], g_i: f64, g: &[[f64; LANES]]) {
    let g_i = simd.splat_f64s(-g_i);
    for (entries, g) in row.iter_mut().zip(g) {
        let g = vectors::<S>(g);
        for (k, entry) in vectors_mut::<S>(&mut entries.0).iter_mut().enumerate() {
            *entry = simd.mul_add_e_f64s(g_i, g[k], *entry);
        }
    }
}

struct Scale<'a> {
    width: usize,
    entries: &'a mut [Lanes],
    s: &'a [f64],
}

impl VectorLoop for Scale<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { width, entries, s } = self;
        let (lanes, _) = s.as_chunks::<LANES>();
        with_width!(width, scale_fixed(simd, entries, s, lanes), {
            for (row, &s_i) in entries.chunks_exact_mut(width).zip(s) {
                scale_row(simd, row, s_i, lanes);
            }
        });
    }
}

#[inline(always)]
fn scale_fixed<S: Simd, const W: usize>(simd: S, entries: &mut [Lanes], s: &[f64], lanes: &[[f64; LANES]]) {
    let (Some(lanes), (rows, _)) = (lanes.first_chunk::<W>(), entries.as_chunks_mut::<W>()) else { return };
    let lanes = *lanes;
    for (row, &s_i) in rows.iter_mut().zip(s) {
        scale_row(simd, row, s_i, &lanes);
    }
}

/// row := row ∘ s_i s.
#[inline(always)]
fn scale_row<S: Simd>(simd: S, row: &mut [Lanes], s_i: f64, s: &[[f64; LANES]]) {
    let s_i = simd.splat_f64s(s_i);
    for (entries, s) in row.iter_mut().zip(s) {
        let s = vectors::<S>(s);
        for (k, entry) in vectors_mut::<S>(&mut entries.0).iter_mut().enumerate() {
            *entry = simd.mul_f64s(*entry, simd.mul_f64s(s_i, s[k]));
        }
    }
}
