//! Samples of several sources that arrive late and in any order: one answer, and what it costs in accuracy.

use daemon::assemble;
use daemon::config::{Clock, Config, ConfigFile, ForceAxesName};
use daemon::engine::Engine;
use shared_types::payload::{Rejection, absent, status_bits};
use shared_types::{Estimate, Measurement};

const START_NS: u64 = 1_000_000_000_000;
const MS: u64 = 1_000_000;
const PERIOD_NS: u64 = 5 * MS;

fn engine_of(preset: &str, change: impl FnOnce(&mut Config)) -> Engine {
    let mut file = ConfigFile::preset(preset).unwrap();
    change(&mut file.config);
    Engine::new(&file.config, assemble::estimator(&file).unwrap())
}

/// Numbers of a fixed seed, 0 … 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, n: u64) -> u64 {
        (self.next() * n as f64) as u64
    }

    /// Of a normal law with the variance 1, nearly.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() - 6.0
    }
}

/// A sample that is on its way.
#[derive(Clone, Copy)]
struct Sent {
    arrival_ns: u64,
    source: u128,
    sample: Measurement,
}

/// Runs an engine at its ticks until `to_ns`, and returns the last estimate. `sent` is in the order of arrival.
fn run(engine: &mut Engine, now_ns: &mut u64, to_ns: u64, sent: &[Sent], saves: bool) -> Estimate {
    let mut sent = sent.iter().peekable();
    let mut estimate = Estimate::default();
    while *now_ns < to_ns {
        *now_ns += PERIOD_NS;
        engine.begin(*now_ns, 0);
        while let Some(sent) = sent.next_if(|sent| sent.arrival_ns <= *now_ns) {
            engine.take(&sent.sample, sent.source);
        }
        estimate = engine.conclude();
        if saves && engine.checkpoint_is_due() {
            engine.save();
        }
    }
    assert!(sent.peek().is_none());
    estimate
}

/// Samples of four sources within 0.3 s, some with equal stamps: rates and torque, velocity, depth, commanded force.
fn window(random: &mut Random, start_ns: u64, sequences: &mut [u64; 4]) -> Vec<Sent> {
    let mut sent = Vec::new();
    for step in 0..30 {
        let stamp_ns = start_ns + step * 10 * MS;
        let t_s = (stamp_ns - START_NS) as f64 / 1e9;
        for (source, every) in [(0, 1), (1, 6), (2, 4), (3, 3)] {
            if !(step + random.below(2)).is_multiple_of(every) {
                continue;
            }
            let noise = 0.01 * random.normal();
            let sample = Measurement::at(stamp_ns, sequences[source]);
            let sample = match source {
                0 => sample
                    .with_angular_velocity_rad_s([0.1 + noise, 0.3 * t_s.sin(), 0.1])
                    .with_attitude_wxyz([1.0, 0.0, 0.0, 0.0])
                    .with_specific_force_m_s2([noise, 0.1, -9.7])
                    .with_torque_n_m([0.0, 0.01 * t_s.cos(), 0.0]),
                1 if step % 2 == 0 => sample.with_velocity_m_s([t_s.sin() + noise, 0.2, -noise]),
                1 => Measurement {
                    absent: if step % 4 == 1 { absent::VELOCITY_Z } else { 0 },
                    ..sample.with_body_velocity_m_s([t_s.sin(), 0.2 + noise, noise]).of_sensor(1)
                },
                2 => sample.with_position_z_m(-3.0 + noise),
                _ if step % 2 == 0 => sample.with_body_force_n([t_s.cos(), noise, -19.62]),
                _ => sample.with_force_n([t_s.cos(), noise, -19.62]),
            };
            sequences[source] += 1;
            let late_ns = random.below(40) * PERIOD_NS;
            sent.push(Sent { arrival_ns: stamp_ns + late_ns, source: source as u128 + 1, sample });
        }
    }
    sent
}

/// An estimate without what tells of the order of arrival.
fn bits(estimate: &Estimate) -> Vec<u8> {
    let passing = status_bits::REJECTED_SAMPLE | status_bits::HELD_BACK;
    let status = estimate.status & !passing;
    postcard::to_allocvec(&Estimate { status, source_sequence: 0, sensors: 0, ..*estimate }).unwrap()
}

/// Windows of one stream, in the order of the stamps and as late as it happens: the same bits once all are there.
fn any_order_gives_the_same_bits(preset: &str, windows: u64, change: fn(&mut Config)) {
    let mut random = Random(7);
    let mut engines = [0, 1].map(|_| engine_of(preset, change));
    let mut now_ns = [START_NS; 2];
    let (mut sequences, mut n_sent) = ([0; 4], 0);
    for number in 0..windows {
        let start_ns = START_NS + number * 500 * MS;
        let mut sent = window(&mut random, start_ns + PERIOD_NS, &mut sequences);
        n_sent += sent.len() as u64;
        let end_ns = start_ns + 500 * MS;
        let mut in_order = sent.clone();
        in_order.iter_mut().for_each(|sent| sent.arrival_ns = sent.sample.stamp_ns);
        // A source that repeats itself is not used twice.
        if let Some(twice) = sent.get(random.below(20) as usize).copied() {
            sent.push(twice);
        }
        sent.sort_by_key(|sent| sent.arrival_ns);
        let expected = run(&mut engines[0], &mut now_ns[0], end_ns, &in_order, true);
        let late = run(&mut engines[1], &mut now_ns[1], end_ns, &sent, true);
        assert!(bits(&expected) == bits(&late), "window {number}: {expected:?} {late:?}");
    }
    let [in_order, late] = engines.map(|engine| *engine.counters());
    assert_eq!((in_order.samples_accepted, in_order.samples_lost), (n_sent, 0));
    assert_eq!((late.samples_accepted, late.samples_lost), (n_sent, 0));
    assert_eq!(late.samples_rejected[Rejection::RepeatedStamp as usize], windows);
    assert_eq!(late.samples_rejected.iter().sum::<u64>(), windows);
}

#[test]
fn in_any_order_of_arrival_the_joint_law_gives_the_same_bits() {
    any_order_gives_the_same_bits("rigid-body", 400, |_| ());
}

#[test]
fn in_any_order_of_arrival_the_gradient_law_gives_the_same_bits() {
    any_order_gives_the_same_bits("rigid-body-gradient", 400, |_| ());
}

/// A sensor off the center that is turned and late, an accelerometer, and what is learned along the body's axes.
#[test]
fn in_any_order_of_arrival_a_configured_sensor_gives_the_same_bits() {
    any_order_gives_the_same_bits("rigid-body", 400, |config| {
        let sensor = "name = \"dvl\"\nnumber = 1\nlever_arm_m = [0.5, 0.1, -0.2]\nmounting_wxyz = [0, 0, 0, 1]\n\
                      velocity_noise_m_s = 0.05\nlatency_s = 0.02\noutliers = \"reject\"";
        config.sensor.push(toml::from_str(sensor).unwrap());
        if let Some(translation) = &mut config.translation {
            translation.joint.specific_force_noise_m_s2 = 0.5;
            translation.force_axes = ForceAxesName::Body;
        }
    });
}

#[test]
fn what_is_older_than_the_window_is_too_late() {
    // Where samples are the clock, their stamps are compared with each other.
    let mut engine = engine_of("rigid-body", |config| config.clock = Clock::Samples);
    let at = |stamp_ns, sequence| Measurement::at(stamp_ns, sequence).with_velocity_m_s([1.0, 0.0, 0.0]);
    engine.begin(START_NS, 0);
    for (sequence, ms) in [(0, 1000), (1, 1005), (2, 506), (3, 504), (4, 1010)] {
        engine.take(&at(START_NS + ms * MS, sequence), 1);
    }
    let estimate = engine.conclude();
    assert_eq!(estimate.source_stamp_ns, START_NS + 1010 * MS);
    assert_eq!(engine.counters().samples_accepted, 4);
    assert_eq!(engine.counters().samples_rejected[Rejection::TooLate as usize], 1);
}

/// A Doppler log without bottom lock whose driver says that its zeros are valid: named at once and not used, and used again
/// when it says anything else.
#[test]
fn zeros_without_bottom_lock_are_not_believed() {
    let mut engine = engine_of("auv", |_| ());
    let mut now_ns = START_NS;
    let mut speed_after = |from: u64, to: u64, has_lock: bool| {
        let mut named_after_s = None;
        let mut estimate = Estimate::default();
        for j in from..to {
            now_ns += 10 * MS;
            let random = 0.01 * ((j * 7919 % 101) as f64 / 50.0 - 1.0);
            let sample = Measurement::at(now_ns, j)
                .with_angular_velocity_rad_s([random, 0.0, -random])
                .with_attitude_wxyz([1.0, 0.0, 0.0, 0.0])
                .with_force_n([0.0; 3]);
            let velocity = if has_lock { [1.0 + random, random, 0.0] } else { [0.0; 3] };
            engine.begin(now_ns, 0);
            engine.take(&if j % 20 == 0 { sample.with_body_velocity_m_s(velocity) } else { sample }, 1);
            estimate = engine.conclude();
            if estimate.status & status_bits::STUCK != 0 {
                named_after_s.get_or_insert((j - from) as f64 / 100.0);
            }
        }
        (estimate.velocity_m_s[0], named_after_s)
    };
    let (speed, _) = speed_after(0, 6000, true);
    assert!((speed - 1.0).abs() < 0.02, "{speed}");
    let (speed, named_after_s) = speed_after(6000, 9000, false);
    assert!((speed - 1.0).abs() < 0.2, "{speed}");
    assert!(named_after_s.is_some_and(|after_s| after_s < 1.0), "{named_after_s:?}");
    let (speed, _) = speed_after(9000, 9100, true);
    assert!((speed - 1.0).abs() < 0.02, "{speed}");
}

#[test]
#[ignore = "ten minutes: 100 000 windows"]
fn in_any_order_of_arrival_many_times() {
    any_order_gives_the_same_bits("rigid-body", 100_000, |_| ());
}
