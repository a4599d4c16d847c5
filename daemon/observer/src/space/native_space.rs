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

use crate::report::box_search::{Supremum, supremum_over_box};
use crate::space::centers::weighted_distance;
use crate::space::factors::cholesky::{self, largest_eigenvalue};
use crate::space::factors::lanes::{VectorLoop, VectorUnit, multiply_add, whole_lanes};
use crate::space::factors::mirrored::{MirroredFactor, MirroredLattice, MirroredProduct};
use crate::space::factors::packed::{POINTS, PackedFactor, Product, SquaresOfProducts};
use crate::space::kernel::RadialFunction;
use crate::{Centers, DesignError, Kernel, Parameter};
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

/// R⁻¹.
#[derive(Debug, Clone)]
enum InverseFactor {
    /// Of K.
    Whole(PackedFactor),
    /// Of a lattice's K in sums and differences of mirror images: the same H_N in another orthonormal basis.
    Mirrored(MirroredFactor),
}

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
    /// Coordinates of the centers over their length scales, in the factor's order: one run per axis, filled up to whole
    /// lanes with centers that are there already.
    scaled_coordinates: Vec<Vec<f64>>,
    inverse_factor: InverseFactor,
    gram_condition: f64,
    unit: VectorUnit,
}

impl NativeSpace {
    /// Builds K, factors it and inverts the factor. Of a lattice with several points along one, two or three axes K falls
    /// apart into eight blocks (four, two), which are used where a step is clearly faster with them.
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
    /// end: at N = 8000, 512 MB and 256 MB. In eight blocks, N³/192 multiply-adds, and 1/8 of the numbers that stay.
    pub fn new(
        kernel: Kernel,
        length_scale: &LengthScale,
        centers: Centers,
        nugget: f64,
    ) -> Result<Self, DesignError> {
        Self::with_mirrors_where(kernel, length_scale, centers, nugget, MirroredLattice::pays)
    }

    fn with_mirrors_where(
        kernel: Kernel,
        length_scale: &LengthScale,
        centers: Centers,
        nugget: f64,
        pays: impl Fn(&MirroredLattice) -> bool,
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
        let mut space = Self {
            scaled_coordinates: Vec::new(),
            value_at_zero: kernel.value_at_zero(),
            kernel,
            bounding_box: centers.bounding_box(),
            inverse_factor: InverseFactor::Whole(PackedFactor::new(&DMatrix::zeros(0, 0))),
            gram_condition: f64::INFINITY,
            unit: VectorUnit::of_this_machine(),
            centers,
        };
        let lattice = MirroredLattice::of(&space.centers, &space.kernel.inverse_length_scales);
        match lattice.filter(pays) {
            Some(lattice) => space.factor_mirrored(&lattice, nugget)?,
            None => space.factor_whole(nugget)?,
        }
        space.scaled_coordinates = space.coordinates_in_order();
        Ok(space)
    }

    fn factor_whole(&mut self, nugget: f64) -> Result<(), DesignError> {
        let n = self.n_centers();
        let mut factor = self.lower_gram();
        for i in 0..n {
            factor[(i, i)] += nugget * self.value_at_zero;
        }
        if cholesky::factor_regular(&mut factor).is_none() {
            let gram = self.gram();
            return Err(self.not_positive_definite(largest_eigenvalue(n, |x| &gram * x)));
        }
        let (smallest, largest) = cholesky::invert_and_bound(&mut factor);
        self.gram_condition = largest / smallest;
        self.inverse_factor = InverseFactor::Whole(PackedFactor::new(&factor));
        Ok(())
    }

    fn factor_mirrored(&mut self, lattice: &MirroredLattice, nugget: f64) -> Result<(), DesignError> {
        let (factor, condition) = lattice
            .factor(&self.kernel.radial, nugget)
            .map_err(|largest_eigenvalue| self.not_positive_definite(largest_eigenvalue))?;
        self.gram_condition = condition;
        self.inverse_factor = InverseFactor::Mirrored(factor);
        Ok(())
    }

    fn coordinates_in_order(&self) -> Vec<Vec<f64>> {
        let n = self.n_centers();
        let order: Vec<usize> = match &self.inverse_factor {
            InverseFactor::Whole(_) => (0..whole_lanes(n)).map(|i| i.min(n - 1)).collect(),
            InverseFactor::Mirrored(factor) => factor.centers().iter().map(|&i| i as usize).collect(),
        };
        let points: Vec<_> = self.centers.points().collect();
        let scales = self.kernel.inverse_length_scales.iter().enumerate();
        scales.map(|(axis, scale)| order.iter().map(|&i| points[i][axis] * scale).collect()).collect()
    }

    fn not_positive_definite(&self, largest_eigenvalue: f64) -> DesignError {
        let n = self.n_centers();
        let condition = largest_eigenvalue / (n as f64 * f64::EPSILON * self.value_at_zero);
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

    /// The length of φ and θ: N rounded up to whole lanes, in mirror images once for each symmetry. The entries that are
    /// more than N are 0.
    pub fn n_padded(&self) -> usize {
        match &self.inverse_factor {
            InverseFactor::Whole(_) => whole_lanes(self.n_centers()),
            InverseFactor::Mirrored(factor) => factor.n_features(),
        }
    }

    /// The length of a kernel vector, in the factor's order.
    fn n_places(&self) -> usize {
        self.scaled_coordinates.first().map_or(0, Vec::len)
    }

    /// k(y): `k_j = 𝔎(ξ_j, y)`, N values for the d numbers of `y`.
    pub fn kernel_vector(&self, y: &[f64]) -> Vec<f64> {
        let mut in_order = vec![0.0; self.n_places()];
        self.unit.run(KernelVector { space: self, y, kernel_vector: &mut in_order });
        let mut kernel_vector = vec![0.0; self.n_centers()];
        match &self.inverse_factor {
            InverseFactor::Whole(_) => kernel_vector.copy_from_slice(&in_order[..self.n_centers()]),
            InverseFactor::Mirrored(factor) => {
                for (&center, &k) in factor.centers().iter().zip(&in_order) {
                    kernel_vector[center as usize] = k;
                }
            }
        }
        kernel_vector
    }

    /// φ(y) = R⁻¹ k(y) into `buffers`, and φᵀφ. No allocation.
    ///
    /// # Cost
    /// N(N+1)/2 multiply-adds and N kernel values; in mirror images an eighth of the multiply-adds (a quarter, a half).
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
        let mut kernel_vectors = vec![[0.0; POINTS]; self.n_places()];
        let mut power_functions = |points: &[Vec<f64>]| -> Vec<f64> {
            match &self.inverse_factor {
                InverseFactor::Whole(factor) => {
                    for (p, y) in points.iter().enumerate() {
                        let kernel_vector = &mut buffers.kernel_vector;
                        self.unit.run(KernelVector { space: self, y, kernel_vector });
                        let both = kernel_vectors.iter_mut().zip(&buffers.kernel_vector);
                        both.for_each(|(all, &one)| all[p] = one);
                    }
                    let squares = self.unit.run(SquaresOfProducts { factor, x: &kernel_vectors });
                    squares[..points.len()].iter().map(|&squares| self.power_function(squares)).collect()
                }
                InverseFactor::Mirrored(_) => {
                    let squares = points.iter().map(|y| self.features(y, &mut buffers));
                    squares.map(|squares| self.power_function(squares)).collect()
                }
            }
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
            least(squares).sqrt()
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

    /// α̂ = R⁻ᵀ θ, N×m, of the function with these weights (m runs, as long as φ).
    pub fn coefficients(&self, weights: &[Vec<f64>]) -> DMatrix<f64> {
        self.by_column(weights.len(), |column| match &self.inverse_factor {
            InverseFactor::Whole(factor) => factor.transposed_times(&weights[column][..self.n_centers()]),
            InverseFactor::Mirrored(factor) => factor.coefficients(&weights[column]),
        })
    }

    /// β = R θ, N×m, of the function with these weights: the values of f̂_N at the centers.
    pub fn nodal_values(&self, weights: &[Vec<f64>]) -> DMatrix<f64> {
        self.by_column(weights.len(), |column| match &self.inverse_factor {
            InverseFactor::Whole(factor) => factor.solve(&weights[column][..self.n_centers()]),
            InverseFactor::Mirrored(factor) => factor.nodal_values(&weights[column]),
        })
    }

    fn by_column(&self, columns: usize, column: impl FnMut(usize) -> Vec<f64>) -> DMatrix<f64> {
        let entries = (0..columns).flat_map(column);
        DMatrix::from_iterator(self.n_centers(), columns, entries)
    }

    /// θ = R⁻¹ β, m runs as long as φ, of the function of H_N with these values at the centers (N×m): the projection
    /// Π_N f of every f of H with these values.
    ///
    /// # Source
    /// Niu et al., §II: ⟨f − Π_N f, 𝒦(ξ_j,·) a⟩ = 0 for all j says that both agree at the centers.
    pub fn weights_of_nodal_values(&self, values: &DMatrix<f64>) -> Vec<Vec<f64>> {
        let weights_of = |beta: &[f64]| {
            let mut x = vec![0.0; self.n_places()];
            match &self.inverse_factor {
                InverseFactor::Whole(_) => x[..beta.len()].copy_from_slice(beta),
                InverseFactor::Mirrored(factor) => {
                    x.iter_mut().zip(factor.centers()).for_each(|(x, &center)| *x = beta[center as usize]);
                }
            }
            let mut weights = vec![0.0; self.n_padded()];
            self.unit.run(Basis { space: self, x: &mut x, product: &mut weights });
            weights
        };
        values.column_iter().map(|beta| weights_of(beta.as_slice())).collect()
    }

    /// Bytes that every step reads: the packed factor and the centers.
    pub fn bytes(&self) -> usize {
        let factor = match &self.inverse_factor {
            InverseFactor::Whole(factor) => factor.bytes(),
            InverseFactor::Mirrored(factor) => factor.bytes(),
        };
        factor + 8 * self.scaled_coordinates.len() * self.n_places()
    }
}

/// What one evaluation of the features works in.
#[derive(Debug, Clone)]
pub struct FeatureBuffers {
    /// k, in the factor's order; afterwards what the factor made of it.
    kernel_vector: Vec<f64>,
    features: Vec<f64>,
}

impl FeatureBuffers {
    /// Buffers for a space.
    pub fn new(space: &NativeSpace) -> Self {
        Self { kernel_vector: vec![0.0; space.n_places()], features: vec![0.0; space.n_padded()] }
    }

    /// φ of the newest evaluation, of whole lanes.
    pub fn features(&self) -> &[f64] {
        &self.features
    }
}

/// |y − ξ_j|² of all centers, in length scales and in the factor's order.
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

/// k(y), in the factor's order; what fills up lanes meets zeros of the factor.
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
        Basis { space, x: kernel_vector, product: features }.call(simd)
    }
}

/// R⁻¹ x and its square, of x in the factor's order, which is overwritten.
struct Basis<'a> {
    space: &'a NativeSpace,
    x: &'a mut [f64],
    product: &'a mut [f64],
}

impl VectorLoop for Basis<'_> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        let Self { space, x, product } = self;
        match &space.inverse_factor {
            InverseFactor::Whole(factor) => Product { factor, x, product }.call(simd),
            InverseFactor::Mirrored(factor) => MirroredProduct { factor, x, product }.call(simd),
        }
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
    use crate::function::dense::DenseFunction;
    use nalgebra::Vector3;

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

    /// Lattices of one, two and three axes with several points, even and odd; kernels and nuggets.
    fn mirrored_cases() -> Vec<(Kernel, LengthScale, Centers, f64)> {
        let three =
            |per_axis: [usize; 3]| Centers::lattice([-1.0, 0.5, -2.0], [1.0, 2.0, 2.5], per_axis).unwrap();
        let per_axis = || LengthScale::PerAxis(vec![0.4, 0.3, 0.8]);
        let matern = |dimension, order| Kernel::SobolevMatern { dimension, order };
        vec![
            (matern(3, 3), per_axis(), three([4; 3]), 0.0),
            (matern(3, 2), per_axis(), three([6, 5, 4]), 0.0),
            (Kernel::WendlandC2, LengthScale::Isotropic(2.0), three([7; 3]), 0.0),
            (Kernel::Gaussian, LengthScale::Isotropic(0.5), three([6, 1, 6]), 1e-6),
            (Kernel::Gaussian, per_axis(), three([3, 5, 2]), 1e-6),
            (
                matern(2, 2),
                LengthScale::PerAxis(vec![0.3, 0.2]),
                Centers::lattice([0.0; 2], [2.0, 1.0], [12, 9]).unwrap(),
                0.0,
            ),
            (matern(1, 2), LengthScale::Isotropic(0.2), Centers::lattice([-1.0], [1.0], [30]).unwrap(), 0.0),
            (
                matern(4, 4),
                LengthScale::Isotropic(1.0),
                Centers::lattice([-1.0; 4], [1.0; 4], [3, 1, 2, 4]).unwrap(),
                1e-8,
            ),
        ]
    }

    fn both_ways(case: &(Kernel, LengthScale, Centers, f64)) -> [NativeSpace; 2] {
        let (kernel, scale, centers, nugget) = case;
        [true, false].map(|is_mirrored| {
            let space =
                NativeSpace::with_mirrors_where(*kernel, scale, centers.clone(), *nugget, |_| is_mirrored);
            let space = space.unwrap();
            assert_eq!(matches!(space.inverse_factor, InverseFactor::Mirrored(_)), is_mirrored);
            space
        })
    }

    /// Points in and around the box, some of them centers.
    fn queries(space: &NativeSpace, n: usize) -> Vec<Vec<f64>> {
        let (lower, upper) = space.bounding_box();
        let anywhere = (0..n).map(|q| {
            let at = |axis: usize| ((q * 7919 + axis * 3571 + 13) % 1009) as f64 / 1009.0;
            let point =
                |axis: usize| lower[axis] + (1.4 * at(axis) - 0.2) * (upper[axis] - lower[axis] + 0.1);
            (0..lower.len()).map(point).collect()
        });
        anywhere.chain(space.centers().points().step_by(17).map(<[f64]>::to_vec)).collect()
    }

    /// φᵀφ and all coordinates against nalgebra's LU of the whole Gram matrix.
    #[test]
    fn in_mirror_images_it_is_the_same_native_space() {
        for case in mirrored_cases() {
            let [space, whole] = both_ways(&case);
            let n = space.n_centers();
            let gram = space.gram() + DMatrix::identity(n, n) * (case.3 * space.value_at_zero());
            let lu = gram.clone().lu();
            let mut buffers = FeatureBuffers::new(&space);
            for y in queries(&space, 20) {
                let k = DMatrix::from_vec(n, 1, space.kernel_vector(&y));
                for (k, xi) in k.iter().zip(space.centers().points()) {
                    assert!((k - space.kernel().value(xi, &y)).abs() < 1e-12, "{case:?}");
                }
                let expected = k.dot(&lu.solve(&k).unwrap());
                let squares = space.features(&y, &mut buffers);
                assert!((squares - expected).abs() < 1e-9, "{case:?}: {squares} {expected}");
                let sum: f64 = buffers.features().iter().map(|phi| phi * phi).sum();
                assert!((squares - sum).abs() < 1e-12 * (1.0 + sum), "{case:?}");
            }
            let beta = DMatrix::from_fn(n, 2, |i, column| ((i * (3 + column)) as f64 * 0.7).sin());
            let alpha = lu.solve(&beta).unwrap();
            let theta = space.weights_of_nodal_values(&beta);
            assert!(theta.iter().all(|theta| theta.len() == space.n_padded()));
            assert!((space.nodal_values(&theta) - &beta).amax() < 1e-9, "{case:?}");
            assert!((space.coefficients(&theta) - &alpha).amax() < 1e-9 * (1.0 + alpha.amax()), "{case:?}");
            let norm = alpha.dot(&(gram * &alpha)).sqrt();
            let found = theta.iter().flatten().map(|theta| theta * theta).sum::<f64>().sqrt();
            assert!((found / norm - 1.0).abs() < 1e-9, "{case:?}: {found} {norm}");
            assert!((space.gram_condition() / whole.gram_condition() - 1.0).abs() < 1e-4, "{case:?}");
            // The search takes thousands of evaluations of both.
            if n > 64 || space.centers().dimension() > 3 {
                continue;
            }
            let (found, expected) = (space.sup_power_function(), whole.sup_power_function());
            assert!((found.value - expected.value).abs() < 1e-6, "{case:?}: {found:?} {expected:?}");
            let (found, expected) = (space.fill_distance(), whole.fill_distance());
            assert!((found.value - expected.value).abs() < 1e-12, "{case:?}: {found:?} {expected:?}");
        }
    }

    #[test]
    fn in_mirror_images_the_same_function_is_learned() {
        for case in mirrored_cases().into_iter().filter(|case| case.2.dimension() <= 3) {
            let [mut mirrored, mut whole] = both_ways(&case).map(DenseFunction::<3>::zero);
            let points = queries(whole.space(), 200);
            for (step, y) in points.iter().enumerate() {
                let increment = Vector3::new(0.3, -0.2, 0.1) * (step as f64).cos();
                for function in [&mut mirrored, &mut whole] {
                    function.hold(y);
                    function.learn(&increment);
                }
            }
            let none = Vector3::zeros();
            let norm = whole.native_norm();
            assert!((mirrored.native_norm() / norm - 1.0).abs() < 1e-9, "{case:?}");
            for y in points.iter().step_by(7) {
                let (found, expected) = (mirrored.at(y, &none).value, whole.at(y, &none).value);
                assert!(
                    (found - expected).amax() < 1e-9 * (1.0 + expected.amax()),
                    "{case:?}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn mirror_images_are_used_where_they_pay() {
        let is_mirrored = |centers: Centers| {
            let scale = LengthScale::Isotropic(0.5);
            let kernel = Kernel::SobolevMatern { dimension: 3, order: 2 };
            let space = NativeSpace::new(kernel, &scale, centers, 0.0).unwrap();
            matches!(space.inverse_factor, InverseFactor::Mirrored(_))
        };
        let lattice = |per_axis: [usize; 3]| Centers::lattice([-1.0; 3], [1.0; 3], per_axis).unwrap();
        for per_axis in [[1; 3], [3; 3], [5, 5, 3], [1, 1, 30]] {
            assert!(!is_mirrored(lattice(per_axis)), "{per_axis:?}");
        }
        for per_axis in [[6; 3], [7; 3], [20, 1, 20]] {
            assert!(is_mirrored(lattice(per_axis)), "{per_axis:?}");
        }
        let listed: Vec<Vec<f64>> = lattice([6; 3]).points().map(<[f64]>::to_vec).collect();
        assert!(!is_mirrored(Centers::listed(listed).unwrap()), "no order of listed centers is known");
    }

    #[test]
    fn a_lattice_too_narrow_is_refused_with_its_closest_pair_as_a_whole_one_is() {
        let centers = Centers::lattice([0.0; 3], [0.2, 1.0, 1.0], [6; 3]).unwrap();
        let scale = LengthScale::Isotropic(2.0);
        let errors = [true, false].map(|is_mirrored| {
            let space =
                NativeSpace::with_mirrors_where(Kernel::Gaussian, &scale, centers.clone(), 0.0, |_| {
                    is_mirrored
                });
            space.unwrap_err().to_string()
        });
        // Which of the pairs that are equally close depends on rounding, and is the same for both.
        assert!(
            errors[0].contains("closest pair, centers ") && errors[0].contains("is 2.000e-2 length scales")
        );
        assert_eq!(errors[0], errors[1], "the condition as well");
    }
}
