//! `bench replay --check`: replays a flight record and compares every estimate.

use crate::harness::output::{show, table};
use anyhow::{Context, bail, ensure};
use daemon::replay::{self, SessionReport};
use flight_record::Reader;
use serde::Serialize;
use shared_types::{logln, outln};
use std::path::Path;

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    file: String,
    same: bool,
    torn_bytes: u64,
    sessions: Vec<SessionReport>,
}

/// Replays the record and prints the result; an estimate that differs is a failure.
pub(crate) fn run(file: &Path, json: bool) -> anyhow::Result<()> {
    let name = file.display().to_string();
    let mut reader = Reader::open(file).with_context(|| name.clone())?;
    let sessions = replay::check(&mut reader).with_context(|| name.clone())?;
    let n_same: u64 = sessions.iter().map(|session| session.ticks_same).sum();
    let same = n_same > 0 && sessions.iter().all(|session| session.difference.is_none());
    let document = Document { file: name, same, torn_bytes: reader.torn_bytes(), sessions };
    show(json, &document, || print(&document))?;
    let here = observer::vector_unit();
    let first = document.sessions.iter().find_map(|session| Some((session, session.difference.as_ref()?)));
    let Some((session, difference)) = first else {
        ensure!(same, "no tick could be compared");
        return Ok(());
    };
    if session.vector_unit != here {
        logln!(
            "bench: recorded with {}, replayed with {here}: the last bits differ between the two",
            session.vector_unit
        );
    }
    bail!(
        "tick {} differs: {} was {} and is {}",
        difference.tick,
        difference.field,
        difference.recorded,
        difference.replayed
    )
}

fn print(document: &Document) {
    let header = [
        "session",
        "began",
        "time (s)",
        "samples",
        "ticks the same",
        "missing",
        "unchecked",
        "first difference",
    ];
    let rows = document.sessions.iter().enumerate().map(|(j, session)| {
        let difference = session.difference.as_ref();
        [
            format!("{} {}", j + 1, session.instance),
            if session.resumed { "from a snapshot" } else { "anew" }.into(),
            format!("{:.1}", session.duration_s),
            session.samples.to_string(),
            session.ticks_same.to_string(),
            session.ticks_missing.to_string(),
            session.ticks_unchecked.to_string(),
            difference.map_or("none".into(), |d| format!("tick {}: {}", d.tick, d.field)),
        ]
    });
    outln!("{}", table(&header, header.len(), rows));
    if document.torn_bytes > 0 {
        outln!("{} bytes are torn: what a kill or a failed write left of a frame", document.torn_bytes);
    }
}
