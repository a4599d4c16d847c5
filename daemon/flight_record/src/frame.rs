//! The parts of a record: sessions, entries, frames.

use serde::{Deserialize, Serialize};
use shared_types::payload::{Estimate, Measurement};

/// A command that the loop carries out between two ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LoopCommand {
    /// Forget state and weights.
    Reset,
    /// Stop learning.
    Freeze,
    /// Learn again.
    Thaw,
}

/// One event of the loop, in its order.
#[allow(clippy::large_enum_variant)] // it travels by value: a box would be an allocation in the loop
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// A tick begins.
    Begin {
        /// When it woke (ns).
        wake_ns: u64,
        /// Ticks before it, in a row, that ended after their next deadline.
        late_ticks_in_a_row: u64,
    },
    /// A sample was taken.
    Sample {
        /// Id of its source.
        source: u128,
        /// As it arrived.
        measurement: Measurement,
    },
    /// What the tick published.
    Estimate(Estimate),
    /// A command was carried out after the tick.
    Command(LoopCommand),
    /// A checkpoint was saved after the tick.
    Checkpoint,
    /// This number of ticks is left out here.
    Missing(u64),
}

/// The beginning of a session: everything that its ticks depend on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Session {
    /// Version of the program that wrote it.
    pub program_version: String,
    /// Name of the vehicle.
    pub instance: String,
    /// The effective configuration, as TOML.
    pub config: String,
    /// The vector unit that the bits depend on.
    pub vector_unit: String,
    /// The checkpoint that the engine was resumed from, in the engine's own bytes, version first; `None` for a fresh start.
    pub checkpoint: Option<Vec<u8>>,
}

/// The parts of a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Frame {
    /// The service started.
    Session(Box<Session>),
    /// An event of the session.
    Entry(Box<Entry>),
}

/// The same as [`Frame`], borrowed: writing needs no box.
#[derive(Serialize)]
pub(crate) enum FrameRef<'a> {
    Session(&'a Session),
    Entry(&'a Entry),
}
