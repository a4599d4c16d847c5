//! The adaptive law: output error, activation, weights, matched force, and the channel that runs it over a plant.

pub(crate) mod channel;
pub(crate) mod dead_zone;
pub(crate) mod gradient;
pub(crate) mod joint;
pub(crate) mod linear_stability;
pub mod stability;
