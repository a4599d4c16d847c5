//! `monitor record`: writes all messages of an instance to an MCAP file.
//!
//! One thread reads shared memory and another writes, so a disk that stalls for seconds delays no reading. A chunk is
//! written in one piece at least twice a second. After `kill -9` a recording is therefore complete up to its last chunk, and
//! readers with recovery (`mcap recover`, `sim_publisher replay`) can read it. A power failure may lose more.

use crate::link::{Announcer, LOOK_EVERY, Link, News, Whence};
use crate::topics::{Tally, Topics, WallClock};
use anyhow::Context as _;
use foxglove::{Context, McapCompression, McapWriteOptions};
use serde::Serialize;
use shared_types::{Domain, clock::monotonic_ns, logln};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Messages that wait for a slow disk: 5 s of a service and a simulator at 1 kHz, 10 MB.
const QUEUE: usize = 16_384;
/// Length of a chunk (ns): what a sudden end loses at most.
const CHUNK_NS: u64 = 500_000_000;

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Compression {
    /// Fast; smaller files
    Lz4,
    /// As it is
    None,
}

/// What to record, and for how long.
#[derive(Debug)]
pub struct Options<'a> {
    /// Where to.
    pub file: &'a Path,
    /// Whether a file that is there may be replaced.
    pub force: bool,
    /// Of chunks.
    pub compression: Compression,
    /// From the first message on (s); `None` until the stop.
    pub duration_s: Option<f64>,
}

/// What was written.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// The file.
    pub file: PathBuf,
    /// Its size (bytes).
    pub bytes: u64,
    /// From the first message to the end (s).
    pub duration_s: f64,
    /// By topic; topics that say the same in Foxglove's own schemas are not counted.
    pub topics: BTreeMap<String, Tally>,
    /// Messages that were lost because the disk was too slow.
    pub not_written: u64,
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "'{}': {:.1} s, {} bytes", self.file.display(), self.duration_s, self.bytes)?;
        for (topic, Tally { messages, missing, restarts, .. }) in &self.topics {
            write!(f, "\n  {topic}: {messages} messages, {missing} missing")?;
            if *restarts > 0 {
                write!(f, ", {restarts} restarts")?;
            }
        }
        if self.not_written > 0 {
            write!(f, "\n  {} messages not written: the disk was too slow", self.not_written)?;
        }
        Ok(())
    }
}

/// A file that remembers why a write failed: foxglove's channels do not report it.
struct Recording {
    file: File,
    bytes: u64,
    failure: Arc<Mutex<Option<io::Error>>>,
}

impl Recording {
    fn noting<T>(&mut self, done: io::Result<T>) -> io::Result<T> {
        done.map_err(|error| {
            let copy = io::Error::from(error.kind());
            self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            copy
        })
    }
}

impl Write for Recording {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes);
        self.bytes += *written.as_ref().unwrap_or(&0) as u64;
        self.noting(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.file.flush();
        self.noting(flushed)
    }
}

impl Seek for Recording {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let sought = self.file.seek(to);
        self.noting(sought)
    }
}

/// Records until `stop`, or the end of the duration.
///
/// # Errors
/// A file that exists already or cannot be written; a service of another version.
pub fn record(
    domain: &Domain,
    instance: &str,
    options: &Options<'_>,
    stop: &AtomicBool,
) -> anyhow::Result<Summary> {
    let name = options.file.display().to_string();
    let mut opening = File::options();
    opening.write(true).create(true).create_new(!options.force).truncate(options.force);
    let file = opening.open(options.file).with_context(|| match options.file.exists() && !options.force {
        true => format!("'{name}' is there already; needed: another name, or --force to replace it"),
        false => format!("cannot write '{name}'"),
    })?;
    let (sender, receiver) = sync_channel(QUEUE);
    let has_failed = Arc::new(AtomicBool::new(false));
    let writer = {
        let (has_failed, instance) = (Arc::clone(&has_failed), instance.to_owned());
        let compression = options.compression;
        std::thread::Builder::new().name("writer".into()).spawn(move || {
            let written = write_all(file, compression, &instance, &receiver);
            has_failed.store(written.is_err(), Ordering::Relaxed);
            written
        })?
    };
    logln!("monitor: recording instance '{instance}' to '{name}'; Ctrl-C ends it");
    let mut link =
        Link::new(domain.clone(), instance, Whence::ThisMachine, monotonic_ns()).with_measurements();
    let mut queue = Queue { sender, not_written: 0, first_ns: None, announcer: Announcer::default() };
    let mut looked = Ok(());
    while !stop.load(Ordering::Relaxed) && !has_failed.load(Ordering::Relaxed) && looked.is_ok() {
        let now_ns = monotonic_ns();
        let recorded_s = queue.first_ns.map_or(0.0, |first_ns| now_ns.saturating_sub(first_ns) as f64 * 1e-9);
        if options.duration_s.is_some_and(|duration_s| recorded_s >= duration_s) {
            break;
        }
        looked = link.look(now_ns, |news| queue.take(news, monotonic_ns()));
        std::thread::sleep(LOOK_EVERY);
    }
    let duration_s = queue.first_ns.map_or(0.0, |first_ns| (monotonic_ns() - first_ns) as f64 * 1e-9);
    let not_written = queue.finish();
    drop(link);
    let written =
        writer.join().map_err(|_| anyhow::anyhow!("the writer of '{name}' has ended unexpectedly"))?;
    let (bytes, topics) = written.with_context(|| {
        format!(
            "cannot write '{name}'; what is in it until now can be read (mcap recover, sim_publisher replay)"
        )
    })?;
    looked?;
    Ok(Summary { file: options.file.into(), bytes, duration_s, topics, not_written })
}

/// What the reading thread sends to the writer.
#[allow(clippy::large_enum_variant)] // the queue's places are of one size anyway
enum Taken {
    News(News, u64),
    End { not_written: u64 },
}

/// The reader's side of the queue.
struct Queue {
    sender: SyncSender<Taken>,
    not_written: u64,
    first_ns: Option<u64>,
    announcer: Announcer,
}

impl Queue {
    fn take(&mut self, news: News, now_ns: u64) {
        self.announcer.note(&news);
        if !matches!(news, News::Away { .. }) {
            self.first_ns.get_or_insert(now_ns);
        }
        if let Err(TrySendError::Full(_)) = self.sender.try_send(Taken::News(news, now_ns)) {
            self.not_written += 1;
        }
    }

    /// Lets the writer finish.
    fn finish(self) -> u64 {
        // A writer that has failed has closed the queue, and reports its error itself.
        let _ = self.sender.send(Taken::End { not_written: self.not_written });
        self.not_written
    }
}

/// Writes messages until the queue ends; returns the file's size and the counts by topic.
fn write_all(
    file: File,
    compression: Compression,
    instance: &str,
    receiver: &Receiver<Taken>,
) -> anyhow::Result<(u64, BTreeMap<String, Tally>)> {
    let failure = Arc::new(Mutex::new(None));
    let context = Context::new();
    let options = McapWriteOptions::new()
        .compression(match compression {
            Compression::Lz4 => Some(McapCompression::Lz4),
            Compression::None => None,
        })
        // Only complete chunks reach the file.
        .disable_seeking(true);
    let recording = Recording { file, bytes: 0, failure: Arc::clone(&failure) };
    let reason = |error: foxglove::FoxgloveError| match failure
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .take()
    {
        Some(cause) => anyhow::Error::from(cause),
        None => anyhow::Error::from(error),
    };
    let clock = WallClock::now();
    let writer = context.mcap_writer_with_options(options).create(recording).map_err(reason)?;
    let text = |key: &str, value: String| (key.to_owned(), value);
    let start = BTreeMap::from([
        text("instance", instance.into()),
        text("version", env!("CARGO_PKG_VERSION").into()),
        text("wall_clock_at_monotonic_zero_ns", clock.at_monotonic_zero_ns.to_string()),
        text(
            "log_time",
            "stamp (CLOCK_MONOTONIC) + wall_clock_at_monotonic_zero_ns, measured once at the start; \
             not after the receipt, and rising on each topic"
                .into(),
        ),
    ]);
    writer.write_metadata("recording", start).and_then(|()| writer.flush()).map_err(reason)?;
    let mut topics = Topics::new(&context, instance, clock);
    let mut chunk_began_ns = monotonic_ns();
    let not_written = loop {
        match receiver.recv_timeout(Duration::from_nanos(CHUNK_NS / 4)) {
            Ok(Taken::News(news, receipt_ns)) => topics.note(&news, receipt_ns),
            Ok(Taken::End { not_written }) => break not_written,
            Err(RecvTimeoutError::Timeout) => {}
            // The reading thread has panicked.
            Err(RecvTimeoutError::Disconnected) => break 0,
        }
        let now_ns = monotonic_ns();
        if now_ns - chunk_began_ns >= CHUNK_NS {
            chunk_began_ns = now_ns;
            writer.flush().map_err(reason)?;
            // The channels do not report a failed write.
            if let Some(cause) = failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
                return Err(cause.into());
            }
        }
    };
    let tallies = topics.tallies();
    let mut end = BTreeMap::from([text("not_written", not_written.to_string())]);
    for (topic, tally) in &tallies {
        end.insert(format!("{topic} messages"), tally.messages.to_string());
        end.insert(format!("{topic} missing"), tally.missing.to_string());
        end.insert(format!("{topic} restarts"), tally.restarts.to_string());
    }
    writer.write_metadata("recording_end", end).map_err(reason)?;
    let recording = writer.close().map_err(reason)?;
    recording.file.sync_all()?;
    match recording.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(cause) => Err(cause.into()),
        None => Ok((recording.bytes, tallies)),
    }
}
