//! What the integration tests of all crates share; a dev-dependency, never part of a program.
//!
//! | module | holds |
//! |---|---|
//! | [`domain`] | [`TestDomain`]: a shared-memory domain that is removed when the test ends |
//! | [`process`] | [`Program`]s and their [`Process`]es in such a domain, killed when the test ends |
//! | [`recorder`] | [`Recorder`]: a thread that keeps everything that passes |
//! | [`python`] | environments of Python, each with its own packages |
//! | [`wait`] | waiting for a condition; saying that a test was skipped |
//!
//! Depends on `shared_types` alone: the programs are the test crate's to name, by a path or by a function ([`Program`]).

pub mod domain;
pub mod process;
pub mod python;
pub mod recorder;
pub mod wait;

pub use domain::TestDomain;
pub use process::{Ended, Main, Process, Program, play_role};
pub use recorder::{Heard, Recorder};
pub use wait::{PATIENCE, skip, wait_until};
