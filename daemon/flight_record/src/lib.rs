//! The file format of flight records: every sample, command and tick of the service's loop, replayable to the same bits.
//!
//! The daemon writes records; the importers and the bench read them. This crate depends on `shared_types` and knows neither
//! engine nor configuration: it stores a checkpoint as bytes and a configuration as text.
//!
//! | file | holds |
//! |---|---|
//! | `frame` | what a record consists of: [`Session`], [`Entry`], [`Frame`] |
//! | `writer` | [`Writer`]: appends a session and its entries to a file |
//! | `reader` | [`Reader`]: reads frame by frame and skips torn ones |
//! | `mark` | the bytes before a session, and the version in them |
//!
//! A file is a sequence of sessions, one for each start of the service:
//!
//! | bytes | what |
//! |---|---|
//! | 16 | mark with the version, before a [`Frame::Session`] only |
//! | 4 | length of the frame, little-endian |
//! | 4 | CRC-32 of the frame |
//! | … | [`Frame`] as postcard |
//!
//! A kill loses at most one buffer. After a torn frame, reading continues at the next session's mark.

mod frame;
mod mark;
mod reader;
mod writer;

pub use frame::{Entry, Frame, LoopCommand, Session};
pub use mark::{MARK, OtherVersion, VERSION};
pub use reader::Reader;
pub use writer::Writer;
