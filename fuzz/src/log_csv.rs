//! Any bytes as a map of columns and, after a line of `---`, as a table.

use crate::flights::check_log;
use importers::{Csv, CsvMap, ImportOptions};

const BETWEEN: &[u8] = b"\n---\n";

pub(crate) fn run(bytes: &[u8]) {
    let Some(at) = bytes.windows(BETWEEN.len()).position(|window| window == BETWEEN) else { return };
    let Ok(map) = str::from_utf8(&bytes[..at]) else { return };
    let Ok(columns) = toml::from_str::<CsvMap>(map) else { return };
    let options = ImportOptions { columns, ..ImportOptions::default() };
    check_log(&Csv, &bytes[at + BETWEEN.len()..], &options);
}
