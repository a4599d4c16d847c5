//! A lower triangular matrix stored in panels, so that only the memory limits the speed of its products.

use crate::space::factors::lanes::{LANES, Lanes, VectorLoop, whole_lanes};
use nalgebra::DMatrix;
use pulp::Simd;

/// A lower triangular n×n matrix T. Eight rows are a panel; a panel's columns lie one after the other, so that
/// the product is one stream of eight-fold multiply-adds. Above the diagonal and below row n are zeros.
#[derive(Debug, Clone)]
pub(crate) struct PackedFactor {
    panels: Vec<Lanes>,
}

impl PackedFactor {
    /// The lower triangle of a square matrix.
    pub(crate) fn new(matrix: &DMatrix<f64>) -> Self {
        let n = matrix.nrows();
        let n_panels = whole_lanes(n) / LANES;
        let mut panels = Vec::with_capacity(LANES * n_panels * (n_panels + 1) / 2);
        for panel in 0..n_panels {
            for column in 0..LANES * (panel + 1) {
                panels.push(Lanes(std::array::from_fn(|l| {
                    let row = LANES * panel + l;
                    if row < n && column <= row { matrix[(row, column)] } else { 0.0 }
                })));
            }
        }
        Self { panels }
    }

    /// T_ij for j ≤ i.
    fn entry(&self, i: usize, j: usize) -> f64 {
        let panel = i / LANES;
        self.panels[LANES * panel * (panel + 1) / 2 + j].0[i % LANES]
    }

    /// Tᵀx of the first rows and columns, as many as x has numbers.
    pub(crate) fn transposed_times(&self, x: &[f64]) -> Vec<f64> {
        (0..x.len()).map(|j| (j..x.len()).map(|i| self.entry(i, j) * x[i]).sum()).collect()
    }

    /// T⁻¹y of the first rows and columns, as many as y has numbers.
    pub(crate) fn solve(&self, y: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = Vec::with_capacity(y.len());
        for (i, y) in y.iter().enumerate() {
            let known: f64 = x.iter().enumerate().map(|(j, x)| self.entry(i, j) * x).sum();
            x.push((y - known) / self.entry(i, i));
        }
        x
    }

    /// Bytes that a product reads.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.panels.as_slice())
    }
}

/// φ = T k and φᵀφ; `x` and `product` of whole lanes.
pub(crate) struct Product<'a> {
    pub(crate) factor: &'a PackedFactor,
    pub(crate) x: &'a [f64],
    pub(crate) product: &'a mut [f64],
}

/// Four sums for each of the eight rows of a panel: one multiply-add takes as long as four of them take to start. Of
/// the LANES registers of each as many are used as hold eight numbers.
type Sums<S> = [[<S as Simd>::f64s; LANES]; 4];

impl VectorLoop for Product<'_> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        let zero = simd.splat_f64s(0.0);
        let mut squares = zero;
        let mut rest = self.factor.panels.as_slice();
        let (products, _) = self.product.as_chunks_mut::<LANES>();
        // Where there are registers enough, two panels at a time: two streams come out of the memory faster than one, by
        // a tenth where the factor is larger than the caches.
        let registers_of_pair = 2 * 4 * LANES / S::F64_LANES;
        let n_paired = if registers_of_pair < S::REGISTER_COUNT { products.len() & !1 } else { 0 };
        let (paired, single) = products.split_at_mut(n_paired);
        for (pair, [upper_product, lower_product]) in paired.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            let n_columns = LANES * (2 * pair + 1);
            let (upper, below) = rest.split_at(n_columns);
            let (lower, below) = below.split_at(n_columns + LANES);
            let (x, next_x) = self.x[..n_columns + LANES].split_at(n_columns);
            let (beside_upper, under_diagonal) = lower.split_at(n_columns);
            let (mut upper_sums, mut lower_sums) = ([[zero; LANES]; 4], [[zero; LANES]; 4]);
            for ((upper, lower), x) in fours(upper).iter().zip(fours(beside_upper)).zip(fours(x)) {
                add_columns(simd, &mut upper_sums, upper, x);
                add_columns(simd, &mut lower_sums, lower, x);
            }
            for (lower, x) in fours(under_diagonal).iter().zip(fours(next_x)) {
                add_columns(simd, &mut lower_sums, lower, x);
            }
            squares = total(simd, &upper_sums, upper_product, squares);
            squares = total(simd, &lower_sums, lower_product, squares);
            rest = below;
        }
        for (panel, product) in single.iter_mut().enumerate() {
            let (columns, below) = rest.split_at(LANES * (n_paired + panel + 1));
            let mut sums = [[zero; LANES]; 4];
            for (columns, x) in fours(columns).iter().zip(fours(self.x)) {
                add_columns(simd, &mut sums, columns, x);
            }
            squares = total(simd, &sums, product, squares);
            rest = below;
        }
        simd.reduce_sum_f64s(squares)
    }
}

#[inline(always)]
fn fours<T>(slice: &[T]) -> &[[T; 4]] {
    slice.as_chunks().0
}

/// Adds four columns of a panel, each times its entry of x, to its four sums.
#[inline(always)]
fn add_columns<S: Simd>(simd: S, sums: &mut Sums<S>, columns: &[Lanes; 4], x: &[f64; 4]) {
    for ((sums, column), &x) in sums.iter_mut().zip(columns).zip(x) {
        let (column, _) = S::as_simd_f64s(&column.0);
        let x = simd.splat_f64s(x);
        for (sum, &entries) in sums.iter_mut().zip(column) {
            *sum = simd.mul_add_e_f64s(entries, x, *sum);
        }
    }
}

/// The four sums' total into a panel's product, and its squares.
#[inline(always)]
fn total<S: Simd>(simd: S, sums: &Sums<S>, product: &mut [f64; LANES], squares: S::f64s) -> S::f64s {
    let [first, second, third, fourth] = sums;
    let (product, _) = S::as_mut_simd_f64s(product);
    let mut squares = squares;
    for (i, entries) in product.iter_mut().enumerate() {
        let sum = simd.add_f64s(simd.add_f64s(first[i], second[i]), simd.add_f64s(third[i], fourth[i]));
        *entries = sum;
        squares = simd.mul_add_e_f64s(sum, sum, squares);
    }
    squares
}

/// Points whose features are found together.
pub(crate) const POINTS: usize = 8;

/// φᵀφ, φ = T k, of several k in one pass over the factor: entry j of all of them, then entry j + 1, in whole lanes.
pub(crate) struct SquaresOfProducts<'a> {
    pub(crate) factor: &'a PackedFactor,
    pub(crate) x: &'a [[f64; POINTS]],
}

impl VectorLoop for SquaresOfProducts<'_> {
    type Output = [f64; POINTS];

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> [f64; POINTS] {
        let zero = simd.splat_f64s(0.0);
        let mut squares = [zero; POINTS];
        let mut rest = self.factor.panels.as_slice();
        for panel in 0..self.x.len() / LANES {
            let (columns, below) = rest.split_at(LANES * (panel + 1));
            let mut sums = [[zero; LANES]; POINTS];
            for (column, x) in columns.iter().zip(self.x) {
                let (column, _) = S::as_simd_f64s(&column.0);
                for (sums, &x) in sums.iter_mut().zip(x) {
                    let x = simd.splat_f64s(x);
                    for (sum, &entries) in sums.iter_mut().zip(column) {
                        *sum = simd.mul_add_e_f64s(entries, x, *sum);
                    }
                }
            }
            let registers = LANES / S::F64_LANES;
            for (squares, sums) in squares.iter_mut().zip(&sums) {
                for &sum in &sums[..registers] {
                    *squares = simd.mul_add_e_f64s(sum, sum, *squares);
                }
            }
            rest = below;
        }
        squares.map(|squares| simd.reduce_sum_f64s(squares))
    }
}

/// T x for four vectors of whole lanes: T is read once.
#[inline(always)]
pub(crate) fn four_products<S: Simd>(
    simd: S,
    factor: &PackedFactor,
    x: [&[f64]; 4],
    product: [&mut [f64]; 4],
) {
    let zero = simd.splat_f64s(0.0);
    let mut rest = factor.panels.as_slice();
    let [x0, x1, x2, x3] = x;
    let [p0, p1, p2, p3] = product.map(|product| product.as_chunks_mut::<LANES>().0);
    for (panel, (((p0, p1), p2), p3)) in p0.iter_mut().zip(p1).zip(p2).zip(p3).enumerate() {
        let n_columns = LANES * (panel + 1);
        let (columns, below) = rest.split_at(n_columns);
        // Two columns at a time, as in a single product. Of the LANES registers of each sum as many are used as hold eight
        // numbers here.
        let mut sums = [[[zero; LANES]; 4]; 2];
        let [x0, x1, x2, x3] = [x0, x1, x2, x3].map(|x| x[..n_columns].as_chunks::<2>().0);
        let x = x0.iter().zip(x1).zip(x2).zip(x3);
        for (columns, (((x0, x1), x2), x3)) in columns.as_chunks::<2>().0.iter().zip(x) {
            for (c, (column, sums)) in columns.iter().zip(&mut sums).enumerate() {
                let (column, _) = S::as_simd_f64s(&column.0);
                for (sums, x) in sums.iter_mut().zip([x0[c], x1[c], x2[c], x3[c]]) {
                    let x = simd.splat_f64s(x);
                    for (sum, &entries) in sums.iter_mut().zip(column) {
                        *sum = simd.mul_add_e_f64s(entries, x, *sum);
                    }
                }
            }
        }
        let [even, odd] = sums;
        for (product, (even, odd)) in [p0, p1, p2, p3].into_iter().zip(even.into_iter().zip(odd)) {
            let (product, _) = S::as_mut_simd_f64s(product);
            for (entries, (even, odd)) in product.iter_mut().zip(even.into_iter().zip(odd)) {
                *entries = simd.add_f64s(even, odd);
            }
        }
        rest = below;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::factors::lanes::VectorUnit;

    #[test]
    fn the_product_is_that_of_the_triangle() {
        for n in [1, 7, 8, 9, 17, 27, 64, 125] {
            let matrix = DMatrix::from_fn(n, n, |i, j| ((i * 31 + j * 17) % 23) as f64 / 23.0 - 0.4);
            let factor = PackedFactor::new(&matrix);
            let mut x = vec![0.0; whole_lanes(n)];
            (0..n).for_each(|i| x[i] = (i as f64 * 0.7).sin());
            let expected = matrix.lower_triangle() * nalgebra::DVector::from_column_slice(&x[..n]);
            for unit in [VectorUnit::of_this_machine(), VectorUnit::baseline()] {
                let mut product = vec![f64::NAN; whole_lanes(n)];
                let squares = unit.run(Product { factor: &factor, x: &x, product: &mut product });
                for i in 0..n {
                    assert!((product[i] - expected[i]).abs() < 1e-13, "n {n} row {i}");
                    assert_eq!(factor.entry(i, i / 2), matrix[(i, i / 2)]);
                }
                assert!(product[n..].iter().all(|&rest| rest == 0.0));
                assert!((squares - expected.norm_squared()).abs() <= 1e-12 * expected.norm_squared());
                // The same vector, times 0 to 7.
                let several: Vec<_> = x.iter().map(|x| std::array::from_fn(|p| p as f64 * x)).collect();
                let found = unit.run(SquaresOfProducts { factor: &factor, x: &several });
                for (p, found) in found.into_iter().enumerate() {
                    let expected = (p * p) as f64 * expected.norm_squared();
                    assert!((found - expected).abs() <= 1e-12 * expected, "n {n}, {p} times");
                }
            }
        }
    }
}
