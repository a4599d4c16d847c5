//! `observer_client.h`: functions by cbindgen from the library's source, everything else from the tables.

use crate::text::wrapped;
use observer_client::layout::{HASH, LAYOUTS};
use observer_client::ports;
use shared_types::payload::{CONSTANTS, Rejection};
use shared_types::table::{Constants, Kind, Scalar, Table};
use std::fmt::Write;
use std::path::Path;

/// What Rust's names are in C.
const RENAMED: [(&str, &str); 10] = [
    ("Measurement", "observer_measurement"),
    ("Channel", "observer_channel"),
    ("Estimate", "observer_estimate"),
    ("LatencySummary", "observer_latency_summary"),
    ("Counters", "observer_counters"),
    ("Status", "observer_status"),
    ("Reply", "observer_reply"),
    ("Rejection", "observer_rejection"),
    ("CallResult", "observer_result"),
    ("Handle", "observer_client"),
];

pub(crate) fn header() -> String {
    let config = cbindgen::Config {
        language: cbindgen::Language::C,
        cpp_compat: true,
        style: cbindgen::Style::Type,
        usize_is_size_t: true,
        no_includes: true,
        sys_includes: ["assert.h", "stddef.h", "stdint.h"].map(String::from).into(),
        header: Some(format!("{}\n\n#ifndef OBSERVER_CLIENT_H\n#define OBSERVER_CLIENT_H", HEAD.trim())),
        after_includes: Some(format!("{}\n{}", constants(), payloads()).trim_end().into()),
        trailer: Some(format!("{}\n#endif // OBSERVER_CLIENT_H", assertions())),
        documentation_style: cbindgen::DocumentationStyle::Doxy,
        line_length: 110,
        enumeration: cbindgen::EnumConfig {
            rename_variants: cbindgen::RenameRule::QualifiedScreamingSnakeCase,
            ..Default::default()
        },
        export: cbindgen::ExportConfig {
            rename: RENAMED.map(|(rust, c)| (rust.into(), c.into())).into(),
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
    let mut bytes = Vec::new();
    let library = cbindgen::Builder::new().with_config(config);
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs");
    library.with_src(source).generate().unwrap().write(&mut bytes);
    let text = String::from_utf8(bytes).unwrap().replace("OBSERVER_RESULT_", "OBSERVER_");
    // What Rust's compiler asks to be said of safety, the texts say. Comments begin and end as those of the tables.
    let text = in_c(&text).replace(" * # Safety\n", " * Condition:\n");
    ["", "  "].iter().fold(text, |text, indent| {
        text.replace(&format!("{indent}/**\n{indent} * "), &format!("{indent}/** "))
            .replace(&format!("\n{indent} */\n"), " */\n")
    })
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

/// What the names of a module's constants begin with.
fn prefix(module: &Constants) -> String {
    format!("OBSERVER_{}", module.name.to_uppercase())
}

fn modules() -> impl Iterator<Item = &'static Constants> {
    CONSTANTS.into_iter().chain([&ports::TABLE])
}

/// Links of Rust's documentation as names in C.
fn in_c(text: &str) -> String {
    let mut text = text.replace("[`Command::kind`]", "`command` in observer_command()");
    for (rust, c) in RENAMED {
        text = text.replace(&format!("[`{rust}`]"), c).replace(&format!("[`{rust}::"), &format!("[`{c}::"));
    }
    for module in modules() {
        let (name, prefix) = (module.name, prefix(module));
        text = text.replace(&format!("[`{name}`]"), &format!("{prefix}_…"));
        text = text.replace(&format!("[`{name}::"), &format!("[`{prefix}_"));
    }
    text.replace("[`", "").replace("`]", "").replace("::", ".")
}

/// A line of code with what it is beside it, or above it where the line would be too long.
fn documented(code: &str, doc: &str) -> String {
    let doc = in_c(doc.trim());
    let beside = format!("{code} /**< {doc} */");
    if beside.chars().count() <= 110 {
        return beside + "\n";
    }
    let indent = " ".repeat(code.len() - code.trim_start().len());
    format!("{}\n{code}\n", comment(&doc, &indent))
}

fn comment(doc: &str, indent: &str) -> String {
    let lines = wrapped(&format!("{doc} */"), &format!("{indent} * "));
    format!("{indent}/** {}", lines.join("\n").trim_start_matches([' ', '*']))
}

fn constants() -> String {
    let mut text = format!(
        "\n/** Tells the payloads of one version from those of another: for observer_open(). */\n#define OBSERVER_LAYOUT UINT32_C({HASH:#010x})\n\n/** Enough for the text of any reply, with its end. */\n#define OBSERVER_REPLY_TEXT_BYTES {}\n",
        size_of_val(&shared_types::payload::Reply::default().message) + 1
    );
    for module in modules() {
        writeln!(text, "\n/* {} */", module.doc.trim()).unwrap();
        let bits = if module.is_wide { 64 } else { 32 };
        for constant in module.constants {
            let (prefix, name, value) = (prefix(module), constant.name, constant.value);
            text += &documented(&format!("#define {prefix}_{name} UINT{bits}_C({value:#x})"), constant.doc);
        }
    }
    text
}

fn payloads() -> String {
    let mut text = String::from(
        "/** Why a sample was rejected; the value is its index in samples_rejected. */\ntypedef enum {\n",
    );
    for (reason, name) in Rejection::ALL.into_iter().zip(Rejection::KEYS) {
        text += &documented(&format!("  OBSERVER_REJECTION_{},", name.to_uppercase()), reason.doc());
    }
    text += "} observer_rejection;\n";
    for (name, table) in LAYOUTS {
        write!(text, "\n{}\ntypedef struct {{\n", comment(&in_c(table.doc.trim()), "")).unwrap();
        for field in table.fields {
            let code = match field.kind {
                Kind::One(scalar) => format!("  {} {};", type_of(scalar), field.name),
                Kind::Many(scalar, n) => format!("  {} {}[{n}];", type_of(scalar), field.name),
                Kind::Message(held) => format!("  {} {};", name_of(held), field.name),
            };
            text += &documented(&code, field.doc);
        }
        writeln!(text, "}} {name};").unwrap();
    }
    text
}

fn name_of(table: &Table) -> &'static str {
    LAYOUTS.iter().find(|(_, layout)| layout.name == table.name).expect("in the list").0
}

fn type_of(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::U8 => "uint8_t",
        Scalar::U32 => "uint32_t",
        Scalar::U64 => "uint64_t",
        Scalar::F64 => "double",
    }
}

/// Sizes and offsets as the library was compiled, for the program's compiler to agree with.
fn assertions() -> String {
    let mut text = String::from("/* The payloads as the library was compiled. */\n");
    for (name, table) in LAYOUTS {
        let mut line = format!("static_assert(sizeof({name}) == {}", table.bytes);
        for field in table.fields {
            let condition = format!("offsetof({name}, {}) == {}", field.name, field.offset);
            if line.len() + condition.len() > 106 {
                writeln!(text, "{line}").unwrap();
                line = String::from("   ");
            }
            line += &format!(" && {condition}");
        }
        writeln!(text, "{line},\n    \"layout of {name}\");").unwrap();
    }
    text.trim_end().into()
}
