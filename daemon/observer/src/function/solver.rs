//! The choice of solver: dense (all centers at every step) or local (the centers around the output).

use crate::error::{DesignError, Parameter};
use crate::space::centers::Centers;

/// Dense, local, or by the number of centers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Solver {
    /// Exact: every step reads the whole triangular factor, 4 N² bytes; of a lattice of three axes N²/2.
    Dense,
    /// From the lattice points around the output, with an error estimate for every evaluation: a cost that hardly
    /// grows with N. For lattices of one to three axes.
    Local(LocalSolver),
    /// Dense up to [`DENSE_UP_TO`] centers, local beyond. Without a local solver it is dense longer: for more than three
    /// outputs always, for listed centers up to [`DENSE_UP_TO_LISTED`], beyond which they are refused.
    Auto(LocalSolver),
}

/// Options of the local solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalSolver {
    /// Lattice points along each axis of the block from which f̂(y) is evaluated, even, 4 … 12; `None` takes the
    /// smallest that reaches `accuracy`.
    pub block: Option<usize>,
    /// Relative error (RMS over random histories of updates) that the block is chosen for.
    pub accuracy: f64,
    /// A kernel without compact support is cut off where κ(r) falls below this multiple of κ(0); 0 never cuts, and
    /// every update visits all centers.
    pub truncation: f64,
}

impl Default for LocalSolver {
    fn default() -> Self {
        Self { block: None, accuracy: 5e-3, truncation: 0.0 }
    }
}

/// Up to this many centers, `Solver::Auto` is exact.
pub const DENSE_UP_TO: usize = 2000;
/// Up to this many listed centers, `Solver::Auto` is exact: more of them cost so much a step that `Solver::Dense` has to
/// be asked for.
pub const DENSE_UP_TO_LISTED: usize = 3000;

/// The chosen solver.
#[derive(Debug, Clone, PartialEq)]
pub enum SolverInUse {
    /// From all centers.
    Dense,
    /// From a block of lattice points.
    Local {
        /// Points along each axis.
        block: Vec<usize>,
        /// RMS of the error over that of f̂ that is predicted for random histories of updates.
        predicted_error: f64,
    },
}

impl std::fmt::Display for SolverInUse {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Dense => f.write_str("dense, exact"),
            Self::Local { block, predicted_error } => {
                let points: Vec<_> = block.iter().map(usize::to_string).collect();
                write!(
                    f,
                    "local, from a block of {} centers; error about {predicted_error:.1e} of f̂ (RMS, random updates)",
                    points.join("×")
                )
            }
        }
    }
}

impl Solver {
    /// The options of the local solver, where that is the one to use for these centers.
    pub(crate) fn local(&self, centers: &Centers) -> Option<LocalSolver> {
        match *self {
            Self::Dense => None,
            Self::Local(options) => Some(options),
            Self::Auto(options) => {
                let is_lattice = centers.lattice_box().is_some();
                let dense_up_to = if is_lattice { DENSE_UP_TO } else { DENSE_UP_TO_LISTED };
                (centers.n_centers() > dense_up_to && centers.dimension() <= 3).then_some(options)
            }
        }
    }
}

impl LocalSolver {
    pub(crate) fn check(&self, dimension: usize) -> Result<(), DesignError> {
        let refuse = |found: String, needed: &str| Err(DesignError::new(Parameter::Solver, found, needed));
        if dimension > 3 {
            return refuse(
                format!("a local solver for {dimension} outputs"),
                "at most 3, or the dense solver",
            );
        }
        if let Some(block) = self.block.filter(|block| !(4..=12).contains(block) || block % 2 == 1) {
            return refuse(format!("a block of {block} points per axis"), "an even number from 4 to 12");
        }
        if !(self.accuracy.is_finite() && self.accuracy > 0.0) {
            return refuse(format!("an accuracy of {}", self.accuracy), "a finite number > 0");
        }
        if !(0.0..1.0).contains(&self.truncation) {
            let found = format!("a truncation at {} κ(0)", self.truncation);
            return refuse(found, "a number from 0 to below 1");
        }
        Ok(())
    }
}

/// The factor on the norm of a block's outermost layer, in the estimate of the local solver's error.
const SHARE_OF_LAYER: f64 = 2.0;
/// ε: the factor on ‖f̂_N‖ in that estimate, for m = 1, 2, 3.
const SHARE_OF_NORM: [f64; 3] = [1.0, 0.25, 0.0625];

/// `min(‖f̂‖, 2 ‖θ_layer‖ + ε ‖f̂‖)`: an estimate of the norm of f̂ around a block of m axes.
pub(crate) fn surroundings_norm(dimension: usize, layer: f64, norm: f64) -> f64 {
    norm.min(SHARE_OF_LAYER * layer + SHARE_OF_NORM[dimension - 1] * norm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::function::lattice::LatticeFunction;
    use crate::space::kernel::Kernel;
    use crate::space::scaled_kernel::LengthScale;

    fn listed(n: u32) -> Centers {
        Centers::listed((0..n).map(|j| [f64::from(j)]).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn auto_is_dense_where_there_is_no_local_solver_and_refuses_more_listed_centers_than_it_should() {
        let auto = Solver::Auto(LocalSolver::default());
        let lattice = |n: usize| Centers::lattice([0.0], [1.0], [n]).unwrap();
        assert_eq!(auto.local(&lattice(2000)), None);
        assert!(auto.local(&lattice(2001)).is_some());
        assert_eq!(auto.local(&listed(2001)), None);
        assert_eq!(auto.local(&listed(3000)), None);
        let options = auto.local(&listed(3001)).unwrap();
        let space = (Kernel::Gaussian, &LengthScale::Isotropic(1.0));
        let refused =
            LatticeFunction::<1>::zero(space, &listed(3001), 0.0, &options).unwrap_err().to_string();
        for needed in ["3001 listed centers", "solver = \"dense\""] {
            assert!(refused.contains(needed), "{refused}");
        }
    }
}
