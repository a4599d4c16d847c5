//! The Python client (`shared_types/python`): its messages are written from the Rust types, and it is run against real
//! services by its own tests.
//!
//!     UPDATE_PYTHON=1 cargo test -p daemon --test python

#[path = "common/python.rs"]
mod venv;

use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use serde_json::{Value, json};
use shared_types::payload::{
    Channel, Command as Order, Estimate, LatencySummary, Measurement, Rejection, Reply, Status, Truth,
    command, frame, outcome, real_time, restored, status_bits, valid,
};
use shared_types::{Domain, service};
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use venv::{environment, pip_install, said};

const SOURCE: &str = include_str!("../../shared_types/src/payload.rs");
const README: &str = include_str!("../../README.md");
const PACKAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared_types/python");

/// A field of a message: name, type as Rust writes it, offset and size in bytes.
type Field = (&'static str, String, usize, usize);

/// One message, as the compiler lays it out.
struct Message {
    name: &'static str,
    detail: TypeDetail,
    fields: Vec<Field>,
}

fn type_of<T>(_: &T) -> String {
    let name = std::any::type_name::<T>();
    let brackets = if name.starts_with('[') { "[" } else { "" };
    format!("{brackets}{}", name.trim_start_matches('[').rsplit("::").next().unwrap())
}

/// A field that is not named does not compile.
macro_rules! message {
    ($name:ident { $($field:ident),* $(,)? }) => {{
        let message = $name::default();
        let $name { $($field),* } = &message;
        let mut fields: Vec<Field> = vec![
            $((stringify!($field), type_of($field), std::mem::offset_of!($name, $field), size_of_val($field))),*
        ];
        fields.sort_by_key(|field| field.2);
        Message { name: stringify!($name), detail: TypeDetail::new::<$name>(TypeVariant::FixedSize), fields }
    }};
}

fn messages() -> Vec<Message> {
    vec![
        message!(Measurement {
            sequence,
            stamp_ns,
            valid,
            velocity_frame,
            velocity_m_s,
            angular_velocity_rad_s,
            position_m,
            attitude_wxyz,
            force_n,
            torque_n_m,
            output,
            input
        }),
        message!(Channel {
            output_error,
            activation,
            power_function,
            native_norm,
            solver_error,
            error_bound,
            output_age_s
        }),
        message!(Estimate {
            sequence,
            source_sequence,
            stamp_ns,
            source_stamp_ns,
            publish_stamp_ns,
            status,
            position_m,
            velocity_m_s,
            attitude_wxyz,
            euler_rad,
            angular_velocity_rad_s,
            matched_force_n,
            matched_torque_n_m,
            translation,
            rotation,
            state,
            matched_input,
            linear
        }),
        message!(LatencySummary { count, p50, p90, p99, p999, max }),
        message!(Status {
            sequence,
            stamp_ns,
            start_stamp_ns,
            rate_millihertz,
            dead_zone_width,
            ticks,
            deadline_misses,
            samples_accepted,
            samples_lost,
            samples_rejected,
            newest_sequence,
            newest_sample_age_ns,
            ticks_coasting,
            ticks_clamped,
            state_resets,
            source_changes,
            source_pid,
            other_source_pid,
            commands,
            records_dropped,
            adaptation_frozen,
            outputs_held_back,
            outputs_stuck,
            late_ticks_in_a_row,
            most_late_ticks_in_a_row,
            ticks_predict_only,
            ticks_invalid,
            real_time_requested,
            real_time_granted,
            snapshot_restored,
            snapshots_saved,
            snapshots_failed,
            snapshot_stamp_ns,
            ticks_recorded,
            ticks_not_recorded,
            wake_up_lateness_ns,
            step_ns,
            input_age_ns,
            source_to_publish_ns
        }),
        message!(Truth {
            sequence,
            stamp_ns,
            position_m,
            velocity_m_s,
            attitude_wxyz,
            angular_velocity_rad_s,
            matched_force_n,
            matched_torque_n_m,
            unmatched_force_n,
            unmatched_torque_n_m
        }),
        {
            use Order as Command;
            message!(Command { kind, reserved })
        },
        message!(Reply { outcome, message_bytes, message, status }),
    ]
}

macro_rules! constants {
    ($module:ident { $($constant:ident),* $(,)? }) => {
        (stringify!($module), vec![$((stringify!($constant), u64::from($module::$constant))),*])
    };
}

/// Modules of constants; that none is missing is seen in the source.
fn constants() -> Vec<(&'static str, Vec<(&'static str, u64)>)> {
    let modules = vec![
        constants!(valid {
            VELOCITY,
            ANGULAR_VELOCITY,
            POSITION,
            ATTITUDE,
            FORCE,
            TORQUE,
            RIGID_BODY,
            OUTPUT,
            INPUT,
            ALL
        }),
        constants!(frame { INERTIAL, BODY }),
        constants!(status_bits {
            TRACKING,
            COASTING_TRANSLATION,
            COASTING_ROTATION,
            COASTING_LINEAR,
            COASTING,
            STALE,
            ADAPTING,
            FROZEN,
            OUTSIDE_CENTERS,
            REJECTED_SAMPLE,
            CLAMPED,
            DIVERGED,
            WAITING,
            LATE,
            PREDICT_ONLY,
            INVALID,
            HELD_BACK,
            STUCK
        }),
        constants!(real_time { PRIORITY, CORES, LOCKED_MEMORY, PUNCTUAL_TIMERS, AWAKE_CORES }),
        constants!(restored { NOTHING, LEARNED, LEARNED_AND_STATE }),
        constants!(command { RESET, FREEZE, THAW, SAVE, STATUS }),
        constants!(outcome { DONE, REFUSED, UNKNOWN }),
    ];
    let public_modules: Vec<&str> =
        SOURCE.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(" {")).collect();
    assert_eq!(public_modules, modules.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    for (module, listed) in &modules {
        let text = item(&format!("pub mod {module} {{"));
        let n_public = text.lines().filter(|line| line.trim_start().starts_with("pub const ")).count();
        assert_eq!(listed.len(), n_public, "{module}: a constant of the source is not listed here");
    }
    modules
}

/// The source from this line to the end of the item.
fn item(first_line: &str) -> &'static str {
    let start = SOURCE.find(&format!("\n{first_line}\n")).unwrap_or_else(|| panic!("no '{first_line}'")) + 1;
    &SOURCE[start..start + SOURCE[start..].find("\n}").unwrap()]
}

/// The documentation above the first line that begins so, as one text.
fn doc_above(source: &str, begins: &str) -> String {
    let lines: Vec<&str> = source.lines().map(str::trim_start).collect();
    let at =
        lines.iter().position(|line| line.starts_with(begins)).unwrap_or_else(|| panic!("no '{begins}'"));
    let doc: Vec<&str> = lines[..at]
        .iter()
        .rev()
        .skip_while(|line| line.starts_with("#["))
        .map_while(|line| line.strip_prefix("///"))
        .map(str::trim)
        .collect();
    let text = doc.into_iter().rev().collect::<Vec<_>>().join(" ");
    assert!(!text.is_empty(), "no documentation above '{begins}'");
    // Links are Rust's.
    text.replace("[`", "`").replace("`]", "`").replace("::", ".")
}

fn python_type(rust: &str) -> String {
    match rust.trim_matches(['[', ']']).split_once("; ") {
        Some((scalar, length)) => format!("array({}, {length})", python_type(scalar)),
        None => match rust {
            "f64" => "ctypes.c_double".into(),
            "u64" => "ctypes.c_uint64".into(),
            "u32" => "ctypes.c_uint32".into(),
            "u8" => "ctypes.c_uint8".into(),
            message => message.into(),
        },
    }
}

/// For a reader and its editor: what an attribute gives.
fn python_hint(rust: &str) -> &str {
    match rust {
        "f64" => "float",
        "u64" | "u32" => "int",
        array if array.starts_with('[') => "ctypes.Array",
        message => message,
    }
}

/// Breaks a text after spaces, with this in front of each line.
fn wrapped(text: &str, indent: &str) -> String {
    let mut lines = vec![String::from(indent)];
    for word in text.split(' ') {
        let line = lines.last_mut().unwrap();
        if line.chars().count() + word.chars().count() < 110 {
            let gap = if line == indent { "" } else { " " };
            line.push_str(gap);
            line.push_str(word);
        } else {
            lines.push(format!("{indent}{word}"));
        }
    }
    lines.join("\n")
}

/// `payload.py`, from the real types.
fn payload_module() -> String {
    let mut text = String::from(
        "\"\"\"The messages, as they lie in shared memory: fixed size, no padding, all SI.\n\n\
         Written from the Rust types by `UPDATE_PYTHON=1 cargo test -p daemon --test python`: not to be edited.\n\n\
         Frames: I is inertial, J the body, both right-handed; `attitude_wxyz` rotates body vectors into I.\n\"\"\"\n\n\
         import ctypes\n\n\
         from .structure import EstimateStructure, ReplyStructure, StatusStructure, Structure, array\n",
    );
    for (module, constants) in constants() {
        let doc = doc_above(SOURCE, &format!("pub mod {module} {{"));
        let source = item(&format!("pub mod {module} {{"));
        write!(text, "\n\nclass {module}:\n    \"\"\"{doc}\"\"\"\n").unwrap();
        for (name, value) in constants {
            let doc = doc_above(source, &format!("pub const {name}:"));
            write!(text, "\n{}\n    {name} = {value}\n", wrapped(&doc, "    # ")).unwrap();
        }
    }
    let words = |name: &str, doc: &str, words: fn(u64) -> Vec<&'static str>| {
        let mut text = format!("\n\n#: {doc}\n{name} = {{\n");
        for bit in (0..64).map(|place| 1 << place) {
            for word in words(bit) {
                writeln!(text, "    {bit}: \"{word}\",").unwrap();
            }
        }
        text + "}\n"
    };
    text += &words("STATUS_WORDS", "Words for bits of `Estimate.status`.", status_bits::words);
    text += &words("REAL_TIME_WORDS", "Words for bits of `Status.real_time_granted`.", real_time::words);
    text +=
        "\n\n#: Why samples were rejected, in the order of `Status.samples_rejected`.\nREJECTION_WORDS = (\n";
    for reason in Rejection::ALL {
        writeln!(text, "    \"{}\",", reason.words()).unwrap();
    }
    text += ")\n";
    for Message { name, detail, fields } in messages() {
        let base = match name {
            "Estimate" | "Reply" | "Status" => format!("{name}Structure"),
            _ => "Structure".into(),
        };
        let first_line = format!("pub struct {name} {{");
        let doc = wrapped(&doc_above(SOURCE, &first_line), "    ");
        write!(text, "\n\nclass {name}({base}):\n    \"\"\"{}\"\"\"\n", doc.trim_start()).unwrap();
        write!(text, "\n    TYPE_NAME = \"{}\"\n", detail.type_name()).unwrap();
        let source = item(&first_line);
        for (field, rust, ..) in &fields {
            let doc = doc_above(source, &format!("pub {field}:"));
            write!(text, "\n{}\n    {field}: {}\n", wrapped(&doc, "    # "), python_hint(rust)).unwrap();
        }
        text += "\n    _fields_ = [\n";
        for (field, rust, ..) in &fields {
            writeln!(text, "        (\"{field}\", {}),", python_type(rust)).unwrap();
        }
        text += "    ]\n";
    }
    text
}

#[test]
fn the_python_messages_are_the_rust_messages() {
    let path = Path::new(PACKAGE).join("observer_client/payload.py");
    let needed = payload_module();
    if std::env::var_os("UPDATE_PYTHON").is_some() {
        fs::write(&path, &needed).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    let differs = found.lines().zip(needed.lines()).position(|(found, needed)| found != needed);
    assert!(
        found == needed,
        "{} differs from the Rust types (line {:?}); write it anew: UPDATE_PYTHON=1 cargo test -p daemon --test python",
        path.display(),
        differs.map(|line| line + 1)
    );
}

#[test]
fn the_readmes_python_is_that_of_a_tested_example() {
    let block = README.split("```python\n").nth(1).expect("a block of Python").split("```").next().unwrap();
    let example = fs::read_to_string(Path::new(PACKAGE).join("examples/flight_loop.py")).unwrap();
    assert!(example.contains(block), "examples/flight_loop.py lacks the README's\n{block}");
}

/// What the Python tests compare with.
fn facts() -> Value {
    let layout = messages().into_iter().map(|message| {
        let detail = &message.detail;
        json!({
            "name": message.name,
            "type_name": detail.type_name().to_string(),
            "size": detail.size(),
            "alignment": detail.alignment(),
            "fields": message.fields,
        })
    });
    let roots = [
        "/dev/shm/observer-0",
        "/dev/shm/flight1",
        "/tmp/a.b-c_d",
        "/tmp/zürich/x",
        "/tmp//double/",
        "/tmp/dot/.",
        "relative/path",
        "",
        "/",
        "/tmp/..",
        "/tmp/with space",
        "/tmp/zürich",
        "/tmp/0123456789012345678901234567890123456789",
        "/tmp/01234567890123456789",
    ];
    let domains = roots.map(|root| match Domain::at(Path::new(root)) {
        Ok(domain) => json!({ "root": root, "prefix": domain.prefix() }),
        Err(error) => json!({ "root": root, "refused": error.to_string() }),
    });
    json!({
        "daemon": env!("CARGO_BIN_EXE_daemon"),
        "layout": layout.collect::<Vec<_>>(),
        "domains": domains,
        "estimate_buffer": service::ESTIMATE_BUFFER,
        "max_readers": service::MAX_READERS,
    })
}

/// Past the test's capture: nobody shall take a skipped test for a passed one.
fn skip(reason: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: the Python client against a live service: {reason}");
}

#[test]
fn the_python_client_works_with_a_live_service() {
    // Where this can be installed, what the package needs can be, too.
    let python = match environment("python-client", &["flit_core>=3.4,<5"]) {
        Ok(python) => python,
        Err(reason) => return skip(&reason),
    };
    pip_install(&python, &["--no-build-isolation", &format!("{PACKAGE}[test]")]).unwrap();
    let facts_file = tempfile::NamedTempFile::new().unwrap();
    fs::write(facts_file.path(), facts().to_string()).unwrap();
    let output = Command::new(python)
        .args(["-m", "pytest", "-p", "no:cacheprovider", "--durations=8", "-ra"])
        .arg(Path::new(PACKAGE).join("tests"))
        // Neither the package's directory nor anything else of the sources is to be imported by chance.
        .current_dir(env!("CARGO_TARGET_TMPDIR"))
        .env("OBSERVER_FACTS", facts_file.path())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("MPLBACKEND", "Agg")
        .env_remove("OBSERVER_ROOT")
        .output()
        .unwrap();
    println!("{}", said(&output));
    assert!(output.status.success(), "{}", said(&output));
}
