//! f̂_N with one interface for all coordinates: hold an output, evaluate f̂ there or elsewhere, and learn an increment `in`,
//! `f̂ ← f̂ + Π_N 𝔎(·, y) in`.

use crate::error::DesignError;
use crate::function::checkpoint::Learned;
use crate::function::dense::DenseFunction;
use crate::function::evaluation::Evaluation;
use crate::function::lattice::LatticeFunction;
use crate::function::solver::{Solver, SolverInUse};
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use crate::space::native_space::NativeSpace;
use crate::space::scaled_kernel::LengthScale;
use nalgebra::SVector;

/// f̂_N with values in ℝ^m, m ≤ M; what is beyond m is zero. Everything is allocated at construction.
#[derive(Debug, Clone)]
pub struct LearnedFunction<const M: usize> {
    kind: Kind<M>,
    /// m.
    n_outputs: usize,
}

#[derive(Debug, Clone)]
enum Kind<const M: usize> {
    Dense(Box<DenseFunction<M>>),
    Lattice(Box<LatticeFunction<M>>),
}

/// The same call for each kind.
macro_rules! each {
    ($function:expr, $inner:ident => $call:expr) => {
        match $function {
            Kind::Dense($inner) => $call,
            Kind::Lattice($inner) => $call,
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
        let kind = match solver.local(centers) {
            None => {
                let space = NativeSpace::new(kernel, length_scale, centers.clone(), nugget)?;
                Kind::Dense(Box::new(DenseFunction::zero(space)))
            }
            Some(options) => {
                let function = LatticeFunction::zero((kernel, length_scale), centers, nugget, &options)?;
                Kind::Lattice(Box::new(function))
            }
        };
        Ok(Self { kind, n_outputs: centers.dimension() })
    }

    /// Takes an output y, at which f̂ is then evaluated and learned; entries beyond m are ignored.
    pub(crate) fn hold(&mut self, output: &[f64]) {
        each!(&mut self.kind, f => f.hold(&output[..self.n_outputs]));
    }

    /// f̂ at the held output, of what is learned by now.
    pub(crate) fn held(&mut self) -> Evaluation<M> {
        each!(&mut self.kind, f => f.held())
    }

    /// f̂ at another point, as if `pending` had been learned at the held output.
    pub(crate) fn at(&mut self, point: &[f64], pending: &SVector<f64, M>) -> Evaluation<M> {
        each!(&mut self.kind, f => f.at(&point[..self.n_outputs], pending))
    }

    /// f̂ ← f̂ + Π_N 𝔎(·, y) in, y the held output.
    pub(crate) fn learn(&mut self, increment: &SVector<f64, M>) {
        each!(&mut self.kind, f => f.learn(increment));
    }

    /// Zero again; the checkpoint stays.
    pub(crate) fn forget(&mut self) {
        each!(&mut self.kind, f => f.forget());
    }

    /// Makes what is learned by now the checkpoint.
    pub(crate) fn save(&mut self) {
        each!(&mut self.kind, f => f.save());
    }

    /// Puts back the checkpoint.
    pub(crate) fn restore(&mut self) {
        each!(&mut self.kind, f => f.restore());
    }

    /// How many numbers a checkpoint holds.
    pub(crate) fn n_learned(&self) -> usize {
        each!(&self.kind, f => f.saved().n_numbers())
    }

    /// The numbers of the checkpoint from `from` on, as many as `into` has room for.
    pub(crate) fn read_saved(&self, from: usize, into: &mut [f64]) {
        each!(&self.kind, f => f.saved().read(from, into));
    }

    /// Takes the checkpoint of another function of the same design, as learned and as its own checkpoint.
    pub(crate) fn load(&mut self, numbers: &[f64]) {
        each!(&mut self.kind, f => f.load(numbers));
    }

    /// What is learned by now; `None` of the local solver, whose copy would take too long between two deadlines.
    pub(crate) fn learned(&self) -> Option<&Learned<M, 1>> {
        match &self.kind {
            Kind::Dense(function) => Some(function.learned()),
            Kind::Lattice(_) => None,
        }
    }

    /// Takes what was learned by the time of a copy. Nothing with the local solver.
    pub(crate) fn set_learned(&mut self, learned: &Learned<M, 1>) {
        if let Kind::Dense(function) = &mut self.kind {
            function.set_learned(learned);
        }
    }

    /// m.
    pub fn n_outputs(&self) -> usize {
        self.n_outputs
    }

    /// The smallest box around the centers: its lower and its upper corner.
    pub fn bounding_box(&self) -> (&[f64], &[f64]) {
        each!(&self.kind, f => f.bounding_box())
    }

    /// ‖f̂_N‖_H.
    pub fn native_norm(&self) -> f64 {
        each!(&self.kind, f => f.native_norm())
    }

    /// q of the norm's recursion at the held output, `‖f̂ + Π_N 𝔎(·, y) in‖² = ‖f̂‖² + 2 f̂(y)ᵀin + q |in|²`: φᵀφ, or an upper
    /// bound on it with the local solver.
    pub(crate) fn norm_coefficient(&self) -> f64 {
        each!(&self.kind, f => f.norm_coefficient())
    }

    /// H_N; of the local solver, the space of one block: K's condition is at least its, and P_N at most its.
    pub fn space(&self) -> &NativeSpace {
        each!(&self.kind, f => f.space())
    }

    /// θ of the dense solver, one run of whole lanes per output; empty for a local one.
    pub fn weights(&self) -> &[Vec<f64>] {
        match &self.kind {
            Kind::Dense(function) => function.weights(),
            Kind::Lattice(_) => &[],
        }
    }

    /// The solver that was chosen.
    pub fn solver(&self) -> SolverInUse {
        match &self.kind {
            Kind::Dense(_) => SolverInUse::Dense,
            Kind::Lattice(function) => {
                SolverInUse::Local { block: function.block(), predicted_error: function.predicted_error() }
            }
        }
    }

    /// Bytes that are held.
    pub fn bytes(&self) -> usize {
        each!(&self.kind, f => f.bytes())
    }

    /// Bytes that a step reads.
    pub fn bytes_of_step(&self) -> usize {
        each!(&self.kind, f => f.bytes_of_step())
    }
}

#[cfg(test)]
mod tests;
