//! Fuzz targets: functions that take arbitrary bytes and check a property. One file per target; `bytes` and `flights` are
//! shared.
//!
//! `tests/seeds.rs` runs the targets on the seeds, as ordinary tests; `src/main.rs` runs one under libFuzzer. May depend on
//! every crate of the workspace but `bench`, `monitor` and the C client.

mod bytes;
mod config;
mod flights;
mod gate;
mod log_acsl;
mod log_csv;
mod log_mcap;
mod log_nanobench;
mod log_ulog;
mod mavlink;
mod record;
mod snapshot;
mod step;

/// A target: it panics if its property does not hold for these bytes.
pub type Target = fn(&[u8]);

/// Each target by its name.
pub const TARGETS: [(&str, Target); 11] = [
    ("config", config::run),
    ("gate", gate::run),
    ("log_acsl", log_acsl::run),
    ("log_csv", log_csv::run),
    ("log_mcap", log_mcap::run),
    ("log_nanobench", log_nanobench::run),
    ("log_ulog", log_ulog::run),
    ("mavlink", mavlink::run),
    ("record", record::run),
    ("snapshot", snapshot::run),
    ("step", step::run),
];
