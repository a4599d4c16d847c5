//! Recorded flights: how well an estimator predicts them (`replay`), a configuration for them (`tune`), and whether a
//! flight record replays to the bit (`check`).

mod accuracy;
mod arguments;
mod candidate;
mod check;
mod latency;
pub(crate) mod replay;
mod search;
mod sensor;
mod trace;
pub(crate) mod tune;
