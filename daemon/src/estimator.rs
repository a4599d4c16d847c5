//! The observers of one service: a rigid body, a general linear plant, or both.

use crate::gate::LinearSample;
use nalgebra::UnitQuaternion;
pub use observer::ChannelName;
use observer::{
    AnyChannel, ChannelReport, ChannelState, InnovationGate, Learn, LinearEstimate, LinearObserver,
    RigidBodyEstimate, RigidBodyObserver, Sample,
};
use serde::{Deserialize, Serialize};

/// The observers of one vehicle; at least one.
#[derive(Debug, Clone)]
pub struct Estimator {
    /// Translation and rotation.
    pub rigid_body: Option<RigidBodyObserver>,
    /// A linear plant with the configuration's A, B, C.
    pub linear: Option<LinearObserver>,
}

/// The state of the observers at a checkpoint: everything that later estimates depend on, except what was learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EstimatorState {
    /// Of each channel that is configured, in the order of [`ChannelName::ALL`].
    pub channels: [Option<ChannelState>; 3],
    fixed_attitude: Option<UnitQuaternion<f64>>,
}

impl EstimatorState {
    /// Stamp of the newest sample (ns); `None` before the first.
    pub fn stamp_ns(&self) -> Option<u64> {
        self.channels.iter().flatten().filter_map(ChannelState::stamp_ns).max()
    }
}

/// The estimate of one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleEstimate {
    /// Translation and rotation.
    pub rigid_body: Option<RigidBodyEstimate>,
    /// The linear plant.
    pub linear: Option<LinearEstimate>,
}

impl From<RigidBodyEstimate> for VehicleEstimate {
    fn from(body: RigidBodyEstimate) -> Self {
        Self { rigid_body: Some(body), linear: None }
    }
}

impl VehicleEstimate {
    /// The report of a channel, if it is configured.
    pub fn report(&self, channel: ChannelName) -> Option<&ChannelReport> {
        let body = self.rigid_body.as_ref();
        match channel {
            ChannelName::Translation => body?.translation.as_ref(),
            ChannelName::Rotation => body?.rotation.as_ref(),
            ChannelName::Linear => self.linear.as_ref().map(|linear| &linear.report),
        }
    }

    /// The reports of all configured channels.
    pub fn reports(&self) -> impl Iterator<Item = &ChannelReport> {
        ChannelName::ALL.into_iter().filter_map(|channel| self.report(channel))
    }
}

impl Estimator {
    /// Takes one sample. Returns which outputs were outliers, by channel.
    pub fn accept(&mut self, sample: &Sample, linear: &LinearSample, learn: Learn) -> [bool; 3] {
        let mut outliers = [false; 3];
        if let Some(body) = &mut self.rigid_body {
            outliers = body.accept(sample, learn);
        }
        if let Some(observer) = &mut self.linear {
            outliers[ChannelName::Linear as usize] =
                observer.accept(sample.stamp_ns, linear.output, linear.input, learn);
        }
        outliers
    }

    /// The estimate at `stamp_ns`, or at the newest sample if that is later.
    pub fn estimate(&mut self, stamp_ns: u64) -> VehicleEstimate {
        VehicleEstimate {
            rigid_body: self.rigid_body.as_mut().map(|body| body.estimate(stamp_ns)),
            linear: self.linear.as_mut().map(|observer| observer.estimate(stamp_ns)),
        }
    }

    /// A channel, if it is configured.
    pub fn channel(&self, name: ChannelName) -> Option<&dyn AnyChannel> {
        match name {
            ChannelName::Linear => self.linear.as_ref().map(LinearObserver::channel),
            name => self.rigid_body.as_ref()?.channel(name),
        }
    }

    /// A channel, if it is configured.
    pub fn channel_mut(&mut self, name: ChannelName) -> Option<&mut dyn AnyChannel> {
        match name {
            ChannelName::Linear => self.linear.as_mut().map(LinearObserver::channel_mut),
            name => self.rigid_body.as_mut()?.channel_mut(name),
        }
    }

    fn channels(&self) -> impl Iterator<Item = &dyn AnyChannel> {
        ChannelName::ALL.into_iter().filter_map(|name| self.channel(name))
    }

    fn each(&mut self, mut act: impl FnMut(ChannelName, &mut dyn AnyChannel)) {
        for name in ChannelName::ALL {
            if let Some(channel) = self.channel_mut(name) {
                act(name, channel);
            }
        }
    }

    /// Forgets the state, not what was learned; starts again from the next sample, with any stamp.
    pub fn restart(&mut self) {
        self.rigid_body.iter_mut().for_each(RigidBodyObserver::restart);
        self.linear.iter_mut().for_each(|observer| observer.channel_mut().restart());
    }

    /// Forgets everything; starts again from the next sample.
    pub fn reset(&mut self) {
        self.restart();
        self.each(|_, channel| channel.forget());
    }

    /// Saves what is learned by now, and returns the states that go with it; see [`AnyChannel::save`].
    pub fn save(&mut self) -> EstimatorState {
        let mut channels = [None; 3];
        self.each(|name, channel| channels[name as usize] = Some(channel.save()));
        EstimatorState { channels, fixed_attitude: self.fixed_attitude() }
    }

    /// Continues from the checkpoint of observers of the same design; see [`AnyChannel::load`].
    ///
    /// # Panics
    /// With another count of numbers than [`Estimator::n_learned`].
    pub fn load(&mut self, learned: &[f64], state: Option<&EstimatorState>) {
        let mut rest = learned;
        self.each(|name, channel| {
            let (own, others) = rest.split_at(channel.n_learned());
            channel.load(own, state.and_then(|state| state.channels[name as usize].as_ref()));
            rest = others;
        });
        if let (Some(body), Some(state)) = (&mut self.rigid_body, state) {
            body.set_fixed_attitude(state.fixed_attitude);
        }
    }

    /// How many numbers are learned, by all channels.
    pub fn n_learned(&self) -> usize {
        self.channels().map(|channel| channel.n_learned()).sum()
    }

    /// The learned numbers of the checkpoint from `from` on, as many as `into` has room for: channel after channel.
    pub fn read_saved(&self, from: usize, into: &mut [f64]) {
        let mut start = 0;
        for channel in self.channels() {
            let end = start + channel.n_learned();
            let (first, last) = (from.max(start), (from + into.len()).min(end));
            if first < last {
                channel.read_saved(first - start, &mut into[first - from..last - from]);
            }
            start = end;
        }
    }

    /// Room for this many marks; see [`AnyChannel::reserve_marks`].
    pub fn reserve_marks(&mut self, n_marks: usize) {
        self.each(|_, channel| channel.reserve_marks(n_marks));
    }

    /// Bytes of one mark; `None` where a channel has none.
    pub fn bytes_of_mark(&self) -> Option<usize> {
        self.channels().map(|channel| channel.bytes_of_mark()).sum()
    }

    /// Copies the channels' present into their marks at this place.
    pub fn mark(&mut self, place: usize) {
        self.each(|_, channel| channel.mark(place));
    }

    /// Becomes what it was at the mark at this place, with the attitude of a body without a rotation channel.
    pub fn return_to(&mut self, place: usize, fixed_attitude: Option<UnitQuaternion<f64>>) {
        self.each(|_, channel| channel.return_to(place));
        if let Some(body) = &mut self.rigid_body {
            body.set_fixed_attitude(fixed_attitude);
        }
    }

    /// The attitude of a body without a rotation channel.
    pub fn fixed_attitude(&self) -> Option<UnitQuaternion<f64>> {
        self.rigid_body.as_ref().and_then(RigidBodyObserver::fixed_attitude)
    }

    /// Sets how outliers are detected; before, all outputs are accepted.
    pub fn set_innovation_gate(&mut self, gate: InnovationGate) {
        self.each(|_, channel| channel.set_innovation_gate(gate));
    }
}
