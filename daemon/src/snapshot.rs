//! Snapshots: what was learned and the state, in a file, so that a restarted service continues from there.
//!
//! ```text
//! while it runs: engine ──▶ saver thread (`threads::snapshot_writer`) ──.new, sync, rename, sync──▶ NAME.snapshot
//! at the start:  NAME.snapshot ──checks: sum, version, meaning──▶ engine
//! ```
//!
//! A kill at any instant leaves either the previous file or the new one, complete.
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
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use shared_types::clock::monotonic_ns;
use shared_types::payload::restored;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

const MAGIC: &[u8; 8] = b"obs-snap";
/// Version of the format: of the file, and of a checkpoint's bytes in a flight record.
pub const VERSION: u32 = 6;

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

/// Why bytes are no snapshot, or checkpoint, of this version.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Another version of the format.
    #[error("version {0}; this program reads version {VERSION}")]
    OtherVersion(u32),
    /// None, or not a whole one.
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
        all_of(body)
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

/// A checkpoint as bytes of its own, for a flight record: the version, little-endian, then postcard.
pub fn encode_checkpoint(checkpoint: &Checkpoint) -> Vec<u8> {
    postcard::to_extend(checkpoint, VERSION.to_le_bytes().to_vec()).expect("numbers")
}

/// Reads the bytes of [`encode_checkpoint`].
///
/// # Errors
/// What is wrong with them: another version, damaged.
pub fn decode_checkpoint(bytes: &[u8]) -> Result<Checkpoint, DecodeError> {
    let (version, body) =
        bytes.split_first_chunk::<4>().ok_or_else(|| "it ends in its version".to_owned())?;
    match u32::from_le_bytes(*version) {
        VERSION => all_of(body),
        other => Err(DecodeError::OtherVersion(other)),
    }
}

/// What these bytes hold, with none left over.
fn all_of<T: DeserializeOwned>(body: &[u8]) -> Result<T, DecodeError> {
    match postcard::take_from_bytes(body) {
        Ok((content, [])) => Ok(content),
        Ok((_, rest)) => Err(format!("{} bytes too many", rest.len()).into()),
        Err(error) => Err(error.to_string().into()),
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

/// The path with this at its end.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
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

/// The keys on which the meaning of the learned numbers depends, with their values: the law, the space, the priors that
/// scale the joint law's weights, and the known plant. Gains, rates, noises, memories and dead zones may change between two
/// flights.
pub fn meaning(config: &Config) -> Vec<(String, String)> {
    const WITHOUT_MEANING: [&str; 16] = [
        "sample_rate_hz",
        "gain_per_s",
        "gain",
        "adaptation_rate",
        "adaptation_rate_kg_s2",
        "adaptation_rate_n_m",
        "dead_zone",
        "features_at",
        "velocity_error_to_position",
        "position_fix_gain_per_s",
        "position_fix_hold_s",
        "attitude_fix_gain_per_s",
        "attitude_fix_hold_s",
        "joint",
        "state_names",
        "initial_state",
    ];
    const WITHOUT_MEANING_IN_PART: [&str; 4] = ["dead_zone_", "_bound", "_noise_", "max_native_norm"];
    let has_meaning = |key: &str| {
        !WITHOUT_MEANING.contains(&key) && !WITHOUT_MEANING_IN_PART.iter().any(|part| key.contains(part))
    };
    let document = config.document();
    let mut meaning = Vec::new();
    for channel in ["translation", "rotation", "linear"] {
        let Some(keys) = document.get(channel).and_then(toml::Value::as_table) else { continue };
        for (key, value) in keys.iter().filter(|(key, _)| has_meaning(key)) {
            meaning.push((format!("{channel}.{key}"), value.to_string()));
        }
        let joint = keys.get("joint").and_then(toml::Value::as_table).into_iter().flatten();
        let scales = joint.filter(|(key, _)| key.starts_with("prior_") || *key == "lag_times_s");
        meaning.extend(scales.map(|(key, value)| (format!("{channel}.joint.{key}"), value.to_string())));
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

/// Since 1970 (s).
pub(crate) fn unix_s() -> u64 {
    SystemTime::UNIX_EPOCH.elapsed().map_or(0, |elapsed| elapsed.as_secs())
}
