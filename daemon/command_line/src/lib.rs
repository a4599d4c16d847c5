//! What the command lines of all programs share: examples at the end of each help text, completions, man pages, and the
//! name under which the program is installed. Depends on no other crate of this workspace.
//!
//! A program declares its arguments as a type that derives [`clap::Parser`], and begins with
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
//! A test of each program checks that [`faults_of_help`] finds none.
//!
//! | module | holds |
//! |---|---|
//! | `program` | reading the arguments |
//! | `manual` | completions and man pages |
//! | `examples` | what a test asks of every help |
//! | `stop` | the signals that end a program |

mod examples;
mod manual;
mod program;
mod stop;

pub use examples::faults_of_help;
pub use program::{command, parse};
pub use stop::stop_flag;
