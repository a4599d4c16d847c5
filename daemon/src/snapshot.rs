//! Snapshots: what was learned, and the state, in a file, so that a restart goes on instead of beginning again.
//!
//! ```text
//! loop:   good copy ──a part per tick──▶ ring ──▶ saver thread: NAME.snapshot.new, sync, rename, sync ──▶ NAME.snapshot
//! start:  NAME.snapshot ──checks: sum, version, meaning──▶ engine
//! ```
//!
//! A kill at any instant leaves the previous file or the new one, whole. The loop never waits: the good copy that it
//! keeps anyway is read in parts, in the slack after publication.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `obs-snap` |
//! | 4 | version, little-endian |
//! | 4 | CRC-32 of what follows |
//! | … | [`Snapshot`] as postcard |

use crate::config::{Clock, Config};
use crate::engine::{Engine, EngineState, Kept};
use crate::say;
use serde::{Deserialize, Serialize};
use shared_types::clock::monotonic_ns;
use shared_types::payload::restored;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant, SystemTime};

const MAGIC: &[u8; 8] = b"obs-snap";
const VERSION: u32 = 1;
/// The loop hands over so many numbers a tick: a few microseconds of copying.
const NUMBERS_PER_TICK: usize = 8192;
/// A loop that has not handed over a copy after this long does not tick, or has none that is good.
const LOOP_PATIENCE: Duration = Duration::from_secs(20);
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// What was learned and when, and what gives it its meaning.
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
    pub kept: Kept,
}

/// Why a snapshot cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    /// The system refused.
    #[error("'{path}': {cause}")]
    Io {
        /// The file.
        path: String,
        /// The system's reason.
        cause: io::Error,
    },
    /// The bytes are no snapshot, or a damaged one.
    #[error("'{path}' is no whole snapshot: {found}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong with it.
        found: String,
    },
    /// It was learned by another design.
    #[error(
        "snapshot '{path}' was learned with another design: {differences}; needed: the same values, or --fresh to begin anew (the file is kept as .old), or another --instance or --state"
    )]
    OtherDesign {
        /// The file.
        path: String,
        /// What differs.
        differences: String,
    },
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
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let header = bytes.split_first_chunk::<8>().filter(|(magic, _)| *magic == MAGIC);
        let (_, rest) = header.ok_or("it does not begin as one")?;
        let (version, rest) = rest.split_first_chunk::<4>().ok_or("it ends in its header")?;
        let version = u32::from_le_bytes(*version);
        if version != VERSION {
            return Err(format!("version {version}; this program reads version {VERSION}"));
        }
        let (sum, body) = rest.split_first_chunk::<4>().ok_or("it ends in its header")?;
        if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
            return Err(format!("the checksum of its {} bytes does not fit", body.len()));
        }
        match postcard::take_from_bytes(body) {
            Ok((snapshot, [])) => Ok(snapshot),
            Ok((_, rest)) => Err(format!("{} bytes too many", rest.len())),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// `Io` or `Damaged`.
    pub fn read(path: &Path) -> Result<Self, SnapshotError> {
        let name = path.display().to_string();
        let bytes = fs::read(path).map_err(|cause| SnapshotError::Io { path: name.clone(), cause })?;
        Self::decode(&bytes).map_err(|found| SnapshotError::Damaged { path: name, found })
    }

    /// Writes a file: beside it first, synced, then renamed, the directory synced.
    ///
    /// # Errors
    /// The system's reason.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let beside = with_suffix(path, ".new");
        let mut options = OpenOptions::new();
        let mut file = options.write(true).create(true).truncate(true).mode(0o600).open(&beside)?;
        file.write_all(&self.encode())?;
        file.sync_all()?;
        fs::rename(&beside, path)?;
        match path.parent() {
            Some(directory) => File::open(directory)?.sync_all(),
            None => Ok(()),
        }
    }

    /// What was learned by another design than this configuration's, value by value; empty where nothing differs.
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

/// The keys that give the learned numbers their meaning, with their values: what is a function of what, in which space,
/// and what is known already. Gains, rates and dead zones may change between two flights.
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

/// Which boot of this machine it is; empty where the kernel does not say.
pub fn boot_id() -> String {
    fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim().into()
}

/// Takes over from `path` what was learned, and the state where it is fresh enough; tells what, and as one of
/// [`shared_types::payload::restored`].
///
/// A file that is no whole snapshot is set aside and said; it does not keep a vehicle on the ground.
///
/// # Errors
/// `OtherDesign`, or `Io` where the file exists and cannot be read.
pub fn take_over(
    path: &Path,
    is_fresh: bool,
    config: &Config,
    engine: &mut Engine,
) -> Result<(Option<Kept>, u64), SnapshotError> {
    let io_error = |cause| SnapshotError::Io { path: path.display().to_string(), cause };
    if !path.try_exists().map_err(io_error)? {
        return Ok((None, restored::NOTHING));
    }
    if is_fresh {
        let old = with_suffix(path, ".old");
        fs::rename(path, &old).map_err(io_error)?;
        say!("begins anew; what was learned before is kept in '{}'", old.display());
        return Ok((None, restored::NOTHING));
    }
    let snapshot = match Snapshot::read(path) {
        Ok(snapshot) => snapshot,
        Err(error @ SnapshotError::Damaged { .. }) => {
            let aside = with_suffix(path, ".damaged");
            fs::rename(path, &aside).map_err(io_error)?;
            say!("warning: {error}; it is kept as '{}', and learning begins anew", aside.display());
            return Ok((None, restored::NOTHING));
        }
        Err(error) => return Err(error),
    };
    let differences = snapshot.differences(config);
    if !differences.is_empty() {
        let path = path.display().to_string();
        return Err(SnapshotError::OtherDesign { path, differences: differences.join("; ") });
    }
    let Kept { learned, state } = snapshot.kept;
    // Of the newest sample that went into it: what was silent for long is not gone on from.
    let age_s = |state: &EngineState| {
        let stamp_ns = state.estimator.stamp_ns()?;
        Some(monotonic_ns().abs_diff(stamp_ns) as f64 / 1e9)
    };
    let goes_on = |state: &EngineState| {
        snapshot.boot_id == boot_id()
            && config.clock == Clock::Monotonic
            && age_s(state).is_some_and(|age_s| age_s <= config.snapshot.resume_state_within_s)
    };
    let kept = Kept { learned, state: state.filter(goes_on) };
    engine.resume(&kept).map_err(|differences| SnapshotError::OtherDesign {
        path: path.display().to_string(),
        differences,
    })?;
    let what = if kept.state.is_some() { "goes on, state included," } else { "goes on" };
    say!(
        "{what} with what was learned until {} s ago ('{}')",
        unix_s().saturating_sub(snapshot.made_unix_s),
        path.display()
    );
    let kind = if kept.state.is_some() { restored::LEARNED_AND_STATE } else { restored::LEARNED };
    Ok((Some(kept), kind))
}

fn unix_s() -> u64 {
    SystemTime::UNIX_EPOCH.elapsed().map_or(0, |elapsed| elapsed.as_secs())
}

/// A good copy on its way from the loop to the saver thread.
#[derive(Debug, Clone, Default)]
struct Copied {
    learned: Vec<f64>,
    state: Option<EngineState>,
    stamp_ns: u64,
    samples_accepted: u64,
}

/// The loop's end: it is asked with an empty copy, fills it in parts and hands it over. Nothing is allocated.
pub struct SnapshotRing {
    requests: rtrb::Consumer<Copied>,
    filled: rtrb::Producer<Copied>,
    /// The copy that is being filled, and how far.
    filling: Option<(Copied, usize)>,
}

impl SnapshotRing {
    /// Takes a request, if there is one: a good copy is to be kept now and read from then on.
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
        engine.read_kept(*done, &mut copy.learned[*done..end]);
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
        let mut copy = Copied { learned: vec![0.0; engine.n_kept()], ..Copied::default() };
        engine.read_kept(0, &mut copy.learned);
        self.hand_over(copy, engine);
    }

    fn hand_over(&mut self, mut copy: Copied, engine: &Engine) {
        copy.state = engine.kept_state();
        copy.stamp_ns = monotonic_ns();
        copy.samples_accepted = engine.counters().samples_accepted;
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

/// An operator's wish for a snapshot now, and where the answer goes.
pub type SaveRequest = mpsc::SyncSender<Result<String, String>>;

/// The saver thread's end.
pub struct Saver {
    path: PathBuf,
    instance: String,
    meaning: Vec<(String, String)>,
    save_every: Option<Duration>,
    requests: rtrb::Producer<Copied>,
    filled: rtrb::Consumer<Copied>,
    /// The copy that is not on its way.
    blank: Option<Copied>,
    wishes: mpsc::Receiver<SaveRequest>,
    progress: Arc<SaverProgress>,
}

/// What others see of the saver thread.
#[derive(Debug, Clone)]
pub struct SaverHandle {
    /// To wish for a snapshot now.
    pub wishes: mpsc::Sender<SaveRequest>,
    /// What it has done.
    pub progress: Arc<SaverProgress>,
}

/// Both ends; without a path nobody ever asks.
pub fn saver(
    path: Option<PathBuf>,
    instance: &str,
    config: &Config,
    n_learned: usize,
) -> (SnapshotRing, Option<(Saver, SaverHandle)>) {
    let (ask, asked) = rtrb::RingBuffer::new(1);
    let (fill, filled) = rtrb::RingBuffer::new(2);
    let ring = SnapshotRing { requests: asked, filled: fill, filling: None };
    let saver = path.map(|path| {
        let (wish, wishes) = mpsc::channel();
        let progress = Arc::<SaverProgress>::default();
        let every_s = config.snapshot.save_every_s;
        let saver = Saver {
            path,
            instance: instance.into(),
            meaning: meaning(config),
            save_every: (every_s > 0.0).then(|| Duration::from_secs_f64(every_s)),
            requests: ask,
            filled,
            blank: Some(Copied { learned: vec![0.0; n_learned], ..Copied::default() }),
            wishes,
            progress: Arc::clone(&progress),
        };
        (saver, SaverHandle { wishes: wish, progress })
    });
    (ring, saver)
}

impl Saver {
    /// Saves when it is time, when it is wished, and, after `stop`, what the loop handed over last.
    pub fn run(mut self, stop: &AtomicBool) {
        let mut last = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let wish = self.wishes.recv_timeout(LOOK_EVERY).ok();
            let is_time = self.save_every.is_some_and(|every| last.elapsed() >= every);
            if wish.is_none() && !is_time {
                continue;
            }
            last = Instant::now();
            let done = self.save(stop);
            if let Some(wish) = wish {
                // Whoever does not wait any more needs no answer.
                let _ = wish.send(done);
            }
        }
        while let Ok(copy) = self.filled.pop() {
            let _ = self.write(copy);
        }
    }

    /// Asks the loop for a copy and writes it.
    fn save(&mut self, stop: &AtomicBool) -> Result<String, String> {
        if let Some(blank) = self.blank.take() {
            // The ring has room for the only one.
            let _ = self.requests.push(blank);
        }
        let deadline = Instant::now() + LOOP_PATIENCE;
        while Instant::now() < deadline && !stop.load(Ordering::Relaxed) {
            if let Ok(copy) = self.filled.pop() {
                return self.write(copy);
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Err("the loop handed nothing over: it does not tick, or its state is not within half of the limits"
            .into())
    }

    fn write(&mut self, copy: Copied) -> Result<String, String> {
        let Copied { learned, state, stamp_ns, samples_accepted } = copy;
        let snapshot = Snapshot {
            program_version: env!("CARGO_PKG_VERSION").into(),
            instance: self.instance.clone(),
            made_unix_s: unix_s(),
            boot_id: boot_id(),
            stamp_ns,
            samples_accepted,
            meaning: self.meaning.clone(),
            kept: Kept { learned, state },
        };
        let written = snapshot.write(&self.path);
        self.blank = Some(Copied { learned: snapshot.kept.learned, ..Copied::default() });
        match written {
            Ok(()) => {
                self.progress.saved.fetch_add(1, Ordering::Relaxed);
                self.progress.stamp_ns.store(stamp_ns, Ordering::Relaxed);
                Ok(format!("saved to '{}'", self.path.display()))
            }
            Err(error) => {
                let failed = self.progress.failed.fetch_add(1, Ordering::Relaxed) + 1;
                // The first, then each power of ten: a full disk is no flood of lines.
                if failed.checked_ilog10() > (failed - 1).checked_ilog10() {
                    say!(
                        "warning: snapshot '{}' cannot be written ({failed} times): {error}; what is learned lives as long as the service",
                        self.path.display()
                    );
                }
                Err(format!("'{}' cannot be written: {error}", self.path.display()))
            }
        }
    }
}
