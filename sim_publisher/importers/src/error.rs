//! The error of a file or a map of columns that cannot be used.

use crate::flight::Skipped;

/// Why a file cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The system refused.
    #[error("cannot read '{path}': {source}")]
    Io {
        /// Which file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file has no bytes, or no line of names.
    #[error("'{path}' is empty; needed: a line of column names, then rows")]
    Empty {
        /// Which file.
        path: String,
    },
    /// A column is missing.
    #[error("'{path}' has no column '{column}'; its columns are: {found}")]
    MissingColumn {
        /// Which file.
        path: String,
        /// The missing column.
        column: String,
        /// The file's columns.
        found: String,
    },
    /// The file is not of this format, or holds nothing that can be used.
    #[error("'{path}': {found}")]
    Content {
        /// Which file.
        path: String,
        /// What was found, and what is needed.
        found: String,
    },
    /// The format's reader was not built.
    #[error(
        "'{path}': the reader of format '{format}' is not in this program; needed: one with it: cargo run --release \
         -p bench --features logs -- …, or sim_publisher as it is built by default"
    )]
    NotBuiltIn {
        /// Which file.
        path: String,
        /// Its format.
        format: &'static str,
    },
    /// An option does not belong to this format.
    #[error("{0}")]
    Option(String),
    /// No row can be used.
    #[error("'{path}' has no usable row; {skipped}")]
    NoUsableRow {
        /// Which file.
        path: String,
        /// What was skipped, and why.
        skipped: Skipped,
    },
    /// The map of columns contradicts itself or lacks something.
    #[error(transparent)]
    Map(#[from] MapError),
}

/// Why a map of columns cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MapError {
    /// The file cannot be read.
    #[error("cannot read the map '{path}': {reason}")]
    Unreadable {
        /// Which file.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// The text is no map; the reason names line and key.
    #[error("{place}: {reason}")]
    NotAMap {
        /// The file, or the option.
        place: String,
        /// The reason.
        reason: String,
    },
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
