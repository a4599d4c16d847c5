//! Any bytes as a map of columns and, after a line of `---`, as a table.

#![no_main]

use importers::{Csv, CsvMap, ImportOptions};
use libfuzzer_sys::fuzz_target;

const BETWEEN: &[u8] = b"\n---\n";

fuzz_target!(|bytes: &[u8]| {
    let Some(at) = bytes.windows(BETWEEN.len()).position(|window| window == BETWEEN) else { return };
    let Ok(map) = str::from_utf8(&bytes[..at]) else { return };
    let Ok(columns) = toml::from_str::<CsvMap>(map) else { return };
    let options = ImportOptions { columns, ..ImportOptions::default() };
    fuzz::check_log(&Csv, &bytes[at + BETWEEN.len()..], &options);
});
