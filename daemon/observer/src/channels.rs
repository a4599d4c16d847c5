//! The channels of a vehicle by name, and the trait through which any of them is saved, restored, loaded and reset.

use crate::innovation_gate::InnovationGate;
use crate::plant::attitude::Attitude;
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
}

impl ChannelState {
    /// Stamp of the newest sample (ns); `None` before the first output.
    pub fn stamp_ns(&self) -> Option<u64> {
        match self {
            Self::Translation(state) => state.stamp_ns(),
            Self::Rotation(state) => state.stamp_ns(),
            Self::Linear(state) => state.stamp_ns(),
        }
    }

    /// r̂ and v̂ of the translation at the newest sample, inertial (m; m/s).
    pub fn position_and_velocity(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let Self::Translation(state) = self else { return None };
        let state = state.newest();
        Some((state.pose.position, state.rate))
    }

    /// q̂ and ω̂ of the rotation at the newest sample, body to inertial and body axes (rad/s).
    pub fn attitude_and_angular_velocity(&self) -> Option<(UnitQuaternion<f64>, Vector3<f64>)> {
        let Self::Rotation(state) = self else { return None };
        let state = state.newest();
        Some((state.pose.attitude, state.rate))
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
    ($name:ident, $state:ty, $m:expr) => {
        impl OfChannel for TimelineState<$state, $m> {
            fn wrapped(self) -> ChannelState {
                ChannelState::$name(self)
            }

            fn unwrapped(state: &ChannelState) -> Option<&Self> {
                if let ChannelState::$name(state) = state { Some(state) } else { None }
            }
        }
    };
}

of_channel!(Translation, BodyState<Position>, 3);
of_channel!(Rotation, BodyState<Attitude>, 3);
of_channel!(Linear, LinearState, MAX_OUTPUTS);

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
