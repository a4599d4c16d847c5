//! The parts of a scenario.

use crate::disturbance::GaussMarkov;
use crate::plant::{Nominal, State, TruePlant, Wrench};
use crate::sensors::SensorSuite;

/// A true plant that flies a reference.
pub trait Vehicle: TruePlant + std::fmt::Debug + Sync {
    /// The state at t = 0, on the reference.
    fn initial_state(&self) -> State;

    /// The command at `t_s`, computed from the true state and held until the next sample.
    fn command(&self, t_s: f64, state: &State) -> Wrench;
}

/// The parts of a scenario.
#[derive(Debug, Clone)]
pub struct Definition {
    /// The true plant and its controller.
    pub vehicle: &'static dyn Vehicle,
    /// The nominal plant, with which the service is configured.
    pub nominal: Nominal,
    /// The disturbance, in the unit that the vehicle states.
    pub disturbance: Option<GaussMarkov>,
    /// What is measured.
    pub sensors: SensorSuite,
    /// Below this rate of samples the held command no longer stabilises the vehicle (Hz).
    pub lowest_rate_hz: f64,
}
