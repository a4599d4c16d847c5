//! Calibrates the error estimate of the local solver at construction: compares a block with a larger one around it.

use crate::error::DesignError;
use crate::function::block::{BlockBuffers, IMAGES, LatticeBlock};
use crate::space::kernel::RadialFunction;

/// The larger block that stands for the lattice has this many more points on each side.
const SURROUNDINGS: usize = 3;
/// Beyond an edge of the lattice ‖q‖/P_c was found to be a sixth larger than in the middle cell, where it is sampled.
const SAFETY: f64 = 1.25;
/// Outputs and updates that the error is predicted from.
const CALIBRATION_OUTPUTS: usize = 64;
const CALIBRATION_UPDATES: usize = 192;

/// A block, and its distance from the whole lattice, estimated with a larger block around it.
pub(crate) struct Calibration {
    pub(crate) block: LatticeBlock,
    /// ρ: [`SAFETY`] times the largest ‖q‖/P_c over the middle cell.
    pub(crate) error_ratio: f64,
    /// RMS of ⟨𝔎(·, z), q⟩ over that of Π_N 𝔎(y, z), y in the middle cell and z anywhere around it.
    pub(crate) relative_error: f64,
    /// The largest Σ_j |w_j| found, f̂(y) = Σ_j w_j β_j, in the block and up to 1.5 spacings outside.
    pub(crate) largest_weights: f64,
}

impl Calibration {
    /// Of a block with `counts` points along the axes of a lattice, of which the count and the spacing (length scales)
    /// are given.
    pub(crate) fn of(
        counts: [usize; 3],
        lattice: [(usize, f64); 3],
        kappa: &RadialFunction,
        nugget: f64,
    ) -> Result<Self, DesignError> {
        let spacing = lattice.map(|(_, spacing)| spacing);
        let is_part: [bool; 3] = std::array::from_fn(|axis| counts[axis] < lattice[axis].0);
        let block = LatticeBlock::new(counts, is_part, spacing, kappa, nugget)?;
        // k of u, which is in points from the block's point at `margin`.
        let see_from = |block: &LatticeBlock, buffers: &mut BlockBuffers, u: [f64; 3], margin: [usize; 3]| {
            for (k, point) in buffers.vector(0).iter_mut().zip(block.points()) {
                let distance = |a: usize| (f64::from(point[a]) - margin[a] as f64 - u[a]) * spacing[a];
                *k = kappa.value((0..3).map(|a| distance(a).powi(2)).sum::<f64>().sqrt());
            }
        };
        let largest_weights = {
            let mut buffers = BlockBuffers::new(&block);
            let sum_of_weights = |u: [f64; 3]| -> f64 {
                let n = IMAGES * block.n_padded();
                // w_j is f̂(u) for β = 1 at one point and 0 elsewhere.
                let weight = |j: usize, buffers: &mut BlockBuffers| {
                    see_from(&block, buffers, u, [0; 3]);
                    let point = block.points()[j];
                    for (beta, other) in buffers.vector(1).iter_mut().zip(block.points()) {
                        *beta = f64::from(u8::from(*other == point));
                    }
                    block.evaluate(buffers).values[0].abs()
                };
                (0..n).map(|j| weight(j, &mut buffers)).sum()
            };
            // In the block, and beyond its first corner.
            let inside = |x: f64| std::array::from_fn(|axis| x * (counts[axis] - 1) as f64);
            let outside = |x: f64| std::array::from_fn(|axis| if counts[axis] > 1 { -x } else { 0.0 });
            let points = [inside(0.5), inside(0.4), inside(0.15), outside(0.5), outside(1.0), outside(1.5)];
            points.into_iter().map(sum_of_weights).fold(0.0, f64::max)
        };
        if is_part == [false; 3] {
            return Ok(Self { block, error_ratio: 0.0, relative_error: 0.0, largest_weights });
        }
        // Where the lattice ends sooner, a larger one is no worse.
        let margin: [usize; 3] =
            std::array::from_fn(|axis| (lattice[axis].0 - counts[axis]).div_ceil(2).min(SURROUNDINGS));
        let larger = LatticeBlock::new(
            std::array::from_fn(|axis| counts[axis] + 2 * margin[axis]),
            [false; 3],
            spacing,
            kappa,
            nugget,
        )?;
        let value_at_zero = kappa.value_at_zero();
        let (mut in_block, mut in_larger) = (BlockBuffers::new(&block), BlockBuffers::new(&larger));
        // φ at u, in points from the first one of the block.
        let mut features = |u: [f64; 3]| {
            let of = |block: &LatticeBlock, buffers: &mut BlockBuffers, margin: [usize; 3]| {
                see_from(block, buffers, u, margin);
                let squares = block.evaluate(buffers).squared_features;
                (buffers.features().to_vec(), (value_at_zero - squares).max(0.0))
            };
            (of(&block, &mut in_block, [0; 3]), of(&larger, &mut in_larger, margin))
        };
        // Roberts' sequence: even cover of a cube.
        let cube = |i: usize| -> [f64; 3] {
            let ratio = 1.220_744_084_605_759_5_f64;
            std::array::from_fn(|axis| (0.5 + i as f64 * ratio.powi(-(axis as i32 + 1))).fract())
        };
        let in_cell = |i: usize| -> [f64; 3] {
            let at = cube(i);
            std::array::from_fn(|axis| match (is_part[axis], counts[axis]) {
                (true, c) => (c / 2 - 1) as f64 + at[axis],
                (false, c) => (c - 1) as f64 * at[axis],
            })
        };
        let around = |i: usize| -> [f64; 3] {
            let at = cube(i);
            std::array::from_fn(|axis| {
                let margin = margin[axis] as f64;
                (counts[axis] as f64 - 1.0 + 2.0 * margin) * at[axis] - margin
            })
        };
        let outputs: Vec<_> = (0..CALIBRATION_OUTPUTS).map(|i| features(in_cell(i))).collect();
        let learned: Vec<_> = (0..CALIBRATION_UPDATES).map(|i| features(around(i))).collect();
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        let (mut error_ratio, mut errors, mut values) = (0.0_f64, 0.0, 0.0);
        for ((block, squared_power), (larger, smaller_power)) in &outputs {
            // Beside a center both are rounding noise.
            if *squared_power > 1e-9 * value_at_zero {
                let ratio = (squared_power - smaller_power).max(0.0) / squared_power;
                error_ratio = error_ratio.max(SAFETY * ratio.sqrt());
            }
            for ((block_there, _), (larger_there, _)) in &learned {
                let value = dot(larger, larger_there);
                values += value * value;
                errors += (value - dot(block, block_there)).powi(2);
            }
        }
        Ok(Self { block, error_ratio, relative_error: (errors / values).sqrt(), largest_weights })
    }
}
