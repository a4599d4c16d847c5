//! What dead processes leave in a domain, and the removal of a domain that no process uses.

use crate::error::{DomainError, io_error};
use crate::files::{DIRECTORIES, MAKING_LOCK, files_where, is_lock, is_own_file, remove_file};
use crate::root::Domain;
use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Node, NodeState, ipc};
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

/// What dead processes have left in a domain.
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
    /// Whether everything belongs to living processes.
    pub fn is_clean(&self) -> bool {
        let none = self.half_made.is_empty() && self.dead_pids.is_empty() && self.dead_claims.is_empty();
        none && (self.living > 0 || self.files == 0)
    }
}

impl Domain {
    /// Finds what dead processes have left, and counts the living ones; removes nothing, makes nothing.
    ///
    /// # Errors
    /// `Locked` where another process makes something meanwhile, `Io` where a directory cannot be read.
    pub fn leftovers(&self) -> Result<Leftovers, DomainError> {
        let mut left = Leftovers::default();
        // While this is held, no process makes or claims anything: a half-made file has no living maker.
        let making = self.root().join(MAKING_LOCK);
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
        for lock in files_where(self.root(), is_lock)? {
            left.files += 1;
            let is_free = |file: File| flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok();
            if lock != making && File::open(&lock).is_ok_and(is_free) {
                left.dead_claims.push(lock);
            }
        }
        // A half-made segment can block a process that lists the nodes.
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

    /// Removes what the domain has made, and the root path if nothing else is in it. Only when no process
    /// uses it any more.
    ///
    /// # Errors
    /// `Io` where the system refuses.
    pub fn remove(&self) -> Result<(), DomainError> {
        for segment in self.segments()? {
            // Another user's file in /dev/shm cannot be removed, and is not the domain's.
            if is_own_file(&segment) {
                remove_file(&segment)?;
            }
        }
        for directory in DIRECTORIES.map(|name| self.root().join(name)) {
            match fs::remove_dir_all(&directory) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(io_error("remove directory", &directory)(error));
                }
                _ => {}
            }
        }
        for lock in files_where(self.root(), is_lock)? {
            remove_file(&lock)?;
        }
        match fs::remove_dir(self.root()) {
            Err(error)
                if ![io::ErrorKind::NotFound, io::ErrorKind::DirectoryNotEmpty].contains(&error.kind()) =>
            {
                Err(io_error("remove directory", self.root())(error))
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
        if !self.root().exists() {
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
}
