//! The value of f̂ at a point.

use nalgebra::SVector;

/// f̂ at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evaluation<const M: usize> {
    /// f̂(y), in the input's unit.
    pub value: SVector<f64, M>,
    /// φᵀφ = κ(0) − P²: what an increment of 1 that is learned here adds to f̂ here.
    pub squared_features: f64,
    /// Estimated difference of the value from that of the dense solver, in the input's unit; 0 where it is dense.
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
