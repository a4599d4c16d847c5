//! The monitor's program; see `monitor --help`.

fn main() -> std::process::ExitCode {
    monitor::main_with_args(std::env::args_os())
}
