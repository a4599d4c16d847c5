//! `--json` and `--once` beside a real service.

use crate::programs::{MONITOR, monitor, service, vehicle};
use serde_json::Value;
use shared_types::clock::monotonic_ns;
use std::io::{BufRead, BufReader};
use testkit::{TestDomain, wait_until};

/// A minute and more of estimates.
const ENOUGH_LINES: usize = 20_000;

#[test]
fn each_estimate_is_a_line_across_a_killed_service() {
    let domain = TestDomain::new();
    // Before there is a service: it waits.
    let mut monitor = MONITOR.start(&domain, &["--json"]);
    let mut lines = BufReader::new(monitor.child.stdout.take().unwrap())
        .lines()
        .map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
    let daemon = service(&domain, "--preset rigid-body");
    let flight = vehicle(&domain, "");
    let is_tracking = |line: &Value| line["status_words"].as_array().unwrap().contains(&"tracking".into());
    let first = lines.by_ref().take(ENOUGH_LINES).find(is_tracking).unwrap();
    for (key, n) in [("velocity_m_s", 3), ("matched_force_n", 3), ("attitude_wxyz", 4), ("state", 12)] {
        assert_eq!(first[key].as_array().unwrap().len(), n, "{key}");
        assert!(first[key][0].is_number(), "{key}");
    }
    assert!(first["translation"]["power_function"].is_number());
    // None is left out while the reader keeps up, and each is there once.
    let next = lines.next().unwrap();
    assert!(next["sequence"].as_u64().unwrap() > first["sequence"].as_u64().unwrap());

    daemon.kill();
    let killed_ns = monotonic_ns();
    let _service = service(&domain, "--preset rigid-body");
    let stamp = |line: &Value| line["publish_stamp_ns"].as_u64().unwrap();
    let mut before = stamp(&next);
    let again = lines.by_ref().take(ENOUGH_LINES).find(|line| {
        assert!(stamp(line) > before, "an estimate comes twice");
        before = stamp(line);
        before > killed_ns && is_tracking(line)
    });
    assert!(again.is_some());
    drop(lines);
    // The reader of its output has ended: the monitor ends without an error.
    monitor.finish().ok();
    drop(flight);
}

#[test]
fn one_status_as_text_and_as_a_document_and_so_many_lines() {
    let domain = TestDomain::new();
    let daemon = service(&domain, "--preset linear");
    wait_until("the service", || domain.status().counters.ticks > 0);
    let text = monitor(&domain, &["--once"]).ok();
    for needed in ["vehicle", "DO NOT FLY ON THIS", "waiting: no sample yet", "LATENCY", "real time"] {
        assert!(text.contains(needed), "lacks '{needed}':\n{text}");
    }
    assert!(!text.contains('\u{1b}'), "no escape sequences");
    let document: Value = serde_json::from_str(&monitor(&domain, &["--once", "--json"]).ok()).unwrap();
    assert!(document["status"]["rate_millihertz"].is_u64(), "{document}");
    assert_eq!(document["estimate"]["status_words"][0], "stale");
    let lines = monitor(&domain, &["--json", "--count", "3"]).ok();
    assert_eq!(lines.lines().count(), 3);
    // What is infinite is null: no output was ever measured.
    let line: Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    assert!(line["linear"]["output_age_s"].is_null() && line["linear"]["output_error"].is_number(), "{line}");
    daemon.stop().ok();
    domain.assert_clean();
}

#[test]
fn wrong_usage_and_failure_have_exit_codes_of_their_own_and_nothing_is_left_behind() {
    let domain = TestDomain::new();
    for wrong in [
        &["--fps", "0"][..],
        &["--instance", "a/b"],
        &["--count", "3"],
        &["--once", "--json", "--count", "3"],
    ] {
        assert_eq!(monitor(&domain, wrong).code, Some(2), "{wrong:?}");
    }
    let no_terminal = monitor(&domain, &[]);
    assert!(no_terminal.code == Some(2) && no_terminal.log.contains("--once"), "{no_terminal:?}");
    let no_service = monitor(&domain, &["--once"]);
    assert!(
        no_service.code == Some(1) && no_service.log.contains("daemon run --instance vehicle"),
        "{no_service:?}"
    );
    domain.assert_clean();
}
