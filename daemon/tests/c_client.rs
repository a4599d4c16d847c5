//! The client for C and C++ (`shared_types/c`) against the real service: its functions called from here, and
//! programs in C and C++ compiled with every warning an error.

use crate::common::{Ended, PATIENCE, TestDomain, preset_between, run_daemon, wait_until};
use observer_client::*;
use rustix::process::Signal;
use shared_types::payload::{Reply, command, outcome};
use shared_types::{Estimate, Measurement, Status, clock, service};
use std::collections::BTreeSet;
use std::ffi::{CStr, CString, c_char};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::ptr::{null, null_mut};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

const NONE: Handle = Handle { thread: 0, number: 0 };

/// The functions as a C program calls them, for callers whose pointers are good or bad on purpose.
#[allow(unsafe_code)]
mod c {
    use super::*;

    pub(super) fn open(root: &Path, instance: *const c_char, patience_s: f64) -> (CallResult, Handle) {
        open_for(layout::HASH, root, instance, ports::ALL, patience_s)
    }

    pub(super) fn open_for(
        layout: u32,
        root: &Path,
        instance: *const c_char,
        ports: u32,
        patience_s: f64,
    ) -> (CallResult, Handle) {
        let root = CString::new(root.to_str().unwrap()).unwrap();
        let mut handle = Handle { thread: 7, number: 7 };
        // SAFETY: both texts end with a zero, or are null.
        let result =
            unsafe { observer_open(layout, root.as_ptr(), instance, ports, patience_s, &raw mut handle) };
        (result, handle)
    }

    pub(super) fn open_to(handle: *mut Handle) -> CallResult {
        // SAFETY: null, or a handle's place.
        unsafe { observer_open(layout::HASH, null(), c"vehicle".as_ptr(), ports::ALL, 0.0, handle) }
    }

    macro_rules! calls {
        ($($name:ident = $function:ident($($argument:ident: $kind:ty),*);)*) => {
            $(pub(super) fn $name($($argument: $kind),*) -> CallResult {
                // SAFETY: each pointer is null, misaligned, or to a value of its type; a text is as long as is said.
                unsafe { $function($($argument),*) }
            })*
        };
    }
    calls! {
        publish = observer_publish(handle: Handle, sample: *const Measurement);
        take = observer_take(handle: Handle, estimate: *mut Estimate);
        wait = observer_wait(handle: Handle, patience_s: f64, estimate: *mut Estimate);
        peek = observer_peek(handle: Handle, estimate: *mut Estimate);
        read_status = observer_read_status(handle: Handle, status: *mut Status);
        command = observer_command(handle: Handle, command: u32, patience_s: f64, reply: *mut Reply);
        reply_text = observer_reply_text(reply: *const Reply, text: *mut c_char, text_bytes: usize);
    }

    pub(super) fn error_text() -> String {
        // SAFETY: never null, ends with a zero, valid until this thread's next failure.
        unsafe { CStr::from_ptr(observer_error_text()) }.to_str().unwrap().to_owned()
    }
}

const VEHICLE: *const c_char = c"vehicle".as_ptr();

fn moving(sequence: u64) -> Measurement {
    let t = sequence as f64 * 0.005;
    Measurement::at(clock::monotonic_ns(), sequence).with_velocity_m_s([t.sin(), t.cos(), 0.5])
}

/// A service that answers every sample, in the samples' own time: a busy machine makes none of them late.
fn on_samples() -> tempfile::NamedTempFile {
    preset_between("trigger = \"sample\"\nclock = \"samples\"", "")
}

fn good(result: CallResult) {
    assert!(result == CallResult::Ok, "{result:?}: {}", c::error_text());
}

#[test]
fn what_goes_in_comes_out_and_commands_are_answered() {
    let domain = TestDomain::new();
    let config = on_samples();
    let daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
    let (result, handle) = c::open(domain.root(), VEHICLE, PATIENCE.as_secs_f64());
    good(result);
    let (mut estimate, mut newest, mut status) =
        (Estimate::default(), Estimate::default(), Status::default());
    let rust = domain.client();
    let mut beside = rust.estimate_subscriber().unwrap();
    for sequence in 0..100 {
        let sample = moving(sequence);
        good(c::publish(handle, &raw const sample));
        let deadline = Instant::now() + PATIENCE;
        while (estimate.source_sequence, estimate.source_stamp_ns) != (sequence, sample.stamp_ns) {
            assert!(Instant::now() < deadline, "no estimate of sample {sequence}: {:?}", domain.status());
            good(c::wait(handle, PATIENCE.as_secs_f64(), &raw mut estimate));
        }
        good(c::peek(handle, &raw mut newest));
        assert!(newest.sequence >= estimate.sequence);
        // The same bits as the Rust client has them.
        let of_rust = loop {
            let found = beside.wait_next(PATIENCE).unwrap();
            if found.sequence == estimate.sequence {
                break found;
            }
        };
        assert_eq!(estimate, of_rust);
    }
    drop((beside, rust));
    // Peeking takes nothing away, and leaves what it found.
    good(c::peek(handle, &raw mut estimate));
    wait_until("a status that counts the samples", || {
        c::read_status(handle, &raw mut status) == CallResult::Ok && status.counters.samples_accepted == 100
    });
    wait_until("an empty queue", || c::take(handle, &raw mut estimate) == CallResult::Nothing);

    let mut reply = Reply::default();
    good(c::command(handle, command::FREEZE, 10.0, &raw mut reply));
    assert_eq!((reply.outcome, reply.status.adaptation_frozen), (outcome::DONE, 1));
    good(c::command(handle, 99, 10.0, &raw mut reply));
    assert_eq!(reply.outcome, outcome::UNKNOWN);
    let mut text = [b'x' as c_char; 300];
    good(c::reply_text(&raw const reply, text.as_mut_ptr(), text.len()));
    let end = text.iter().position(|&byte| byte == 0).unwrap();
    assert_eq!(end, reply.text().len());
    assert!(reply.text().contains("99") && text[end + 1] == b'x' as c_char);
    good(c::reply_text(&raw const reply, text.as_mut_ptr(), 5));
    let cut: Vec<u8> = text[..5].iter().map(|&byte| byte as u8).collect();
    assert_eq!(cut, [&reply.text().as_bytes()[..4], &[0]].concat());

    // Without a service, publishing is no failure: the result tells it.
    assert_eq!(daemon.stop().code, Some(0));
    let late = moving(100);
    assert_eq!(c::publish(handle, &raw const late), CallResult::Nothing);
    assert_eq!(c::command(handle, command::STATUS, 0.05, &raw mut reply), CallResult::NoDaemon);
    good(observer_close(handle));
}

#[test]
fn without_a_service_the_reason_comes_in_time() {
    let domain = TestDomain::new();
    let start = Instant::now();
    let (result, handle) = c::open(domain.root(), VEHICLE, 0.2);
    assert_eq!((result, handle), (CallResult::NoDaemon, NONE));
    assert!(start.elapsed() >= Duration::from_millis(200) && start.elapsed() < PATIENCE);
    assert!(c::error_text().contains("daemon run --instance vehicle"), "{}", c::error_text());

    let _daemon = run_daemon(&domain, &[]);
    domain.client();
    let (result, _) = c::open(domain.root(), c"other-vehicle".as_ptr(), 0.05);
    assert_eq!(result, CallResult::NoDaemon);
    assert!(c::error_text().contains("other-vehicle"), "{}", c::error_text());
    // Each thread has a text of its own.
    assert_eq!(std::thread::spawn(c::error_text).join().unwrap(), "");
}

#[test]
fn misuse_is_an_error_with_words_and_nothing_else() {
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    let refused = |result: CallResult, expected: CallResult, words: &str| {
        assert!(result == expected && c::error_text().contains(words), "{result:?}: {}", c::error_text());
    };
    let bad = CallResult::BadArgument;
    refused(c::open_to(null_mut()), bad, "client is null");
    let root = domain.root();
    let open = |layout, instance, ports, patience_s| {
        let (result, handle) = c::open_for(layout, root, instance, ports, patience_s);
        assert!(result == CallResult::Ok || handle == NONE);
        result
    };
    refused(open(layout::HASH ^ 1, VEHICLE, ports::ALL, 1.0), bad, "OBSERVER_LAYOUT");
    refused(open(layout::HASH, null(), ports::ALL, 1.0), bad, "instance is null");
    refused(open(layout::HASH, c"a/b".as_ptr(), ports::ALL, 1.0), bad, "instance 'a/b'");
    refused(open(layout::HASH, c"\xff".as_ptr(), ports::ALL, 1.0), bad, "not UTF-8");
    refused(open(layout::HASH, VEHICLE, 0, 1.0), bad, "ports is 0x0");
    refused(open(layout::HASH, VEHICLE, 1 << 9, 1.0), bad, "ports is 0x200");
    for patience_s in [f64::NAN, -1.0, f64::INFINITY, 1e300] {
        refused(open(layout::HASH, VEHICLE, ports::ALL, patience_s), bad, "patience_s is");
    }
    refused(c::open(Path::new("relative"), VEHICLE, 1.0).0, CallResult::Refused, "not an absolute path");

    let (result, handle) = c::open(root, VEHICLE, 10.0);
    good(result);
    let (sample, mut estimate, mut status, mut reply) =
        (moving(0), Estimate::default(), Status::default(), Reply::default());
    refused(c::publish(handle, null()), bad, "measurement is null");
    refused(c::take(handle, null_mut()), bad, "estimate is null");
    refused(c::wait(handle, 1.0, null_mut()), bad, "estimate is null");
    refused(c::wait(handle, f64::NAN, &raw mut estimate), bad, "patience_s is NaN");
    refused(c::peek(handle, null_mut()), bad, "estimate is null");
    refused(c::read_status(handle, null_mut()), bad, "status is null");
    refused(c::command(handle, command::STATUS, 1.0, null_mut()), bad, "reply is null");
    refused(c::command(handle, command::STATUS, -1.0, &raw mut reply), bad, "patience_s is -1");
    refused(c::reply_text(null(), null_mut(), 0), bad, "reply is null");
    refused(c::reply_text(&raw const reply, null_mut(), 0), bad, "text is null");
    let mut byte = 0;
    refused(c::reply_text(&raw const reply, &raw mut byte, 0), bad, "text_bytes is 0");
    let odd = (&raw const sample).wrapping_byte_add(1);
    refused(c::publish(handle, odd), bad, "not aligned to 8 bytes");

    // A handle of another thread, there and back.
    let elsewhere = std::thread::spawn(move || {
        let sample = moving(0);
        let results = (c::publish(handle, &raw const sample), observer_close(handle));
        (results, c::error_text())
    });
    let (results, text) = elsewhere.join().unwrap();
    assert_eq!(results, (CallResult::WrongThread, CallResult::WrongThread));
    assert!(text.contains("another thread opened"), "{text}");
    good(c::publish(handle, &raw const sample));

    // A port that was not requested.
    let (result, reader) = c::open_for(layout::HASH, root, VEHICLE, ports::PEEK, 10.0);
    good(result);
    refused(c::publish(reader, &raw const sample), bad, "OBSERVER_PORTS_PUBLISH");
    refused(c::take(reader, &raw mut estimate), bad, "OBSERVER_PORTS_TAKE");
    refused(c::read_status(reader, &raw mut status), bad, "OBSERVER_PORTS_STATUS");
    wait_until("an estimate", || c::peek(reader, &raw mut estimate) == CallResult::Ok);
    good(observer_close(reader));

    // Closed, never opened, garbage.
    good(observer_close(handle));
    refused(observer_close(handle), CallResult::BadHandle, "closed already");
    refused(c::publish(handle, &raw const sample), CallResult::BadHandle, "closed already");
    refused(c::take(NONE, &raw mut estimate), CallResult::BadHandle, "never opened");
    let garbage = Handle { thread: u32::MAX, number: 3 };
    refused(c::peek(garbage, &raw mut estimate), CallResult::BadHandle, "not open");
}

#[test]
fn what_a_thread_leaves_open_is_closed_when_it_ends() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    let root = domain.root().to_owned();
    // More than the places for sources: each gives its own back.
    for _ in 0..service::MAX_SOURCES + 2 {
        let root = root.clone();
        let opened = std::thread::spawn(move || (c::open(&root, VEHICLE, 10.0).0, c::error_text()));
        let (result, text) = opened.join().unwrap();
        assert_eq!(result, CallResult::Ok, "{text}");
    }
    assert_eq!(daemon.stop().code, Some(0));
    domain.assert_clean();
}

#[test]
fn an_open_handle_allocates_nothing_but_the_loan() {
    let domain = TestDomain::new();
    let config = on_samples();
    let _daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
    let (result, handle) = c::open(domain.root(), VEHICLE, 10.0);
    good(result);
    let (mut estimate, mut status) = (Estimate::default(), Status::default());
    let sample = moving(0);
    good(c::publish(handle, &raw const sample));
    good(c::wait(handle, 10.0, &raw mut estimate));
    wait_until("a status", || c::read_status(handle, &raw mut status) == CallResult::Ok);
    let counted = allocation_counter::measure(|| {
        for _ in 0..100 {
            c::take(handle, &raw mut estimate);
            c::peek(handle, &raw mut estimate);
            c::read_status(handle, &raw mut status);
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    let counted = allocation_counter::measure(|| {
        for _ in 0..100 {
            c::publish(handle, &raw const sample);
        }
    });
    assert!(counted.count_total <= 100 && counted.count_current == 0, "{counted:?}");
    good(observer_close(handle));
}

/// A path of `shared_types/c`.
fn of_the_client(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared_types/c").join(path)
}

/// Where this test's own build of the library is installed, as a user would.
fn installed() -> &'static Path {
    static PREFIX: LazyLock<PathBuf> = LazyLock::new(|| {
        let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("c_client");
        let built = std::env::current_exe().unwrap().parent().unwrap().to_owned();
        // Tests of other processes install it to the same place.
        let lock = std::fs::File::create(prefix.with_extension("lock")).unwrap();
        lock.lock().unwrap();
        let output = Command::new(of_the_client("install")).args([&prefix, &built]).output().unwrap();
        let Ended { code, log, .. } = Ended::from(output);
        assert_eq!(code, Some(0), "{log}");
        prefix
    });
    &PREFIX
}

/// The output of a tool of the compiler's; `None`, said, where it is not here.
fn output_of(command: &mut Command) -> Option<String> {
    match command.output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            testkit::skip("the C client", &format!("not here: {command:?}"));
            None
        }
        output => {
            let Ended { code, out, log } = Ended::from(output.unwrap());
            assert_eq!(code, Some(0), "{command:?}\n{log}");
            Some(out)
        }
    }
}

/// How a program finds the library's functions.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Linked {
    Shared,
    Static,
}

impl Linked {
    /// What pkg-config says, or, where it is not here, the same by hand.
    fn flags(self) -> Vec<String> {
        let package = match self {
            Self::Shared => "observer_client",
            Self::Static => "observer_client-static",
        };
        let prefix = installed().display();
        let mut command = Command::new("pkg-config");
        command.args(["--cflags", "--libs", package]);
        command.env("PKG_CONFIG_PATH", installed().join("lib/pkgconfig"));
        let flags = output_of(&mut command).unwrap_or_else(|| match self {
            Self::Shared => format!("-I{prefix}/include -L{prefix}/lib -lobserver_client"),
            Self::Static => format!(
                "-I{prefix}/include {prefix}/lib/libobserver_client.a -lgcc_s -lutil -lrt -lpthread -lm -ldl"
            ),
        });
        flags.split_whitespace().map(String::from).collect()
    }
}

/// A program in C or C++, compiled as strictly as can be.
struct Program {
    directory: tempfile::TempDir,
}

impl Program {
    /// `None`, said, where there is no compiler of that language.
    fn compiled(source: &Path, linked: Linked) -> Option<Self> {
        let directory = tempfile::tempdir().unwrap();
        let (compiler, standard) = match source.extension().unwrap().to_str().unwrap() {
            "c" => ("cc", "-std=c11"),
            _ => ("c++", "-std=c++17"),
        };
        let mut command = Command::new(compiler);
        command.args([standard, "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]).arg(source);
        command.arg("-o").arg(directory.path().join("program")).args(linked.flags()).arg("-lm");
        output_of(&mut command).map(|_| Self { directory })
    }

    fn command(&self, domain: &TestDomain, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.directory.path().join("program"));
        command.args(arguments).env("OBSERVER_ROOT", domain.root());
        command.env("LD_LIBRARY_PATH", installed().join("lib"));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }
}

/// The number after a word of a program's summary.
fn number(summary: &str, word: &str) -> u64 {
    let after = summary.split_once(&format!("{word} ")).unwrap_or_else(|| panic!("{word}: {summary}")).1;
    after.split(|c: char| !c.is_ascii_digit()).next().unwrap().parse().unwrap()
}

#[test]
fn the_flight_loops_in_c_and_cpp_have_an_estimate_for_every_sample() {
    for (source, linked, samples) in [
        ("flight_loop.c", Linked::Shared, 1000),
        ("flight_loop.cpp", Linked::Static, 1000),
        ("flight_loop.c", Linked::Static, 100),
        ("flight_loop.cpp", Linked::Shared, 100),
    ] {
        let Some(program) = Program::compiled(&of_the_client("examples").join(source), linked) else {
            continue;
        };
        let domain = TestDomain::new();
        let config = on_samples();
        let daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
        // So patient that a busy machine does not matter: each sample is waited for.
        let output = program.command(&domain, &[&samples.to_string(), "400", "30"]).output().unwrap();
        let Ended { code, out: summary, log } = Ended::from(output);
        assert_eq!(code, Some(0), "{source}: {log}");
        let found = ["published", "answered", "newest", "outages"].map(|word| number(&summary, word));
        assert_eq!(found, [samples, samples, samples - 1, 0], "{source}, {linked:?}: {summary}");
        assert!(summary.contains("samples used, outcome 0"), "{source}: {summary}");
        wait_until("all to be counted", || domain.status().counters.samples_accepted == samples);
        // It closed what it opened.
        assert_eq!(daemon.stop().code, Some(0));
        domain.assert_clean();
    }
}

#[test]
fn a_loop_in_c_flies_on_while_the_service_is_killed_and_comes_back() {
    let Some(program) = Program::compiled(&of_the_client("examples/flight_loop.c"), Linked::Shared) else {
        return;
    };
    let domain = TestDomain::new();
    let config = on_samples();
    let arguments = ["--config", config.path().to_str().unwrap()];
    let daemon = run_daemon(&domain, &arguments);
    let vehicle = program.command(&domain, &["3000", "250", "0.02"]).spawn().unwrap();
    wait_until("samples to be used", || domain.status().counters.samples_accepted > 10);
    daemon.signal(Signal::KILL);
    daemon.finish();
    std::thread::sleep(Duration::from_millis(300));
    let daemon = run_daemon(&domain, &arguments);
    let Ended { code, out: summary, log } = Ended::from(vehicle.wait_with_output().unwrap());
    assert_eq!(code, Some(0), "{log}");
    assert!(number(&summary, "outages") >= 1, "{summary}");
    let (answered, newest) = (number(&summary, "answered"), number(&summary, "newest"));
    assert!((1..3000).contains(&answered) && newest > answered, "{summary}");
    // The second service used the samples of the same ports.
    assert!(domain.status().counters.samples_accepted > 0);
    assert_eq!(daemon.stop().code, Some(0));
}

#[test]
fn without_a_service_the_programs_end_with_the_reason() {
    let Some(program) = Program::compiled(&of_the_client("examples/flight_loop.cpp"), Linked::Shared) else {
        return;
    };
    let domain = TestDomain::new();
    let Ended { code, log, .. } = Ended::of(&mut program.command(&domain, &["1"]));
    assert_eq!(code, Some(1), "{log}");
    assert!(log.contains("daemon run --instance vehicle"), "{log}");
}

#[test]
fn a_forked_child_that_exits_takes_no_port_of_its_parent() {
    let Some(program) = Program::compiled(&of_the_client("tests/forked_child.c"), Linked::Shared) else {
        return;
    };
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    let Ended { code, out, log } = Ended::of(&mut program.command(&domain, &[]));
    assert_eq!((code, out.as_str()), (Some(0), "child ended with 0; 0 files gone\n"), "{log}");
}

#[test]
fn the_readmes_loop_is_accepted_by_the_compiler() {
    let readme = include_str!("../../shared_types/c/README.md");
    let block = readme.split("```cpp\n").nth(1).unwrap().split("```").next().unwrap();
    let directory = tempfile::tempdir().unwrap();
    let source = directory.path().join("loop.cpp");
    std::fs::write(
        &source,
        format!("void control(const double *, const double *);\nbool landed();\n{block}"),
    )
    .unwrap();
    let include = of_the_client("include");
    let warnings = ["-Wall", "-Wextra", "-Werror"];
    output_of(
        Command::new("c++")
            .args(["-std=c++17", "-fsyntax-only", "-I"])
            .arg(include)
            .args(warnings)
            .arg(&source),
    );
}

#[test]
fn an_open_handle_makes_no_system_call() {
    let Some(program) = Program::compiled(&of_the_client("tests/no_system_call.c"), Linked::Shared) else {
        return;
    };
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    let Ended { code, out, log } = Ended::of(&mut program.command(&domain, &[]));
    assert_eq!(code, Some(0), "{log}");
    if out.starts_with("skipped") {
        testkit::skip("the C client", out.trim_start_matches("skipped").trim_matches([':', ' ', '\n']));
        return;
    }
    assert_eq!(out, "no system call\n", "{log}");
    // With one system call too many the kernel ends it.
    let Ended { code, out, .. } = Ended::of(&mut program.command(&domain, &["sleep"]));
    assert_eq!((code, out.as_str()), (None, "no system call\n"));
}

/// The library exports exactly the functions that the header declares, and its soname has the major version.
#[test]
fn the_shared_library_has_the_functions_of_the_header_and_no_other() {
    let library = installed().join("lib/libobserver_client.so");
    let Some(symbols) =
        output_of(Command::new("nm").args(["--dynamic", "--defined-only", "--format=posix"]).arg(&library))
    else {
        return;
    };
    let exported: BTreeSet<&str> =
        symbols.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    let header = std::fs::read_to_string(of_the_client("include/observer_client.h")).unwrap();
    let (_, functions) = header.split_once("extern \"C\" {").unwrap();
    let declared: BTreeSet<&str> = functions
        .lines()
        .filter(|line| !line.starts_with([' ', '/', '*', '#']))
        .filter_map(|line| line.split_once('('))
        .filter_map(|(before, _)| before.rsplit([' ', '*']).next())
        .filter(|word| word.starts_with("observer_"))
        .collect();
    assert!(declared.len() == 11 && exported == declared, "{exported:?}\n{declared:?}");
    let about = output_of(Command::new("readelf").args(["--dynamic", "--wide"]).arg(&library)).unwrap();
    assert!(about.contains("Library soname: [libobserver_client.so.0]"), "{about}");
}
