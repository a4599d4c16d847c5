//! What one service estimates: a rigid body, a general linear plant, or both.

use crate::gate::LinearSample;
use observer::{
    ChannelReport, LinearEstimate, LinearObserver, LinearObserverState, Plausibility, RigidBodyEstimate,
    RigidBodyObserver, RigidBodyState, Sample,
};
use serde::{Deserialize, Serialize};

/// The observers of one vehicle. At least one is there.
#[derive(Debug, Clone)]
pub struct Estimator {
    /// Translation and rotation.
    pub rigid_body: Option<RigidBodyObserver>,
    /// A plant of the configuration's own A, B, C.
    pub linear: Option<LinearObserver>,
}

/// All that the observers' future depends on, beside what they learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EstimatorState {
    /// Of translation and rotation.
    pub rigid_body: Option<RigidBodyState>,
    /// Of the linear plant.
    pub linear: Option<LinearObserverState>,
}

impl EstimatorState {
    /// Stamp of the newest sample (ns); `None` before the first.
    pub fn stamp_ns(&self) -> Option<u64> {
        let body = self.rigid_body.and_then(|body| body.stamp_ns());
        body.max(self.linear.and_then(|linear| linear.stamp_ns()))
    }
}

/// One of the three that estimate on their own.
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
    /// All of them, as counters of three are ordered.
    pub const ALL: [Self; 3] = [Self::Translation, Self::Rotation, Self::Linear];
}

/// What the observers say about one instant.
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
        let body = self.rigid_body.iter().flat_map(|body| body.translation.iter().chain(&body.rotation));
        body.chain(self.linear.iter().map(|linear| &linear.report))
    }
}

impl Estimator {
    /// Takes one sample.
    pub fn accept(&mut self, sample: &Sample, linear: &LinearSample) {
        if let Some(body) = &mut self.rigid_body {
            body.accept(sample);
        }
        if let Some(observer) = &mut self.linear {
            observer.accept(sample.stamp_ns, linear.output, linear.input);
        }
    }

    /// The estimate at `stamp_ns`, or at the newest sample where that is later.
    pub fn estimate(&mut self, stamp_ns: u64) -> VehicleEstimate {
        VehicleEstimate {
            rigid_body: self.rigid_body.as_mut().map(|body| body.estimate(stamp_ns)),
            linear: self.linear.as_mut().map(|observer| observer.estimate(stamp_ns)),
        }
    }

    /// Stops or resumes learning; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        self.each(|body| body.set_frozen(frozen), |linear| linear.set_frozen(frozen));
    }

    /// Forgets everything; starts again from the next sample.
    pub fn reset(&mut self) {
        self.each(RigidBodyObserver::reset, LinearObserver::reset);
    }

    /// Forgets the state, not what was learned.
    pub fn restart(&mut self) {
        self.each(RigidBodyObserver::restart, LinearObserver::restart);
    }

    /// Puts a channel back to its last good copy, weights included.
    pub fn restore(&mut self, channel: ChannelName) {
        match channel {
            ChannelName::Translation => self.each(RigidBodyObserver::restore_translation, |_| ()),
            ChannelName::Rotation => self.each(RigidBodyObserver::restore_rotation, |_| ()),
            ChannelName::Linear => self.each(|_| (), LinearObserver::restore_good_copy),
        }
    }

    /// Forgets a channel's state, not what it learned.
    pub fn restart_channel(&mut self, channel: ChannelName) {
        match channel {
            ChannelName::Translation => self.each(RigidBodyObserver::restart_translation, |_| ()),
            ChannelName::Rotation => self.each(RigidBodyObserver::restart_rotation, |_| ()),
            ChannelName::Linear => self.each(|_| (), LinearObserver::restart),
        }
    }

    /// Forgets all of a channel, in the good copy too.
    pub fn forget(&mut self, channel: ChannelName) {
        match channel {
            ChannelName::Translation => self.each(RigidBodyObserver::forget_translation, |_| ()),
            ChannelName::Rotation => self.each(RigidBodyObserver::forget_rotation, |_| ()),
            ChannelName::Linear => self.each(|_| (), LinearObserver::forget),
        }
    }

    /// Keeps a copy of states and weights. Call it while they are known to be good.
    pub fn keep_good_copy(&mut self) {
        self.each(RigidBodyObserver::keep_good_copy, LinearObserver::keep_good_copy);
    }

    /// The states of the last good copy; `None` before the first.
    pub fn kept_state(&self) -> Option<EstimatorState> {
        let body = self.rigid_body.as_ref().map(|body| body.kept_state());
        let linear = self.linear.as_ref().map(|linear| linear.kept_state());
        Some(EstimatorState {
            // An observer without a copy is no answer; one that is not configured is.
            rigid_body: body.map_or(Some(None), |kept| kept.map(Some))?,
            linear: linear.map_or(Some(None), |kept| kept.map(Some))?,
        })
    }

    /// How many numbers the good copy of what was learned is.
    pub fn n_kept(&self) -> usize {
        self.n_kept_of_body() + self.linear.as_ref().map_or(0, LinearObserver::n_kept)
    }

    fn n_kept_of_body(&self) -> usize {
        self.rigid_body.as_ref().map_or(0, RigidBodyObserver::n_kept)
    }

    /// The numbers of the good copy from `from` on, as many as `into` has room for: rigid body, then linear plant.
    pub fn read_kept(&self, from: usize, into: &mut [f64]) {
        let split = self.n_kept_of_body();
        let (first, second) = into.split_at_mut(split.saturating_sub(from).min(into.len()));
        if let Some(body) = &self.rigid_body {
            body.read_kept(from, first);
        }
        if let Some(linear) = &self.linear {
            linear.read_kept(from.saturating_sub(split), second);
        }
    }

    /// Takes what observers of the same design have learned.
    ///
    /// # Panics
    /// With another count of numbers than [`Estimator::n_kept`].
    pub fn put(&mut self, learned: &[f64]) {
        let (body, linear) = learned.split_at(self.n_kept_of_body());
        self.each(|observer| observer.put(body), |observer| observer.put(linear));
    }

    /// Goes on from states that observers of the same design have kept, after [`Estimator::put`].
    pub fn resume(&mut self, kept: &EstimatorState) {
        if let (Some(observer), Some(kept)) = (&mut self.rigid_body, &kept.rigid_body) {
            observer.resume(kept);
        }
        if let (Some(observer), Some(kept)) = (&mut self.linear, &kept.linear) {
            observer.resume(kept);
        }
    }

    /// Whether the outputs from now on may be learned from: of translation, rotation, linear plant.
    pub fn set_teaching(&mut self, [translation, rotation, linear]: [bool; 3]) {
        self.each(|body| body.set_teaching(translation, rotation), |observer| observer.set_teaching(linear));
    }

    /// From now on outputs are judged by this; at first all are believed.
    pub fn set_plausibility(&mut self, plausibility: Plausibility) {
        self.each(|body| body.set_plausibility(plausibility), |linear| linear.set_plausibility(plausibility));
    }

    /// Outputs that stood out and were held back: of translation, rotation, linear plant.
    pub fn n_held_back(&self) -> [u64; 3] {
        let [translation, rotation] = self.rigid_body.as_ref().map_or([0; 2], RigidBodyObserver::n_held_back);
        [translation, rotation, self.linear.as_ref().map_or(0, LinearObserver::n_held_back)]
    }

    fn each(&mut self, body: impl FnOnce(&mut RigidBodyObserver), linear: impl FnOnce(&mut LinearObserver)) {
        if let Some(observer) = &mut self.rigid_body {
            body(observer);
        }
        if let Some(observer) = &mut self.linear {
            linear(observer);
        }
    }
}
