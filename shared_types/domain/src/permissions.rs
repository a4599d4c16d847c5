//! Only the owner has access to root path and segments: sets the modes, checks them, and corrects that of a file which
//! iceoryx2 opens to everyone.

use crate::error::{DomainError, ROOT_VARIABLE, described, foreign, io_error};
use crate::files::{files_where, is_lock, is_own_file, remove_file};
use crate::root::Domain;
use rustix::process::geteuid;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};

impl Domain {
    /// Refuses files of other users among the domain's segments, since every user may write to /dev/shm.
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
    /// `node/global_management_segment.rs`). A process that has it open could truncate it while this process reads it. Therefore a
    /// copy that only the owner can open replaces it. Call it under the domain's lock; no node is being made then, and
    /// only that maps it.
    pub fn close_segments_to_others(&self) -> Result<(), DomainError> {
        for segment in self.segments()? {
            let Ok(metadata) = fs::symlink_metadata(&segment) else { continue };
            if metadata.permissions().mode() & 0o077 != 0 {
                let copy = segment.with_file_name(format!("{}closing", self.prefix()));
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

    /// Makes the root path if it is missing, and ensures that only this user has access.
    pub(crate) fn make_root(&self) -> Result<(), DomainError> {
        self.check_directories_above()?;
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(self.root());
        // The existing file and its owner explain more than the system's reason.
        let metadata = match fs::symlink_metadata(self.root()) {
            Ok(metadata) => metadata,
            Err(error) => return Err(io_error("create directory", self.root())(made.err().unwrap_or(error))),
        };
        let user = geteuid().as_raw();
        if !metadata.is_dir() || metadata.uid() != user {
            return Err(DomainError::Root {
                path: self.root().display().to_string(),
                found: described(self.root()),
                needed: format!(
                    "a directory of user id {user}: run as its owner, or choose a root path of your own (--root, or {ROOT_VARIABLE} in the environment)"
                ),
            });
        }
        // The lock is the first file made here and the last one removed: without it, nothing here is ours.
        // So it is looked for after the others: another process may be making them just now, or removing them.
        if let Some(other) = files_where(self.root(), |_| true)?.first()
            && files_where(self.root(), is_lock)?.is_empty()
            && other.exists()
        {
            return Err(DomainError::Root {
                path: self.root().display().to_string(),
                found: format!("a directory with other files in it ('{}')", other.display()),
                needed: "a directory of the domain's own, empty or not there yet (--root, or OBSERVER_ROOT)"
                    .into(),
            });
        }
        if metadata.permissions().mode() & 0o777 != 0o700 {
            fs::set_permissions(self.root(), fs::Permissions::from_mode(0o700))
                .map_err(io_error("close to others", self.root()))?;
        }
        Ok(())
    }

    /// Checks the directories above: a user who may rename the root path could replace it.
    fn check_directories_above(&self) -> Result<(), DomainError> {
        for directory in self.root().ancestors().skip(1) {
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
                    path: self.root().display().to_string(),
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
}
