//! The Doppler log's bridge between a live daemon and a server that speaks the log's JSON over loopback. The server is our own; no
//! device was there.

use crate::programs::BENCH;
use shared_types::Measurement;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{command, status_bits};
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread;
use std::time::Duration;
use testkit::{Ended, PATIENCE, TestDomain, wait_until};

const LATENCY_US: u64 = 80_000;
const VELOCITY_M_S: [f64; 3] = [0.8, -0.1, 0.05];

/// What the log says.
const LOCKED: u8 = 0;
const UNLOCKED: u8 = 1;
const HUNG_UP: u8 = 2;
const ENDED: u8 = 3;

fn report(n: u64, has_lock: bool) -> String {
    let [vx, vy, vz] = if has_lock { VELOCITY_M_S } else { [0.0; 3] };
    let sent_us = 1_700_000_000_000_000 + n * 50_000;
    let read_us = sent_us - LATENCY_US;
    format!(
        "{{\"time\":50.0,\"vx\":{vx},\"vy\":{vy},\"vz\":{vz},\"fom\":0.003,\"covariance\":[[1e-4,0,0],[0,1e-4,0],\
         [0,0,1e-4]],\"altitude\":2.0,\"transducers\":[],\"velocity_valid\":{has_lock},\"status\":0,\
         \"format\":\"json_v3.1\",\"type\":\"velocity\",\"time_of_validity\":{read_us},\
         \"time_of_transmission\":{sent_us}}}\n{{\"ts\":{n},\"x\":1,\"y\":2,\"z\":3,\"type\":\"position_local\"}}\n"
    )
}

/// Serves one peer after the other, 20 reports a second, until it is told to end.
fn serve(listener: TcpListener, says: Arc<AtomicU8>) {
    let mut n = 0;
    listener.set_nonblocking(true).unwrap();
    let mut peer: Option<TcpStream> = None;
    while says.load(Ordering::Relaxed) != ENDED {
        let now = says.load(Ordering::Relaxed);
        if now == HUNG_UP {
            peer = None;
        } else if peer.is_none() {
            peer = listener.accept().ok().map(|(stream, _)| stream);
        }
        if let Some(stream) = &mut peer
            && stream.write_all(report(n, now == LOCKED).as_bytes()).is_err()
        {
            peer = None;
        }
        n += 1;
        thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_doppler_log_over_tcp_is_used_as_late_and_as_sure_as_it_says() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let config = directory.path().join("auv.toml");
    let preset = include_str!("../../daemon/presets/auv.toml");
    let sensor = "[[sensor]]\nname = \"dvl\"\nnumber = 1\nrate_hz = 20\nmounting_wxyz = [0, 0, 0, 1]\n";
    std::fs::write(&config, format!("{preset}\n{sensor}")).unwrap();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--config", config.to_str().unwrap(), "--fresh"]);
    let client = domain.client();

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp:{}", listener.local_addr().unwrap());
    let says = Arc::new(AtomicU8::new(LOCKED));
    let server = thread::spawn({
        let says = says.clone();
        move || serve(listener, says)
    });
    let record = directory.path().join("dive.jsonl");
    let arguments = ["sim_publisher", "dvl", "--connect", &address, "--sensor", "1", "--json", "--record"];
    let bridge = BENCH.start(&domain, &[&arguments[..], &[record.to_str().unwrap()]].concat());

    // Beside it, rates and attitude from this process: level, at rest.
    let publisher = client.measurement_publisher().unwrap();
    let mut sequence = 0;
    let mut fly_until = |what: &str, mut test: Box<dyn FnMut() -> bool + '_>| {
        wait_until(what, || {
            publisher
                .publish(
                    &Measurement::at(monotonic_ns(), sequence)
                        .with_angular_velocity_rad_s([0.0; 3])
                        .with_attitude_wxyz([1.0, 0.0, 0.0, 0.0]),
                )
                .unwrap();
            sequence += 1;
            thread::sleep(Duration::from_millis(10));
            test()
        });
    };
    let mut latest = client.latest_estimate().unwrap();
    // Half a turn about z between the log and the vehicle.
    let wanted = [-VELOCITY_M_S[0], -VELOCITY_M_S[1], VELOCITY_M_S[2]];
    let mut is_near = || {
        let Some(estimate) = latest.peek().unwrap() else { return false };
        let velocity = estimate.velocity_m_s;
        estimate.status & status_bits::COASTING_TRANSLATION == 0
            && (0..3).all(|axis| (velocity[axis] - wanted[axis]).abs() < 0.02)
    };
    fly_until("the velocity of the log", Box::new(&mut is_near));
    let log = || domain.status().sources().find(|source| source.sensor == 1);
    fly_until("a row of the log", Box::new(|| log().is_some_and(|log| log.accepted >= 40)));
    let row = log().unwrap();
    assert_eq!((row.lost, row.rejected), (0, 0), "{row:?}");
    assert!(row.late * 10 > row.accepted * 9, "nearly all are older than the newest rates: {row:?}");
    let (delay_ms, period_ms) = (row.delay_ns / 1_000_000, row.period_ns / 1_000_000);
    assert!((75..150).contains(&delay_ms) && (40..80).contains(&period_ms), "{row:?}");

    // Without bottom lock nothing comes: the velocity coasts, and zeros are no velocity.
    says.store(UNLOCKED, Ordering::Relaxed);
    let mut coasts = || {
        let Some(estimate) = latest.peek().unwrap() else { return false };
        estimate.status & status_bits::COASTING_TRANSLATION != 0 && estimate.velocity_m_s[0] < -0.4
    };
    fly_until("a coast", Box::new(&mut coasts));

    // The log restarts.
    says.store(HUNG_UP, Ordering::Relaxed);
    thread::sleep(Duration::from_millis(200));
    says.store(LOCKED, Ordering::Relaxed);
    let before = log().unwrap().accepted;
    fly_until("the log again", Box::new(|| log().is_some_and(|log| log.accepted > before + 10)));

    let Ended { code, out, log } = bridge.stop();
    assert_eq!(code, Some(0), "{log}");
    let counts: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&counts["connections"], &counts["unreadable_lines"]), (&2.into(), &0.into()), "{out}");
    assert!(
        counts["without_bottom_lock"].as_u64().unwrap() > 0 && counts["other_lines"].as_u64().unwrap() > 40
    );
    assert!(log.contains("bottom lock is lost") && log.contains("bottom lock is back"), "{log}");
    says.store(ENDED, Ordering::Relaxed);
    server.join().unwrap();

    // What was recorded plays again, at its own pace.
    let published = counts["samples_published"].as_u64().unwrap();
    let replay = ["sim_publisher", "dvl", "--replay", record.to_str().unwrap(), "--sensor", "1", "--json"];
    let replayed = BENCH.start(&domain, &replay).finish_within(2 * PATIENCE).ok();
    let replayed: serde_json::Value = serde_json::from_str(&replayed).unwrap();
    assert_eq!(replayed["samples_published"].as_u64().unwrap(), published);
    let status = client.command(command::STATUS, PATIENCE).unwrap().status;
    assert_eq!(status.counters.samples_rejected_total(), 0);

    drop((latest, publisher, client));
    daemon.stop().ok();
    domain.assert_clean();
}
