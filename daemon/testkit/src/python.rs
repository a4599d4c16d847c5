//! Python environments, one for each set of tests. The machine's own Python is not changed.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Both streams of a finished command.
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

/// `pip install` of these arguments.
///
/// # Errors
/// What pip said.
pub fn pip_install(python: &Path, what: &[&str]) -> Result<(), String> {
    let quietly = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input"];
    run(Command::new(python).args(quietly).args(what))
}

/// The interpreter of the environment in this directory, made with these packages where it is missing.
///
/// Tests may ask for one at the same time, from several processes: a lock beside it lets one of them make it.
///
/// # Errors
/// The reason why this machine has none: no Python 3.9, no package index.
pub fn environment(directory: &Path, packages: &[&str]) -> Result<PathBuf, String> {
    let said = |error: std::io::Error| format!("{}: {error}", directory.display());
    std::fs::create_dir_all(directory.parent().unwrap_or(Path::new("."))).map_err(said)?;
    let lock = File::create(directory.with_extension("lock")).map_err(said)?;
    lock.lock().map_err(said)?;
    let python = directory.join("bin/python");
    // What was installed; written last, so that an environment that was left half-made is made anew.
    let (list, needed) = (directory.join("packages"), packages.join("\n"));
    if std::fs::read_to_string(&list).is_ok_and(|found| found == needed) {
        return Ok(python);
    }
    run(Command::new("python3").args(["-c", "import sys; sys.exit(sys.version_info < (3, 9))"]))?;
    run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(directory))?;
    pip_install(&python, packages)?;
    std::fs::write(list, needed).map_err(said)?;
    Ok(python)
}
