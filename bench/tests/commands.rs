//! The commands of `bench` as a user runs them.

use crate::programs::{BENCH, bench, document, run_and_leave_nothing, shared_memory_of};
use rustix::process::Signal;
use std::path::PathBuf;
use std::time::Duration;
use testkit::{PATIENCE, Process, TestDomain};

// One test: two demos at once would take each other's cores.
#[test]
fn the_demo_prints_one_document_and_leaves_nothing_behind() {
    let out = tempfile::tempdir().unwrap();
    let out_text = out.path().to_str().unwrap();
    for scenario in ["rigid-body", "translation"] {
        let arguments = ["demo", "--scenario", scenario, "--duration", "4", "--json", "--out", out_text];
        let document: serde_json::Value =
            serde_json::from_str(&run_and_leave_nothing(&arguments).ok()).unwrap();
        assert_eq!(document["scenario"], scenario);
        assert_eq!(document["samples_sent"], 800);
        assert_eq!(
            document["samples_used"].as_u64().unwrap() + document["samples_lost"].as_u64().unwrap(),
            800
        );
        for key in ["velocity_rms_m_s", "force_rms_n"] {
            let with = document[key].as_f64().unwrap();
            let without = document[format!("{key}_without_adaptation")].as_f64().unwrap();
            assert!(with < without, "{key}: {with} with, {without} without adaptation");
        }
        for key in ["duration_s", "rate_hz", "deadline_misses", "position_rms_m"] {
            assert!(document[key].is_number(), "{key}");
        }
        for key in ["step_ns", "wake_up_lateness_ns", "source_to_estimate_ns"] {
            for quantile in ["count", "p50", "p90", "p99", "p999", "max"] {
                assert!(document[key][quantile].is_u64(), "{key}.{quantile}");
            }
        }
        if scenario == "translation" {
            assert!(document["torque_rms_n_m"].is_null() && document["torque_rms_n_m_reason"].is_string());
        }
        let plot = out.path().join(format!("{scenario}-truth-and-estimate.svg"));
        assert!(std::fs::metadata(plot).unwrap().len() > 10_000);
    }

    // Ctrl-C in the middle.
    let demo = Process::spawn(BENCH.command(&["demo", "--duration", "60", "--out", out_text]));
    let pid = demo.pid();
    std::thread::sleep(Duration::from_secs(3));
    assert!(!shared_memory_of(pid).is_empty(), "it runs");
    demo.signal(Signal::INT);
    demo.finish().ok();
    assert_eq!(shared_memory_of(pid), Vec::<PathBuf>::new());
}

#[test]
fn wrong_usage_and_failure_have_exit_codes_of_their_own() {
    let code = |arguments: &[&str]| bench(arguments).code;
    assert_eq!(code(&["demo", "--scenario", "boat"]), Some(2));
    assert_eq!(code(&["demo", "--rate-hz", "0"]), Some(2));
    assert_eq!(code(&["replay", "--format", "acsl", "/nowhere.log"]), Some(1));
    assert_eq!(code(&["--help"]), Some(0));
}

/// The keys that scripts rely on, and a reason beside every figure that was not measured.
#[test]
fn the_document_of_the_step_has_its_keys() {
    let small = ["step", "--centers", "8,27", "--samples", "100", "--literal-up-to", "8"];
    let document = document(&[&small[..], &["--json"]].concat());
    assert!(document["machine"].is_object());
    let rows = document["rows"].as_array().unwrap();
    for (row, n_centers) in rows.iter().zip([8, 27]) {
        assert!(row["solver"] == "dense" && row["n_centers"] == n_centers && row["samples"] == 100);
        for key in ["median_ns", "p99_ns", "p999_ns", "max_ns", "bytes"] {
            assert!(row[key].as_u64().unwrap() > 0, "{key}");
        }
        assert_eq!(
            row["quantiles_ns"].as_array().unwrap().len(),
            document["quantiles"].as_array().unwrap().len()
        );
        assert!(row["kalman_ratio"].is_number());
        assert_eq!(row["literal_ratio"].is_number(), n_centers == 8);
        assert_eq!(row["literal_ratio_reason"].is_string(), n_centers == 27);
    }
}

fn recorded_flight() -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/acsl");
    let found = std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let found = found.filter(|path| path.extension().is_some_and(|e| e == "log")).min();
    if found.is_none() {
        testkit::skip("the recorded flight", &format!("no .log in {}", folder.display()));
    }
    found
}

/// The prototype's figures on this flight: 0.069 m/s for the next sample, 0.169 m/s after a coast of 0.5 s.
#[test]
fn the_recorded_flight_is_predicted_as_well_as_by_the_prototype() {
    let Some(file) = recorded_flight() else { return };
    let document = document(&["replay", "--format", "acsl", file.to_str().unwrap(), "--json"]);
    let row = |estimator: &str| {
        let rows = document["rows"].as_array().unwrap();
        let row = rows.iter().find(|row| row["estimator"] == estimator).unwrap();
        [row["one_step_rms_m_s"].as_f64().unwrap(), row["coast_rms_m_s"].as_f64().unwrap()]
    };
    let [one_step, coast] = row("observer");
    assert!(one_step <= 0.069 && coast <= 0.169, "{one_step} {coast}");
    let [_, coast_without] = row("observer-without-adaptation");
    assert!(coast < coast_without / 2.0, "{coast} with, {coast_without} without adaptation");
    assert!(row("kalman").iter().all(|error| error.is_finite()));
}

/// The lab's flight as live samples through a live service.
#[test]
fn the_recorded_flight_plays_through_the_service() {
    let Some(file) = recorded_flight() else { return };
    let domain = TestDomain::new();
    let config = tempfile::NamedTempFile::new().unwrap();
    let preset = daemon::config::PRESETS.iter().find(|(name, _)| *name == "acsl-x8").unwrap().1;
    std::fs::write(config.path(), format!("clock = \"samples\"\n{preset}")).unwrap();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--config", config.path().to_str().unwrap()]);
    let client = domain.client();
    let arguments =
        ["sim_publisher", "replay", "--format", "acsl", "--airborne-only", "--speed", "4", "--json"];
    let replay = BENCH.start(&domain, &[&arguments, [file.to_str().unwrap()].as_slice()].concat());
    let sent: serde_json::Value = serde_json::from_str(&replay.finish_within(2 * PATIENCE).ok()).unwrap();
    std::thread::sleep(Duration::from_millis(100));
    let reply = client.command(shared_types::payload::command::STATUS, PATIENCE).unwrap();
    assert_eq!(reply.status.counters.samples_accepted, sent["samples_published"].as_u64().unwrap());
    assert_eq!(reply.status.counters.samples_rejected_total(), 0);
    let estimate = client.latest_estimate().unwrap().peek().unwrap();
    drop(client);
    daemon.stop().ok();
    if let Some(estimate) = estimate {
        assert!(estimate.velocity_m_s.iter().all(|v| v.is_finite()));
    }
}
