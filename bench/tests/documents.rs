//! Every command in a document is accepted by its program, and every link leads to a file. CI runs the `sh` blocks of the
//! documents; these tests check the other commands: in the text, in tables, in indented blocks.

use crate::programs::bench;
use std::path::{Path, PathBuf};

fn documents() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let docs = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let more = ["README.md", "fuzz/README.md", "shared_types/c/README.md", "shared_types/python/README.md"];
    let more = more.map(|name| root.join(name));
    docs.filter(|path| path.extension().is_some_and(|ending| ending == "md")).chain(more).collect()
}

#[test]
fn the_readme_is_short() {
    let readme = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("README.md");
    let n_bytes = std::fs::metadata(readme).unwrap().len();
    assert!(n_bytes <= 10_000, "found {n_bytes} bytes, needed at most 10 000: move a section to docs/");
}

/// Links to files of the repository, in Markdown, that lead nowhere.
#[test]
fn every_link_leads_to_a_file() {
    let mut faults = Vec::new();
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let path = target.split('#').next().unwrap();
            let is_local = !path.is_empty() && !path.contains("://") && !path.contains(char::is_whitespace);
            if is_local && !document.parent().unwrap().join(path).exists() {
                faults.push(format!("{}: {target}", document.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// What stands between backticks, and the lines of blocks.
fn code(text: &str) -> Vec<String> {
    let (mut found, mut fenced) = (Vec::new(), false);
    // A command may go on in the next line.
    for line in text.replace("\\\n", " ").lines() {
        if line.starts_with("```") {
            fenced = !fenced;
        } else if fenced || line.starts_with("    ") {
            found.push(line.trim().to_owned());
        } else {
            found.extend(line.split('`').skip(1).step_by(2).map(str::to_owned));
        }
    }
    found
}

/// The words of a command of ours, its program first; `None` for other text.
fn command(code: &str) -> Option<Vec<String>> {
    let code = code.split(" # ").next()?.replace('…', " … ");
    let mut words = shlex::split(&code)?;
    let program = words.first()?.rsplit('/').next()?.to_owned();
    if !["daemon", "sim_publisher", "bench"].contains(&program.as_str()) || words.len() < 2 {
        return None;
    }
    words[0] = program;
    words.iter_mut().filter(|word| *word == "NAME").for_each(|word| *word = "rigid-body".into());
    // What the shell or the reader adds.
    let ends = words.iter().position(|word| ["&", ">", "|", ";", "…", "2>"].contains(&word.as_str()));
    if let Some(end) = ends {
        words.truncate(end);
        if words.last()?.starts_with("--") {
            words.pop();
        }
    }
    Some(words)
}

/// Every argument before `--help` is checked, and nothing is started.
fn is_understood(words: &[String]) -> Result<(), String> {
    // `bench` is the other two as well.
    let arguments = if words[0] == "bench" { &words[1..] } else { words };
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).chain(["--help"]).collect();
    let ended = bench(&arguments);
    if ended.code == Some(0) { Ok(()) } else { Err(ended.log) }
}

#[test]
fn every_documented_command_is_understood() {
    let (mut n_commands, mut n_of_the_bridge, mut faults) = (0, 0, Vec::new());
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        for words in code(&text).iter().filter_map(|code| command(code)) {
            n_commands += 1;
            // Without the bridge, every argument of its command is refused alike.
            if !sim_publisher::HAS_MAVLINK && is_of_the_bridge(&words) {
                n_of_the_bridge += 1;
                continue;
            }
            if let Err(message) = is_understood(&words) {
                faults.push(format!("{}: `{}`: {message}", document.display(), words.join(" ")));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(n_commands > 100, "{n_commands}");
    if n_of_the_bridge > 0 {
        let what = format!("{n_of_the_bridge} documented commands of the MAVLink bridge");
        testkit::skip(&what, "it is not in this program; needed: --features mavlink");
    }
}

/// `sim_publisher mavlink …`, alone or behind `bench`.
fn is_of_the_bridge(words: &[String]) -> bool {
    words.windows(2).any(|pair| pair == ["sim_publisher", "mavlink"])
}

#[test]
fn a_command_that_is_not_is_found() {
    let words = |line: &str| command(line).unwrap();
    assert!(is_understood(&words("./target/release/daemon run --preset auv &")).is_ok());
    assert!(is_understood(&words("bench demo --faults …")).is_ok());
    for wrong in [
        "daemon fly",
        "daemon run --presett auv",
        "bench step --centers many",
        "sim_publisher run --rate-hz fast",
    ] {
        assert!(is_understood(&words(wrong)).is_err(), "{wrong}");
    }
    assert!(is_of_the_bridge(&words("bench sim_publisher mavlink --listen udp:0.0.0.0:14550")));
    assert!(!is_of_the_bridge(&words("sim_publisher run --scenario auv")));
    assert_eq!(command("daemon/observer"), None);
    assert_eq!(command("cargo test"), None);
}
