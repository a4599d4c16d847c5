//! Helpers that several measurements share. No file here imports a measurement.
//!
//! | file | what lives there |
//! |---|---|
//! | `processes` | the programs as processes in a domain of their own |
//! | `exchange` | the vehicle's side of a measured exchange of samples and estimates |
//! | `latency` | quantiles of latencies, and their columns in tables |
//! | `machine` | the machine of a measurement |
//! | `options` | value parsers of options that several commands share |
//! | `random` | noise of a fixed seed |
//! | `output` | tables, numbers, progress, shared messages |

pub(crate) mod exchange;
pub(crate) mod latency;
pub(crate) mod machine;
pub(crate) mod options;
pub(crate) mod output;
pub(crate) mod processes;
pub(crate) mod random;
