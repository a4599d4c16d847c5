//! The plant of a rigid body's channel: a velocity, and the pose that is integrated from it.

use crate::plant::integrator::{Integrator, Segment};
use crate::plant::nominal::{Moment, Plant};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// What is integrated from a velocity: a position, an attitude, or nothing.
pub trait Kinematics: Copy {
    /// The pose after a segment that starts at `start_ns`.
    fn after(&self, segment: &Segment, start_ns: u64) -> Self;
    /// The same pose, with the gains of another.
    fn with_gains_of(self, other: &Self) -> Self;
}

/// No pose: the velocity alone.
impl Kinematics for () {
    fn after(&self, _: &Segment, _: u64) {}
    fn with_gains_of(self, (): &()) {}
}

/// Velocity and position, or angular velocity and attitude.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BodyState<K> {
    /// v̂, inertial (m/s), or ω̂, body axes (rad/s).
    pub rate: Vector3<f64>,
    /// What is integrated from it.
    pub pose: K,
}

/// Forces that need no learning, added to the input.
#[derive(Debug, Clone, Copy)]
pub(crate) enum KnownForce {
    /// Gravity, buoyancy.
    Constant(Vector3<f64>),
    /// −ω × Iω, from the estimate at the start of a step.
    Gyroscopic(Matrix3<f64>),
}

impl KnownForce {
    pub(crate) fn at(&self, rate: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Constant(force) => *force,
            Self::Gyroscopic(inertia) => -rate.cross(&(inertia * rate)),
        }
    }
}

/// `M v' = u + known force + f`, and a pose K.
#[derive(Debug, Clone, Copy)]
pub struct Body<K> {
    integrator: Integrator,
    known_force: KnownForce,
    /// Output estimate at the first output; `None` takes the output itself.
    initial_rate: Option<Vector3<f64>>,
    pose: std::marker::PhantomData<K>,
}

impl<K: Kinematics> Body<K> {
    pub(crate) fn new(
        integrator: Integrator,
        known_force: KnownForce,
        initial_rate: Option<Vector3<f64>>,
    ) -> Self {
        Self { integrator, known_force, initial_rate, pose: std::marker::PhantomData }
    }

    /// The integrator of the velocity.
    pub fn integrator(&self) -> &Integrator {
        &self.integrator
    }
}

fn after<K: Kinematics>(from: &Moment<BodyState<K>>, segment: &Segment) -> BodyState<K> {
    BodyState { rate: segment.end, pose: from.state.pose.after(segment, from.stamp_ns) }
}

impl<K: Kinematics> Plant<3> for Body<K> {
    type State = BodyState<K>;

    fn output(&self, state: &BodyState<K>) -> Vector3<f64> {
        state.rate
    }

    fn start(&self, waiting: &BodyState<K>, output: &Vector3<f64>) -> BodyState<K> {
        BodyState { rate: self.initial_rate.unwrap_or(*output), pose: waiting.pose }
    }

    fn at_output(&self, state: &BodyState<K>, output: &Vector3<f64>) -> BodyState<K> {
        BodyState { rate: *output, pose: state.pose }
    }

    fn follow(
        &mut self,
        from: &Moment<BodyState<K>>,
        output: &Vector3<f64>,
        force: &Vector3<f64>,
        h_s: f64,
    ) -> BodyState<K> {
        let rate = &from.state.rate;
        let force = force + self.known_force.at(rate);
        after(from, &self.integrator.follow(rate, output, &force, h_s))
    }

    fn coast(&mut self, from: &Moment<BodyState<K>>, force: &Vector3<f64>, h_s: f64) -> BodyState<K> {
        let rate = &from.state.rate;
        let force = force + self.known_force.at(rate);
        after(from, &self.integrator.coast(rate, &force, h_s))
    }

    fn loaded(&self, own: &BodyState<K>, saved: &BodyState<K>) -> BodyState<K> {
        BodyState { rate: saved.rate, pose: saved.pose.with_gains_of(&own.pose) }
    }
}
