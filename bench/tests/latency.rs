//! `bench ipc`, `service`, `jitter` and `load` as a user runs them, for a short time: the JSON documents are complete, and no
//! files are left behind. No test asserts a time.

use crate::programs::{BENCH, bench, run_and_leave_nothing, shared_memory_of};
use rustix::process::Signal;
use serde_json::Value;
use std::path::PathBuf;
use testkit::{Ended, Process, wait_until};

/// The document that a command prints; it leaves nothing behind.
fn document(arguments: &[&str]) -> Value {
    serde_json::from_str(&run_and_leave_nothing(&[arguments, &["--json"]].concat()).ok()).unwrap()
}

/// Quantiles in ascending order, or null with a reason.
fn assert_quantiles(object: &Value, key: &str) -> Option<u64> {
    let found = &object[key];
    if found.is_null() {
        assert!(object[format!("{key}_reason")].is_string(), "{key} of {object}");
        return None;
    }
    let values = ["p50", "p90", "p99", "p999", "max"].map(|quantile| found[quantile].as_u64().unwrap());
    assert!(values.is_sorted(), "{key}: {values:?}");
    found["count"].as_u64()
}

fn assert_machine(document: &Value) {
    let machine = &document["machine"];
    assert!(machine["cpu"].is_string() && machine["profile"].is_string(), "{machine}");
    assert!(machine["pinned_core"].is_u64() || machine["pinned_core_reason"].is_string(), "{machine}");
}

fn has_two_cores() -> bool {
    let two = std::thread::available_parallelism().is_ok_and(|cores| cores.get() > 1);
    if !two {
        testkit::skip(
            "bench ipc, service and load",
            "found one core, needed two: each side of an exchange polls",
        );
    }
    two
}

#[test]
fn round_trips_are_compared_and_nothing_stays() {
    if !has_two_cores() {
        return;
    }
    let found = document(&["ipc", "--samples", "120", "--batch", "50"]);
    assert_machine(&found);
    let counts = ["service_ns", "bare_ns"].map(|key| assert_quantiles(&found, key));
    assert_eq!(counts, [Some(120), Some(120)]);
    let median = |key: &str| found[key]["p50"].as_f64().unwrap();
    let ratio = median("service_ns") / median("bare_ns");
    // Reading a number from text may move its last bit.
    assert!((found["service_over_bare_median"].as_f64().unwrap() / ratio - 1.0).abs() < 1e-12);
    for way in ["service_one_way", "bare_one_way"] {
        for part in ["there_ns", "inside_ns", "back_ns"] {
            assert_eq!(assert_quantiles(&found[way], part), Some(120));
        }
    }
}

#[test]
fn a_round_trip_is_shown_as_a_table_too_and_wrong_options_are_refused() {
    if has_two_cores() {
        let table = bench(&["ipc", "--samples", "20", "--pause-us", "50"]).ok();
        assert!(table.contains("bare: round trip"), "{table}");
    }
    // A process may use the cores that the thread that starts it may use.
    let on_one_core = || {
        let mut one = rustix::thread::CpuSet::new();
        one.set(rustix::thread::sched_getcpu());
        rustix::thread::sched_setaffinity(None, &one).unwrap();
        for command in ["ipc", "service", "load"] {
            let refused = bench(&[command, "--json"]);
            assert_eq!((refused.code, refused.out.as_str()), (Some(1), ""), "{command}");
            assert!(
                refused.log.contains("found 1 core") && refused.log.contains("needed two"),
                "{}",
                refused.log
            );
        }
    };
    std::thread::scope(|scope| scope.spawn(on_one_core).join().unwrap());
    let code = |arguments: &[&str]| bench(arguments).code;
    assert_eq!(code(&["ipc", "--samples", "0"]), Some(2));
    assert_eq!(code(&["jitter", "--priority", "100"]), Some(2));
    assert_eq!(code(&["service", "--rates-hz", "0"]), Some(2));
    assert_eq!(code(&["load", "--readers", "31"]), Some(2));
    assert_eq!(code(&["echo"]), Some(1));
}

#[test]
fn every_trigger_and_rate_has_its_row_and_curve() {
    if !has_two_cores() {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let plot = directory.path().join("service.svg");
    let arguments =
        ["service", "--rates-hz", "200,1000", "--seconds", "0.2", "--plot", plot.to_str().unwrap()];
    let found = document(&arguments);
    assert_machine(&found);
    let rows = found["rows"].as_array().unwrap();
    let names: Vec<_> =
        rows.iter().map(|row| (row["trigger"].as_str().unwrap(), row["rate_hz"].as_f64().unwrap())).collect();
    let expected =
        [200.0, 1000.0].map(|rate| ["timer", "timer-spin", "sample"].map(|trigger| (trigger, rate)));
    assert_eq!(names, expected.concat());
    for row in rows {
        let count = assert_quantiles(row, "source_to_estimate_ns").unwrap_or(0);
        assert!(
            count + row["unanswered"].as_u64().unwrap() <= (0.2 * row["rate_hz"].as_f64().unwrap()) as u64
        );
    }
    assert!(std::fs::read_to_string(plot).unwrap().contains("share later"));
}

#[test]
fn lateness_has_a_row_for_each_mode_whatever_is_granted() {
    let found = document(&["jitter", "--rates-hz", "1000,2000", "--seconds", "0.05", "--slices", "2"]);
    assert_machine(&found);
    for granted in ["memory_locked", "cores_kept_awake"] {
        assert!(found[granted].is_string(), "{granted}");
    }
    let rows = found["rows"].as_array().unwrap();
    for rate_hz in [1000.0, 2000.0] {
        for mode in ["plain", "fifo", "fifo-spin", "cyclictest-fifo", "cyclictest-other"] {
            let row = rows.iter().find(|row| row["mode"] == mode && row["rate_hz"] == rate_hz).unwrap();
            let n_wakes = (0.05 * rate_hz) as u64;
            match assert_quantiles(row, "lateness_ns") {
                // cyclictest may print a wake-up less or more.
                Some(count) if mode.starts_with("cyclictest") => assert!(count > 0),
                Some(count) => assert_eq!(count, n_wakes, "{mode}"),
                None => assert_ne!(mode, "plain"),
            }
        }
    }
    assert_eq!(found["ratios"].as_array().unwrap().len(), 2);
}

#[test]
fn cyclictest_that_is_not_there_is_said_with_its_remedy() {
    let arguments = ["jitter", "--rates-hz", "1000", "--seconds", "0.05", "--slices", "1", "--json"];
    let ended = Ended::of(BENCH.command(&arguments).env("PATH", "/nowhere"));
    let found: Value = serde_json::from_str(&ended.ok()).unwrap();
    let row = |mode: &str| found["rows"].as_array().unwrap().iter().find(|row| row["mode"] == mode).unwrap();
    for mode in ["cyclictest-fifo", "cyclictest-other"] {
        assert!(row(mode)["lateness_ns"].is_null());
        assert!(row(mode)["lateness_ns_reason"].as_str().unwrap().contains("apt-get install rt-tests"));
    }
    assert!(row("plain")["lateness_ns"]["count"].is_u64());
    assert!(found["ratios"][0]["fifo_over_cyclictest_p50"].is_null());
}

// One test: two at once would take each other's cores.
#[test]
fn readers_and_vehicles_are_counted_and_nothing_stays_even_after_ctrl_c() {
    if !has_two_cores() {
        return;
    }
    let found = document(&["load", "--readers", "1,3", "--instances", "1,2", "--seconds", "0.3"]);
    assert_machine(&found);
    for (n, row) in [1, 3].iter().zip(found["readers"].as_array().unwrap()) {
        assert_eq!(row["readers"], *n);
        assert!(assert_quantiles(row, "step_ns") > Some(0) && row["shm_bytes"].as_u64() > Some(0));
    }
    for (n, row) in [1, 2].iter().zip(found["instances"].as_array().unwrap()) {
        assert_eq!(row["instances"], *n);
        assert!(assert_quantiles(row, "step_ns") > Some(0));
        assert!(assert_quantiles(row, "wake_up_lateness_ns") > Some(0));
        for key in ["ticks", "service_cpu_ns_per_tick", "service_private_kb", "shm_bytes"] {
            assert!(row[key].as_u64() > Some(0), "{key}: {row}");
        }
    }

    let arguments = ["load", "--readers", "1", "--instances", "2", "--seconds", "600", "--json"];
    let load = Process::spawn(BENCH.command(&arguments));
    let pid = load.pid();
    wait_until("its services", || shared_memory_of(pid).len() >= 5);
    load.signal(Signal::INT);
    load.finish().ok();
    assert_eq!(shared_memory_of(pid), Vec::<PathBuf>::new());
}
