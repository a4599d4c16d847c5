//! The checked-in header is what the library's source says. After a change of either:
//!
//!     OBSERVER_WRITE_HEADER=1 cargo test -p observer_client --test header

use observer_client::layout::{HASH, LAYOUTS};
use std::fmt::Write;
use std::path::Path;

const SOURCE: &str = include_str!("../src/lib.rs");
const PAYLOADS: &str = include_str!("../../src/payload.rs");

#[test]
fn the_checked_in_header_is_what_the_source_says() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/observer_client.h");
    let made = header();
    if std::env::var_os("OBSERVER_WRITE_HEADER").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let differing = made.lines().zip(found.lines()).find(|(made, found)| made != found);
    assert!(
        made == found,
        "{} is not what the source says ({differing:?}); write it: OBSERVER_WRITE_HEADER=1 cargo test -p observer_client --test header",
        path.display()
    );
}

/// Functions and structs by cbindgen; around them constants and assertions, which it cannot make from modules
/// of constants and from a compiled layout.
fn header() -> String {
    let renamed = [
        ("Measurement", "observer_measurement"),
        ("Channel", "observer_channel"),
        ("Estimate", "observer_estimate"),
        ("LatencySummary", "observer_latency_summary"),
        ("Status", "observer_status"),
        ("Reply", "observer_reply"),
        ("Rejection", "observer_rejection"),
        ("CallResult", "observer_result"),
        ("Handle", "observer_client"),
    ];
    let config = cbindgen::Config {
        language: cbindgen::Language::C,
        cpp_compat: true,
        style: cbindgen::Style::Type,
        usize_is_size_t: true,
        no_includes: true,
        sys_includes: ["assert.h", "stddef.h", "stdint.h"].map(String::from).into(),
        header: Some(format!("{}\n\n#ifndef OBSERVER_CLIENT_H\n#define OBSERVER_CLIENT_H", HEAD.trim())),
        after_includes: Some(constants()),
        trailer: Some(format!("{}\n#endif // OBSERVER_CLIENT_H", assertions())),
        documentation_style: cbindgen::DocumentationStyle::Doxy,
        line_length: 110,
        enumeration: cbindgen::EnumConfig {
            rename_variants: cbindgen::RenameRule::QualifiedScreamingSnakeCase,
            ..Default::default()
        },
        export: cbindgen::ExportConfig {
            include: vec!["Rejection".into()],
            rename: renamed.map(|(rust, c)| (rust.into(), c.into())).into(),
            item_types: [
                cbindgen::ItemType::Functions,
                cbindgen::ItemType::Structs,
                cbindgen::ItemType::Enums,
            ]
            .into(),
            ..Default::default()
        },
        ..Default::default()
    };
    let directory = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut bytes = Vec::new();
    cbindgen::Builder::new()
        .with_config(config)
        .with_src(directory.join("src/lib.rs"))
        .with_src(directory.join("../src/payload.rs"))
        .generate()
        .unwrap()
        .write(&mut bytes);
    // Links of Rust's documentation are names in C; what its compiler asks to be said of safety, the texts say.
    let mut text = String::from_utf8(bytes).unwrap().replace("OBSERVER_RESULT_", "OBSERVER_");
    for (rust, c) in renamed {
        text = text.replace(&format!("[`{rust}`]"), c);
        text = text.replace(&format!("[`{rust}::"), &format!("[`{c}::"));
    }
    for (module, prefix) in MODULES {
        text = text.replace(&format!("[`{module}`]"), &format!("{prefix}_…"));
        text = text.replace(&format!("[`{module}::"), &format!("[`{prefix}_"));
    }
    text = text.replace("[`Command::kind`]", "`command` in observer_command()");
    text.replace("[`", "").replace("`]", "").replace("::", ".").replace(" * # Safety\n", " * Condition:\n")
}

const HEAD: &str = r#"
/* The vehicle's side of the state-estimation service, for C11 and, wrapped by observer_client.hpp, C++17.
 * Made from the library's source by cargo test; not to be edited.
 *
 *     observer_client client;
 *     if (observer_open(OBSERVER_LAYOUT, NULL, "vehicle", OBSERVER_PORTS_ALL, 5.0, &client) < 0)
 *         fprintf(stderr, "%s\n", observer_error_text());
 *     observer_measurement sample = {.sequence = 0, .stamp_ns = observer_now_ns(), .valid = OBSERVER_VALID_VELOCITY};
 *     observer_publish(client, &sample);
 *     observer_estimate estimate;
 *     uint64_t do_not_fly = OBSERVER_STATUS_BITS_STALE | OBSERVER_STATUS_BITS_INVALID;
 *     if (observer_peek(client, &estimate) == OBSERVER_OK && !(estimate.status & do_not_fly)
 *         && observer_now_ns() - estimate.publish_stamp_ns < 100000000) ... // a dead service's last one stays
 *     observer_close(client);
 *
 * Results below 0 are failures. Any thread may call; a handle belongs to the thread that opened it, and every other
 * thread's call is refused. Signal handlers and forked children must not call.
 * Once a handle is open, observer_publish, _take, _peek and _read_status make no system call.
 * All quantities are SI; the unit is in the name. Frames: inertial, and the body's; attitude_wxyz rotates
 * body vectors into the inertial frame. */
"#;

/// Modules of constants, and what their names begin with in C.
const MODULES: [(&str, &str); 8] = [
    ("valid", "OBSERVER_VALID"),
    ("frame", "OBSERVER_FRAME"),
    ("status_bits", "OBSERVER_STATUS_BITS"),
    ("real_time", "OBSERVER_REAL_TIME"),
    ("restored", "OBSERVER_RESTORED"),
    ("command", "OBSERVER_COMMAND"),
    ("outcome", "OBSERVER_OUTCOME"),
    ("ports", "OBSERVER_PORTS"),
];

fn constants() -> String {
    let mut text = format!(
        "\n/** Tells the payloads of one version from those of another: for observer_open(). */\n#define OBSERVER_LAYOUT UINT32_C({HASH:#010x})\n\n/** Enough for the text of any reply, with its end. */\n#define OBSERVER_REPLY_TEXT_BYTES {}\n",
        size_of_val(&shared_types::payload::Reply::default().message) + 1
    );
    for (module, prefix) in MODULES {
        let source = if module == "ports" { SOURCE } else { PAYLOADS };
        text += &defines(source, module, prefix);
    }
    text.trim_end().into()
}

/// The public constants of a module, with its documentation and theirs.
fn defines(source: &str, module: &str, prefix: &str) -> String {
    let start = format!("pub mod {module} {{");
    let mut lines = source.lines();
    let before = lines.by_ref().take_while(|line| *line != start).last().unwrap();
    let mut text = format!("\n/* {} */\n", before.strip_prefix("/// ").expect("a documented module"));
    let mut words = Vec::new();
    for line in lines.take_while(|line| *line != "}").map(str::trim) {
        if let Some(found) = line.strip_prefix("/// ") {
            words.push(found);
            continue;
        }
        if let Some(constant) = line.strip_prefix("pub const ") {
            let (name, rest) = constant.split_once(": ").unwrap();
            let (kind, value) = rest.strip_suffix(';').unwrap().split_once(" = ").unwrap();
            let literal = if kind == "u64" { "UINT64_C" } else { "UINT32_C" };
            let value = in_c(value, prefix, literal);
            writeln!(text, "/** {} */\n#define {prefix}_{name} ({value})", words.join(" ")).unwrap();
        }
        words.clear();
    }
    text
}

/// A constant expression of numbers and of names from the same module.
fn in_c(expression: &str, prefix: &str, literal: &str) -> String {
    let mut text = String::new();
    for word in expression.split_inclusive(|c: char| !(c.is_ascii_alphanumeric() || c == '_')) {
        let end = word.trim_end_matches(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).len();
        let (word, rest) = word.split_at(end);
        text += &match word.as_bytes() {
            [] => String::new(),
            [b'0'..=b'9', ..] if text.ends_with("<< ") => word.into(),
            [b'0'..=b'9', ..] => format!("{literal}({word})"),
            _ => format!("{prefix}_{word}"),
        };
        text += rest;
    }
    text
}

/// Sizes and offsets as the library was compiled, for the program's compiler to agree with.
fn assertions() -> String {
    let mut text = String::from("/* The payloads as the library was compiled. */\n");
    for layout in LAYOUTS {
        let name = layout.name;
        writeln!(text, "static_assert(sizeof({name}) == {}, \"size of {name}\");", layout.bytes).unwrap();
        for (field, offset) in layout.fields {
            writeln!(text, "static_assert(offsetof({name}, {field}) == {offset}, \"{name}.{field}\");")
                .unwrap();
        }
    }
    text.trim_end().into()
}
