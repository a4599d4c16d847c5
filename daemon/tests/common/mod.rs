//! A domain of its own for every test, and the real program in it.

#![allow(dead_code, unreachable_pub)] // each test file uses its part

use shared_types::payload::{Status, command};
use shared_types::{Client, Domain};
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

pub const PATIENCE: Duration = Duration::from_secs(10);

/// A root path that is removed, with all segments, when the test ends.
pub struct TestDomain {
    pub domain: Domain,
    /// Snapshots of its services.
    pub state: tempfile::TempDir,
    _root: tempfile::TempDir,
}

impl TestDomain {
    pub fn new() -> Self {
        let root = tempfile::Builder::new().prefix("ot").tempdir_in("/dev/shm").unwrap();
        // In memory: a busy disk may take seconds to sync.
        let state = tempfile::Builder::new().prefix("os").tempdir_in("/dev/shm").unwrap();
        Self { domain: Domain::at(root.path()).unwrap(), state, _root: root }
    }

    pub fn root(&self) -> &Path {
        self.domain.root()
    }

    pub fn client(&self) -> Client {
        Client::connect(&self.domain, "vehicle", PATIENCE).unwrap()
    }

    pub fn status(&self) -> Status {
        self.client().command(command::STATUS, PATIENCE).unwrap().status
    }

    /// Nothing of the domain is left but, perhaps, its empty root path.
    pub fn assert_clean(&self) {
        assert_eq!(self.domain.segments().unwrap(), Vec::<std::path::PathBuf>::new());
        let left: Vec<_> = std::fs::read_dir(self.root()).into_iter().flatten().flatten().collect();
        assert!(left.is_empty(), "{left:?}");
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        let _ = self.domain.remove();
    }
}

/// `daemon` with these arguments in that domain.
pub fn daemon_command(domain: &TestDomain, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_daemon"));
    command.args(arguments).arg("--root").arg(domain.root()).env("OBSERVER_STATE", domain.state.path());
    command
}

/// `daemon run`, killed when the test ends.
pub struct Daemon {
    pub child: Child,
}

impl Daemon {
    pub fn start(domain: &TestDomain, arguments: &[&str]) -> Self {
        Self::spawn(daemon_command(domain, &[&["run"], arguments].concat()))
    }

    pub fn spawn(mut command: Command) -> Self {
        Self { child: command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap() }
    }

    pub fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, signal).unwrap();
    }

    /// Waits for the end; exit code and log.
    pub fn finish(mut self) -> (Option<i32>, String) {
        let deadline = Instant::now() + PATIENCE;
        while self.child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < deadline, "the daemon does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
        let mut log = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut log).unwrap();
        (self.child.wait().unwrap().code(), log)
    }

    /// Stops it as an operator does, and waits.
    pub fn stop(self) -> (Option<i32>, String) {
        self.signal(rustix::process::Signal::TERM);
        self.finish()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A user without any rights, as whom root can run a program.
const NOBODY: u32 = 65_534;

/// `daemon` for a user without rights: where the tests run as root, a copy of the program, run as nobody.
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
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

pub fn wait_until(what: &str, mut test: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !test() {
        assert!(Instant::now() < deadline, "waited {PATIENCE:?} for: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}
