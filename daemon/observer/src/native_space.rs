//! The finite-dimensional native space H_N: centers, Gram matrix, and orthonormal (Newton) features.
//!
//! With K = R Rᵀ, the features φ(y) = R⁻¹ k(y) are an orthonormal basis of H_N: φᵀφ = kᵀK⁻¹k and
//! f̂_N(y) = θᵀφ(y) has the norm ‖θ‖_F. The paper's coefficients are α̂ = R⁻ᵀθ, its nodal values β = Rθ.

use crate::{Centers, DesignError, Kernel, Parameter};
use nalgebra::{DMatrix, Vector3};

/// A kernel of one length scale on N centers, factored once.
#[derive(Debug, Clone)]
pub struct NativeSpace {
    kernel: Kernel,
    inverse_length_scale: f64,
    centers: Centers,
    bounding_box: ([f64; 3], [f64; 3]),
    /// Coordinates of the centers, one run per axis, so that the kernel vector is plain loops.
    coordinates: [Vec<f64>; 3],
    /// R⁻¹, lower triangle, row after row: row i has i + 1 entries.
    inverse_factor: Vec<f64>,
    gram_condition: f64,
}

impl NativeSpace {
    /// Builds K, factors it and inverts the factor.
    ///
    /// `nugget` ≥ 0 is added to K's diagonal as a multiple of κ(0); 0 is the paper's law.
    ///
    /// # Errors
    /// `LengthScale` or `Nugget` out of range; `Centers` where K is not numerically positive definite,
    /// naming the closest pair of centers, the condition estimate and what to change.
    ///
    /// # Cost
    /// 2N³/3 multiply-adds, once; N(N+1)/2 numbers kept.
    pub fn new(
        kernel: Kernel,
        length_scale: f64,
        centers: Centers,
        nugget: f64,
    ) -> Result<Self, DesignError> {
        if !(length_scale.is_finite() && length_scale > 0.0) {
            return Err(DesignError::new(
                Parameter::LengthScale,
                length_scale.to_string(),
                "a finite number > 0",
            ));
        }
        if !(nugget.is_finite() && nugget >= 0.0) {
            return Err(DesignError::new(Parameter::Nugget, nugget.to_string(), "a finite number ≥ 0"));
        }
        let n = centers.n_centers();
        let coordinates = std::array::from_fn(|axis| centers.points().iter().map(|p| p[axis]).collect());
        let mut space = Self {
            kernel,
            inverse_length_scale: length_scale.recip(),
            coordinates,
            bounding_box: centers.bounding_box(),
            inverse_factor: Vec::new(),
            gram_condition: f64::INFINITY,
            centers,
        };
        let mut gram = space.gram();
        for i in 0..n {
            gram[(i, i)] += nugget * kernel.value_at_zero();
        }
        // A pivot of the size of the rounding errors of the ones before it carries no information.
        let smallest_pivot = (n as f64 * f64::EPSILON * kernel.value_at_zero()).sqrt();
        let factor = gram.clone().cholesky().map(|cholesky| cholesky.unpack());
        let Some(factor) = factor.filter(|r| r.diagonal().iter().all(|&pivot| pivot > smallest_pivot)) else {
            return Err(space.not_positive_definite(&gram));
        };
        let inverse =
            factor.solve_lower_triangular(&DMatrix::identity(n, n)).expect("the pivots are positive");
        space.inverse_factor =
            (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|at| inverse[at]).collect();
        space.gram_condition =
            largest_eigenvalue(n, |x| &gram * x) * largest_eigenvalue(n, |x| inverse.tr_mul(&(&inverse * x)));
        Ok(space)
    }

    fn not_positive_definite(&self, gram: &DMatrix<f64>) -> DesignError {
        let largest = largest_eigenvalue(gram.nrows(), |x| gram * x);
        let condition = largest / (f64::EPSILON * self.kernel.value_at_zero());
        let pair = match self.centers.closest_pair() {
            Some((a, b, distance)) => format!(
                "the closest pair, centers {a} and {b}, is {distance:.3e} apart ({:.3e} length scales)",
                distance * self.inverse_length_scale
            ),
            None => "there is a single center".into(),
        };
        DesignError::new(
            Parameter::Centers,
            format!(
                "the Gram matrix is not numerically positive definite: {pair}; condition ≥ {condition:.1e}"
            ),
            "centers further apart, a shorter length scale, a lower kernel order, or a nugget (1e-10, say)",
        )
    }

    /// K: `K_ij = 𝔎(ξ_i, ξ_j)`, N×N, without nugget. The Gram matrix of the vector-valued kernel is K ⊗ I₃.
    pub fn gram(&self) -> DMatrix<f64> {
        let points = self.centers.points();
        DMatrix::from_fn(points.len(), points.len(), |i, j| {
            let squared: f64 = (0..3).map(|axis| (points[i][axis] - points[j][axis]).powi(2)).sum();
            self.kernel.value(squared.sqrt() * self.inverse_length_scale)
        })
    }

    /// N.
    pub fn n_centers(&self) -> usize {
        self.centers.n_centers()
    }

    /// The centers, in the order of all vectors of length N.
    pub fn centers(&self) -> &Centers {
        &self.centers
    }

    /// The smallest box around the centers: its lower and its upper corner.
    pub fn bounding_box(&self) -> ([f64; 3], [f64; 3]) {
        self.bounding_box
    }

    /// The kernel κ.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// The spectral condition number of K, estimated by power iteration (relative error about 1e-6).
    pub fn gram_condition(&self) -> f64 {
        self.gram_condition
    }

    /// k(y): `k_j = κ(‖ξ_j − y‖/ℓ)`, N values. No allocation.
    pub fn kernel_vector(&self, y: &Vector3<f64>, kernel_vector: &mut [f64]) {
        let n = kernel_vector.len();
        let [xs, ys, zs] = &self.coordinates;
        let (xs, ys, zs) = (&xs[..n], &ys[..n], &zs[..n]);
        for j in 0..n {
            let (dx, dy, dz) = (xs[j] - y.x, ys[j] - y.y, zs[j] - y.z);
            let r = (dx * dx + dy * dy + dz * dz).sqrt() * self.inverse_length_scale;
            kernel_vector[j] = self.kernel.value(r);
        }
    }

    /// φ(y) = R⁻¹ k(y), N values; `kernel_vector` is left holding k(y). No allocation.
    ///
    /// # Cost
    /// N(N+1)/2 multiply-adds and N kernel values.
    pub fn features(&self, y: &Vector3<f64>, kernel_vector: &mut [f64], features: &mut [f64]) {
        self.kernel_vector(y, kernel_vector);
        let mut rest = &self.inverse_factor[..];
        for (i, feature) in features.iter_mut().enumerate() {
            let (row, below) = rest.split_at(i + 1);
            *feature = dot(row, &kernel_vector[..=i]);
            rest = below;
        }
    }

    /// P_N(y) = √(κ(0) − φᵀφ): how badly the centers cover y; √κ(0) where they cover nothing.
    pub fn power_function(&self, squared_features: f64) -> f64 {
        (self.kernel.value_at_zero() - squared_features).max(0.0).sqrt()
    }

    /// α̂ = R⁻ᵀ θ, N×3: the paper's coefficients of the function with these weights.
    pub fn coefficients(&self, weights: &[Vec<f64>; 3]) -> DMatrix<f64> {
        let n = self.n_centers();
        let mut coefficients = DMatrix::zeros(n, 3);
        for (column, theta) in weights.iter().enumerate() {
            let mut rest = &self.inverse_factor[..];
            for (i, &weight) in theta.iter().enumerate() {
                let (row, below) = rest.split_at(i + 1);
                for (j, entry) in row.iter().enumerate() {
                    coefficients[(j, column)] += entry * weight;
                }
                rest = below;
            }
        }
        coefficients
    }

    /// Bytes that every step reads: the packed factor and the centers.
    pub fn bytes(&self) -> usize {
        8 * (self.inverse_factor.len() + 3 * self.n_centers())
    }
}

/// xᵀy in eight partial sums, so that the compiler may use vector registers.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (x_runs, x_rest) = x.as_chunks::<8>();
    let (y_runs, y_rest) = y.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in x_runs.iter().zip(y_runs) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(a, b)| a * b).sum();
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) + rest
}

/// The largest eigenvalue of a symmetric positive semidefinite matrix, by power iteration.
fn largest_eigenvalue(n: usize, multiply: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> f64 {
    // No symmetry of a lattice can make this start orthogonal to the dominant eigenvector for long.
    let mut x = DMatrix::from_fn(n, 1, |i, _| 1.0 + ((i * 7919) % 1013) as f64 / 1013.0);
    let mut eigenvalue = 0.0;
    for _ in 0..500 {
        x /= x.norm();
        let next = multiply(&x);
        let estimate = x.dot(&next);
        let settled = (estimate - eigenvalue).abs() <= 1e-9 * estimate;
        (x, eigenvalue) = (next, estimate);
        if settled {
            break;
        }
    }
    eigenvalue
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MaternOrder;

    const KERNEL: Kernel = Kernel::SobolevMatern { order: MaternOrder::Three };

    fn paper() -> NativeSpace {
        let centers = Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap();
        NativeSpace::new(KERNEL, 1.0, centers, 0.0).unwrap()
    }

    fn features(space: &NativeSpace, y: [f64; 3]) -> (Vec<f64>, Vec<f64>) {
        let n = space.n_centers();
        let (mut k, mut phi) = (vec![0.0; n], vec![0.0; n]);
        space.features(&y.into(), &mut k, &mut phi);
        (k, phi)
    }

    #[test]
    fn the_papers_lattice_has_the_known_condition() {
        let space = paper();
        let eigenvalues = space.gram().symmetric_eigenvalues();
        let exact = eigenvalues.max() / eigenvalues.min();
        assert!((exact - 291.7).abs() < 0.05, "{exact}");
        assert!((space.gram_condition() / exact - 1.0).abs() < 1e-4, "{}", space.gram_condition());
    }

    /// φᵀφ = kᵀ K⁻¹ k, with K⁻¹k from nalgebra's LU and not from our factor.
    #[test]
    fn the_features_are_orthonormal() {
        let space = paper();
        let gram = space.gram();
        for y in [[0.1, 0.2, -0.7], [0.9, -0.9, 0.4], [3.0, 0.0, 0.0], [1.0, 1.0, 1.0]] {
            let (k, phi) = features(&space, y);
            let k = DMatrix::from_vec(27, 1, k);
            let expected = k.dot(&gram.clone().lu().solve(&k).unwrap());
            assert!((dot(&phi, &phi) - expected).abs() < 1e-12, "{y:?}");
        }
    }

    /// The power function vanishes at a center and nears √κ(0) far away.
    #[test]
    fn the_power_function_measures_cover() {
        let space = paper();
        let power = |y: [f64; 3]| {
            let (_, phi) = features(&space, y);
            space.power_function(dot(&phi, &phi))
        };
        assert!(power([1.0, 0.0, -1.0]) < 1e-6);
        assert!((power([60.0, 0.0, 0.0]) - KERNEL.value_at_zero().sqrt()).abs() < 1e-12);
        // Its supremum over the lattice's box, at the middle of a cell: 0.443.
        assert!((power([0.5, 0.5, 0.5]) - 0.443).abs() < 5e-4, "{}", power([0.5; 3]));
    }

    #[test]
    fn equal_or_nearly_equal_centers_are_refused_by_name() {
        for gap in [0.0, 1e-12] {
            let centers = Centers::listed(vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, gap, 0.0]]).unwrap();
            let error = NativeSpace::new(KERNEL, 1.0, centers, 0.0).unwrap_err().to_string();
            assert!(error.contains("centers 2 and 3"), "{error}");
        }
        let centers = Centers::listed(vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]).unwrap();
        assert!(NativeSpace::new(KERNEL, 1.0, centers, 1e-8).is_ok(), "a nugget helps");
    }
}
