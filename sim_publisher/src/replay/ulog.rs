//! PX4's ULog: topics at their own, uneven rates, joined by time stamp.
//!
//! | topic | becomes |
//! |---|---|
//! | vehicle_local_position | velocity and position, where they are valid (north-east-down) |
//! | vehicle_angular_velocity | angular velocity (body, forward-right-down) |
//! | vehicle_attitude | attitude |
//! | vehicle_thrust_setpoint | force: the set-point times the thrust of 1, turned by the newest attitude |
//! | vehicle_torque_setpoint | torque: the set-point times the torque of 1 |
//! | vehicle_land_detected | the time in the air |
//!
//! Each message is a sample at its own `timestamp_sample` with its own fields; messages of one instant are one sample.

use super::{Collector, ImportError, RecordedFlight, SkipReason};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use px4_ulog::stream_parser::{DataMessage, LogParser, model::DropoutMessage};
use shared_types::Measurement;
use std::collections::BTreeMap;

/// What a ULog does not say of its vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct UlogScales {
    /// Force of a thrust set-point of 1 (N), with the body's axes.
    pub thrust_n: Option<f64>,
    /// Torque of a torque set-point of 1 (N m), about each axis of the body.
    pub torque_n_m: Option<[f64; 3]>,
    /// Mass (kg), from which and from the log's own hover thrust the thrust follows where it is not given.
    pub mass_kg: Option<f64>,
}

/// Standard gravity (m/s²).
const GRAVITY_M_S2: f64 = 9.80665;

/// A message that matters.
#[derive(Debug, Clone, Copy)]
enum Event {
    Motion { velocity_m_s: Option<[f64; 3]>, position_m: Option<[f64; 3]> },
    AngularVelocity([f64; 3]),
    Attitude([f64; 4]),
    Thrust([f64; 3]),
    Torque([f64; 3]),
    HoverThrust(f64),
    Landed(bool),
}

/// What a log holds, for people: topics with the number of their messages, and what was lost.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct UlogContents {
    /// Topics and the number of their messages.
    pub topics: BTreeMap<String, usize>,
    /// Gaps of the logger, and their length in all (ms).
    pub dropouts: usize,
    /// In all (ms).
    pub dropouts_ms: u64,
    /// Why reading ended before the end of the file, if it did.
    pub ended_by: Option<String>,
    /// The log's own estimate of the set-point that carries the weight.
    pub hover_thrust: Option<f64>,
}

/// Reads what matters, in the order of the file.
fn read(bytes: &[u8]) -> (Vec<(u64, Event)>, UlogContents) {
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
    (events, UlogContents { topics, dropouts, dropouts_ms, ended_by, hover_thrust })
}

/// Feeds the log: up to its appended sections, if it has some (of a crash), then those.
fn consume(parser: &mut LogParser<'_>, bytes: &[u8]) -> Result<(), String> {
    // Byte by byte until the header says where sections begin.
    let mut fed = 0;
    while fed < bytes.len() && !parser.header_complete() {
        parser.consume_bytes(&bytes[fed..=fed]).map_err(|error| error.to_string())?;
        fed += 1;
    }
    let mut starts: Vec<usize> = parser
        .appended_offsets()
        .iter()
        .filter_map(|&offset| usize::try_from(offset).ok())
        .filter(|&offset| offset > fed && offset < bytes.len())
        .collect();
    starts.sort_unstable();
    starts.dedup();
    starts.push(bytes.len());
    for end in starts {
        parser.consume_bytes(&bytes[fed..end]).map_err(|error| error.to_string())?;
        if parser.has_leftover() {
            parser.clear_leftover();
            if end == bytes.len() {
                return Err("the file ends within a message".into());
            }
        }
        fed = end;
    }
    Ok(())
}

/// The time (µs) and content of a message, if it matters and is whole.
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

/// What the log holds, without reading it as a flight.
pub fn ulog_contents(bytes: &[u8]) -> UlogContents {
    read(bytes).1
}

pub(super) fn parse(bytes: &[u8], path: &str, scales: &UlogScales) -> Result<RecordedFlight, ImportError> {
    let (mut events, contents) = read(bytes);
    if events.is_empty() {
        return Err(match contents.topics.is_empty() {
            true => ImportError::NoUlog {
                path: path.into(),
                found: contents.ended_by.unwrap_or_else(|| "no message".into()),
            },
            false => ImportError::MissingTopics {
                path: path.into(),
                found: contents.topics.into_keys().collect::<Vec<_>>().join(", "),
            },
        });
    }
    events.sort_by_key(|(stamp_us, _)| *stamp_us);
    let hover_n =
        contents.hover_thrust.zip(scales.mass_kg).map(|(hover, mass_kg)| mass_kg * GRAVITY_M_S2 / hover);
    let thrust_n = scales.thrust_n.or(hover_n);

    let mut flight = Collector::default();
    let mut attitude: Option<UnitQuaternion<f64>> = None;
    // What the vehicle is told before it is known how it lies.
    let mut thrusts_without_attitude = 0;
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
                    (Some(_), None) => thrusts_without_attitude += 1,
                    (None, _) => {}
                },
                Event::Torque(setpoint) => {
                    if let Some(torque_n_m) = scales.torque_n_m {
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
                Event::Attitude(_) | Event::HoverThrust(_) => {}
            }
        }
        if sample.valid != 0 {
            flight.add(stamp_us, i128::from(stamp_us) * 1000, sample);
        }
    }
    if let (Some(since_us), Some(&(last_us, _))) = (flying_since_us, events.last()) {
        airborne_us = longer(airborne_us, (since_us, last_us));
    }
    for _ in 0..thrusts_without_attitude {
        flight.skipped.add(SkipReason::NothingMeasured, 0);
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
