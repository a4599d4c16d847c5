//! Adaptive state observation in a vector-valued native space (RKHS): the mathematics only.
//!
//! The observer follows a vehicle's measured velocities, learns the force and torque that nobody
//! modelled (drag, current, wind, a shifted load) as functions of the motion, and coasts on what it
//! learned when a sensor falls silent:
//!
//! ```text
//! x̂' = A x̂ + L (y − C x̂) + B (u + f̂(y)),     f̂ = Σ_j 𝔎(ξ_j, ·) α̂_j,     α̂' = σ(‖ỹ‖) K⁻¹ k(y) (Γ_f ỹ)ᵀ
//! ```
//!
//! | read | for |
//! |---|---|
//! | [`RigidBodyObserver`] | position, velocity, attitude, angular velocity and both unknown wrenches of a vehicle |
//! | [`LinearObserver`] | any linear plant of your own A, B and C |
//! | [`Channel`], [`Law`] | the law itself, to put the paper beside; [`LearnedFunction`] is f̂ |
//! | [`Kernel`], [`Centers`], [`NativeSpace`] | the native space that f̂ is taken from |
//! | [`DeadZone`], [`Plausibility`] | which errors are learned from, and which are believed |
//! | [`DesignReport`], [`Certificate`], [`stability`] | what is proven for a design |
//!
//! What it does for a multicopter in wind with a load that nobody told it of:
#![cfg_attr(doc, doc = concat!("<div style=\"overflow-x:auto\">\n", include_str!("../../../docs/demo.svg"), "</div>\n"))]
//!
//! There is no clock, no file and no shared memory here, and no allocation after construction: time comes
//! in with the samples. [`RigidBodyObserver`] is what flight code uses; [`Channel`] is the law itself.
//!
//! ```
//! use nalgebra::{Matrix3, Vector3};
//! use observer::*;
//!
//! let translation = TranslationDesign {
//!     channel: ChannelDesign {
//!         kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
//!         length_scale: LengthScale::Isotropic(2.0),
//!         centers: Centers::lattice([-1.0; 3], [1.0; 3], [3; 3])?,
//!         nugget: 0.0,
//!         solver: Solver::Dense,
//!         inertia: Matrix3::identity() * 4.0,
//!         gain_per_s: 10.0,
//!         adaptation_rate: Matrix3::identity() * 100.0,
//!         dead_zone: DeadZone::new(DeadZoneShape::Saturated, 1e-4, 1e-4)?,
//!         bounds: DisturbanceBounds::default(),
//!         hold_s: 0.01,
//!         coast_step_s: 0.005,
//!     },
//!     known_force_n: Vector3::zeros(),
//!     velocity_error_to_position: 0.0,
//!     position_fix_gain_per_s: 0.0,
//!     position_fix_hold_s: 0.0,
//! };
//! let mut observer = RigidBodyObserver::new(Some(translation), None, InitialState::default())?;
//!
//! // A body of 4 kg pushed with 2 N along x, against a drag of 0.5 N s/m that the observer is not told of.
//! let (mut v, h) = (0.0, 0.005);
//! for j in 0..4000_u64 {
//!     observer.accept(&Sample {
//!         stamp_ns: j * 5_000_000,
//!         velocity: Some(Velocity::Inertial(Vector3::new(v, 0.0, 0.0))),
//!         force_n: Some(Vector3::new(2.0, 0.0, 0.0)),
//!         ..Sample::default()
//!     });
//!     v += h * (2.0 - 0.5 * v) / 4.0;
//! }
//! let estimate = observer.estimate(3999 * 5_000_000);
//! assert!((estimate.matched_force_n.x + 0.5 * v).abs() < 0.05);
//! # Ok::<(), DesignError>(())
//! ```

mod function;
mod innovation_gate;
mod law;
mod linear_observer;
mod plant;
mod report;
mod rigid_body;
mod space;
mod timeline;

pub use function::learned::{Evaluation, LearnedFunction};
pub use function::solver::{DENSE_UP_TO, LocalSolver, Solver, SolverInUse};
pub use innovation_gate::{Doubt, Plausibility};
pub use law::channel::{Channel, ChannelDesign, DisturbanceBounds, Integrator, Segment};
pub use law::dead_zone::{DeadZone, DeadZoneShape};
pub use law::gradient::{Law, Learning};
pub use law::stability;
pub use linear_observer::{
    LinearDesign, LinearEstimate, LinearObserver, LinearObserverState, LinearOutput, LinearState,
    MAX_OUTPUTS, MAX_STATES,
};
pub use report::box_search::Supremum;
pub use report::certificate::Certificate;
pub use report::design_report::{DesignReport, Finding, LengthScaleEffect, Verdict, length_scale_effect};
pub use report::linear_algebra::LurePair;
pub use rigid_body::{
    GyroscopicTorque, InitialState, RigidBodyEstimate, RigidBodyObserver, RigidBodyState, RotationDesign,
    Sample, TranslationDesign, Velocity,
};
pub use space::centers::{Centers, LatticeBox};
pub use space::factors::lanes::vector_unit;
pub use space::kernel::{Kernel, RadialFunction};
pub use space::native_space::{FeatureBuffers, LengthScale, NativeSpace, ScaledKernel};
pub use timeline::ChannelReport;

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
    /// `hold_s`.
    Hold,
    /// `coast_step_s`.
    CoastStep,
    /// Gain or hold of a position or attitude fix, or the velocity error's way into the position.
    Fix,
    /// No channel was asked for.
    Channels,
    /// A of a linear plant.
    Plant,
    /// B of a linear plant.
    PlantInput,
    /// C of a linear plant.
    PlantOutput,
    /// x̂(0) of a linear plant.
    InitialState,
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
