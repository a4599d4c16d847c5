//! `--json` and `--once` beside a real service.

mod common;

use common::{Role, TestDomain, finished, monitor, play_role, wait_until};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::clock::monotonic_ns;
use shared_types::service::ESTIMATE_BUFFER;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

#[test]
fn role() {
    play_role();
}

/// A minute and more of estimates.
const ENOUGH_LINES: usize = 20_000;

#[test]
fn each_estimate_is_a_line_across_a_killed_service() {
    let domain = TestDomain::new();
    // Before there is a service: it waits.
    let mut monitor =
        monitor(&domain, &["--json"]).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut lines = BufReader::new(monitor.stdout.take().unwrap())
        .lines()
        .map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
    let service = Role::start(&domain, "daemon run --preset rigid-body");
    let vehicle = Role::start(&domain, "sim_publisher run --scenario rigid-body");
    let is_tracking = |line: &Value| line["status_words"].as_array().unwrap().contains(&"tracking".into());
    let first = lines.by_ref().take(ENOUGH_LINES).find(is_tracking).unwrap();
    for (key, n) in [("velocity_m_s", 3), ("matched_force_n", 3), ("attitude_wxyz", 4), ("state", 12)] {
        assert_eq!(first[key].as_array().unwrap().len(), n, "{key}");
        assert!(first[key][0].is_number(), "{key}");
    }
    assert!(first["translation"]["error_bound"].as_f64().unwrap() > 0.0);
    // None is left out while the reader keeps up, and each is there once.
    let next = lines.next().unwrap();
    assert!(next["sequence"].as_u64().unwrap() > first["sequence"].as_u64().unwrap());

    service.kill();
    let killed_ns = monotonic_ns();
    let _service = Role::start(&domain, "daemon run --preset rigid-body");
    let stamp = |line: &Value| line["publish_stamp_ns"].as_u64().unwrap();
    let mut before = stamp(&next);
    let again = lines.by_ref().take(ENOUGH_LINES).find(|line| {
        assert!(stamp(line) > before, "an estimate comes twice");
        before = stamp(line);
        before > killed_ns && is_tracking(line)
    });
    assert!(again.is_some());
    drop(lines);
    // Its reader is gone: that is the end, and no failure.
    assert_eq!(monitor.wait().unwrap().code(), Some(0));
    drop(vehicle);
}

#[test]
fn a_stopped_monitor_holds_nobody_up_and_goes_on() {
    let domain = TestDomain::new();
    let service = Role::start(&domain, "daemon run --preset rigid-body");
    wait_until("the service", || domain.status().counters.ticks > 0);
    let command = monitor(&domain, &["--json"]).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let mut monitor = Role(command.unwrap());
    let mut sequences = BufReader::new(monitor.0.stdout.take().unwrap())
        .lines()
        .map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap()["sequence"].as_u64().unwrap());
    let first = sequences.next().unwrap();
    monitor.signal(Signal::STOP);
    // Twice as many as wait for a slow reader.
    let enough = first + 2 * ESTIMATE_BUFFER as u64;
    wait_until("more ticks than are kept for a reader", || domain.status().counters.ticks > enough);
    monitor.signal(Signal::CONT);
    // It is up to date again, and what was not kept for it is left out.
    let taken = sequences.take_while(|&sequence| sequence <= enough).count() as u64;
    assert!(taken < enough - first, "{taken} of {}", enough - first);
    monitor.signal(Signal::TERM);
    assert!(monitor.0.wait().unwrap().success());
    service.stop();
    domain.assert_clean();
}

#[test]
fn one_status_as_text_and_as_a_document_and_so_many_lines() {
    let domain = TestDomain::new();
    let service = Role::start(&domain, "daemon run --preset linear");
    wait_until("the service", || domain.status().counters.ticks > 0);
    let (code, text, log) = finished(monitor(&domain, &["--once"]).output().unwrap());
    assert_eq!((code, log.as_str()), (Some(0), ""));
    for needed in ["vehicle", "DO NOT FLY ON THIS", "waiting: no sample yet", "LATENCY", "real time"] {
        assert!(text.contains(needed), "lacks '{needed}':\n{text}");
    }
    assert!(!text.contains('\u{1b}'), "no escape sequences");
    let (code, document, _) = finished(monitor(&domain, &["--once", "--json"]).output().unwrap());
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!((code, document["status"]["rate_millihertz"].is_u64()), (Some(0), true));
    assert_eq!(document["estimate"]["status_words"][0], "stale");
    let (code, lines, _) = finished(monitor(&domain, &["--json", "--count", "3"]).output().unwrap());
    assert_eq!((code, lines.lines().count()), (Some(0), 3));
    // What is infinite is null: no output was ever measured.
    let line: Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    assert!(line["linear"]["output_age_s"].is_null() && line["linear"]["output_error"].is_number(), "{line}");
    service.stop();
    domain.assert_clean();
}

#[test]
fn wrong_usage_is_told_from_failure_and_nothing_is_left_behind() {
    let domain = TestDomain::new();
    let run = |arguments: &[&str]| finished(monitor(&domain, arguments).output().unwrap());
    for wrong in [
        &["--fps", "0"][..],
        &["--instance", "a/b"],
        &["--count", "3"],
        &["--once", "--json", "--count", "3"],
    ] {
        assert_eq!(run(wrong).0, Some(2), "{wrong:?}");
    }
    let (code, _, log) = run(&[]);
    assert_eq!(code, Some(2));
    assert!(log.contains("--once"), "{log}");
    let (code, _, log) = run(&["--once"]);
    assert_eq!(code, Some(1));
    assert!(log.contains("daemon run --instance vehicle"), "{log}");
    domain.assert_clean();
}
