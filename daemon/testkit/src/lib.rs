//! What the integration tests of all crates share; a dev-dependency, never part of a program.
//!
//! | module | holds |
//! |---|---|
//! | [`domain`] | [`TestDomain`]: a shared-memory domain that is removed when the test ends |
//! | [`process`] | [`Program`]s and their [`Process`]es in such a domain, killed when the test ends |
//! | [`python`] | environments of Python, each with its own packages |
//! | here | waiting for a condition; saying that a test was skipped |
//!
//! Depends on `shared_types` alone: the programs are the test crate's to name, by a path or by a function ([`Program`]).

pub mod domain;
pub mod process;
pub mod python;

pub use domain::TestDomain;
pub use process::{Ended, Process, Program, play_role};

use std::io::Write as _;
use std::time::{Duration, Instant};

/// How long a test waits for what must happen before it fails. Generous: a busy machine is no failure.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// Waits until `test` is true.
///
/// # Panics
/// After [`PATIENCE`], with what was waited for.
#[track_caller]
pub fn wait_until(what: &str, mut test: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !test() {
        assert!(Instant::now() < deadline, "waited {PATIENCE:?} for: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Says that a test was skipped, and why: past the harness, which swallows what a passed test prints.
pub fn skip(what: &str, reason: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {what}: {reason}");
}
