//! A live vehicle that speaks MAVLink (PX4, ArduPilot, ArduSub) as the source of samples, and the estimate back to it.
//!
//! It depends on `shared_types`, for the samples and the ports. It has no command line; `sim_publisher mavlink` is that.
//!
//! | file | holds |
//! |---|---|
//! | `link` | UDP and serial |
//! | `frames` | bytes into frames; garbage is skipped and counted |
//! | `clock` | the vehicle's time on our clock |
//! | `convert` | messages into quantities, an estimate into ODOMETRY: axes, signs, units |
//! | `selection` | which vehicle is followed, and which of its frames are lost |
//! | `joining` | quantities of one instant into a sample |
//! | `requests` | which messages the vehicle is asked for |
//! | `settings`, `tally` | what to take, and what came |
//! | `bridge` | [`Bridge`]: all of these together; no clock, no wire |
//! | `report` | what is missing where nothing usable comes, and what to set |
//! | `run` | [`run`]: the loop around them, with the service's ports |
//!
//! Time is CLOCK_MONOTONIC of this machine. TIMESYNC requests are answered with it, so that the vehicle can tell how old an
//! estimate is. HEARTBEAT, TIMESYNC, requests for messages, and the estimate are sent; none of it is signed.

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
