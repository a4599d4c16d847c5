//! The directory in which snapshots are stored.

use std::path::{Path, PathBuf};

/// Environment variable that names the directory of the snapshots.
pub const STATE_VARIABLE: &str = "OBSERVER_STATE";

/// The directory of the snapshots: the requested one (`None` for "none"), or that of the service manager or the user's home.
pub fn state_directory(asked: Option<&Path>) -> Option<PathBuf> {
    if let Some(asked) = asked {
        let is_none = asked.as_os_str() == "none" || asked.as_os_str().is_empty();
        return (!is_none).then(|| asked.to_owned());
    }
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    absolute("STATE_DIRECTORY")
        .or_else(|| Some(absolute("XDG_STATE_HOME")?.join("observer")))
        .or_else(|| Some(absolute("HOME")?.join(".local/state/observer")))
}
