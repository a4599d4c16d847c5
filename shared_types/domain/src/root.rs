//! The root path of a domain, and the prefix and configuration that follow from it.

use crate::error::{DomainError, ROOT_VARIABLE};
use crate::files::{SEGMENTS, files_with_prefix};
use iceoryx2::prelude::{Config, FileName, Path as IoxPath, SemanticString};
use rustix::process::geteuid;
use std::path::{Path, PathBuf};

/// Unix sockets live below the root path, the prefix in their names: longer ones do not fit their address.
const MAX_ROOT_AND_PREFIX_BYTES: usize = 60;

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
        if bytes > MAX_ROOT_AND_PREFIX_BYTES {
            let longest = MAX_ROOT_AND_PREFIX_BYTES;
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

    /// The domain's files in /dev/shm.
    ///
    /// # Errors
    /// `Io` where the directory cannot be read.
    pub fn segments(&self) -> Result<Vec<PathBuf>, DomainError> {
        files_with_prefix(Path::new(SEGMENTS), &self.prefix)
    }

    /// The configuration for iceoryx2's nodes; files of the working directory are not consulted.
    pub fn config(&self) -> Config {
        let mut config = Config::default();
        let root = self.root.to_str().expect("checked by Domain::at").as_bytes();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).expect("checked by Domain::at");
        config.global.set_root_path(&IoxPath::new(root).expect("checked by Domain::at"));
        config
    }
}

/// FNV-1a, 32 bits.
fn hash(text: &str) -> u32 {
    text.bytes().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}
