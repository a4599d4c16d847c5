//! Boxes of lattice points, in sums and differences of mirror images.
//!
//! The Gram matrix of a radial kernel on a box does not change when the box is mirrored in one of its middle planes. In sums
//! and differences of mirror images it separates into eight blocks of an eighth of the size. Its factors then take 1/8 of
//! the memory, a product 1/8 of the multiplications, and factoring 1/64:
//!
//! ```text
//! u_s(o) = Σ_e (−1)^{s·e} v(o, e),    U_s = Σ_{e,e'} (−1)^{s·(e+e')} 𝔎(ξ(o,e), ξ(o',e')) = R_s R_sᵀ
//! kᵀ K⁻¹ β = Σ_s (R_s⁻¹ u_s(k))ᵀ (R_s⁻¹ u_s(β))
//! ```
//!
//! An *octet* o is a point with its mirror images e ∈ {0,1}³; s ∈ {0,1}³ is a symmetry. In a box with two mirrored axes or
//! one, an octet has four or two points, and there are as many symmetries.

use crate::space::factors::cholesky;
use crate::space::factors::lanes::whole_lanes;
use nalgebra::DMatrix;

/// c₁×c₂×c₃ points of a lattice, in octets.
#[derive(Debug, Clone)]
pub(crate) struct MirrorImages {
    counts: [usize; 3],
    n_mirrored: usize,
    /// Outwards from the middle planes.
    octets: Vec<[usize; 3]>,
}

impl MirrorImages {
    /// `counts` points, mirrored along the first `n_mirrored` axes; the others have one point. Octets that are `outer`
    /// come last.
    pub(crate) fn new(counts: [usize; 3], n_mirrored: usize, outer: impl Fn(&[usize; 3]) -> bool) -> Self {
        let half = counts.map(|n| n.div_ceil(2));
        let mut octets: Vec<[usize; 3]> = (0..half[0])
            .flat_map(|i| (0..half[1]).flat_map(move |j| (0..half[2]).map(move |k| [i, j, k])))
            .collect();
        octets.sort_by_key(outer);
        Self { counts, n_mirrored, octets }
    }

    /// Points along each axis.
    pub(crate) fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Outwards from the middle planes, the index of each octet along the axes.
    pub(crate) fn octets(&self) -> &[[usize; 3]] {
        &self.octets
    }

    /// Mirror images of a point; symmetries.
    pub(crate) fn n_images(&self) -> usize {
        1 << self.n_mirrored
    }

    /// Length of a run of octets, in whole lanes.
    pub(crate) fn n_padded(&self) -> usize {
        whole_lanes(self.octets.len())
    }

    /// Index along the axes of an octet's image.
    pub(crate) fn point(&self, image: usize, octet: usize) -> [usize; 3] {
        std::array::from_fn(|axis| {
            let (n, outwards) = (self.counts[axis], self.octets[octet][axis]);
            if image >> axis & 1 == 0 { (n - 1) / 2 - outwards } else { n / 2 + outwards }
        })
    }

    /// Octets with a part of a symmetry: a point in a middle plane is its own image, and has no difference to it.
    pub(crate) fn present(&self, symmetry: usize) -> Vec<usize> {
        let is_present = |octet: &[usize; 3]| {
            (0..3).all(|axis| {
                symmetry >> axis & 1 == 0 || self.counts[axis].is_multiple_of(2) || octet[axis] > 0
            })
        };
        (0..self.octets.len()).filter(|&o| is_present(&self.octets[o])).collect()
    }

    /// The lower triangle of D⁻¹ U_s D⁻¹ on the octets `present`, with zeros above; `kernel` is 𝔎 of two points these
    /// steps of the lattice apart, with the nugget.
    ///
    /// `D_oo = √(Σ of the squared weights of the distinct points in u_s(o)) = 8 / √(distinct images of o)`: the
    /// eigenvalues are those of K.
    pub(crate) fn gram(
        &self,
        symmetry: usize,
        present: &[usize],
        kernel: impl Fn([usize; 3]) -> f64,
    ) -> DMatrix<f64> {
        let n_images = self.n_images();
        let images: Vec<Vec<[usize; 3]>> =
            present.iter().map(|&o| (0..n_images).map(|e| self.point(e, o)).collect()).collect();
        let norms: Vec<f64> = present.iter().map(|&o| self.norm(o)).collect();
        let mut gram = DMatrix::zeros(present.len(), present.len());
        for (j, mut column) in gram.column_iter_mut().enumerate() {
            for (i, entry) in column.iter_mut().enumerate().skip(j) {
                // A reflection moves both points alike: one of them need not move.
                let still = images[i][0];
                let sum: f64 = images[j]
                    .iter()
                    .enumerate()
                    .map(|(e, moved)| {
                        let value = kernel(std::array::from_fn(|axis| still[axis].abs_diff(moved[axis])));
                        if (symmetry & e).count_ones().is_multiple_of(2) { value } else { -value }
                    })
                    .sum();
                *entry = n_images as f64 * sum / (norms[i] * norms[j]);
            }
        }
        gram
    }

    /// R_s⁻¹ from the inverse factor of D⁻¹ U_s D⁻¹.
    pub(crate) fn unscale(&self, present: &[usize], inverse: &mut DMatrix<f64>) {
        for (mut column, &o) in inverse.column_iter_mut().zip(present) {
            column /= self.norm(o);
        }
    }

    /// R_s⁻¹ on the octets `present`; `None` where U_s is not numerically positive definite.
    pub(crate) fn inverse_factor(
        &self,
        symmetry: usize,
        present: &[usize],
        kernel: impl Fn([usize; 3]) -> f64,
    ) -> Option<DMatrix<f64>> {
        let mut factor = self.gram(symmetry, present, kernel);
        cholesky::factor_regular(&mut factor)?;
        cholesky::invert(&mut factor);
        self.unscale(present, &mut factor);
        Some(factor)
    }

    /// D_oo.
    fn norm(&self, octet: usize) -> f64 {
        let is_moved = |axis: &usize| self.counts[*axis].is_multiple_of(2) || self.octets[octet][*axis] > 0;
        let distinct = 1_usize << (0..self.n_mirrored).filter(is_moved).count();
        self.n_images() as f64 / (distinct as f64).sqrt()
    }
}

/// u_s = Σ_e (−1)^{s·e} v_e, in place, axis after axis; runs of `padded` octets, image after image. Twice, it is a
/// multiplication by the number of images.
#[inline(always)]
pub(crate) fn sums_and_differences(vector: &mut [f64], padded: usize) {
    let mut step = padded;
    while step < vector.len() {
        for pair in vector.chunks_exact_mut(2 * step) {
            let (first, second) = pair.split_at_mut(step);
            for (a, b) in first.iter_mut().zip(second) {
                (*a, *b) = (*a + *b, *a - *b);
            }
        }
        step *= 2;
    }
}
