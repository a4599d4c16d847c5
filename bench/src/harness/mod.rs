//! What several measurements share. Nothing here imports a measurement.
//!
//! | file | what lives there |
//! |---|---|
//! | `processes` | the programs as processes in a domain of their own |
//! | `exchange` | the vehicle's side of a measured exchange of samples and estimates |
//! | `latency` | quantiles of latencies, and how tables show them |
//! | `machine` | the machine that the figures are of |
//! | `options` | values of options that several commands have |
//! | `output` | tables, numbers, progress, shared messages |

pub(crate) mod exchange;
pub(crate) mod latency;
pub(crate) mod machine;
pub(crate) mod options;
pub(crate) mod output;
pub(crate) mod processes;
