//! The error of a domain that cannot be used: what was found, what is needed, and the command that helps.

use rustix::process::geteuid;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Environment variable that names the default root path.
pub const ROOT_VARIABLE: &str = "OBSERVER_ROOT";

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

pub(crate) fn io_error(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DomainError {
    move |cause| DomainError::Io { action, path: path.display().to_string(), cause }
}

pub(crate) fn foreign(path: &Path, found: &str) -> DomainError {
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
pub(crate) fn described(path: &Path) -> String {
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
