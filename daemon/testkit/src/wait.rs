//! Waiting for a condition, and reporting that a test was skipped.

use std::io::Write as _;
use std::path::Path;
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

/// Names a file that collects what [`skip`] says, by an absolute path; `.ci/run` prints it at its end.
pub const SKIPPED: &str = "TESTKIT_SKIPPED";

/// Says that a test, or a part of it, was skipped, and why.
///
/// It writes to the process's own stderr, which the standard harness does not capture, and to the file that [`SKIPPED`]
/// names: other runners hide both streams of a passed test.
pub fn skip(what: &str, reason: &str) {
    let line = format!("skipped: {what}: {reason}\n");
    let _ = std::io::stderr().write_all(line.as_bytes());
    if let Some(file) = std::env::var_os(SKIPPED) {
        append(Path::new(&file), &line)
            .unwrap_or_else(|error| panic!("{SKIPPED}={}: {error}", file.display()));
    }
}

/// In one write, since tests of other processes append to the same file.
fn append(file: &Path, line: &str) -> std::io::Result<()> {
    std::fs::OpenOptions::new().create(true).append(true).open(file)?.write_all(line.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads its own environment, so that it needs a process of its own.
    #[test]
    #[ignore = "a part of another test"]
    fn says_that_it_is_skipped() {
        skip("a test", "for an example");
    }

    #[test]
    fn what_is_skipped_is_in_the_file_that_the_environment_names() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("skipped");
        for _ in 0..2 {
            let mut part = std::process::Command::new(std::env::current_exe().unwrap());
            part.args(["--exact", "wait::tests::says_that_it_is_skipped", "--ignored"]).env(SKIPPED, &file);
            assert!(part.output().unwrap().status.success());
        }
        let said = std::fs::read_to_string(&file).unwrap();
        assert_eq!(said, "skipped: a test: for an example\n".repeat(2));
    }
}
