//! The trait of a nominal plant: what a channel needs of it.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// `x̂' = A x̂ + L (y − C x̂) + B F` with at most M outputs: the rigid body, or a linear plant.
pub trait Plant<const M: usize> {
    /// x̂, and what is integrated along with it.
    type State: Copy;

    /// C x̂.
    fn output(&self, state: &Self::State) -> SVector<f64, M>;

    /// The state at the first output, from the one before it.
    fn start(&self, waiting: &Self::State, output: &SVector<f64, M>) -> Self::State;

    /// The state with C x̂ = y that is nearest to this one: after an outage.
    fn at_output(&self, state: &Self::State, output: &SVector<f64, M>) -> Self::State;

    /// The state after a step of `h_s` with the held `output` and `force` = u + f̂: `x̂' = A x̂ + L (y − C x̂) + B F`.
    fn follow(
        &mut self,
        from: &Moment<Self::State>,
        output: &SVector<f64, M>,
        force: &SVector<f64, M>,
        h_s: f64,
    ) -> Self::State;

    /// The same without an output: `x̂' = A x̂ + B F`.
    fn coast(&mut self, from: &Moment<Self::State>, force: &SVector<f64, M>, h_s: f64) -> Self::State;

    /// The state of a checkpoint, with the gains of `own`: these belong to the design.
    fn loaded(&self, own: &Self::State, saved: &Self::State) -> Self::State;
}

/// The state at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moment<S> {
    /// Time of the state (ns).
    pub stamp_ns: u64,
    /// x̂, and what is integrated along with it.
    pub state: S,
}
