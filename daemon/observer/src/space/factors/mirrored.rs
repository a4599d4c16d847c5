//! The factor of the Gram matrix of a whole lattice, in sums and differences of mirror images (see [`crate::space::factors::mirror`]).
//!
//! The features of all symmetries, in sequence, are an orthonormal basis, as those of the whole factor are:
//!
//! ```text
//! φ_s = R_s⁻¹ u_s(k),    φᵀφ = Σ_s φ_sᵀ φ_s = kᵀ K⁻¹ k
//! ```

use crate::space::centers::Centers;
use crate::space::factors::cholesky::{self, largest_eigenvalue};
use crate::space::factors::lanes::{LANES, VectorLoop, whole_lanes};
use crate::space::factors::mirror::{MirrorImages, sums_and_differences};
use crate::space::factors::packed::{PackedFactor, Product};
use crate::space::kernel::RadialFunction;
use pulp::Simd;

/// The octets of a lattice with two points or more along one, two or three axes.
pub(crate) struct MirroredLattice {
    images: MirrorImages,
    /// Between two neighbours, in length scales.
    spacing: [f64; 3],
}

impl MirroredLattice {
    /// `None` where the centers are no such lattice.
    pub(crate) fn of(centers: &Centers, inverse_length_scales: &[f64]) -> Option<Self> {
        let lattice = centers.lattice_box()?;
        let (mut counts, mut spacing, mut n_axes) = ([1; 3], [0.0; 3], 0);
        for (axis, &n) in lattice.per_axis.iter().enumerate().filter(|(_, n)| **n > 1) {
            *counts.get_mut(n_axes)? = n;
            spacing[n_axes] =
                (lattice.upper[axis] - lattice.lower[axis]) / (n - 1) as f64 * inverse_length_scales[axis];
            n_axes += 1;
        }
        (n_axes > 0).then(|| Self { images: MirrorImages::new(counts, n_axes, |_| false), spacing })
    }

    /// Whether a product is clearly faster than with a factor of the whole Gram matrix, in columns of eight
    /// multiply-adds.
    pub(crate) fn pays(&self) -> bool {
        /// The cost of kernel values of eight points, and of sorting eight octets with their images.
        const KERNEL: usize = 24;
        const ORDER: usize = 8;
        let product = |n: usize| {
            let panels = n.div_ceil(LANES);
            LANES * panels * (panels + 1) / 2 + ORDER * panels
        };
        let kernel = |n: usize| KERNEL * n.div_ceil(LANES);
        let n_images = self.images.n_images();
        let n = self.images.counts().into_iter().product();
        let mirrored: usize = (0..n_images).map(|s| product(self.images.present(s).len())).sum();
        5 * (mirrored + kernel(n_images * self.images.n_padded())) < 4 * (product(n) + kernel(n))
    }

    /// The factor, and the spectral condition number of K.
    ///
    /// # Errors
    /// The largest eigenvalue of K, where K is not numerically positive definite.
    ///
    /// # Cost
    /// N³/192 multiply-adds and N²/2 look-ups; N²/8 bytes while it works.
    pub(crate) fn factor(&self, kappa: &RadialFunction, nugget: f64) -> Result<(MirroredFactor, f64), f64> {
        let Self { images, spacing } = self;
        let counts = images.counts();
        let place = |[i, j, k]: [usize; 3]| (i * counts[1] + j) * counts[2] + k;
        let n: usize = counts.iter().product();
        let distance = |at: usize| {
            let steps = [at / (counts[1] * counts[2]), at / counts[2] % counts[1], at % counts[2]];
            steps.iter().zip(spacing).map(|(&n, spacing)| (n as f64 * spacing).powi(2)).sum::<f64>().sqrt()
        };
        let mut values: Vec<f64> = (0..n).map(|at| kappa.value(distance(at))).collect();
        values[0] += nugget * kappa.value_at_zero();
        let kernel = |steps: [usize; 3]| values[place(steps)];
        let (mut largest, mut smallest) = (0.0_f64, f64::INFINITY);
        let mut classes = Vec::with_capacity(images.n_images());
        for symmetry in 0..images.n_images() {
            let present = images.present(symmetry);
            let mut factor = images.gram(symmetry, &present, kernel);
            if cholesky::factor_regular(&mut factor).is_none() {
                // Of a positive matrix it belongs to a vector without changes of sign: to the sums.
                let present = images.present(0);
                let mut gram = images.gram(0, &present, kernel);
                gram.fill_upper_triangle_with_lower_triangle();
                return Err(largest_eigenvalue(present.len(), |x| &gram * x));
            }
            let eigenvalues = cholesky::invert_and_bound(&mut factor);
            (smallest, largest) = (smallest.min(eigenvalues.0), largest.max(eigenvalues.1));
            images.unscale(&present, &mut factor);
            classes.push(Class {
                factor: PackedFactor::new(&factor),
                octets: present.into_iter().map(|o| o as u32).collect(),
            });
        }
        let (n_octets, padded) = (images.octets().len(), images.n_padded());
        let centers = (0..images.n_images())
            .flat_map(|image| {
                (0..padded).map(move |o| place(images.point(image, o.min(n_octets - 1))) as u32)
            })
            .collect();
        let factor =
            MirroredFactor { n_octets, padded, n_images: images.n_images(), n_centers: n, centers, classes };
        Ok((factor, largest / smallest))
    }
}

/// One symmetry.
#[derive(Debug, Clone)]
struct Class {
    /// Octets that have a part of it, ascending.
    octets: Vec<u32>,
    /// R_s⁻¹.
    factor: PackedFactor,
}

/// R_s⁻¹ of all symmetries s of a lattice.
#[derive(Debug, Clone)]
pub(crate) struct MirroredFactor {
    n_octets: usize,
    padded: usize,
    n_images: usize,
    n_centers: usize,
    centers: Vec<u32>,
    classes: Vec<Class>,
}

impl MirroredFactor {
    /// The center at each place of a kernel vector: image after image, octets filled up to whole lanes with the last
    /// one's. A center in a middle plane is there more than once.
    pub(crate) fn centers(&self) -> &[u32] {
        &self.centers
    }

    /// Length of φ: each symmetry's in whole lanes.
    pub(crate) fn n_features(&self) -> usize {
        self.classes.iter().map(|class| whole_lanes(class.octets.len())).sum()
    }

    /// Bytes that a product reads.
    pub(crate) fn bytes(&self) -> usize {
        let of_class = |class: &Class| class.factor.bytes() + size_of_val(class.octets.as_slice());
        self.classes.iter().map(of_class).sum()
    }

    /// α̂: `α̂(ξ) = Σ_s ± (R_s⁻ᵀ θ_s)(o)`, summed over all places of ξ.
    pub(crate) fn coefficients(&self, weights: &[f64]) -> Vec<f64> {
        let images = self.to_images(weights, |class, theta| class.factor.transposed_times(theta));
        let mut coefficients = vec![0.0; self.n_centers];
        self.each_place(&images, |center, value| coefficients[center] += value);
        coefficients
    }

    /// β: `β(ξ) = Σ_s ± (R_s θ_s)(o) / 8`.
    pub(crate) fn nodal_values(&self, weights: &[f64]) -> Vec<f64> {
        let images = self.to_images(weights, |class, theta| class.factor.solve(theta));
        let mut values = vec![0.0; self.n_centers];
        self.each_place(&images, |center, value| values[center] = value / self.n_images as f64);
        values
    }

    /// Signed sums over the symmetries of what `each` makes of their θ_s.
    fn to_images(&self, weights: &[f64], each: impl Fn(&Class, &[f64]) -> Vec<f64>) -> Vec<f64> {
        let mut images = vec![0.0; self.centers.len()];
        let mut weights = weights;
        for (class, run) in self.classes.iter().zip(images.chunks_exact_mut(self.padded)) {
            let (theta, others) = weights.split_at(whole_lanes(class.octets.len()));
            let parts = each(class, &theta[..class.octets.len()]);
            class.octets.iter().zip(parts).for_each(|(&o, part)| run[o as usize] = part);
            weights = others;
        }
        sums_and_differences(&mut images, self.padded);
        images
    }

    fn each_place(&self, images: &[f64], mut look: impl FnMut(usize, f64)) {
        for (centers, values) in self.centers.chunks_exact(self.padded).zip(images.chunks_exact(self.padded))
        {
            let both = centers.iter().zip(values).take(self.n_octets);
            both.for_each(|(&center, &value)| look(center as usize, value));
        }
    }
}

/// φ and φᵀφ from k, at the places of [`MirroredFactor::centers`]; k is overwritten.
pub(crate) struct MirroredProduct<'a> {
    pub(crate) factor: &'a MirroredFactor,
    pub(crate) x: &'a mut [f64],
    pub(crate) product: &'a mut [f64],
}

impl VectorLoop for MirroredProduct<'_> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        let Self { factor, x, product } = self;
        sums_and_differences(x, factor.padded);
        let (mut rest, mut squares) = (product, 0.0);
        for (class, run) in factor.classes.iter().zip(x.chunks_exact_mut(factor.padded)) {
            let n = class.octets.len();
            if n < factor.n_octets {
                // Ascending, no octet is overwritten before it is read. What is left beyond n meets zeros of the factor.
                for (to, &from) in class.octets.iter().enumerate() {
                    run[to] = run[from as usize];
                }
            }
            let (product, others) = rest.split_at_mut(whole_lanes(n));
            squares += Product { factor: &class.factor, x: run, product }.call(simd);
            rest = others;
        }
        squares
    }
}
