//! The flight record: every sample, command and tick of the service's loop, in a file that replays to the same bits.
//!
//! This crate is the file format alone. The daemon writes it, the importers and the bench read it. It depends on
//! `shared_types`; it knows neither the engine nor the configuration, which are text and bytes here.
//!
//! | file | holds |
//! |---|---|
//! | `frame` | what a record consists of: [`Session`], [`Entry`], [`Frame`] |
//! | `writer` | [`Writer`]: appends a session and its entries to a file |
//! | `reader` | [`Reader`]: frame by frame, past torn places |
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
//! A kill costs one buffer at most. Reading continues at the next session's mark.

mod frame;
mod mark;
mod reader;
mod writer;

pub use frame::{Entry, Frame, LoopCommand, Session};
pub use mark::{MARK, OtherVersion, VERSION};
pub use reader::Reader;
pub use writer::Writer;
