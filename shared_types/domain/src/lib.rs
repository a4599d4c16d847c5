//! Which shared memory: a root path, a prefix, and the lock under which anything in it is made.
//!
//! A domain consists of `<root>/` (static files, sockets, locks) and `/dev/shm/<prefix>*` (segments). Both are open to
//! their owner alone, whatever the umask; another user's file in either is refused by name. Only files that the domain
//! itself made are ever removed.
//!
//! A process that is killed while it makes a service, a node or a port leaves a half-made file that would stop every
//! later start. Therefore a process takes the domain's lock before it makes anything, and removes what a dead one left.
//!
//! | file | holds |
//! |---|---|
//! | `root` | [`Domain`]: root path, prefix, iceoryx2's configuration |
//! | `locks` | [`MakingLock`], [`InstanceClaim`] |
//! | `leftovers` | [`Leftovers`], and the removal of a domain |
//! | `half_made` | files whose maker died before they were finished |
//! | `permissions` | root path and segments are the owner's alone |
//! | `files` | what the files of a domain are called; how they are listed and removed |
//! | `error` | [`DomainError`] |
//!
//! Depends on iceoryx2 and the system alone, on no other crate of this workspace.

mod error;
mod files;
mod half_made;
mod leftovers;
mod locks;
mod permissions;
mod root;

pub use error::{DomainError, ROOT_VARIABLE};
pub use leftovers::Leftovers;
pub use locks::{InstanceClaim, MakingLock};
pub use root::Domain;
