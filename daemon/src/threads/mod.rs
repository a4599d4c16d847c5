//! The service's threads beside the loop. Each owns its data and exchanges values with the loop through wait-free rings.

pub mod housekeeping;
pub mod recorder;
pub mod snapshot_writer;
