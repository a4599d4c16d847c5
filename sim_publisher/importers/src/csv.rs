//! The format `csv`: tables whose columns have the names of the keys, or are named by a map.

use crate::error::ImportError;
use crate::flight::RecordedFlight;
use crate::importer::{ImportOption, ImportOptions, Importer};
use crate::table;

/// A table with a line of column names.
#[derive(Debug)]
pub struct Csv;

impl Importer for Csv {
    fn name(&self) -> &'static str {
        "csv"
    }

    fn about(&self) -> &'static str {
        "Any table with a line of column names; which column is what, --column or --map says"
    }

    fn ending(&self) -> &'static str {
        "csv"
    }

    fn reads(&self) -> &'static [ImportOption] {
        &[ImportOption::Columns]
    }

    fn contents(&self, bytes: &[u8], _: &str, options: &ImportOptions) -> Result<Vec<String>, ImportError> {
        Ok(table::column_names(bytes, &options.columns)?)
    }

    fn import(
        &self,
        bytes: &[u8],
        file: &str,
        options: &ImportOptions,
    ) -> Result<RecordedFlight, ImportError> {
        table::parse(bytes, file, &options.columns)
    }
}
