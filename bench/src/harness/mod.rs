//! What several measurements share. Nothing here imports a measurement.
//!
//! | file | what lives there |
//! |---|---|
//! | `processes` | the programs as processes in a domain of their own |
//! | `exchange` | the vehicle's side of a measured exchange of samples and estimates |
//! | `latency` | quantiles, histograms and their tables |
//! | `machine` | the machine that the figures are of |

pub(crate) mod exchange;
pub(crate) mod latency;
pub(crate) mod machine;
pub(crate) mod processes;
