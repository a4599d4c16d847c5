//! Nominal plants, solved exactly over a step with held inputs, and what is integrated along with them.

pub(crate) mod attitude;
pub(crate) mod body;
pub(crate) mod position;
