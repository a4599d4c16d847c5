//! The program `sim_publisher`; see `sim_publisher --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    sim_publisher::main_with_args(std::env::args_os())
}
