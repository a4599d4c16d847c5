//! The lock under which anything in a domain is made, and the claim of the one service of an instance.

use crate::error::{DomainError, described, foreign, io_error};
use crate::files::{CLAIM_SUFFIX, MAKING_LOCK, files_where, is_still_at};
use crate::root::Domain;
use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::process::geteuid;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

const LOCK_PATIENCE: Duration = Duration::from_secs(10);

/// Held while something is made in a domain.
#[derive(Debug)]
pub struct MakingLock {
    _file: File,
}

/// Held by the one service of an instance name.
#[derive(Debug)]
pub struct InstanceClaim {
    _file: File,
}

impl Domain {
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
                        what: format!("the lock '{}'", self.root().join(MAKING_LOCK).display()),
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
        self.remove_half_made()?;
        Ok(MakingLock { _file: file })
    }

    /// Claims an instance name for one service; the claim ends with the returned value, or the process.
    ///
    /// # Errors
    /// `Locked` where a living process holds the name.
    pub fn claim_instance(&self, instance: &str) -> Result<InstanceClaim, DomainError> {
        // Under the domain's lock, so that no process removes the domain, or looks at the claim, meanwhile.
        let _making = self.lock_for_making()?;
        match self.take_lock(&format!("{instance}{CLAIM_SUFFIX}"))? {
            Ok(file) => Ok(InstanceClaim { _file: file }),
            Err(holder) => Err(DomainError::Locked {
                what: format!("instance '{instance}' in {}", self.root().display()),
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
        if !self.root().exists() {
            return Ok(None);
        }
        // Under the domain's lock, so that a service that claims its name now is not disturbed by this check.
        let _making = self.lock_for_making()?;
        let claim = self.root().join(format!("{instance}{CLAIM_SUFFIX}"));
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
        let path = self.root().join(name);
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
    pub(crate) fn has_claims(&self) -> Result<bool, DomainError> {
        for claim in files_where(self.root(), |name| name.ends_with(CLAIM_SUFFIX))? {
            let Some(file) = open_lock_file(&claim, false)? else { continue };
            if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    pub(crate) fn wait_for_lock(&self, file: File) -> Result<File, DomainError> {
        let deadline = Instant::now() + Duration::from_secs(1);
        while flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            if Instant::now() > deadline {
                return Err(DomainError::Locked {
                    what: format!("the lock '{}'", self.root().join(MAKING_LOCK).display()),
                    holder: fs::read_to_string(self.root().join(MAKING_LOCK)).unwrap_or_default(),
                    remedy: "it should last milliseconds: look at that process".into(),
                });
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(file)
    }
}

/// The lock file at `path`, made if it may be; `None` if it, or its directory, is not there.
pub(crate) fn open_lock_file(path: &Path, create: bool) -> Result<Option<File>, DomainError> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(create).truncate(false).mode(0o600);
    // Links are not followed, and a pipe in its place does not block.
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
        // The umask has removed a bit that the next process needs to open it.
        file.set_permissions(fs::Permissions::from_mode(0o600)).map_err(io_error("close to others", path))?;
    }
    Ok(Some(file))
}
