//! The finite-dimensional native space H_N: centers, Gram matrix, and orthonormal (Newton) features.
//!
//! With K = R Rᵀ, the features φ(y) = R⁻¹ k(y) are an orthonormal basis of H_N. One function f̂_N of H_N has
//! three sets of coordinates, each N×m:
//!
//! | symbol | name | f̂_N(y) | ‖f̂_N‖²_H |
//! |---|---|---|---|
//! | α̂ | `coefficients` | α̂ᵀ k(y) | tr α̂ᵀ K α̂ |
//! | β = K α̂ | `nodal_values` | βᵀ K⁻¹ k(y) | tr βᵀ K⁻¹ β |
//! | θ = Rᵀ α̂ | `weights` | θᵀ φ(y) | ‖θ‖²_F |
//!
//! α̂ is the paper's (§V-B); a step of the law is cheapest in θ.

use crate::error::{DesignError, Parameter};
use crate::space::centers::Centers;
use crate::space::factors::cholesky::{self, largest_eigenvalue};
use crate::space::factors::lanes::{VectorLoop, VectorUnit, multiply_add, whole_lanes};
use crate::space::factors::mirrored::{MirroredFactor, MirroredLattice, MirroredProduct};
use crate::space::factors::packed::{POINTS, PackedFactor, Product, SquaresOfProducts};
use crate::space::kernel::Kernel;
use crate::space::scaled_kernel::{LengthScale, ScaledKernel};
use nalgebra::DMatrix;
use pulp::Simd;

/// Factoring more takes minutes, and 8 N² bytes.
const MAX_CENTERS: usize = 20_000;

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

    /// The same with the one factor of K, whatever pays: N features, none of them 0.
    pub(crate) fn whole(
        kernel: Kernel,
        length_scale: &LengthScale,
        centers: Centers,
        nugget: f64,
    ) -> Result<Self, DesignError> {
        Self::with_mirrors_where(kernel, length_scale, centers, nugget, |_| false)
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
        if n > MAX_CENTERS {
            let found = format!("{n} centers, whose Gram matrix takes {:.0} GB", 8e-9 * (n as f64).powi(2));
            return Err(DesignError::new(Parameter::Centers, found, format!("at most {MAX_CENTERS}")));
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
        let lattice = MirroredLattice::of(&space.centers, space.kernel.inverse_length_scales());
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
            .factor(self.kernel.radial(), nugget)
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
        let scales = self.kernel.inverse_length_scales().iter().enumerate();
        scales.map(|(axis, scale)| order.iter().map(|&i| points[i][axis] * scale).collect()).collect()
    }

    fn not_positive_definite(&self, largest_eigenvalue: f64) -> DesignError {
        let n = self.n_centers();
        let condition = largest_eigenvalue / (n as f64 * f64::EPSILON * self.value_at_zero);
        let pair = match self.centers.closest_pair(self.kernel.inverse_length_scales()) {
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

    /// P_N at several points: a dense factor is read once for [`POINTS`] of them.
    pub(crate) fn power_functions_at(&self, points: &[Vec<f64>], buffers: &mut FeatureBuffers) -> Vec<f64> {
        let InverseFactor::Whole(factor) = &self.inverse_factor else {
            let squares = points.iter().map(|y| self.features(y, buffers));
            return squares.map(|squares| self.power_function(squares)).collect();
        };
        let mut kernel_vectors = vec![[0.0; POINTS]; self.n_places()];
        let mut power_functions = Vec::with_capacity(points.len());
        for points in points.chunks(POINTS) {
            for (p, y) in points.iter().enumerate() {
                let kernel_vector = &mut buffers.kernel_vector;
                self.unit.run(KernelVector { space: self, y, kernel_vector });
                let both = kernel_vectors.iter_mut().zip(&buffers.kernel_vector);
                both.for_each(|(all, &one)| all[p] = one);
            }
            let squares = self.unit.run(SquaresOfProducts { factor, x: &kernel_vectors });
            power_functions
                .extend(squares[..points.len()].iter().map(|&squares| self.power_function(squares)));
        }
        power_functions
    }

    /// The distance of y from the nearest center, in length scales.
    pub(crate) fn distance_to_nearest_center(&self, y: &[f64], buffers: &mut FeatureBuffers) -> f64 {
        let squares = &mut buffers.kernel_vector;
        self.unit.run(SquaredDistances { space: self, y, squares });
        least(squares).sqrt()
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
        let axes = space.scaled_coordinates.iter().zip(space.kernel.inverse_length_scales());
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
        space.kernel.radial().replace_squares::<S>(kernel_vector);
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
mod tests;
