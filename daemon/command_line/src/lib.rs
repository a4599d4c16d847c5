//! What the command lines of all programs have in common: each ends its help in examples that it accepts itself, prints
//! its completions, writes its man pages, and goes by the name it is installed under.
//!
//! A program says what is its own, as a type that derives [`Parser`], and begins with
//!
//! ```
//! # use clap::Parser;
//! # use std::{ffi::OsString, process::ExitCode};
//! /// Adds numbers.
//! #[derive(Debug, Parser)]
//! #[command(name = "add", after_help = "Examples:\n  # Three numbers\n  add 1 2 3")]
//! struct Arguments {
//!     /// What is added.
//!     numbers: Vec<f64>,
//! }
//!
//! fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
//!     match command_line::parse::<Arguments>(args) {
//!         Ok(arguments) => { println!("{}", arguments.numbers.iter().sum::<f64>()); ExitCode::SUCCESS }
//!         Err(code) => code,
//!     }
//! }
//! # assert_eq!(main_with_args(["add", "1", "2"].map(OsString::from)), ExitCode::SUCCESS);
//! # assert_eq!(main_with_args(["add", "one"].map(OsString::from)), ExitCode::from(2));
//! # assert!(command_line::faults_of_help::<Arguments>().is_empty());
//! ```
//!
//! and has a test that [`faults_of_help`] finds none.

mod examples;
mod manual;

use clap::{Command, FromArgMatches, Parser, Subcommand};
pub use examples::faults_of_help;
use manual::Manual;
use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::ExitCode;

/// What the build says of itself, if it was set: a commit, for example.
const BUILD: Option<&str> = option_env!("OBSERVER_BUILD");

/// Reads a program's arguments, its name first.
///
/// # Errors
/// The code to end with, where nothing is left to do: after help, version, completions and man pages (0), a message
/// about wrong usage (2), or a file that cannot be written (1).
pub fn parse<P: Parser>(args: impl IntoIterator<Item = OsString>) -> Result<P, ExitCode> {
    let args: Vec<OsString> = args.into_iter().collect();
    let installed_as = args.first().map(Path::new).and_then(Path::file_name).and_then(OsStr::to_str);
    let mut program = command::<P>(installed_as);
    let parsed = program.try_get_matches_from_mut(&args).and_then(|matches| {
        // The commands of this crate are unknown to the program.
        match Manual::from_arg_matches(&matches) {
            Ok(manual) => Ok(Err(manual)),
            Err(_) => P::from_arg_matches(&matches).map(Ok).map_err(|error| error.format(&mut program)),
        }
    });
    match parsed {
        Ok(Ok(arguments)) => Ok(arguments),
        Ok(Err(manual)) => Err(manual.run(command::<P>(installed_as))),
        Err(error) => {
            let _ = error.print();
            Err(ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2)))
        }
    }
}

/// The whole command line of a program, under the name it is installed as, or else its own.
pub fn command<P: Parser>(installed_as: Option<&str>) -> Command {
    let command = Manual::augment_subcommands(P::command()).subcommand_negates_reqs(true);
    let own_name = command.get_name().to_owned();
    let name = installed_as.unwrap_or(&own_name);
    let machine = format!("{} {}", std::env::consts::ARCH, std::env::consts::OS);
    let build = BUILD.map(|build| format!("{build}, ")).unwrap_or_default();
    let profile = if cfg!(debug_assertions) { "debug" } else { "release" };
    let version = env!("CARGO_PKG_VERSION");
    let command = command.version(version).long_version(format!("{version} ({build}{profile}, {machine})"));
    examples::named(manual::with_examples(command), &own_name, name).name(name.to_owned())
}
