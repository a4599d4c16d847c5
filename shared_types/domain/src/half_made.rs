//! Finds files whose maker died before they were finished.
//!
//! iceoryx2 finishes a file by changing its mode: a service file from 0600 to 0400, a segment from 0200 to 0600.

use crate::error::DomainError;
use crate::files::{files_with_prefix, remove_file};
use crate::root::Domain;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

/// A half-made file older than this has no living maker: creation takes microseconds.
const HALF_MADE_AGE: Duration = Duration::from_millis(250);

/// Whether a file of this mode is unfinished.
pub(crate) type IsUnfinished = fn(u32) -> bool;

impl Domain {
    /// A service file still writable by its owner (0600; finished is 0400) and a segment not yet readable
    /// (0200) were never finished. A young one is given the time in which a living maker finishes it.
    pub(crate) fn remove_half_made(&self) -> Result<(), DomainError> {
        for (file, unfinished) in self.half_made_candidates()? {
            while let Ok(metadata) = fs::symlink_metadata(&file) {
                if !unfinished(metadata.permissions().mode()) {
                    break;
                }
                let made = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                let age = SystemTime::now().duration_since(made).unwrap_or(HALF_MADE_AGE);
                if age >= HALF_MADE_AGE {
                    remove_file(&file)?;
                    break;
                }
                std::thread::sleep(HALF_MADE_AGE - age);
            }
        }
        Ok(())
    }

    pub(crate) fn half_made_candidates(&self) -> Result<Vec<(PathBuf, IsUnfinished)>, DomainError> {
        let services = files_with_prefix(&self.root().join("services"), self.prefix())?;
        let services = services.into_iter().filter(|file| file.extension().is_some_and(|e| e == "service"));
        let writable: IsUnfinished = |mode| mode & 0o200 != 0;
        let unreadable: IsUnfinished = |mode| mode & 0o400 == 0;
        Ok(services
            .map(|file| (file, writable))
            .chain(self.segments()?.into_iter().map(|file| (file, unreadable)))
            .collect())
    }
}
