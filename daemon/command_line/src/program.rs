//! A program's command line: its own arguments and the common commands, under the name that it is installed as.

use crate::manual::{Manual, with_examples};
use clap::builder::StyledStr;
use clap::{Command, FromArgMatches, Parser, Subcommand};
use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::ExitCode;

/// The description of the build, if it was set: a commit, for example.
const BUILD: Option<&str> = option_env!("OBSERVER_BUILD");

/// Reads a program's arguments, its name first.
///
/// # Errors
/// The exit code, if nothing is left to do: after help, version, completions and man pages (0), a message
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
    named(with_examples(command), &own_name, name).name(name.to_owned())
}

/// The command with the name that it is installed under in the examples of all of its commands.
fn named(command: Command, own_name: &str, name: &str) -> Command {
    let renamed = command.get_after_help().map(|text| {
        let (old, new) = (format!("\n  {own_name} "), format!("\n  {name} "));
        StyledStr::from(text.to_string().replace(&old, &new))
    });
    let command = match renamed {
        Some(text) => command.after_help(text),
        None => command,
    };
    command.mut_subcommands(|command| named(command, own_name, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_go_by_the_name_that_the_program_is_installed_as() {
        let program = Command::new("tool").after_help("Examples:\n  tool --speed 3");
        let help = named(program, "tool", "vehicle-tool").render_help();
        assert!(help.to_string().contains("  vehicle-tool --speed 3"), "{help}");
    }
}
