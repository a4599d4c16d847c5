//! Any bytes as a map of columns and, after a line of `---`, as a table.

use crate::flights::check_flight;
use sim_publisher::{CsvMap, Format, Import, parse_flight};

const BETWEEN: &[u8] = b"\n---\n";

/// One run.
pub(crate) fn run(bytes: &[u8]) {
    let Some(at) = bytes.windows(BETWEEN.len()).position(|window| window == BETWEEN) else { return };
    let Ok(map) = str::from_utf8(&bytes[..at]) else { return };
    let Ok(map) = toml::from_str::<CsvMap>(map) else { return };
    check_flight(parse_flight(
        Format::Csv,
        &bytes[at + BETWEEN.len()..],
        "fuzz",
        &Import { map, ..Import::default() },
    ));
}
