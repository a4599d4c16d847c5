//! Any bytes as an MCAP recording: of this service's own kind, and with columns named.

use crate::flights::check_recording;
use importers::{CsvMap, ImportOptions, Mcap, parse_flight};

pub(crate) fn run(bytes: &[u8]) {
    let pairs = ["x", "y", "z"].map(|axis| format!("velocity_{axis}=/a:v.{axis}"));
    for pairs in [&pairs[..0], &pairs] {
        let columns = CsvMap::read(None, pairs).expect("three pairs");
        let options = ImportOptions { columns, ..ImportOptions::default() };
        check_recording(parse_flight(&Mcap, bytes, "fuzz", &options));
    }
}
