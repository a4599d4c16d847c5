//! The error of a file or a map of columns that cannot be used.

use crate::flight::{RecordedFlight, Skipped};

/// Why a file cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The system refused to read this file.
    #[error("cannot read '{0}': {1}")]
    Io(String, #[source] std::io::Error),
    /// This file has no bytes, or no line of names.
    #[error("'{0}' is empty; needed: a line of column names, then rows")]
    Empty(String),
    /// A column is not there.
    #[error("'{path}' has no column '{column}'; its columns are: {found}")]
    MissingColumn {
        /// Which file.
        path: String,
        /// The missing column.
        column: String,
        /// The file's columns.
        found: String,
    },
    /// This file is not of the format, or holds nothing that can be used: what was found, and what is needed.
    #[error("'{0}': {1}")]
    Content(String, String),
    /// The reader of this file's format was not built.
    #[error(
        "'{0}': the reader of format '{1}' is not in this program; needed: one with it: cargo run --release \
         -p bench --features logs -- …, or sim_publisher as it is built by default"
    )]
    NotBuiltIn(String, &'static str),
    /// An option does not belong to this format.
    #[error("{0}")]
    Option(String),
    /// No row of this file can be used.
    #[error("'{0}' has no usable row; {1}")]
    NoUsableRow(String, Skipped),
    /// The map of columns contradicts itself or lacks something.
    #[error(transparent)]
    Map(#[from] MapError),
}

/// What an importer makes of a file.
pub(crate) type Imported<T = RecordedFlight> = Result<T, ImportError>;

/// Why a map of columns cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MapError {
    /// This file cannot be read, for the system's reason.
    #[error("cannot read the map '{0}': {1}")]
    Unreadable(String, String),
    /// The text of this file or option is no map; the reason names line and key.
    #[error("{0}: {1}")]
    NotAMap(String, String),
    /// An option is not `KEY=COLUMN`.
    #[error("--column '{0}': needed: KEY=COLUMN, for example velocity_x=vx")]
    NotAPair(String),
    /// A quantity has some of its components only.
    #[error("column map: {quantity} has {found} but lacks {lacking}; name all of its components, or none")]
    Partial {
        /// Which quantity.
        quantity: &'static str,
        /// The components that are named.
        found: String,
        /// Those that are not.
        lacking: String,
    },
    /// No time, or two.
    #[error("column map: {0}; needed: either time_s=COLUMN, or time=COLUMN with time_unit = s, ms, us or ns")]
    Time(&'static str),
    /// Nothing that an observer could use.
    #[error("column map: neither velocity nor angular velocity; name the columns of one of them at least")]
    NothingMeasured,
    /// The separator cannot separate.
    #[error(
        "column map: separator '{0}'; needed: one ASCII character that is no digit, letter, dot, sign or quote"
    )]
    Separator(char),
}
