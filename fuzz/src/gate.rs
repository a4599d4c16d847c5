//! Any samples, from any sources, at any times: an accepted sample is within the limits and newer; a rejected one changes
//! nothing.

use crate::bytes::Bytes;
use daemon::config::{InputConfig, SourcePolicy};
use daemon::gate::Gate;
use observer::Velocity;

pub(crate) fn run(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let kind = bytes.byte();
    let source = match kind & 5 {
        0 => SourcePolicy::First,
        1 => SourcePolicy::Newest,
        _ => SourcePolicy::All,
    };
    let limits = InputConfig { source, ..InputConfig::default() };
    let check_clock = kind & 2 == 0;
    let mut gate = Gate::new(limits, check_clock);
    let mut now_ns = 1_000_000_000_000;
    while !bytes.is_empty() {
        now_ns = bytes.stamp_ns(now_ns);
        let near_ns = if bytes.byte() & 1 == 0 { now_ns } else { gate.newest_stamp_ns().unwrap_or(now_ns) };
        let sample = bytes.measurement(near_ns, gate.newest_sequence().unwrap_or(0));
        let before = (gate.source(), gate.newest_stamp_ns(), gate.newest_sequence());
        let source = u128::from(bytes.byte() % 12);
        match gate.judge(&sample, source, &gate.in_order(&sample, now_ns)) {
            Ok(accepted) => {
                assert_eq!(gate.source(), Some(source));
                assert_eq!(gate.newest_stamp_ns(), Some(sample.stamp_ns));
                assert_eq!(gate.newest_sequence(), Some(sample.sequence));
                assert_eq!(accepted.sample.stamp_ns, sample.stamp_ns);
                // Time goes forward, or is said to start anew, and that only where samples are the clock.
                assert!(accepted.new_time || before.1.is_none_or(|newest_ns| sample.stamp_ns > newest_ns));
                assert!(!(accepted.new_time && check_clock));
                assert!(accepted.new_source || kind & 4 != 0 || before.0 == Some(source));
                if let Some(Velocity::Inertial(v) | Velocity::Body(v)) = accepted.sample.velocity {
                    assert!(v.norm() <= limits.max_speed_m_s);
                }
                let vectors = [
                    (accepted.sample.angular_velocity_rad_s, limits.max_angular_rate_rad_s),
                    (accepted.sample.position_m, limits.max_position_m),
                    (accepted.sample.force_n, limits.max_force_n),
                    (accepted.sample.torque_n_m, limits.max_torque_n_m),
                ];
                assert!(
                    vectors.iter().all(|(vector, limit)| vector.is_none_or(|vector| vector.norm() <= *limit))
                );
                let attitude = accepted.sample.attitude;
                assert!(attitude.is_none_or(|q| (q.coords.norm() - 1.0).abs() < 1e-9));
                let (output, input) = (accepted.linear.output, accepted.linear.input);
                assert!(output.is_none_or(|y| y.amax() <= limits.max_output));
                assert!(input.is_none_or(|u| u.amax() <= limits.max_input));
            }
            Err(_) => assert_eq!(before, (gate.source(), gate.newest_stamp_ns(), gate.newest_sequence())),
        }
    }
}
