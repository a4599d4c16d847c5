//! The finite-dimensional native space H_N: centers, Gram matrix, and orthonormal (Newton) features.
//!
//! With K = R Rᵀ, the features φ(y) = R⁻¹ k(y) are an orthonormal basis of H_N. One function f̂_N of H_N has
//! three coordinates, each N×m, that say the same:
//!
//! | symbol | name | f̂_N(y) | ‖f̂_N‖²_H |
//! |---|---|---|---|
//! | α̂ | `coefficients` | α̂ᵀ k(y) | tr α̂ᵀ K α̂ |
//! | β = K α̂ | `nodal_values` | βᵀ K⁻¹ k(y) | tr βᵀ K⁻¹ β |
//! | θ = Rᵀ α̂ | `weights` | θᵀ φ(y) | ‖θ‖²_F |
//!
//! α̂ is the paper's (§V-B); a step of the law is cheapest in θ.

use crate::box_search::{Supremum, supremum_over_box};
use crate::centers::weighted_distance;
use crate::cholesky::{self, largest_eigenvalue, times, transposed_times};
use crate::kernel::RadialFunction;
use crate::lanes::{VectorLoop, VectorUnit, multiply_add, whole_lanes};
use crate::packed_factor::{POINTS, PackedFactor, Product, SquaresOfProducts};
use crate::{Centers, DesignError, Kernel, NativeFunction, Parameter};
use nalgebra::DMatrix;
use pulp::Simd;

/// ℓ: how far from a center its knowledge reaches, in the output's unit.
#[derive(Debug, Clone, PartialEq)]
pub enum LengthScale {
    /// One for all axes.
    Isotropic(f64),
    /// One for each axis.
    PerAxis(Vec<f64>),
}

impl LengthScale {
    fn inverses(&self, dimension: usize) -> Result<Vec<f64>, DesignError> {
        let scales = match self {
            Self::Isotropic(scale) => vec![*scale; dimension],
            Self::PerAxis(scales) => scales.clone(),
        };
        let positive = scales.iter().all(|scale| scale.is_finite() && *scale > 0.0);
        if scales.len() != dimension || !positive {
            let needed = format!("a finite number > 0, or one for each of the {dimension} axes");
            return Err(DesignError::new(Parameter::LengthScale, format!("{scales:?}"), needed));
        }
        Ok(scales.iter().map(|scale| scale.recip()).collect())
    }

    /// The same shape, `factor` times as long.
    pub fn scaled(&self, factor: f64) -> Self {
        match self {
            Self::Isotropic(scale) => Self::Isotropic(scale * factor),
            Self::PerAxis(scales) => Self::PerAxis(scales.iter().map(|scale| scale * factor).collect()),
        }
    }
}

/// 𝔎: a radial kernel with its length scales, `𝔎(y, ξ) = κ(√Σ_i ((y_i − ξ_i)/ℓ_i)²)`.
///
/// # Source
/// Niu et al., §II (Mercer kernel); the length scales are ours, the paper has ℓ = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaledKernel {
    radial: RadialFunction,
    inverse_length_scales: Vec<f64>,
}

impl ScaledKernel {
    /// `kernel` on ℝ^`dimension` with these length scales.
    ///
    /// # Errors
    /// `Kernel` where it is not positive definite there, `LengthScale` where one is not a finite number > 0 or
    /// there is not one for each axis.
    pub fn new(kernel: Kernel, length_scale: &LengthScale, dimension: usize) -> Result<Self, DesignError> {
        Ok(Self {
            radial: kernel.radial(dimension)?,
            inverse_length_scales: length_scale.inverses(dimension)?,
        })
    }

    /// 1/ℓ, one for each axis.
    pub(crate) fn inverse_length_scales(&self) -> &[f64] {
        &self.inverse_length_scales
    }

    /// κ.
    pub(crate) fn radial(&self) -> &RadialFunction {
        &self.radial
    }

    /// 𝔎(a, b), dimensionless.
    pub fn value(&self, a: &[f64], b: &[f64]) -> f64 {
        self.radial.value(weighted_distance(a, b, &self.inverse_length_scales))
    }

    /// κ(0).
    pub fn value_at_zero(&self) -> f64 {
        self.radial.value_at_zero()
    }
}

/// Factoring more takes minutes, and 8 N² bytes.
const MOST_CENTERS: usize = 20_000;

/// H_N = span {𝒦(ξ_j,·) a}: a kernel on N centers, factored once.
///
/// # Source
/// Niu et al., §II, eqs. (kernel matrix), (Grammian matrix), (power function).
#[derive(Debug, Clone)]
pub struct NativeSpace {
    kernel: ScaledKernel,
    value_at_zero: f64,
    centers: Centers,
    bounding_box: (Vec<f64>, Vec<f64>),
    /// Coordinates of the centers over their length scales: one run per axis, of whole lanes.
    scaled_coordinates: Vec<Vec<f64>>,
    /// R⁻¹.
    inverse_factor: PackedFactor,
    gram_condition: f64,
    unit: VectorUnit,
}

impl NativeSpace {
    /// Builds K, factors it and inverts the factor.
    ///
    /// `nugget` ≥ 0 is added to K's diagonal as a multiple of κ(0); 0 is the paper's law. With a nugget, read
    /// K + nugget κ(0) I for K in the coordinates above.
    ///
    /// # Errors
    /// `Kernel`, `LengthScale` or `Nugget` out of range; `Centers` where K is not numerically positive
    /// definite, naming the closest pair of centers, the condition estimate and what to change.
    ///
    /// # Cost
    /// N³/3 multiply-adds, once: seconds at N = 4096. N² numbers while it works, of which N(N+1)/2 stay beside it at its
    /// end: at N = 8000, 512 MB and 256 MB.
    pub fn new(
        kernel: Kernel,
        length_scale: &LengthScale,
        centers: Centers,
        nugget: f64,
    ) -> Result<Self, DesignError> {
        let kernel = ScaledKernel::new(kernel, length_scale, centers.dimension())?;
        if !(nugget.is_finite() && nugget >= 0.0) {
            return Err(DesignError::new(Parameter::Nugget, nugget.to_string(), "a finite number ≥ 0"));
        }
        let n = centers.n_centers();
        if n > MOST_CENTERS {
            let found = format!("{n} centers, whose Gram matrix takes {:.0} GB", 8e-9 * (n as f64).powi(2));
            return Err(DesignError::new(Parameter::Centers, found, format!("at most {MOST_CENTERS}")));
        }
        let axis_run = |(axis, scale): (usize, &f64)| {
            let mut run: Vec<f64> = centers.points().map(|p| p[axis] * scale).collect();
            run.resize(whole_lanes(n), 0.0);
            run
        };
        let mut space = Self {
            scaled_coordinates: kernel.inverse_length_scales.iter().enumerate().map(axis_run).collect(),
            value_at_zero: kernel.value_at_zero(),
            kernel,
            bounding_box: centers.bounding_box(),
            inverse_factor: PackedFactor::new(&DMatrix::zeros(0, 0)),
            gram_condition: f64::INFINITY,
            unit: VectorUnit::of_this_machine(),
            centers,
        };
        let mut factor = space.lower_gram();
        for i in 0..n {
            factor[(i, i)] += nugget * space.value_at_zero;
        }
        // A pivot of the size of the rounding errors of the ones before it carries no information.
        let smallest_pivot = (n as f64 * f64::EPSILON * space.value_at_zero).sqrt();
        let is_factored = cholesky::factor(&mut factor).is_some();
        if !(is_factored && factor.diagonal().iter().all(|&pivot| pivot > smallest_pivot)) {
            return Err(space.not_positive_definite());
        }
        let largest = largest_eigenvalue(n, |x| times(&factor, &transposed_times(&factor, x)));
        cholesky::invert(&mut factor);
        let smallest = largest_eigenvalue(n, |x| transposed_times(&factor, &times(&factor, x))).recip();
        space.gram_condition = largest / smallest;
        space.inverse_factor = PackedFactor::new(&factor);
        Ok(space)
    }

    fn not_positive_definite(&self) -> DesignError {
        let (n, gram) = (self.n_centers(), self.gram());
        let condition = largest_eigenvalue(n, |x| &gram * x) / (n as f64 * f64::EPSILON * self.value_at_zero);
        let pair = match self.centers.closest_pair(&self.kernel.inverse_length_scales) {
            Some((a, b, distance)) => {
                format!("the closest pair, centers {a} and {b}, is {distance:.3e} length scales apart")
            }
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

    /// K: `K_ij = 𝔎(ξ_i, ξ_j)`, N×N, without nugget. The paper's Gram matrix 𝕂 of the vector-valued kernel is
    /// K ⊗ I_m.
    pub fn gram(&self) -> DMatrix<f64> {
        let mut gram = self.lower_gram();
        gram.fill_upper_triangle_with_lower_triangle();
        gram
    }

    /// The lower triangle of K, with zeros above.
    fn lower_gram(&self) -> DMatrix<f64> {
        let points: Vec<_> = self.centers.points().collect();
        let mut gram = DMatrix::zeros(points.len(), points.len());
        for (j, mut column) in gram.column_iter_mut().enumerate() {
            for (entry, xi) in column.iter_mut().zip(&points).skip(j) {
                *entry = self.kernel.value(xi, points[j]);
            }
        }
        gram
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
    pub fn bounding_box(&self) -> (&[f64], &[f64]) {
        (&self.bounding_box.0, &self.bounding_box.1)
    }

    /// 𝔎.
    pub fn kernel(&self) -> &ScaledKernel {
        &self.kernel
    }

    /// κ(0).
    pub fn value_at_zero(&self) -> f64 {
        self.value_at_zero
    }

    /// The spectral condition number of K, to about 1e-6 of itself.
    pub fn gram_condition(&self) -> f64 {
        self.gram_condition
    }

    /// N rounded up to whole lanes: the length of all vectors that a step works on. What is beyond N is 0.
    pub fn n_padded(&self) -> usize {
        whole_lanes(self.n_centers())
    }

    /// k(y): `k_j = 𝔎(ξ_j, y)`, N values for the d numbers of `y`.
    pub fn kernel_vector(&self, y: &[f64]) -> Vec<f64> {
        let mut buffers = FeatureBuffers::new(self);
        self.features(y, &mut buffers);
        buffers.kernel_vector[..self.n_centers()].to_vec()
    }

    /// φ(y) = R⁻¹ k(y) into `buffers`, and φᵀφ. No allocation.
    ///
    /// # Cost
    /// N(N+1)/2 multiply-adds and N kernel values.
    pub fn features(&self, y: &[f64], buffers: &mut FeatureBuffers) -> f64 {
        self.unit.run(Features { space: self, y, buffers })
    }

    pub(crate) fn unit(&self) -> VectorUnit {
        self.unit
    }

    /// P_N(y) = √(κ(0) − φᵀφ), from φᵀφ: how badly the centers cover y; √κ(0) where they cover nothing, 0 at a
    /// center (there the difference is rounding noise).
    ///
    /// # Source
    /// Niu et al., eq. (power function): with 𝒦 = 𝔎 I_m all m entries of its maximum are the same.
    pub fn power_function(&self, squared_features: f64) -> f64 {
        let square = self.value_at_zero - squared_features;
        if square > 16.0 * f64::EPSILON * self.value_at_zero { square.sqrt() } else { 0.0 }
    }

    /// P_N(y).
    pub fn power_function_at(&self, y: &[f64]) -> f64 {
        self.power_function(self.features(y, &mut FeatureBuffers::new(self)))
    }

    /// sup P_N over the box of the centers.
    ///
    /// The value found by a search, and a bound that no point exceeds: P_N(y) is the distance of 𝔎(y,·) from
    /// H_N, hence `|P_N(y) − P_N(z)| ≤ ‖𝔎(y,·) − 𝔎(z,·)‖ = √(2κ(0) − 2𝔎(y, z))`. Over all of ℝ^d, as the paper
    /// prints it, the supremum is always √κ(0): no finite set of centers covers an unbounded space.
    ///
    /// # Cost
    /// Some hundred to some ten thousand evaluations of the features: for reports.
    pub fn sup_power_function(&self) -> Supremum {
        let n = self.n_centers();
        let mut buffers = FeatureBuffers::new(self);
        let mut kernel_vectors = vec![[0.0; POINTS]; self.n_padded()];
        let mut power_functions = |points: &[Vec<f64>]| -> Vec<f64> {
            for (p, y) in points.iter().enumerate() {
                self.unit.run(KernelVector { space: self, y, kernel_vector: &mut buffers.kernel_vector });
                kernel_vectors.iter_mut().zip(&buffers.kernel_vector).for_each(|(all, &one)| all[p] = one);
            }
            let factor = &self.inverse_factor;
            let squares = self.unit.run(SquaresOfProducts { factor, x: &kernel_vectors });
            squares[..points.len()].iter().map(|&squares| self.power_function(squares)).collect()
        };
        let found = self.search(
            |rho| (2.0 * (self.value_at_zero - self.kernel.radial.value(rho))).max(0.0).sqrt(),
            n * n,
            |points| points.chunks(POINTS).flat_map(&mut power_functions).collect(),
        );
        // Nowhere is it more than far from all centers.
        Supremum { upper_bound: found.upper_bound.min(self.value_at_zero.sqrt()), ..found }
    }

    /// The fill distance `h = sup_y min_j |y − ξ_j|` over the box of the centers, in length scales.
    pub fn fill_distance(&self) -> Supremum {
        let mut buffers = FeatureBuffers::new(self);
        let mut nearest = |y: &Vec<f64>| {
            let squares = &mut buffers.kernel_vector;
            self.unit.run(SquaredDistances { space: self, y, squares });
            least(&squares[..self.n_centers()]).sqrt()
        };
        self.search(|rho| rho, self.n_centers(), |points| points.iter().map(&mut nearest).collect())
    }

    /// The separation distance `q = ½ min_{i≠j} |ξ_i − ξ_j|`, in length scales; `None` for a single center.
    pub fn separation(&self) -> Option<f64> {
        self.centers.closest_pair(&self.kernel.inverse_length_scales).map(|(_, _, distance)| 0.5 * distance)
    }

    fn search(
        &self,
        modulus: impl Fn(f64) -> f64,
        cost: usize,
        values: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> Supremum {
        // Half a second or so on a slow core up to N = 1000; beyond, the power function takes as N²: seconds at 4096.
        let most_evaluations = (400_000_000 / cost.max(1)).clamp(1000, 100_000);
        supremum_over_box(
            self.bounding_box(),
            &self.kernel.inverse_length_scales,
            modulus,
            most_evaluations,
            values,
        )
    }

    /// α̂ = R⁻ᵀ θ, N×m, of the function with these weights (m runs of N, or of whole lanes).
    pub fn coefficients(&self, weights: &[Vec<f64>]) -> DMatrix<f64> {
        let n = self.n_centers();
        let entry = |i: usize, j: usize| self.inverse_factor.entry(i, j);
        DMatrix::from_fn(n, weights.len(), |j, column| (j..n).map(|i| entry(i, j) * weights[column][i]).sum())
    }

    /// β = R θ, N×m, of the function with these weights: the values of f̂_N at the centers.
    pub fn nodal_values(&self, weights: &[Vec<f64>]) -> DMatrix<f64> {
        let n = self.n_centers();
        let entry = |i: usize, j: usize| self.inverse_factor.entry(i, j);
        let mut values = DMatrix::zeros(n, weights.len());
        for (theta, mut beta) in weights.iter().zip(values.column_iter_mut()) {
            // R⁻¹ β = θ, forward.
            for i in 0..n {
                let known: f64 = (0..i).map(|j| entry(i, j) * beta[j]).sum();
                beta[i] = (theta[i] - known) / entry(i, i);
            }
        }
        values
    }

    /// θ = R⁻¹ β, m runs of N, of the function of H_N with these values at the centers (N×m): the projection
    /// Π_N f of every f of H with these values.
    ///
    /// # Source
    /// Niu et al., §II: ⟨f − Π_N f, 𝒦(ξ_j,·) a⟩ = 0 for all j says that both agree at the centers.
    pub fn weights_of_nodal_values(&self, values: &DMatrix<f64>) -> Vec<Vec<f64>> {
        let n = self.n_centers();
        let row = |i: usize, beta: &[f64]| (0..=i).map(|j| self.inverse_factor.entry(i, j) * beta[j]).sum();
        values.column_iter().map(|beta| (0..n).map(|i| row(i, beta.as_slice())).collect()).collect()
    }

    /// Π_N f, as weights.
    pub fn projection(&self, f: &NativeFunction) -> Vec<Vec<f64>> {
        let values: Vec<_> = self.centers.points().map(|xi| f.value(xi)).collect();
        let columns = values.first().map_or(0, |value| value.len());
        self.weights_of_nodal_values(&DMatrix::from_fn(values.len(), columns, |i, j| values[i][j]))
    }

    /// The function with these weights, as an element of H.
    pub fn function(&self, weights: &[Vec<f64>]) -> NativeFunction {
        let coefficients = self.coefficients(weights);
        let mut function = NativeFunction::zero(self.kernel.clone(), weights.len());
        for (xi, row) in self.centers.points().zip(coefficients.row_iter()) {
            function.add(xi, row.transpose().as_slice());
        }
        function
    }

    /// Bytes that every step reads: the packed factor and the centers.
    pub fn bytes(&self) -> usize {
        self.inverse_factor.bytes() + 8 * self.scaled_coordinates.len() * self.n_padded()
    }
}

/// What one evaluation of the features works in.
#[derive(Debug, Clone)]
pub struct FeatureBuffers {
    kernel_vector: Vec<f64>,
    features: Vec<f64>,
}

impl FeatureBuffers {
    /// Buffers for a space.
    pub fn new(space: &NativeSpace) -> Self {
        let n = space.n_padded();
        Self { kernel_vector: vec![0.0; n], features: vec![0.0; n] }
    }

    /// φ of the newest evaluation, of whole lanes.
    pub fn features(&self) -> &[f64] {
        &self.features
    }
}

/// |y − ξ_j|² of all centers, in length scales; beyond N they mean nothing.
struct SquaredDistances<'a> {
    space: &'a NativeSpace,
    y: &'a [f64],
    squares: &'a mut [f64],
}

impl VectorLoop for SquaredDistances<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, _: S) {
        let Self { space, y, squares } = self;
        squares.fill(0.0);
        let axes = space.scaled_coordinates.iter().zip(&space.kernel.inverse_length_scales);
        for ((coordinates, scale), y) in axes.zip(y) {
            let y = y * scale;
            for (square, x) in squares.iter_mut().zip(coordinates) {
                let distance = x - y;
                *square = multiply_add::<S>(distance, distance, *square);
            }
        }
    }
}

/// k(y); what is beyond N meets zeros of the factor.
struct KernelVector<'a> {
    space: &'a NativeSpace,
    y: &'a [f64],
    kernel_vector: &'a mut [f64],
}

impl VectorLoop for KernelVector<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { space, y, kernel_vector } = self;
        SquaredDistances { space, y, squares: kernel_vector }.call(simd);
        space.kernel.radial.replace_squares::<S>(kernel_vector);
    }
}

/// k(y), φ = R⁻¹ k(y) and φᵀφ in one go.
struct Features<'a> {
    space: &'a NativeSpace,
    y: &'a [f64],
    buffers: &'a mut FeatureBuffers,
}

impl VectorLoop for Features<'_> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        let Self { space, y, buffers } = self;
        let FeatureBuffers { kernel_vector, features } = buffers;
        KernelVector { space, y, kernel_vector }.call(simd);
        let product = Product { factor: &space.inverse_factor, x: kernel_vector, product: features };
        product.call(simd)
    }
}

/// The smallest of some numbers, eight at a time.
fn least(numbers: &[f64]) -> f64 {
    let (eights, rest) = numbers.as_chunks::<8>();
    let mut least = [f64::INFINITY; 8];
    for eight in eights {
        least.iter_mut().zip(eight).for_each(|(least, &x)| *least = if x < *least { x } else { *least });
    }
    least.iter().chain(rest).fold(f64::INFINITY, |least, &x| least.min(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNEL: Kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };

    fn paper() -> NativeSpace {
        let centers = Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap();
        NativeSpace::new(KERNEL, &LengthScale::Isotropic(1.0), centers, 0.0).unwrap()
    }

    fn features(space: &NativeSpace, y: [f64; 3]) -> (Vec<f64>, f64) {
        let mut buffers = FeatureBuffers::new(space);
        let squares = space.features(&y, &mut buffers);
        (buffers.features().to_vec(), squares)
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
            let (phi, squares) = features(&space, y);
            let k = DMatrix::from_vec(27, 1, space.kernel_vector(&y));
            let expected = k.dot(&gram.clone().lu().solve(&k).unwrap());
            assert!((squares - expected).abs() < 1e-12, "{y:?}");
            assert!((phi.iter().map(|x| x * x).sum::<f64>() - expected).abs() < 1e-12, "{y:?}");
        }
    }

    /// The power function vanishes at a center and nears √κ(0) far away.
    #[test]
    fn the_power_function_measures_cover() {
        let space = paper();
        let power = |y: [f64; 3]| space.power_function(features(&space, y).1);
        assert!(power([1.0, 0.0, -1.0]) < 1e-6);
        assert!((power([60.0, 0.0, 0.0]) - space.value_at_zero().sqrt()).abs() < 1e-12);
        // Its supremum over the lattice's box, at the middle of a cell: 0.443.
        assert!((power([0.5, 0.5, 0.5]) - 0.443).abs() < 5e-4, "{}", power([0.5; 3]));
    }

    #[test]
    fn equal_or_nearly_equal_centers_are_refused_by_name() {
        for gap in [0.0, 1e-12] {
            let centers = Centers::listed([[0.0; 3], [1.0, 0.0, 0.0], [1.0, gap, 0.0]]).unwrap();
            let error =
                NativeSpace::new(KERNEL, &LengthScale::Isotropic(1.0), centers, 0.0).unwrap_err().to_string();
            assert!(error.contains("centers 2 and 3"), "{error}");
        }
        let centers = Centers::listed([[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]).unwrap();
        assert!(
            NativeSpace::new(KERNEL, &LengthScale::Isotropic(1.0), centers, 1e-8).is_ok(),
            "a nugget helps"
        );
    }
}
