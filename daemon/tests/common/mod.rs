//! Helpers of these tests beside `testkit`: the daemon as a process.

#![allow(dead_code, unused_imports, unreachable_pub)] // each test file uses its part

use std::process::{Child, Command, Output};
use testkit::{Ended, Process, Program};
pub use testkit::{PATIENCE, TestDomain, wait_until};

pub const DAEMON: Program = Program::at(env!("CARGO_BIN_EXE_daemon"));

/// `daemon` with these arguments in that domain.
pub fn daemon_command(domain: &TestDomain, arguments: &[&str]) -> Command {
    DAEMON.command_in(domain, arguments)
}

/// `daemon run`, killed when the test ends.
pub struct Daemon(Process);

impl std::ops::Deref for Daemon {
    type Target = Process;

    fn deref(&self) -> &Process {
        &self.0
    }
}

impl std::ops::DerefMut for Daemon {
    fn deref_mut(&mut self) -> &mut Process {
        &mut self.0
    }
}

impl Daemon {
    pub fn start(domain: &TestDomain, arguments: &[&str]) -> Self {
        Self(DAEMON.start(domain, &[&["run"], arguments].concat()))
    }

    pub fn spawn(command: Command) -> Self {
        Self(Process::spawn(command))
    }

    pub fn of(child: Child) -> Self {
        Self(Process { child })
    }

    /// Waits for the end; exit code and log.
    pub fn finish(self) -> (Option<i32>, String) {
        let Ended { code, log, .. } = self.0.finish();
        (code, log)
    }

    /// Stops it as an operator does, and waits.
    pub fn stop(self) -> (Option<i32>, String) {
        let Ended { code, log, .. } = self.0.stop();
        (code, log)
    }
}

/// The id of a user without rights, under which root can run a program.
const NOBODY: u32 = 65_534;

/// `daemon` as a user without rights: if the tests run as root, a copy of the program that runs as `nobody`.
pub struct Unprivileged {
    pub domain: TestDomain,
    program: Option<tempfile::TempDir>,
}

impl Unprivileged {
    pub fn new() -> Self {
        let domain = TestDomain::new();
        if !rustix::process::geteuid().is_root() {
            return Self { domain, program: None };
        }
        let directory = tempfile::tempdir().unwrap();
        let open = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(directory.path(), open).unwrap();
        std::fs::copy(env!("CARGO_BIN_EXE_daemon"), directory.path().join("daemon")).unwrap();
        std::os::unix::fs::chown(domain.root(), Some(NOBODY), Some(NOBODY)).unwrap();
        Self { domain, program: Some(directory) }
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let Some(directory) = &self.program else { return daemon_command(&self.domain, arguments) };
        let mut command = Command::new(directory.path().join("daemon"));
        std::os::unix::process::CommandExt::uid(&mut command, NOBODY);
        std::os::unix::process::CommandExt::gid(&mut command, NOBODY);
        command
            .args(arguments)
            .arg("--root")
            .arg(self.domain.root())
            .current_dir("/")
            .env("OBSERVER_STATE", "none");
        command
    }
}

/// The preset `rigid-body` as a file, with lines before its first key and after its last table.
pub fn preset_between(before: &str, after: &str) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), format!("{before}\n{}\n{after}\n", daemon::config::PRESETS[0].1)).unwrap();
    file
}

/// Exit code, stdout and stderr of a finished command.
pub fn finished(output: Output) -> (Option<i32>, String, String) {
    let Ended { code, out, log } = output.into();
    (code, out, log)
}
