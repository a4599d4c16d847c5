//! What the command lines of all programs have in common: each ends its help in examples that it accepts itself, prints
//! its completions, writes its man pages, and goes by the name it is installed under.
//!
//! A program says what is its own, as a type that derives [`clap::Parser`], and begins with
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
//! and has a test that [`faults_of_help`] finds none. Depends on nothing of ours.
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
