//! The programs of these tests.

use testkit::{Ended, Process, Program, TestDomain};

pub(crate) const MONITOR: Program = Program::At(env!("CARGO_BIN_EXE_monitor"));
const DAEMON: Program = Program::Played("daemon");
const SIMULATOR: Program = Program::Played("sim_publisher");

fn words(arguments: &str) -> Vec<&str> {
    arguments.split_whitespace().collect()
}

/// `daemon run` with these arguments, in that domain.
pub(crate) fn service(domain: &TestDomain, arguments: &str) -> Process {
    DAEMON.start(domain, &[&["run"], &words(arguments)[..]].concat())
}

/// The simulated multicopter with these arguments.
pub(crate) fn vehicle(domain: &TestDomain, arguments: &str) -> Process {
    simulator(domain, &format!("run --scenario rigid-body {arguments}"))
}

/// `sim_publisher` with these arguments.
pub(crate) fn simulator(domain: &TestDomain, arguments: &str) -> Process {
    SIMULATOR.start(domain, &words(arguments))
}

/// `monitor` with these arguments, run to its end.
pub(crate) fn monitor(domain: &TestDomain, arguments: &[&str]) -> Ended {
    Ended::of(&mut MONITOR.command_in(domain, arguments))
}
