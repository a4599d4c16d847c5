//! PX4's ULog: topics at their own, uneven rates, joined by time stamp.
//!
//! | topic | becomes |
//! |---|---|
//! | vehicle_local_position | velocity and position, where they are valid (north-east-down) |
//! | vehicle_angular_velocity | angular velocity (body, forward-right-down) |
//! | vehicle_attitude | attitude |
//! | vehicle_thrust_setpoint | force: the set-point times the thrust of 1, turned by the newest attitude |
//! | vehicle_torque_setpoint | torque: the set-point times the torque of 1 |
//! | actuator_controls_0 | force and torque, of logs from before these two topics |
//! | vehicle_land_detected | the time in the air |
//!
//! Each message is a sample at its own `timestamp_sample` with its own fields; messages of one instant are one sample.

use crate::collector::Collector;
use crate::error::{ImportError, Imported};
use crate::flight::{Place, SkipReason};
use crate::importer::ImportOptions;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use px4_ulog::stream_parser::{DataMessage, LogParser, model::DropoutMessage};
use shared_types::Measurement;
use std::collections::BTreeMap;

/// Standard gravity (m/s²).
const GRAVITY_M_S2: f64 = 9.80665;

/// A message that is used.
#[derive(Debug, Clone, Copy)]
enum Event {
    Motion {
        velocity_m_s: Option<[f64; 3]>,
        position_m: Option<[f64; 3]>,
    },
    AngularVelocity([f64; 3]),
    Attitude([f64; 4]),
    Thrust([f64; 3]),
    Torque([f64; 3]),
    /// Torque about each axis, then thrust, upwards.
    Controls([f64; 4]),
    HoverThrust(f64),
    Landed(bool),
}

/// What a log holds beside its events.
#[derive(Debug, Clone, Default, PartialEq)]
struct Contents {
    /// Topics and the number of their messages.
    topics: BTreeMap<String, usize>,
    /// Gaps of the logger.
    dropouts: usize,
    /// Their length in all (ms).
    dropouts_ms: u64,
    /// Why reading ended before the end of the file, if it did.
    ended_by: Option<String>,
    /// The log's own estimate of the set-point that carries the weight.
    hover_thrust: Option<f64>,
}

/// Reads the messages that are used, in the order of the file.
fn read(bytes: &[u8]) -> (Vec<(u64, Event)>, Contents) {
    let mut events = Vec::new();
    let mut topics: BTreeMap<String, usize> = BTreeMap::new();
    let (mut dropouts, mut dropouts_ms) = (0, 0);
    let mut take = |message: &DataMessage<'_>| {
        let topic = &message.flattened_format.message_name;
        match topics.get_mut(topic) {
            Some(count) => *count += 1,
            None => drop(topics.insert(topic.clone(), 1)),
        }
        // The first instance is the one that the vehicle flies on.
        if message.multi_id.value() == 0 {
            events.extend(event(topic, message));
        }
    };
    let mut drop_out = |dropout: &DropoutMessage| {
        dropouts += 1;
        dropouts_ms += u64::from(dropout.duration_ms);
    };
    let mut parser = LogParser::default();
    parser.set_data_message_callback(&mut take);
    parser.set_dropout_message_callback(&mut drop_out);
    let ended_by = consume(&mut parser, bytes).err();
    drop(parser);
    let hover_thrust = events.iter().rev().find_map(|(_, event)| match event {
        Event::HoverThrust(thrust) => Some(*thrust),
        _ => None,
    });
    (events, Contents { topics, dropouts, dropouts_ms, ended_by, hover_thrust })
}

/// Passes the log to the parser: up to its appended sections, if it has any (of a crash), then these. Only the needed
/// messages are passed, because px4-ulog 0.6.1 does not check the shape of the others (parameters, texts).
fn consume(parser: &mut LogParser<'_>, bytes: &[u8]) -> Result<(), String> {
    const HEADER_BYTES: usize = 16;
    let (header, mut rest) = bytes.split_at(bytes.len().min(HEADER_BYTES));
    parser.consume_bytes(header).map_err(|error| error.to_string())?;
    if header.len() < HEADER_BYTES {
        return Err(format!("{} bytes", bytes.len()));
    }
    let mut ends = Vec::new();
    while !rest.is_empty() {
        let position = bytes.len() - rest.len();
        let section = &rest[..ends.first().map_or(rest.len(), |&end: &usize| end - position)];
        let Some(message) = first_message(section) else {
            if section.len() == rest.len() {
                return Err("the file ends within a message".into());
            }
            rest = &rest[section.len()..];
            ends.remove(0);
            continue;
        };
        match message[2] {
            b'A' if message.len() < 3 + 4 => {
                return Err(format!("a subscription without a topic at byte {position}"));
            }
            b'B' | b'F' | b'A' | b'D' | b'O' => {
                parser.consume_bytes(message).map_err(|error| format!("{error} at byte {position}"))?;
            }
            _ => {}
        }
        rest = &rest[message.len()..];
        if message[2] == b'B' {
            let offsets = parser.appended_offsets().iter().filter_map(|&offset| usize::try_from(offset).ok());
            ends =
                offsets.filter(|offset| (position + message.len()..bytes.len()).contains(offset)).collect();
            ends.sort_unstable();
            ends.dedup();
        }
        let position = bytes.len() - rest.len();
        ends.retain(|&end| end > position);
    }
    Ok(())
}

/// The first message of a section, with its size and kind, if it is whole.
fn first_message(section: &[u8]) -> Option<&[u8]> {
    let size = section.first_chunk::<2>().map(|size| usize::from(u16::from_le_bytes(*size)))?;
    section.get(..3 + size)
}

/// The time (µs) and content of a message, if it is used and complete.
fn event(topic: &str, message: &DataMessage<'_>) -> Option<(u64, Event)> {
    let format = message.flattened_format;
    if message.data.len() < usize::from(format.size()) {
        return None;
    }
    let number = |name: &str| -> Option<f64> {
        let value = f64::from(format.get_field_parser::<f32>(name).ok()?.parse(message.data));
        value.is_finite().then_some(value)
    };
    let numbers = |names: [&str; 3]| -> Option<[f64; 3]> {
        let [x, y, z] = names.map(number);
        Some([x?, y?, z?])
    };
    let flag =
        |name: &str| format.get_field_parser::<bool>(name).is_ok_and(|parser| parser.parse(message.data));
    let both = |first: &str, second: &str| flag(first) && flag(second);
    let event = match topic {
        "vehicle_local_position" => {
            let velocity = numbers(["vx", "vy", "vz"]).filter(|_| both("v_xy_valid", "v_z_valid"));
            let position = numbers(["x", "y", "z"]).filter(|_| both("xy_valid", "z_valid"));
            Event::Motion { velocity_m_s: velocity, position_m: position }
        }
        "vehicle_angular_velocity" => Event::AngularVelocity(numbers(["xyz[0]", "xyz[1]", "xyz[2]"])?),
        "vehicle_attitude" => {
            let [x, y, z] = numbers(["q[1]", "q[2]", "q[3]"])?;
            Event::Attitude([number("q[0]")?, x, y, z])
        }
        "vehicle_thrust_setpoint" => Event::Thrust(numbers(["xyz[0]", "xyz[1]", "xyz[2]"])?),
        "vehicle_torque_setpoint" => Event::Torque(numbers(["xyz[0]", "xyz[1]", "xyz[2]"])?),
        "actuator_controls_0" => {
            let [roll, pitch, yaw] = numbers(["control[0]", "control[1]", "control[2]"])?;
            Event::Controls([roll, pitch, yaw, number("control[3]")?])
        }
        "hover_thrust_estimate" => {
            Event::HoverThrust(number("hover_thrust").filter(|&thrust| thrust > 0.05)?)
        }
        "vehicle_land_detected" => Event::Landed(flag("landed")),
        _ => return None,
    };
    let stamp = |name: &str| Some(format.get_field_parser::<u64>(name).ok()?.parse(message.data));
    let sampled_us = stamp("timestamp_sample").filter(|&us| us > 0);
    Some((sampled_us.or_else(|| stamp("timestamp"))?, event))
}

/// Topics with the number of their messages, and the hover thrust; read without joining them to a flight.
pub(super) fn contents(bytes: &[u8]) -> Vec<String> {
    let Contents { topics, hover_thrust, .. } = read(bytes).1;
    let topics = topics.iter().map(|(topic, n)| format!("{topic} ({n})"));
    topics.chain(hover_thrust.map(|thrust| format!("hover thrust {thrust:.3}"))).collect()
}

/// Old logs' controls as the set-points that newer ones have; dropped where both are there.
fn commanded(stamp_us: u64, event: Event, has_setpoints: bool) -> Vec<(u64, Event)> {
    match event {
        Event::Controls(_) if has_setpoints => Vec::new(),
        Event::Controls([roll, pitch, yaw, up]) => {
            vec![(stamp_us, Event::Torque([roll, pitch, yaw])), (stamp_us, Event::Thrust([0.0, 0.0, -up]))]
        }
        other => vec![(stamp_us, other)],
    }
}

/// What the log lacks, a sentence each.
fn remarks(
    contents: &Contents,
    events: &[(u64, Event)],
    thrust_n: Option<f64>,
    options: &ImportOptions,
) -> Vec<String> {
    let has = |is: fn(&Event) -> bool| events.iter().any(|(_, event)| is(event));
    let mut remarks = Vec::new();
    if let Some(reason) = &contents.ended_by {
        remarks.push(format!("read up to here: {reason}"));
    }
    if contents.dropouts > 0 {
        let (n, length_ms) = (contents.dropouts, contents.dropouts_ms);
        remarks.push(format!("the logger lost data {n} times, {length_ms} ms in all"));
    }
    if !has(|event| matches!(event, Event::Motion { velocity_m_s: Some(_), .. })) {
        remarks.push("no valid velocity (topic vehicle_local_position)".into());
    }
    if !has(|event| matches!(event, Event::Thrust(_))) {
        remarks.push("no force: neither vehicle_thrust_setpoint nor actuator_controls_0 is in it".into());
    } else if thrust_n.is_none() {
        remarks.push(match options.mass_kg {
            None => "no force: needed: --mass-kg, or --thrust-n, the force of a thrust set-point of 1".into(),
            Some(_) => "no force: the log has no hover_thrust_estimate, from which --mass-kg could tell it; \
                        needed: --thrust-n, the force of a thrust set-point of 1"
                .into(),
        });
    } else if !has(|event| matches!(event, Event::Attitude(_))) {
        remarks.push("no force: without vehicle_attitude nothing tells where the thrust points".into());
    }
    remarks
}

pub(super) fn parse(bytes: &[u8], path: &str, options: &ImportOptions) -> Imported {
    let (mut events, contents) = read(bytes);
    if events.is_empty() {
        let found = match contents.topics.is_empty() {
            true => {
                let found = contents.ended_by.unwrap_or_else(|| "no message".into());
                format!("it is no ULog: {found}; needed: a log of PX4 (.ulg)")
            }
            false => format!(
                "it has none of vehicle_local_position, vehicle_angular_velocity, vehicle_attitude; its topics are: {}",
                contents.topics.into_keys().collect::<Vec<_>>().join(", ")
            ),
        };
        return Err(ImportError::Content(path.into(), found));
    }
    let has_setpoints = events.iter().any(|(_, event)| matches!(event, Event::Thrust(_)));
    events = events.into_iter().flat_map(|(us, event)| commanded(us, event, has_setpoints)).collect();
    events.sort_by_key(|(stamp_us, _)| *stamp_us);
    let hover_n =
        contents.hover_thrust.zip(options.mass_kg).map(|(hover, mass_kg)| mass_kg * GRAVITY_M_S2 / hover);
    let thrust_n = options.thrust_n.or(hover_n);

    let mut flight = Collector::counted_by(Place::Microsecond);
    flight.remarks = remarks(&contents, &events, thrust_n, options);
    let mut attitude: Option<UnitQuaternion<f64>> = None;
    let (mut flying_since_us, mut airborne_us) = (None, None);
    let mut rest = &events[..];
    while let Some(&(stamp_us, _)) = rest.first() {
        let n = rest.iter().take_while(|(other_us, _)| *other_us == stamp_us).count();
        let (now, later) = rest.split_at(n);
        rest = later;
        let mut sample = Measurement::default();
        // The attitude of the instant turns the thrust of the instant.
        for (_, event) in now {
            if let Event::Attitude([w, x, y, z]) = *event {
                sample = sample.with_attitude_wxyz([w, x, y, z]);
                attitude = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6);
            }
        }
        for (_, event) in now {
            match *event {
                Event::Motion { velocity_m_s, position_m } => {
                    sample = velocity_m_s.map_or(sample, |velocity| sample.with_velocity_m_s(velocity));
                    sample = position_m.map_or(sample, |position| sample.with_position_m(position));
                }
                Event::AngularVelocity(rates) => sample = sample.with_angular_velocity_rad_s(rates),
                Event::Thrust(setpoint) => match (thrust_n, attitude) {
                    (Some(thrust_n), Some(attitude)) => {
                        let force_n = attitude * (thrust_n * Vector3::from(setpoint));
                        sample = sample.with_force_n(force_n.into());
                    }
                    (Some(_), None) => flight.skipped.add(SkipReason::NoAttitudeYet, stamp_us),
                    (None, _) => {}
                },
                Event::Torque(setpoint) => {
                    if let Some(torque_n_m) = options.torque_n_m {
                        let torque = Vector3::from(setpoint).component_mul(&Vector3::from(torque_n_m));
                        sample = sample.with_torque_n_m(torque.into());
                    }
                }
                Event::Landed(true) => {
                    if let Some(since_us) = flying_since_us.take() {
                        airborne_us = longer(airborne_us, (since_us, stamp_us));
                    }
                }
                Event::Landed(false) => _ = flying_since_us.get_or_insert(stamp_us),
                Event::Attitude(_) | Event::HoverThrust(_) | Event::Controls(_) => {}
            }
        }
        if sample.valid != 0 {
            flight.add(stamp_us, i128::from(stamp_us) * 1000, sample);
        }
    }
    if let (Some(since_us), Some(&(last_us, _))) = (flying_since_us, events.last()) {
        airborne_us = longer(airborne_us, (since_us, last_us));
    }
    let first_us = flight.first_ns.map_or(0, |ns| u64::try_from(ns / 1000).unwrap_or(0));
    let airborne = airborne_us.map(|(start_us, end_us)| {
        let index = |us: u64| {
            let stamp_ns = us.saturating_sub(first_us).saturating_mul(1000);
            flight.samples.partition_point(|sample| sample.stamp_ns < stamp_ns)
        };
        index(start_us)..index(end_us)
    });
    flight.finish(path, airborne.filter(|range| !range.is_empty()))
}

fn longer(kept: Option<(u64, u64)>, other: (u64, u64)) -> Option<(u64, u64)> {
    let length = |(start, end): (u64, u64)| end.saturating_sub(start);
    Some(kept.filter(|&kept| length(kept) >= length(other)).unwrap_or(other))
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::payload::valid;

    /// A log with these formats (name, fields) and messages (index of format, instance, payload).
    fn log(formats: &[(&str, &str)], messages: &[(usize, u8, Vec<u8>)]) -> Vec<u8> {
        let mut bytes = b"ULog\x01\x12\x35\x01".to_vec();
        bytes.extend(0_u64.to_le_bytes());
        let mut message = |kind: u8, body: &[u8]| {
            bytes.extend(u16::try_from(body.len()).unwrap().to_le_bytes());
            bytes.push(kind);
            bytes.extend(body);
        };
        message(b'B', &[0; 40]);
        for (name, fields) in formats {
            message(b'F', format!("{name}:{fields}").as_bytes());
        }
        // Every format is subscribed to as two instances.
        for (index, (name, _)) in formats.iter().enumerate() {
            for instance in [0_u8, 1] {
                let id = (2 * index) as u16 + u16::from(instance);
                message(b'A', &[&[instance][..], &id.to_le_bytes(), name.as_bytes()].concat());
            }
        }
        for (index, instance, payload) in messages {
            let id = (2 * index) as u16 + u16::from(*instance);
            message(b'D', &[&id.to_le_bytes()[..], payload].concat());
        }
        message(b'O', &7_u16.to_le_bytes());
        bytes
    }

    fn payload(stamp_us: u64, values: &[f32]) -> Vec<u8> {
        let values = values.iter().flat_map(|value| value.to_le_bytes());
        stamp_us.to_le_bytes().into_iter().chain(values).collect()
    }

    const ATTITUDE: (&str, &str) = ("vehicle_attitude", "uint64_t timestamp;float[4] q;");
    const CONTROLS: (&str, &str) = ("actuator_controls_0", "uint64_t timestamp;float[8] control;");

    #[test]
    fn thrust_of_an_old_log_points_where_its_vehicle_does() {
        // Nose up by 90°: forward is up, and the body's upward thrust pulls to the south.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let controls = [0.1, 0.2, 0.3, 0.5, 0.0, 0.0, 0.0, 0.0];
        let bytes = log(
            &[ATTITUDE, CONTROLS],
            &[
                (1, 0, payload(500, &controls)),
                (0, 0, payload(1000, &[half, 0.0, half, 0.0])),
                // Another instance's is not what the vehicle flies on.
                (0, 1, payload(1500, &[1.0, 0.0, 0.0, 0.0])),
                (1, 0, payload(3000, &controls)),
            ],
        );
        let options = ImportOptions {
            thrust_n: Some(20.0),
            torque_n_m: Some([1.0, 2.0, 3.0]),
            ..ImportOptions::default()
        };
        let flight = parse(&bytes, "old.ulg", &options).unwrap();
        assert_eq!(flight.skipped.for_reason(SkipReason::NoAttitudeYet), 1, "{}", flight.skipped);
        assert!(flight.skipped.to_string().contains("at 500 µs"), "{}", flight.skipped);
        assert!(flight.remarks.iter().any(|remark| remark.contains("1 times, 7 ms")), "{:?}", flight.remarks);
        let last = flight.samples.last().unwrap();
        assert_eq!(last.stamp_ns, 2_500_000);
        for (found, expected) in last.force_n.iter().zip([-10.0, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-5, "{:?}", last.force_n);
        }
        for (found, expected) in last.torque_n_m.iter().zip([0.1, 0.4, 0.9]) {
            assert!((found - expected).abs() < 1e-6, "{:?}", last.torque_n_m);
        }
    }

    #[test]
    fn what_a_log_lacks_is_said() {
        let sentence =
            |bytes: &[u8]| parse(bytes, "f.ulg", &ImportOptions::default()).unwrap_err().to_string();
        assert!(sentence(b"").contains("is no ULog"), "{}", sentence(b""));
        assert!(sentence(b"time,vx\n0,1\n").contains("is no ULog"));
        let other = log(&[("cpuload", "uint64_t timestamp;float load;")], &[(0, 0, payload(1, &[0.5]))]);
        assert!(sentence(&other).contains("its topics are: cpuload"), "{}", sentence(&other));
        let rates = log(
            &[("vehicle_angular_velocity", "uint64_t timestamp;float[3] xyz;")],
            &[(0, 0, payload(1, &[0.1, 0.2, 0.3]))],
        );
        let remarks = parse(&rates, "f.ulg", &ImportOptions::default()).unwrap().remarks.join("; ");
        assert!(remarks.contains("no valid velocity") && remarks.contains("no force: neither"), "{remarks}");
        // A message that is shorter than its fields.
        let torn = parse(&rates[..rates.len() - 1], "f.ulg", &ImportOptions::default()).unwrap();
        assert_eq!(torn.samples.len(), 1);
        assert!(torn.remarks[0].contains("ends within a message"), "{:?}", torn.remarks);
    }

    /// Counts and sums of pyulog 1.3.0 and NumPy, which also rotated the force; attitudes are normalised here.
    #[test]
    fn a_real_log_is_read_as_pyulog_reads_it() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/ulog/sample_px4_events.ulg");
        let Ok(bytes) = std::fs::read(path) else {
            testkit::skip("the recorded ULog", &format!("{path} is not here (PX4/pyulog has it in test/)"));
            return;
        };
        let options = ImportOptions { thrust_n: Some(1.0), ..ImportOptions::default() };
        let flight = parse(&bytes, "sample", &options).unwrap();
        let sum = |bit: u32, values: fn(&Measurement) -> Vec<f64>| {
            let carrying = flight.samples.iter().filter(|sample| sample.has(bit));
            carrying.fold((0, Vec::new()), |(n, sum), sample| {
                let values = values(sample);
                let sum = if sum.is_empty() { vec![0.0; values.len()] } else { sum };
                (n + 1, sum.iter().zip(values).map(|(a, b)| a + b).collect())
            })
        };
        let expect = |found: (usize, Vec<f64>), n: usize, sums: &[f64]| {
            assert_eq!(found.0, n);
            for (found, expected) in found.1.iter().zip(sums) {
                assert!((found - expected).abs() < 1e-4, "{found} where {expected} was expected");
            }
        };
        expect(
            sum(valid::VELOCITY, |s| s.velocity_m_s.to_vec()),
            215,
            &[0.5267404958722182, 0.9251902831092593, 16.027262673804216],
        );
        expect(
            sum(valid::POSITION, |s| s.position_m.to_vec()),
            215,
            &[4.268593340209918, 0.993495428469032, -69.77674569189548],
        );
        expect(
            sum(valid::ANGULAR_VELOCITY, |s| s.angular_velocity_rad_s.to_vec()),
            1558,
            &[0.06134217012731824, -0.4914440525462851, 0.009814391309191706],
        );
        expect(
            sum(valid::ATTITUDE, |s| s.attitude_wxyz.to_vec()),
            622,
            &[621.9658616781235, 0.8648783563203324, 1.2424542478111107, 6.198285951162688],
        );
        expect(
            sum(valid::FORCE, |s| s.force_n.to_vec()),
            1553,
            &[-1.1369387961651953, 0.7132044084596662, -248.57209880570417],
        );
        // landed: false from 1710773367086000 to 1710773378478000; the first sample is at 1710773350354000.
        let (start_s, end_s) = flight.airborne_s().unwrap();
        assert!((start_s - 16.732).abs() < 0.02 && (end_s - 28.124).abs() < 0.02, "{start_s} {end_s}");
    }
}
