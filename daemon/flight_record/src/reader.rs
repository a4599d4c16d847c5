//! Reads a record frame by frame. Torn frames are skipped and counted.

use crate::frame::Frame;
use crate::mark::{MARK, check_version};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// A session that resumes a million centers is some 24 MB.
const MAX_FRAME_BYTES: u64 = 1 << 30;
const BUFFER_BYTES: usize = 1 << 18;

/// Reads a file frame by frame. Torn places are skipped up to the next session, and counted.
#[derive(Debug)]
pub struct Reader<R> {
    input: BufReader<R>,
    /// Where the next frame, or mark, begins.
    position: u64,
    torn_bytes: u64,
}

impl Reader<File> {
    /// Opens a file.
    ///
    /// # Errors
    /// The system's reason.
    pub fn open(path: &Path) -> io::Result<Self> {
        File::open(path).map(Self::new)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Reads from the start of a record.
    pub fn new(input: R) -> Self {
        Self { input: BufReader::with_capacity(BUFFER_BYTES, input), position: 0, torn_bytes: 0 }
    }

    /// Bytes that are no frames.
    pub fn torn_bytes(&self) -> u64 {
        self.torn_bytes
    }

    /// The next whole frame; `None` at the end.
    ///
    /// # Errors
    /// The system's reason, or the file begins as a record of another version ([`crate::OtherVersion`]).
    pub fn next_frame(&mut self) -> io::Result<Option<Frame>> {
        loop {
            let mut header = Vec::with_capacity(MARK.len());
            self.input.by_ref().take(8).read_to_end(&mut header)?;
            if header.is_empty() {
                return Ok(None);
            }
            if header == MARK[..8] {
                self.input.by_ref().take(8).read_to_end(&mut header)?;
                if header == MARK {
                    self.position += MARK.len() as u64;
                    continue;
                }
                // A file is of one version: another digit further on is damage, which costs one session.
                if self.position == 0 {
                    check_version(&header)?;
                }
            } else if let Some(frame) = self.frame(&header)? {
                return Ok(Some(frame));
            }
            self.skip_to_mark()?;
        }
    }

    /// The frame after this header, if it is whole.
    fn frame(&mut self, header: &[u8]) -> io::Result<Option<Frame>> {
        let Some((length, sum)) = header.split_first_chunk::<4>() else { return Ok(None) };
        let length = u64::from(u32::from_le_bytes(*length));
        if sum.len() < 4 || length > MAX_FRAME_BYTES {
            return Ok(None);
        }
        // Memory grows with the bytes that are read and is not reserved, since a damaged length may be anything.
        let mut bytes = Vec::new();
        self.input.by_ref().take(length).read_to_end(&mut bytes)?;
        if bytes.len() as u64 != length || crc32fast::hash(&bytes).to_le_bytes() != sum {
            return Ok(None);
        }
        let frame = postcard::from_bytes(&bytes).ok();
        if frame.is_some() {
            self.position += 8 + length;
        }
        Ok(frame)
    }

    /// Continues at the first mark after the start of the torn frame, or at the end.
    fn skip_to_mark(&mut self) -> io::Result<()> {
        let from = self.position;
        self.position = self.input.seek(SeekFrom::Start(from + 1))?;
        let mut window = Vec::new();
        loop {
            let got = self.input.by_ref().take(BUFFER_BYTES as u64).read_to_end(&mut window)?;
            if let Some(place) = window.windows(MARK.len()).position(|bytes| bytes == MARK) {
                self.position += place as u64;
                break;
            }
            if got == 0 {
                self.position += window.len() as u64;
                break;
            }
            // The mark may lie across two reads.
            let done = window.len().saturating_sub(MARK.len() - 1);
            window.drain(..done);
            self.position += done as u64;
        }
        self.torn_bytes += self.position - from;
        self.input.seek(SeekFrom::Start(self.position))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Entry, LoopCommand, OtherVersion, Session, VERSION, Writer};
    use shared_types::Measurement;
    use std::io::Cursor;

    fn session() -> Session {
        Session {
            program_version: "1.2.3".into(),
            instance: "vehicle".into(),
            config: "rate_hz = 200.0\n".into(),
            vector_unit: "scalar".into(),
            checkpoint: Some(vec![1, 2, 3]),
        }
    }

    fn entries() -> Vec<Entry> {
        let measurement = Measurement::at(77, 3).with_velocity_m_s([1.0, f64::NAN, -0.0]);
        vec![
            Entry::Checkpoint,
            Entry::Begin { wake_ns: 5, late_ticks_in_a_row: 1 },
            Entry::Sample { source: u128::MAX, measurement },
            Entry::Command(LoopCommand::Freeze),
            Entry::Missing(7),
        ]
    }

    /// A record of one session with these entries.
    fn record() -> Vec<u8> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("flight.rec");
        let mut writer = Writer::append(&path, &session()).unwrap();
        entries().iter().for_each(|entry| writer.push(entry).unwrap());
        writer.flush().unwrap();
        std::fs::read(path).unwrap()
    }

    fn read(bytes: &[u8]) -> (Vec<Frame>, u64) {
        let mut reader = Reader::new(Cursor::new(bytes));
        let mut frames = Vec::new();
        while let Some(frame) = reader.next_frame().unwrap() {
            frames.push(frame);
        }
        (frames, reader.torn_bytes())
    }

    #[test]
    fn written_frames_are_read_to_the_bit() {
        let (frames, torn) = read(&record());
        assert_eq!((frames.len(), torn), (6, 0));
        assert_eq!(frames[0], Frame::Session(Box::new(session())));
        let Frame::Entry(entry) = &frames[3] else { panic!("{:?}", frames[3]) };
        let Entry::Sample { source, measurement } = **entry else { panic!("{entry:?}") };
        assert_eq!((source, measurement.sequence), (u128::MAX, 3));
        assert_eq!(measurement.velocity_m_s[1].to_bits(), f64::NAN.to_bits());
        assert!(measurement.velocity_m_s[2].is_sign_negative());
    }

    /// Cut at any byte, with another session after the tear: all whole frames before it, and all of the other session.
    #[test]
    fn a_tear_costs_the_torn_session_s_end_and_no_more() {
        let whole = record();
        let (frames, _) = read(&whole);
        let mut least = usize::MAX;
        for length in (1..whole.len()).rev() {
            let (before, _) = read(&whole[..length]);
            // NaN is equal to nothing: texts are compared.
            assert_eq!(format!("{before:?}"), format!("{:?}", &frames[..before.len()]), "{length}");
            assert!(before.len() <= least, "{length}");
            least = before.len();
            let mut torn = whole[..length].to_vec();
            torn.extend_from_slice(&whole);
            let (found, torn_bytes) = read(&torn);
            assert_eq!(found.len(), before.len() + frames.len(), "{length}");
            assert!(torn_bytes < whole.len() as u64);
        }
        assert_eq!(least, 0);
    }

    /// Each byte of the second of three sessions, changed to another digit where it is one, too.
    #[test]
    fn a_damaged_byte_costs_the_rest_of_its_session_and_no_more() {
        let whole = record();
        let (frames, _) = read(&whole);
        for (place, bit) in (0..whole.len()).flat_map(|place| [(place, 0x01), (place, 0x10)]) {
            let mut damaged = whole.repeat(3);
            damaged[whole.len() + place] ^= bit;
            let (found, torn_bytes) = read(&damaged);
            let n = frames.len();
            assert!((2 * n..3 * n).contains(&found.len()) && torn_bytes > 0, "{place}: {}", found.len());
        }
    }

    #[test]
    fn a_damaged_byte_of_the_first_session_is_noticed() {
        let whole = record();
        let (frames, _) = read(&whole);
        for (place, bit) in (0..whole.len()).flat_map(|place| [(place, 0x01), (place, 0x10)]) {
            let mut damaged = whole.clone();
            damaged[place] ^= bit;
            if (place, bit) == (14, 0x01) {
                // The version's digit is another digit: that record cannot be told from one of another version.
                Reader::new(Cursor::new(damaged)).next_frame().unwrap_err();
                continue;
            }
            let (found, torn_bytes) = read(&damaged);
            assert!(found.len() < frames.len() && torn_bytes > 0, "{place}: {}", found.len());
        }
    }

    #[test]
    fn a_record_of_another_version_is_refused_by_reader_and_writer() {
        let mut older = record();
        older[14] = b'1';
        let read = Reader::new(Cursor::new(&older)).next_frame().unwrap_err();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("flight.rec");
        std::fs::write(&path, &older).unwrap();
        let written = Writer::append(&path, &session()).unwrap_err();
        for error in [read, written] {
            assert_eq!(OtherVersion::in_error(&error), Some(OtherVersion { found: '1' }));
            let sentence = error.to_string();
            assert!(sentence.contains(&format!("of version 1; needed: version {VERSION}")), "{sentence}");
        }
        assert_eq!(std::fs::read(&path).unwrap(), older);
    }
}
