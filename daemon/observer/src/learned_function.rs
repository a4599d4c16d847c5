//! f̂_N behind one interface, whatever its coordinates: an output is held, f̂ is evaluated there or elsewhere, and an
//! increment `in` is learned, `f̂ ← f̂ + Π_N 𝔎(·, y) in`.

use crate::dense_function::DenseFunction;
use crate::lattice_function::LatticeFunction;
use crate::{Centers, DesignError, Kernel, LengthScale, NativeSpace, Solver, SolverInUse};
use nalgebra::SVector;

/// f̂ at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evaluation<const M: usize> {
    /// f̂(y), in the input's unit.
    pub value: SVector<f64, M>,
    /// φᵀφ = κ(0) − P²: what an increment of 1 that is learned here adds to f̂ here.
    pub squared_features: f64,
    /// How far the value may be from that of the dense solver, in the input's unit; 0 where it is dense.
    pub error: f64,
    /// What an increment of 1 that is learned here adds to the error at most.
    pub error_of_increment: f64,
}

impl<const M: usize> Evaluation<M> {
    /// Of the dense solver.
    pub(crate) fn exact(value: SVector<f64, M>, squared_features: f64) -> Self {
        Self { value, squared_features, error: 0.0, error_of_increment: 0.0 }
    }
}

/// f̂_N with values in ℝ^m, m ≤ M; what is beyond m is zero. Everything is allocated at construction.
#[derive(Debug, Clone)]
pub(crate) enum LearnedFunction<const M: usize> {
    Dense(Box<DenseFunction<M>>),
    Lattice(Box<LatticeFunction<M>>),
}

/// The same call for each kind.
macro_rules! each {
    ($function:expr, $inner:ident => $call:expr) => {
        match $function {
            Self::Dense($inner) => $call,
            Self::Lattice($inner) => $call,
        }
    };
}

impl<const M: usize> LearnedFunction<M> {
    /// Zero, with the solver that the design asks for.
    ///
    /// # Errors
    /// As [`NativeSpace::new`]; `Solver` where the local one has no answer for these centers or options.
    pub(crate) fn zero(
        (kernel, length_scale): (Kernel, &LengthScale),
        centers: &Centers,
        nugget: f64,
        solver: &Solver,
    ) -> Result<Self, DesignError> {
        match solver.local(centers) {
            None => {
                let space = NativeSpace::new(kernel, length_scale, centers.clone(), nugget)?;
                Ok(Self::Dense(Box::new(DenseFunction::zero(space))))
            }
            Some(options) => {
                let function = LatticeFunction::zero((kernel, length_scale), centers, nugget, &options)?;
                Ok(Self::Lattice(Box::new(function)))
            }
        }
    }

    /// Takes an output y, at which f̂ is then evaluated and learned.
    pub(crate) fn hold(&mut self, output: &[f64]) {
        each!(self, f => f.hold(output));
    }

    /// f̂ at the held output, of what is learned by now.
    pub(crate) fn held(&mut self) -> Evaluation<M> {
        each!(self, f => f.held())
    }

    /// f̂ at another point, as if `pending` had been learned at the held output.
    pub(crate) fn at(&mut self, point: &[f64], pending: &SVector<f64, M>) -> Evaluation<M> {
        each!(self, f => f.at(point, pending))
    }

    /// f̂ ← f̂ + Π_N 𝔎(·, y) in, y the held output.
    pub(crate) fn learn(&mut self, increment: &SVector<f64, M>) {
        each!(self, f => f.learn(increment));
    }

    /// Zero again.
    pub(crate) fn forget(&mut self) {
        each!(self, f => f.forget());
    }

    /// Keeps what is learned by now, beside the function.
    pub(crate) fn keep_good_copy(&mut self) {
        each!(self, f => f.keep_good_copy());
    }

    /// Puts back what was kept last.
    pub(crate) fn restore_good_copy(&mut self) {
        each!(self, f => f.restore_good_copy());
    }

    /// ‖f̂_N‖_H.
    pub(crate) fn native_norm(&self) -> f64 {
        each!(self, f => f.native_norm())
    }

    /// H_N; of the local solver, the space of one block: K's condition is at least its, and P_N at most its.
    pub(crate) fn space(&self) -> &NativeSpace {
        each!(self, f => f.space())
    }

    /// The solver that was chosen.
    pub(crate) fn solver(&self) -> SolverInUse {
        match self {
            Self::Dense(_) => SolverInUse::Dense,
            Self::Lattice(function) => {
                SolverInUse::Local { block: function.block(), predicted_error: function.predicted_error() }
            }
        }
    }

    /// Bytes that are held.
    pub(crate) fn bytes(&self) -> usize {
        each!(self, f => f.bytes())
    }

    /// Bytes that a step reads.
    pub(crate) fn bytes_of_step(&self) -> usize {
        each!(self, f => f.bytes_of_step())
    }
}
