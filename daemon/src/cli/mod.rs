//! The command line of `daemon`: one file for each subcommand.
//!
//! stdout carries results, stderr the log. Exit codes: 0 done, 1 failed while running, 2 wrong usage or
//! configuration.

mod arguments;
mod check;
mod config;
mod control;
mod doctor;
mod run;
mod snapshot;

use crate::config::ConfigError;
use crate::log::say;
use crate::service::StartError;
use crate::snapshot::SnapshotError;
use arguments::DesignArguments;
use clap::{Parser, Subcommand};
use shared_types::DomainError;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

/// State estimation next to a flight or underwater vehicle's process.
///
/// Reads measurements from shared memory at a fixed rate, writes position, velocity, attitude, angular
/// velocity and the learned unknown force and torque back.
#[derive(Debug, Parser)]
#[command(
    name = "daemon",
    after_help = "\
Examples:
  # A multicopter's service; the simulator, or a vehicle, feeds it
  daemon run --preset rigid-body
  # A configuration to start from, and what is proven for it
  daemon config --preset auv > vehicle.toml
  daemon check --config vehicle.toml"
)]
struct Arguments {
    #[command(subcommand)]
    command: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Run the service until SIGINT or SIGTERM.
    #[command(after_help = "\
Examples:
  # A second vehicle on this machine
  daemon run --preset auv --instance auv1
  # What flies: a core of its own, and no start without it
  daemon run --config vehicle.toml --cores 2 --require-real-time
  # Every sample and tick, to replay: bench replay --check flight.rec
  daemon run --config vehicle.toml --record flight.rec")]
    Run(run::RunArguments),
    /// Look at a snapshot of what was learned.
    #[command(after_help = snapshot::SNAPSHOT_EXAMPLES)]
    Snapshot(snapshot::SnapshotArguments),
    /// Print the effective configuration as commented TOML: a file to start from.
    #[command(after_help = "\
Examples:
  # A file to start from, each key with what it means
  daemon config --preset rigid-body > vehicle.toml
  # What a file means with all defaults; refused with its line if it is wrong
  daemon config --config vehicle.toml")]
    Config {
        #[command(flatten)]
        design: DesignArguments,
    },
    /// Print what every key of a configuration means: type, unit, default, bounds, an example.
    #[command(after_help = "\
Examples:
  daemon config-reference | less
  # For an editor that knows TOML: the line #:schema PATH above a configuration
  daemon config-reference --schema > configuration.schema.json")]
    ConfigReference {
        /// Print the JSON schema instead of the text.
        #[arg(long)]
        schema: bool,
    },
    /// Tell what is proven for a configuration, without starting anything.
    ///
    /// Controllability, observability, poles, strict positive realness, the error bounds of the theorems,
    /// the stability of the sampled law, the centers' cover and condition, and what would be better.
    #[command(after_help = "\
Examples:
  # Exit code 2 if the service would refuse it
  daemon check --config vehicle.toml
  daemon check --preset paper-translation --json")]
    Check(check::CheckArguments),
    /// Tell what this machine grants, measured.
    ///
    /// How late threads wake up with each setting; scheduling rights, locked memory, cores, clock, kernel,
    /// shared memory, stale files: each with the command that would help. Needs no rights; changes nothing.
    #[command(after_help = "\
Examples:
  daemon doctor
  # Ten seconds for each setting, at another priority
  daemon doctor --seconds 10 --priority 50
  # The rate and the settings of a configuration
  daemon doctor --config vehicle.toml --json")]
    Doctor(doctor::DoctorArguments),
    /// Print the domain's iceoryx2 configuration, for programs of others.
    ///
    /// iox2, and the link to another machine (docs/across-machines.md), read it as config/iceoryx2.toml in
    /// the directory in which they are started. The root path is made here, if it is missing, so that it is
    /// this user's alone.
    #[command(after_help = "\
Examples:
  mkdir -p link/config
  daemon iceoryx2-config > link/config/iceoryx2.toml")]
    Iceoryx2Config {
        /// Root path of the shared-memory domain [default: /dev/shm/observer-UID].
        #[arg(long, value_name = "PATH", env = shared_types::domain::ROOT_VARIABLE)]
        root: Option<PathBuf>,
    },
    /// Talk to a running service.
    #[command(after_help = "\
Examples:
  # What it did, how late it was, what the system granted
  daemon control status
  # Keep what was learned as it is, and write it down
  daemon control freeze --instance auv1
  daemon control save --instance auv1")]
    Control(control::ControlArguments),
}

/// Runs `daemon` with these arguments, the program's name first.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match command_line::parse::<Arguments>(args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    let done = match arguments.command {
        Task::Run(arguments) => run::run(&arguments),
        Task::Snapshot(arguments) => snapshot::run(&arguments),
        Task::Config { design } => config::effective(&design),
        Task::ConfigReference { schema } => {
            config::print_reference(schema);
            Ok(())
        }
        Task::Check(arguments) => check::run(&arguments),
        Task::Doctor(arguments) => doctor::run(&arguments),
        Task::Iceoryx2Config { root } => config::iceoryx2(root.as_deref()),
        Task::Control(arguments) => control::run(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say!("{error:#}");
            let wrong_usage = error.is::<ConfigError>()
                || error.is::<DomainError>()
                || matches!(error.downcast_ref(), Some(SnapshotError::Damaged(..)))
                || error.downcast_ref::<StartError>().is_some_and(StartError::is_wrong_usage);
            ExitCode::from(if wrong_usage { 2 } else { 1 })
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
