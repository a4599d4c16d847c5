//! The saver thread, which writes snapshots, and its ring from the loop.
//!
//! ```text
//! loop: checkpoint ──a part per tick──▶ ring ──▶ saver thread ──▶ Snapshot::write
//! ```
//!
//! The loop never waits: the checkpoint that it saves anyway is read in parts, in the slack after publication.

use crate::config::Config;
use crate::engine::{Checkpoint, Engine, EngineState};
use crate::log::say;
use crate::snapshot::{Snapshot, boot_id, meaning, unix_s, with_suffix};
use shared_types::clock::monotonic_ns;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

/// The loop hands over this many numbers a tick: a few microseconds of copying.
const NUMBERS_PER_TICK: usize = 8192;
/// A loop that has not handed over a copy after this long, and twice the time that it takes to read it, does not tick,
/// or has none that is good.
const LOOP_PATIENCE: Duration = Duration::from_secs(5);
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// A checkpoint on its way from the loop to the saver thread.
#[derive(Debug, Clone, Default)]
struct Copied {
    learned: Vec<f64>,
    state: Option<EngineState>,
    stamp_ns: u64,
    samples_accepted: u64,
    /// As [`Engine::n_forgotten`].
    n_forgotten: u64,
}

/// The loop's end: it is asked with an empty copy, fills it in parts and hands it over. Nothing is allocated.
pub struct SnapshotRing {
    requests: rtrb::Consumer<Copied>,
    filled: rtrb::Producer<Copied>,
    /// The copy that is being filled, and how far.
    filling: Option<(Copied, usize)>,
}

impl SnapshotRing {
    /// Takes a request, if there is one: a checkpoint is to be saved now and read from then on.
    pub fn take_request(&mut self) -> bool {
        self.filling = self.requests.pop().ok().map(|copy| (copy, 0));
        self.filling.is_some()
    }

    /// Whether a copy is being read.
    pub fn is_reading(&self) -> bool {
        self.filling.is_some()
    }

    /// Reads again from the start: the copy is another one.
    pub fn start_over(&mut self) {
        if let Some((_, done)) = &mut self.filling {
            *done = 0;
        }
    }

    /// Reads the next part of the copy; hands it over when that was the last.
    pub fn read_a_part(&mut self, engine: &Engine) {
        let Some((copy, done)) = &mut self.filling else { return };
        let end = (*done + NUMBERS_PER_TICK).min(copy.learned.len());
        engine.read_saved(*done, &mut copy.learned[*done..end]);
        *done = end;
        if end < copy.learned.len() {
            return;
        }
        if let Some((copy, _)) = self.filling.take() {
            self.hand_over(copy, engine);
        }
    }

    /// Reads the whole copy at once, after the last tick.
    pub fn read_at_once(&mut self, engine: &Engine) {
        self.filling = None;
        let mut copy = Copied { learned: vec![0.0; engine.n_learned()], ..Copied::default() };
        engine.read_saved(0, &mut copy.learned);
        self.hand_over(copy, engine);
    }

    fn hand_over(&mut self, mut copy: Copied, engine: &Engine) {
        copy.state = engine.saved_state();
        copy.stamp_ns = monotonic_ns();
        copy.samples_accepted = engine.counters().samples_accepted;
        copy.n_forgotten = engine.n_forgotten();
        // There is room for every copy that is on its way.
        let _ = self.filled.push(copy);
    }
}

/// What the saver thread has done, for the status.
#[derive(Debug, Default)]
pub struct SaverProgress {
    /// Snapshots written.
    pub saved: AtomicU64,
    /// Snapshots that could not be written.
    pub failed: AtomicU64,
    /// CLOCK_MONOTONIC of the newest one (ns).
    pub stamp_ns: AtomicU64,
}

/// An operator's request for a snapshot now, and where the answer goes.
pub type SaveRequest = mpsc::SyncSender<Result<String, String>>;

/// The saver thread's end.
pub struct Saver {
    path: PathBuf,
    instance: String,
    meaning: Vec<(String, String)>,
    save_every: Option<Duration>,
    patience: Duration,
    /// What is on disk knows more than what comes next, if this differs from the copy's: it is set aside.
    n_forgotten: Option<u64>,
    has_set_aside: bool,
    requests: rtrb::Producer<Copied>,
    filled: rtrb::Consumer<Copied>,
    /// The copy that is not on its way.
    blank: Option<Copied>,
    save_requests: mpsc::Receiver<SaveRequest>,
    progress: Arc<SaverProgress>,
}

/// What others see of the saver thread.
#[derive(Debug, Clone)]
pub struct SaverHandle {
    /// To ask for a snapshot now.
    pub save_requests: mpsc::Sender<SaveRequest>,
    /// What it has done.
    pub progress: Arc<SaverProgress>,
}

/// Both ends; without a path no request ever comes.
pub fn saver(
    path: Option<PathBuf>,
    instance: &str,
    config: &Config,
    (n_learned, is_fresh): (usize, bool),
) -> (SnapshotRing, Option<(Saver, SaverHandle)>) {
    let (ask, asked) = rtrb::RingBuffer::new(1);
    let (fill, filled) = rtrb::RingBuffer::new(2);
    let ring = SnapshotRing { requests: asked, filled: fill, filling: None };
    let saver = path.map(|path| {
        let (send, save_requests) = mpsc::channel();
        let progress = Arc::<SaverProgress>::default();
        let every_s = config.snapshot.save_every_s;
        let saver = Saver {
            path,
            instance: instance.into(),
            meaning: meaning(config),
            save_every: (every_s > 0.0).then(|| Duration::from_secs_f64(every_s)),
            patience: LOOP_PATIENCE
                + Duration::from_secs_f64(2.0 * (n_learned / NUMBERS_PER_TICK) as f64 / config.rate_hz),
            n_forgotten: (!is_fresh).then_some(0),
            has_set_aside: false,
            requests: ask,
            filled,
            blank: Some(Copied { learned: vec![0.0; n_learned], ..Copied::default() }),
            save_requests,
            progress: Arc::clone(&progress),
        };
        (saver, SaverHandle { save_requests: send, progress })
    });
    (ring, saver)
}

impl Saver {
    /// Saves when it is time, on request, and, after `stop`, what the loop handed over last.
    pub fn run(mut self, stop: &AtomicBool) {
        let mut last = Instant::now();
        while !stop.load(Ordering::Acquire) {
            let request = self.save_requests.recv_timeout(LOOK_EVERY).ok();
            let is_time = self.save_every.is_some_and(|every| last.elapsed() >= every);
            if request.is_none() && !is_time {
                continue;
            }
            last = Instant::now();
            let done = self.save(stop);
            if let Some(request) = request {
                // The asker may have stopped waiting.
                let _ = request.send(done);
            }
        }
        while let Ok(copy) = self.filled.pop() {
            let _ = self.write(copy);
        }
    }

    /// Asks the loop for a copy and writes it.
    fn save(&mut self, stop: &AtomicBool) -> Result<String, String> {
        // A copy that came too late for the one who asked is not what is asked for now.
        while let Ok(copy) = self.filled.pop() {
            self.blank = Some(copy);
        }
        if let Some(blank) = self.blank.take() {
            // The ring has room for the only one.
            let _ = self.requests.push(blank);
        }
        let deadline = Instant::now() + self.patience;
        while Instant::now() < deadline && !stop.load(Ordering::Acquire) {
            if let Ok(copy) = self.filled.pop() {
                return self.write(copy);
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Err("the loop handed nothing over: it does not tick, or its state is not within half of the limits"
            .into())
    }

    fn write(&mut self, copy: Copied) -> Result<String, String> {
        let Copied { learned, state, stamp_ns, samples_accepted, n_forgotten } = copy;
        let snapshot = Snapshot {
            program_version: env!("CARGO_PKG_VERSION").into(),
            instance: self.instance.clone(),
            made_unix_s: unix_s(),
            boot_id: boot_id(),
            stamp_ns,
            samples_accepted,
            meaning: self.meaning.clone(),
            checkpoint: Checkpoint { learned, state },
        };
        let written = self.set_aside(n_forgotten).and_then(|()| snapshot.write(&self.path));
        self.blank = Some(Copied { learned: snapshot.checkpoint.learned, ..Copied::default() });
        match written {
            Ok(()) => {
                self.progress.saved.fetch_add(1, Ordering::Relaxed);
                self.progress.stamp_ns.store(stamp_ns, Ordering::Relaxed);
                Ok(format!("saved to '{}'", self.path.display()))
            }
            Err(error) => {
                let reason = format!("'{}' cannot be written: {error}", self.path.display());
                self.note_failure(&reason);
                Err(reason)
            }
        }
    }

    /// What was forgotten since is in the file that is there: it is kept.
    fn set_aside(&mut self, n_forgotten: u64) -> io::Result<()> {
        if self.n_forgotten == Some(n_forgotten) {
            return Ok(());
        }
        // Once: what is forgotten again and again is what was learned since the last time, and no flight.
        if !self.has_set_aside && self.path.try_exists()? {
            let old = with_suffix(&self.path, ".old");
            let old =
                if old.try_exists()? { with_suffix(&self.path, &format!(".old-{}", unix_s())) } else { old };
            fs::rename(&self.path, &old)?;
            say!("what was learned before is kept in '{}'", old.display());
            self.has_set_aside = true;
        }
        self.n_forgotten = Some(n_forgotten);
        Ok(())
    }

    fn note_failure(&self, reason: &str) {
        let failed = self.progress.failed.fetch_add(1, Ordering::Relaxed) + 1;
        // The first, then each power of ten: a full disk is no flood of lines.
        if failed.checked_ilog10() > (failed - 1).checked_ilog10() {
            say!(
                "warning: no snapshot ({failed} times): {reason}; what is learned since lives as long as the service"
            );
        }
    }
}
