//! The doctor measures how late threads wake up with each setting, and collects the facts that this depends on.
//!
//! Each fact has what was found, a verdict, and a remedy. The doctor needs no rights and changes nothing. A fact that the
//! kernel does not report is listed as unknown.

mod disk;
mod fact;
mod facts;
mod lateness;
mod memory;
mod report;

pub(crate) use fact::{Plan, Verdict};
pub(crate) use lateness::seconds;
pub(crate) use report::{Report, report};
