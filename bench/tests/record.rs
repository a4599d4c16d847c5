//! A flight record with dropouts, commands, a kill and a restart replays to the same bits.

use crate::programs::{BENCH, bench};
use shared_types::payload::command;
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};
use testkit::{PATIENCE, TestDomain, wait_until};

fn check(record: &Path) -> (Option<i32>, serde_json::Value, String) {
    let checked = bench(&["replay", "--check", record.to_str().unwrap(), "--json"]);
    (checked.code, serde_json::from_str(&checked.out).unwrap_or_default(), checked.log)
}

#[test]
fn a_flight_with_dropouts_and_a_restart_replays_to_the_bit() {
    replays_to_the_bit(12.0);
}

#[test]
#[ignore = "takes a minute; run: cargo test -p bench record -- --ignored"]
fn a_minute_with_dropouts_and_a_restart_replays_to_the_bit() {
    replays_to_the_bit(60.0);
}

/// A flight of this length: faults from the start, commands, and half-way the service is killed and started again.
fn replays_to_the_bit(length_s: f64) {
    let domain = TestDomain::new();
    let files = tempfile::tempdir().unwrap();
    let record = files.path().join("flight.rec");
    let arguments = ["daemon", "run", "--preset", "rigid-body", "--record", record.to_str().unwrap()];
    let daemon = BENCH.start(&domain, &arguments);
    let client = domain.client();
    let (duration, outage) = (length_s.to_string(), format!("{}:0.7", 0.1 * length_s));
    let vehicle = ["sim_publisher", "run", "--scenario", "rigid-body", "--duration", &duration];
    let faults = ["--dropout-probability", "0.02", "--jitter-us", "300", "--outage", &outage];
    let vehicle = BENCH.start(&domain, &[&vehicle[..], &faults].concat());
    let start = Instant::now();
    let until = |part: f64| {
        std::thread::sleep(Duration::from_secs_f64(part * length_s).saturating_sub(start.elapsed()));
    };
    until(0.25);
    client.command(command::FREEZE, PATIENCE).unwrap();
    until(0.3);
    client.command(command::THAW, PATIENCE).unwrap();
    until(0.5);
    daemon.kill();
    let daemon = BENCH.start(&domain, &arguments);
    until(0.75);
    client.command(command::RESET, PATIENCE).unwrap();
    until(0.85);
    client.command(command::SAVE, PATIENCE).unwrap();
    vehicle.finish_within(2 * PATIENCE).ok();
    // Of each session at 200 Hz, with what starting up takes.
    let least_ticks = (0.35 * length_s * 200.0) as u64;
    let status = client.command(command::STATUS, PATIENCE).unwrap().status;
    assert!(status.ticks_recorded > least_ticks && status.counters.ticks_not_recorded == 0, "{status:?}");
    drop(client);
    daemon.stop().ok();

    let (code, document, log) = check(&record);
    println!("{document:#}");
    assert_eq!(code, Some(0), "{log}");
    assert_eq!(document["same"], true);
    let sessions = document["sessions"].as_array().unwrap();
    assert_eq!(sessions.len(), 2);
    assert_eq!([&sessions[0]["resumed"], &sessions[1]["resumed"]], [false, true]);
    for session in sessions {
        assert_eq!((&session["ticks_missing"], &session["ticks_unchecked"]), (&0.into(), &0.into()));
        assert!(session["ticks_same"].as_u64().unwrap() > least_ticks, "{session}");
        assert!(session["samples"].as_u64().unwrap() > least_ticks, "{session}");
    }

    // A bit of one sample changed, sums and all, is found, and where.
    let mut reader = flight_record::Reader::open(&record).unwrap();
    while reader.next_frame().unwrap().is_some() {}
    let bytes = std::fs::read(&record).unwrap();
    let changed = files.path().join("changed.rec");
    std::fs::write(&changed, with_one_bit_changed(&bytes)).unwrap();
    let (code, document, log) = check(&changed);
    assert_eq!(code, Some(1), "{log}");
    assert_eq!(document["same"], false);
    let difference = &document["sessions"][0]["difference"];
    assert!(difference["tick"].as_u64().unwrap() > 400 && log.contains("differs"), "{difference} {log}");
}

/// Flips a bit of the 500th measured velocity of a record, with the frame's checksum: not the last bit, which may be
/// rounded away in the estimate.
fn with_one_bit_changed(bytes: &[u8]) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    let mut place = 16;
    let mut samples = 0;
    loop {
        let length = u32::from_le_bytes(changed[place..place + 4].try_into().unwrap()) as usize;
        let frame = &mut changed[place + 8..place + 8 + length];
        if let Ok(flight_record::Frame::Entry(entry)) = postcard::from_bytes(frame)
            && let flight_record::Entry::Sample { source, mut measurement } = *entry
        {
            samples += 1;
            if samples == 500 {
                measurement.velocity_m_s[0] =
                    f64::from_bits(measurement.velocity_m_s[0].to_bits() ^ (1 << 20));
                let entry = flight_record::Entry::Sample { source, measurement };
                let new = postcard::to_allocvec(&flight_record::Frame::Entry(Box::new(entry))).unwrap();
                frame.copy_from_slice(&new);
                let sum = crc32fast::hash(&new);
                changed[place + 4..place + 8].copy_from_slice(&sum.to_le_bytes());
                return changed;
            }
        }
        place += 8 + length;
    }
}

/// A pipe that is not read represents a slow disk: the loop continues, and the ticks that are left out are counted.
#[test]
fn a_slow_disk_costs_ticks_of_the_record_and_none_of_the_loop() {
    let domain = TestDomain::new();
    let files = tempfile::tempdir().unwrap();
    let record = files.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&record).status().unwrap();
    assert!(made.success());
    // Opened for reading and writing: neither end waits for the other.
    let mut pipe = std::fs::File::options().read(true).write(true).open(&record).unwrap();
    let rate = ["--rate-hz", "1000", "--record", record.to_str().unwrap()];
    let daemon = BENCH.start(&domain, &[&["daemon", "run", "--preset", "rigid-body"], &rate[..]].concat());
    let client = domain.client();
    let status = || client.command(command::STATUS, PATIENCE).unwrap().status;
    wait_until("ticks that are left out", || status().counters.ticks_not_recorded >= 500);
    let before = status();
    std::thread::sleep(Duration::from_secs(1));
    let after = status();
    assert!(
        after.counters.ticks - before.counters.ticks > 500,
        "the loop goes on: {} {}",
        before.counters.ticks,
        after.counters.ticks
    );
    // After the pipe is emptied the record continues, with the gap marked.
    let file = files.path().join("copy");
    let mut copy = std::fs::File::create(&file).unwrap();
    let copier = std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        loop {
            let got = pipe.read(&mut buffer).unwrap();
            std::io::Write::write_all(&mut copy, &buffer[..got]).unwrap();
            // What the test writes at the end, below.
            if buffer[..got].ends_with(b"the end") {
                return;
            }
        }
    });
    std::thread::sleep(Duration::from_secs(2));
    let daemon = daemon.stop();
    assert!(daemon.code == Some(0) && daemon.log.contains("the disk is too slow"), "{daemon:?}");
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

/// A file of another kind is not appended to, and a pipe without a reader is not waited for.
#[test]
fn only_a_record_is_appended_to() {
    let domain = TestDomain::new();
    let files = tempfile::tempdir().unwrap();
    let other = files.path().join("vehicle.toml");
    std::fs::write(&other, "rate_hz = 200.0\n").unwrap();
    let pipe = files.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let older = files.path().join("older.rec");
    std::fs::write(&older, b"\xff\xff\xff\xffflight-rec1\nand what only that version knows").unwrap();
    for (path, code, reason) in [
        (&other, 1, "no flight record"),
        (&pipe, 1, "No such device"),
        (&older, 2, "has version 1, this program appends to version 7; needed: another --record FILE"),
    ] {
        let ended = BENCH.start(&domain, &["daemon", "run", "--record", path.to_str().unwrap()]).finish();
        assert!(ended.code == Some(code) && ended.log.contains(reason), "{ended:?}");
        assert!(ended.log.matches("needed").count() <= 1, "{ended:?}");
    }
    // Nor is it read: with its name, and one remedy.
    let older = older.to_str().unwrap();
    for arguments in [vec!["replay", older], vec!["replay", "--check", older], vec!["tune", older]] {
        let ended = bench(&arguments);
        assert!(ended.code != Some(0) && ended.log.contains("a flight record of version 1"), "{ended:?}");
        assert!(ended.log.contains(older) && ended.log.matches("needed").count() == 1, "{ended:?}");
    }
    assert_eq!(std::fs::read(&other).unwrap(), b"rate_hz = 200.0\n");
}
