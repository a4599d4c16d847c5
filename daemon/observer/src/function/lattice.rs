//! The local solver: f̂_N on a lattice, evaluated from the centers around the output. The cost of a step hardly depends on
//! the number of centers.
//!
//! The coordinates are the nodal values β = K α̂, the values of f̂_N at the centers. Learning is exact in them and changes
//! only the centers within the kernel's support. An evaluation uses the block of c points along each axis around y:
//!
//! ```text
//! β += k(y) inᵀ,    f̂(y) = βᵀ K⁻¹ k(y) ≈ β_cᵀ K_c⁻¹ k_c(y)
//! ```
//!
//! with `in` = h σ Γ_f ỹ. Distant nodal values contribute little at y, because the cardinal functions of Sobolev-type kernels
//! decay exponentially.
//!
//! # The error estimate
//!
//! With Π_c the projection onto the span of the block's kernels, the error is that of one functional,
//!
//! ```text
//! f̂_N(y) − f̂_c(y) = ⟨f̂_N − Π_c f̂_N, q⟩,   q = Π_N 𝔎(y,·) − Π_c 𝔎(y,·),   ‖q‖² = P_c(y)² − P_N(y)²
//! ```
//!
//! so that `‖q‖ ‖f̂_N‖` bounds it. For a given lattice, ‖q‖/P_c(y) depends only on the place of y in its cell, and only
//! slightly. ρ is 1.25 times its largest value in the middle cell, found at construction with a larger block in place of the
//! lattice. Since q is small away from the block, only the norm of f̂_N *near the block* matters. The block's outermost
//! layer gives an estimate of it:
//!
//! ```text
//! error = ρ P_c(y) min(‖f̂_N‖, 2 ‖θ_layer‖ + ε ‖f̂_N‖),   ε = 1, 1/4, 1/16 for m = 1, 2, 3
//! ```
//!
//! The first term is a bound. The factors 2 and ε are calibrated on random histories, in which the error never exceeded the
//! estimate; the estimate was some tens of times the error.
//!
//! # Source
//! Fuselier, Hangelbroek, Narcowich, Ward (2013), *Localized bases for kernel spaces on the unit sphere*, for the decay.
//! The scheme and its estimate are ours.

use crate::error::{DesignError, Parameter};
use crate::function::block::{BlockBuffers, BlockEvaluation, IMAGES, LatticeBlock};
use crate::function::calibration::Calibration;
use crate::function::checkpoint::Learned;
use crate::function::evaluation::Evaluation;
use crate::function::solver::{LocalSolver, surroundings_norm};
use crate::space::centers::Centers;
use crate::space::factors::lanes::{VectorLoop, VectorUnit, multiply_add, whole_lanes};
use crate::space::kernel::{Kernel, RadialFunction};
use crate::space::native_space::NativeSpace;
use crate::space::scaled_kernel::{LengthScale, ScaledKernel};
use nalgebra::SVector;
use pulp::Simd;

/// Distance (length scales) of the padding beyond the last point of a row, so that the kernel is 0 there.
const FAR: f64 = 1e150;
/// Blocks that are tried for the requested accuracy; larger ones take long to set up.
const BLOCKS_TO_TRY: [usize; 3] = [4, 6, 8];
/// More than a block has points along an axis; a power of two.
const INDICES: usize = 16;

/// One axis of the lattice.
#[derive(Debug, Clone, Copy)]
struct Axis {
    lower: f64,
    /// 1/spacing, in points per unit of the output.
    points_per_unit: f64,
    /// Spacing in length scales.
    spacing: f64,
    count: usize,
}

impl Axis {
    /// An axis without extent.
    const SINGLE: Self = Self { lower: 0.0, points_per_unit: 0.0, spacing: 1.0, count: 1 };

    /// Distance of a point of the lattice from u, which is in points (length scales).
    fn distance(&self, index: usize, u: f64) -> f64 {
        (index as f64 - u) * self.spacing
    }

    /// First of the `count` points around u.
    fn block_start(&self, u: f64, count: usize) -> usize {
        // Saturates: a point far outside takes the block at the edge.
        let cell = u.floor() as isize;
        cell.saturating_sub(count as isize / 2 - 1).clamp(0, (self.count - count) as isize) as usize
    }

    /// The points within `reach` points of u; empty where the kernel ends before the lattice begins.
    fn reached(&self, u: f64, reach: f64) -> std::ops::Range<usize> {
        let from = (u - reach).ceil().max(0.0);
        let to = (u + reach).floor().min((self.count - 1) as f64);
        if from <= to { from as usize..to as usize + 1 } else { 0..0 }
    }
}

/// A list with room for a fixed number of rows, which its clones have too.
#[derive(Debug, Clone)]
struct Rows {
    rows: Vec<usize>,
    length: usize,
}

impl Rows {
    fn with_room_for(n: usize) -> Self {
        Self { rows: vec![0; n], length: 0 }
    }

    fn push(&mut self, row: usize) {
        self.rows[self.length] = row;
        self.length += 1;
    }

    fn clear(&mut self) {
        self.length = 0;
    }

    fn listed(&self) -> &[usize] {
        &self.rows[..self.length]
    }
}

/// A function of H_N with values in ℝ^m, m ≤ 3, as nodal values on a lattice.
#[derive(Debug, Clone)]
pub(crate) struct LatticeFunction<const M: usize> {
    geometry: Geometry,
    n_outputs: usize,
    /// β row after row along the last axis; ‖f̂_N‖², by its recursion, and Σ|in|, which what a truncated kernel drops is
    /// in proportion to.
    learned: Learned<M, 2>,
    saved: Learned<M, 2>,
    bounding_box: (Vec<f64>, Vec<f64>),
    /// Rows that differ from the checkpoint, and a list of them.
    touched: Vec<bool>,
    touched_rows: Rows,
    /// The held output, in points.
    held_at: [f64; 3],
    held: Evaluation<M>,
    at_output: BlockBuffers,
    at_query: BlockBuffers,
    /// Kernel values of what an update reaches: one slab.
    slab: Vec<f64>,
    slab_rows: Rows,
    window: Vec<f64>,
    /// Of one block, for reports.
    block_space: NativeSpace,
}

/// What does not change.
#[derive(Debug, Clone)]
struct Geometry {
    kappa: RadialFunction,
    value_at_zero: f64,
    axes: [Axis; 3],
    /// Length of a row, in whole lanes.
    row: usize,
    /// How far an update goes, in length scales; +∞ for all centers.
    reach: f64,
    block: LatticeBlock,
    /// Place of each point of the block in the nodal values, from that of its first one.
    places: Vec<u32>,
    /// ρ.
    error_ratio: f64,
    /// m.
    dimension: usize,
    /// RMS of the error over that of f̂, for random histories.
    predicted_error: f64,
    /// What one unit of increment that was dropped beyond the reach may change f̂ by at most.
    error_of_truncation: f64,
    unit: VectorUnit,
}

impl<const M: usize> LatticeFunction<M> {
    /// Zero.
    ///
    /// # Errors
    /// `Solver` where the centers are no lattice of 1, 2 or 3 axes or an option is out of range; `Kernel`,
    /// `LengthScale`, `Nugget` out of range; `Centers` where the Gram matrix of a block is not positive definite.
    pub(crate) fn zero(
        (kernel, length_scale): (Kernel, &LengthScale),
        centers: &Centers,
        nugget: f64,
        options: &LocalSolver,
    ) -> Result<Self, DesignError> {
        let m = centers.dimension();
        options.check(m)?;
        let Some(lattice) = centers.lattice_box() else {
            let found = format!("the local solver for {} listed centers", centers.n_centers());
            let needed = "centers on a lattice, or the dense solver, which takes any (solver = \"dense\")";
            return Err(DesignError::new(Parameter::Solver, found, needed));
        };
        let scaled = ScaledKernel::new(kernel, length_scale, m)?;
        let mut axes = [Axis::SINGLE; 3];
        for (axis, place) in axes[3 - m..].iter_mut().enumerate() {
            let (lower, upper, count) = (lattice.lower[axis], lattice.upper[axis], lattice.per_axis[axis]);
            *place = match count {
                1 => Axis {
                    lower: 0.5 * (lower + upper),
                    points_per_unit: scaled.inverse_length_scales()[axis],
                    ..Axis::SINGLE
                },
                n => {
                    let spacing = (upper - lower) / (n - 1) as f64;
                    let scaled_spacing = spacing * scaled.inverse_length_scales()[axis];
                    Axis { lower, points_per_unit: spacing.recip(), spacing: scaled_spacing, count }
                }
            };
        }
        let geometry = Geometry::new(scaled.radial().clone(), axes, m, nugget, options)?;
        let block_centers = {
            let counts = &geometry.block.counts()[3 - m..];
            let upper: Vec<_> = (counts.iter().enumerate())
                .map(|(axis, &c)| {
                    let steps = (lattice.per_axis[axis] - 1).max(1) as f64;
                    lattice.lower[axis] + (lattice.upper[axis] - lattice.lower[axis]) * (c - 1) as f64 / steps
                })
                .collect();
            Centers::lattice(&lattice.lower, upper, counts)?
        };
        let block_space = NativeSpace::new(kernel, length_scale, block_centers, nugget)?;
        let n_rows = axes[0].count * axes[1].count;
        let length = n_rows * geometry.row;
        let buffers = BlockBuffers::new(&geometry.block);
        Ok(Self {
            n_outputs: m,
            learned: Learned::zeros(m, length),
            saved: Learned::zeros(m, length),
            bounding_box: centers.bounding_box(),
            touched: vec![false; n_rows],
            touched_rows: Rows::with_room_for(n_rows),
            held_at: [0.0; 3],
            held: Evaluation::exact(SVector::zeros(), 0.0),
            at_output: buffers.clone(),
            at_query: buffers,
            slab: vec![0.0; axes[1].count * geometry.row],
            slab_rows: Rows::with_room_for(axes[1].count),
            window: vec![0.0; geometry.row],
            block_space,
            geometry,
        })
    }

    pub(crate) fn hold(&mut self, output: &[f64]) {
        self.held_at = self.geometry.in_points(output);
    }

    pub(crate) fn held(&mut self) -> Evaluation<M> {
        let evaluate = Evaluate::<M> {
            geometry: &self.geometry,
            learned: &self.learned,
            u: self.held_at,
            held_at: self.held_at,
            pending: &SVector::zeros(),
            buffers: &mut self.at_output,
        };
        let block = self.geometry.unit.run(evaluate);
        self.held = self.geometry.evaluation(&block, &self.learned, 0.0);
        self.held
    }

    pub(crate) fn at(&mut self, point: &[f64], pending: &SVector<f64, M>) -> Evaluation<M> {
        let evaluate = Evaluate {
            geometry: &self.geometry,
            learned: &self.learned,
            u: self.geometry.in_points(point),
            held_at: self.held_at,
            pending,
            buffers: &mut self.at_query,
        };
        let block = self.geometry.unit.run(evaluate);
        self.geometry.evaluation(&block, &self.learned, pending.norm())
    }

    pub(crate) fn learn(&mut self, increment: &SVector<f64, M>) {
        let size = increment.norm();
        let own = self.norm_coefficient();
        let [squared_norm, increments] = &mut self.learned.scalars;
        *squared_norm = (*squared_norm + 2.0 * self.held.value.dot(increment) + own * size * size).max(0.0);
        *increments += size;
        self.geometry.unit.run(Learn {
            geometry: &self.geometry,
            nodal_values: &mut self.learned.runs[..self.n_outputs],
            u: self.held_at,
            increment,
            touched: &mut self.touched,
            touched_rows: &mut self.touched_rows,
            slab: &mut self.slab,
            slab_rows: &mut self.slab_rows,
            window: &mut self.window,
        });
    }

    /// # Cost
    /// All nodal values are written: milliseconds for a million centers.
    pub(crate) fn forget(&mut self) {
        self.learned.clear();
        self.everything_touched();
    }

    /// # Cost
    /// A copy of the rows that were learned on since the last one.
    pub(crate) fn save(&mut self) {
        self.saved.copy_rows_from(&self.learned, self.touched_rows.listed(), self.geometry.row);
        self.nothing_touched();
    }

    pub(crate) fn restore(&mut self) {
        self.learned.copy_rows_from(&self.saved, self.touched_rows.listed(), self.geometry.row);
        self.nothing_touched();
    }

    pub(crate) fn load(&mut self, numbers: &[f64]) {
        self.saved.load(numbers);
        self.learned.copy_from(&self.saved);
        self.nothing_touched();
    }

    pub(crate) fn saved(&self) -> &Learned<M, 2> {
        &self.saved
    }

    /// Of all centers.
    pub(crate) fn bounding_box(&self) -> (&[f64], &[f64]) {
        (&self.bounding_box.0, &self.bounding_box.1)
    }

    fn everything_touched(&mut self) {
        self.touched_rows.clear();
        (0..self.touched.len()).for_each(|row| self.touched_rows.push(row));
        self.touched.fill(true);
    }

    fn nothing_touched(&mut self) {
        for &row in self.touched_rows.listed() {
            self.touched[row] = false;
        }
        self.touched_rows.clear();
    }

    /// ‖f̂_N‖_H by its recursion, in which f̂(y) is the local one.
    pub(crate) fn native_norm(&self) -> f64 {
        self.learned.scalars[0].sqrt()
    }

    /// q in ‖f̂ + Π_N 𝔎(·, y) in‖² = ‖f̂‖² + 2 ⟨f̂(y), in⟩ + q |in|²: κ(0) − P_N² with P_N² ≥ (1 − ρ²) P_c².
    pub(crate) fn norm_coefficient(&self) -> f64 {
        let squared_power = self.geometry.value_at_zero - self.held.squared_features;
        self.held.squared_features + self.geometry.error_ratio.powi(2) * squared_power.max(0.0)
    }

    /// H_c, the space of one block.
    pub(crate) fn space(&self) -> &NativeSpace {
        &self.block_space
    }

    /// Points of the block along each axis.
    pub(crate) fn block(&self) -> Vec<usize> {
        self.geometry.block.counts()[3 - self.n_outputs..].to_vec()
    }

    /// RMS of the error over that of f̂, for random histories of updates.
    pub(crate) fn predicted_error(&self) -> f64 {
        self.geometry.predicted_error
    }

    /// Bytes of nodal values, of their checkpoint, and of what an evaluation reads beside them.
    pub(crate) fn bytes(&self) -> usize {
        let values: usize = self.learned.runs.iter().map(|values| size_of_val(values.as_slice())).sum();
        2 * values + self.geometry.block.bytes() + self.block_space.bytes()
    }

    /// Bytes that a step reads: the block's factors, and the nodal values that the block and an update reach.
    pub(crate) fn bytes_of_step(&self) -> usize {
        let geometry = &self.geometry;
        let reached: usize = (geometry.axes.iter())
            .map(|axis| {
                let reach = geometry.reach / axis.spacing;
                if reach < axis.count as f64 { (2.0 * reach) as usize + 1 } else { axis.count }
                    .min(axis.count)
            })
            .product();
        geometry.block.bytes() + 8 * self.n_outputs * reached
    }
}

impl Geometry {
    fn new(
        kappa: RadialFunction,
        axes: [Axis; 3],
        dimension: usize,
        nugget: f64,
        options: &LocalSolver,
    ) -> Result<Self, DesignError> {
        if !(nugget.is_finite() && nugget >= 0.0) {
            return Err(DesignError::new(Parameter::Nugget, nugget.to_string(), "a finite number ≥ 0"));
        }
        let value_at_zero = kappa.value_at_zero();
        let reach = reach(&kappa, options.truncation);
        let blocks = options.block.as_ref().map_or(BLOCKS_TO_TRY.as_slice(), std::slice::from_ref);
        let mut found = None;
        for &points in blocks {
            let counts = axes.map(|axis| points.min(axis.count));
            let tried = Calibration::of(counts, axes.map(|axis| (axis.count, axis.spacing)), &kappa, nugget)?;
            let is_accurate = tried.relative_error <= options.accuracy;
            found = Some(tried);
            if is_accurate {
                break;
            }
        }
        let Calibration { block, error_ratio, relative_error, largest_weights } =
            found.expect("there is a block to try");
        let row = whole_lanes(axes[2].count);
        let place = |point: &[u8; 3]| {
            let [i, j, k] = point.map(usize::from);
            ((i * axes[1].count + j) * row + k) as u32
        };
        Ok(Self {
            error_of_truncation: match reach.is_finite() {
                true => largest_weights * options.truncation * value_at_zero,
                false => 0.0,
            },
            value_at_zero,
            kappa,
            axes,
            row,
            reach,
            places: block.points().iter().map(place).collect(),
            block,
            error_ratio,
            dimension,
            predicted_error: relative_error,
            unit: VectorUnit::of_this_machine(),
        })
    }

    /// A point of ℝ^m, in points of the lattice.
    fn in_points(&self, point: &[f64]) -> [f64; 3] {
        let missing = 3 - point.len();
        std::array::from_fn(|axis| match axis.checked_sub(missing) {
            None => 0.0,
            Some(own) => (point[own] - self.axes[axis].lower) * self.axes[axis].points_per_unit,
        })
    }

    /// With an increment of size `pending` that is part of the block's values, but not yet of what is learned.
    fn evaluation<const M: usize>(
        &self,
        block: &BlockEvaluation,
        learned: &Learned<M, 2>,
        pending: f64,
    ) -> Evaluation<M> {
        let [squared_norm, increments] = learned.scalars;
        let norm = squared_norm.sqrt() + self.value_at_zero.sqrt() * pending;
        let surroundings = |layer: f64, norm: f64| surroundings_norm(self.dimension, layer, norm);
        // Beside a center the difference is rounding noise.
        let power = self.block.power_function(block.squared_features).max(1e-7 * self.value_at_zero.sqrt());
        let functional = self.error_ratio * power;
        let of_increment = surroundings(block.squared_layer_features.sqrt(), self.value_at_zero.sqrt());
        Evaluation {
            value: SVector::from_fn(|axis, _| if axis < 3 { block.values[axis] } else { 0.0 }),
            squared_features: block.squared_features,
            error: functional * surroundings(block.squared_layer.sqrt(), norm)
                + self.error_of_truncation * (increments + pending),
            error_of_increment: functional * of_increment,
        }
    }

    /// κ at the points of the block that starts at `start`, seen from u.
    #[inline(always)]
    fn kernel_on_block<S: Simd>(&self, start: [usize; 3], u: [f64; 3], buffers: &mut BlockBuffers) {
        let mut squares = [[0.0; INDICES]; 3];
        for (axis, squares) in squares.iter_mut().enumerate() {
            for (i, square) in squares.iter_mut().enumerate().take(self.block.counts()[axis]) {
                *square = self.axes[axis].distance(start[axis] + i, u[axis]).powi(2);
            }
        }
        // Along one axis an octet has two indices: those of its first image, and those of its last.
        let padded = self.block.n_padded();
        let (kernel, sides) = buffers.kernel_and_sides();
        let first = &self.block.points()[..self.block.n_octets()];
        let last = &self.block.points()[(IMAGES - 1) * padded..][..self.block.n_octets()];
        for (side, points) in [first, last].into_iter().enumerate() {
            for (axis, squares) in squares.iter().enumerate() {
                let along = &mut sides[(2 * axis + side) * padded..][..points.len()];
                for (square, point) in along.iter_mut().zip(points) {
                    *square = squares[usize::from(point[axis]) & (INDICES - 1)];
                }
            }
        }
        for (image, squares) in kernel.chunks_exact_mut(padded).enumerate() {
            let [first, second, third]: [&[f64]; 3] =
                std::array::from_fn(|axis| &sides[(2 * axis + (image >> axis & 1)) * padded..][..padded]);
            for (((square, a), b), c) in squares.iter_mut().zip(first).zip(second).zip(third) {
                *square = a + b + c;
            }
        }
        self.kappa.replace_squares::<S>(kernel);
    }
}

/// f̂ at u, as if `pending` had been learned at `held_at`.
struct Evaluate<'a, const M: usize> {
    geometry: &'a Geometry,
    learned: &'a Learned<M, 2>,
    u: [f64; 3],
    held_at: [f64; 3],
    pending: &'a SVector<f64, M>,
    buffers: &'a mut BlockBuffers,
}

impl<const M: usize> VectorLoop for Evaluate<'_, M> {
    type Output = BlockEvaluation;

    #[inline(always)]
    fn call<S: Simd>(self, _: S) -> BlockEvaluation {
        let Self { geometry, learned, u, held_at, pending, buffers } = self;
        let counts = geometry.block.counts();
        let start: [usize; 3] =
            std::array::from_fn(|axis| geometry.axes[axis].block_start(u[axis], counts[axis]));
        let first = (start[0] * geometry.axes[1].count + start[1]) * geometry.row + start[2];
        for (output, values) in learned.runs.iter().enumerate().filter(|(_, values)| !values.is_empty()) {
            let values = &values[first..];
            let (n_octets, padded) = (geometry.block.n_octets(), geometry.block.n_padded());
            let images = buffers.vector(output + 1).chunks_exact_mut(padded);
            for (betas, places) in images.zip(geometry.places.chunks_exact(padded)) {
                for (beta, &place) in betas[..n_octets].iter_mut().zip(places) {
                    *beta = values[place as usize];
                }
            }
        }
        if *pending != SVector::<f64, M>::zeros() {
            geometry.kernel_on_block::<S>(start, held_at, buffers);
            let length = buffers.vector(0).len();
            let (kernel, betas) = buffers.nodal.split_at_mut(length);
            let outputs = learned.runs.iter().filter(|values| !values.is_empty());
            for ((betas, &increment), _) in betas.chunks_exact_mut(length).zip(pending).zip(outputs) {
                // What fills up the lanes stays zero: it would grow with every evaluation.
                let (n_octets, padded) = (geometry.block.n_octets(), geometry.block.n_padded());
                for (betas, kernel) in betas.chunks_exact_mut(padded).zip(kernel.chunks_exact(padded)) {
                    for (beta, &k) in betas[..n_octets].iter_mut().zip(kernel) {
                        *beta = multiply_add::<S>(k, increment, *beta);
                    }
                }
            }
        }
        geometry.kernel_on_block::<S>(start, u, buffers);
        geometry.block.evaluate(buffers)
    }
}

/// β += k(y) inᵀ, y at u.
struct Learn<'a, const M: usize> {
    geometry: &'a Geometry,
    nodal_values: &'a mut [Vec<f64>],
    u: [f64; 3],
    increment: &'a SVector<f64, M>,
    touched: &'a mut [bool],
    touched_rows: &'a mut Rows,
    slab: &'a mut [f64],
    slab_rows: &'a mut Rows,
    window: &'a mut [f64],
}

impl<const M: usize> VectorLoop for Learn<'_, M> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { geometry, nodal_values, u, increment, touched, touched_rows, slab, slab_rows, window } =
            self;
        let reached: [_; 3] = std::array::from_fn(|axis| {
            let along = &geometry.axes[axis];
            along.reached(u[axis], geometry.reach / along.spacing)
        });
        // Whole lanes of each row; what is beyond the kernel's reach or the row's end gets 0.
        let width = whole_lanes(reached[2].len());
        let start = reached[2].start.min(geometry.row - width);
        let window = &mut window[..width];
        for (i, square) in window.iter_mut().enumerate() {
            let along = &geometry.axes[2];
            let distance = if start + i < along.count { along.distance(start + i, u[2]) } else { FAR };
            *square = distance * distance;
        }
        let squared_reach = geometry.reach * geometry.reach;
        for i in reached[0].clone() {
            let from_slab = geometry.axes[0].distance(i, u[0]).powi(2);
            slab_rows.clear();
            let mut rest = &mut *slab;
            for j in reached[1].clone() {
                let from_row = from_slab + geometry.axes[1].distance(j, u[1]).powi(2);
                if from_row >= squared_reach {
                    continue;
                }
                let (row, others) = rest.split_at_mut(width);
                rest = others;
                for (square, along) in row.iter_mut().zip(&*window) {
                    *square = from_row + along;
                }
                slab_rows.push(i * geometry.axes[1].count + j);
            }
            let kernel = &mut slab[..slab_rows.listed().len() * width];
            geometry.kappa.replace_squares::<S>(kernel);
            for (kernel, &row) in kernel.chunks_exact(width.max(1)).zip(slab_rows.listed()) {
                let (kernel, _) = S::as_simd_f64s(kernel);
                for (values, &increment) in nodal_values.iter_mut().zip(increment) {
                    let (values, _) = S::as_mut_simd_f64s(&mut values[row * geometry.row + start..][..width]);
                    let increment = simd.splat_f64s(increment);
                    for (value, &kernel) in values.iter_mut().zip(kernel) {
                        *value = simd.mul_add_e_f64s(kernel, increment, *value);
                    }
                }
                if !touched[row] {
                    touched[row] = true;
                    touched_rows.push(row);
                }
            }
        }
    }
}

/// Beyond this many length scales κ is 0, or below `truncation` κ(0).
fn reach(kappa: &RadialFunction, truncation: f64) -> f64 {
    let smallest = truncation * kappa.value_at_zero();
    let is_beyond = |r: f64| kappa.value(r) <= smallest;
    // A kernel that is never 0, or so far away that no sensor gets there.
    if !is_beyond(100.0) {
        return f64::INFINITY;
    }
    let (mut near, mut far) = (0.0, 100.0);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if is_beyond(middle) { far = middle } else { near = middle }
    }
    far
}

#[cfg(test)]
mod tests;
