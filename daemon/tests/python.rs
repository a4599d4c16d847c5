//! The Python client (`shared_types/python`), run against real services by its own tests.

use serde_json::{Value, json};
use shared_types::payload::PAYLOADS;
use shared_types::table::Kind;
use shared_types::{Domain, service};
use std::fs;
use std::path::Path;
use std::process::Command;
use testkit::python::{environment, pip_install, said};

const PACKAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared_types/python");

#[test]
fn the_readmes_python_is_that_of_a_tested_example() {
    let read = |file: &str| fs::read_to_string(Path::new(PACKAGE).join(file)).unwrap();
    let (readme, example) = (read("README.md"), read("examples/flight_loop.py"));
    let block = readme.split("```python\n").nth(1).expect("a block of Python").split("```").next().unwrap();
    assert!(example.contains(block), "examples/flight_loop.py lacks the README's\n{block}");
}

/// A type as Rust writes it.
fn type_of(kind: Kind) -> String {
    let scalar = |scalar| format!("{scalar:?}").to_lowercase();
    match kind {
        Kind::One(kind) => scalar(kind),
        Kind::Many(kind, n) => format!("[{}; {n}]", scalar(kind)),
        Kind::Message(table) => table.name.into(),
    }
}

/// What the Python tests compare with.
fn facts() -> Value {
    let layout = PAYLOADS.map(|table| {
        let fields = table.fields.iter();
        let fields =
            fields.map(|field| json!([field.name, type_of(field.kind), field.offset, field.bytes()]));
        json!({
            "name": table.name,
            "type_name": table.type_name,
            "size": table.bytes,
            "alignment": table.align,
            "fields": fields.collect::<Vec<_>>(),
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
        "layout": layout,
        "domains": domains,
        "estimate_buffer": service::ESTIMATE_BUFFER,
        "max_readers": service::MAX_READERS,
    })
}

#[test]
fn the_python_client_works_with_a_live_service() {
    // Where this can be installed, what the package needs can be, too.
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-client");
    let python = match environment(&directory, &["flit_core>=3.4,<5"]) {
        Ok(python) => python,
        Err(reason) => return testkit::skip("the Python client against a live service", &reason),
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
