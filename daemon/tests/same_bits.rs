//! The same samples through the service and through the library give the same estimates, bit for bit.

use crate::common::{TestDomain, run_daemon};
use daemon::assemble;
use daemon::config::{ConfigFile, InputConfig};
use daemon::engine::to_payload;
use daemon::gate::Gate;
use observer::Learn;
use shared_types::clock::{monotonic_ns, sleep_until_ns};
use shared_types::{Estimate, Measurement};

const PERIOD_NS: u64 = 5_000_000;

#[test]
fn the_service_and_the_library_agree_to_the_bit() {
    let domain = TestDomain::new();
    // Four ticks a sample: held outputs, pending updates and coasting are all seen between the samples.
    let daemon = run_daemon(&domain, &["--preset", "auv", "--rate-hz", "800"]);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut estimates = client.estimate_subscriber().unwrap();

    let start_ns = monotonic_ns() + 50_000_000;
    let (mut sent, mut received): (Vec<Measurement>, Vec<Estimate>) = Default::default();
    for sequence in 0..1000_u64 {
        let t = sequence as f64 * 0.005;
        let stamp_ns = start_ns + sequence * PERIOD_NS + sequence * 7919 % 1000 * 1500;
        let mut sample = Measurement::at(stamp_ns, sequence)
            .with_angular_velocity_rad_s([0.3 * t.sin(), 0.1, 0.2 * t.cos()])
            .with_force_n([10.0 * t.cos(), 2.0, -1.0])
            .with_torque_n_m([0.1, 0.2 * t.sin(), 0.0]);
        if sequence.is_multiple_of(20) {
            sample = sample.with_body_velocity_m_s([1.0 + 0.2 * t.sin(), 0.1, -0.1 * t.cos()]);
        }
        if sequence.is_multiple_of(50) {
            sample = sample.with_position_m([t, 0.1 * t, 0.0]).with_attitude_wxyz([1.0, 0.0, 0.0, 0.0]);
        }
        // An outage, and a sample that arrives two ticks late.
        let late_ns = if sequence % 100 == 3 { 2_500_000 } else { 0 };
        sleep_until_ns(stamp_ns + late_ns);
        if !(600..700).contains(&sequence) {
            sensors.publish(&sample).unwrap();
            sent.push(sample);
        }
        while let Some(estimate) = estimates.take().unwrap() {
            received.push(estimate);
        }
    }
    let status = domain.status();
    assert_eq!(status.counters.samples_accepted as usize, sent.len(), "{status:?}");
    assert_eq!(daemon.stop().code, Some(0));

    let mut config = ConfigFile::preset("auv").unwrap();
    config.config.rate_hz = 800.0;
    let mut observer = assemble::estimator(&config).unwrap();
    let mut gate = Gate::new(InputConfig::default(), true);
    let mut samples = sent.iter().peekable();
    let mut compared = 0;
    for estimate in received.iter().filter(|estimate| estimate.source_stamp_ns > 0) {
        while let Some(sample) = samples.next_if(|sample| sample.sequence <= estimate.source_sequence) {
            let accepted = gate.judge(sample, 1, &gate.in_order(sample, estimate.stamp_ns)).unwrap();
            observer.accept(&accepted.sample, &accepted.linear, Learn::ALL);
        }
        let offline = to_payload(&observer.estimate(estimate.stamp_ns));
        let offline = Estimate {
            sequence: estimate.sequence,
            source_sequence: estimate.source_sequence,
            source_stamp_ns: estimate.source_stamp_ns,
            publish_stamp_ns: estimate.publish_stamp_ns,
            status: estimate.status,
            sensors: estimate.sensors,
            ..offline
        };
        // Debug prints the shortest text that names one number: equal texts are equal bits.
        assert_eq!(format!("{offline:?}"), format!("{estimate:?}"));
        compared += 1;
    }
    assert!(compared > 3000, "{compared}");
    let last = received.last().unwrap();
    assert!(last.translation.native_norm > 0.0 && last.rotation.native_norm > 0.0, "{last:?}");
}
