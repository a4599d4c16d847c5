//! The fixed-rate state-estimation service.
//!
//! It runs beside the process of a flight or underwater vehicle. At a fixed rate it takes the vehicle's sensor samples from
//! shared memory, and writes back position, velocity, attitude, angular velocity and the unknown force and torque, which it
//! learns on line. Every estimate states how far it can be trusted.
#![cfg_attr(doc, doc = concat!("<div>\n", include_str!("../../docs/architecture.svg"), "</div>\n"))]
//!
//! The mathematics is the crate [`observer`]. Most users need no more of this crate than its program; a vehicle's process
//! depends on [`shared_types`], whose [`Client`](shared_types::Client) publishes samples and reads estimates. To embed the
//! service in a program of your own: [`ConfigFile`](config::ConfigFile) and [`Service`].
//!
//! | module | holds |
//! |---|---|
//! | [`config`] | the configuration as data: the crate `daemon_config` |
//! | [`assemble`] | makes observers of a configuration |
//! | [`check`] | what is proven for a configuration |
//! | [`sensors`] | a sample in body axes, as its sensor is mounted |
//! | [`gate`] | which samples are accepted |
//! | [`estimator`] | the observer of a configuration, of a rigid body or of a linear plant |
//! | [`engine`] | everything that determines an estimate, without clock and ports |
//! | [`source_book`] | what each source has sent, for people |
//! | [`window`] | the samples of the last while, in the order of their stamps |
//! | [`cycle`] | the tick |
//! | [`deadline`] | waiting for the next deadline |
//! | [`ports`] | the iceoryx2 ports of the service |
//! | [`snapshot`] | saving what was learned to a file, and resuming from it |
//! | [`replay`] | replaying a flight record to the same bits |
//! | [`threads`] | the threads beside the loop |
//! | [`system`] | real-time settings, doctor, service manager |
//! | [`service`] | starting and stopping all of it |
//! | [`cli`] | the command line |
//!
//! A multicopter in wind, with a load that the configuration does not contain, beside the same observer without learning
//! (`bench demo`):
#![cfg_attr(doc, doc = concat!("<div style=\"overflow-x:auto\">\n", include_str!("../../docs/demo.svg"), "</div>\n"))]

pub mod assemble;
pub mod check;
pub mod cli;
pub mod cycle;
pub mod deadline;
pub mod engine;
pub mod estimator;
pub mod gate;
mod latency;
pub mod limits;
mod log;
pub mod ports;
pub mod replay;
pub mod sensor_clocks;
pub mod sensors;
pub mod service;
pub mod snapshot;
pub mod source_book;
pub mod system;
pub mod threads;
pub mod window;

pub use daemon_config as config;
pub use service::{Service, ServiceFiles, StartError};
