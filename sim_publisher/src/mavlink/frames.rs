//! Bytes into MAVLink frames, versions 1 and 2 mixed. Whatever else comes is skipped and counted.
//!
//! ```text
//! version 1: FE length sequence system component id        payload sum sum
//! version 2: FD length flags flags sequence system component id id id payload sum sum [signature of 13]
//! ```
//!
//! A frame that is whole is taken at once, whatever an unfinished one before it claims to be: half a packet delays
//! nothing. Signatures are not checked.

use mavlink::dialects::common::MavMessage;
use mavlink::{MavlinkVersion, Message, calculate_crc};

const MARKER_V1: u8 = 0xFE;
const MARKER_V2: u8 = 0xFD;
const HEADER_V1: usize = 6;
const HEADER_V2: usize = 10;
const SUM: usize = 2;
const SIGNATURE: usize = 13;
/// The one incompatibility flag that is understood: a signature follows. A frame with another must not be read.
const SIGNED: u8 = 1;
const LONGEST_PAYLOAD: usize = 255;

/// A frame whose sum is right.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// Of the protocol.
    pub version: MavlinkVersion,
    /// Of the sender, counts modulo 256.
    pub sequence: u8,
    /// Who sent it.
    pub system_id: u8,
    /// Which part of it.
    pub component_id: u8,
    /// Of the common message set.
    pub message_id: u32,
    payload: [u8; LONGEST_PAYLOAD],
    payload_length: usize,
}

impl Frame {
    /// As sent; version 2 leaves zeros at the end out.
    pub fn payload(&self) -> &[u8] {
        &self.payload[..self.payload_length]
    }
}

/// What came.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameTally {
    /// In all.
    pub bytes: u64,
    /// Frames whose sum was right.
    pub frames: u64,
    /// Of them, with a signature, which nobody checked.
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
    pub fn plus(self, other: Self) -> Self {
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

/// What the bytes from a marker on are.
enum Candidate {
    Whole(usize, Frame),
    WrongSum(usize),
    UnknownMessage(usize),
    Unfinished,
    Nothing,
}

/// Takes the bytes of one sender in any pieces.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// From the first byte that may still belong to a frame.
    bytes: Vec<u8>,
    tally: FrameTally,
}

impl Decoder {
    /// What came so far.
    pub fn tally(&self) -> FrameTally {
        self.tally
    }

    /// Adds bytes; then take all frames.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.tally.bytes += bytes.len() as u64;
        self.bytes.extend_from_slice(bytes);
    }

    /// Passes all frames that are whole to `take`. What stays is shorter than one frame.
    pub fn take_all(&mut self, mut take: impl FnMut(&Frame)) {
        let mut at = 0;
        while let Some(skipped) = self.bytes[at..].iter().position(|b| is_marker(*b)) {
            self.skip(&mut at, skipped);
            let rest = &self.bytes[at..];
            match candidate(rest) {
                Candidate::Whole(length, frame) => {
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
                Candidate::WrongSum(length) if rest.get(length).is_none_or(|b| is_marker(*b)) => {
                    match whole_within(rest, length) {
                        Some(offset) => self.skip(&mut at, offset),
                        None => {
                            self.tally.crc_failures += 1;
                            at += length;
                        }
                    }
                }
                Candidate::UnknownMessage(length) if rest.get(length).is_none_or(|b| is_marker(*b)) => {
                    match whole_within(rest, length) {
                        Some(offset) => self.skip(&mut at, offset),
                        None => {
                            self.tally.unknown_messages += 1;
                            at += length;
                        }
                    }
                }
                Candidate::WrongSum(_) | Candidate::UnknownMessage(_) | Candidate::Nothing => {
                    self.skip(&mut at, 1);
                }
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
        is_marker(bytes[offset]) && matches!(candidate(&bytes[offset..]), Candidate::Whole(..))
    })
}

fn candidate(bytes: &[u8]) -> Candidate {
    let (version, header) = match bytes[0] {
        MARKER_V1 => (MavlinkVersion::V1, HEADER_V1),
        _ => (MavlinkVersion::V2, HEADER_V2),
    };
    let is_v2 = version == MavlinkVersion::V2;
    if is_v2 && bytes.get(2).is_some_and(|flags| flags & !SIGNED != 0) {
        return Candidate::Nothing;
    }
    if bytes.len() < header {
        return Candidate::Unfinished;
    }
    let payload_length = usize::from(bytes[1]);
    let signature = if is_v2 && bytes[2] & SIGNED != 0 { SIGNATURE } else { 0 };
    let end = header + payload_length;
    let length = end + SUM + signature;
    if bytes.len() < length {
        return Candidate::Unfinished;
    }
    let (sequence, system_id, component_id, message_id) = match version {
        MavlinkVersion::V1 => (bytes[2], bytes[3], bytes[4], u32::from(bytes[5])),
        MavlinkVersion::V2 => {
            (bytes[4], bytes[5], bytes[6], u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]))
        }
    };
    if !MavMessage::all_ids().contains(&message_id) {
        return Candidate::UnknownMessage(length);
    }
    let sum = u16::from_le_bytes([bytes[end], bytes[end + 1]]);
    if calculate_crc(&bytes[1..end], MavMessage::extra_crc(message_id)) != sum {
        return Candidate::WrongSum(length);
    }
    let mut payload = [0; LONGEST_PAYLOAD];
    payload[..payload_length].copy_from_slice(&bytes[header..end]);
    let frame = Frame { version, sequence, system_id, component_id, message_id, payload, payload_length };
    Candidate::Whole(length, frame)
}
