//! What one service estimates: a rigid body, a general linear plant, or both.

use crate::gate::LinearSample;
use observer::{ChannelReport, LinearEstimate, LinearObserver, RigidBodyEstimate, RigidBodyObserver, Sample};

/// The observers of one vehicle. At least one is there.
#[derive(Debug, Clone)]
pub struct Estimator {
    /// Translation and rotation.
    pub rigid_body: Option<RigidBodyObserver>,
    /// A plant of the configuration's own A, B, C.
    pub linear: Option<LinearObserver>,
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

    /// Keeps a copy of states and weights. Call it while they are known to be good.
    pub fn keep_good_copy(&mut self) {
        self.each(RigidBodyObserver::keep_good_copy, LinearObserver::keep_good_copy);
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
