//! Adaptive state observation in a vector-valued native space (RKHS): the mathematics only.
//!
//! The observer follows a vehicle's measured velocities, learns the force and torque that are not
//! modelled (drag, current, wind, a shifted load) as functions of the motion, and coasts on what was
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
//! | [`Channel`], [`GradientLaw`] | the law itself, to compare with the paper; [`LearnedFunction`] is f̂ |
//! | [`JointChannel`], [`JointFilter`] | the joint filter, which also has deviations; the observers do not use it yet |
//! | [`Kernel`], [`Centers`], [`NativeSpace`] | the native space that f̂ is an element of |
//! | [`DeadZone`], [`InnovationGate`] | which errors are learned from, and which outputs are accepted |
//! | [`DesignReport`], [`Certificate`], [`stability`] | what is proven for a design |
//!
//! A multicopter in wind with an unknown load:
#![cfg_attr(doc, doc = concat!("<div style=\"overflow-x:auto\">\n", include_str!("../../../docs/demo.svg"), "</div>\n"))]
//!
//! The crate has no clock, no file and no shared memory, and allocates nothing after construction. Time is an argument, the
//! stamp of each sample. Flight code uses [`RigidBodyObserver`]; [`Channel`] is the law itself.
//!
//! The crate depends on no other crate of this repository. Inside, a file depends only on those above it in this list:
//!
//! | room | what lives there |
//! |---|---|
//! | `error`, `space/` | kernel, centers, native space, factors of the Gram matrix |
//! | `function/` | f̂_N: evaluation, dense and local coordinates, what a checkpoint holds of it |
//! | `plant/` | body, position, attitude, linear plant, over one step with held inputs |
//! | `design`, `linear_design`, `law/` | the designs; dead zone, gradient law, stability; the channel: the step |
//! | `report/` | certificate, design report: what is proven, at set-up only |
//! | `innovation_gate`, `timeline` | outliers; holding, coasting, committing by the samples' stamps |
//! | `law/joint/`, `joint_channel` | the joint filter, and a channel of the body with it on the samples' time line |
//! | `channels` | the channels by name, with one trait: save, restore, load, restart, forget |
//! | `rigid_body`, `linear_observer` | the observers |
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
//!         options: GradientOptions::default(),
//!         bounds: DisturbanceBounds::default(),
//!         hold_s: 0.01,
//!         coast_step_s: 0.005,
//!     },
//!     known_force_n: Vector3::zeros(),
//!     velocity_error_to_position: 0.0,
//!     position_fix_gain_per_s: 0.0,
//!     position_fix_hold_s: 0.0,
//! };
//! let mut observer = RigidBodyObserver::new(Some(translation.into()), None, InitialState::default())?;
//!
//! // A body of 4 kg pushed with 2 N along x, against a drag of 0.5 N s/m that the observer does not know.
//! let (mut v, h) = (0.0, 0.005);
//! for j in 0..4000_u64 {
//!     observer.accept(&Sample {
//!         stamp_ns: j * 5_000_000,
//!         velocity: Some(Velocity::Inertial(Vector3::new(v, 0.0, 0.0))),
//!         force_n: Some(Vector3::new(2.0, 0.0, 0.0)),
//!         ..Sample::default()
//!     }, Learn::ALL);
//!     v += h * (2.0 - 0.5 * v) / 4.0;
//! }
//! let estimate = observer.estimate(3999 * 5_000_000);
//! assert!((estimate.matched_force_n.x + 0.5 * v).abs() < 0.05);
//! # Ok::<(), DesignError>(())
//! ```

#[cfg(test)]
extern crate self as observer;

mod channels;
mod design;
#[cfg(test)]
#[path = "../tests/guarantees/designs.rs"]
mod designs;
mod error;
mod function;
mod innovation_gate;
mod joint_channel;
mod law;
mod linear_design;
mod linear_observer;
mod plant;
mod report;
mod rigid_body;
mod space;
mod timeline;

pub use channels::{AnyChannel, ChannelName, ChannelState, Learn};
pub use design::{
    ChannelDesign, DisturbanceBounds, FeaturePoint, GradientOptions, GyroscopicTorque, RotationDesign,
    TranslationDesign,
};
pub use error::{DesignError, Parameter};
pub use function::evaluation::Evaluation;
pub use function::learned::LearnedFunction;
pub use function::solver::{DENSE_UP_TO, DENSE_UP_TO_LISTED, LocalSolver, Solver, SolverInUse};
pub use innovation_gate::{InnovationGate, OutlierAction};
pub use joint_channel::checkpoint::JointChannelState;
pub use joint_channel::{
    JointChannel, JointChannelDesign, JointEstimate, JointRotationDesign, JointSample, JointTranslationDesign,
};
pub use law::channel::{Ahead, BodyChannel, Channel};
pub use law::dead_zone::{DeadZone, DeadZoneShape};
pub use law::gradient::{GradientLaw, HeldOutput, Learning};
pub use law::joint::design::{
    AccelerometerDesign, BodyAxesDesign, ExcitationDesign, JointDesign, PriorDeviations,
};
pub use law::joint::filter::JointFilter;
pub use law::joint::predict::{JointPrediction, LearnedAcceleration};
pub use law::joint::sensor::{MAX_SENSORS, Outliers, SensorUse};
pub use law::joint::state::JointState;
pub use law::joint::teaches::Teaches;
pub use law::joint::update::Agreement;
pub use law::stability;
pub use linear_design::LinearDesign;
pub use linear_observer::{LinearEstimate, LinearObserver};
pub use plant::attitude_filter::{AttitudeFilter, JointPose, PoseStep};
pub use plant::body::{Body, BodyState};
pub use plant::integrator::{Integrator, Segment};
pub use plant::linear::{LinearOutput, LinearState, MAX_OUTPUTS, MAX_STATES};
pub use plant::nominal::{Moment, Plant};
pub use report::box_search::Supremum;
pub use report::certificate::Certificate;
pub use report::cover::{LengthScaleEffect, length_scale_effect};
pub use report::design_report::DesignReport;
pub use report::findings::{Finding, Verdict};
pub use report::joint_report::{ExpectedStd, JointReport};
pub use report::lure_pair::LurePair;
pub use rigid_body::{
    Deviations, InitialState, Quality, RigidBodyEstimate, RigidBodyObserver, RotationLaw, Sample,
    TranslationLaw, Velocity,
};
pub use space::centers::{Centers, LatticeBox};
pub use space::factors::lanes::vector_unit;
pub use space::kernel::{Kernel, RadialFunction};
pub use space::native_space::{FeatureBuffers, NativeSpace};
pub use space::scaled_kernel::{LengthScale, ScaledKernel};
pub use timeline::ChannelReport;
