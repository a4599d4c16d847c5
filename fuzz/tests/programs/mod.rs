//! Seeds that programs write and no fuzzing finds: a vehicle's frames, a flight record, a snapshot.
//!
//! They must stay what they are meant to be: a format that changes makes them mere garbage. To write them anew:
//! `cargo test -p fuzz write_the_seeds -- --ignored`.

use daemon::assemble;
use daemon::config::ConfigFile;
use daemon::engine::{Checkpoint, Engine};
use daemon::replay::check;
use daemon::snapshot::{Snapshot, meaning};
use daemon::threads::recorder::session;
use flight_record::{Entry, Frame, LoopCommand, MARK, Reader};
use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA,
    MavAutopilot, MavFrame, MavMessage, MavType, ODOMETRY_DATA,
};
use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader};
use mavlink_bridge::{Bridge, Settings};
use shared_types::Measurement;
use std::io::Cursor;
use std::path::PathBuf;

const START_NS: u64 = 1_000_000_000_000;
const PERIOD_NS: u64 = 5_000_000;

fn path(seed: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("seeds").join(seed)
}

fn read(seed: &str) -> Vec<u8> {
    let bytes = std::fs::read(path(seed)).unwrap_or_else(|error| panic!("{seed}: {error}"));
    assert!(bytes.len() < 20_000, "{seed}: {} bytes", bytes.len());
    bytes
}

#[test]
#[ignore = "writes the seeds"]
fn write_the_seeds() {
    let (config, entries, snapshot) = flown();
    let bodies = entries.iter().map(|entry| postcard::to_allocvec(&Frame::Entry(Box::new(*entry))).unwrap());
    let of_record = bodies.flat_map(|body| {
        let length = u16::try_from(body.len()).unwrap();
        [length.to_le_bytes().to_vec(), body].concat()
    });
    let whole = {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("flight");
        let mut writer =
            flight_record::Writer::append(&file, &session(&config.config, "vehicle", None)).unwrap();
        entries.iter().for_each(|entry| writer.push(entry).unwrap());
        writer.flush().unwrap();
        std::fs::read(file).unwrap()
    };
    for (seed, bytes) in [
        ("mavlink/stream", stream()),
        ("record/entries", of_record.collect()),
        ("record/whole", whole),
        ("snapshot/body", snapshot.encode()[HEADER..].to_vec()),
    ] {
        std::fs::create_dir_all(path(seed).parent().unwrap()).unwrap();
        std::fs::write(path(seed), bytes).unwrap();
    }
}

/// Bytes of a snapshot before its body, which is the seed: the target adds them.
const HEADER: usize = 16;

/// Ten ticks of the target's configuration: what the loop records of them, and a snapshot of the engine then.
fn flown() -> (ConfigFile, Vec<Entry>, Snapshot) {
    let file = ConfigFile::preset("paper-translation").unwrap();
    let mut engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
    let mut entries = Vec::new();
    for tick in 0..10 {
        let wake_ns = START_NS + tick * PERIOD_NS;
        entries.push(Entry::Begin { wake_ns, late_ticks_in_a_row: 0 });
        engine.begin(wake_ns, 0);
        let measurement =
            Measurement::at(wake_ns - 1_000_000, tick).with_velocity_m_s([1.0, 0.1 * tick as f64, 2.0]);
        entries.push(Entry::Sample { source: 1, measurement });
        engine.take(&measurement, 1);
        entries.push(Entry::Estimate(engine.conclude()));
        if tick == 5 {
            entries.push(Entry::Command(LoopCommand::Freeze));
            engine.carry_out(LoopCommand::Freeze);
        }
    }
    entries.push(Entry::Checkpoint);
    engine.save();
    let mut learned = vec![0.0; engine.n_learned()];
    engine.read_saved(0, &mut learned);
    let snapshot = Snapshot {
        program_version: "0".into(),
        instance: "vehicle".into(),
        made_unix_s: 1_700_000_000,
        boot_id: "boot".into(),
        stamp_ns: START_NS,
        samples_accepted: engine.counters().samples_accepted,
        meaning: meaning(&file.config),
        checkpoint: Checkpoint { learned, state: engine.saved_state() },
    };
    (file, entries, snapshot)
}

#[test]
fn the_seed_of_a_snapshot_is_one_that_an_engine_resumes_from() {
    let (file, _, snapshot) = flown();
    let body = read("snapshot/body");
    let head = &snapshot.encode()[..HEADER - 4];
    let whole = [head, &crc32fast::hash(&body).to_le_bytes(), &body].concat();
    let seed = Snapshot::decode(&whole).unwrap();
    assert!(seed.checkpoint.state.is_some() && seed.checkpoint.learned.iter().any(|number| *number != 0.0));
    assert_eq!(seed.differences(&file.config), Vec::<String>::new());
    Engine::new(&file.config, assemble::estimator(&file).unwrap()).load(&seed.checkpoint).unwrap();
}

#[test]
fn the_seeds_of_records_are_read_to_the_end_and_replayed() {
    let whole = read("record/whole");
    let (entries, behind) = {
        let (mut frames, mut rest) = (Vec::new(), &read("record/entries")[..]);
        while let Some((length, behind)) = rest.split_first_chunk() {
            let (body, behind) = behind.split_at(usize::from(u16::from_le_bytes(*length)));
            frames.push(postcard::from_bytes::<Frame>(body).unwrap());
            rest = behind;
        }
        (frames, rest.len())
    };
    assert_eq!(behind, 0);
    let mut reader = Reader::new(Cursor::new(&whole));
    assert!(whole.starts_with(MARK) && matches!(reader.next_frame().unwrap(), Some(Frame::Session(_))));
    for entry in entries {
        assert_eq!(reader.next_frame().unwrap(), Some(entry));
    }
    assert_eq!((reader.next_frame().unwrap(), reader.torn_bytes()), (None, 0));
    let reports = check(&mut Reader::new(Cursor::new(&whole))).unwrap();
    assert_eq!((reports.len(), reports[0].samples), (1, 10));
    // Made with one vector unit: with another, bits differ.
    assert!(reports[0].ticks_same > 0 || reports[0].vector_unit != observer::vector_unit(), "{reports:?}");
}

/// What the target takes: a source; then pieces, each with its delay (ms), its kind (raw bytes) and its length.
fn stream() -> Vec<u8> {
    const RAW: u8 = 255;
    let mut bytes = vec![0];
    let mut add = |delay_ms: usize, piece: &[u8]| {
        bytes.extend([delay_ms as u8, RAW, piece.len() as u8]);
        bytes.extend_from_slice(piece);
    };
    let mut frames = Vec::new();
    for (sequence, message) in messages().iter().enumerate() {
        let header = MavHeader { system_id: 1, component_id: 1, sequence: sequence as u8 };
        // Version 1 carries the messages that it has.
        if let MavMessage::ATTITUDE(_) = message {
            let mut frame = MAVLinkV1MessageRaw::new();
            frame.serialize_message(header, message);
            frames.push(frame.raw_bytes().to_vec());
        } else {
            let mut frame = MAVLinkV2MessageRaw::new();
            frame.serialize_message(header, message);
            frames.push(frame.raw_bytes().to_vec());
        }
    }
    let (datagrams, in_pieces) = frames.split_at(frames.len() / 2);
    datagrams.iter().for_each(|frame| add(10, frame));
    add(3, b"between two frames");
    in_pieces.concat().chunks(100).for_each(|piece| add(9, piece));
    bytes
}

fn messages() -> Vec<MavMessage> {
    let heartbeat = HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        ..HEARTBEAT_DATA::default()
    };
    let mut messages = vec![MavMessage::HEARTBEAT(heartbeat)];
    for j in 0..6_u16 {
        let (ms, v) = (50_000 + 10 * u32::from(j), 0.1 * f32::from(j));
        let [q1, q2, q3, q4] = [1.0, 0.0, 0.0, 0.0];
        messages.push(MavMessage::ODOMETRY(ODOMETRY_DATA {
            time_usec: u64::from(ms) * 1000,
            frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
            q: [q1, q2, q3, q4],
            vx: v,
            vz: 1.0,
            yawspeed: 0.2,
            ..ODOMETRY_DATA::default()
        }));
        messages.push(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: ms,
            vx: v,
            z: -10.0,
            ..LOCAL_POSITION_NED_DATA::default()
        }));
        messages.push(if j % 2 == 0 {
            MavMessage::ATTITUDE(ATTITUDE_DATA {
                time_boot_ms: ms,
                yawspeed: 0.2,
                ..ATTITUDE_DATA::default()
            })
        } else {
            let turning = ATTITUDE_QUATERNION_DATA::default();
            MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                time_boot_ms: ms,
                q1,
                q2,
                q3,
                q4,
                ..turning
            })
        });
        let target =
            ATTITUDE_TARGET_DATA { time_boot_ms: ms, q: [q1, q2, q3, q4], thrust: 0.5, ..Default::default() };
        messages.push(MavMessage::ATTITUDE_TARGET(target));
    }
    messages
}

#[test]
fn the_seed_of_a_vehicle_has_its_frames_and_gives_samples() {
    let seed = read("mavlink/stream");
    let (mut bridge, mut now_ns, mut n_samples) = (Bridge::new(Settings::default()), START_NS, 0);
    let mut rest = &seed[1..];
    while let [delay_ms, _, length, behind @ ..] = rest {
        now_ns += u64::from(*delay_ms) * 1_000_000;
        let (piece, behind) = behind.split_at(usize::from(*length));
        bridge.receive(piece, None, now_ns);
        bridge.poll(now_ns);
        n_samples += bridge.take_samples().len();
        rest = behind;
    }
    let tally = bridge.frame_tally();
    assert_eq!((tally.frames, tally.crc_failures), (messages().len() as u64, 0));
    assert!(tally.garbage_bytes > 0 && n_samples >= 5, "{tally:?}, {n_samples} samples");
}
