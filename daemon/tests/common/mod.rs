//! Helpers of these tests beside `testkit`: the daemon as a process.

#![allow(dead_code, unused_imports, unreachable_pub)] // each test file uses its part

use std::process::Command;
use testkit::Program;
pub use testkit::{Ended, PATIENCE, Process, TestDomain, wait_until};

pub const DAEMON: Program = Program::At(env!("CARGO_BIN_EXE_daemon"));

/// `daemon` with these arguments in that domain.
pub fn daemon_command(domain: &TestDomain, arguments: &[&str]) -> Command {
    DAEMON.command_in(domain, arguments)
}

/// `daemon run` with these arguments in that domain.
pub fn run_daemon(domain: &TestDomain, arguments: &[&str]) -> Process {
    DAEMON.start(domain, &[&["run"], arguments].concat())
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
