//! The recorder: a thread that writes the flight record. The loop sends it entries through a wait-free ring.
//!
//! ```text
//! loop ──Entry──▶ wait-free ring ──▶ recorder thread ──▶ FILE (appended)
//! ```
//!
//! If the disk is slow, the ring fills up. Then whole ticks are left out and counted; the loop never waits. The crate
//! [`flight_record`] defines the file's format.

use crate::config::Config;
use crate::engine::Checkpoint;
use crate::log::say;
use crate::snapshot::encode_checkpoint;
use flight_record::{Entry, Session, Writer};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Entries of one tick beside its samples: begin, missing, estimate, commands, checkpoint.
const ENTRIES_BESIDE_SAMPLES: usize = 16;
/// The ring holds this much time (s) at three entries a tick, up to some 2700 ticks a second.
const RING_S: f64 = 4.0;
const POLL_EVERY: Duration = Duration::from_millis(5);
/// A kill loses at most this much of the record.
const FLUSH_EVERY: Duration = Duration::from_millis(100);

/// The session of a service with this configuration that continued from `checkpoint`.
pub fn session(config: &Config, instance: &str, checkpoint: Option<&Checkpoint>) -> Session {
    Session {
        program_version: env!("CARGO_PKG_VERSION").into(),
        instance: instance.into(),
        config: config.document().to_string(),
        vector_unit: observer::vector_unit().into(),
        checkpoint: checkpoint.map(encode_checkpoint),
    }
}

/// The loop's end of the ring; without a recorder it takes nothing.
pub struct RecorderRing {
    ring: Option<rtrb::Producer<Entry>>,
    max_samples_per_tick: usize,
    /// Whether the present tick is left out.
    leaves_out: bool,
    /// Ticks left out since the last one that was not.
    missing: u64,
    left_out: u64,
}

impl RecorderRing {
    /// Without a recorder: nothing is recorded.
    pub fn none() -> Self {
        Self { ring: None, max_samples_per_tick: 0, leaves_out: true, missing: 0, left_out: 0 }
    }

    /// Begins a tick, which is taken as a whole or not at all.
    pub fn begin_tick(&mut self, begin: &Entry) {
        let Some(ring) = &mut self.ring else { return };
        self.leaves_out = ring.slots() < self.max_samples_per_tick + ENTRIES_BESIDE_SAMPLES;
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
            // There is room: `begin_tick` has checked it.
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
    file: Writer,
    ring: rtrb::Consumer<Entry>,
    /// Ticks in the buffer that are not yet in the file.
    pending_ticks: u64,
    progress: Arc<RecorderProgress>,
    /// A write failed. Frames written after it would follow half a frame, so a reader would not find them.
    is_broken: bool,
}

/// Opens or makes the file, appends the session, and gives both ends of the ring.
///
/// A tick is recorded where the ring has room for `max_samples_per_tick` and the tick's other entries.
///
/// # Errors
/// The system's reason.
pub fn recorder(
    path: &Path,
    session: &Session,
    rate_hz: f64,
    max_samples_per_tick: usize,
) -> io::Result<(RecorderRing, Recorder, Arc<RecorderProgress>)> {
    let file = Writer::append(path, session)?;
    let entries = (3.0 * RING_S * rate_hz) as usize;
    let (mut ring, mut taken) = rtrb::RingBuffer::new(entries.clamp(4096, 32_768));
    // The pages are there before the loop writes to them.
    while ring.push(Entry::Checkpoint).is_ok() {}
    while taken.pop().is_ok() {}
    let progress = Arc::<RecorderProgress>::default();
    let ring =
        RecorderRing { ring: Some(ring), max_samples_per_tick, leaves_out: false, missing: 0, left_out: 0 };
    let recorder =
        Recorder { file, ring: taken, pending_ticks: 0, progress: Arc::clone(&progress), is_broken: false };
    Ok((ring, recorder, progress))
}

impl Recorder {
    /// Writes entries until `stop`, and then the remaining ones.
    pub fn run(mut self, stop: &AtomicBool) {
        let mut last_flush = Instant::now();
        loop {
            // Read `stop` first: everything that was pushed before it is then in the ring.
            let is_last = stop.load(Ordering::Acquire);
            while let Ok(entry) = self.ring.pop() {
                let is_tick = u64::from(matches!(entry, Entry::Estimate(_)));
                if self.is_broken {
                    self.progress.failed.fetch_add(is_tick, Ordering::Relaxed);
                    continue;
                }
                let written = self.file.push(&entry);
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
                let synced = self.file.sync();
                self.note(synced);
                return;
            }
            std::thread::sleep(POLL_EVERY);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_is_taken_whole_or_left_out_and_counted() {
        let (ring, mut taken) = rtrb::RingBuffer::new(4 + ENTRIES_BESIDE_SAMPLES + 2);
        let mut ring = RecorderRing {
            ring: Some(ring),
            max_samples_per_tick: 4,
            leaves_out: false,
            missing: 0,
            left_out: 0,
        };
        let tick = |ring: &mut RecorderRing| {
            ring.begin_tick(&Entry::Begin { wake_ns: 0, late_ticks_in_a_row: 0 });
            ring.push(|| Entry::Checkpoint);
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
