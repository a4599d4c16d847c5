//! Any bytes as a table of the NanoBench data set.

use crate::flights::check_log;
use importers::{ImportOptions, Nanobench};

pub(crate) fn run(bytes: &[u8]) {
    check_log(&Nanobench, bytes, &ImportOptions::default());
}
