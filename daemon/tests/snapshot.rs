//! Snapshots: what was learned is written completely, resumed to the bit, and refused if its design is another one.

use crate::common::{
    Ended, PATIENCE, Process, TestDomain, daemon_command, preset_between, run_daemon, wait_until,
};
use daemon::ServiceFiles;
use daemon::assemble;
use daemon::config::ConfigFile;
use daemon::engine::{Checkpoint, Engine};
use daemon::snapshot::{Snapshot, VERSION};
use rustix::process::Signal;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{command, outcome, restored};
use shared_types::{Client, Measurement};
use std::path::PathBuf;
use std::time::Duration;

const PERIOD_NS: u64 = 5_000_000;

fn varied(sequence: u64, stamp_ns: u64) -> Measurement {
    let t = sequence as f64 * 0.005;
    let mut sample = Measurement::at(stamp_ns, sequence)
        .with_velocity_m_s([1.5 * t.sin(), (1.3 * t).cos(), 0.3 * (0.7 * t).sin()])
        .with_angular_velocity_rad_s([0.1 * t.cos(), 0.2 * t.sin(), 0.05])
        .with_force_n([0.0, (0.9 * t).sin(), -19.62])
        .with_output(&[(0.8 * t).sin()])
        .with_input(&[t.cos()]);
    if sequence.is_multiple_of(40) {
        sample = sample.with_position_m([t, 0.5 * t, 0.0]).with_attitude_wxyz([1.0, 0.0, 0.0, 0.0]);
    }
    sample
}

/// A tick 2 ms after each sample; every seventh sample is lost, every fiftieth is a spike.
fn tick(engine: &mut Engine, sequence: u64) -> String {
    let stamp_ns = 1_000_000_000_000 + sequence * PERIOD_NS;
    engine.begin(stamp_ns + 2_000_000, 0);
    let sample = varied(sequence, stamp_ns);
    match sequence {
        _ if sequence.is_multiple_of(7) => {}
        _ if sequence.is_multiple_of(50) => engine.take(&sample.with_velocity_m_s([30.0, 0.0, 0.0]), 1),
        _ => engine.take(&sample, 1),
    }
    let estimate = engine.conclude();
    // Counted from each service's own start.
    format!("{:?}", shared_types::Estimate { sequence: 0, ..estimate })
}

fn local_preset() -> ConfigFile {
    let (_, text) = daemon::config::PRESETS.iter().find(|(name, _)| *name == "rigid-body-gradient").unwrap();
    let text = text.replace("[rotation]", "solver = \"local\"\n[rotation]");
    ConfigFile::parse("local".into(), text).unwrap()
}

/// Saved and resumed, a state and what was learned continue in another engine with the same bits; what was learned
/// alone, or the state alone, does not.
#[test]
fn another_engine_goes_on_to_the_bit() {
    let presets = ["rigid-body", "auv", "linear", "paper-translation", "rigid-body-gradient"]
        .map(|name| ConfigFile::preset(name).unwrap());
    for file in presets.into_iter().chain([local_preset()]) {
        let mut engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
        (0..600).for_each(|sequence| drop(tick(&mut engine, sequence)));
        engine.save();
        let mut learned = vec![0.0; engine.n_learned()];
        learned.chunks_mut(100).enumerate().for_each(|(j, part)| engine.read_saved(100 * j, part));
        assert!(learned.iter().any(|number| *number != 0.0), "{}", file.name());
        let snapshot = Snapshot {
            program_version: String::new(),
            instance: "vehicle".into(),
            made_unix_s: 0,
            boot_id: String::new(),
            stamp_ns: 0,
            samples_accepted: 600,
            meaning: daemon::snapshot::meaning(&file.config),
            checkpoint: Checkpoint { learned, state: engine.saved_state() },
        };
        let kept = Snapshot::decode(&snapshot.encode()).unwrap().checkpoint;
        let nothing = Checkpoint { learned: vec![0.0; kept.learned.len()], ..kept.clone() };
        let without_state = Checkpoint { state: None, ..kept.clone() };
        for (kept, same) in [(kept, true), (nothing, false), (without_state, false)] {
            let mut other = Engine::new(&file.config, assemble::estimator(&file).unwrap());
            other.load(&kept).unwrap();
            let mut original = engine.clone();
            let is_same = (600..900).all(|j| tick(&mut original, j) == tick(&mut other, j));
            assert_eq!(is_same, same, "{}", file.name());
        }
    }
}

/// A file of any length but the whole, and with any byte changed, is noticed.
#[test]
fn a_damaged_snapshot_is_never_taken_for_a_whole_one() {
    let file = ConfigFile::preset("rigid-body").unwrap();
    let engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
    let snapshot = Snapshot {
        program_version: "1".into(),
        instance: "vehicle".into(),
        made_unix_s: 1,
        boot_id: "b".into(),
        stamp_ns: 2,
        samples_accepted: 3,
        meaning: vec![("a".into(), "b".into())],
        checkpoint: Checkpoint { learned: vec![1.0; 5], state: engine.saved_state() },
    };
    let bytes = snapshot.encode();
    assert_eq!(Snapshot::decode(&bytes).unwrap(), snapshot);
    (0..bytes.len()).for_each(|length| assert!(Snapshot::decode(&bytes[..length]).is_err(), "{length}"));
    for place in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1;
        assert!(Snapshot::decode(&damaged).is_err(), "{place}");
    }
    assert!(Snapshot::decode(&[bytes.as_slice(), &[0]].concat()).is_err());
}

fn snapshot_path(domain: &TestDomain) -> PathBuf {
    ServiceFiles::snapshot_in(domain.state.path(), &domain.domain, "vehicle")
}

/// Flies on with samples numbered from `from`.
fn fly(client: &Client, from: u64, samples: u64) -> u64 {
    let sensors = client.measurement_publisher().unwrap();
    for sequence in from..from + samples {
        sensors.publish(&varied(sequence, monotonic_ns())).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    from + samples
}

fn norm(client: &Client) -> f64 {
    let mut latest = client.latest_estimate().unwrap();
    wait_until("an estimate", || latest.peek().unwrap().is_some());
    latest.peek().unwrap().unwrap().translation.native_norm
}

#[test]
fn a_restart_goes_on_with_what_was_learned_and_with_the_state() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    let client = domain.client();
    let flown = fly(&client, 0, 300);
    let learned = norm(&client);
    assert!(learned > 1.0, "{learned}");
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    assert!(snapshot_path(&domain).exists());

    let daemon = run_daemon(&domain, &[]);
    let client_again = domain.client();
    assert_eq!(domain.status().snapshot_restored, restored::LEARNED_AND_STATE);
    assert!((norm(&client_again) - learned).abs() < 0.1 * learned, "{}", norm(&client_again));
    let mut latest = client_again.latest_estimate().unwrap();
    wait_until("an estimate", || latest.peek().unwrap().is_some());
    // Dead reckoning continues from the saved position: x = 1.5 (1 − cos 1.5), and it has coasted since.
    let position_m = latest.peek().unwrap().unwrap().position_m;
    assert!(position_m.iter().any(|r| r.abs() > 0.5), "{position_m:?}");

    // `control save`, `snapshot show`, and what the status says.
    fly(&client_again, flown, 50);
    let before = std::fs::metadata(snapshot_path(&domain)).unwrap().modified().unwrap();
    let reply = client_again.command(command::SAVE, PATIENCE).unwrap();
    assert_eq!(reply.outcome, outcome::DONE, "{}", reply.text());
    assert!(reply.text().contains(".snapshot") && reply.status.snapshots_saved == 1, "{}", reply.text());
    assert!(std::fs::metadata(snapshot_path(&domain)).unwrap().modified().unwrap() > before);
    let path = snapshot_path(&domain);
    let show = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_daemon"));
        Ended::from(command.args(["snapshot", "show"]).args(arguments).output().unwrap())
    };
    let Ended { code, out, log } = show(&[path.to_str().unwrap()]);
    assert!(
        code == Some(0) && out.contains("velocity (m/s)") && out.contains("translation.mass_kg"),
        "{out}{log}"
    );
    let Ended { code, out, .. } = show(&[path.to_str().unwrap(), "--json"]);
    let document: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(code == Some(0) && document["checkpoint"]["learned"].as_array().unwrap().len() > 100, "{out}");
    assert_eq!(document["instance"], "vehicle");

    // After a kill the service resumes what was saved last.
    daemon.signal(Signal::KILL);
    daemon.finish();
    let daemon = run_daemon(&domain, &[]);
    domain.client();
    assert_eq!(domain.status().snapshot_restored, restored::LEARNED_AND_STATE);
    let Ended { log, .. } = daemon.stop();
    assert!(log.contains("goes on, state included"), "{log}");
    drop((latest, client, client_again));
}

#[test]
fn another_design_is_refused_by_name_and_fresh_begins_anew() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    fly(&domain.client(), 0, 100);
    assert_eq!(daemon.stop().code, Some(0));

    let heavier = tempfile::NamedTempFile::new().unwrap();
    let text = daemon::config::PRESETS[0].1.replace("mass_kg = 2.0", "mass_kg = 3.0");
    assert_ne!(text, daemon::config::PRESETS[0].1);
    std::fs::write(heavier.path(), text).unwrap();
    let arguments = ["--config", heavier.path().to_str().unwrap()];
    let Ended { code, log, .. } = run_daemon(&domain, &arguments).finish();
    assert_eq!(code, Some(2), "{log}");
    for needed in ["translation.mass_kg was 2.0 and is 3.0", "--fresh", ".snapshot"] {
        assert!(log.contains(needed), "{log}");
    }
    let daemon = run_daemon(&domain, &[&arguments[..], &["--fresh"]].concat());
    domain.client();
    assert_eq!(domain.status().snapshot_restored, restored::NOTHING);
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    let mut old = snapshot_path(&domain).into_os_string();
    old.push(".old");
    assert!(PathBuf::from(old).exists() && snapshot_path(&domain).exists());
    // Gains are no part of what was learned.
    let gains = tempfile::NamedTempFile::new().unwrap();
    let text =
        std::fs::read_to_string(heavier.path()).unwrap().replacen("gain_per_s = ", "gain_per_s = 1", 1);
    std::fs::write(gains.path(), text).unwrap();
    let daemon = run_daemon(&domain, &["--config", gains.path().to_str().unwrap()]);
    domain.client();
    assert_ne!(domain.status().snapshot_restored, restored::NOTHING);
    assert_eq!(daemon.stop().code, Some(0));
}

#[test]
fn a_damaged_file_is_set_aside_and_keeps_nothing_on_the_ground() {
    let domain = TestDomain::new();
    // A file of another version is not damaged: it is refused.
    std::fs::write(snapshot_path(&domain), b"obs-snap\x07\0\0\0and what only that one knows").unwrap();
    let Ended { code, log, .. } = run_daemon(&domain, &[]).finish();
    assert!(code == Some(2) && log.contains("version 7") && log.contains("--fresh"), "{log}");
    let damaged = [b"obs-snap", &VERSION.to_le_bytes()[..], b"sum and then something else"].concat();
    std::fs::write(snapshot_path(&domain), damaged).unwrap();
    let daemon = run_daemon(&domain, &[]);
    domain.client();
    assert_eq!(domain.status().snapshot_restored, restored::NOTHING);
    let Ended { code, log, .. } = daemon.stop();
    assert!(code == Some(0) && log.contains(".damaged"), "{log}");
    let Ended { code, log, .. } = Ended::from({
        let mut aside = snapshot_path(&domain).into_os_string();
        aside.push(".damaged");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_daemon"));
        command.args(["snapshot", "show"]).arg(aside).output().unwrap()
    });
    assert!(code == Some(2) && log.contains("no whole snapshot"), "{log}");
}

#[test]
fn a_snapshot_is_written_every_so_often_and_a_full_disk_is_counted() {
    let domain = TestDomain::new();
    let config = preset_between("", "[snapshot]\nsave_every_s = 0.2");
    let daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
    let client = domain.client();
    wait_until("three snapshots", || domain.status().snapshots_saved >= 3);
    assert!(domain.status().snapshot_stamp_ns > 0);
    // A directory in the file's place cannot be written over: as a full disk, the write fails, also for root.
    std::fs::remove_file(snapshot_path(&domain)).unwrap();
    std::fs::create_dir(snapshot_path(&domain)).unwrap();
    wait_until("failures", || domain.status().snapshots_failed >= 2);
    let reply = client.command(command::SAVE, PATIENCE).unwrap();
    assert!(
        reply.outcome == outcome::REFUSED && reply.text().contains("cannot be written"),
        "{}",
        reply.text()
    );
    drop(client);
    let Ended { code, log, .. } = daemon.stop();
    assert!(code == Some(0) && log.contains("cannot be written"), "{log}");
}

#[test]
fn without_a_directory_nothing_is_kept_and_that_is_said() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &["--state", "none"]);
    domain.client();
    let Ended { code, log, .. } = Ended::of(&mut daemon_command(&domain, &["control", "save"]));
    assert!(code == Some(1) && log.contains("--state DIR"), "{log}");
    let Ended { log, .. } = daemon.stop();
    assert!(log.contains("no snapshots"), "{log}");
    assert!(!snapshot_path(&domain).exists());
}

/// The service runs without the default directory, because it was not requested explicitly.
#[test]
fn a_default_directory_that_cannot_be_made_is_no_reason_to_stay_on_the_ground() {
    let domain = TestDomain::new();
    let file = tempfile::NamedTempFile::new().unwrap();
    let run = |configure: &dyn Fn(&mut std::process::Command)| {
        let mut command = daemon_command(&domain, &["run"]);
        configure(command.env_remove("OBSERVER_STATE"));
        Process::spawn(command)
    };
    let daemon = run(&|command| _ = command.env("STATE_DIRECTORY", file.path().join("below")));
    domain.client();
    let Ended { code, log, .. } = daemon.stop();
    assert!(code == Some(0) && log.contains("below") && log.contains("no snapshots"), "{log}");
    // What somebody asked for is not left out, and neither is a directory that others may write to.
    let Ended { code, log, .. } =
        run(&|command| _ = command.env("OBSERVER_STATE", file.path().join("below"))).finish();
    assert!(code == Some(1) && log.contains("below"), "{log}");
    let open = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    std::fs::set_permissions(domain.state.path(), open).unwrap();
    let Ended { code, log, .. } = run_daemon(&domain, &[]).finish();
    assert!(code == Some(1) && log.contains("chmod go-w"), "{log}");
}

/// A trap in the place of the unfinished file is not written through, and a pipe is not waited for.
#[test]
fn what_another_one_planted_does_no_harm() {
    let domain = TestDomain::new();
    let victim = tempfile::NamedTempFile::new().unwrap();
    let beside = |suffix: &str| {
        let mut name = snapshot_path(&domain).into_os_string();
        name.push(suffix);
        PathBuf::from(name)
    };
    std::os::unix::fs::symlink(victim.path(), beside(".new")).unwrap();
    let daemon = run_daemon(&domain, &[]);
    domain.client();
    let second = ServiceFiles { state: Some(domain.state.path().into()), ..ServiceFiles::default() };
    // Another container: its domain is another one of the same name.
    let error = daemon::snapshot::SnapshotLock::take(&ServiceFiles::snapshot_in(
        second.state.as_deref().unwrap(),
        &domain.domain,
        "vehicle",
    ))
    .unwrap_err();
    assert!(error.to_string().contains("another service's"), "{error}");
    assert_eq!(daemon.stop().code, Some(0));
    assert_eq!(std::fs::read(victim.path()).unwrap(), b"");
    assert!(snapshot_path(&domain).metadata().unwrap().is_file());
    std::fs::remove_file(snapshot_path(&domain)).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(snapshot_path(&domain)).status().unwrap().success());
    let Ended { code, log, .. } = run_daemon(&domain, &[]).finish();
    assert!(code == Some(1) && log.contains("not a regular file"), "{log}");
}

/// An operator's reset, and what the guard forgets, leave what was learned before on disk.
#[test]
fn what_is_forgotten_is_kept_beside() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    let client = domain.client();
    fly(&client, 0, 200);
    let file = ConfigFile::preset("rigid-body").unwrap();
    let mut fresh = Engine::new(&file.config, assemble::estimator(&file).unwrap());
    fresh.save();
    let mut nothing = vec![0.0; fresh.n_learned()];
    fresh.read_saved(0, &mut nothing);
    let learned = |path: PathBuf| Snapshot::read(&path).unwrap().checkpoint.learned != nothing;
    assert_eq!(client.command(command::SAVE, PATIENCE).unwrap().outcome, outcome::DONE);
    assert!(learned(snapshot_path(&domain)));
    assert_eq!(client.command(command::RESET, PATIENCE).unwrap().outcome, outcome::DONE);
    assert_eq!(client.command(command::SAVE, PATIENCE).unwrap().outcome, outcome::DONE);
    assert!(!learned(snapshot_path(&domain)));
    let mut old = snapshot_path(&domain).into_os_string();
    old.push(".old");
    assert!(learned(old.clone().into()));
    // The file is kept, however often later learning is forgotten, by this service and the next.
    let forget_again = |client: &Client| {
        assert_eq!(client.command(command::RESET, PATIENCE).unwrap().outcome, outcome::DONE);
        assert_eq!(client.command(command::SAVE, PATIENCE).unwrap().outcome, outcome::DONE);
    };
    forget_again(&client);
    assert!(learned(old.clone().into()));
    assert_eq!(daemon.stop().code, Some(0));
    let daemon = run_daemon(&domain, &["--fresh"]);
    forget_again(&domain.client());
    assert!(learned(old.into()));
    drop(client);
    assert_eq!(daemon.stop().code, Some(0));
}

/// A service whose standard error is closed falls back without a log line, and continues.
#[test]
fn a_closed_log_ends_nothing() {
    let domain = TestDomain::new();
    let config = preset_between("", "[input]\nmax_unknown_force_n = 2.0\nstuck = \"off\"");
    let mut daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
    drop(daemon.child.stderr.take());
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let still = |sequence| Measurement::at(monotonic_ns(), sequence).with_velocity_m_s([0.5, 0.0, 0.0]);
    for sequence in 0..300 {
        sensors.publish(&still(sequence)).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    wait_until("a fall", || domain.status().counters.state_resets > 0);
    std::thread::sleep(Duration::from_millis(500));
    assert!(daemon.child.try_wait().unwrap().is_none(), "it runs on");
}
