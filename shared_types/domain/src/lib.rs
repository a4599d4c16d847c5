//! A domain: the shared memory in which programs find each other. It has a root path, a prefix, and a lock under which
//! anything in it is made.
//!
//! A domain consists of `<root>/` (static files, sockets, locks) and `/dev/shm/<prefix>*` (segments). Only their owner
//! has access, with any umask; another user's file in either is refused with its name. The domain removes only files that it
//! has made itself.
//!
//! A process that is killed while it makes a service, a node or a port leaves a half-made file, which would make every later
//! start fail. Therefore a process takes the domain's lock before it makes anything, and removes half-made files first.
//!
//! | file | holds |
//! |---|---|
//! | `root` | [`Domain`]: root path, prefix, iceoryx2's configuration |
//! | `locks` | [`MakingLock`], [`InstanceClaim`] |
//! | `leftovers` | [`Leftovers`], and the removal of a domain |
//! | `half_made` | files whose maker died before they were finished |
//! | `permissions` | checks that only the owner has access to root path and segments |
//! | `files` | names of a domain's files; listing and removing them |
//! | `error` | [`DomainError`] |
//!
//! Depends on iceoryx2 and the system, and on no other crate of this workspace.

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
