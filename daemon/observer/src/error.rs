//! The error of a design that cannot be used.

/// The parameter of a design that cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// `kernel`.
    Kernel,
    /// `length_scale`.
    LengthScale,
    /// `nugget`.
    Nugget,
    /// `solver`.
    Solver,
    /// `centers`.
    Centers,
    /// `gain_per_s`.
    Gain,
    /// `adaptation_rate`.
    AdaptationRate,
    /// `inertia`.
    Inertia,
    /// The dead zone's width.
    DeadZoneWidth,
    /// The dead zone's buffer.
    DeadZoneBuffer,
    /// The bound on the measurement error.
    NoiseBound,
    /// The bound on the unmatched disturbance.
    UnmatchedBound,
    /// The bound on the part of f that the centers cannot represent.
    ResidualNorm,
    /// The bound on the norm of f̂.
    MaxNorm,
    /// `hold_s`.
    Hold,
    /// `coast_step_s`.
    CoastStep,
    /// Gain or hold of a position or attitude fix, or the gain from the velocity error to the position.
    Fix,
    /// The design has no channel.
    Channels,
    /// A of a linear plant.
    Plant,
    /// B of a linear plant.
    PlantInput,
    /// C of a linear plant.
    PlantOutput,
    /// x̂(0) of a linear plant.
    InitialState,
    /// A parameter of the joint law, by the name of its field.
    Joint(&'static str),
}

/// Why a design cannot be used: what was found, and what would be accepted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{parameter:?}: found {found}; needed: {needed}")]
pub struct DesignError {
    /// Which parameter.
    pub parameter: Parameter,
    /// What it is.
    pub found: String,
    /// What would be accepted.
    pub needed: String,
}

impl DesignError {
    pub(crate) fn new(parameter: Parameter, found: String, needed: impl Into<String>) -> Self {
        Self { parameter, found, needed: needed.into() }
    }
}
