//! The service as a real process with real shared memory, under good and bad input.

use crate::common::{Ended, PATIENCE, TestDomain, daemon_command, preset_between, run_daemon, wait_until};
use iceoryx2::prelude::*;
use rustix::process::Signal;
use shared_types::client::Latest;
use shared_types::clock::{monotonic_ns, realtime_ns};
use shared_types::payload::{command, outcome, status_bits};
use shared_types::{Client, ClientError, Estimate, Measurement, service};
use std::time::Duration;

fn moving(sequence: u64) -> Measurement {
    let t = sequence as f64 * 0.005;
    Measurement::at(monotonic_ns(), sequence)
        .with_velocity_m_s([t.sin(), t.cos(), 0.5])
        .with_angular_velocity_rad_s([0.1, 0.2 * t.sin(), 0.0])
        .with_attitude_wxyz([1.0, 0.0, 0.0, 0.0])
        .with_force_n([0.0, 0.0, -19.62])
}

fn newest(latest: &mut Latest<Estimate>) -> Estimate {
    latest.peek().unwrap().unwrap_or_default()
}

fn period() {
    std::thread::sleep(Duration::from_millis(5));
}

#[test]
fn samples_go_in_and_estimates_come_out() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut estimates = client.estimate_subscriber().unwrap();
    let mut latest = client.latest_estimate().unwrap();
    let waiting = estimates.wait_next(PATIENCE).unwrap();
    assert_eq!(waiting.status & status_bits::WAITING, status_bits::WAITING);
    assert_eq!(waiting.status & status_bits::TRACKING, 0);

    let mut received: Vec<Estimate> = Vec::new();
    for sequence in 0..200 {
        sensors.publish(&moving(sequence)).unwrap();
        period();
        while let Some(estimate) = estimates.take().unwrap() {
            received.push(estimate);
        }
    }
    for pair in received.windows(2) {
        assert_eq!(pair[1].sequence, pair[0].sequence + 1, "every tick publishes once");
        assert!(pair[1].stamp_ns > pair[0].stamp_ns);
        assert!(pair[1].publish_stamp_ns >= pair[1].stamp_ns);
    }
    assert!(received.iter().all(Estimate::is_finite));
    let tracking = received.iter().filter(|e| e.status & status_bits::TRACKING != 0).count();
    assert!(tracking > received.len() / 2, "{tracking} of {}", received.len());
    let newest_one = newest(&mut latest);
    assert!(newest_one.sequence >= received.last().unwrap().sequence);
    assert!((newest_one.velocity_m_s[2] - 0.5).abs() < 0.2);

    wait_until("the status to count the samples", || domain.status().counters.samples_accepted == 200);
    let status = domain.status();
    assert_eq!((status.counters.samples_lost, status.counters.samples_rejected_total()), (0, 0));
    assert_eq!(status.source_pid, u64::from(std::process::id()));
    assert_eq!(status.other_source_pid, 0);
    assert_eq!(status.step_ns.count, status.counters.ticks);

    // The same on the status topic, waited for and at a glance.
    let next = client.status_subscriber().unwrap().wait_next(PATIENCE).unwrap();
    assert!(next.counters.ticks > 0 && next.rate_millihertz == 200_000);
    assert_eq!(next.dead_zone_width, [0.0; 3], "the joint law has none");
    let mut at_a_glance = client.latest_status().unwrap();
    wait_until("a newer status", || {
        at_a_glance.peek().unwrap().is_some_and(|newer| newer.sequence > next.sequence)
    });
    assert_eq!(at_a_glance.peek().unwrap().unwrap().counters.samples_accepted, 200);
    drop(at_a_glance);

    // Silence: first coasting, then stale; still finite, still published.
    wait_until("stale", || newest(&mut latest).status & status_bits::STALE != 0);
    let stale = newest(&mut latest);
    let both = status_bits::COASTING_TRANSLATION | status_bits::COASTING_ROTATION;
    assert_eq!(stale.status & status_bits::COASTING, both);
    assert_eq!(stale.status & status_bits::ADAPTING, 0);
    assert!(stale.is_finite());
    drop((sensors, estimates, latest, client));
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("200 used, 0 lost, 0 rejected"), "{log}");
    domain.assert_clean();
}

#[test]
fn a_killed_daemon_comes_back_and_the_stream_resumes_by_itself() {
    let domain = TestDomain::new();
    let mut daemon = run_daemon(&domain, &[]);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut estimates = client.estimate_subscriber().unwrap();
    let mut latest = client.latest_estimate().unwrap();
    let mut sequence = 0;
    for _ in 0..3 {
        let before_ns = monotonic_ns();
        let mut fresh = false;
        for _ in 0..1000 {
            sensors.publish(&moving(sequence)).unwrap();
            sequence += 1;
            period();
            while let Some(estimate) = estimates.take().unwrap() {
                fresh |= estimate.source_stamp_ns > before_ns && estimate.status & status_bits::TRACKING != 0;
            }
            if fresh && newest(&mut latest).source_stamp_ns > before_ns {
                break;
            }
        }
        assert!(fresh, "the same ports go on");
        assert!(newest(&mut latest).source_stamp_ns > before_ns, "and so does the newest at a glance");
        daemon.signal(Signal::KILL);
        daemon.finish();
        daemon = run_daemon(&domain, &[]);
    }
    drop((sensors, estimates, latest, client));
    domain.client();
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    domain.assert_clean();
}

#[test]
fn commands_are_carried_out_and_answered() {
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut latest = client.latest_estimate().unwrap();
    let mut sequence = 0;
    let mut feed = |n: u64| {
        for _ in 0..n {
            sensors.publish(&moving(sequence)).unwrap();
            sequence += 1;
            period();
        }
    };
    feed(100);
    assert!(newest(&mut latest).translation.native_norm > 0.0, "it learns gravity's error");
    let send = |kind| client.command(kind, PATIENCE).unwrap();
    let reply = send(command::FREEZE);
    assert_eq!((reply.outcome, reply.status.adaptation_frozen), (outcome::DONE, 1));
    feed(20);
    let frozen = newest(&mut latest);
    feed(50);
    assert_eq!(newest(&mut latest).translation.native_norm, frozen.translation.native_norm);
    assert_ne!(newest(&mut latest).status & status_bits::FROZEN, 0);
    assert_eq!(send(command::THAW).status.adaptation_frozen, 0);
    feed(50);
    assert_ne!(newest(&mut latest).translation.native_norm, frozen.translation.native_norm);
    assert_eq!(send(command::RESET).outcome, outcome::DONE);
    wait_until("the weights to be gone", || newest(&mut latest).translation.native_norm == 0.0);
    assert_eq!(send(command::SAVE).outcome, outcome::DONE);
    let unknown = send(99);
    assert!(unknown.outcome == outcome::UNKNOWN && unknown.text().contains("99"));

    let control = |arguments: &[&str]| Ended::of(&mut daemon_command(&domain, arguments));
    let Ended { code, out, .. } = control(&["control", "status"]);
    assert!(code == Some(0) && out.contains("wake-up lateness"), "{out}");
    let accepted = out.lines().find(|line| line.trim_start().starts_with("samples accepted"));
    assert!(accepted.is_some_and(|line| line.trim_end().ends_with(" 220")), "{out}");
    let Ended { out, .. } = control(&["control", "status", "--json"]);
    assert!(out.starts_with('{') && out.contains("\"samples_accepted\": 220"), "{out}");
    let Ended { code, out, .. } = control(&["control", "freeze"]);
    assert!(code == Some(0) && out.contains("frozen"), "{out}");
    let Ended { code, out, log } = control(&["control", "save"]);
    assert!(code == Some(0) && out.contains(".snapshot"), "{out}{log}");
}

/// Two publishers that stamp with other clocks.
#[test]
fn a_sensor_may_stamp_by_the_time_of_day_or_by_a_clock_of_its_own() {
    let domain = TestDomain::new();
    let sensors = "[[sensor]]\nname = \"imu\"\nnumber = 1\nclock = \"realtime\"\n\
                   [[sensor]]\nname = \"log\"\nnumber = 2\nclock = \"own\"";
    let config = preset_between("", sensors);
    let daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
    let (imu, log) = (domain.client(), domain.client());
    let (imu, log) = (imu.measurement_publisher().unwrap(), log.measurement_publisher().unwrap());
    let mut estimates = domain.client().estimate_subscriber().unwrap();
    let mut latest = domain.client().latest_estimate().unwrap();
    let start_ns = monotonic_ns();
    let mut contributed = 0;
    for sequence in 0..100 {
        let rates = Measurement::at(realtime_ns(), sequence).with_angular_velocity_rad_s([0.1, 0.2, 0.0]);
        imu.publish(&rates.of_sensor(1)).unwrap();
        let speed = Measurement::at(monotonic_ns() - start_ns, sequence).with_velocity_m_s([1.0, 0.0, 0.5]);
        log.publish(&speed.of_sensor(2)).unwrap();
        period();
        while let Some(estimate) = estimates.take().unwrap() {
            contributed |= estimate.sensors;
        }
    }
    wait_until("all to be taken", || domain.status().counters.samples_accepted == 200);
    assert_eq!(contributed, 0b110);
    let estimate = newest(&mut latest);
    assert!((estimate.velocity_m_s[0] - 1.0).abs() < 0.1, "{estimate:?}");
    assert!(estimate.source_stamp_ns.abs_diff(monotonic_ns()) < 1_000_000_000, "{estimate:?}");
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    let told: Vec<_> = log.lines().filter(|line| line.contains("CLOCK_MONOTONIC is its clock")).collect();
    assert!(told.len() >= 2 && told[0].contains("sensor imu (number 1)"), "{log}");
}

/// Stepping at once on every sample, in the samples' own time, ten times faster than the wall's.
#[test]
fn every_sample_has_its_estimate_where_samples_are_trigger_and_clock() {
    let domain = TestDomain::new();
    let config = preset_between("trigger = \"sample\"\nclock = \"samples\"", "");
    let _daemon = run_daemon(&domain, &["--config", config.path().to_str().unwrap()]);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut estimates = client.estimate_subscriber().unwrap();
    let start_ns = monotonic_ns();
    let mut answered = |sequence: u64| {
        let stamp_ns = start_ns + sequence * 5_000_000;
        sensors.publish(&Measurement { stamp_ns, ..moving(sequence) }).unwrap();
        loop {
            let estimate = estimates.wait_next(PATIENCE).unwrap();
            if estimate.source_stamp_ns == stamp_ns {
                assert_eq!((estimate.stamp_ns, estimate.source_sequence), (stamp_ns, sequence));
                return estimate;
            }
        }
    };
    for sequence in 0..200 {
        answered(sequence);
    }
    // Another replay, from the start of the same time: after the silence it is taken, learned weights are kept.
    std::thread::sleep(Duration::from_millis(250));
    let newest = (0..50).map(answered).last().unwrap();
    assert!(newest.translation.native_norm > 0.0);
    wait_until("all to be counted", || domain.status().counters.samples_accepted == 250);
}

/// The oldest estimates are dropped for a reader whose queue is full; the service and the other readers go on.
#[test]
fn a_reader_that_does_not_read_holds_nothing_up() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &["--rate-hz", "1000"]);
    let client = domain.client();
    let mut idle = client.estimate_subscriber().unwrap();
    let mut reading = client.estimate_subscriber().unwrap();
    let first = reading.wait_next(PATIENCE).unwrap().sequence;
    let mut newest = first;
    while newest < first + 2 * service::ESTIMATE_BUFFER as u64 {
        let next = reading.wait_next(PATIENCE).unwrap().sequence;
        assert!(next > newest, "{next} after {newest}");
        newest = next;
    }
    // A command is answered as well.
    assert!(domain.status().counters.ticks > newest - first);

    let mut kept = Vec::new();
    while let Some(estimate) = idle.take().unwrap() {
        kept.push(estimate.sequence);
    }
    assert!(kept.windows(2).all(|pair| pair[1] > pair[0]), "{kept:?}");
    assert!(kept.len() >= service::ESTIMATE_BUFFER, "{} kept", kept.len());
    assert!(kept[0] > first && *kept.last().unwrap() >= newest, "{first} … {newest}; kept {kept:?}");
    drop((idle, reading, client));
    daemon.stop().ok();
    domain.assert_clean();
}

#[test]
fn without_a_daemon_a_client_says_how_to_start_it() {
    let domain = TestDomain::new();
    let error = Client::connect(&domain.domain, "vehicle", Duration::from_millis(50)).unwrap_err();
    assert!(matches!(error, ClientError::NoDaemon { .. }));
    assert!(error.to_string().contains("daemon run --instance vehicle"), "{error}");
    let Ended { code, log, .. } = Ended::of(&mut daemon_command(&domain, &["control", "status"]));
    assert!(code == Some(1) && log.contains("daemon run"), "{log}");
}

#[test]
fn a_second_daemon_of_the_same_instance_is_told_who_runs() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    domain.client();
    let Ended { code, log, .. } = run_daemon(&domain, &[]).finish();
    assert_eq!(code, Some(1), "{log}");
    assert!(log.contains(&daemon.child.id().to_string()) && log.contains("--instance"), "{log}");
    let other = run_daemon(&domain, &["--instance", "second"]);
    Client::connect(&domain.domain, "second", PATIENCE).unwrap();
    assert_eq!(other.stop().code, Some(0));
    assert_eq!(daemon.stop().code, Some(0));
    domain.assert_clean();
}

/// Another version of the payload under the same service name.
#[repr(C)]
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("observer.Measurement.v999")]
struct OtherMeasurement {
    value: f64,
}

#[test]
fn a_service_of_another_type_or_quality_is_refused_with_the_reason() {
    for other_type in [true, false] {
        let domain = TestDomain::new();
        let node = {
            let _making = domain.domain.lock_for_making().unwrap();
            service::node(&domain.domain, "intruder").unwrap()
        };
        let name = "vehicle/measurement".try_into().unwrap();
        // Held by an intruder until the end of the test.
        let (_typed, _small);
        if other_type {
            let builder = node.service_builder(&name).publish_subscribe::<OtherMeasurement>();
            _typed = builder.create().unwrap();
        } else {
            let builder = node.service_builder(&name).publish_subscribe::<Measurement>();
            _small = builder.subscriber_max_buffer_size(2).create().unwrap();
        }
        let Ended { code, log, .. } = run_daemon(&domain, &[]).finish();
        assert_eq!(code, Some(1), "{log}");
        assert!(log.contains("vehicle/measurement"), "{log}");
        let reason = if other_type { "another version of the payload" } else { "other qualities of service" };
        assert!(log.contains(reason), "{log}");
    }
}

/// The client waits for a service that is started after it, and Ctrl-C ends the service as cleanly as SIGTERM.
#[test]
fn start_order_does_not_matter_and_ctrl_c_ends_it_cleanly() {
    let domain = TestDomain::new();
    let waiting = {
        let domain = domain.domain.clone();
        std::thread::spawn(move || Client::connect(&domain, "vehicle", PATIENCE).map(|_| ()))
    };
    std::thread::sleep(Duration::from_millis(300));
    let daemon = run_daemon(&domain, &[]);
    waiting.join().unwrap().unwrap();
    daemon.signal(Signal::INT);
    assert_eq!(daemon.finish().code, Some(0));
    domain.assert_clean();
}

#[test]
fn where_one_source_holds_the_stream_the_process_of_a_second_one_is_named() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let config = directory.path().join("first.toml");
    let text = format!("{}\n[input]\nsource = \"first\"\n", include_str!("../presets/rigid-body.toml"));
    std::fs::write(&config, text).unwrap();
    let _daemon = run_daemon(&domain, &["--config", config.to_str().unwrap()]);
    let (first, second) = (domain.client(), domain.client());
    let (a, b) = (first.measurement_publisher().unwrap(), second.measurement_publisher().unwrap());
    let mut sequence = 0;
    wait_until("the other source to be named", || {
        a.publish(&moving(sequence)).unwrap();
        period();
        b.publish(&Measurement { sequence: 500 + sequence, ..moving(sequence) }).unwrap();
        sequence += 1;
        domain.status().other_source_pid == u64::from(std::process::id())
    });
}

/// Two processes' worth of sensors: rates in time, and velocities that come 100 ms late.
#[test]
fn late_samples_of_a_second_source_are_used() {
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &[]);
    let (rates, velocities) = (domain.client(), domain.client());
    let (rates, velocities) =
        (rates.measurement_publisher().unwrap(), velocities.measurement_publisher().unwrap());
    let (mut waiting, mut sent) = (std::collections::VecDeque::new(), 0);
    for sequence in 0..300 {
        let now_ns = monotonic_ns();
        let rate = [0.1, 0.01 * (sequence as f64).sin(), 0.0];
        rates.publish(&Measurement::at(now_ns, sequence).with_angular_velocity_rad_s(rate)).unwrap();
        if sequence % 20 == 0 {
            waiting.push_back(now_ns);
        }
        if waiting.front().is_some_and(|stamp_ns| now_ns - stamp_ns > 100_000_000)
            && let Some(stamp_ns) = waiting.pop_front()
        {
            let velocity = [1.0 + 1e-3 * sequence as f64, 0.0, 0.5];
            velocities.publish(&Measurement::at(stamp_ns, sent).with_velocity_m_s(velocity)).unwrap();
            sent += 1;
        }
        period();
    }
    wait_until("all samples to be used", || {
        let counters = domain.status().counters;
        counters.samples_accepted + counters.samples_rejected.iter().sum::<u64>() >= 300 + sent
    });
    let counters = domain.status().counters;
    assert_eq!(counters.samples_rejected.iter().sum::<u64>(), 0, "{counters:?}");
    assert_eq!(counters.samples_lost, 0);
    assert_eq!(daemon.stop().code, Some(0));
}
