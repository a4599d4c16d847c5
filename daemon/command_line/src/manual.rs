//! The commands `completions` and `man-pages` of every program, made from its command line.

use clap::{Command, Subcommand, ValueEnum, ValueHint};
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, roman};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Subcommand)]
pub(crate) enum Manual {
    /// Print completions for a shell
    Completions {
        /// Which shell
        shell: ShellName,
    },
    /// Write man pages, one for each command
    ManPages {
        /// Where they go; made if it is missing
        #[arg(value_hint = ValueHint::DirPath)]
        directory: PathBuf,
    },
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum ShellName {
    Bash,
    Zsh,
    Fish,
}

/// Examples that are those of any program.
pub(crate) fn with_examples(command: Command) -> Command {
    let name = command.get_name().to_owned();
    let completions = format!(
        "Examples:\n  # For this user, in every bash from now on\n  \
         mkdir -p ~/.local/share/bash-completion/completions\n  \
         cd ~/.local/share/bash-completion/completions\n  \
         {name} completions bash > {name}"
    );
    let man_pages =
        format!("Examples:\n  # For this user; then: man {name}\n  {name} man-pages ~/.local/share/man/man1");
    command
        .mut_subcommand("completions", |command| command.after_help(completions))
        .mut_subcommand("man-pages", |command| command.after_help(man_pages))
}

impl Manual {
    pub(crate) fn run(&self, command: Command) -> ExitCode {
        let name = command.get_name().to_owned();
        let done = match self {
            Self::Completions { shell } => io::stdout().write_all(completions(*shell, command).as_bytes()),
            Self::ManPages { directory } => write_man_pages(command, directory),
        };
        match done {
            Ok(()) => ExitCode::SUCCESS,
            // `| head` has read enough.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
            Err(error) => {
                let _ = writeln!(io::stderr(), "{name}: {error}; needed: a place that can be written");
                ExitCode::FAILURE
            }
        }
    }
}

fn completions(shell: ShellName, mut command: Command) -> String {
    let name = command.get_name().to_owned();
    // clap_complete 4.6.11 loses the commands of a bash program with a dash in its name.
    let (shell, generated_for) = match shell {
        ShellName::Bash => (Shell::Bash, name.replace('-', "_")),
        ShellName::Zsh => (Shell::Zsh, name.clone()),
        ShellName::Fish => (Shell::Fish, name.clone()),
    };
    let mut script = Vec::new();
    generate(shell, &mut command, &generated_for, &mut script);
    let script = String::from_utf8(script).expect("clap writes text");
    script.replace(&format!(" -o default {generated_for}\n"), &format!(" -o default {name}\n"))
}

fn write_man_pages(command: Command, directory: &Path) -> io::Result<()> {
    let in_directory =
        |error: io::Error| io::Error::new(error.kind(), format!("'{}': {error}", directory.display()));
    std::fs::create_dir_all(directory).map_err(in_directory)?;
    let mut command = command.disable_help_subcommand(true);
    command.build();
    write_pages_below(&command, directory).map_err(in_directory)
}

fn write_pages_below(command: &Command, directory: &Path) -> io::Result<()> {
    for command in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        write_pages_below(command, directory)?;
    }
    // Our order of sections, and the examples line by line: clap_mangen would fill them like prose.
    let page = Man::new(command.clone()).source(format!("observer {}", env!("CARGO_PKG_VERSION")));
    let mut file = BufWriter::new(File::create(directory.join(page.get_filename()))?);
    page.render_title(&mut file)?;
    page.render_name_section(&mut file)?;
    page.render_synopsis_section(&mut file)?;
    page.render_description_section(&mut file)?;
    if command.get_arguments().any(|argument| !argument.is_hide_set()) {
        page.render_options_section(&mut file)?;
    }
    if command.get_subcommands().any(|command| !command.is_hide_set()) {
        page.render_subcommands_section(&mut file)?;
    }
    if let Some(text) = command.get_after_help() {
        sections_as_they_stand(&text.to_string()).to_writer(&mut file)?;
    }
    file.flush()
}

/// A text whose sections begin with `Heading:`, each line kept as it is.
fn sections_as_they_stand(text: &str) -> Roff {
    let mut page = Roff::new();
    page.control("nf", []);
    for line in text.lines() {
        match line.strip_suffix(':').filter(|heading| heading.chars().all(char::is_alphabetic)) {
            Some(heading) => page.control("SH", [heading.to_uppercase().as_str()]).control("nf", []),
            None => page.text([roman(line)]),
        };
    }
    page.control("fi", []);
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    /// Flies.
    #[derive(Debug, Parser)]
    #[command(name = "tool", after_help = "Examples:\n  # Fast\n  tool fly --speed 3")]
    struct Tool {
        #[command(subcommand)]
        task: Task,
    }

    #[derive(Debug, Subcommand)]
    enum Task {
        /// Flies.
        #[command(after_help = "Notes:\n  one\n  .two\n\nExamples:\n  # Fast\n  tool fly --speed 3")]
        Fly {
            /// How fast.
            #[arg(long)]
            speed: f64,
        },
    }

    /// What bash offers after these words, with the program installed under this name.
    fn offered(script: &Path, name: &str, words: &[&str]) -> Vec<String> {
        let ask = r#"
            source "$1"; name="$2"; shift 2
            COMP_WORDS=("$name" "$@"); COMP_CWORD=$#; COMPREPLY=()
            before="${COMP_WORDS[COMP_CWORD - 1]}"
            "$(complete -p "$name" | sed 's/.*-F \([^ ]*\) .*/\1/')" "$name" "${@: -1}" "$before"
            printf '%s\n' "${COMPREPLY[@]}"
        "#;
        let mut bash = std::process::Command::new("bash");
        let output = bash.args(["-c", ask, "-"]).arg(script).arg(name).args(words).output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
        String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
    }

    #[test]
    fn bash_completes_commands_and_options_under_the_installed_name() {
        let script = tempfile::NamedTempFile::new().unwrap();
        for name in ["tool", "vehicle-tool"] {
            let program = crate::program::command::<Tool>(Some(name));
            std::fs::write(script.path(), completions(ShellName::Bash, program)).unwrap();
            assert_eq!(offered(script.path(), name, &["f"]), ["fly"]);
            assert_eq!(offered(script.path(), name, &["fly", "--s"]), ["--speed"]);
            let shells = offered(script.path(), name, &["completions", ""]);
            assert_eq!(shells.len(), 5, "-h, --help and three shells");
        }
    }

    #[test]
    fn man_pages_keep_the_examples_line_by_line() {
        let directory = tempfile::tempdir().unwrap();
        write_man_pages(crate::program::command::<Tool>(Some("vehicle-tool")), directory.path()).unwrap();
        let pages = std::fs::read_dir(directory.path()).unwrap().map(|page| page.unwrap().file_name());
        let mut pages: Vec<_> = pages.map(|name| name.into_string().unwrap()).collect();
        pages.sort();
        let needed =
            ["-completions.1", "-fly.1", "-man-pages.1", ".1"].map(|end| format!("vehicle-tool{end}"));
        assert_eq!(pages, needed);
        let page = std::fs::read_to_string(directory.path().join("vehicle-tool-fly.1")).unwrap();
        let examples = ".SH EXAMPLES\n.nf\n  # Fast\n  vehicle\\-tool fly \\-\\-speed 3\n.fi\n";
        assert!(page.ends_with(examples) && page.contains(".SH NOTES\n.nf\n  one\n"), "{page}");
    }
}
