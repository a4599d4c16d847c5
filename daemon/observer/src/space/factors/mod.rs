//! Factors of the Gram matrix, packed for the vector unit. Independent of the kernel.

pub(crate) mod cholesky;
pub(crate) mod lanes;
pub(crate) mod mirror;
pub(crate) mod mirrored;
pub(crate) mod packed;
