//! Computes K = R Rᵀ and R⁻¹ in place, block by block, so that nearly all work is products of large matrices.
//!
//! nalgebra's own factorisation and substitution go column by column, and memory limits their speed: at 4096 centers they
//! take minutes, and its product of matrices seconds.

use nalgebra::{DMatrix, DVector};

/// Columns of a block. It is factored and inverted by nalgebra's plain loops, which take a share of 3·BLOCK/N of all
/// work.
const BLOCK: usize = 96;
/// Columns of a product within the inverse: wide enough to run at speed, and narrow enough to leave out most zeros.
const STRIP: usize = 256;

/// R in place of K: reads and writes the lower triangle; what is above it has to be zero. `None` where a pivot is not
/// positive.
///
/// # Cost
/// N³/6 multiply-adds.
fn factor(matrix: &mut DMatrix<f64>) -> Option<()> {
    let n = matrix.nrows();
    for start in (0..n).step_by(BLOCK) {
        let (width, end) = (BLOCK.min(n - start), n.min(start + BLOCK));
        let (known, mut block) = matrix.columns_range_pair_mut(0..start, start..end);
        let beside = known.rows(start, width).transpose();
        block.rows_range_mut(start..).gemm(-1.0, &known.rows_range(start..), &beside, 1.0);
        let diagonal = block.rows(start, width).into_owned().cholesky()?.unpack();
        let below = block.rows_range(end..) * inverse_of_block(&diagonal).transpose();
        block.rows_mut(start, width).copy_from(&diagonal);
        block.rows_range_mut(end..).copy_from(&below);
    }
    Some(())
}

/// As [`factor`]; `None` also where a pivot is no larger than the rounding errors of the ones before it, and carries no
/// information.
pub(crate) fn factor_regular(matrix: &mut DMatrix<f64>) -> Option<()> {
    let smallest_pivot = (matrix.nrows() as f64 * f64::EPSILON * matrix.amax()).sqrt();
    factor(matrix)?;
    matrix.diagonal().iter().all(|&pivot| pivot > smallest_pivot).then_some(())
}

/// R⁻¹ in place of R, and the smallest and the largest eigenvalue of K, to about 1e-6 of themselves.
pub(crate) fn invert_and_bound(factor: &mut DMatrix<f64>) -> (f64, f64) {
    let n = factor.nrows();
    let largest = largest_eigenvalue(n, |x| times(factor, &transposed_times(factor, x)));
    invert(factor);
    let smallest = largest_eigenvalue(n, |x| transposed_times(factor, &times(factor, x))).recip();
    (smallest, largest)
}

/// R⁻¹ in place of R, both with zeros above the diagonal, and a diagonal without.
///
/// With the rows of X = R⁻¹ above block i known, `X_ij = −R_ii⁻¹ Σ_{k<i} R_ik X_kj`.
///
/// # Cost
/// N³/6 multiply-adds.
pub(crate) fn invert(factor: &mut DMatrix<f64>) {
    let n = factor.nrows();
    for start in (0..n).step_by(BLOCK) {
        let width = BLOCK.min(n - start);
        let diagonal = inverse_of_block(&factor.view((start, start), (width, width)).into_owned());
        let scaled = -(&diagonal * factor.view((start, 0), (width, start)));
        for column in (0..start).step_by(STRIP) {
            let (height, strip) = (start - column, STRIP.min(start - column));
            let product = scaled.columns_range(column..) * factor.view((column, column), (height, strip));
            factor.view_mut((start, column), (width, strip)).copy_from(&product);
        }
        factor.view_mut((start, start), (width, width)).copy_from(&diagonal);
    }
}

fn inverse_of_block(lower: &DMatrix<f64>) -> DMatrix<f64> {
    let identity = DMatrix::identity(lower.nrows(), lower.nrows());
    lower.solve_lower_triangular(&identity).expect("the pivots are positive")
}

/// T x of a lower triangular T.
fn times(lower: &DMatrix<f64>, x: &DVector<f64>) -> DVector<f64> {
    let mut product = DVector::zeros(x.len());
    for (j, (column, &x)) in lower.column_iter().zip(x).enumerate() {
        product.rows_range_mut(j..).axpy(x, &column.rows_range(j..), 1.0);
    }
    product
}

/// Tᵀ x of a lower triangular T.
fn transposed_times(lower: &DMatrix<f64>, x: &DVector<f64>) -> DVector<f64> {
    DVector::from_fn(x.len(), |j, _| lower.column(j).rows_range(j..).dot(&x.rows_range(j..)))
}

/// The largest eigenvalue of a symmetric positive semidefinite matrix, by Lanczos' iteration: to 1e-6 of itself.
///
/// The largest eigenvalue ϑ of the projection on the space searched so far, with its vector's last entry s, has an
/// eigenvalue of the matrix within β|s|.
pub(crate) fn largest_eigenvalue(n: usize, multiply: impl Fn(&DVector<f64>) -> DVector<f64>) -> f64 {
    const TOLERANCE: f64 = 1e-6;
    const MAX_STEPS: usize = 400;
    // No symmetry of a lattice makes this start orthogonal to the eigenvector.
    let mut direction = DVector::from_fn(n, |i, _| 1.0 + ((i * 7919) % 1013) as f64 / 1013.0).normalize();
    let mut before = DVector::zeros(n);
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    loop {
        let mut next = multiply(&direction);
        diagonal.push(direction.dot(&next));
        next.axpy(-diagonal[diagonal.len() - 1], &direction, 1.0);
        next.axpy(-beside.last().copied().unwrap_or(0.0), &before, 1.0);
        let (beta, steps) = (next.norm(), diagonal.len());
        // The projection's eigenvalues cost more than a step, once it is large.
        if steps <= 8 || steps.is_multiple_of(8) || steps == n {
            let mut projection = DMatrix::from_diagonal(&DVector::from_column_slice(&diagonal));
            for (i, &beta) in beside.iter().enumerate() {
                projection[(i + 1, i)] = beta;
                projection[(i, i + 1)] = beta;
            }
            let eigen = projection.symmetric_eigen();
            let largest = eigen.eigenvalues.imax();
            let (value, last) = (eigen.eigenvalues[largest], eigen.eigenvectors[(steps - 1, largest)]);
            if beta * last.abs() <= TOLERANCE * value || steps >= MAX_STEPS.min(n) {
                return value;
            }
        }
        beside.push(beta);
        before = std::mem::replace(&mut direction, next / beta);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Well conditioned, without any structure that blocks could share.
    fn positive_definite(n: usize) -> DMatrix<f64> {
        let noise = |i: usize, j: usize| ((i * 7919 + j * 104_729) % 1009) as f64 / 1009.0;
        DMatrix::from_fn(n, n, |i, j| noise(i.min(j), i.max(j)) + if i == j { n as f64 } else { 0.0 })
    }

    #[test]
    fn factor_and_inverse_are_those_of_plain_loops_at_all_sizes_around_a_block() {
        for n in [1, 5, BLOCK - 1, BLOCK, BLOCK + 1, STRIP + BLOCK, 3 * STRIP + 7] {
            let matrix = positive_definite(n);
            let mut lower = matrix.lower_triangle();
            factor(&mut lower).unwrap();
            let expected = matrix.clone().cholesky().unwrap().unpack();
            assert!((&lower - &expected).amax() < 1e-12 * expected.amax(), "n {n}");
            let x = DVector::from_fn(n, |i, _| (i as f64 * 0.7).sin());
            assert!((times(&lower, &transposed_times(&lower, &x)) - &matrix * &x).amax() < 1e-10 * n as f64);
            invert(&mut lower);
            assert_eq!(lower, lower.lower_triangle(), "n {n}");
            assert!((lower * expected - DMatrix::identity(n, n)).amax() < 1e-13 * n as f64, "n {n}");
        }
    }

    #[test]
    fn an_indefinite_matrix_has_no_factor_in_whichever_block_it_shows() {
        for at in [0, BLOCK - 1, BLOCK, 2 * BLOCK + 3] {
            let mut matrix = positive_definite(3 * BLOCK).lower_triangle();
            matrix[(at, at)] = -1.0;
            assert_eq!(factor(&mut matrix), None);
        }
    }

    #[test]
    fn the_largest_eigenvalue_is_that_of_a_full_decomposition() {
        for n in [1, 2, 27, 200] {
            let matrix = positive_definite(n);
            let expected = matrix.symmetric_eigenvalues().max();
            let found = largest_eigenvalue(n, |x| &matrix * x);
            assert!((found / expected - 1.0).abs() < 1e-6, "n {n}: {found} {expected}");
        }
        // A multiple of the identity ends after one step, which leaves nothing to search.
        assert_eq!(largest_eigenvalue(50, |x| 3.0 * x), 3.0);
    }
}
