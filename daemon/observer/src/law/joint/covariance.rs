//! The covariance P of the joint filter: symmetric, stored whole, in rows of whole lanes.
//!
//! An update subtracts a square g gᵀ and a prediction scales every entry: both want a pass over P. The square therefore waits
//! until the next pass, so that a step makes one. What is read of P in between has it subtracted, to the bit as the pass
//! does it.
//!
//! The velocity's row, p of joint.md, stands by itself: both put a new one in its place.
//!
//! Every operation computes the two mirror images of an entry from the same numbers in the same order, so that P stays
//! symmetric to the bit. Rows and columns beyond the filter's own are 0 and stay 0.

use super::rows::VELOCITY;
use crate::space::factors::lanes::{LANES, Lanes, VectorLoop, VectorUnit, multiply_add, whole_lanes};
use pulp::Simd;

/// P, n×n.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Covariance {
    unit: VectorUnit,
    /// Lanes of a row.
    width: usize,
    /// p.
    velocity_row: Vec<f64>,
    /// P + g gᵀ, row after row, each beginning on a cache line; 0 in the velocity's row and column.
    entries: Vec<Lanes>,
    /// g; 0 where nothing waits, and in the velocity's row.
    square: Vec<f64>,
    /// Whether a square waits to be subtracted.
    square_waits: bool,
}

impl Covariance {
    /// Zero.
    pub(crate) fn zero(unit: VectorUnit, n: usize) -> Self {
        let stride = whole_lanes(n);
        let width = stride / LANES;
        let entries = vec![Lanes([0.0; LANES]); stride * width];
        let zeros = vec![0.0; stride];
        Self { unit, width, velocity_row: zeros.clone(), entries, square: zeros, square_waits: false }
    }

    /// Becomes diagonal. The diagonal is of whole lanes.
    pub(crate) fn set_diagonal(&mut self, diagonal: &[f64]) {
        self.forget_square();
        self.velocity_row.fill(0.0);
        self.entries.fill(Lanes([0.0; LANES]));
        for (i, &variance) in diagonal.iter().enumerate() {
            *self.entry_mut(i, i) = variance;
        }
    }

    /// Becomes equal to another one of the same size. No allocation.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.velocity_row.copy_from_slice(&other.velocity_row);
        self.entries.copy_from_slice(&other.entries);
        self.square.copy_from_slice(&other.square);
        self.square_waits = other.square_waits;
    }

    /// P_ij.
    pub(crate) fn at(&self, i: usize, j: usize) -> f64 {
        match (i, j) {
            (VELOCITY, other) | (other, VELOCITY) => self.velocity_row[other],
            _ => {
                let entry = self.entries[i * self.width + j / LANES].0[j % LANES];
                let (g_i, g_j) = (self.square[i], self.square[j]);
                if g_i == 0.0 { entry } else { self.unit.multiply_add(-g_i, g_j, entry) }
            }
        }
    }

    fn entry_mut(&mut self, i: usize, j: usize) -> &mut f64 {
        match (i, j) {
            (VELOCITY, other) | (other, VELOCITY) => &mut self.velocity_row[other],
            _ => &mut self.entries[i * self.width + j / LANES].0[j % LANES],
        }
    }

    /// Sets P_ij and P_ji.
    pub(crate) fn set(&mut self, i: usize, j: usize, value: f64) {
        self.settle();
        *self.entry_mut(i, j) = value;
        *self.entry_mut(j, i) = value;
    }

    /// P_ii += `variance`.
    pub(crate) fn add_to_diagonal(&mut self, i: usize, variance: f64) {
        if self.square[i] != 0.0 {
            self.settle();
        }
        *self.entry_mut(i, i) += variance;
    }

    /// Row i, which is column i, of whole lanes.
    pub(crate) fn copy_row(&self, i: usize, row: &mut [f64]) {
        if i == VELOCITY {
            row.copy_from_slice(&self.velocity_row);
            return;
        }
        let entries = &self.entries[i * self.width..][..self.width];
        for (row, entries) in row.as_chunks_mut().0.iter_mut().zip(entries) {
            *row = entries.0;
        }
        if self.square[i] != 0.0 {
            self.unit.run(SubtractRow { row, g_i: self.square[i], g: &self.square });
        }
        row[VELOCITY] = self.velocity_row[i];
    }

    /// Sets row and column i.
    pub(crate) fn set_cross(&mut self, i: usize, values: &[f64]) {
        if i == VELOCITY {
            self.velocity_row.copy_from_slice(values);
            return;
        }
        // Of the square that waits, this row and column have nothing.
        if self.square[i] != 0.0 {
            self.settle();
        }
        for (j, &value) in values.iter().enumerate() {
            *self.entry_mut(i, j) = value;
            *self.entry_mut(j, i) = value;
        }
    }

    /// `P −= g gᵀ`, with the next pass.
    pub(crate) fn subtract_square(&mut self, g: &[f64]) {
        self.settle();
        self.square.copy_from_slice(g);
        self.square_waits = true;
        let g_v = std::mem::take(&mut self.square[VELOCITY]);
        if g_v != 0.0 {
            self.unit.run(SubtractRow { row: &mut self.velocity_row, g_i: g_v, g });
        }
    }

    /// `P_ij −= g_i g_j` where i or j is one of these rows; n rows are in use.
    pub(crate) fn subtract_square_of(&mut self, rows: &[usize], g: &[f64], n: usize) {
        for (position, &i) in rows.iter().enumerate() {
            for j in (0..n).filter(|j| !rows[..position].contains(j)) {
                self.set(i, j, self.at(i, j) - g[i] * g[j]);
            }
        }
    }

    /// Subtracts the square that waits.
    pub(crate) fn settle(&mut self) {
        if self.square_waits {
            self.unit.run(Settle { covariance: self });
            self.forget_square();
        }
    }

    fn forget_square(&mut self) {
        if self.square_waits {
            self.square.fill(0.0);
            self.square_waits = false;
        }
    }

    /// `products = (P f, P c)`.
    ///
    /// # Cost
    /// 2n² multiply-adds, n² more for a square that waits: one pass that reads P.
    pub(crate) fn times(&self, [f, c]: [&[f64]; 2], products: [&mut [f64]; 2]) {
        let [of_f, of_c] = products;
        self.unit.run(Times { covariance: self, f, c, products: [of_f, of_c] });
        [of_f[VELOCITY], of_c[VELOCITY]] = self.unit.dots([f, c], &self.velocity_row);
    }

    /// `product = P f`, then `P := P ∘ s sᵀ`, then `P_kk += variances_k`. The velocity's row stays as it is: it is to be set.
    ///
    /// # Cost
    /// 2n² multiply-adds and n² multiplications, with the square that waits: one pass over P.
    pub(crate) fn advance(&mut self, f: &[f64], s: &[f64], variances: &[f64], product: &mut [f64]) {
        self.unit.run(Advance { covariance: self, f, s, variances, product });
        self.forget_square();
        [product[VELOCITY]] = self.unit.dots([&self.velocity_row], f);
    }
}

/// A pass over P by blocks of columns, as many lanes at once as what it needs of them stays in registers; the last block may
/// be narrower.
macro_rules! by_blocks {
    ($width:expr, $pass:ident $arguments:tt) => {
        let block = if S::F64_LANES == LANES { 6 } else { 3 };
        for first in (0..$width).step_by(block) {
            match block.min($width - first) {
                1 => by_blocks!(@ 1, first, $pass $arguments),
                2 => by_blocks!(@ 2, first, $pass $arguments),
                3 => by_blocks!(@ 3, first, $pass $arguments),
                4 => by_blocks!(@ 4, first, $pass $arguments),
                5 => by_blocks!(@ 5, first, $pass $arguments),
                _ => by_blocks!(@ 6, first, $pass $arguments),
            }
        }
    };
    (@ $columns:tt, $first:ident, $pass:ident ($($argument:expr),*)) => {
        $pass::<S, $columns>($first, $($argument),*)
    };
}

/// A block of columns of a vector.
#[inline(always)]
fn columns<const W: usize>(vector: &[f64], first: usize) -> [[f64; LANES]; W] {
    let lanes = vector.as_chunks().0;
    std::array::from_fn(|k| lanes[first + k])
}

/// A block of columns of a vector times a factor.
#[inline(always)]
fn scaled_columns<const W: usize>(factor: f64, vector: &[f64], first: usize) -> [[f64; LANES]; W] {
    columns::<W>(vector, first).map(|lanes| lanes.map(|entry| factor * entry))
}

/// Becomes a block of columns of a vector.
#[inline(always)]
fn set_columns<const W: usize>(vector: &mut [f64], first: usize, columns: [[f64; LANES]; W]) {
    vector.as_chunks_mut().0[first..first + W].copy_from_slice(&columns);
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

struct Advance<'a> {
    covariance: &'a mut Covariance,
    f: &'a [f64],
    s: &'a [f64],
    variances: &'a [f64],
    product: &'a mut [f64],
}

impl VectorLoop for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self {
            covariance: Covariance { width, velocity_row, entries, square: g, .. },
            f,
            s,
            variances,
            product,
        } = self;
        by_blocks!(
            *width,
            advance_block(simd, (velocity_row, entries), *width, g, (f, s, variances), product)
        );
    }
}

#[inline(always)]
fn advance_block<S: Simd, const W: usize>(
    first: usize,
    simd: S,
    (velocity_row, entries): (&[f64], &mut [Lanes]),
    width: usize,
    g: &[f64],
    (f, s, variances): (&[f64], &[f64], &[f64]),
    product: &mut [f64],
) {
    let (g_columns, s_columns) = (columns::<W>(g, first), columns::<W>(s, first));
    // s_i s, which is the same for most rows.
    let (mut scale, mut scales) = (1.0, s_columns);
    let mut sums = scaled_columns::<W>(f[VELOCITY], velocity_row, first);
    let [f, g, s, variances] = [f, g, s, variances].map(|vector| vector.as_chunks::<LANES>().0);
    for (lanes, rows) in entries.chunks_exact_mut(LANES * width).enumerate() {
        for lane in 0..LANES {
            let Some(row) = rows[lane * width + first..].first_chunk_mut::<W>() else { return };
            let [minus_g_i, f_i, s_i] =
                [-g[lanes][lane], f[lanes][lane], s[lanes][lane]].map(|factor| simd.splat_f64s(factor));
            if s[lanes][lane] != scale {
                scale = s[lanes][lane];
                for (scales, s) in scales.iter_mut().zip(&s_columns) {
                    for (scale, &s) in vectors_mut::<S>(scales).iter_mut().zip(vectors::<S>(s)) {
                        *scale = simd.mul_f64s(s_i, s);
                    }
                }
            }
            for k in 0..W {
                let (row, sums) = (vectors_mut::<S>(&mut row[k].0), vectors_mut::<S>(&mut sums[k]));
                let columns = vectors::<S>(&g_columns[k]).iter().zip(vectors::<S>(&scales[k]));
                for ((entry, sum), (&g, &scale)) in row.iter_mut().zip(sums).zip(columns) {
                    let settled = simd.mul_add_e_f64s(minus_g_i, g, *entry);
                    *sum = simd.mul_add_e_f64s(f_i, settled, *sum);
                    *entry = simd.mul_f64s(settled, scale);
                }
            }
        }
        if (first..first + W).contains(&lanes) {
            for (lane, variance) in variances[lanes].iter().enumerate() {
                rows[lane * width + lanes].0[lane] += variance;
            }
        }
    }
    set_columns(product, first, sums);
}

struct Times<'a> {
    covariance: &'a Covariance,
    f: &'a [f64],
    c: &'a [f64],
    products: [&'a mut [f64]; 2],
}

impl VectorLoop for Times<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { covariance, f, c, mut products } = self;
        let Covariance { width, velocity_row, entries, square: g, .. } = covariance;
        by_blocks!(*width, times_block(simd, (velocity_row, entries), *width, g, (f, c), &mut products));
    }
}

#[inline(always)]
fn times_block<S: Simd, const W: usize>(
    first: usize,
    simd: S,
    (velocity_row, entries): (&[f64], &[Lanes]),
    width: usize,
    g: &[f64],
    (f, c): (&[f64], &[f64]),
    [of_f, of_c]: &mut [&mut [f64]; 2],
) {
    let g_columns = columns::<W>(g, first);
    let mut f_sums = scaled_columns::<W>(f[VELOCITY], velocity_row, first);
    let mut c_sums = scaled_columns::<W>(c[VELOCITY], velocity_row, first);
    let rows = entries.chunks_exact(width).zip(g).zip(f.iter().zip(c));
    for ((row, &g_i), (&f_i, &c_i)) in rows {
        let Some(row) = row[first..].first_chunk::<W>() else { return };
        let [minus_g_i, f_i, c_i] = [-g_i, f_i, c_i].map(|factor| simd.splat_f64s(factor));
        for k in 0..W {
            let sums = vectors_mut::<S>(&mut f_sums[k]).iter_mut().zip(vectors_mut::<S>(&mut c_sums[k]));
            let row = vectors::<S>(&row[k].0).iter().zip(vectors::<S>(&g_columns[k]));
            for ((f_sum, c_sum), (&entry, &g)) in sums.zip(row) {
                let settled = simd.mul_add_e_f64s(minus_g_i, g, entry);
                *f_sum = simd.mul_add_e_f64s(f_i, settled, *f_sum);
                *c_sum = simd.mul_add_e_f64s(c_i, settled, *c_sum);
            }
        }
    }
    set_columns(of_f, first, f_sums);
    set_columns(of_c, first, c_sums);
}

struct Settle<'a> {
    covariance: &'a mut Covariance,
}

impl VectorLoop for Settle<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, _: S) {
        let Covariance { width, entries, square: g, .. } = self.covariance;
        for (row, &g_i) in entries.chunks_exact_mut(*width).zip(&*g) {
            for (entries, g) in row.iter_mut().zip(g.as_chunks::<LANES>().0) {
                for (entry, g) in entries.0.iter_mut().zip(g) {
                    *entry = multiply_add::<S>(-g_i, *g, *entry);
                }
            }
        }
    }
}

struct SubtractRow<'a> {
    row: &'a mut [f64],
    g_i: f64,
    g: &'a [f64],
}

impl VectorLoop for SubtractRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, _: S) {
        for (entry, g) in self.row.iter_mut().zip(self.g) {
            *entry = multiply_add::<S>(-self.g_i, *g, *entry);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Against matrices, on each unit, for numbers of rows that fill blocks of every width.
    #[test]
    fn passes_are_what_the_formulas_say_on_every_unit_and_width() {
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        for unit in [VectorUnit::of_this_machine(), VectorUnit::baseline()] {
            for n in [5, 16, 24, 32, 40, 43, 53, 80, 141] {
                let padded = whole_lanes(n);
                let mut vector =
                    || -> Vec<f64> { (0..padded).map(|i| if i < n { random() } else { 0.0 }).collect() };
                let (f, c, s, variances) = (vector(), vector(), vector(), vector());
                let mut g = vector();
                let root = DMatrix::from_fn(padded, n, |i, k| if i < n { vector()[k] } else { 0.0 });
                let mut expected = &root * root.transpose();
                let mut covariance = Covariance::zero(unit, n);
                for i in 0..n {
                    (0..=i).for_each(|j| covariance.set(i, j, expected[(i, j)]));
                }
                // A square that waits, with the velocity's row and, as after an update of the velocity, without.
                for with_velocity in [true, false] {
                    g[VELOCITY] = if with_velocity { 0.3 } else { 0.0 };
                    covariance.subtract_square(&g);
                    let square = DVector::from_column_slice(&g);
                    expected -= &square * square.transpose();
                    let agrees = |covariance: &Covariance, expected: &DMatrix<f64>| {
                        let entries = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
                        entries
                            .map(|(i, j)| (covariance.at(i, j) - expected[(i, j)]).abs())
                            .fold(0.0, f64::max)
                    };
                    assert!(agrees(&covariance, &expected) < 1e-12, "{n}");
                    let mut row = vec![0.0; padded];
                    covariance.copy_row(3, &mut row);
                    assert!((0..n).all(|j| row[j] == covariance.at(3, j)));
                    let (mut of_f, mut of_c) = (vec![0.0; padded], vec![0.0; padded]);
                    covariance.times([&f, &c], [&mut of_f, &mut of_c]);
                    for (product, factor) in [(&of_f, &f), (&of_c, &c)] {
                        let wanted = &expected * DVector::from_column_slice(factor);
                        assert!((DVector::from_column_slice(product) - wanted).amax() < 1e-12, "{n}");
                    }
                    let mut settled = covariance.clone();
                    settled.settle();
                    let (mut product, mut of_settled) = (vec![0.0; padded], vec![0.0; padded]);
                    covariance.advance(&f, &s, &variances, &mut product);
                    settled.advance(&f, &s, &variances, &mut of_settled);
                    assert!(product == of_settled && covariance == settled, "{n}: to the bit");
                    assert!((0..n).all(|j| (product[j] - of_f[j]).abs() < 1e-12), "{n}");
                    let kept: Vec<f64> = (0..padded).map(|j| expected[(VELOCITY, j)]).collect();
                    expected = DMatrix::from_fn(padded, padded, |i, j| {
                        expected[(i, j)] * s[i] * s[j] + if i == j { variances[i] } else { 0.0 }
                    });
                    // The caller sets the velocity's row.
                    for (j, value) in kept.into_iter().enumerate() {
                        (expected[(VELOCITY, j)], expected[(j, VELOCITY)]) = (value, value);
                    }
                    let mut values: Vec<f64> = (0..padded).map(|j| expected[(VELOCITY, j)]).collect();
                    values[VELOCITY] = expected[(VELOCITY, VELOCITY)];
                    covariance.set_cross(VELOCITY, &values);
                    assert!(agrees(&covariance, &expected) < 1e-12, "{n}");
                }
            }
        }
    }
}
