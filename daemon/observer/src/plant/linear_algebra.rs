//! Subspaces, poles and norms of a linear plant. Only for set-up, since all functions allocate.

use nalgebra::{Complex, DMatrix, DVector, Schur};

/// A direction shorter than this part of what it came from lies in the span already.
const RANK_TOLERANCE: f64 = 1e-9;

/// An orthonormal basis of span {B, AB, A²B, …}: the reachable subspace of (A, B). n×r.
pub(crate) fn reachable_subspace(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut fresh: Vec<DVector<f64>> = b.column_iter().map(|column| column.into_owned()).collect();
    while !fresh.is_empty() && basis.len() < a.nrows() {
        let mut added = Vec::new();
        for direction in fresh {
            let length = direction.norm();
            let mut rest = direction;
            // Twice is enough (Kahan).
            for _ in 0..2 {
                for known in &basis {
                    let along = known.dot(&rest);
                    rest -= along * known;
                }
            }
            if rest.norm() > RANK_TOLERANCE * length && length > 0.0 {
                let direction = rest.normalize();
                added.push(a * &direction);
                basis.push(direction);
            }
        }
        fresh = added;
    }
    match basis.is_empty() {
        true => DMatrix::zeros(a.nrows(), 0),
        false => DMatrix::from_columns(&basis),
    }
}

/// An orthonormal basis of the orthogonal complement of the columns of an orthonormal `basis`. n×(n−r).
pub(crate) fn complement(basis: &DMatrix<f64>) -> DMatrix<f64> {
    let n = basis.nrows();
    let outside = DMatrix::identity(n, n) - basis * basis.transpose();
    reachable_subspace(&DMatrix::zeros(n, n), &outside.map(|x| if x.abs() < 1e-12 { 0.0 } else { x }))
}

/// The eigenvalues of a square matrix of finite numbers.
///
/// nalgebra's QR iteration with its default tolerance of one rounding error does not end on some repeated
/// eigenvalues; with a few it does, or with the matrix moved by a few rounding errors, which is as right.
pub(crate) fn eigenvalues(matrix: &DMatrix<f64>) -> Vec<Complex<f64>> {
    if matrix.is_empty() {
        return Vec::new();
    }
    let moved = |roundings: f64| {
        let size = roundings * f64::EPSILON * matrix.amax();
        let shift = |i: usize, j: usize| ((i * 7919 + j * 104_729) % 1013) as f64 / 1013.0 - 0.5;
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] + size * shift(i, j))
    };
    let schur = [0.0, 4.0, 16.0, 64.0, 256.0]
        .into_iter()
        .find_map(|roundings| Schur::try_new(moved(roundings), 16.0 * f64::EPSILON, 300 * matrix.nrows()));
    match schur {
        Some(schur) => schur.complex_eigenvalues().iter().copied().collect(),
        // Unknown eigenvalues count as unstable.
        None => vec![Complex::new(f64::NAN, f64::NAN)],
    }
}

/// The largest real part of the eigenvalues: negative where the matrix is Hurwitz; +∞ where they are not known.
pub(crate) fn spectral_abscissa(matrix: &DMatrix<f64>) -> f64 {
    let real_part = |pole: &Complex<f64>| if pole.re.is_nan() { f64::INFINITY } else { pole.re };
    eigenvalues(matrix).iter().map(real_part).fold(f64::NEG_INFINITY, f64::max)
}

/// ‖M‖₂, the largest singular value.
pub(crate) fn spectral_norm(matrix: &DMatrix<f64>) -> f64 {
    if matrix.is_empty() { 0.0 } else { matrix.singular_values().max() }
}

/// ‖M⁻¹‖₂; +∞ where M is not square.
pub(crate) fn inverse_norm(matrix: &DMatrix<f64>) -> f64 {
    if matrix.is_square() { matrix.singular_values().min().recip() } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::matrix;

    #[test]
    fn the_subspaces_of_a_double_integrator() {
        let (a, b) = (matrix(2, &[0.0, 1.0, 0.0, 0.0]), matrix(2, &[0.0, 0.25]));
        assert_eq!(reachable_subspace(&a, &b).ncols(), 2);
        for (c, unobservable) in [([1.0, 0.0], 0), ([0.0, 1.0], 1)] {
            let observable = reachable_subspace(&a.transpose(), &matrix(2, &c));
            let rest = complement(&observable);
            assert_eq!(rest.ncols(), unobservable);
            if unobservable == 1 {
                assert_eq!(rest[(0, 0)].abs(), 1.0, "position");
            }
        }
    }
}
