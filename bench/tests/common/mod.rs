//! The roles of `bench` as real processes in a domain of their own.

#![allow(dead_code, unreachable_pub)] // each test file uses its part

use rustix::process::{Pid, Signal, kill_process};
use shared_types::Domain;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

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
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        let _ = self.domain.remove();
    }
}

/// `bench` with these arguments.
pub fn bench(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bench"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// The directories and segments that a process of `bench` has in shared memory.
pub fn shared_memory_of(pid: u32) -> Vec<PathBuf> {
    let prefix = format!("bench{pid}-");
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let its =
        entries.filter(|entry| entry.file_name().to_str().is_some_and(|name| name.starts_with(&prefix)));
    its.map(|entry| entry.path()).collect()
}

/// `bench` with these arguments, run to its end; nothing of it may stay in shared memory.
pub fn run_and_leave_nothing(arguments: &[&str]) -> Output {
    let child = bench(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let pid = child.id();
    let output = child.wait_with_output().unwrap();
    let left = shared_memory_of(pid);
    assert!(left.is_empty(), "{left:?}; {}", text(&output.stderr));
    output
}

/// One process of the demo, killed when the test ends.
pub struct Role(pub Child);

impl Role {
    pub fn start(domain: &TestDomain, arguments: &[&str]) -> Self {
        let mut command = bench(arguments);
        command.arg("--root").arg(domain.root()).env("OBSERVER_STATE", domain.state.path());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        Self(command.spawn().unwrap())
    }

    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).unwrap();
    }

    /// Kills it at once, without any chance to clean up.
    pub fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    pub fn finish(mut self, patience: Duration) -> Output {
        let deadline = Instant::now() + patience;
        while self.0.try_wait().unwrap().is_none() {
            assert!(Instant::now() < deadline, "the process does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
        let read = |from: &mut dyn std::io::Read| {
            let mut bytes = Vec::new();
            from.read_to_end(&mut bytes).unwrap();
            bytes
        };
        let stdout = read(self.0.stdout.as_mut().unwrap());
        let stderr = read(self.0.stderr.as_mut().unwrap());
        Output { status: self.0.wait().unwrap(), stdout, stderr }
    }

    pub fn stop(self) -> Output {
        self.signal(Signal::TERM);
        self.finish(Duration::from_secs(10))
    }
}

impl Drop for Role {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub fn text(bytes: &[u8]) -> &str {
    str::from_utf8(bytes).unwrap()
}
