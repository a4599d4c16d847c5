//! Runs the programs under test as processes.

use crate::domain::TestDomain;
use crate::wait::PATIENCE;
use rustix::process::{Pid, Signal, kill_process};
use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::process::{Child, Command, ExitCode, Output, Stdio};
use std::time::{Duration, Instant};

/// The arguments of a role, in the environment of the process that plays it.
const ROLE: &str = "TESTKIT_ROLE";
/// Between two arguments of a role.
const SEPARATOR: &str = "\u{1f}";

/// A program that tests start.
///
/// Cargo builds a crate's own programs for its tests, and tells where they are: `Program::At(env!("CARGO_BIN_EXE_…"))`.
/// It does not build those of other crates. [`Program::Played`] is one of these: the test's own executable, started
/// anew, calls the program's `main` from a test named `role` (see [`play_role`]).
#[derive(Debug, Clone, Copy)]
pub enum Program {
    /// An executable.
    At(&'static str),
    /// This test's executable in a role of this name.
    Played(&'static str),
}

impl Program {
    /// The program with these arguments. It reads nothing; what it prints goes where the caller says.
    pub fn command<S: AsRef<OsStr>>(&self, arguments: &[S]) -> Command {
        let mut command = match self {
            Self::At(path) => {
                let mut command = Command::new(path);
                command.args(arguments);
                command
            }
            Self::Played(name) => {
                let mut command = Command::new(std::env::current_exe().unwrap());
                command.args(["role", "--exact", "--nocapture"]);
                let mut role = OsString::from(name);
                for argument in arguments {
                    role.push(SEPARATOR);
                    role.push(argument);
                }
                command.env(ROLE, role);
                command
            }
        };
        command.stdin(Stdio::null());
        command
    }

    /// The same in a domain; its services keep their snapshots there.
    pub fn command_in(&self, domain: &TestDomain, arguments: &[&str]) -> Command {
        let root = domain.root().to_str().unwrap();
        let mut command = self.command(&[arguments, &["--root", root]].concat());
        command.env("OBSERVER_STATE", domain.state.path());
        command
    }

    /// Starts it in a domain.
    pub fn start(&self, domain: &TestDomain, arguments: &[&str]) -> Process {
        Process::spawn(self.command_in(domain, arguments))
    }
}

/// A program's `main`, which takes its arguments, the program's name first.
pub type Main = fn(Vec<OsString>) -> ExitCode;

/// Plays a role, if this process was started as one, and ends it; returns in a test run.
///
/// A test crate with a [`Program::Played`] has this test at its top:
///
/// ```ignore
/// #[test]
/// fn role() {
///     testkit::play_role(&[("daemon", |arguments| daemon::cli::main_with_args(arguments))]);
/// }
/// ```
pub fn play_role(programs: &[(&str, Main)]) {
    let Ok(role) = std::env::var(ROLE) else { return };
    let arguments: Vec<OsString> = role.split(SEPARATOR).map(OsString::from).collect();
    let (_, main) = programs.iter().find(|(name, _)| arguments[0] == *name).expect("a program of this name");
    let code = main(arguments);
    std::process::exit(if code == ExitCode::SUCCESS { 0 } else { 1 });
}

/// How a process has ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ended {
    /// Its exit code; `None` after a signal.
    pub code: Option<i32>,
    /// What it wrote to stdout.
    pub out: String,
    /// What it wrote to stderr.
    pub log: String,
}

impl Ended {
    /// Runs a command to its end.
    pub fn of(command: &mut Command) -> Self {
        command.output().unwrap().into()
    }

    /// Asserts exit code 0; returns what it wrote to stdout.
    ///
    /// # Panics
    /// With the log, on another exit code.
    #[track_caller]
    pub fn ok(self) -> String {
        assert_eq!(self.code, Some(0), "{}", self.log);
        self.out
    }
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), log: text(output.stderr) }
    }
}

/// A process, killed when the test ends.
#[derive(Debug)]
pub struct Process {
    /// The process; a test may take its streams.
    pub child: Child,
}

impl Process {
    /// Starts a command with stdout and stderr in pipes, which [`Process::finish`] reads.
    pub fn spawn(mut command: Command) -> Self {
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        Self { child: command.spawn().unwrap() }
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Whether it has ended by itself.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Waits for its end.
    ///
    /// # Panics
    /// After [`PATIENCE`].
    #[track_caller]
    pub fn finish(self) -> Ended {
        self.finish_within(PATIENCE)
    }

    /// Waits for its end for this long.
    ///
    /// # Panics
    /// After that.
    #[track_caller]
    pub fn finish_within(mut self, patience: Duration) -> Ended {
        // Read from the start: a full pipe would hold the process up.
        let out = read_to_end(self.child.stdout.take());
        let log = read_to_end(self.child.stderr.take());
        let deadline = Instant::now() + patience;
        while !self.has_ended() {
            assert!(Instant::now() < deadline, "process {} does not end within {patience:?}", self.pid());
            std::thread::sleep(Duration::from_millis(5));
        }
        let code = self.child.wait().unwrap().code();
        Ended { code, out: out.join().unwrap(), log: log.join().unwrap() }
    }

    /// Stops it as an operator does, and waits.
    ///
    /// # Panics
    /// As [`Process::finish`].
    #[track_caller]
    pub fn stop(self) -> Ended {
        self.signal(Signal::TERM);
        self.finish()
    }

    /// Kills it at once, without any chance to clean up.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

fn read_to_end(stream: Option<impl Read + Send + 'static>) -> std::thread::JoinHandle<String> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut stream) = stream {
            stream.read_to_end(&mut bytes).unwrap();
        }
        String::from_utf8(bytes).unwrap()
    })
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
