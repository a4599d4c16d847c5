//! The engine, called as the loop calls it, with the test's own clock: the effect of good and bad samples on estimates and counts.

use daemon::assemble;
use daemon::config::{Config, ConfigFile, SensorConfig, SourcePolicy};
use daemon::engine::Engine;
use shared_types::payload::{Rejection, status_bits, valid};
use shared_types::{Estimate, Measurement};

const PERIOD_NS: u64 = 5_000_000;

struct Loop {
    engine: Engine,
    now_ns: u64,
}

impl Loop {
    fn new(preset: &str, change: impl FnOnce(&mut Config)) -> Self {
        let mut file = ConfigFile::preset(preset).unwrap();
        change(&mut file.config);
        let engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
        Self { engine, now_ns: 1_000_000_000_000 }
    }

    /// One tick with these samples, each of its source.
    fn tick(&mut self, samples: &[(u128, Measurement)]) -> Estimate {
        self.now_ns += PERIOD_NS;
        self.engine.begin(self.now_ns, 0);
        for (source, sample) in samples {
            self.engine.take(sample, *source);
        }
        let estimate = self.engine.conclude();
        assert!(estimate.is_finite(), "{estimate:?}");
        estimate
    }

    /// A good sample, stamped at the next tick.
    fn moving(&self, sequence: u64) -> Measurement {
        let t = sequence as f64 * 0.005;
        Measurement::at(self.now_ns + PERIOD_NS, sequence)
            .with_velocity_m_s([t.sin(), t.cos(), 0.5])
            .with_angular_velocity_rad_s([0.1, 0.2 * t.sin(), 0.0])
            .with_attitude_wxyz([1.0, 0.0, 0.0, 0.0])
            .with_force_n([0.0, 0.0, -19.62])
    }
}

#[test]
fn bad_samples_are_rejected_counted_and_do_no_harm() {
    let mut service = Loop::new("rigid-body", |_| ());
    // Gaps of 4 and 3 before the newest good one.
    for sequence in [0, 5, 9] {
        let sample = service.moving(sequence);
        assert_eq!(service.tick(&[(1, sample)]).status & status_bits::REJECTED_SAMPLE, 0);
    }
    let newest_ns = service.now_ns;
    let bad: [(&dyn Fn(Measurement) -> Measurement, Rejection); 10] = [
        (&|m| m.with_velocity_m_s([f64::NAN; 3]), Rejection::NotFinite),
        (&|m| m.with_torque_n_m([f64::INFINITY; 3]), Rejection::NotFinite),
        (&|m| m.with_velocity_m_s([1e3, 0.0, 0.0]), Rejection::BeyondLimits),
        (&|m| m.with_attitude_wxyz([2.0, 0.0, 0.0, 0.0]), Rejection::QuaternionNorm),
        (&|m| Measurement { stamp_ns: newest_ns, ..m }, Rejection::RepeatedStamp),
        (&|m| Measurement { stamp_ns: m.stamp_ns - 2_000_000_000, ..m }, Rejection::TooOld),
        (&|m| Measurement { stamp_ns: m.stamp_ns + 3_600_000_000_000, ..m }, Rejection::FarFuture),
        (&|m| Measurement { sequence: 7, ..m }, Rejection::SequenceBackwards),
        (&|m| Measurement { valid: 0, ..m }, Rejection::Malformed),
        (&|m| Measurement { velocity_frame: 7, ..m }, Rejection::Malformed),
    ];
    let mut expected = [0; Rejection::ALL.len()];
    for ((change, reason), sequence) in bad.into_iter().zip(10..) {
        let sample = change(service.moving(sequence));
        let estimate = service.tick(&[(1, sample)]);
        assert_ne!(estimate.status & status_bits::REJECTED_SAMPLE, 0, "{reason:?}");
        expected[reason as usize] += 1;
        assert_eq!(service.engine.counters().samples_rejected, expected);
    }
    let sample = service.moving(20);
    service.tick(&[(1, sample)]);
    let counters = service.engine.counters();
    assert_eq!((counters.samples_accepted, counters.samples_rejected), (4, expected));
    // 1 to 4 and 6 to 8 never arrived, nor the sample whose number was changed; the rejected ones did.
    assert_eq!(counters.samples_lost, 8);
}

#[test]
fn a_field_that_is_missing_makes_only_its_channel_coast() {
    let mut service = Loop::new("rigid-body", |_| ());
    let bits = status_bits::COASTING | status_bits::TRACKING;
    let mut status_after = |with_velocity: bool, sequences: std::ops::Range<u64>| {
        let mut status = 0;
        for sequence in sequences {
            let mut sample = service.moving(sequence);
            if !with_velocity {
                sample.valid &= !valid::VELOCITY;
            }
            status = service.tick(&[(1, sample)]).status & bits;
        }
        status
    };
    assert_eq!(status_after(true, 0..20), status_bits::TRACKING);
    assert_eq!(status_after(false, 20..40), status_bits::COASTING_TRANSLATION);
    assert_eq!(status_after(true, 40..60), status_bits::TRACKING);
}

#[test]
fn of_two_sources_the_first_wins_until_it_is_silent() {
    let first = |config: &mut Config| config.input.source = SourcePolicy::First;
    let mut service = Loop::new("rigid-body", first);
    for sequence in 0..40 {
        let sample = service.moving(sequence);
        service.tick(&[(1, sample), (2, Measurement { sequence: 500 + sequence, ..sample })]);
    }
    let counters = service.engine.counters();
    assert_eq!(counters.samples_accepted, 40);
    assert_eq!(counters.samples_rejected[Rejection::OtherSource as usize], 40);
    assert_eq!(service.engine.gate().other_source(), Some(2));
    // The preset's takeover_after_s is 0.2 s.
    for _ in 0..50 {
        service.tick(&[]);
    }
    for sequence in 540..550 {
        let sample = service.moving(sequence);
        service.tick(&[(2, sample)]);
    }
    let counters = service.engine.counters();
    assert_eq!((counters.samples_accepted, counters.source_changes), (50, 2));
    assert_eq!(counters.samples_lost, 0);
}

/// Two spikes are held back, and a sensor that repeats one value is named; the estimate follows neither.
#[test]
fn spikes_are_held_back_and_a_stuck_sensor_is_named() {
    let mut service = Loop::new("rigid-body", |_| ());
    let mut bits = 0;
    for sequence in 0..400 {
        let mut sample = service.moving(sequence);
        if sequence == 150 || sequence == 151 {
            sample.velocity_m_s[0] += 8.0;
        }
        if sequence >= 250 {
            sample.angular_velocity_rad_s = [0.1, 0.2, 0.3];
        }
        let estimate = service.tick(&[(1, sample)]);
        bits |= estimate.status & (status_bits::HELD_BACK | status_bits::STUCK);
        assert!(estimate.velocity_m_s[0].abs() < 2.0, "{:?}", estimate.velocity_m_s);
    }
    let counters = service.engine.counters();
    assert_eq!((counters.samples_accepted, counters.outputs_held_back[0]), (400, 2));
    // The first of the 150 is new, and the next 49 may be chance.
    assert_eq!(counters.outputs_stuck, [0, 100, 0]);
    assert_eq!(bits, status_bits::HELD_BACK | status_bits::STUCK);
}

/// A mass on a spring under an unmodelled force: from y and u the observer estimates x̂ and f̂.
#[test]
fn a_linear_plant_of_the_users_own_is_estimated() {
    // At rest and without noise the output repeats itself.
    let mut service = Loop::new("linear", |config| config.input.stuck = daemon::config::OutlierAction::Off);
    // x = (r, v) at rest against a constant force of 3 N that is not commanded: r = 3 / 6 m.
    let (r, unknown_n) = (0.5, 3.0);
    let mut estimate = Estimate::default();
    for sequence in 0..600 {
        let sample = service.moving(sequence);
        let sample = Measurement::at(sample.stamp_ns, sequence).with_output(&[2.0 * r]).with_input(&[0.0]);
        estimate = service.tick(&[(1, sample)]);
    }
    assert_ne!(estimate.status & status_bits::TRACKING, 0);
    // Within what the dead zone of 0.02 leaves.
    assert!((estimate.matched_input[0] - unknown_n).abs() < 0.6, "{:?}", estimate.matched_input);
    assert!((estimate.state[0] - r).abs() < 0.05 && estimate.state[1].abs() < 0.1, "{:?}", estimate.state);
    assert!(estimate.linear.native_norm > 0.1 && estimate.linear.error_bound > 0.0);
    assert_eq!(estimate.state[2..], [0.0; 10]);

    // Bad input is refused by reason, and silence means coasting.
    for (sequence, y) in [(600, f64::NAN), (601, 1e12)] {
        let sample = Measurement::at(service.now_ns + PERIOD_NS, sequence).with_output(&[y]);
        service.tick(&[(1, sample)]);
    }
    let rejected = service.engine.counters().samples_rejected;
    assert_eq!(rejected[Rejection::NotFinite as usize], 1);
    assert_eq!(rejected[Rejection::BeyondLimits as usize], 1);
    assert_ne!(service.tick(&[]).status & status_bits::COASTING_LINEAR, 0);
}

/// One flight, told by an ideal sensor, and by one that is turned, sits off the center and stamps late, of which the configuration knows.
#[test]
fn a_configured_sensor_gives_the_estimates_of_an_ideal_one() {
    const LATENCY_NS: u64 = 120_000_000;
    let arm = nalgebra::Vector3::new(0.8, -0.3, 0.2);
    let mounting = nalgebra::UnitQuaternion::new(nalgebra::Vector3::new(0.2, 0.1, -1.5));
    let fly = |is_ideal: bool| {
        let q = mounting.coords;
        let mut service = Loop::new("rigid-body", |config| {
            let mut sensor: SensorConfig =
                toml::from_str("name = \"dvl\"\nnumber = 4\nlatency_s = 0.12").unwrap();
            sensor.lever_arm_m = arm.into();
            sensor.mounting_wxyz = [q.w, q.x, q.y, q.z];
            config.sensor.push(sensor);
        });
        let mut estimate = Estimate::default();
        for j in 0..2000_u64 {
            let moving = service.moving(j);
            let mut samples = vec![(1, Measurement { valid: moving.valid & !valid::VELOCITY, ..moving })];
            // Every tenth arrives 24 ticks late.
            if let Some(k) = j.checked_sub(24).filter(|k| k % 10 == 0) {
                let t = k as f64 * 0.005;
                let rate = nalgebra::Vector3::new(0.1, 0.2 * t.sin(), 0.0);
                let velocity = nalgebra::Vector3::new(t.sin(), t.cos(), 0.5);
                let stamp_ns = moving.stamp_ns - LATENCY_NS;
                let sample = Measurement::at(stamp_ns, k / 10);
                samples.push((
                    2,
                    match is_ideal {
                        true => sample.with_body_velocity_m_s(velocity.into()),
                        false => {
                            let read = mounting.inverse() * (velocity + rate.cross(&arm));
                            Measurement { stamp_ns: moving.stamp_ns, sensor: 4, ..sample }
                                .with_body_velocity_m_s(read.into())
                        }
                    },
                ));
            }
            estimate = service.tick(&samples);
        }
        assert_eq!(service.engine.counters().samples_rejected_total(), 0);
        let late: Vec<_> = service.engine.sources().rows().map(|row| (row.sensor, row.late)).collect();
        assert_eq!(late, [(0, 0), (if is_ideal { 0 } else { 4 }, 198)]);
        estimate
    };
    let (ideal, installed) = (fly(true), fly(false));
    for axis in 0..3 {
        let difference = ideal.velocity_m_s[axis] - installed.velocity_m_s[axis];
        // The estimated angular velocity is not exact; its noise is 0.005 rad/s, at 0.9 m.
        assert!(difference.abs() < 5e-3, "axis {axis}: {difference}");
    }
}

#[test]
fn a_sensor_that_the_configuration_does_not_know_is_refused_by_name() {
    let known = "name = \"imu\"\nnumber = 1";
    let mut service = Loop::new("rigid-body", |config| config.sensor.push(toml::from_str(known).unwrap()));
    let (first, second) = (service.moving(0), service.moving(1));
    service.tick(&[(1, first.of_sensor(1))]);
    service.tick(&[(1, second.of_sensor(2))]);
    let counters = service.engine.counters();
    assert_eq!((counters.samples_accepted, counters.rejected(Rejection::UnknownSensor)), (1, 1));
    let sample = service.moving(2);
    service.tick(&[(1, sample)]);
    let counters = service.engine.counters();
    assert_eq!((counters.samples_accepted, counters.samples_lost), (2, 0));
}
