//! The true plant, or a recorded flight, as live samples.

use std::process::ExitCode;

fn main() -> ExitCode {
    sim_publisher::main_with_args(std::env::args_os())
}
