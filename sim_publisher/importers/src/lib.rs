//! Reads recorded flights of several log formats as samples.
//!
//! Depends on `shared_types` and `flight_record`. It publishes nothing and has no command line.
//!
//! | file | holds |
//! |---|---|
//! | `importer` | the trait [`Importer`], and [`ImportOptions`]: what a file does not determine |
//! | `list` | all formats, and reading a file of one of them |
//! | `acsl`, `csv`, `mcap`, `nanobench`, `record`, `ulog` | one format each |
//! | `table` | tables with named columns: read by `csv` and `mcap`, and written |
//! | `collector` | collecting rows into a flight: times in order, attitudes of unit norm |
//! | `flight` | [`RecordedFlight`], and why rows were skipped |
//! | `inspect` | what a file holds, and which options follow from it |
//!
//! A new format is a file that implements [`Importer`], and a line in `list`. The readers of ULog and MCAP are Cargo
//! features (`ulog`, `mcap`), because their parsers take long to build.
//!
//! Each row of a file is checked. A row that cannot be used is skipped and counted, with its place and reason; a file
//! without a usable row is an error.

mod acsl;
mod collector;
mod csv;
mod error;
mod flight;
mod importer;
mod inspect;
mod list;
mod mcap;
mod nanobench;
mod record;
mod table;
mod ulog;

pub use acsl::Acsl;
pub use csv::Csv;
pub use error::{ImportError, MapError};
pub use flight::{RecordedFlight, SkipReason, Skipped};
pub use importer::{Format, ImportOption, ImportOptions, Importer};
pub use inspect::{Findings, Quantity, inspect};
pub use list::{IMPORTERS, by_ending, by_name, parse_flight, read_flight};
pub use mcap::Mcap;
pub use nanobench::{Nanobench, is_nanobench};
pub use record::Record;
pub use table::{CsvMap, TimeUnit, VelocityAxes, write_table};
pub use ulog::Ulog;
