//! The service, the simulator and the monitor as real processes, in a domain of their own.

#![allow(dead_code, unreachable_pub)] // each test file uses its part

use rustix::process::{Pid, Signal, kill_process};
use shared_types::payload::{Status, command};
use shared_types::{Client, Domain};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

pub const PATIENCE: Duration = Duration::from_secs(30);

pub struct TestDomain {
    pub domain: Domain,
    state: tempfile::TempDir,
    _root: tempfile::TempDir,
}

impl TestDomain {
    pub fn new() -> Self {
        let root = tempfile::Builder::new().prefix("ot").tempdir_in("/dev/shm").unwrap();
        let state = tempfile::tempdir().unwrap();
        Self { domain: Domain::at(root.path()).unwrap(), state, _root: root }
    }

    pub fn root(&self) -> &str {
        self.domain.root().to_str().unwrap()
    }

    pub fn status(&self) -> Status {
        let client = Client::connect(&self.domain, "vehicle", PATIENCE).unwrap();
        client.command(command::STATUS, PATIENCE).unwrap().status
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

const ROLE: &str = "MONITOR_TEST_ROLE";

/// What a test named `role` of each file calls: does nothing in a test run, and is `daemon` or `sim_publisher` where
/// this program was started as one. Their own programs are built for their own packages' tests alone.
pub fn play_role() {
    let Ok(arguments) = std::env::var(ROLE) else { return };
    let arguments: Vec<_> = arguments.split(' ').map(std::ffi::OsString::from).collect();
    let done = match arguments[0].to_str() {
        Some("daemon") => daemon::cli::main_with_args(arguments),
        _ => sim_publisher::main_with_args(arguments),
    };
    std::process::exit(i32::from(done != std::process::ExitCode::SUCCESS));
}

/// A process, killed when the test ends.
pub struct Role(pub Child);

impl Role {
    /// `daemon …` or `sim_publisher …`.
    pub fn start(domain: &TestDomain, arguments: &str) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["role", "--exact", "--nocapture"]);
        command.env(ROLE, format!("{arguments} --root {}", domain.root()));
        command.env("OBSERVER_STATE", domain.state.path());
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).unwrap();
    }

    /// Stops it as an operator does, and waits.
    pub fn stop(mut self) {
        self.signal(Signal::TERM);
        assert!(self.0.wait().unwrap().success());
    }

    /// Kills it at once.
    pub fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Role {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `monitor` with these arguments in that domain.
pub fn monitor(domain: &TestDomain, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_monitor"));
    command.args(arguments).args(["--root", domain.root()]).stdin(Stdio::null());
    command
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
        std::thread::sleep(Duration::from_millis(20));
    }
}
