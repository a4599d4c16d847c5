//! A flight record replays to the same bits: with dropouts, commands, a kill and a restart in it.

mod common;

use common::{Role, TestDomain, bench, text};
use rustix::process::Signal;
use shared_types::Client;
use shared_types::payload::command;
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(10);

fn check(record: &Path) -> (Option<i32>, serde_json::Value, String) {
    let checked = bench(&["replay", "--check", record.to_str().unwrap(), "--json"]).output().unwrap();
    let document = serde_json::from_slice(&checked.stdout).unwrap_or_default();
    (checked.status.code(), document, text(&checked.stderr).into())
}

#[test]
fn a_minute_with_dropouts_and_a_restart_replays_to_the_bit() {
    let domain = TestDomain::new();
    let files = tempfile::tempdir().unwrap();
    let record = files.path().join("flight.rec");
    let arguments = ["daemon", "run", "--preset", "rigid-body", "--record", record.to_str().unwrap()];
    let daemon = Role::start(&domain, &arguments);
    let client = Client::connect(&domain.domain, "vehicle", PATIENCE).unwrap();
    let faults =
        ["--dropout-probability", "0.02", "--outage", "8:1.5", "--jitter-us", "300", "--duration", "60"];
    let vehicle = [&["sim_publisher", "run", "--scenario", "rigid-body"], faults.as_slice()].concat();
    let vehicle = Role::start(&domain, &vehicle);
    let start = Instant::now();
    let until = |s: f64| std::thread::sleep(Duration::from_secs_f64(s).saturating_sub(start.elapsed()));
    until(15.0);
    client.command(command::FREEZE, PATIENCE).unwrap();
    until(16.0);
    client.command(command::THAW, PATIENCE).unwrap();
    until(30.0);
    daemon.kill();
    let daemon = Role::start(&domain, &arguments);
    until(45.0);
    client.command(command::RESET, PATIENCE).unwrap();
    until(50.0);
    client.command(command::SAVE, PATIENCE).unwrap();
    assert!(vehicle.finish(Duration::from_secs(40)).status.success());
    let status = client.command(command::STATUS, PATIENCE).unwrap().status;
    assert!(status.ticks_recorded > 4000 && status.counters.ticks_not_recorded == 0, "{status:?}");
    drop(client);
    let daemon = daemon.stop();
    assert!(daemon.status.success(), "{}", text(&daemon.stderr));

    let (code, document, log) = check(&record);
    println!("{document:#}");
    assert_eq!(code, Some(0), "{log}");
    assert_eq!(document["same"], true);
    let sessions = document["sessions"].as_array().unwrap();
    assert_eq!(sessions.len(), 2);
    assert_eq!([&sessions[0]["resumed"], &sessions[1]["resumed"]], [false, true]);
    for session in sessions {
        assert_eq!((&session["ticks_missing"], &session["ticks_unchecked"]), (&0.into(), &0.into()));
        assert!(
            session["ticks_same"].as_u64().unwrap() > 4000 && session["samples"].as_u64().unwrap() > 4000
        );
    }

    // A bit of one sample changed, sums and all, is found, and where.
    let mut reader = daemon::record::Reader::open(&record).unwrap();
    while reader.next_frame().unwrap().is_some() {}
    let bytes = std::fs::read(&record).unwrap();
    let changed = files.path().join("changed.rec");
    std::fs::write(&changed, with_one_bit_changed(&bytes)).unwrap();
    let (code, document, log) = check(&changed);
    assert_eq!(code, Some(1), "{log}");
    assert_eq!(document["same"], false);
    let difference = &document["sessions"][0]["difference"];
    assert!(difference["tick"].as_u64().unwrap() > 1000 && log.contains("differs"), "{difference} {log}");
}

/// Flips the last bit of a measured velocity some thousand frames into a record, with the frame's checksum.
fn with_one_bit_changed(bytes: &[u8]) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    let mut place = 16;
    let mut samples = 0;
    loop {
        let length = u32::from_le_bytes(changed[place..place + 4].try_into().unwrap()) as usize;
        let frame = &mut changed[place + 8..place + 8 + length];
        if let Ok(daemon::record::Frame::Entry(entry)) = postcard::from_bytes(frame)
            && let daemon::record::Entry::Sample { source, mut measurement } = *entry
        {
            samples += 1;
            if samples == 2000 {
                measurement.velocity_m_s[0] = f64::from_bits(measurement.velocity_m_s[0].to_bits() ^ 1);
                let entry = daemon::record::Entry::Sample { source, measurement };
                let new = postcard::to_allocvec(&daemon::record::Frame::Entry(Box::new(entry))).unwrap();
                frame.copy_from_slice(&new);
                let sum = crc32fast::hash(&new);
                changed[place + 4..place + 8].copy_from_slice(&sum.to_le_bytes());
                return changed;
            }
        }
        place += 8 + length;
    }
}

/// A pipe that nobody empties stands for a disk that is too slow: the loop goes on, and what is left out is counted.
#[test]
fn a_slow_disk_costs_ticks_of_the_record_and_none_of_the_loop() {
    let domain = TestDomain::new();
    let files = tempfile::tempdir().unwrap();
    let record = files.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&record).status().unwrap();
    assert!(made.success());
    // Opened for reading and writing, so that nobody waits for the other end.
    let mut pipe = std::fs::File::options().read(true).write(true).open(&record).unwrap();
    let rate = ["--rate-hz", "1000", "--record", record.to_str().unwrap()];
    let daemon = Role::start(&domain, &[&["daemon", "run", "--preset", "rigid-body"], &rate[..]].concat());
    let client = Client::connect(&domain.domain, "vehicle", PATIENCE).unwrap();
    let status = || client.command(command::STATUS, PATIENCE).unwrap().status;
    let deadline = Instant::now() + Duration::from_secs(60);
    while status().counters.ticks_not_recorded < 500 {
        assert!(Instant::now() < deadline, "{:?}", status());
        std::thread::sleep(Duration::from_millis(100));
    }
    let before = status();
    std::thread::sleep(Duration::from_secs(1));
    let after = status();
    assert!(
        after.counters.ticks - before.counters.ticks > 500,
        "the loop goes on: {} {}",
        before.counters.ticks,
        after.counters.ticks
    );
    // Once it is emptied the record goes on, with the gap marked.
    let file = files.path().join("copy");
    let mut copy = std::fs::File::create(&file).unwrap();
    let copier = std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        loop {
            let got = pipe.read(&mut buffer).unwrap();
            std::io::Write::write_all(&mut copy, &buffer[..got]).unwrap();
            // The writer's end of the test, below.
            if buffer[..got].ends_with(b"the end") {
                return;
            }
        }
    });
    std::thread::sleep(Duration::from_secs(2));
    daemon.signal(Signal::TERM);
    let daemon = daemon.finish(PATIENCE);
    assert!(daemon.status.success(), "{}", text(&daemon.stderr));
    assert!(text(&daemon.stderr).contains("the disk is too slow"), "{}", text(&daemon.stderr));
    std::fs::write(&record, b"the end").unwrap();
    copier.join().unwrap();
    let (code, document, log) = check(&file);
    assert_eq!(code, Some(0), "{log}");
    let session = &document["sessions"][0];
    assert!(session["ticks_same"].as_u64().unwrap() > 500, "{session}");
    assert!(session["ticks_missing"].as_u64().unwrap() > 500, "{session}");
    assert!(session["ticks_unchecked"].as_u64().unwrap() > 100, "{session}");
    drop(client);
}

#[test]
fn what_is_no_record_is_refused() {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), "time,velocity\n1,2\n").unwrap();
    let (code, _, log) = check(file.path());
    assert!(code == Some(1) && log.contains("no flight record"), "{log}");
}

/// A file that is something else is not appended to, and a pipe without a reader is not waited for.
#[test]
fn only_a_record_is_appended_to() {
    let domain = TestDomain::new();
    let files = tempfile::tempdir().unwrap();
    let other = files.path().join("vehicle.toml");
    std::fs::write(&other, "rate_hz = 200.0\n").unwrap();
    let pipe = files.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for (path, reason) in [(&other, "no flight record"), (&pipe, "No such device")] {
        let daemon = Role::start(&domain, &["daemon", "run", "--record", path.to_str().unwrap()]);
        let ended = daemon.finish(PATIENCE);
        assert_eq!(ended.status.code(), Some(1));
        assert!(text(&ended.stderr).contains(reason), "{}", text(&ended.stderr));
    }
    assert_eq!(std::fs::read(&other).unwrap(), b"rate_hz = 200.0\n");
}
