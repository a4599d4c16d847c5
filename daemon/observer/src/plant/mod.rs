//! Nominal plants, solved exactly over a step with held inputs, and the quantities integrated along with them. Independent of
//! what is learned.

pub(crate) mod attitude;
pub(crate) mod attitude_filter;
pub(crate) mod body;
pub(crate) mod integrator;
pub(crate) mod linear;
pub(crate) mod linear_algebra;
pub(crate) mod nominal;
pub(crate) mod position;
