//! The native space H_N that f̂ is taken from: kernel, centers, and the factored Gram matrix. It depends on nothing else
//! of ours but the error type.

pub(crate) mod centers;
pub(crate) mod factors;
pub(crate) mod kernel;
pub(crate) mod native_space;
pub(crate) mod scaled_kernel;
