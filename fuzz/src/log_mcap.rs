//! Any bytes as an MCAP recording: of this service's own kind, and with columns named.

use crate::flights::check_recording;
use sim_publisher::{CsvMap, Format, Import, parse_flight};

/// One run.
pub(crate) fn run(bytes: &[u8]) {
    let columns = ["x", "y", "z"].map(|axis| (format!("velocity_{axis}"), format!("/a:v.{axis}")));
    let named = CsvMap { columns: columns.into(), ..CsvMap::default() };
    for map in [CsvMap::default(), named] {
        let import = Import { map, ..Import::default() };
        check_recording(parse_flight(Format::Mcap, bytes, "fuzz", &import));
    }
}
