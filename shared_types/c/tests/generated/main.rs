//! The files of other languages are generated from the tables of `shared_types`. These tests compare the checked-in files
//! with the tables. After a change of a table, or of a function of the C client, generate them anew:
//!
//!     UPDATE=1 cargo test -p observer_client --test generated

mod c;
mod python;
mod text;

use shared_types::payload::PAYLOADS;
use std::path::Path;

#[test]
fn the_c_header_is_what_the_tables_say() {
    compare("include/observer_client.h", &c::header());
}

#[test]
fn the_python_messages_are_what_the_tables_say() {
    compare("../python/observer_client/payload.py", &python::module());
}

/// The layout is the contract with other processes: a type name never gets another one.
#[test]
fn another_layout_has_another_version() {
    let known = include_str!("layouts.txt");
    let layouts = PAYLOADS.map(|table| {
        let fields = table.fields.iter().map(|field| format!(" {}@{}", field.name, field.offset));
        let layout = format!("{} {}:{}", table.type_name, table.bytes, fields.collect::<String>());
        let begin = format!("{} ", table.type_name);
        if let Some(before) = known.lines().find(|line| line.starts_with(&begin)) {
            assert_eq!(layout, before, "count up the version in this payload's type name");
        }
        layout + "\n"
    });
    compare("tests/generated/layouts.txt", &layouts.concat());
}

fn compare(file: &str, made: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, made).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let differing = made.lines().zip(found.lines()).find(|(made, found)| made != found);
    assert!(
        made == found,
        "{} is not what the tables say ({differing:?}); write it: UPDATE=1 cargo test -p observer_client --test generated",
        path.display()
    );
}
