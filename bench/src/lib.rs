//! Measurement of the observer and of the service around it. Every figure that the project states comes
//! from one of these commands.
//!
//! | module | command | measures |
//! |---|---|---|
//! | [`demo`] | `bench demo` | the whole job: service and simulated vehicle as two processes |
//! | [`paper`] | `bench paper` | the paper's two examples: table, figures, errors |
//! | [`step`] | `bench step` | latency of a step as the number of centers grows |
//! | [`replay`] | `bench replay` | accuracy on a recorded flight, beside a Kalman filter |
//! | [`kalman`] | | that filter |
//! | [`plot`] | | figures |
//! | `machine` | | what machine the figures are of |

pub mod cli;
pub mod demo;
pub mod kalman;
mod machine;
pub mod paper;
pub mod plot;
pub mod replay;
pub mod step;
