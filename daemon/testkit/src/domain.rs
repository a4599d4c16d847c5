//! A shared-memory domain for one test.

use crate::wait::PATIENCE;
use shared_types::payload::{Status, command};
use shared_types::{Client, Domain};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A root path of its own, removed with all segments when the test ends.
pub struct TestDomain {
    /// The domain.
    pub domain: Domain,
    /// Where its services keep their snapshots.
    pub state: TempDir,
    _root: TempDir,
}

impl TestDomain {
    /// A domain that nothing is in yet.
    #[allow(clippy::new_without_default)] // it makes directories
    pub fn new() -> Self {
        // In memory, the state as well: a busy disk may take seconds to sync.
        let directory = |prefix| tempfile::Builder::new().prefix(prefix).tempdir_in("/dev/shm").unwrap();
        let root = directory("ot");
        Self { domain: Domain::at(root.path()).unwrap(), state: directory("os"), _root: root }
    }

    /// The root path.
    pub fn root(&self) -> &Path {
        self.domain.root()
    }

    /// A client of the instance `vehicle`, as soon as it runs.
    pub fn client(&self) -> Client {
        Client::connect(&self.domain, "vehicle", PATIENCE).unwrap()
    }

    /// What the instance `vehicle` answers to the command `status`.
    pub fn status(&self) -> Status {
        self.client().command(command::STATUS, PATIENCE).unwrap().status
    }

    /// Nothing of the domain is left but, perhaps, its empty root path.
    ///
    /// # Panics
    /// If something is left.
    #[track_caller]
    pub fn assert_clean(&self) {
        assert_eq!(self.domain.segments().unwrap(), Vec::<PathBuf>::new());
        let left: Vec<_> = std::fs::read_dir(self.root()).into_iter().flatten().flatten().collect();
        assert!(left.is_empty(), "{left:?}");
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        let _ = self.domain.remove();
    }
}
