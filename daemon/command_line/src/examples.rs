//! The examples at the end of every help text: they use the program's name, and a test checks that the program accepts them.

use crate::program::command;
use clap::{ArgMatches, Command, Parser};

const HEADING: &str = "Examples:";
/// Lines of a help must fit into a terminal of this width.
const COLUMNS: usize = 80;

/// The faults of a program's help; empty if there are none.
///
/// Every command and every option must have a text. Every command's help must end in a section `Examples:`, fit into
/// 80 columns, and each example that begins with the program's name must be accepted by the program, as that command; at
/// least one must be there. Lines of a shell around them and comments may stand between.
pub fn faults_of_help<P: Parser>() -> Vec<String> {
    // As long a name as it is installed under.
    let name = format!("observer-{}", P::command().get_name());
    let mut program = command::<P>(Some(&name)).term_width(COLUMNS).disable_help_subcommand(true);
    program.build();
    let mut faults = Vec::new();
    collect(&command::<P>(Some(&name)), &program, &mut faults);
    faults
}

fn collect(program: &Command, command: &Command, faults: &mut Vec<String>) {
    let path = command.get_bin_name().unwrap_or(command.get_name()).to_owned();
    let mut fault = |text: String| faults.push(format!("{path}: {text}"));
    if command.get_about().is_none() {
        fault("no description".into());
    }
    for argument in command.get_arguments().filter(|a| !a.is_hide_set() && a.get_help().is_none()) {
        fault(format!("no text for {argument}"));
    }
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let whole_help = command.clone().render_long_help().to_string();
    // An example that is too long would be broken in two.
    for line in whole_help.lines().chain(help.lines()) {
        if line.chars().count() > COLUMNS {
            fault(format!("wider than {COLUMNS} columns: {line}"));
        }
    }
    let examples = examples(&help, program.get_name());
    if examples.is_empty() {
        fault(format!("its help does not end in a section '{HEADING}' with an example"));
    }
    for example in examples {
        match shlex::split(&example) {
            None => fault(format!("a quote is not closed: {example}")),
            Some(words) => {
                let words =
                    words.into_iter().take_while(|word| !matches!(word.as_str(), ">" | "|" | "&" | "<"));
                match program.clone().try_get_matches_from(words) {
                    Err(error) => fault(format!("refuses its own example: {example}\n{error}")),
                    Ok(matches) if !path_of(program, &matches).starts_with(&path) => {
                        fault(format!("an example of another command: {example}"));
                    }
                    Ok(_) => {}
                }
            }
        }
    }
    for command in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        collect(program, command, faults);
    }
}

/// The program's own lines of the last section, each with its continuations.
fn examples(help: &str, name: &str) -> Vec<String> {
    let Some((before, section)) = help.rsplit_once(HEADING) else { return Vec::new() };
    let begins_a_line = before.is_empty() || before.ends_with('\n');
    let is_last = section.lines().skip(1).all(|line| line.is_empty() || line.starts_with("  "));
    if !(begins_a_line && is_last) {
        return Vec::new();
    }
    let section = section.replace("\\\n", " ");
    let own =
        |line: &&str| line.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '));
    section.lines().map(str::trim).filter(own).map(str::to_owned).collect()
}

fn path_of(program: &Command, matches: &ArgMatches) -> String {
    let mut path = program.get_name().to_owned();
    let mut matches = matches;
    while let Some((name, inner)) = matches.subcommand() {
        path = format!("{path} {name}");
        matches = inner;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Args;

    /// A program with one option, and this text after its help.
    fn program(after_help: &'static str) -> Command {
        /// Tests.
        #[derive(Debug, Parser)]
        #[command(name = "tool")]
        struct Tool {
            #[command(flatten)]
            speed: Speed,
        }
        #[derive(Debug, Args)]
        struct Speed {
            /// How fast.
            #[arg(long)]
            speed: Option<f64>,
        }
        <Tool as clap::CommandFactory>::command().after_help(after_help).term_width(COLUMNS)
    }

    fn faults(mut program: Command) -> String {
        program.build();
        let mut faults = Vec::new();
        collect(&program.clone(), &program, &mut faults);
        faults.join("\n")
    }

    #[test]
    fn each_kind_of_fault_is_found() {
        let fault = |after_help| faults(program(after_help));
        assert_eq!(
            fault("Notes:\n  a: b\n\nExamples:\n  tool \\\n    --speed '3' > log   # fast\n  kill %1"),
            ""
        );
        assert!(fault("").contains("does not end in a section"));
        assert!(fault("Examples:\n  other 3").contains("does not end in a section"));
        assert!(fault("Examples:\n  tool --speed 3\n\nNotes").contains("does not end in a section"));
        assert!(fault("Examples:\n  tool --sped 3").contains("refuses its own example"));
        assert!(fault("Examples:\n  tool --speed '3").contains("not closed"));
        let wide = "Examples:\n  tool --speed 3.000000000000000000000000000000000000000000000000000000000000000000000000";
        assert!(fault(wide).contains("wider than 80"));
        let no_text = program("Examples:\n  tool").about("").arg(clap::Arg::new("rate").long("rate"));
        assert!(faults(no_text).contains("no text for --rate"));
        // An example stands in the help of its own command.
        let fly = Command::new("fly").about("Flies.").after_help("Examples:\n  tool land");
        let land = Command::new("land").about("Lands.").after_help("Examples:\n  tool land");
        let two = program("Examples:\n  tool land").disable_help_subcommand(true).subcommands([fly, land]);
        assert_eq!(faults(two), "tool fly: an example of another command: tool land");
    }
}
