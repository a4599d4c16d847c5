//! The names of a domain's files; listing and removing them.

use crate::error::{DomainError, io_error};
use rustix::process::geteuid;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Where the operating system keeps shared memory.
pub(crate) const SEGMENTS: &str = "/dev/shm";
/// The file below the root path that is locked while something is made.
pub(crate) const MAKING_LOCK: &str = "making.lock";
/// End of the name of the file that the one service of an instance holds locked.
pub(crate) const CLAIM_SUFFIX: &str = ".claim";
/// Directories that iceoryx2 makes below the root path.
pub(crate) const DIRECTORIES: [&str; 2] = ["nodes", "services"];

/// A file of this user; one that vanished meanwhile counts as such.
pub(crate) fn is_own_file(path: &Path) -> bool {
    fs::symlink_metadata(path)
        .map_or(true, |metadata| metadata.is_file() && metadata.uid() == geteuid().as_raw())
}

pub(crate) fn is_still_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::metadata(path)) {
        (Ok(locked), Ok(there)) => locked.ino() == there.ino() && locked.dev() == there.dev(),
        _ => false,
    }
}

pub(crate) fn files_where(
    directory: &Path,
    test: impl Fn(&str) -> bool,
) -> Result<Vec<PathBuf>, DomainError> {
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

pub(crate) fn files_with_prefix(directory: &Path, prefix: &str) -> Result<Vec<PathBuf>, DomainError> {
    files_where(directory, |name| name.starts_with(prefix))
}

pub(crate) fn remove_file(path: &Path) -> Result<(), DomainError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_error("remove", path)(error)),
        _ => Ok(()),
    }
}

pub(crate) fn is_lock(name: &str) -> bool {
    name == MAKING_LOCK || name.ends_with(CLAIM_SUFFIX)
}
