//! Runs `bench` as the program under test; it contains the service, the simulator and the bridge too.

use serde_json::Value;
use std::path::PathBuf;
use testkit::{Ended, Process, Program};

pub(crate) const BENCH: Program = Program::At(env!("CARGO_BIN_EXE_bench"));

/// `bench` with these arguments, run to its end.
pub(crate) fn bench(arguments: &[&str]) -> Ended {
    Ended::of(&mut BENCH.command(arguments))
}

/// The JSON document that `bench` prints with these arguments.
#[track_caller]
pub(crate) fn document(arguments: &[&str]) -> Value {
    serde_json::from_str(&bench(arguments).ok()).unwrap()
}

/// The directories and segments that a process of `bench` has in shared memory.
pub(crate) fn shared_memory_of(pid: u32) -> Vec<PathBuf> {
    let prefix = format!("bench{pid}-");
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let its =
        entries.filter(|entry| entry.file_name().to_str().is_some_and(|name| name.starts_with(&prefix)));
    its.map(|entry| entry.path()).collect()
}

/// `bench` with these arguments, run to its end; nothing of it may stay in shared memory.
#[track_caller]
pub(crate) fn run_and_leave_nothing(arguments: &[&str]) -> Ended {
    let process = Process::spawn(BENCH.command(arguments));
    let pid = process.pid();
    let ended = process.finish_within(20 * testkit::PATIENCE);
    let left = shared_memory_of(pid);
    assert!(left.is_empty(), "{left:?}; {}", ended.log);
    ended
}
