//! The command line of `bench`.

use crate::{demo, paper, replay, step};
use clap::{Parser, Subcommand};
use daemon::config::ConfigError;
use rustix::process::{Signal, set_parent_process_death_signal};
use shared_types::logln;
use std::ffi::OsString;
use std::process::ExitCode;

/// Measure the observer and its service.
///
/// Results go to stdout, progress and log to stderr. Exit codes: 0 done, 1 failed while running, 2 wrong
/// usage or configuration.
#[derive(Debug, Parser)]
#[command(name = "bench", version, after_help = "Example: bench demo")]
struct Arguments {
    #[command(subcommand)]
    command: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// The main job in one command: service and simulated vehicle as two processes, live progress, then a
    /// table and a plot.
    #[command(
        after_help = "Examples:\n  bench demo\n  bench demo --scenario auv --duration 60 --outage 40:3"
    )]
    Demo(demo::DemoArguments),
    /// Latency of a whole step as the number of kernel centers grows.
    #[command(after_help = "Example: bench step --centers 27,125,343 --plot step.png")]
    Step(step::StepArguments),
    /// The paper's examples, run exactly and deterministically: a table, the figures, and the errors; every number of
    /// the paper is an option.
    #[command(
        after_help = "Examples:\n  bench paper --scenario translation\n  bench paper --scenario translation --dead-zone saturated --adaptation-rate 100\n  bench paper --scenario rotation --dead-zone saturated --width 0.02"
    )]
    Paper(paper::PaperArguments),
    /// Accuracy on a recorded flight, beside a Kalman filter; offline.
    #[command(after_help = "Example: bench replay --format acsl log_20240613_121802.log --plot coasts.png")]
    Replay(replay::ReplayArguments),
}

/// Runs `bench` with these arguments, the program's name first.
///
/// With `daemon` or `sim_publisher` as the first argument it is that program: so `bench demo` has both sides
/// as processes of their own, whatever else is installed. Such a process ends with the one that started it.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let args: Vec<OsString> = args.into_iter().collect();
    let role = args.get(1).and_then(|role| role.to_str());
    if matches!(role, Some("daemon" | "sim_publisher")) {
        // Best effort: without it, a killed demo leaves two processes behind that the next one does not see.
        let _ = set_parent_process_death_signal(Some(Signal::TERM));
    }
    match role {
        Some("daemon") => return daemon::cli::main_with_args(args.into_iter().skip(1)),
        Some("sim_publisher") => return sim_publisher::main_with_args(args.into_iter().skip(1)),
        _ => {}
    }
    let arguments = match Arguments::try_parse_from(args) {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    let done = match &arguments.command {
        Task::Demo(arguments) => demo::run(arguments),
        Task::Step(arguments) => step::run(arguments),
        Task::Paper(arguments) => paper::run(arguments),
        Task::Replay(arguments) => replay::run(arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            logln!("bench: {error:#}");
            let is_usage = error.is::<ConfigError>() || error.is::<paper::UsageError>();
            ExitCode::from(if is_usage { 2 } else { 1 })
        }
    }
}
