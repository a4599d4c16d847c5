//! Helpers that the integration tests of all crates share. Only a dev-dependency, never part of a program.
//!
//! | module | holds |
//! |---|---|
//! | [`domain`] | [`TestDomain`]: a shared-memory domain that is removed when the test ends |
//! | [`process`] | [`Program`]s and their [`Process`]es in such a domain, killed when the test ends |
//! | [`recorder`] | [`Recorder`]: a thread that records every message of an instance |
//! | [`python`] | Python environments, each with its own packages |
//! | [`wait`] | waiting for a condition; saying that a test was skipped |
//!
//! Depends on `shared_types` alone. The test crate names the programs, by a path or by a function ([`Program`]).

pub mod domain;
pub mod process;
pub mod python;
pub mod recorder;
pub mod wait;

pub use domain::TestDomain;
pub use process::{Ended, Main, Process, Program, play_role};
pub use recorder::{Heard, Recorder};
pub use wait::{PATIENCE, skip, wait_until};
