//! Elements of the native space H, not only of H_N: finite sums of kernels at any points.
//!
//! `f = Σ_i 𝒦(z_i, ·) a_i ,  𝒦 = 𝔎 I_m`
//!
//! With the inner product `⟨𝒦(y,·) a, 𝒦(z,·) b⟩ = 𝔎(y, z) aᵀb` (Niu et al., eqs. (native space, inner product)) the evaluation
//! E_y f = f(y) has the adjoint E_y* a = 𝒦(y,·) a: `⟨E_y* a, f⟩ = aᵀ f(y)`.

use nalgebra::DMatrix;
use observer::{NativeSpace, ScaledKernel};

/// A vector-valued function of the native space, `f: ℝ^d → ℝ^m`.
///
/// # Source
/// Niu et al., §II, eqs. (native space), (inner product), (evaluation operator).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NativeFunction {
    kernel: ScaledKernel,
    n_outputs: usize,
    /// z_i and a_i.
    terms: Vec<(Vec<f64>, Vec<f64>)>,
}

impl NativeFunction {
    /// The zero of H, with m = `n_outputs` components.
    pub(crate) fn zero(kernel: ScaledKernel, n_outputs: usize) -> Self {
        Self { kernel, n_outputs, terms: Vec::new() }
    }

    /// The function of H_N with these weights.
    pub(crate) fn of(space: &NativeSpace, weights: &[Vec<f64>]) -> Self {
        let coefficients = space.coefficients(weights);
        let mut function = Self::zero(space.kernel().clone(), weights.len());
        for (xi, row) in space.centers().points().zip(coefficients.row_iter()) {
            function.add(xi, row.transpose().as_slice());
        }
        function
    }

    /// Π_N f.
    pub(crate) fn projected(space: &NativeSpace, f: &Self) -> Self {
        Self::of(space, &projection(space, f))
    }

    /// E_y* a = 𝒦(y,·) a: the adjoint of the evaluation at `y` (d numbers), applied to `a` (m numbers).
    pub(crate) fn evaluation_adjoint(kernel: ScaledKernel, y: &[f64], a: &[f64]) -> Self {
        Self { kernel, n_outputs: a.len(), terms: vec![(y.to_vec(), a.to_vec())] }
    }

    /// Adds 𝒦(z,·) a.
    ///
    /// # Panics
    /// Where `a` has not m entries.
    pub(crate) fn add(&mut self, z: &[f64], a: &[f64]) {
        assert_eq!(a.len(), self.n_outputs, "one coefficient per component");
        self.terms.push((z.to_vec(), a.to_vec()));
    }

    /// The number of kernels.
    pub(crate) fn n_terms(&self) -> usize {
        self.terms.len()
    }

    /// E_y f = f(y), m numbers.
    pub(crate) fn value(&self, y: &[f64]) -> Vec<f64> {
        let mut value = vec![0.0; self.n_outputs];
        for (z, a) in &self.terms {
            let k = self.kernel.value(z, y);
            value.iter_mut().zip(a).for_each(|(sum, a)| *sum += k * a);
        }
        value
    }

    /// self − other, both of the same kernel.
    pub(crate) fn minus(&self, other: &Self) -> Self {
        let negative = |(z, a): &(Vec<f64>, Vec<f64>)| (z.clone(), a.iter().map(|a| -a).collect());
        let mut difference = self.clone();
        difference.terms.extend(other.terms.iter().map(negative));
        difference
    }

    /// The function with every coefficient multiplied by a matrix: `y ↦ G f(y)`.
    pub(crate) fn transformed(&self, matrix: &DMatrix<f64>) -> Self {
        let apply = |(z, a): &(Vec<f64>, Vec<f64>)| {
            (z.clone(), (matrix * nalgebra::DVector::from_column_slice(a)).as_slice().to_vec())
        };
        Self {
            kernel: self.kernel.clone(),
            n_outputs: matrix.nrows(),
            terms: self.terms.iter().map(apply).collect(),
        }
    }

    /// ⟨self, other⟩_H = Σ_ij 𝔎(z_i, w_j) a_iᵀ b_j.
    ///
    /// # Cost
    /// The product of the numbers of kernels.
    pub(crate) fn inner_product(&self, other: &Self) -> f64 {
        let aligned = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let terms = self
            .terms
            .iter()
            .flat_map(|(z, a)| other.terms.iter().map(move |(w, b)| self.kernel.value(z, w) * aligned(a, b)));
        terms.sum()
    }

    /// ‖f‖_H.
    pub(crate) fn norm(&self) -> f64 {
        self.inner_product(self).max(0.0).sqrt()
    }
}

/// Π_N f, as weights.
pub(crate) fn projection(space: &NativeSpace, f: &NativeFunction) -> Vec<Vec<f64>> {
    let values: Vec<_> = space.centers().points().map(|xi| f.value(xi)).collect();
    let columns = values.first().map_or(0, |value| value.len());
    space.weights_of_nodal_values(&DMatrix::from_fn(values.len(), columns, |i, j| values[i][j]))
}
