//! The native space H_N that f̂ is an element of: kernel, centers, and the factored Gram matrix. Depends on `error` alone.

pub(crate) mod centers;
pub(crate) mod factors;
pub(crate) mod kernel;
pub(crate) mod native_space;
pub(crate) mod scaled_kernel;
