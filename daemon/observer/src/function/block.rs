//! A box of lattice points, and one factor for every such box of a lattice.
//!
//! The Gram matrix of a radial kernel does not depend on where on the lattice a box lies: all boxes of c₁×c₂×c₃ points have
//! the same one. In sums and differences of mirror images it separates into eight small matrices (see
//! [`crate::space::factors::mirror`]). The points inside of the outermost layer, the *core*, come first. The first entries of
//! R⁻¹u are therefore those of the smaller box, and the last ones are what the outermost layer adds.

use crate::error::{DesignError, Parameter};
use crate::space::factors::lanes::{VectorLoop, VectorUnit, whole_lanes};
use crate::space::factors::mirror::{MirrorImages, sums_and_differences};
use crate::space::factors::packed::{PackedFactor, four_products};
use crate::space::kernel::RadialFunction;
use nalgebra::DMatrix;
use pulp::Simd;

/// Mirror images of a point; symmetries.
pub(crate) const IMAGES: usize = 8;
/// Vectors that are processed together: k, and β of three outputs.
pub(crate) const VECTORS: usize = 4;

/// c₁×c₂×c₃ points of a lattice, and the factors of their Gram matrix.
#[derive(Debug, Clone)]
pub(crate) struct LatticeBlock {
    counts: [usize; 3],
    n_octets: usize,
    /// 1 for an octet of the outermost layer, 0 for one of the core; in whole lanes.
    in_layer: Vec<f64>,
    /// Index of each point along the axes: image after image, octets filled up to whole lanes.
    points: Vec<[u8; 3]>,
    factors: [PackedFactor; IMAGES],
    value_at_zero: f64,
    unit: VectorUnit,
}

impl LatticeBlock {
    /// A block of `counts` points that are `spacing` length scales apart. Where `has_layer`, the two outermost points
    /// along the axis belong to the outermost layer.
    ///
    /// # Errors
    /// `Centers` where the Gram matrix is not numerically positive definite.
    pub(crate) fn new(
        counts: [usize; 3],
        has_layer: [bool; 3],
        spacing: [f64; 3],
        kappa: &RadialFunction,
        nugget: f64,
    ) -> Result<Self, DesignError> {
        let in_layer = |octet: &[usize; 3]| {
            (0..3).any(|axis| has_layer[axis] && octet[axis] + 1 == counts[axis].div_ceil(2))
        };
        let images = MirrorImages::new(counts, 3, in_layer);
        let (n_octets, padded) = (images.octets().len(), images.n_padded());
        let mut layer = vec![0.0; padded];
        for (place, octet) in layer.iter_mut().zip(images.octets()) {
            *place = f64::from(u8::from(in_layer(octet)));
        }
        let mut points = vec![[0; 3]; IMAGES * padded];
        for (image, points) in points.chunks_exact_mut(padded).enumerate() {
            for (o, point) in points[..n_octets].iter_mut().enumerate() {
                *point = images.point(image, o).map(|index| index as u8);
            }
        }
        let value_at_zero = kappa.value_at_zero();
        let kernel = |steps: [usize; 3]| {
            let distances = steps.iter().zip(spacing).map(|(&n, spacing)| n as f64 * spacing);
            let r = distances.map(|distance| distance.powi(2)).sum::<f64>().sqrt();
            kappa.value(r) + if steps == [0; 3] { nugget * value_at_zero } else { 0.0 }
        };
        let factor = |symmetry: usize| {
            let present = images.present(symmetry);
            let inverse = images
                .inverse_factor(symmetry, &present, kernel)
                .ok_or_else(|| not_positive_definite(counts, spacing))?;
            let mut whole = DMatrix::zeros(n_octets, n_octets);
            for (i, &row) in present.iter().enumerate() {
                for (j, &column) in present.iter().enumerate().take(i + 1) {
                    whole[(row, column)] = inverse[(i, j)];
                }
            }
            Ok(PackedFactor::new(&whole))
        };
        let mut factors = std::array::from_fn(|_| PackedFactor::new(&DMatrix::zeros(0, 0)));
        for (symmetry, place) in factors.iter_mut().enumerate() {
            *place = factor(symmetry)?;
        }
        Ok(Self {
            counts,
            n_octets,
            in_layer: layer,
            points,
            factors,
            value_at_zero,
            unit: VectorUnit::of_this_machine(),
        })
    }

    /// Points along each axis.
    pub(crate) fn counts(&self) -> [usize; 3] {
        self.counts
    }

    pub(crate) fn n_octets(&self) -> usize {
        self.n_octets
    }

    /// Length of a run of octets, in whole lanes.
    pub(crate) fn n_padded(&self) -> usize {
        whole_lanes(self.n_octets)
    }

    /// Indices along the axes of all points, in the order of a vector of a [`BlockBuffers`].
    pub(crate) fn points(&self) -> &[[u8; 3]] {
        &self.points
    }

    /// Bytes that an evaluation reads.
    pub(crate) fn bytes(&self) -> usize {
        self.factors.iter().map(PackedFactor::bytes).sum::<usize>() + size_of_val(self.points.as_slice())
    }

    /// P of the block, from φᵀφ.
    pub(crate) fn power_function(&self, squared_features: f64) -> f64 {
        (self.value_at_zero - squared_features).max(0.0).sqrt()
    }

    /// φ, and θ of the three outputs, from k and β in `buffers`.
    pub(crate) fn evaluate(&self, buffers: &mut BlockBuffers) -> BlockEvaluation {
        self.unit.run(Evaluate { block: self, buffers })
    }
}

fn not_positive_definite(counts: [usize; 3], spacing: [f64; 3]) -> DesignError {
    let [a, b, c] = counts;
    let nearest =
        spacing.into_iter().zip(counts).filter(|(_, n)| *n > 1).map(|(s, _)| s).fold(f64::INFINITY, f64::min);
    DesignError::new(
        Parameter::Centers,
        format!(
            "the Gram matrix of {a}×{b}×{c} neighbours {nearest:.3e} length scales apart is not numerically positive definite"
        ),
        "centers further apart, a shorter length scale, a lower kernel order, a smaller block, or a nugget (1e-10, say)",
    )
}

/// Vectors over the points of a block: k first, then β of each output; image after image, octets in whole lanes.
#[derive(Debug, Clone)]
pub(crate) struct BlockBuffers {
    /// k and β; afterwards their sums and differences.
    pub(crate) nodal: Vec<f64>,
    /// φ and θ.
    newton: Vec<f64>,
    /// Squared distances along the axes, of the first and the last image of each octet.
    sides: Vec<f64>,
    padded: usize,
}

impl BlockBuffers {
    pub(crate) fn new(block: &LatticeBlock) -> Self {
        let padded = block.n_padded();
        let length = VECTORS * IMAGES * padded;
        Self { nodal: vec![0.0; length], newton: vec![0.0; length], sides: vec![0.0; 6 * padded], padded }
    }

    /// One of the vectors before [`LatticeBlock::evaluate`].
    pub(crate) fn vector(&mut self, vector: usize) -> &mut [f64] {
        let length = IMAGES * self.padded;
        &mut self.nodal[vector * length..][..length]
    }

    /// k, and room for the squared distances that it is made of: for each axis a run per side.
    pub(crate) fn kernel_and_sides(&mut self) -> (&mut [f64], &mut [f64]) {
        (&mut self.nodal[..IMAGES * self.padded], &mut self.sides)
    }

    /// φ.
    pub(crate) fn features(&self) -> &[f64] {
        &self.newton[..IMAGES * self.padded]
    }
}

/// The results of a block at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BlockEvaluation {
    /// φᵀφ.
    pub(crate) squared_features: f64,
    /// θᵀφ.
    pub(crate) values: [f64; 3],
    /// ‖θ‖² of the outermost layer.
    pub(crate) squared_layer: f64,
    /// φᵀφ of the outermost layer.
    pub(crate) squared_layer_features: f64,
}

struct Evaluate<'a> {
    block: &'a LatticeBlock,
    buffers: &'a mut BlockBuffers,
}

impl VectorLoop for Evaluate<'_> {
    type Output = BlockEvaluation;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> BlockEvaluation {
        let Self { block, buffers } = self;
        let padded = buffers.padded;
        let length = IMAGES * padded;
        for vector in buffers.nodal.chunks_exact_mut(length) {
            sums_and_differences(vector, padded);
        }
        let zero = simd.splat_f64s(0.0);
        let (mut squares, mut layer_features) = (zero, zero);
        let (mut values, mut layers) = ([zero; 3], [zero; 3]);
        for (symmetry, factor) in block.factors.iter().enumerate() {
            let run = |vector: usize| vector * length + symmetry * padded;
            let x: [&[f64]; VECTORS] = std::array::from_fn(|v| &buffers.nodal[run(v)..][..padded]);
            let mut rest = buffers.newton.as_mut_slice();
            let product: [&mut [f64]; VECTORS] = std::array::from_fn(|_| {
                let (vector, others) = std::mem::take(&mut rest).split_at_mut(length);
                rest = others;
                &mut vector[symmetry * padded..][..padded]
            });
            four_products(simd, factor, x, product);
            let [phi, theta_1, theta_2, theta_3]: [&[S::f64s]; VECTORS] =
                std::array::from_fn(|v| S::as_simd_f64s(&buffers.newton[run(v)..][..padded]).0);
            let (in_layer, _) = S::as_simd_f64s(&block.in_layer);
            for i in 0..phi.len() {
                let theta = [theta_1[i], theta_2[i], theta_3[i]];
                let phi_in_layer = simd.mul_f64s(phi[i], in_layer[i]);
                squares = simd.mul_add_e_f64s(phi[i], phi[i], squares);
                layer_features = simd.mul_add_e_f64s(phi_in_layer, phi[i], layer_features);
                for ((value, layer), theta) in values.iter_mut().zip(&mut layers).zip(theta) {
                    *value = simd.mul_add_e_f64s(theta, phi[i], *value);
                    *layer = simd.mul_add_e_f64s(simd.mul_f64s(theta, in_layer[i]), theta, *layer);
                }
            }
        }
        BlockEvaluation {
            squared_features: simd.reduce_sum_f64s(squares),
            values: values.map(|value| simd.reduce_sum_f64s(value)),
            squared_layer: layers.into_iter().map(|layer| simd.reduce_sum_f64s(layer)).sum(),
            squared_layer_features: simd.reduce_sum_f64s(layer_features),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::kernel::Kernel;
    use nalgebra::DVector;

    /// kᵀK⁻¹k and kᵀK⁻¹β against nalgebra's LU of the whole matrix, for even and odd, flat and thin blocks.
    #[test]
    fn a_block_is_the_interpolant_of_its_points() {
        let spacing = [0.5, 0.4, 0.7];
        for (kernel, nugget) in [
            (Kernel::SobolevMatern { dimension: 3, order: 3 }, 0.0),
            (Kernel::WendlandC2, 0.0),
            (Kernel::Gaussian, 1e-6),
        ] {
            for counts in [[4, 4, 4], [6, 4, 2], [3, 4, 5], [1, 1, 6], [1, 3, 4], [1, 1, 1], [4, 1, 7]] {
                let kappa = kernel.radial(3).unwrap();
                let has_layer = counts.map(|n| n >= 4);
                let block = LatticeBlock::new(counts, has_layer, spacing, &kappa, nugget).unwrap();
                let points: Vec<[f64; 3]> = (0..counts[0])
                    .flat_map(|i| (0..counts[1]).flat_map(move |j| (0..counts[2]).map(move |k| [i, j, k])))
                    .map(|index| std::array::from_fn(|a| index[a] as f64 * spacing[a]))
                    .collect();
                let kernel_of = |a: &[f64; 3], b: &[f64; 3]| {
                    kappa.value((0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt())
                };
                let n = points.len();
                let gram = DMatrix::from_fn(n, n, |i, j| {
                    let nugget = if i == j { nugget * kappa.value_at_zero() } else { 0.0 };
                    kernel_of(&points[i], &points[j]) + nugget
                })
                .lu();
                let y = [0.61, 0.47, 1.13];
                let k = DVector::from_iterator(n, points.iter().map(|point| kernel_of(point, &y)));
                let beta: [DVector<f64>; 3] = std::array::from_fn(|q| {
                    DVector::from_iterator(n, points.iter().map(|p| (p[0] + 2.0 * p[q] + q as f64).sin()))
                });
                let mut buffers = BlockBuffers::new(&block);
                for (at, index) in block.points().iter().enumerate() {
                    let index = index.map(usize::from);
                    let i = (index[0] * counts[1] + index[1]) * counts[2] + index[2];
                    buffers.vector(0)[at] = k[i];
                    (0..3).for_each(|q| buffers.vector(q + 1)[at] = beta[q][i]);
                }
                let found = block.evaluate(&mut buffers);
                let solved = gram.solve(&k).unwrap();
                let case = format!("{kernel:?} {counts:?}");
                let expected = k.dot(&solved);
                assert!((found.squared_features - expected).abs() < 1e-9, "{case}: {found:?}, {expected}");
                for (value, beta) in found.values.iter().zip(&beta) {
                    let expected = beta.dot(&solved);
                    assert!((value - expected).abs() <= 1e-7 * beta.amax(), "{case}: {value}, {expected}");
                }
            }
        }
    }

    /// The entries of the core are the interpolant of the smaller block around the same middle.
    #[test]
    fn the_core_comes_first() {
        let kappa = Kernel::SobolevMatern { dimension: 3, order: 3 }.radial(3).unwrap();
        let spacing = [0.5, 0.4, 0.7];
        let make = |counts, has_layer| LatticeBlock::new(counts, has_layer, spacing, &kappa, 0.0).unwrap();
        for (outer, layer, inner) in
            [([6, 6, 6], [true; 3], [4, 4, 4]), ([3, 6, 4], [false, true, true], [3, 4, 2])]
        {
            let evaluate = |block: &LatticeBlock, shift: [f64; 3]| {
                let mut buffers = BlockBuffers::new(block);
                for (at, index) in block.points().iter().enumerate() {
                    let point: [f64; 3] =
                        std::array::from_fn(|a| (f64::from(index[a]) + shift[a]) * spacing[a]);
                    let y = [1.1, 0.9, 1.6];
                    let r = (0..3).map(|a| (point[a] - y[a]).powi(2)).sum::<f64>().sqrt();
                    buffers.vector(0)[at] = kappa.value(r);
                    buffers.vector(1)[at] = (point[0] - 2.0 * point[1] * point[2]).cos();
                }
                block.evaluate(&mut buffers)
            };
            let shift = std::array::from_fn(|a| ((outer[a] - inner[a]) / 2) as f64);
            let (outer, inner) = (make(outer, layer), make(inner, [false; 3]));
            let (outer, inner) = (evaluate(&outer, [0.0; 3]), evaluate(&inner, shift));
            let core = outer.squared_features - outer.squared_layer_features;
            assert!((core - inner.squared_features).abs() < 1e-11);
            assert!((outer.values[0] - inner.values[0]).abs() > 1e-6, "the layer says something");
            let by_layer = (outer.squared_layer * outer.squared_layer_features).sqrt();
            assert!((outer.values[0] - inner.values[0]).abs() <= by_layer);
        }
    }

    #[test]
    fn points_too_close_to_tell_apart_are_refused() {
        let kappa = Kernel::Gaussian.radial(3).unwrap();
        let error = LatticeBlock::new([6; 3], [true; 3], [0.05; 3], &kappa, 0.0).unwrap_err().to_string();
        assert!(error.contains("5.000e-2 length scales apart"), "{error}");
        assert!(LatticeBlock::new([6; 3], [true; 3], [0.05; 3], &kappa, 1e-8).is_ok(), "a nugget helps");
    }
}
