//! The channels of a vehicle by name, and the trait through which any of them is saved, restored, loaded and reset.

use crate::innovation_gate::InnovationGate;
use crate::joint_channel::JointChannel;
use crate::joint_channel::checkpoint::JointChannelState;
use crate::plant::attitude::Attitude;
use crate::plant::attitude_filter::{AttitudeFilter, JointPose};
use crate::plant::body::BodyState;
use crate::plant::linear::{LinearState, MAX_OUTPUTS};
use crate::plant::nominal::Plant;
use crate::plant::position::Position;
use crate::report::certificate::Certificate;
use crate::timeline::{Timeline, TimelineState};
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// One of the three channels of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChannelName {
    /// Position and velocity.
    Translation,
    /// Attitude and angular velocity.
    Rotation,
    /// The linear plant.
    Linear,
}

impl ChannelName {
    /// All of them, in the order of every array with one entry per channel.
    pub const ALL: [Self; 3] = [Self::Translation, Self::Rotation, Self::Linear];
}

/// What may be learned from a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Learn {
    /// Nothing is learned from here on, from this output or from the one that is held; what was learned stays in use.
    pub frozen: bool,
    /// Whether each channel learns from its output; not while its sensor is stuck, for example.
    pub teaches: [bool; 3],
}

impl Learn {
    /// Every channel learns.
    pub const ALL: Self = Self { frozen: false, teaches: [true; 3] };
    /// Nothing is learned.
    pub const FROZEN: Self = Self { frozen: true, teaches: [true; 3] };
}

/// The state of one channel at a checkpoint; the learned numbers that belong to it are read on their own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // it travels by value: a box would be an allocation in the loop
pub enum ChannelState {
    /// Of the translation.
    Translation(TimelineState<BodyState<Position>, 3>),
    /// Of the rotation.
    Rotation(TimelineState<BodyState<Attitude>, 3>),
    /// Of the linear plant.
    Linear(TimelineState<LinearState, MAX_OUTPUTS>),
    /// Of the translation with the joint law.
    JointTranslation(JointChannelState<()>),
    /// Of the rotation with the joint law.
    JointRotation(JointChannelState<AttitudeFilter>),
}

impl ChannelState {
    /// Stamp of the newest sample (ns); `None` before the first output.
    pub fn stamp_ns(&self) -> Option<u64> {
        match self {
            Self::Translation(state) => state.stamp_ns(),
            Self::Rotation(state) => state.stamp_ns(),
            Self::Linear(state) => state.stamp_ns(),
            Self::JointTranslation(state) => state.stamp_ns(),
            Self::JointRotation(state) => state.stamp_ns(),
        }
    }

    /// r̂ and v̂ of the translation at the newest sample, inertial (m; m/s).
    pub fn position_and_velocity(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        match self {
            Self::Translation(state) => {
                let state = state.newest();
                Some((state.pose.position, state.rate))
            }
            Self::JointTranslation(state) => Some((state.position.into(), state.velocity.into())),
            _ => None,
        }
    }

    /// q̂ and ω̂ of the rotation at the newest sample, body to inertial and body axes (rad/s).
    pub fn attitude_and_angular_velocity(&self) -> Option<(UnitQuaternion<f64>, Vector3<f64>)> {
        match self {
            Self::Rotation(state) => {
                let state = state.newest();
                Some((state.pose.attitude, state.rate))
            }
            Self::JointRotation(state) => Some((state.pose.attitude, state.velocity.into())),
            _ => None,
        }
    }

    /// x̂ of the linear plant at the newest sample.
    pub fn linear_state(&self) -> Option<LinearState> {
        let Self::Linear(state) = self else { return None };
        Some(state.newest())
    }
}

/// The state of one kind of channel, in and out of [`ChannelState`].
pub(crate) trait OfChannel: Sized {
    fn wrapped(self) -> ChannelState;
    /// `None` where it is the state of another channel.
    fn unwrapped(state: &ChannelState) -> Option<&Self>;
}

macro_rules! of_channel {
    ($name:ident, $state:ty) => {
        impl OfChannel for $state {
            fn wrapped(self) -> ChannelState {
                ChannelState::$name(self)
            }

            fn unwrapped(state: &ChannelState) -> Option<&Self> {
                if let ChannelState::$name(state) = state { Some(state) } else { None }
            }
        }
    };
}

of_channel!(Translation, TimelineState<BodyState<Position>, 3>);
of_channel!(Rotation, TimelineState<BodyState<Attitude>, 3>);
of_channel!(Linear, TimelineState<LinearState, MAX_OUTPUTS>);
of_channel!(JointTranslation, JointChannelState<()>);
of_channel!(JointRotation, JointChannelState<AttitudeFilter>);

/// A channel, independent of its plant and law.
///
/// A checkpoint is the state that [`AnyChannel::save`] returns and the learned numbers, which stay in the channel. Copying a
/// million of them between two deadlines would take too long; only those that have changed are copied, inside the channel.
pub trait AnyChannel {
    /// Saves what is learned by now as the checkpoint, and returns the state that goes with it. Call it while both are
    /// known to be good. No allocation.
    ///
    /// # Cost
    /// A copy of what was learned since the last one: dense, N m numbers.
    fn save(&mut self) -> ChannelState;

    /// Restores the learned numbers of the checkpoint, and the state that was saved with it, from which the channel coasts
    /// to the present; without a state it starts from the next output. No allocation.
    fn restore(&mut self, state: Option<&ChannelState>);

    /// How many numbers are learned.
    fn n_learned(&self) -> usize;

    /// The learned numbers of the checkpoint from `from` on, as many as `into` has room for.
    fn read_saved(&self, from: usize, into: &mut [f64]);

    /// Continues from the checkpoint of a channel of the same design. With its state, the next step is the same to the bit.
    ///
    /// # Panics
    /// With another count of numbers than [`AnyChannel::n_learned`].
    fn load(&mut self, learned: &[f64], state: Option<&ChannelState>);

    /// Room for this many marks: what the channel is at an instant, to return to when a sample arrives late. Allocates.
    fn reserve_marks(&mut self, n_marks: usize);

    /// Bytes of one mark; `None` where it would take too long to make one between two deadlines: with the local solver.
    fn bytes_of_mark(&self) -> Option<usize>;

    /// Copies the present into the mark at a place below the number that is reserved. No allocation.
    ///
    /// # Cost
    /// A copy: N m numbers with the gradient law, n²/2 with the joint one.
    fn mark(&mut self, place: usize);

    /// Becomes what it was when the mark at this place was made, to the bit. No allocation.
    fn return_to(&mut self, place: usize);

    /// Normalized innovation squared of the newest output; 0 with a law without deviations.
    fn nis(&self) -> f64 {
        0.0
    }

    /// Whether the newest output repeats what cannot be, and is not used; of a law that knows it.
    fn is_stuck(&self) -> bool {
        false
    }

    /// Forgets the state, not what was learned: starts again from the next output, with any stamp.
    fn restart(&mut self);

    /// Forgets the state and what was learned; the checkpoint stays until the next one.
    fn forget(&mut self);

    /// Sets how outliers are detected; before, all outputs are accepted.
    fn set_innovation_gate(&mut self, gate: InnovationGate);

    /// What the theorems claim; `None` where the error dynamics are not strictly positive real.
    fn certificate(&self) -> Option<&Certificate>;
}

impl<P: Plant<M>, const M: usize> AnyChannel for Timeline<P, M>
where
    TimelineState<P::State, M>: OfChannel,
{
    fn save(&mut self) -> ChannelState {
        Timeline::save(self).wrapped()
    }

    fn restore(&mut self, state: Option<&ChannelState>) {
        Timeline::restore(self, state.and_then(OfChannel::unwrapped));
    }

    fn n_learned(&self) -> usize {
        self.channel().law().function().n_learned()
    }

    fn read_saved(&self, from: usize, into: &mut [f64]) {
        self.channel().law().function().read_saved(from, into);
    }

    fn load(&mut self, learned: &[f64], state: Option<&ChannelState>) {
        Timeline::load(self, learned, state.and_then(OfChannel::unwrapped));
    }

    fn reserve_marks(&mut self, n_marks: usize) {
        Timeline::reserve_marks(self, n_marks);
    }

    fn bytes_of_mark(&self) -> Option<usize> {
        Timeline::bytes_of_mark(self)
    }

    fn mark(&mut self, place: usize) {
        Timeline::mark(self, place);
    }

    fn return_to(&mut self, place: usize) {
        Timeline::return_to(self, place);
    }

    fn restart(&mut self) {
        Timeline::restart(self);
    }

    fn forget(&mut self) {
        Timeline::forget(self);
    }

    fn set_innovation_gate(&mut self, gate: InnovationGate) {
        Timeline::set_innovation_gate(self, gate);
    }

    fn certificate(&self) -> Option<&Certificate> {
        Timeline::certificate(self)
    }
}

impl<K: JointPose> AnyChannel for JointChannel<K>
where
    JointChannelState<K>: OfChannel,
{
    fn save(&mut self) -> ChannelState {
        JointChannel::save(self).wrapped()
    }

    fn restore(&mut self, state: Option<&ChannelState>) {
        JointChannel::restore(self, state.and_then(OfChannel::unwrapped));
    }

    fn n_learned(&self) -> usize {
        JointChannel::n_learned(self)
    }

    fn read_saved(&self, from: usize, into: &mut [f64]) {
        JointChannel::read_saved(self, from, into);
    }

    fn load(&mut self, learned: &[f64], state: Option<&ChannelState>) {
        JointChannel::load(self, learned, state.and_then(OfChannel::unwrapped));
    }

    fn reserve_marks(&mut self, n_marks: usize) {
        JointChannel::reserve_marks(self, n_marks);
    }

    fn bytes_of_mark(&self) -> Option<usize> {
        Some(JointChannel::bytes_of_mark(self))
    }

    fn mark(&mut self, place: usize) {
        JointChannel::mark(self, place);
    }

    fn return_to(&mut self, place: usize) {
        JointChannel::return_to(self, place);
    }

    fn nis(&self) -> f64 {
        JointChannel::nis(self)
    }

    fn is_stuck(&self) -> bool {
        JointChannel::is_stuck(self)
    }

    fn restart(&mut self) {
        JointChannel::restart(self);
    }

    fn forget(&mut self) {
        JointChannel::forget(self);
    }

    /// The law weighs stray outputs itself.
    fn set_innovation_gate(&mut self, _: InnovationGate) {}

    fn certificate(&self) -> Option<&Certificate> {
        None
    }
}
