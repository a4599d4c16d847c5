//! Finds MAVLink frames, of versions 1 and 2 mixed, in a stream of bytes. Other bytes are skipped and counted.
//!
//! ```text
//! version 1: FE length sequence system component id        payload sum sum
//! version 2: FD length flags flags sequence system component id id id payload sum sum [signature of 13]
//! ```
//!
//! A complete frame is taken at once, even if an incomplete one that seems to contain it came first: half a packet delays no
//! other frame. Signatures are not checked.

use mavlink::dialects::common::MavMessage;
use mavlink::{MavlinkVersion, Message, calculate_crc};
use std::net::SocketAddr;

const MARKER_V1: u8 = 0xFE;
const MARKER_V2: u8 = 0xFD;
const HEADER_V1: usize = 6;
const HEADER_V2: usize = 10;
const SUM: usize = 2;
const SIGNATURE: usize = 13;
/// The one incompatibility flag that is understood: a signature follows. A frame with another must not be read.
const SIGNED: u8 = 1;
const MAX_PAYLOAD_BYTES: usize = 255;

/// Where bytes come from: an address, or `None` for the one other end of a serial line.
pub type Peer = Option<SocketAddr>;

/// A frame with a correct check sum.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    /// Of the protocol.
    pub version: MavlinkVersion,
    /// Of the sender, counts modulo 256.
    pub sequence: u8,
    /// The system that sent it.
    pub system_id: u8,
    /// The component of that system.
    pub component_id: u8,
    /// Of the common message set.
    pub message_id: u32,
    payload: [u8; MAX_PAYLOAD_BYTES],
    payload_length: usize,
}

impl Frame {
    /// As sent; version 2 leaves zeros at the end out.
    pub(crate) fn payload(&self) -> &[u8] {
        &self.payload[..self.payload_length]
    }
}

/// What came.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameTally {
    /// All bytes.
    pub bytes: u64,
    /// Frames whose sum was right.
    pub frames: u64,
    /// Of them, with a signature, which is not checked.
    pub signed: u64,
    /// Bytes of no frame.
    pub garbage_bytes: u64,
    /// Frames whose sum was wrong.
    pub crc_failures: u64,
    /// Frames of messages that the common set does not have: their sum cannot be checked.
    pub unknown_messages: u64,
}

impl FrameTally {
    /// Both together.
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            bytes: self.bytes + other.bytes,
            frames: self.frames + other.frames,
            signed: self.signed + other.signed,
            garbage_bytes: self.garbage_bytes + other.garbage_bytes,
            crc_failures: self.crc_failures + other.crc_failures,
            unknown_messages: self.unknown_messages + other.unknown_messages,
        }
    }
}

/// The kind of the bytes that begin with a marker.
enum Candidate {
    Whole(usize),
    /// With a wrong sum, or a message without a known one.
    Unverified {
        length: usize,
        is_known: bool,
    },
    Unfinished,
    Nothing,
}

/// Takes the bytes of one sender in any pieces.
#[derive(Debug, Clone, Default)]
pub(crate) struct Decoder {
    /// From the first byte that may still belong to a frame.
    bytes: Vec<u8>,
    tally: FrameTally,
}

impl Decoder {
    /// What came so far.
    pub(crate) fn tally(&self) -> FrameTally {
        self.tally
    }

    /// Adds bytes; then take all frames.
    pub(crate) fn feed(&mut self, bytes: &[u8]) {
        self.tally.bytes += bytes.len() as u64;
        self.bytes.extend_from_slice(bytes);
    }

    /// Passes all complete frames to `take`. The remaining bytes are fewer than one frame has.
    pub(crate) fn take_all(&mut self, mut take: impl FnMut(&Frame)) {
        let mut at = 0;
        while let Some(skipped) = self.bytes[at..].iter().position(|b| is_marker(*b)) {
            self.skip(&mut at, skipped);
            let rest = &self.bytes[at..];
            match candidate(rest) {
                Candidate::Whole(length) => {
                    let mut frame = header(rest);
                    let end = frame_length(&frame) - SUM;
                    let payload = &rest[end - frame.payload_length..end];
                    frame.payload[..payload.len()].copy_from_slice(payload);
                    self.tally.frames += 1;
                    self.tally.signed += u64::from(length > frame_length(&frame));
                    at += length;
                    take(&frame);
                }
                Candidate::Unfinished => match whole_within(rest, rest.len()) {
                    Some(offset) => self.skip(&mut at, offset),
                    None => {
                        self.bytes.drain(..at);
                        return;
                    }
                },
                // Believed to be a frame where another one, or nothing, follows it.
                Candidate::Unverified { length, is_known }
                    if rest.get(length).is_none_or(|b| is_marker(*b)) =>
                {
                    match whole_within(rest, length) {
                        Some(offset) => self.skip(&mut at, offset),
                        None => {
                            self.tally.crc_failures += u64::from(is_known);
                            self.tally.unknown_messages += u64::from(!is_known);
                            at += length;
                        }
                    }
                }
                Candidate::Unverified { .. } | Candidate::Nothing => self.skip(&mut at, 1),
            }
        }
        self.tally.garbage_bytes += (self.bytes.len() - at) as u64;
        self.bytes.clear();
    }

    fn skip(&mut self, at: &mut usize, n: usize) {
        self.tally.garbage_bytes += n as u64;
        *at += n;
    }
}

fn is_marker(byte: u8) -> bool {
    matches!(byte, MARKER_V1 | MARKER_V2)
}

/// Without a signature.
fn frame_length(frame: &Frame) -> usize {
    let header = if frame.version == MavlinkVersion::V1 { HEADER_V1 } else { HEADER_V2 };
    header + frame.payload_length + SUM
}

/// Where, after the first byte and before `end`, a whole frame begins.
fn whole_within(bytes: &[u8], end: usize) -> Option<usize> {
    (1..end).find(|&offset| {
        is_marker(bytes[offset]) && matches!(candidate(&bytes[offset..]), Candidate::Whole(_))
    })
}

/// The header's fields of a frame that is at least as long as its header.
fn header(bytes: &[u8]) -> Frame {
    let mut frame = Frame {
        version: MavlinkVersion::V1,
        sequence: bytes[2],
        system_id: bytes[3],
        component_id: bytes[4],
        message_id: u32::from(bytes[5]),
        payload: [0; MAX_PAYLOAD_BYTES],
        payload_length: usize::from(bytes[1]),
    };
    if bytes[0] == MARKER_V2 {
        frame.version = MavlinkVersion::V2;
        [frame.sequence, frame.system_id, frame.component_id] = [bytes[4], bytes[5], bytes[6]];
        frame.message_id = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
    }
    frame
}

fn candidate(bytes: &[u8]) -> Candidate {
    let is_v2 = bytes[0] == MARKER_V2;
    if is_v2 && bytes.get(2).is_some_and(|flags| flags & !SIGNED != 0) {
        return Candidate::Nothing;
    }
    if bytes.len() < if is_v2 { HEADER_V2 } else { HEADER_V1 } {
        return Candidate::Unfinished;
    }
    let frame = header(bytes);
    let signature = if is_v2 && bytes[2] & SIGNED != 0 { SIGNATURE } else { 0 };
    let length = frame_length(&frame) + signature;
    if bytes.len() < length {
        return Candidate::Unfinished;
    }
    if !MavMessage::all_ids().contains(&frame.message_id) {
        return Candidate::Unverified { length, is_known: false };
    }
    let end = frame_length(&frame) - SUM;
    let sum = u16::from_le_bytes([bytes[end], bytes[end + 1]]);
    if calculate_crc(&bytes[1..end], MavMessage::extra_crc(frame.message_id)) != sum {
        return Candidate::Unverified { length, is_known: true };
    }
    Candidate::Whole(length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{ATTITUDE_DATA, HEARTBEAT_DATA, ODOMETRY_DATA};
    use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader};
    use proptest::prelude::*;

    fn v2(sequence: u8, message: &MavMessage) -> Vec<u8> {
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message(MavHeader { system_id: 1, component_id: 1, sequence }, message);
        frame.raw_bytes().to_vec()
    }

    fn v1(sequence: u8, message: &MavMessage) -> Vec<u8> {
        let mut frame = MAVLinkV1MessageRaw::new();
        frame.serialize_message(MavHeader { system_id: 1, component_id: 1, sequence }, message);
        frame.raw_bytes().to_vec()
    }

    fn odometry(sequence: u8) -> Vec<u8> {
        // A marker in the middle of it, and no zero at its end.
        let message = ODOMETRY_DATA { time_usec: 0xFDFE_FDFE, quality: 1, ..ODOMETRY_DATA::default() };
        v2(sequence, &MavMessage::ODOMETRY(message))
    }

    fn attitude(sequence: u8) -> Vec<u8> {
        v1(
            sequence,
            &MavMessage::ATTITUDE(ATTITUDE_DATA {
                time_boot_ms: 7,
                yawspeed: 1.0,
                ..ATTITUDE_DATA::default()
            }),
        )
    }

    /// Longer than every frame: 10 + 255 + 2 + 13 bytes.
    const TOO_MANY_BYTES: usize = 300;

    /// Sequences of what is found when the bytes come in pieces of this size.
    fn found(bytes: &[u8], piece: usize) -> (Vec<u8>, FrameTally) {
        let (mut decoder, mut sequences) = (Decoder::default(), Vec::new());
        for piece in bytes.chunks(piece) {
            decoder.feed(piece);
            decoder.take_all(|frame| sequences.push(frame.sequence));
            assert!(decoder.bytes.len() < TOO_MANY_BYTES, "{} bytes kept", decoder.bytes.len());
        }
        (sequences, decoder.tally())
    }

    /// Written by pymavlink 2.4.50: heartbeat_send(2, 12, 81, 0, 4) of system 1, component 1, once in each version.
    const HEARTBEATS: [u8; 38] = [
        0xfd, 9, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2, 12, 81, 4, 3, 0x1b, 0x74, //
        0xfe, 9, 1, 1, 1, 0, 0, 0, 0, 0, 2, 12, 81, 4, 3, 0x6b, 0xc9,
    ];

    #[test]
    fn frames_of_pymavlink_are_read_in_both_versions() {
        let (sequences, tally) = found(&HEARTBEATS, HEARTBEATS.len());
        assert_eq!((sequences, tally.garbage_bytes, tally.crc_failures), (vec![0, 1], 0, 0));
    }

    #[test]
    fn frames_are_found_in_pieces_of_any_size() {
        let bytes = [odometry(1), attitude(2), odometry(3)].concat();
        for piece in 1..bytes.len() {
            let (sequences, tally) = found(&bytes, piece);
            assert_eq!(sequences, [1, 2, 3], "in pieces of {piece}");
            assert_eq!((tally.frames, tally.garbage_bytes, tally.crc_failures), (3, 0, 0));
            assert_eq!(tally.bytes, bytes.len() as u64);
        }
    }

    #[test]
    fn half_a_packet_delays_and_hides_nothing() {
        for length in 1..odometry(9).len() {
            let half = &odometry(9)[..length];
            let (mut decoder, mut sequences) = (Decoder::default(), Vec::new());
            for bytes in [half, &attitude(1)] {
                decoder.feed(bytes);
                decoder.take_all(|frame| sequences.push(frame.sequence));
            }
            assert_eq!(sequences, [1], "after {length} bytes");
            assert_eq!(decoder.tally().garbage_bytes, length as u64);
        }
    }

    #[test]
    fn a_wrong_sum_and_an_unknown_message_are_counted_as_such() {
        let mut wrong = odometry(1);
        *wrong.last_mut().unwrap() ^= 1;
        let unknown = [0xFD, 2, 0, 0, 0, 1, 1, 163, 0, 0, 5, 6, 0xAA, 0xBB];
        let (sequences, tally) = found(&[&wrong[..], &attitude(2), &unknown, &odometry(3)].concat(), 1 << 16);
        assert_eq!(sequences, [2, 3]);
        assert_eq!((tally.crc_failures, tally.unknown_messages, tally.garbage_bytes), (1, 1, 0));
    }

    #[test]
    fn a_signed_frame_is_read_and_one_with_another_flag_is_not() {
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let mut signed = v2(1, &heartbeat);
        signed[2] = SIGNED;
        let end = signed.len() - SUM;
        let sum = calculate_crc(&signed[1..end], MavMessage::extra_crc(0));
        signed[end..].copy_from_slice(&sum.to_le_bytes());
        signed.extend([7; SIGNATURE]);
        let mut strange = v2(2, &heartbeat);
        strange[2] = 4;
        let end = strange.len() - SUM;
        let sum = calculate_crc(&strange[1..end], MavMessage::extra_crc(0));
        strange[end..].copy_from_slice(&sum.to_le_bytes());
        let (sequences, tally) = found(&[&signed[..], &strange, &attitude(3)].concat(), 1 << 16);
        assert_eq!((sequences, tally.signed), (vec![1, 3], 1));
        assert_eq!(tally.garbage_bytes, strange.len() as u64);
    }

    /// Bytes before a true frame that take its first two bytes as their sum.
    #[test]
    fn a_frame_that_noise_forms_hides_one_true_frame_at_most() {
        let sum = u16::from_le_bytes([odometry(0)[0], odometry(0)[1]]);
        let made_up = |free: u16| {
            let [low, high] = free.to_le_bytes();
            [MARKER_V2, 2, 0, 0, 9, 7, 1, 0, 0, 0, low, high]
        };
        // The sum is a bijection of two bytes, so one fits.
        let fits = |noise: &[u8; 12]| calculate_crc(&noise[1..], MavMessage::extra_crc(0)) == sum;
        let noise = (0..=u16::MAX).map(made_up).find(fits).unwrap();
        let (mut decoder, mut found) = (Decoder::default(), Vec::new());
        for bytes in [&noise[..], &odometry(0), &odometry(1)] {
            decoder.feed(bytes);
            decoder.take_all(|frame| found.push((frame.system_id, frame.sequence)));
        }
        assert_eq!(found, [(7, 9), (1, 1)]);
        assert_eq!(decoder.tally().garbage_bytes, odometry(0).len() as u64 - 2);
    }

    proptest! {
        #[test]
        fn random_bytes_between_frames_lose_none_and_every_byte_is_accounted_for(
            noise in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 1..6),
            piece in 1usize..400,
        ) {
            let mut bytes = Vec::new();
            for (sequence, noise) in noise.iter().enumerate() {
                bytes.extend_from_slice(noise);
                bytes.extend(odometry(sequence as u8));
            }
            // As datagrams come: whole.
            let (mut decoder, mut sequences) = (Decoder::default(), Vec::new());
            for (sequence, noise) in noise.iter().enumerate() {
                for bytes in [noise, &odometry(sequence as u8)] {
                    decoder.feed(bytes);
                    decoder.take_all(|frame| sequences.push((frame.system_id, frame.sequence)));
                    prop_assert!(decoder.bytes.len() < TOO_MANY_BYTES, "{} bytes kept", decoder.bytes.len());
                }
            }
            // Noise has the sum of a frame in one of 65 536 cases. Such a frame may end within a true one, which is lost.
            let n_found = sequences.len();
            sequences.retain(|(system_id, _)| *system_id == 1);
            let n_made_up = n_found - sequences.len();
            prop_assert!(sequences.is_sorted_by(|a, b| a < b) && sequences.len() <= noise.len(), "{sequences:?}");
            prop_assert!(noise.len() - sequences.len() <= n_made_up, "{sequences:?}, {n_made_up} made up");
            // As a line gives them: in any pieces. No frame is made up, and no more bytes are kept than one frame has.
            let (sequences, tally) = found(&bytes, piece);
            prop_assert!(sequences.len() <= noise.len() + 1);
            prop_assert!(tally.garbage_bytes <= tally.bytes && tally.bytes == bytes.len() as u64);
        }
    }
}
