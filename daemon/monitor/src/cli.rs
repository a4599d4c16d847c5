//! The command line of `monitor`.
//!
//! stdout carries results, stderr the log. Exit codes: 0 done, 1 failed while running, 2 wrong usage.

use crate::lines::{lines, once};
use crate::link::Whence;
use crate::record::{self, Compression, record};
use crate::serve::serve;
use crate::view::screen;
use crate::view::theme::Theme;
use anyhow::Context;
use clap::{Args, Parser, Subcommand};
use shared_types::service::{ServiceError, check_instance_name};
use shared_types::{Domain, DomainError, logln, outln};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::ffi::OsString;
use std::io::{ErrorKind, IsTerminal, stdout};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A live view of the estimation service: state, learned force, trust, samples, latencies, in a terminal.
///
/// Reads shared memory like any other reader, and follows the service when it is started again.
/// Needs a terminal of 80 × 24 for the whole view; ? shows the keys.
#[derive(Debug, Parser)]
#[command(
    name = "monitor",
    args_conflicts_with_subcommands = true,
    after_help = "\
Colours: none if NO_COLOR is set.

Examples:
  # Another vehicle, over a slow link
  monitor --instance auv1 --fps 1
  # The status as text, once
  monitor --once
  # A vehicle on another machine, beside the tunnel
  monitor --remote --root /dev/shm/ground
  # A hundred estimates for a script
  monitor --json --count 100 > estimates.jsonl
  # A file, and a live stream, for Foxglove and PlotJuggler
  monitor record flight.mcap
  monitor serve"
)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    target: Target,
    /// The service runs on another machine, and a link brings what it says (docs/across-machines.md): ages count from
    /// the shortest way here, and no command crosses it
    #[arg(long)]
    remote: bool,
    /// Pictures per second at most, 0.1 to 60: fewer on a slow link
    #[arg(long, value_name = "HZ", default_value_t = 4.0, value_parser = parse_fps)]
    fps: f64,
    /// Print the status once as text; with --json as one document
    #[arg(long)]
    once: bool,
    /// Print each estimate as a line of JSON: the fields of an Estimate, units in their names, and status_words;
    /// null is a number that is not finite (no measurement yet, coasting)
    #[arg(long)]
    json: bool,
    /// End after this many estimates
    #[arg(long, value_name = "N", requires = "json", conflicts_with = "once")]
    count: Option<u64>,
}

/// Which service to read.
#[derive(Debug, Args)]
struct Target {
    /// Name of the vehicle
    #[arg(long, value_name = "NAME", default_value = "vehicle")]
    instance: String,
    /// Root path of the shared-memory domain [default: /dev/shm/observer-UID]
    #[arg(long, value_name = "PATH", env = shared_types::domain::ROOT_VARIABLE)]
    root: Option<PathBuf>,
}

impl Target {
    /// The shared memory's domain; the vehicle's name is checked, too.
    fn domain(&self) -> anyhow::Result<Domain> {
        check_instance_name(&self.instance)?;
        Ok(Domain::at_or_of_user(self.root.as_deref())?)
    }
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Writes measurements, estimates, truth and status to an MCAP file
    ///
    /// Foxglove and PlotJuggler open it; sim_publisher replay and bench replay play its measurements. Ends on Ctrl-C; what
    /// is written is whole up to the last half second, even if the recorder is killed.
    #[command(after_help = "\
Examples:
  monitor record flight.mcap
  # Ten seconds of another vehicle, and what was recorded as a document
  monitor record dive.mcap --instance auv1 --duration-s 10 --json")]
    Record(RecordArguments),
    /// Serves the same live to Foxglove, over its WebSocket protocol
    ///
    /// In Foxglove: Open connection, and the address that is printed. Every client that reaches the address can read
    /// everything and change nothing; there is no password and no encryption. By default only this machine can, which
    /// includes its other users and the pages in its browsers.
    #[command(after_help = "\
Examples:
  monitor serve
  # To other machines
  monitor serve --listen 0.0.0.0:8765")]
    Serve(ServeArguments),
}

#[derive(Debug, Args)]
struct RecordArguments {
    /// The file to write
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,
    /// Replace the file if it is there
    #[arg(long)]
    force: bool,
    /// End this long after the first message, in s [default: on Ctrl-C]
    #[arg(long, visible_alias = "duration", value_name = "S", value_parser = parse_duration)]
    duration_s: Option<f64>,
    /// Compression of the file
    #[arg(long, value_enum, default_value_t = Compression::Lz4)]
    compression: Compression,
    /// Print what was recorded as one JSON document
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    target: Target,
}

#[derive(Debug, Args)]
struct ServeArguments {
    /// Where to listen; port 0 takes a free one
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:8765")]
    listen: SocketAddr,
    /// End after this long, in s [default: on Ctrl-C]
    #[arg(long, visible_alias = "duration", value_name = "S", value_parser = parse_duration)]
    duration_s: Option<f64>,
    #[command(flatten)]
    target: Target,
}

fn parse_duration(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(duration_s) if (0.0..=1e9).contains(&duration_s) && duration_s > 0.0 => Ok(duration_s),
        _ => Err("needed: a number of seconds above 0".into()),
    }
}

fn parse_fps(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fps) if (0.1..=60.0).contains(&fps) => Ok(fps),
        _ => Err("needed: a number from 0.1 to 60".into()),
    }
}

/// Runs `monitor` with these arguments, the program's name first.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Arguments = match command_line::parse(args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        // `| head` has read enough.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            logln!("monitor: {error:#}");
            let wrong_usage = error.is::<DomainError>()
                || error.is::<NoTerminal>()
                || matches!(error.downcast_ref(), Some(ServiceError::InstanceName(_)));
            ExitCode::from(if wrong_usage { 2 } else { 1 })
        }
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<std::io::Error>().is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

#[derive(Debug, thiserror::Error)]
#[error("{0}; needed: a terminal that places its cursor, or --once (text), or --json (a line per estimate)")]
struct NoTerminal(&'static str);

fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    // `--once` runs for seconds at most: the default action of a signal will do.
    for signal in [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|_| !arguments.once) {
        // A second signal ends the program immediately: the first may wait for a terminal that accepts no more output.
        signal_hook::flag::register_conditional_default(signal, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .context("register signal handler")?;
    }
    match &arguments.command {
        Some(Command::Record(RecordArguments { file, force, duration_s, compression, json, target })) => {
            let options =
                record::Options { file, force: *force, compression: *compression, duration_s: *duration_s };
            let summary = record(&target.domain()?, &target.instance, &options, &stop)?;
            match json {
                true => outln!("{}", serde_json::to_string_pretty(&summary)?),
                false => outln!("{summary}"),
            }
            return Ok(());
        }
        Some(Command::Serve(ServeArguments { listen, duration_s, target })) => {
            return serve(&target.domain()?, &target.instance, *listen, *duration_s, &stop);
        }
        None => {}
    }
    let whence = if arguments.remote { Whence::AnotherMachine } else { Whence::ThisMachine };
    let domain = arguments.target.domain()?;
    let instance = &arguments.target.instance;
    match arguments {
        Arguments { once: true, json, .. } => once(&domain, instance, whence, *json),
        Arguments { json: true, count, .. } => lines(&domain, instance, whence, *count, &stop),
        _ if !stdout().is_terminal() => Err(NoTerminal("the output is no terminal").into()),
        _ if std::env::var_os("TERM").is_some_and(|term| term == "dumb") => {
            Err(NoTerminal("TERM is 'dumb'").into())
        }
        Arguments { fps, .. } => {
            let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
            screen::run(&domain, instance, whence, *fps, Theme { is_coloured: !no_colour }, &stop)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_ends_in_examples_that_are_understood() {
        assert_eq!(command_line::faults_of_help::<Arguments>(), Vec::<String>::new());
    }
}
