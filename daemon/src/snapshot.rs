//! Snapshots: what was learned and the state, in a file, so that a restarted service continues from there.
//!
//! ```text
//! loop:   checkpoint ──a part per tick──▶ ring ──▶ saver thread: NAME.snapshot.new, sync, rename, sync ──▶ NAME.snapshot
//! start:  NAME.snapshot ──checks: sum, version, meaning──▶ engine
//! ```
//!
//! A kill at any instant leaves either the previous file or the new one, complete. The loop never waits: the engine's
//! checkpoint is read in parts, in the slack after publication.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `obs-snap` |
//! | 4 | version, little-endian |
//! | 4 | CRC-32 of what follows |
//! | … | [`Snapshot`] as postcard |

use crate::config::{Clock, Config};
use crate::engine::{Checkpoint, Engine, EngineState};
use crate::log::say;
use rustix::fs::{FlockOperation, OFlags, flock};
use serde::{Deserialize, Serialize};
use shared_types::clock::monotonic_ns;
use shared_types::payload::restored;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant, SystemTime};

const MAGIC: &[u8; 8] = b"obs-snap";
const VERSION: u32 = 2;
/// The loop hands over this many numbers a tick: a few microseconds of copying.
const NUMBERS_PER_TICK: usize = 8192;
/// After this time, and twice the time that reading a copy takes, a loop that has handed over no copy does not tick, or has
/// no good checkpoint.
const LOOP_PATIENCE: Duration = Duration::from_secs(5);
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// What was learned and when, and the configuration on which its meaning depends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Version of the program that wrote it.
    pub program_version: String,
    /// Name of the vehicle.
    pub instance: String,
    /// Since 1970 (s).
    pub made_unix_s: u64,
    /// Which boot the stamps of CLOCK_MONOTONIC belong to.
    pub boot_id: String,
    /// CLOCK_MONOTONIC when it was made (ns).
    pub stamp_ns: u64,
    /// Samples used until then, by the service that wrote it.
    pub samples_accepted: u64,
    /// The keys of the configuration that give the learned numbers their meaning, with their values.
    pub meaning: Vec<(String, String)>,
    /// What was learned, and the state.
    #[serde(rename = "kept")]
    pub checkpoint: Checkpoint,
}

/// Why a snapshot cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    /// The system refused this file.
    #[error("'{0}': {1}")]
    Io(String, #[source] io::Error),
    /// The bytes of this file are no snapshot, or a damaged one.
    #[error("'{0}' is no whole snapshot: {1}")]
    Damaged(String, String),
    /// This file is of another version of the program.
    #[error(
        "snapshot '{0}' has version {1}, this program reads version {VERSION}; needed: the program that wrote it, or --fresh to begin anew (the file is kept as .old)"
    )]
    OtherVersion(String, u32),
    /// Another service writes this file.
    #[error(
        "snapshot '{0}' is another service's: it holds '{0}.lock'; needed: another --state or --instance"
    )]
    InUse(String),
    /// This file was learned by another design, with these differences.
    #[error(
        "snapshot '{0}' was learned with another design: {1}; needed: the same values, or --fresh to begin anew (the file is kept as .old), or another --instance or --state"
    )]
    OtherDesign(String, String),
}

/// Why bytes are no snapshot of this version.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Another version of the format.
    #[error("version {0}; this program reads version {VERSION}")]
    OtherVersion(u32),
    /// No snapshot, or not a whole one.
    #[error("{0}")]
    Damaged(String),
}

impl From<String> for DecodeError {
    fn from(found: String) -> Self {
        Self::Damaged(found)
    }
}

impl Snapshot {
    /// The bytes of a file.
    pub fn encode(&self) -> Vec<u8> {
        let body = postcard::to_allocvec(self).expect("numbers, texts and lists");
        let mut bytes = Vec::with_capacity(16 + body.len());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&crc32fast::hash(&body).to_le_bytes());
        bytes.extend_from_slice(&body);
        bytes
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// What is wrong with them: no snapshot, another version, damaged.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let ends = || "it ends in its header".to_owned();
        let header = bytes.split_first_chunk::<8>().filter(|(magic, _)| *magic == MAGIC);
        let (_, rest) = header.ok_or_else(|| "it does not begin as one".to_owned())?;
        let (version, rest) = rest.split_first_chunk::<4>().ok_or_else(ends)?;
        let version = u32::from_le_bytes(*version);
        if version != VERSION {
            return Err(DecodeError::OtherVersion(version));
        }
        let (sum, body) = rest.split_first_chunk::<4>().ok_or_else(ends)?;
        if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
            return Err(format!("the checksum of its {} bytes does not fit", body.len()).into());
        }
        match postcard::take_from_bytes(body) {
            Ok((snapshot, [])) => Ok(snapshot),
            Ok((_, rest)) => Err(format!("{} bytes too many", rest.len()).into()),
            Err(error) => Err(error.to_string().into()),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// `Io`, `Damaged` or `OtherVersion`.
    pub fn read(path: &Path) -> Result<Self, SnapshotError> {
        let name = path.display().to_string();
        let bytes = read_file(path).map_err(|cause| SnapshotError::Io(name.clone(), cause))?;
        Self::decode(&bytes).map_err(|error| match error {
            DecodeError::OtherVersion(found) => SnapshotError::OtherVersion(name, found),
            DecodeError::Damaged(found) => SnapshotError::Damaged(name, found),
        })
    }

    /// Writes a file beside `path`, syncs it, renames it to `path`, and syncs the directory.
    ///
    /// # Errors
    /// The system's reason.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let beside = with_suffix(path, ".new");
        // An existing file was never finished, or another user has planted it: it is removed, not written to.
        match fs::remove_file(&beside) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&beside)?;
        file.write_all(&self.encode())?;
        file.sync_all()?;
        fs::rename(&beside, path)?;
        match path.parent() {
            Some(directory) => File::open(directory)?.sync_all(),
            None => Ok(()),
        }
    }

    /// The values in which the snapshot's design differs from this configuration; empty if none.
    pub fn differences(&self, config: &Config) -> Vec<String> {
        let now = meaning(config);
        let value = |list: &[(String, String)], key: &str| {
            list.iter().find(|(known, _)| known == key).map_or("none".into(), |(_, value)| value.clone())
        };
        let mut keys: Vec<&String> = now.iter().chain(&self.meaning).map(|(key, _)| key).collect();
        keys.sort();
        keys.dedup();
        let compared = keys.into_iter().map(|key| (key, value(&self.meaning, key), value(&now, key)));
        compared
            .filter(|(_, then, now)| then != now)
            .map(|(key, then, now)| format!("{key} was {} and is {}", cut(&then), cut(&now)))
            .collect()
    }
}

/// The bytes of a regular file. Other files are refused, since reading a pipe could block.
fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    let flags = OFlags::NONBLOCK | OFlags::CLOEXEC;
    let mut file = OpenOptions::new().read(true).custom_flags(flags.bits() as i32).open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("not a regular file"));
    }
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Makes the directory of the snapshots, writable by this user alone. An existing directory must be so already.
///
/// # Errors
/// The system's reason, or that other users own the directory or may write to it.
pub fn make_directory(path: &Path) -> io::Result<()> {
    fs::DirBuilder::new().recursive(true).mode(0o700).create(path)?;
    let metadata = fs::metadata(path)?;
    let user = rustix::process::geteuid().as_raw();
    match (metadata.uid() == user, metadata.mode() & 0o022 == 0) {
        (false, _) => Err(io::Error::other(format!(
            "it belongs to user id {}, this process runs as {user}; needed: a directory of its own",
            metadata.uid()
        ))),
        (true, false) => Err(io::Error::other("others may write to it; needed: chmod go-w")),
        (true, true) => Ok(()),
    }
}

/// Held by the one service that writes a snapshot.
#[derive(Debug)]
pub struct SnapshotLock {
    _file: File,
}

impl SnapshotLock {
    /// Takes the lock. It is released when the returned value is dropped or the process ends.
    ///
    /// # Errors
    /// `InUse` while another service holds it, for example one in another container, whose claim on the instance is not
    /// visible here. `Io` with the system's reason.
    pub fn take(path: &Path) -> Result<Self, SnapshotError> {
        let lock = with_suffix(path, ".lock");
        let io_error = |cause| SnapshotError::Io(lock.display().to_string(), cause);
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(false).mode(0o600);
        let flags = OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let file = options.custom_flags(flags.bits() as i32).open(&lock).map_err(io_error)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(Self { _file: file }),
            Err(rustix::io::Errno::WOULDBLOCK) => Err(SnapshotError::InUse(path.display().to_string())),
            Err(error) => Err(io_error(error.into())),
        }
    }
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// A list of centers is too long for a message.
fn cut(value: &str) -> String {
    const LONGEST: usize = 60;
    match value.len() > LONGEST {
        true => format!("{}… ({} characters)", &value[..value.floor_char_boundary(LONGEST)], value.len()),
        false => value.into(),
    }
}

/// The keys on which the meaning of the learned numbers depends, with their values: the channels, the space, and the known
/// plant. Gains, rates and dead zones may change between two flights.
pub fn meaning(config: &Config) -> Vec<(String, String)> {
    const WITHOUT_MEANING: [&str; 14] = [
        "sample_rate_hz",
        "gain_per_s",
        "gain",
        "adaptation_rate",
        "adaptation_rate_kg_s2",
        "adaptation_rate_n_m",
        "dead_zone",
        "velocity_error_to_position",
        "position_fix_gain_per_s",
        "position_fix_hold_s",
        "attitude_fix_gain_per_s",
        "attitude_fix_hold_s",
        "state_names",
        "initial_state",
    ];
    let has_meaning = |key: &str| {
        !WITHOUT_MEANING.contains(&key) && !key.starts_with("dead_zone_") && !key.contains("_bound")
    };
    let table = toml::Table::try_from(config).expect("a configuration is a TOML document");
    let mut meaning = Vec::new();
    for channel in ["translation", "rotation", "linear"] {
        let keys = table.get(channel).and_then(toml::Value::as_table).into_iter().flatten();
        let values = keys.filter(|(key, _)| has_meaning(key));
        meaning.extend(values.map(|(key, value)| (format!("{channel}.{key}"), value.to_string())));
    }
    meaning
}

/// The id of this boot of the machine; empty if the kernel does not report it.
pub fn boot_id() -> String {
    fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim().into()
}

/// Resumes what was learned from the snapshot at `path`, and the state if it is recent enough. Returns the checkpoint and one
/// of [`shared_types::payload::restored`].
///
/// A damaged file is renamed, with a warning, and does not prevent a flight.
///
/// # Errors
/// `OtherDesign`, `OtherVersion`, or `Io` where the file exists and cannot be read.
pub fn take_over(
    path: &Path,
    is_fresh: bool,
    config: &Config,
    engine: &mut Engine,
) -> Result<(Option<Checkpoint>, u64), SnapshotError> {
    let io_error = |cause| SnapshotError::Io(path.display().to_string(), cause);
    // A fresh start sets an old file aside when it first has another one to put there.
    if is_fresh || !path.try_exists().map_err(io_error)? {
        return Ok((None, restored::NOTHING));
    }
    let snapshot = match Snapshot::read(path) {
        Ok(snapshot) => snapshot,
        Err(error @ SnapshotError::Damaged(..)) => {
            let aside = with_suffix(path, ".damaged");
            fs::rename(path, &aside).map_err(io_error)?;
            say!("warning: {error}; it is kept as '{}', and learning begins anew", aside.display());
            return Ok((None, restored::NOTHING));
        }
        Err(error) => return Err(error),
    };
    let differences = snapshot.differences(config);
    if !differences.is_empty() {
        return Err(SnapshotError::OtherDesign(path.display().to_string(), differences.join("; ")));
    }
    let Checkpoint { learned, state } = snapshot.checkpoint;
    // The age of its newest sample: a state without recent samples is not resumed.
    let age_s = |state: &EngineState| {
        let stamp_ns = state.estimator.stamp_ns()?;
        Some(monotonic_ns().abs_diff(stamp_ns) as f64 / 1e9)
    };
    let goes_on = |state: &EngineState| {
        !snapshot.boot_id.is_empty()
            && snapshot.boot_id == boot_id()
            && config.clock == Clock::Monotonic
            && age_s(state).is_some_and(|age_s| age_s <= config.snapshot.resume_state_within_s)
    };
    let checkpoint = Checkpoint { learned, state: state.filter(goes_on) };
    engine
        .load(&checkpoint)
        .map_err(|differences| SnapshotError::OtherDesign(path.display().to_string(), differences))?;
    let what = if checkpoint.state.is_some() { "goes on, state included," } else { "goes on" };
    say!(
        "{what} with what was learned until {} s ago ('{}')",
        unix_s().saturating_sub(snapshot.made_unix_s),
        path.display()
    );
    let kind = if checkpoint.state.is_some() { restored::LEARNED_AND_STATE } else { restored::LEARNED };
    Ok((Some(checkpoint), kind))
}

fn unix_s() -> u64 {
    SystemTime::UNIX_EPOCH.elapsed().map_or(0, |elapsed| elapsed.as_secs())
}

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

/// The loop's end. It receives an empty copy as a request, fills it in parts and hands it over. Nothing is allocated.
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

/// An operator's request for a snapshot, and the channel for the answer.
pub type SaveRequest = mpsc::SyncSender<Result<String, String>>;

/// The saver thread's end.
pub struct Saver {
    path: PathBuf,
    instance: String,
    meaning: Vec<(String, String)>,
    save_every: Option<Duration>,
    patience: Duration,
    /// If this differs from the copy's, something was forgotten since: the file on disk is kept as `.old`.
    n_forgotten: Option<u64>,
    has_set_aside: bool,
    requests: rtrb::Producer<Copied>,
    filled: rtrb::Consumer<Copied>,
    /// The copy that is not on its way.
    blank: Option<Copied>,
    save_requests: mpsc::Receiver<SaveRequest>,
    progress: Arc<SaverProgress>,
}

/// The interface to the saver thread.
#[derive(Debug, Clone)]
pub struct SaverHandle {
    /// For requests to save a snapshot now.
    pub save_requests: mpsc::Sender<SaveRequest>,
    /// What it has done.
    pub progress: Arc<SaverProgress>,
}

/// Makes both ends; without a path no request is ever sent.
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
                // The requester may have stopped waiting.
                let _ = request.send(done);
            }
        }
        while let Ok(copy) = self.filled.pop() {
            let _ = self.write(copy);
        }
    }

    /// Requests a copy from the loop and writes it.
    fn save(&mut self, stop: &AtomicBool) -> Result<String, String> {
        // A copy that arrived after its request had timed out is outdated.
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

    /// Keeps the existing file under another name, because it holds what was forgotten since.
    fn set_aside(&mut self, n_forgotten: u64) -> io::Result<()> {
        if self.n_forgotten == Some(n_forgotten) {
            return Ok(());
        }
        // Only once per start: what is forgotten later was learned since then, not in an earlier flight.
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
        // Logs the first failure and then each power of ten, so that a full disk does not flood the log.
        if failed.checked_ilog10() > (failed - 1).checked_ilog10() {
            say!(
                "warning: no snapshot ({failed} times): {reason}; what is learned since lives as long as the service"
            );
        }
    }
}
