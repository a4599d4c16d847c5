//! `payload.py`, from the tables.

use crate::text::wrapped;
use shared_types::payload::{CONSTANTS, Measurement, PAYLOADS, Rejection, real_time, status_bits};
use shared_types::table::{Constants, Field, Kind, Scalar, Table};
use std::collections::BTreeSet;
use std::fmt::Write;

pub(crate) fn module() -> String {
    let mut text = String::from(HEAD);
    let fields = PAYLOADS.iter().flat_map(|table| table.fields);
    let arrays: BTreeSet<_> = fields.filter(|field| matches!(field.kind, Kind::Many(..))).map(hint).collect();
    for array in arrays {
        let (scalar, n) = array.split_once('x').unwrap();
        let scalar = if scalar == "f64" { "double".into() } else { scalar.replace('u', "uint") };
        writeln!(text, "{array} = Annotated[ctypes.Array, array(ctypes.c_{scalar}, {n})]").unwrap();
    }
    for module in CONSTANTS {
        write!(text, "\n\nclass {}:\n    \"\"\"{}\"\"\"\n\n", module.name, plain(module.doc)).unwrap();
        for constant in module.constants {
            text += &documented(&format!("    {} = {:#x}", constant.name, constant.value), constant.doc);
        }
    }
    text += &words("STATUS_WORDS", "Words for bits of `Estimate.status`.", &status_bits::TABLE);
    text += &words("REAL_TIME_WORDS", "Words for bits of `Status.real_time_granted`.", &real_time::TABLE);
    text += "\n\n#: Why samples were rejected, in the order of `Counters.samples_rejected`.\nREJECTION_WORDS = (\n";
    for reason in Rejection::ALL {
        writeln!(text, "    \"{}\",", reason.words()).unwrap();
    }
    text += ")\n\n#: What a sample may carry: name, bit of `valid`, what it is.\nREADINGS = {\n";
    for (_, field, _) in Measurement::quantities() {
        writeln!(text, "    \"{}\": ({:#x}, \"{}\"),", field.name, field.valid, plain(field.doc)).unwrap();
    }
    text += "}\n";
    for table in PAYLOADS {
        let base = match table.name {
            "Estimate" | "Reply" | "Status" => format!("{}Structure", table.name),
            _ => "Structure".into(),
        };
        let doc = wrapped(&plain(table.doc), "    ").join("\n");
        write!(
            text,
            "\n\n@laid_out\nclass {}({base}):\n    \"\"\"{}\"\"\"\n\n",
            table.name,
            doc.trim_start()
        )
        .unwrap();
        writeln!(text, "    TYPE_NAME = \"{}\"", table.type_name).unwrap();
        text += &match table.name {
            "Estimate" => format!("    WORDS = STATUS_WORDS\n    MAY_BE_INFINITE = {}\n\n", infinite(table)),
            "Status" => "    WORDS = REJECTION_WORDS\n\n".into(),
            _ => "\n".into(),
        };
        for field in table.fields {
            text += &documented(&format!("    {}: {}", field.name, hint(field)), field.doc);
        }
    }
    text
}

const HEAD: &str = r#""""The messages, as they lie in shared memory: fixed size, no padding, all SI.

Made from the tables of `shared_types` by `UPDATE=1 cargo test -p observer_client --test generated`: not to be edited.

Frames: I is inertial, J the body, both right-handed; `attitude_wxyz` rotates body vectors into I.
"""

import ctypes
from typing import Annotated

from .structure import EstimateStructure, ReplyStructure, StatusStructure, Structure, array, laid_out

u32 = Annotated[int, ctypes.c_uint32]
u64 = Annotated[int, ctypes.c_uint64]
f64 = Annotated[float, ctypes.c_double]
"#;

/// Links are Rust's.
fn plain(doc: &str) -> String {
    doc.trim().replace("[`", "`").replace("`]", "`").replace("::", ".")
}

/// A line with what it is beside it, or above it where the line would be too long.
fn documented(code: &str, doc: &str) -> String {
    let doc = plain(doc);
    let beside = format!("{code}  # {doc}");
    match beside.chars().count() <= 120 {
        true => beside + "\n",
        false => format!("{}\n{code}\n", wrapped(&doc, "    # ").join("\n")),
    }
}

/// The fields of which +∞ is a value, as a tuple.
fn infinite(table: &Table) -> String {
    let fields = table.fields.iter().filter(|field| field.may_be_infinite);
    let names: String = fields.map(|field| format!("        \"{}\",\n", field.name)).collect();
    format!("(\n{names}    )")
}

/// The type of an attribute.
fn hint(field: &Field) -> String {
    let scalar = |scalar| match scalar {
        Scalar::U8 => "u8",
        Scalar::U32 => "u32",
        Scalar::U64 => "u64",
        Scalar::F64 => "f64",
    };
    match field.kind {
        Kind::One(kind) => scalar(kind).into(),
        Kind::Many(kind, n) => format!("{}x{n}", scalar(kind)),
        Kind::Message(table) => table.name.into(),
    }
}

fn words(name: &str, doc: &str, bits: &Constants) -> String {
    let mut text = format!("\n\n#: {doc}\n{name} = {{\n");
    for constant in bits.constants.iter().filter(|constant| !constant.word.is_empty()) {
        writeln!(text, "    {:#x}: \"{}\",", constant.value, constant.word).unwrap();
    }
    text + "}\n"
}
