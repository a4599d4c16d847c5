//! Which shared memory: a root path, a prefix, and the lock under which anything in it is made.
//!
//! Everything of one domain lies in `<root>/` (static files, sockets) and `/dev/shm/<prefix>*` (segments).
//! Only what the domain itself makes there is ever removed. The root path is open to its owner alone, whatever
//! the umask, and so is every segment; what another user planted in either is refused by name.
//! A process killed while it makes a service, a node or a port leaves a half-made file behind that would
//! stop every later start. So whoever makes something first takes the domain's lock and removes what a
//! dead maker left half-made.

use crate::service;
use iceoryx2::node::NodeView;
use iceoryx2::prelude::{
    CallbackProgression, Config, FileName, Node, NodeState, Path as IoxPath, SemanticString, ipc,
};
use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::process::geteuid;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Environment variable that names the default root path.
pub const ROOT_VARIABLE: &str = "OBSERVER_ROOT";

const SEGMENTS: &str = "/dev/shm";
const MAKING_LOCK: &str = "making.lock";
const CLAIM_SUFFIX: &str = ".claim";
/// Unix sockets live below the root path, the prefix in their names: longer ones do not fit their address.
const LONGEST_ROOT_AND_PREFIX_BYTES: usize = 60;
/// Directories that iceoryx2 makes below the root path.
const DIRECTORIES: [&str; 2] = ["nodes", "services"];
const LOCK_PATIENCE: Duration = Duration::from_secs(10);
/// A half-made file older than this has no living maker: creation takes microseconds.
const HALF_MADE_AGE: Duration = Duration::from_millis(250);

/// Why a domain cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DomainError {
    /// The root path cannot serve.
    #[error("root path '{path}': {found}; needed: {needed}")]
    Root {
        /// The path.
        path: String,
        /// What was found.
        found: String,
        /// What would be accepted, and the command that helps.
        needed: String,
    },
    /// A file where the domain's own belongs.
    #[error("'{path}': {found}; needed: {needed}")]
    Foreign {
        /// The file.
        path: String,
        /// What was found.
        found: String,
        /// What would be accepted, and the command that helps.
        needed: String,
    },
    /// Another process holds a lock.
    #[error("{what} is held by process {holder}; {remedy}")]
    Locked {
        /// What is held.
        what: String,
        /// Process id that the lock file names.
        holder: String,
        /// What to do.
        remedy: String,
    },
    /// The operating system refused.
    #[error("{action} '{path}': {cause}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: String,
        /// The system's reason.
        cause: io::Error,
    },
}

fn io_error(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DomainError {
    move |cause| DomainError::Io { action, path: path.display().to_string(), cause }
}

/// One isolated set of services. Processes see each other only inside the same domain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    root: PathBuf,
    prefix: String,
}

impl Domain {
    /// The domain of `$OBSERVER_ROOT`, or the user's own one, `/dev/shm/observer-<uid>`.
    ///
    /// # Errors
    /// As [`Domain::at`].
    pub fn of_user() -> Result<Self, DomainError> {
        let default = || format!("{SEGMENTS}/observer-{}", geteuid().as_raw()).into();
        Self::at(Path::new(&std::env::var_os(ROOT_VARIABLE).unwrap_or_else(default)))
    }

    /// The domain with this root path, or without one [`Domain::of_user`].
    ///
    /// # Errors
    /// As [`Domain::at`].
    pub fn at_or_of_user(root: Option<&Path>) -> Result<Self, DomainError> {
        root.map_or_else(Self::of_user, Self::at)
    }

    /// The domain with this root path. The prefix of its segments is the last component and a hash of the
    /// whole path, so that no two domains share segments.
    ///
    /// # Errors
    /// `Root` where the path is relative, too long for a socket address, or has characters that a file name
    /// of a segment cannot have.
    pub fn at(root: &Path) -> Result<Self, DomainError> {
        let refuse = |found: String, needed: &str| DomainError::Root {
            path: root.display().to_string(),
            found,
            needed: needed.into(),
        };
        let text = root.to_str().unwrap_or_default();
        let name = root.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if !root.is_absolute() || name.is_empty() {
            return Err(refuse("not an absolute path".into(), "for example /dev/shm/flight1"));
        }
        if !name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b)) {
            return Err(refuse(format!("last component '{name}'"), "letters, digits, '-', '_', '.' only"));
        }
        // No name contains the '~', so no prefix is the beginning of another one.
        let prefix = format!("{name}~{:08x}_", hash(text));
        let bytes = text.len() + prefix.len();
        if bytes > LONGEST_ROOT_AND_PREFIX_BYTES {
            let longest = LONGEST_ROOT_AND_PREFIX_BYTES;
            let found = format!("it and its segments' prefix '{prefix}' are {bytes} bytes long");
            return Err(refuse(
                found,
                &format!("at most {longest} bytes: sockets with both in their names live below it"),
            ));
        }
        Ok(Self { root: root.into(), prefix })
    }

    /// The root path.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The prefix of the domain's segments in /dev/shm, and of its services' files.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The configuration for iceoryx2's nodes; files of the working directory are not consulted.
    pub(crate) fn config(&self) -> Config {
        let mut config = Config::default();
        let root = self.root.to_str().expect("checked by Domain::at").as_bytes();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).expect("checked by Domain::at");
        config.global.set_root_path(&IoxPath::new(root).expect("checked by Domain::at"));
        config
    }

    /// The same for programs that are not ours, such as the link between machines (docs/across-machines.md). The
    /// services that those make themselves, mirrors of ours, have qualities like those that the daemon gives.
    pub fn config_for_others(&self) -> Config {
        let mut config = self.config();
        let topic = &mut config.defaults.publish_subscribe;
        topic.max_subscribers = service::MAX_READERS;
        topic.max_publishers = service::MAX_SOURCES;
        topic.max_nodes = service::MAX_NODES;
        topic.subscriber_max_buffer_size = service::ESTIMATE_BUFFER;
        topic.publisher_history_size = 1;
        topic.enable_safe_overflow = true;
        config
    }

    /// Makes the root path if it is missing, waits for the domain's lock, removes what dead makers left
    /// half-made, and returns the lock. Hold it while nodes, services or ports are made.
    ///
    /// # Errors
    /// `Root` where the path is not this user's alone, `Foreign` where another user's file lies in the domain's
    /// place, `Locked` where another process makes something for longer than 10 s, `Io` where the system refuses.
    pub fn lock_for_making(&self) -> Result<MakingLock, DomainError> {
        let deadline = Instant::now() + LOCK_PATIENCE;
        let file = loop {
            match self.take_lock(MAKING_LOCK)? {
                Ok(file) => break file,
                Err(holder) if Instant::now() > deadline => {
                    return Err(DomainError::Locked {
                        what: format!("the lock '{}'", self.root.join(MAKING_LOCK).display()),
                        remedy: format!(
                            "it should last milliseconds: look at that process, and stop it if it hangs (kill {holder})"
                        ),
                        holder,
                    });
                }
                Err(_) => std::thread::sleep(Duration::from_millis(2)),
            }
        };
        self.check_segments()?;
        let removed = self.remove_half_made()?;
        Ok(MakingLock { _file: file, removed })
    }

    /// Claims an instance name for one service; the claim ends with the returned value, or the process.
    ///
    /// # Errors
    /// `Locked` where a living process holds the name.
    pub fn claim_instance(&self, instance: &str) -> Result<InstanceClaim, DomainError> {
        // Under the domain's lock, so that nobody removes the domain, or looks at the claim, meanwhile.
        let _making = self.lock_for_making()?;
        match self.take_lock(&format!("{instance}{CLAIM_SUFFIX}"))? {
            Ok(file) => Ok(InstanceClaim { _file: file }),
            Err(holder) => Err(DomainError::Locked {
                what: format!("instance '{instance}' in {}", self.root.display()),
                remedy: format!(
                    "stop that service (kill {holder}) or start this one with another --instance"
                ),
                holder,
            }),
        }
    }

    /// The living process that holds an instance name, whether it publishes or not; makes nothing.
    ///
    /// # Errors
    /// As [`Domain::lock_for_making`].
    pub fn instance_holder(&self, instance: &str) -> Result<Option<String>, DomainError> {
        if !self.root.exists() {
            return Ok(None);
        }
        // Under the domain's lock, so that a service which claims its name now does not meet our look at it.
        let _making = self.lock_for_making()?;
        let claim = self.root.join(format!("{instance}{CLAIM_SUFFIX}"));
        let Some(mut file) = open_lock_file(&claim, false)? else { return Ok(None) };
        if flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok() {
            return Ok(None);
        }
        let mut holder = String::new();
        file.read_to_string(&mut holder).map_err(io_error("read", &claim))?;
        Ok(Some(if holder.is_empty() { "unknown".into() } else { holder }))
    }

    /// The locked file with our process id in it, or the process id of the holder.
    ///
    /// The last process of a domain removes its files: a lock on a removed file protects nothing, so the
    /// file is opened again until the locked one is the one that is there.
    fn take_lock(&self, name: &str) -> Result<Result<File, String>, DomainError> {
        let path = self.root.join(name);
        loop {
            self.make_root()?;
            let Some(mut file) = open_lock_file(&path, true)? else { continue };
            match flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) if !is_still_at(&file, &path) => {}
                Ok(()) => {
                    file.set_len(0).and_then(|()| file.rewind()).map_err(io_error("write", &path))?;
                    write!(file, "{}", std::process::id()).map_err(io_error("write", &path))?;
                    return Ok(Ok(file));
                }
                Err(rustix::io::Errno::WOULDBLOCK | rustix::io::Errno::INTR) => {
                    let mut holder = String::new();
                    file.read_to_string(&mut holder).map_err(io_error("read", &path))?;
                    return Ok(Err(if holder.is_empty() { "unknown".into() } else { holder }));
                }
                Err(error) => return Err(io_error("lock", &path)(error.into())),
            }
        }
    }

    /// Whether a service holds an instance of this domain.
    fn has_claims(&self) -> Result<bool, DomainError> {
        for claim in files_where(&self.root, |name| name.ends_with(CLAIM_SUFFIX))? {
            let Some(file) = open_lock_file(&claim, false)? else { continue };
            if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Removes what the domain has made, and the root path if nothing else is in it. Only when no process
    /// uses it any more.
    ///
    /// # Errors
    /// `Io` where the system refuses.
    pub fn remove(&self) -> Result<(), DomainError> {
        for segment in self.segments()? {
            // In /dev/shm nobody else's file can be removed, and it is not the domain's.
            if is_own_file(&segment) {
                remove_file(&segment)?;
            }
        }
        for directory in DIRECTORIES.map(|name| self.root.join(name)) {
            match fs::remove_dir_all(&directory) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(io_error("remove directory", &directory)(error));
                }
                _ => {}
            }
        }
        for lock in files_where(&self.root, is_lock)? {
            remove_file(&lock)?;
        }
        match fs::remove_dir(&self.root) {
            Err(error)
                if ![io::ErrorKind::NotFound, io::ErrorKind::DirectoryNotEmpty].contains(&error.kind()) =>
            {
                Err(io_error("remove directory", &self.root)(error))
            }
            _ => Ok(()),
        }
    }

    /// Removes every file of the domain if no living process uses it. Call it last, after all ports and
    /// nodes of this process are dropped.
    ///
    /// # Errors
    /// As [`Domain::lock_for_making`] and [`Domain::remove`].
    pub fn remove_if_unused(&self) -> Result<(), DomainError> {
        if !self.root.exists() {
            return Ok(());
        }
        let _making = self.lock_for_making()?;
        let mut in_use = self.has_claims()?;
        let listed = Node::<ipc::Service>::list(&self.config(), |node| {
            in_use |= !matches!(node, NodeState::Dead(_));
            CallbackProgression::Continue
        });
        if listed.is_ok() && !in_use { self.remove() } else { Ok(()) }
    }

    /// What dead processes left behind, and how many living ones there are; removes nothing, makes nothing.
    ///
    /// # Errors
    /// `Locked` where another process makes something meanwhile, `Io` where a directory cannot be read.
    pub fn leftovers(&self) -> Result<Leftovers, DomainError> {
        let mut left = Leftovers::default();
        // Held, nobody makes or claims anything: what is half-made now has no living maker.
        let making = self.root.join(MAKING_LOCK);
        let _lock = match File::open(&making) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(io_error("open lock file", &making)(error)),
            Ok(file) => Some(self.wait_for_lock(file)?),
        };
        for (file, unfinished) in self.half_made_candidates()? {
            left.files += 1;
            if fs::metadata(&file).is_ok_and(|metadata| unfinished(metadata.permissions().mode())) {
                left.half_made.push(file);
            }
        }
        for lock in files_where(&self.root, is_lock)? {
            left.files += 1;
            let is_free = |file: File| flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok();
            if lock != making && File::open(&lock).is_ok_and(is_free) {
                left.dead_claims.push(lock);
            }
        }
        // A half-made segment can hold up whoever lists the nodes.
        if left.half_made.is_empty() {
            let _ = Node::<ipc::Service>::list(&self.config(), |node| {
                match node {
                    NodeState::Dead(node) => {
                        let pid = node.id().pid::<ipc::Service>();
                        left.dead_pids.push(pid.map_or(0, |pid| pid.value() as u32));
                    }
                    _ => left.living += 1,
                }
                CallbackProgression::Continue
            });
        }
        left.dead_pids.sort_unstable();
        left.dead_pids.dedup();
        Ok(left)
    }

    fn wait_for_lock(&self, file: File) -> Result<File, DomainError> {
        let deadline = Instant::now() + Duration::from_secs(1);
        while flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            if Instant::now() > deadline {
                return Err(DomainError::Locked {
                    what: format!("the lock '{}'", self.root.join(MAKING_LOCK).display()),
                    holder: fs::read_to_string(self.root.join(MAKING_LOCK)).unwrap_or_default(),
                    remedy: "it should last milliseconds: look at that process".into(),
                });
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(file)
    }

    /// The domain's files in /dev/shm.
    ///
    /// # Errors
    /// `Io` where the directory cannot be read.
    pub fn segments(&self) -> Result<Vec<PathBuf>, DomainError> {
        files_with_prefix(Path::new(SEGMENTS), &self.prefix)
    }

    /// Refuses what another user planted where the domain's segments lie: /dev/shm is everyone's.
    ///
    /// # Errors
    /// `Foreign` with the first such file.
    pub fn check_segments(&self) -> Result<(), DomainError> {
        match self.segments()?.iter().find(|segment| !is_own_file(segment)) {
            Some(segment) => Err(foreign(segment, &described(segment))),
            None => Ok(()),
        }
    }

    /// iceoryx2 0.10.0 opens one segment to everyone, the count of nodes (`enable_global_access` in its
    /// `node/global_management_segment.rs`). Whoever has it open could cut it short while we read it: so a copy
    /// of the owner's alone takes its place. Call it under the domain's lock; no node is being made then, and
    /// only that maps it.
    pub(crate) fn close_segments_to_others(&self) -> Result<(), DomainError> {
        for segment in self.segments()? {
            let Ok(metadata) = fs::symlink_metadata(&segment) else { continue };
            if metadata.permissions().mode() & 0o077 != 0 {
                let copy = segment.with_file_name(format!("{}closing", self.prefix));
                remove_file(&copy)?;
                let content = fs::read(&segment).map_err(io_error("read", &segment))?;
                let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&copy);
                let written = file.and_then(|mut file| {
                    file.set_permissions(fs::Permissions::from_mode(0o600))?;
                    file.write_all(&content)
                });
                written.map_err(io_error("write", &copy))?;
                fs::rename(&copy, &segment).map_err(io_error("replace", &segment))?;
            }
        }
        Ok(())
    }

    /// Makes the root path if it is missing, and sees to it that it is this user's alone.
    fn make_root(&self) -> Result<(), DomainError> {
        self.check_directories_above()?;
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(&self.root);
        // What is there instead of a directory, and whose it is, says more than why none could be made.
        let metadata = match fs::symlink_metadata(&self.root) {
            Ok(metadata) => metadata,
            Err(error) => return Err(io_error("create directory", &self.root)(made.err().unwrap_or(error))),
        };
        let user = geteuid().as_raw();
        if !metadata.is_dir() || metadata.uid() != user {
            return Err(DomainError::Root {
                path: self.root.display().to_string(),
                found: described(&self.root),
                needed: format!(
                    "a directory of user id {user}: run as its owner, or choose a root path of your own (--root, or {ROOT_VARIABLE} in the environment)"
                ),
            });
        }
        // The lock is the first file made here and the last one removed: without it, nothing here is ours.
        // So it is looked for after the others: another process may be making them just now, or removing them.
        if let Some(other) = files_where(&self.root, |_| true)?.first()
            && files_where(&self.root, is_lock)?.is_empty()
            && other.exists()
        {
            return Err(DomainError::Root {
                path: self.root.display().to_string(),
                found: format!("a directory with other files in it ('{}')", other.display()),
                needed: "a directory of the domain's own, empty or not there yet (--root, or OBSERVER_ROOT)"
                    .into(),
            });
        }
        if metadata.permissions().mode() & 0o777 != 0o700 {
            fs::set_permissions(&self.root, fs::Permissions::from_mode(0o700))
                .map_err(io_error("close to others", &self.root))?;
        }
        Ok(())
    }

    /// Whoever may rename the root path may put another one in its place.
    fn check_directories_above(&self) -> Result<(), DomainError> {
        for directory in self.root.ancestors().skip(1) {
            let Ok(metadata) = fs::metadata(directory) else { continue };
            let (owner, mode) = (metadata.uid(), metadata.permissions().mode());
            let is_trusted = owner == 0 || owner == geteuid().as_raw();
            let is_open = mode & 0o002 != 0 && mode & 0o1000 == 0;
            if !is_trusted || is_open {
                let what = if is_open {
                    "is writable by everyone".into()
                } else {
                    format!("belongs to user id {owner}")
                };
                return Err(DomainError::Root {
                    path: self.root.display().to_string(),
                    found: format!(
                        "'{}' above it {what}, who may put another one in its place",
                        directory.display()
                    ),
                    needed: "below directories of root or of your own, for example /dev/shm/flight1".into(),
                });
            }
        }
        Ok(())
    }

    /// A service file still writable by its owner (0600; finished is 0400) and a segment not yet readable
    /// (0200) were never finished. A young one is given the time in which a living maker finishes it.
    fn remove_half_made(&self) -> Result<usize, DomainError> {
        let mut removed = 0;
        for (file, unfinished) in self.half_made_candidates()? {
            while let Ok(metadata) = fs::symlink_metadata(&file) {
                if !unfinished(metadata.permissions().mode()) {
                    break;
                }
                let made = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                let age = SystemTime::now().duration_since(made).unwrap_or(HALF_MADE_AGE);
                if age >= HALF_MADE_AGE {
                    remove_file(&file)?;
                    removed += 1;
                    break;
                }
                std::thread::sleep(HALF_MADE_AGE - age);
            }
        }
        Ok(removed)
    }

    #[allow(clippy::type_complexity)] // a pair of a file and how to tell that it is unfinished
    fn half_made_candidates(&self) -> Result<Vec<(PathBuf, fn(u32) -> bool)>, DomainError> {
        let services = files_with_prefix(&self.root.join("services"), &self.prefix)?;
        let services = services.into_iter().filter(|file| file.extension().is_some_and(|e| e == "service"));
        let writable: fn(u32) -> bool = |mode| mode & 0o200 != 0;
        let unreadable: fn(u32) -> bool = |mode| mode & 0o400 == 0;
        Ok(services
            .map(|file| (file, writable))
            .chain(self.segments()?.into_iter().map(|file| (file, unreadable)))
            .collect())
    }
}

/// What is in a domain that should not be.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Services and segments whose maker died before they were finished.
    pub half_made: Vec<PathBuf>,
    /// Dead processes whose nodes are still there; 0 for an unknown one.
    pub dead_pids: Vec<u32>,
    /// Claims of instances whose services are dead.
    pub dead_claims: Vec<PathBuf>,
    /// Nodes of living processes; not counted while anything is half-made.
    pub living: usize,
    /// Services, segments and locks, of the living and the dead.
    pub files: usize,
}

impl Leftovers {
    /// Whether all there is belongs to living processes.
    pub fn is_clean(&self) -> bool {
        let none = self.half_made.is_empty() && self.dead_pids.is_empty() && self.dead_claims.is_empty();
        none && (self.living > 0 || self.files == 0)
    }
}

/// Held while something is made in a domain.
#[derive(Debug)]
pub struct MakingLock {
    _file: File,
    removed: usize,
}

impl MakingLock {
    /// Half-made files of dead processes that were removed when the lock was taken.
    pub fn half_made_files_removed(&self) -> usize {
        self.removed
    }
}

/// Held by the one service of an instance name.
#[derive(Debug)]
pub struct InstanceClaim {
    _file: File,
}

fn is_lock(name: &str) -> bool {
    name == MAKING_LOCK || name.ends_with(CLAIM_SUFFIX)
}

/// The lock file at `path`, made if it may be; `None` if it, or its directory, is not there.
fn open_lock_file(path: &Path, create: bool) -> Result<Option<File>, DomainError> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(create).truncate(false).mode(0o600);
    // No link is followed, and a pipe in its place does not make us wait.
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    let file = match options.open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(_) if fs::symlink_metadata(path).is_ok_and(|metadata| !metadata.is_file()) => {
            return Err(foreign(path, &described(path)));
        }
        file => file.map_err(io_error("open lock file", path))?,
    };
    let metadata = file.metadata().map_err(io_error("look at", path))?;
    if !metadata.is_file() || metadata.uid() != geteuid().as_raw() || metadata.nlink() > 1 {
        return Err(foreign(path, &described(path)));
    }
    if metadata.permissions().mode() & 0o777 != 0o600 {
        // The umask took a bit that the next one to open it needs.
        file.set_permissions(fs::Permissions::from_mode(0o600)).map_err(io_error("close to others", path))?;
    }
    Ok(Some(file))
}

fn foreign(path: &Path, found: &str) -> DomainError {
    DomainError::Foreign {
        path: path.display().to_string(),
        found: found.into(),
        needed: format!(
            "only files that user id {} made here: look who made it, then remove it (as its owner or root: rm '{}'), or choose another root path (--root, or {ROOT_VARIABLE})",
            geteuid().as_raw(),
            path.display()
        ),
    }
}

/// What is there, in words.
fn described(path: &Path) -> String {
    let Ok(metadata) = fs::symlink_metadata(path) else { return "vanished while it was looked at".into() };
    let kind = metadata.file_type();
    let kind = match () {
        () if kind.is_dir() => "a directory",
        () if kind.is_symlink() => "a symbolic link",
        () if kind.is_file() && metadata.nlink() > 1 => "a file with several names",
        () if kind.is_file() => "a file",
        () => "neither a file nor a directory",
    };
    let (owner, user) = (metadata.uid(), geteuid().as_raw());
    format!("{kind} that belongs to user id {owner}; this process runs as user id {user}")
}

/// A file of this user; one that vanished meanwhile counts as such.
fn is_own_file(path: &Path) -> bool {
    fs::symlink_metadata(path)
        .map_or(true, |metadata| metadata.is_file() && metadata.uid() == geteuid().as_raw())
}

/// FNV-1a, 32 bits.
fn hash(text: &str) -> u32 {
    text.bytes().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

fn is_still_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::metadata(path)) {
        (Ok(locked), Ok(there)) => locked.ino() == there.ino() && locked.dev() == there.dev(),
        _ => false,
    }
}

fn files_with_prefix(directory: &Path, prefix: &str) -> Result<Vec<PathBuf>, DomainError> {
    files_where(directory, |name| name.starts_with(prefix))
}

fn files_where(directory: &Path, test: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>, DomainError> {
    let entries = match fs::read_dir(directory) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(io_error("read directory", directory))?,
    };
    Ok(entries
        .flatten()
        .filter(|entry| entry.file_name().to_str().is_some_and(&test))
        .map(|entry| entry.path())
        .collect())
}

fn remove_file(path: &Path) -> Result<(), DomainError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_error("remove", path)(error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn temporary() -> (tempfile::TempDir, Domain) {
        let directory = tempfile::Builder::new().prefix("ot").tempdir_in(SEGMENTS).unwrap();
        let domain = Domain::at(directory.path()).unwrap();
        (directory, domain)
    }

    #[test]
    fn unusable_root_paths_are_refused_with_a_reason() {
        for (root, reason) in [
            ("relative/path", "not an absolute path"),
            ("/tmp/with space", "letters, digits"),
            ("/tmp/0123456789012345678901234567890123456789", "at most 60 bytes"),
        ] {
            let error = Domain::at(Path::new(root)).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn a_claimed_instance_names_its_holder_to_the_second() {
        let (_directory, domain) = temporary();
        let claim = domain.claim_instance("vehicle").unwrap();
        let error = domain.claim_instance("vehicle").unwrap_err().to_string();
        assert!(error.contains(&std::process::id().to_string()), "{error}");
        assert_eq!(domain.instance_holder("vehicle").unwrap(), Some(std::process::id().to_string()));
        assert_eq!(domain.instance_holder("other").unwrap(), None);
        drop(claim);
        assert_eq!(domain.instance_holder("vehicle").unwrap(), None);
        domain.claim_instance("vehicle").unwrap();
    }

    #[test]
    fn leftovers_are_what_no_living_process_holds() {
        let (directory, domain) = temporary();
        assert_eq!(domain.leftovers().unwrap(), Leftovers::default());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "looking makes nothing");
        let claim = domain.claim_instance("vehicle").unwrap();
        let held = domain.leftovers().unwrap();
        assert_eq!((held.dead_claims.len(), held.files), (0, 2));
        drop(claim);
        let left = domain.leftovers().unwrap();
        assert_eq!(left.dead_claims, [directory.path().join("vehicle.claim")]);
        assert!(!left.is_clean());
    }

    #[test]
    fn only_the_domains_own_files_are_removed() {
        let (directory, domain) = temporary();
        let precious = directory.path().join("logs");
        fs::create_dir(&precious).unwrap();
        // A directory that is somebody else's is refused before anything is made in it.
        let error = domain.lock_for_making().unwrap_err().to_string();
        assert!(error.contains("other files in it"), "{error}");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
        fs::remove_dir(&precious).unwrap();
        drop(domain.lock_for_making().unwrap());
        fs::create_dir(&precious).unwrap();
        let neighbour = Domain::at(
            &directory
                .path()
                .with_file_name(format!("{}_2", directory.path().file_name().unwrap().to_str().unwrap())),
        )
        .unwrap();
        let segment = Path::new(SEGMENTS).join(format!("{}data", neighbour.prefix));
        File::create(&segment).unwrap();
        domain.remove_if_unused().unwrap();
        assert!(precious.exists() && segment.exists());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
        neighbour.remove().unwrap();
        assert!(!segment.exists());
    }

    #[test]
    fn half_made_files_are_removed_and_finished_ones_stay() {
        let (directory, domain) = temporary();
        drop(domain.lock_for_making().unwrap());
        let services = directory.path().join("services");
        fs::create_dir(&services).unwrap();
        let write = |path: PathBuf, mode: u32| {
            File::create(&path).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let service = |name: &str| services.join(format!("{}{name}.service", domain.prefix));
        let segment = |name: &str| Path::new(SEGMENTS).join(format!("{}{name}", domain.prefix));
        let half_made = [write(service("a"), 0o600), write(segment("a"), 0o200)];
        let finished = [write(service("b"), 0o400), write(segment("b"), 0o600)];
        // Looking removes nothing.
        let mut found = domain.leftovers().unwrap();
        found.half_made.sort_by_key(|file| !file.starts_with(directory.path()));
        assert_eq!((found.half_made.as_slice(), found.is_clean()), (&half_made[..], false));
        let lock = domain.lock_for_making().unwrap();
        assert_eq!(lock.half_made_files_removed(), 2);
        assert!(half_made.iter().all(|file| !file.exists()));
        assert!(finished.iter().all(|file| file.exists()));
        drop(lock);
        domain.remove().unwrap();
        assert!(!finished[1].exists() && !directory.path().exists());
    }
}
