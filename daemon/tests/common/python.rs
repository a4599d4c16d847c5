//! Environments of Python, one for each set of tests: nothing of the machine's own is changed.

#![allow(dead_code, unreachable_pub)] // each test file uses its part

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Both streams.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

fn run(command: &mut Command) -> Result<(), String> {
    match command.output() {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => Err(format!("{command:?}: {}", said(&output))),
        Err(error) => Err(format!("{command:?}: {error}")),
    }
}

pub fn pip_install(python: &Path, what: &[&str]) -> Result<(), String> {
    let quietly = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input"];
    run(Command::new(python).args(quietly).args(what))
}

/// The interpreter of an environment of this name with these packages, or why this machine gives none.
pub fn environment(name: &str, packages: &[&str]) -> Result<PathBuf, String> {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let python = directory.join("bin/python");
    run(Command::new("python3").args(["-c", "import sys; sys.exit(sys.version_info < (3, 9))"]))?;
    if run(Command::new(&python).args(["-m", "pip", "--version"])).is_err() {
        run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&directory))?;
    }
    pip_install(&python, packages)?;
    Ok(python)
}
