//! Daemon, vehicle and reader as three processes: every sample is accounted for, and after any of them is killed and started
//! again, the others continue without help.

use crate::programs::BENCH;
use daemon::ServiceFiles;
use daemon::snapshot::Snapshot;
use shared_types::Client;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Estimate, Rejection, Status, command, restored, status_bits};
use std::time::{Duration, Instant};
use testkit::{PATIENCE, TestDomain};

fn status(client: &Client) -> Status {
    client.command(command::STATUS, PATIENCE).unwrap().status
}

/// A run of this length at 1 kHz, with a reader beside it.
fn is_accounted_for(duration_s: u64) {
    let domain = TestDomain::new();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--preset", "rigid-body", "--rate-hz", "1000"]);
    let client = domain.client();
    let mut estimates = client.estimate_subscriber().unwrap();
    let duration = duration_s.to_string();
    let arguments = ["sim_publisher", "run", "--scenario", "rigid-body", "--rate-hz", "1000", "--json"];
    let mut vehicle = BENCH.start(&domain, &[&arguments[..], &["--duration", &duration]].concat());
    let mut received = Vec::new();
    while !vehicle.has_ended() {
        received.extend(std::iter::from_fn(|| estimates.take().unwrap()));
        std::thread::sleep(Duration::from_millis(2));
    }
    let sent: serde_json::Value = serde_json::from_str(&vehicle.finish().ok()).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    let status = status(&client);
    drop((estimates, client));
    daemon.stop().ok();

    assert_eq!(sent["samples_published"], 1000 * duration_s);
    println!(
        "used {}, lost {}, rejected {}; {} ticks, {} missed",
        status.counters.samples_accepted,
        status.counters.samples_lost,
        status.counters.samples_rejected_total(),
        status.counters.ticks,
        status.counters.deadline_misses
    );
    // A loop that a busy machine kept from its processor for too long turns samples away; nothing else does.
    let turned_away =
        status.counters.rejected(Rejection::Overload) + status.counters.rejected(Rejection::TooOld);
    assert_eq!(status.counters.samples_rejected_total(), turned_away);
    // Every sequence number is used, turned away or counted as lost.
    assert_eq!(
        status.counters.samples_accepted + status.counters.samples_lost + turned_away,
        1000 * duration_s
    );
    assert!(received.iter().all(Estimate::is_finite));
    // This reader may be kept from its processor for longer than its queue lasts; then the gap shows.
    let all = received.last().unwrap().sequence - received[0].sequence + 1;
    assert!(10 * received.len() as u64 > 9 * all, "{} of {all} estimates read", received.len());
    assert!(received.windows(2).all(|pair| pair[1].sequence > pair[0].sequence));
    assert!(received.iter().any(|estimate| estimate.status & status_bits::TRACKING != 0));
    assert!(received.len() as u64 > 500 * duration_s, "{}", received.len());
}

#[test]
fn every_sample_at_one_kilohertz_is_accounted_for() {
    is_accounted_for(5);
}

#[test]
#[ignore = "takes a minute; run: cargo test -p bench three_processes -- --ignored"]
fn a_minute_at_one_kilohertz_is_accounted_for() {
    is_accounted_for(60);
}

/// Waits until an estimate holds a sample that was stamped after now.
fn assert_resumes(client: &Client, what: &str) -> Duration {
    let start = Instant::now();
    let now_ns = monotonic_ns();
    let mut latest = client.latest_estimate().unwrap();
    loop {
        let estimate = latest.peek().unwrap().unwrap_or_default();
        if estimate.source_stamp_ns > now_ns {
            assert!(estimate.is_finite());
            return start.elapsed();
        }
        assert!(start.elapsed() < PATIENCE, "after {what}: the stream does not resume");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Kills daemon and vehicle in turn, at instants from within their start-up to steady running.
fn kill_at_any_time(kills: u64) {
    let domain = TestDomain::new();
    // So often that many a kill falls into the writing of one.
    let config = tempfile::NamedTempFile::new().unwrap();
    let preset = daemon::config::PRESETS[0].1;
    std::fs::write(config.path(), format!("{preset}\n[snapshot]\nsave_every_s = 0.02\n")).unwrap();
    let arguments = ["daemon", "run", "--config", config.path().to_str().unwrap()];
    let start_daemon = || BENCH.start(&domain, &arguments);
    let snapshot = ServiceFiles::snapshot_in(domain.state.path(), &domain.domain, "vehicle");
    let mut snapshots = 0;
    let start_vehicle = || BENCH.start(&domain, &["sim_publisher", "run", "--scenario", "rigid-body"]);
    let (mut daemon, mut vehicle) = (start_daemon(), start_vehicle());
    let client = domain.client();
    assert_resumes(&client, "the first start");
    let mut slowest = Duration::ZERO;
    for kill in 0..kills {
        // Twice within the start of a process, where half-made files are left, then once while it runs.
        let during_start_us = [kill * 7919 % 12_000, kill * 104_729 % 40_000];
        if kill % 2 == 0 {
            daemon.kill();
            for after_us in during_start_us {
                let short_lived = start_daemon();
                std::thread::sleep(Duration::from_micros(after_us));
                short_lived.kill();
            }
            daemon = start_daemon();
        } else {
            vehicle.kill();
            for after_us in during_start_us {
                let short_lived = start_vehicle();
                std::thread::sleep(Duration::from_micros(after_us));
                short_lived.kill();
            }
            vehicle = start_vehicle();
        }
        if snapshot.exists() {
            Snapshot::read(&snapshot).unwrap();
            snapshots += 1;
        }
        slowest = slowest
            .max(assert_resumes(&client, if kill % 2 == 0 { "the daemon's death" } else { "the vehicle's" }));
    }
    println!(
        "{kills} × 3 kills; the slowest return took {:.2} s; {snapshots} snapshots read, all whole",
        slowest.as_secs_f64()
    );
    assert!(10 * snapshots > 9 * (kills - 1), "{snapshots}");
    let files = std::fs::read_dir(domain.state.path()).unwrap();
    let damaged =
        files.filter(|file| file.as_ref().unwrap().path().extension().is_some_and(|e| e == "damaged"));
    assert_eq!(damaged.count(), 0);
    assert_ne!(status(&client).snapshot_restored, restored::NOTHING);
    drop(client);
    vehicle.stop().ok();
    daemon.stop().ok();
    assert_eq!(domain.domain.segments().unwrap(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_process_that_is_killed_comes_back() {
    kill_at_any_time(17);
}

#[test]
#[ignore = "takes minutes; run: cargo test -p bench three_processes -- --ignored"]
fn processes_that_are_killed_a_thousand_times_come_back() {
    kill_at_any_time(334);
}

/// A process for each sensor: rates, a Doppler log 150 ms late, depth, a USBL a second late.
#[test]
fn every_sample_of_every_sensor_s_process_is_accounted_for() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let config = directory.path().join("auv.toml");
    let preset = include_str!("../../daemon/presets/auv.toml").replace("[input]", "[input]\nmax_age_s = 1.5");
    std::fs::write(&config, preset).unwrap();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--config", config.to_str().unwrap(), "--fresh"]);
    let client = domain.client();
    let run =
        ["sim_publisher", "run", "--sensors", "auv-survey", "--processes", "--duration", "11", "--json"];
    let vehicle = BENCH.start(&domain, &run);
    let sent: serde_json::Value = serde_json::from_str(&vehicle.finish_within(2 * PATIENCE).ok()).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    let status = status(&client);
    let mut rows: Vec<_> = status.sources().collect();
    rows.sort_by_key(|row| std::cmp::Reverse(row.accepted + row.rejected + row.lost));
    println!("{sent} {rows:#?}");
    let all = |row: &shared_types::payload::SourceStatus| row.accepted + row.lost + row.rejected;
    assert_eq!(rows.iter().map(all).collect::<Vec<_>>(), [1100, 110, 55, 3]);
    assert_eq!(sent["samples_published"], 1268);
    // A loop that a busy machine kept from its processor turns samples away; nothing else does.
    let turned_away =
        status.counters.rejected(Rejection::Overload) + status.counters.rejected(Rejection::TooOld);
    assert_eq!(status.counters.samples_rejected_total(), turned_away);
    // They have ended by now.
    assert!(rows.iter().all(|row| row.pid == 0));
    let ms = |ns: u64| ns / 1_000_000;
    assert!((150..220).contains(&ms(rows[2].delay_ns)) && rows[2].sensor == 1, "{:?}", rows[2]);
    assert!((1000..1100).contains(&ms(rows[3].delay_ns)), "{:?}", rows[3]);
    drop(client);
    daemon.stop().ok();
    domain.assert_clean();
}
