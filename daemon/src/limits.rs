//! Limits that several files share.

/// One tick takes at most this many samples, so that a flood of them does not delay the estimate.
pub const MAX_SAMPLES_PER_TICK: usize = 256;
