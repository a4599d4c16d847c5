//! The learned function f̂_N: its evaluation, its coordinates, and the part of a checkpoint that holds it. Depends on the
//! native space (`space`), not on law or plant.

pub(crate) mod block;
pub(crate) mod calibration;
pub(crate) mod checkpoint;
pub(crate) mod dense;
pub(crate) mod evaluation;
pub(crate) mod lattice;
pub(crate) mod learned;
pub(crate) mod solver;
