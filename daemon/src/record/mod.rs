//! The flight record: every sample, command and tick of the loop, in a file that replays to the same bits.
//!
//! ```text
//! loop ──Entry──▶ wait-free ring ──▶ recorder thread ──▶ FILE (appended)
//! ```
//!
//! Where the disk is slow the ring fills up, and whole ticks are left out and counted; the loop never waits. A file
//! is a sequence of sessions, one per start of the service:
//!
//! | bytes | what |
//! |---|---|
//! | 16 | session mark, before a [`Frame::Session`] only |
//! | 4 | length of the frame, little-endian |
//! | 4 | CRC-32 of the frame |
//! | … | [`Frame`] as postcard |
//!
//! What was torn by a kill is as long as one buffer at most; reading goes on at the next session's mark.

mod replay;

pub use replay::{Difference, SessionReport, check};

use crate::config::{Config, ConfigFile};
use crate::cycle::MOST_SAMPLES_PER_TICK;
use crate::engine::{Checkpoint, LoopCommand};
use crate::say;
use rustix::fs::{FlockOperation, OFlags, fcntl_setfl, flock};
use serde::{Deserialize, Serialize};
use shared_types::payload::{Estimate, Measurement};
use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The first four bytes, as a length, are more than any frame has.
const MARK: &[u8; 16] = b"\xff\xff\xff\xffflight-rec2\n";
const MARK_OF_VERSION_1: &[u8; 16] = b"\xff\xff\xff\xffflight-rec1\n";
/// A session with a million centers learned is some 24 MB.
const LONGEST_FRAME_BYTES: u64 = 1 << 30;
/// Entries of one tick beside its samples: begin, missing, estimate, commands, kept.
const ENTRIES_BESIDE_SAMPLES: usize = 16;
/// The ring holds this much time (s) at three entries a tick, up to some 2700 ticks a second.
const RING_S: f64 = 4.0;
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// What a kill can cost.
const FLUSH_EVERY: Duration = Duration::from_millis(100);
const BUFFER_BYTES: usize = 1 << 18;

/// One event of the loop, in its order.
#[allow(clippy::large_enum_variant)] // it travels by value: a box would be an allocation in the loop
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// A tick begins.
    Begin {
        /// When it woke (ns).
        wake_ns: u64,
        /// Ticks before it, in a row, that ended after their next deadline.
        late_ticks_in_a_row: u64,
    },
    /// A sample was taken.
    Sample {
        /// Whose.
        source: u128,
        /// As it arrived.
        measurement: Measurement,
    },
    /// What the tick published.
    Estimate(Estimate),
    /// A command was carried out after it.
    Command(LoopCommand),
    /// A checkpoint was saved after it.
    Kept,
    /// So many ticks are left out here.
    Missing(u64),
}

/// What a session begins with: all that its ticks depend on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Session {
    /// Version of the program that wrote it.
    pub program_version: String,
    /// Name of the vehicle.
    pub instance: String,
    /// The effective configuration, as TOML.
    pub config: String,
    /// The vector unit that the bits depend on.
    pub vector_unit: String,
    /// What was taken over from a snapshot.
    pub kept: Option<Checkpoint>,
}

/// What a file consists of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Frame {
    /// The service started.
    Session(Box<Session>),
    /// Something happened in it.
    Entry(Box<Entry>),
}

/// The same as [`Frame::Entry`], without a box.
#[derive(Serialize)]
enum FrameOf<'a> {
    Session(&'a Session),
    Entry(&'a Entry),
}

impl Session {
    /// A session of this configuration.
    pub fn of(config: &Config, instance: &str, kept: Option<&Checkpoint>) -> Self {
        Self {
            program_version: env!("CARGO_PKG_VERSION").into(),
            instance: instance.into(),
            config: toml::to_string(config).expect("a configuration is a TOML document"),
            vector_unit: observer::vector_unit().into(),
            kept: kept.cloned(),
        }
    }

    /// Its configuration.
    ///
    /// # Errors
    /// As [`ConfigFile::parse`]: it was written by another version.
    pub fn config_file(&self) -> Result<ConfigFile, crate::config::ConfigError> {
        ConfigFile::parse("the record's configuration".into(), self.config.clone())
    }
}

/// The loop's end of the ring; without a recorder it takes nothing.
pub struct RecorderRing {
    ring: Option<rtrb::Producer<Entry>>,
    /// Whether the present tick is left out.
    leaves_out: bool,
    /// Ticks left out since the last one that was not.
    missing: u64,
    left_out: u64,
}

impl RecorderRing {
    /// A ring that nobody reads: nothing is recorded.
    pub fn none() -> Self {
        Self { ring: None, leaves_out: true, missing: 0, left_out: 0 }
    }

    /// Begins a tick, which is taken as a whole or not at all.
    pub fn begin_tick(&mut self, begin: &Entry) {
        let Some(ring) = &mut self.ring else { return };
        self.leaves_out = ring.slots() < MOST_SAMPLES_PER_TICK + ENTRIES_BESIDE_SAMPLES;
        if self.leaves_out {
            self.missing += 1;
            self.left_out += 1;
            return;
        }
        if self.missing > 0 {
            let missing = std::mem::take(&mut self.missing);
            self.push(|| Entry::Missing(missing));
        }
        self.push(|| *begin);
    }

    /// Takes an event of the present tick.
    pub fn push(&mut self, entry: impl FnOnce() -> Entry) {
        if let Some(ring) = self.ring.as_mut().filter(|_| !self.leaves_out) {
            // There is room: it was looked for when the tick began.
            let _ = ring.push(entry());
        }
    }

    /// Ticks left out so far.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }
}

/// What the recorder thread has done, for the status.
#[derive(Debug, Default)]
pub struct RecorderProgress {
    /// Ticks in the file.
    pub written: AtomicU64,
    /// Ticks that could not be written.
    pub failed: AtomicU64,
}

/// The recorder thread's end.
pub struct Recorder {
    file: BufWriter<File>,
    ring: rtrb::Consumer<Entry>,
    frame: Vec<u8>,
    /// Ticks in the buffer that are not yet in the file.
    pending_ticks: u64,
    progress: Arc<RecorderProgress>,
    /// A write failed: what could still be written would stand behind half a frame, where nobody finds it.
    is_broken: bool,
}

/// Opens or makes the file, appends the session, and gives both ends.
///
/// # Errors
/// The system's reason.
pub fn recorder(
    path: &Path,
    session: &Session,
    rate_hz: f64,
) -> io::Result<(RecorderRing, Recorder, Arc<RecorderProgress>)> {
    let file = open_to_append(path)?;
    let entries = (3.0 * RING_S * rate_hz) as usize;
    let (mut ring, mut taken) = rtrb::RingBuffer::new(entries.clamp(4096, 32_768));
    // The pages are there before the loop writes to them.
    while ring.push(Entry::Kept).is_ok() {}
    while taken.pop().is_ok() {}
    let progress = Arc::<RecorderProgress>::default();
    let mut recorder = Recorder {
        file: BufWriter::with_capacity(BUFFER_BYTES, file),
        ring: taken,
        frame: Vec::new(),
        pending_ticks: 0,
        progress: Arc::clone(&progress),
        is_broken: false,
    };
    recorder.file.write_all(MARK)?;
    recorder.write(&FrameOf::Session(session))?;
    recorder.file.flush()?;
    Ok((RecorderRing { ring: Some(ring), leaves_out: false, missing: 0, left_out: 0 }, recorder, progress))
}

/// A record of ours, an empty file, or a pipe with a reader; nothing else is appended to.
fn open_to_append(path: &Path) -> io::Result<File> {
    // A pipe that nobody reads is refused, not waited for.
    let flags = OFlags::NONBLOCK | OFlags::CLOEXEC;
    let mut options = OpenOptions::new();
    options.append(true).create(true).mode(0o600).custom_flags(flags.bits() as i32);
    let file = options.open(path)?;
    fcntl_setfl(&file, OFlags::APPEND)?;
    if !file.metadata()?.is_file() {
        return Ok(file);
    }
    let mut start = Vec::new();
    File::open(path)?.take(MARK.len() as u64).read_to_end(&mut start)?;
    if !start.is_empty() && !MARK.starts_with(&start) {
        return Err(io::Error::other("it is no flight record of this version, and would be spoiled"));
    }
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Err(rustix::io::Errno::WOULDBLOCK) => Err(io::Error::other("another service writes it")),
        locked => locked.map(|()| file).map_err(io::Error::from),
    }
}

impl Recorder {
    /// Writes what comes until `stop`, and then what is left.
    pub fn run(mut self, stop: &AtomicBool) {
        let mut last_flush = Instant::now();
        loop {
            // Looked at first: what was pushed before the stop is in the ring now.
            let is_last = stop.load(Ordering::Acquire);
            while let Ok(entry) = self.ring.pop() {
                let is_tick = u64::from(matches!(entry, Entry::Estimate(_)));
                if self.is_broken {
                    self.progress.failed.fetch_add(is_tick, Ordering::Relaxed);
                    continue;
                }
                let written = self.write(&FrameOf::Entry(&entry));
                self.pending_ticks += is_tick;
                self.note(written);
            }
            if !self.is_broken && (is_last || last_flush.elapsed() >= FLUSH_EVERY) {
                last_flush = Instant::now();
                let flushed = self.file.flush();
                let is_flushed = flushed.is_ok();
                self.note(flushed);
                if is_flushed {
                    self.progress
                        .written
                        .fetch_add(std::mem::take(&mut self.pending_ticks), Ordering::Relaxed);
                }
            }
            if is_last {
                let synced = self.file.get_ref().sync_all();
                self.note(synced);
                return;
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    fn write(&mut self, frame: &FrameOf<'_>) -> io::Result<()> {
        self.frame.clear();
        self.frame = postcard::to_extend(frame, std::mem::take(&mut self.frame)).expect("numbers and texts");
        let length = u32::try_from(self.frame.len()).map_err(io::Error::other)?;
        self.file.write_all(&length.to_le_bytes())?;
        self.file.write_all(&crc32fast::hash(&self.frame).to_le_bytes())?;
        self.file.write_all(&self.frame)
    }

    /// A pipe or a special file cannot be synced, and need not be.
    fn note(&mut self, done: io::Result<()>) {
        let Err(error) = done else { return };
        if error.kind() == io::ErrorKind::InvalidInput {
            return;
        }
        self.progress.failed.fetch_add(std::mem::take(&mut self.pending_ticks), Ordering::Relaxed);
        if !std::mem::replace(&mut self.is_broken, true) {
            say!(
                "warning: the flight record ends here: {error}; all further ticks are counted as not recorded"
            );
        }
    }
}

/// Reads a file frame by frame. What is torn is skipped up to the next session, and counted.
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
    /// The system's reason.
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
                if header == MARK_OF_VERSION_1 {
                    return Err(io::Error::other(
                        "a flight record of version 1; this program reads version 2; needed: the program that wrote it",
                    ));
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
        if sum.len() < 4 || length > LONGEST_FRAME_BYTES {
            return Ok(None);
        }
        // Read as it comes, and not reserved: a damaged length asks for anything.
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

    /// Goes on at the first mark after the start of what is no frame, or at the end.
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
    use std::io::Cursor;

    fn bytes_of(frames: &[Entry]) -> Vec<u8> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("flight.rec");
        let config = ConfigFile::preset("auv").unwrap().config;
        let session = Session::of(&config, "vehicle", None);
        let (mut ring, recorder, progress) = recorder(&path, &session, 200.0).unwrap();
        ring.begin_tick(&Entry::Kept);
        frames.iter().for_each(|entry| ring.push(|| *entry));
        recorder.run(&AtomicBool::new(true));
        assert_eq!(progress.failed.load(Ordering::Relaxed), 0);
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

    fn entries() -> Vec<Entry> {
        let measurement = Measurement::at(77, 3).with_velocity_m_s([1.0, f64::NAN, -0.0]);
        vec![
            Entry::Begin { wake_ns: 5, late_ticks_in_a_row: 1 },
            Entry::Sample { source: u128::MAX, measurement },
            Entry::Command(LoopCommand::Freeze),
            Entry::Missing(7),
        ]
    }

    #[test]
    fn a_record_of_version_1_is_refused_by_name() {
        let error = Reader::new(Cursor::new(MARK_OF_VERSION_1)).next_frame().unwrap_err().to_string();
        assert!(error.contains("version 1") && error.contains("reads version 2"), "{error}");
    }

    #[test]
    fn what_is_recorded_is_read() {
        let (frames, torn) = read(&bytes_of(&entries()));
        assert_eq!((frames.len(), torn), (6, 0));
        assert!(matches!(&frames[0], Frame::Session(session) if session.instance == "vehicle"
            && session.config_file().unwrap().config == ConfigFile::preset("auv").unwrap().config));
        let Frame::Entry(entry) = &frames[3] else { panic!("{:?}", frames[3]) };
        let Entry::Sample { source, measurement } = **entry else { panic!("{entry:?}") };
        assert_eq!((source, measurement.sequence), (u128::MAX, 3));
        assert_eq!(measurement.velocity_m_s[1].to_bits(), f64::NAN.to_bits());
        assert!(measurement.velocity_m_s[2].is_sign_negative());
    }

    /// Cut at any byte, with another session after the tear: all whole frames before it, and all of the other session.
    #[test]
    fn a_tear_costs_what_is_torn_and_no_more() {
        let whole = bytes_of(&entries());
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

    #[test]
    fn a_damaged_byte_is_noticed() {
        let whole = bytes_of(&entries());
        let (frames, _) = read(&whole);
        for place in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x10;
            let (found, torn_bytes) = read(&damaged);
            // A session frame is found without its mark, too.
            assert!(found.len() < frames.len() && torn_bytes > 0, "{place}: {}", found.len());
        }
    }

    #[test]
    fn a_tick_is_taken_whole_or_left_out_and_counted() {
        let (ring, mut taken) = rtrb::RingBuffer::new(MOST_SAMPLES_PER_TICK + ENTRIES_BESIDE_SAMPLES + 2);
        let mut ring = RecorderRing { ring: Some(ring), leaves_out: false, missing: 0, left_out: 0 };
        let tick = |ring: &mut RecorderRing| {
            ring.begin_tick(&Entry::Begin { wake_ns: 0, late_ticks_in_a_row: 0 });
            ring.push(|| Entry::Kept);
        };
        (0..5).for_each(|_| tick(&mut ring));
        assert_eq!(ring.left_out(), 3);
        let entries: Vec<_> = std::iter::from_fn(|| taken.pop().ok()).collect();
        assert_eq!(entries.len(), 4);
        tick(&mut ring);
        assert_eq!(taken.pop(), Ok(Entry::Missing(3)));
        assert_eq!(ring.left_out(), 3);
    }
}
