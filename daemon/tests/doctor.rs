//! `daemon doctor` as text and as JSON: it measures, names remedies, and changes nothing.

use crate::common::{Ended, TestDomain, Unprivileged, daemon_command, run_daemon};
use rustix::process::Signal;
use serde_json::Value;
use std::process::Command;

const QUICK: [&str; 3] = ["doctor", "--seconds", "0.05"];

fn document(mut command: Command) -> Value {
    let Ended { code, out: text, log } = Ended::from(command.arg("--json").output().unwrap());
    assert_eq!(code, Some(0), "{log}");
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn fact<'a>(document: &'a Value, name: &str) -> &'a Value {
    let facts = document["facts"].as_array().unwrap();
    facts.iter().find(|fact| fact["name"] == name).unwrap_or_else(|| panic!("no '{name}' in {document:#}"))
}

fn row<'a>(document: &'a Value, mode: &str) -> &'a Value {
    document["lateness"].as_array().unwrap().iter().find(|row| row["mode"] == mode).unwrap()
}

#[test]
fn it_measures_lateness_and_gives_every_fact_a_verdict() {
    let domain = TestDomain::new();
    let found = document(daemon_command(&domain, &QUICK));
    for mode in ["ordinary", "punctual-timers", "ordinary-spin"] {
        let lateness = &row(&found, mode)["lateness_ns"];
        // 0.05 s at 1 kHz, in four turns.
        assert_eq!(lateness["count"], 52, "{mode}");
        assert!(lateness["p50"].as_u64() <= lateness["p99"].as_u64(), "{lateness}");
        assert!(lateness["p99"].as_u64() <= lateness["max"].as_u64(), "{lateness}");
    }
    for mode in ["fifo", "awake-cores", "locked-memory", "everything", "everything-spin"] {
        let row = row(&found, mode);
        assert_ne!(row["lateness_ns"].is_null(), row["lateness_ns_reason"].is_null(), "{row}");
    }
    let facts = found["facts"].as_array().unwrap();
    assert!(facts.len() >= 17, "{found:#}");
    for fact in facts {
        let verdict = fact["verdict"].as_str().unwrap();
        assert!(["good", "could-be-better", "bad", "unknown"].contains(&verdict), "{fact}");
        assert_eq!(["could-be-better", "bad"].contains(&verdict), fact["remedy"].is_string(), "{fact}");
    }
    assert_eq!(fact(&found, "shared memory, write test")["verdict"], "good");
    assert_eq!(fact(&found, "stale files")["verdict"], "good");
    assert_eq!(fact(&found, "vector unit")["found"], observer::vector_unit());
    // It only looked.
    domain.assert_clean();

    let Ended { code, out: text, .. } = Ended::of(&mut daemon_command(&domain, &QUICK));
    assert_eq!(code, Some(0));
    for part in ["ordinary thread", "spin 200 µs", "p99", "stale files: none", "scheduling right", " good, "]
    {
        assert!(text.contains(part), "'{part}' is missing in:\n{text}");
    }
}

#[test]
fn a_configuration_gives_the_rate_and_its_settings_are_tried_out() {
    let domain = TestDomain::new();
    let config = crate::common::preset_between("spin_us = 50.0", "[real_time]\ncores = [0]\npriority = 7");
    let config = config.path().to_str().unwrap();
    if daemon::system::real_time::allowed_cores().contains(&0) {
        let found = document(daemon_command(&domain, &[&QUICK[..], &["--config", config]].concat()));
        assert_eq!(found["rate_hz"], 200.0);
        assert_eq!(found["spin_us"], 50.0);
        assert_eq!(found["priority"], 7);
        let settings = fact(&found, "settings of the configuration");
        assert!(settings["found"].as_str().unwrap().contains("cores"), "{settings}");
    }
    let Ended { code, log, .. } = Ended::from(
        daemon_command(&domain, &[&QUICK[..], &["--config", "/nowhere.toml"]].concat()).output().unwrap(),
    );
    assert!(code == Some(2) && log.contains("/nowhere.toml"), "{log}");
}

#[test]
fn it_needs_no_rights() {
    let nobody = Unprivileged::new();
    let found = document(nobody.command(&QUICK));
    assert_eq!(row(&found, "ordinary")["lateness_ns"]["count"], 52);
    if rustix::process::geteuid().is_root() {
        for (mode, reason) in [("fifo", "Operation not permitted"), ("everything", "needed: root")] {
            let row = row(&found, mode);
            assert!(row["lateness_ns"].is_null(), "{row}");
            assert!(row["lateness_ns_reason"].as_str().unwrap().contains(reason), "{row}");
        }
        let right = fact(&found, "scheduling right");
        assert_eq!(right["verdict"], "could-be-better");
        assert!(right["remedy"].as_str().unwrap().contains("LimitRTPRIO"), "{right}");
    }
    nobody.domain.assert_clean();
}

#[test]
fn what_a_killed_service_left_is_found_and_the_command_it_names_removes_it() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    domain.client();
    let living = document(daemon_command(&domain, &QUICK));
    assert_eq!(fact(&living, "stale files")["verdict"], "good", "{living:#}");
    let pid = daemon.child.id();
    daemon.signal(Signal::KILL);
    daemon.finish();

    let found = document(daemon_command(&domain, &QUICK));
    let stale = fact(&found, "stale files");
    assert_eq!(stale["verdict"], "could-be-better", "{stale}");
    let words = stale["found"].as_str().unwrap();
    assert!(words.contains(&format!("({pid})")) && words.contains("1 dead services' claims"), "{words}");
    let remedy = stale["remedy"].as_str().unwrap();
    let (command, _) = remedy.split_once(" removes ").unwrap();
    let arguments: Vec<_> = command.split(' ').collect();
    assert_eq!(arguments[0], "daemon");
    Command::new(env!("CARGO_BIN_EXE_daemon")).args(&arguments[1..]).output().unwrap();
    let found = document(daemon_command(&domain, &QUICK));
    assert_eq!(fact(&found, "stale files")["verdict"], "good", "{found:#}");
    domain.assert_clean();
}

#[test]
fn it_tells_whether_snapshots_can_be_written() {
    let domain = TestDomain::new();
    let verdict = |domain: &TestDomain| {
        let found = document(daemon_command(domain, &QUICK));
        let fact = fact(&found, "snapshots");
        (fact["verdict"].as_str().unwrap().to_owned(), fact["found"].as_str().unwrap().to_owned())
    };
    let (good, found) = verdict(&domain);
    assert!(good == "good" && found.contains("synced in"), "{good}: {found}");
    assert_eq!(std::fs::read_dir(domain.state.path()).unwrap().count(), 0, "nothing is left");
    let open = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    std::fs::set_permissions(domain.state.path(), open).unwrap();
    let (bad, found) = verdict(&domain);
    assert!(bad == "bad" && found.contains("others may write"), "{bad}: {found}");
}
