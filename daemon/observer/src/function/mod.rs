//! The learned function f̂_N: its evaluation, its coordinates, and what a checkpoint holds of it. It knows the native
//! space, and neither law nor plant.

pub(crate) mod block;
pub(crate) mod calibration;
pub(crate) mod checkpoint;
pub(crate) mod dense;
pub(crate) mod evaluation;
pub(crate) mod lattice;
pub(crate) mod learned;
pub(crate) mod solver;
