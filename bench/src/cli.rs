//! The command line of `bench`.

use crate::flights::{replay, tune};
use crate::{accuracy, demo, hover, ipc, jitter, load, paper, sensors, service, soak, step};
use clap::{Parser, Subcommand};
use daemon::config::ConfigError;
use rustix::process::{Signal, set_parent_process_death_signal};
use shared_types::logln;
use sim_publisher::faults::FaultError;
use std::ffi::OsString;
use std::process::ExitCode;

/// Measure the observer and its service.
///
/// Results go to stdout, progress and log to stderr. Exit codes: 0 done, 1 failed while running, 2 wrong
/// usage or configuration.
#[derive(Debug, Parser)]
#[command(
    name = "bench",
    after_help = "\
Examples:
  # The service and a simulated vehicle, a table and a plot
  bench demo
  # A first look at the speed of this machine
  bench step --quick"
)]
struct Arguments {
    #[command(subcommand)]
    command: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// The main job in one command: service and simulated vehicle as two processes, live progress, then a
    /// table and a plot.
    #[command(after_help = demo::after_help())]
    Demo(demo::DemoArguments),
    /// Latency of a whole step as the number of kernel centers grows.
    #[command(after_help = "\
Examples:
  # Within 20 s
  bench step --quick
  bench step --centers 27,125,343 --plot step.svg")]
    Step(step::StepArguments),
    /// A round trip through the service beside one through bare shared memory, and both one-way times.
    #[command(after_help = "\
Needs two cores: the service polls on one, its client on the other.

Examples:
  bench ipc
  # At the pace of a vehicle instead of back to back
  bench ipc --pause-us 1000 --samples 10000
  bench ipc --preset paper-translation --json")]
    Ipc(ipc::IpcArguments),
    /// A sample's stamp to the estimate in the reader's hands, by trigger and rate.
    #[command(after_help = "\
Needs two cores: the service polls on one, its client on the other.

Examples:
  bench service
  bench service --rates-hz 500 --triggers sample --plot service.svg")]
    Service(service::ServiceArguments),
    /// How late the service's cycle wakes up, beside cyclictest at the same rate and priority.
    #[command(after_help = "\
Examples:
  # Run it as root, or with the right to SCHED_FIFO, to see all modes
  bench jitter
  bench jitter --rates-hz 1000 --seconds 60")]
    Jitter(jitter::JitterArguments),
    /// What further readers of one service, and further vehicles on one machine, cost.
    #[command(after_help = "\
Needs two cores: the service polls on one, its client on the other.

Examples:
  bench load
  bench load --instances 1,2 --readers 1,16 --json")]
    Load(load::LoadArguments),
    /// A long run beside processes that load all cores: losses are counted, and growing memory is a failure.
    #[command(after_help = "\
Examples:
  bench soak --seconds 60
  # With a further argument of daemon run
  bench soak --service=--require-real-time")]
    Soak(soak::SoakArguments),
    /// The paper's examples, run exactly and deterministically: a table, the figures, and the errors; every number of
    /// the paper is an option.
    #[command(after_help = "\
Examples:
  # At the paper's own numbers
  bench paper --scenario translation
  # At others
  bench paper --scenario rotation --dead-zone saturated --width 0.02")]
    Paper(paper::PaperArguments),
    /// Sensors as vehicles have them: several processes, slow and late ones; beside the same samples at once.
    #[command(after_help = "\
Examples:
  bench sensors
  bench sensors --sensors auv-survey --json")]
    Sensors(sensors::SensorsArguments),
    /// What the sensor's noise alone teaches the gradient law: f̂ of a hover in still air.
    #[command(after_help = "\
Examples:
  bench hover
  bench hover --minutes 60 --plot hover.svg")]
    Hover(hover::HoverArguments),
    /// Accuracy on many flights, beside other estimators: every flight of a directory, one configuration, a table and a page.
    #[command(after_help = "\
Examples:
  bench accuracy flights --html accuracy.html
  bench accuracy monday.log --warm sunday.log
  bench accuracy --simulated --json")]
    Accuracy(accuracy::AccuracyArguments),
    /// Accuracy on a recorded flight, beside a Kalman filter; offline. Or: whether a flight record replays to the bit.
    #[command(after_help = "\
Examples:
  bench replay --format acsl log_20240613_121802.log --plot coasts.svg
  # A table of your own, and two seconds without measurements
  bench replay --format csv flight.csv --config vehicle.toml \\
      --coast-s 2
  # What daemon run --record wrote
  bench replay --check flight.rec")]
    Replay(replay::ReplayArguments),
    /// A configuration for a recorded flight: the numbers of the law that matter, searched on its first half and judged on
    /// its second.
    #[command(
        after_help = "Examples:\n  bench tune log_20240613_121802.log --out x8.toml\n  bench tune flight.csv --config vehicle.toml --mass --coast-s 2"
    )]
    Tune(tune::TuneArguments),
}

/// Runs `bench` with these arguments, the program's name first.
///
/// With `daemon` or `sim_publisher` as the first argument it is that program. So `bench demo` has both sides as processes
/// of the same build. With `echo` it is the other side of `bench ipc`, with `burn` the load of `bench soak`. Such a process
/// ends with the one that started it.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let args: Vec<OsString> = args.into_iter().collect();
    let role = args.get(1).and_then(|role| role.to_str());
    if matches!(role, Some("daemon" | "sim_publisher" | "echo" | "burn")) {
        // Best effort: without it, a killed demo leaves two processes behind that the next one does not see.
        let _ = set_parent_process_death_signal(Some(Signal::TERM));
    }
    match role {
        Some("daemon") => return daemon::cli::main_with_args(args.into_iter().skip(1)),
        Some("sim_publisher") => return sim_publisher::main_with_args(args.into_iter().skip(1)),
        Some("echo") => return finish(ipc::echo(&args[2..])),
        Some("burn") => return finish(soak::burn()),
        _ => {}
    }
    let arguments = match command_line::parse::<Arguments>(args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    finish(match &arguments.command {
        Task::Demo(arguments) => demo::run(arguments),
        Task::Step(arguments) => step::run(arguments),
        Task::Ipc(arguments) => ipc::run(arguments),
        Task::Service(arguments) => service::run(arguments),
        Task::Jitter(arguments) => jitter::run(arguments),
        Task::Load(arguments) => load::run(arguments),
        Task::Soak(arguments) => soak::run(arguments),
        Task::Paper(arguments) => paper::run(arguments),
        Task::Hover(arguments) => hover::run(arguments),
        Task::Sensors(arguments) => sensors::run(arguments),
        Task::Accuracy(arguments) => accuracy::run(arguments),
        Task::Replay(arguments) => replay::run(arguments),
        Task::Tune(arguments) => tune::run(arguments),
    })
}

fn finish(done: anyhow::Result<()>) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            logln!("bench: {error:#}");
            let is_usage =
                error.is::<ConfigError>() || error.is::<paper::UsageError>() || error.is::<FaultError>();
            ExitCode::from(if is_usage { 2 } else { 1 })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_help_ends_in_examples_that_are_accepted() {
        assert_eq!(command_line::faults_of_help::<Arguments>(), Vec::<String>::new());
    }
}
