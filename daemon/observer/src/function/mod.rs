//! The learned function f̂_N: its evaluation, its coordinates, and what a checkpoint keeps of it.

pub(crate) mod block;
pub(crate) mod dense;
pub(crate) mod lattice;
pub(crate) mod learned;
pub(crate) mod solver;
