//! Completions that bash takes, and man pages with their examples line by line.

use clap::{Parser, Subcommand};
use std::path::Path;
use std::process::Command;

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
    let output =
        Command::new("bash").args(["-c", ask, "-"]).arg(script).arg(name).args(words).output().unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

/// `parse` writes to stdout: this test is the program, in a process of its own.
#[test]
#[ignore = "run by the others"]
fn program() {
    let words = std::env::var("WORDS").unwrap();
    let code = command_line::parse::<Tool>(words.split(' ').map(Into::into)).err();
    assert_eq!(code, Some(std::process::ExitCode::SUCCESS));
}

fn run(words: &str) -> String {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["program", "--exact", "--ignored", "--nocapture", "--quiet"]).env("WORDS", words);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn bash_completes_commands_and_options_under_the_installed_name() {
    let directory = tempfile::tempdir().unwrap();
    let script = directory.path().join("script");
    for name in ["tool", "vehicle-tool"] {
        let printed = run(&format!("/usr/bin/{name} completions bash"));
        // Between the lines of the test runner.
        let (start, end) = (printed.find('_').unwrap(), printed.rfind("\nfi\n").unwrap() + 4);
        std::fs::write(&script, &printed[start..end]).unwrap();
        assert_eq!(offered(&script, name, &["f"]), ["fly"]);
        assert_eq!(offered(&script, name, &["fly", "--s"]), ["--speed"]);
        assert_eq!(offered(&script, name, &["completions", ""]).len(), 5, "-h, --help and three shells");
    }
}

#[test]
fn man_pages_keep_the_examples_line_by_line() {
    let directory = tempfile::tempdir().unwrap();
    run(&format!("vehicle-tool man-pages {}", directory.path().display()));
    let mut pages: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|page| page.unwrap().file_name()).collect();
    pages.sort();
    assert_eq!(
        pages,
        ["vehicle-tool-completions.1", "vehicle-tool-fly.1", "vehicle-tool-man-pages.1", "vehicle-tool.1"]
    );
    let page = std::fs::read_to_string(directory.path().join("vehicle-tool-fly.1")).unwrap();
    let examples = ".SH EXAMPLES\n.nf\n  # Fast\n  vehicle\\-tool fly \\-\\-speed 3\n.fi\n";
    assert!(page.ends_with(examples) && page.contains(".SH NOTES\n.nf\n  one\n"), "{page}");
}
