//! A channel of the rigid body as the time line sees it: the velocity, and the pose that is integrated from it.

use crate::law::channel::{Integrator, Segment};
use crate::timeline::{Moment, Plant};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// What is integrated from a channel's output: a position, or an attitude.
pub(crate) trait Kinematics: Copy {
    /// The pose after a segment that starts at `start_ns`.
    fn after(&self, segment: &Segment, start_ns: u64) -> Self;
    /// The same pose, with the gains of another.
    fn with_gains_of(self, other: &Self) -> Self;
}

/// Velocity and position, or angular velocity and attitude.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct BodyState<K> {
    pub(crate) rate: Vector3<f64>,
    pub(crate) pose: K,
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
    fn at(&self, rate: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Constant(force) => *force,
            Self::Gyroscopic(inertia) => -rate.cross(&(inertia * rate)),
        }
    }
}

/// `M v' = u + known force + f`, and a pose K.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Body<K> {
    integrator: Integrator,
    known_force: KnownForce,
    /// Output estimate at the first output; `None` takes the output itself.
    initial_rate: Option<Vector3<f64>>,
    pose: std::marker::PhantomData<K>,
}

impl<K> Body<K> {
    pub(crate) fn new(
        integrator: Integrator,
        known_force: KnownForce,
        initial_rate: Option<Vector3<f64>>,
    ) -> Self {
        Self { integrator, known_force, initial_rate, pose: std::marker::PhantomData }
    }
}

fn after<K: Kinematics>(at: &Moment<BodyState<K>>, segment: &Segment) -> BodyState<K> {
    BodyState { rate: segment.end, pose: at.state.pose.after(segment, at.stamp_ns) }
}

impl<K: Kinematics> Plant<3> for Body<K> {
    type State = BodyState<K>;

    fn output(&self, state: &BodyState<K>) -> Vector3<f64> {
        state.rate
    }

    fn start(&self, waiting: &BodyState<K>, output: &Vector3<f64>) -> BodyState<K> {
        BodyState { rate: self.initial_rate.unwrap_or(*output), pose: waiting.pose }
    }

    fn resumed(&self, own: &BodyState<K>, kept: &BodyState<K>) -> BodyState<K> {
        BodyState { rate: kept.rate, pose: kept.pose.with_gains_of(&own.pose) }
    }

    fn follow(
        &mut self,
        at: &Moment<BodyState<K>>,
        output: &Vector3<f64>,
        force: &Vector3<f64>,
        h_s: f64,
    ) -> BodyState<K> {
        let rate = &at.state.rate;
        let force = force + self.known_force.at(rate);
        after(at, &self.integrator.follow(rate, output, &force, h_s))
    }

    fn coast(&mut self, at: &Moment<BodyState<K>>, force: &Vector3<f64>, h_s: f64) -> BodyState<K> {
        let rate = &at.state.rate;
        let force = force + self.known_force.at(rate);
        after(at, &self.integrator.coast(rate, &force, h_s))
    }
}
