//! A live vehicle that speaks MAVLink (PX4, ArduPilot, ArduSub) as the source of samples, and the estimate back to it.
//!
//! Depends on `shared_types`, for the samples and the ports. Its command line is `sim_publisher mavlink`.
//!
//! | file | holds |
//! |---|---|
//! | `link` | UDP and serial |
//! | `frames` | finding frames in bytes; garbage is skipped and counted |
//! | `clock` | converting the vehicle's time to our clock |
//! | `convert` | converting messages to quantities, and an estimate to ODOMETRY: axes, signs, units |
//! | `selection` | which vehicle is followed, and which of its frames are lost |
//! | `joining` | joining quantities of one instant into a sample |
//! | `requests` | which messages are requested from the vehicle |
//! | `settings`, `tally` | what is used of the vehicle's messages; counts of what arrived |
//! | `bridge` | [`Bridge`]: all of these together; no clock, no socket |
//! | `report` | counts, and advice if nothing usable arrives |
//! | `run` | [`run`]: the loop around them, with the service's ports |
//!
//! Time is CLOCK_MONOTONIC of this machine. TIMESYNC requests are answered with it, so that the vehicle can compute the age of
//! an estimate. HEARTBEAT, TIMESYNC, requests for messages, and the estimate are sent; none of it is signed.

mod bridge;
mod clock;
mod convert;
mod frames;
mod joining;
mod link;
mod report;
mod requests;
mod run;
mod selection;
mod settings;
mod tally;

pub use bridge::Bridge;
pub use clock::VehicleClock;
pub use frames::{FrameTally, Peer};
pub use link::{Address, Link, LinkError};
pub use report::Bridged;
pub use run::{MavlinkError, Options, run};
pub use settings::{Settings, Source};
pub use tally::Tally;
