//! Which row of the filter's state is what.

/// Row of the velocity.
pub(crate) const VELOCITY: usize = 0;
/// Row of the fast disturbance.
pub(crate) const DISTURBANCE: usize = 1;
/// First row of the weights: bias, 3 linear, 3 of the command, 3 of each lag.
pub(crate) const WEIGHTS: usize = 2;
/// Weights beside those of the kernel.
pub(crate) const N_PARAMETRIC: usize = 13;
/// Row of the position; without a position its entries are 0.
pub(crate) const POSITION: usize = WEIGHTS + N_PARAMETRIC;
/// Rows of ω × v, with features along the body's axes: after the kernel's.
pub(crate) const N_TURN: usize = 3;
/// First row of the kernel's weights; after the last of them and of [`N_TURN`], the accelerometer's bias, where there is an accelerometer.
pub(crate) const KERNEL: usize = POSITION + 1;
