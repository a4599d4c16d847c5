//! The commands that every program has: completions and man pages, made from its command line.

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
