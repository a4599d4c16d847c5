//! Waiting for a condition, and reporting that a test was skipped.

use std::io::Write as _;
use std::time::{Duration, Instant};

/// How long a test waits for a condition before it fails. Long enough for a busy machine.
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

/// Reports that a test was skipped, and why, directly to stderr, since the test harness hides the output of a passed test.
pub fn skip(what: &str, reason: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {what}: {reason}");
}
