//! Measurement of the observer and of the service around it. Every figure that the project states comes
//! from one of these commands.
//!
//! | module | command | measures |
//! |---|---|---|
//! | [`demo`] | `bench demo` | the whole job: service and simulated vehicle as two processes |
//! | [`paper`] | `bench paper` | the paper's two examples: table, figures, errors |
//! | [`step`] | `bench step` | latency of a step as the number of centers grows |
//! | [`ipc`] | `bench ipc` | a round trip through the service, beside one through bare shared memory |
//! | [`service`] | `bench service` | a sample's stamp to its estimate, by trigger and rate |
//! | [`jitter`] | `bench jitter` | how late the service's cycle wakes up, beside cyclictest |
//! | [`load`] | `bench load` | what further readers and further vehicles cost |
//! | [`replay`] | `bench replay` | accuracy on a recorded flight, beside a Kalman filter |
//! | [`tune`] | `bench tune` | a configuration for a recorded flight, by the same figures |
//! | `accuracy`, `flight` | | how well an estimator predicts a recorded flight |
//! | [`kalman`] | | that filter |
//! | [`plot`] | | figures |
//! | `c_client` | | calls of the C client beside those of the Rust client, for `bench ipc` |
//! | `latency` | | quantiles and histograms |
//! | `exchange` | | the vehicle's side of a measured exchange of samples and estimates |
//! | `processes` | | the programs as processes in a domain of their own |
//! | `machine` | | what machine the figures are of |

pub mod cli;
pub mod demo;
mod flights;
mod harness;
pub mod ipc;
pub mod jitter;
pub mod kalman;
pub mod load;
pub mod paper;
mod plot;
pub mod service;
pub mod soak;
pub mod step;
