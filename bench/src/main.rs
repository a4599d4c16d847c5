//! The program `bench`; see `bench --help`.

fn main() -> std::process::ExitCode {
    bench::cli::main_with_args(std::env::args_os())
}
