//! The service's threads beside the loop. Each owns its data; what it shares with the loop is a wait-free ring.

pub mod housekeeping;
pub mod recorder;
pub mod snapshot_writer;
