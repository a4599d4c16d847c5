//! The messages between a vehicle's process and the estimation service, and the clients that exchange them in shared memory.
//!
//! | module | holds |
//! |---|---|
//! | [`payload`] | the fixed-size messages: one table each |
//! | [`table`] | what a table is, and the macros that make structs of it |
//! | [`service`] | service names and qualities |
//! | [`client`] | the client of a vehicle's process or a reader: publish, wait, peek, command |
//! | [`clock`] | the clock of all time stamps |
//! | [`terminal`] | printing lines to a terminal or pipe that may be closed |
//!
//! The crate [`domain`] determines which shared memory is used. This crate depends on `domain` and on iceoryx2, and on no
//! other crate of the workspace (its tests start a daemon).
//!
//! # In your own process
//!
//! ```
//! use shared_types::{Client, Domain, Measurement, clock};
//! use std::time::Duration;
//! # // A live service in a domain of its own, so that this example really runs.
//! # let root = tempfile::Builder::new().prefix("od").tempdir_in("/dev/shm")?;
//! # let domain = Domain::at(root.path())?;
//! # let config = daemon::config::ConfigFile::preset("rigid-body")?;
//! # let service = daemon::Service::start(&config, &domain, "vehicle", &daemon::ServiceFiles::default())?;
//! # let _ = stringify! {
//!
//! let domain = Domain::of_user()?;
//! # };
//! let client = Client::connect(&domain, "vehicle", Duration::from_secs(5))?;
//! let sensors = client.measurement_publisher()?;
//! let mut estimates = client.estimate_subscriber()?;
//! sensors.publish(&Measurement::at(clock::monotonic_ns(), 0).with_velocity_m_s([1.0, 0.0, 0.0]))?;
//! let estimate = estimates.wait_next(Duration::from_secs(1))?;
//! println!("unknown force {:?} N", estimate.matched_force_n);
//! # drop((sensors, estimates, client));
//! # service.stop();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

/// The README's example, compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct ReadMe;

#[macro_use]
pub mod table;

pub mod client;
pub mod clock;
pub mod payload;
pub mod service;
pub mod terminal;

pub use client::{Client, ClientError};
pub use domain::{self, Domain, DomainError};
pub use payload::{Channel, Command, Counters, Estimate, LatencySummary, Measurement, Reply, Status, Truth};
