//! What this machine grants, measured.
//!
//! How late threads wake up with each setting, and what that depends on: each fact with what was found, a verdict, and a
//! remedy. The doctor needs no rights and changes nothing; a fact that the kernel does not tell is one line that says so.

mod disk;
mod fact;
mod facts;
mod lateness;
mod memory;
mod report;

pub(crate) use fact::{Plan, Verdict};
pub(crate) use lateness::seconds;
pub(crate) use report::{Report, report};
