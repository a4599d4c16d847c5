//! The state-estimation service's program; see `daemon --help`.

fn main() -> std::process::ExitCode {
    daemon::cli::main_with_args(std::env::args_os())
}
