//! Any bytes from a vehicle, raw or as the payload of a frame with a correct check sum, at any times.

use crate::bytes::Bytes;
use mavlink::dialects::common::MavMessage;
use mavlink::{Message, calculate_crc};
use mavlink_bridge::{Bridge, Settings, Source};
use shared_types::payload::{frame, valid};

/// Those that are understood: HEARTBEAT, ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, COMMAND_ACK, ATTITUDE_TARGET,
/// TIMESYNC, ACTUATOR_CONTROL_TARGET, ODOMETRY.
const IDS: [u32; 9] = [0, 30, 31, 32, 77, 83, 111, 140, 331];

fn framed(id: u32, sequence: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xFD, payload.len() as u8, 0, 0, sequence, 1, 1];
    bytes.extend_from_slice(&id.to_le_bytes()[..3]);
    bytes.extend_from_slice(payload);
    let sum = calculate_crc(&bytes[1..], MavMessage::extra_crc(id));
    bytes.extend_from_slice(&sum.to_le_bytes());
    bytes
}

pub(crate) fn run(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let mut bridge = Bridge::new(Settings {
        source: [Source::Auto, Source::Odometry, Source::LocalPosition][usize::from(bytes.byte()) % 3],
        thrust_n: Some(30.0),
        torque_n_m: Some([1.0; 3]),
        request_rate_hz: Some(50.0),
        ..Settings::default()
    });
    let (mut now_ns, mut newest, mut n_samples) = (1_000_000_000_000u64, 0, 0);
    let mut sequence = 0u8;
    while !bytes.is_empty() {
        now_ns += u64::from(bytes.byte()) * 1_000_000;
        let (kind, length) = (usize::from(bytes.byte()), usize::from(bytes.byte()));
        let payload: Vec<u8> = (0..length).map(|_| bytes.byte()).collect();
        match IDS.get(kind) {
            Some(id) => bridge.receive(&framed(*id, sequence, &payload), None, now_ns),
            None => bridge.receive(&payload, None, now_ns),
        }
        sequence = sequence.wrapping_add(1);
        bridge.poll(now_ns);
        for sample in bridge.take_samples() {
            assert!(sample.stamp_ns > newest && sample.stamp_ns <= now_ns, "{sample:?}");
            assert_eq!(sample.sequence, n_samples);
            (newest, n_samples) = (sample.stamp_ns, n_samples + 1);
            assert!(sample.valid != 0 && sample.valid & !valid::RIGID_BODY == 0);
            assert!(sample.velocity_frame <= frame::BODY);
            let vectors = [
                sample.velocity_m_s,
                sample.angular_velocity_rad_s,
                sample.position_m,
                sample.force_n,
                sample.torque_n_m,
            ];
            assert!(vectors.iter().flatten().all(|number| number.is_finite()), "{sample:?}");
            if sample.has(valid::ATTITUDE) {
                let norm = sample.attitude_wxyz.iter().map(|part| part * part).sum::<f64>().sqrt();
                assert!((norm - 1.0).abs() < 1e-9, "{sample:?}");
            }
        }
        assert!(bridge.take_replies().len() < 64 && bridge.take_notes().len() < 300);
    }
    let tally = bridge.frame_tally();
    assert!(tally.garbage_bytes <= tally.bytes && bridge.tally().samples == n_samples);
}
