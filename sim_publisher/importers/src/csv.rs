//! The format `csv`: tables whose columns have the names of the keys, or are named by a map.

use crate::error::Imported;
use crate::importer::{Format, ImportOption, ImportOptions, Importer};
use crate::table;

/// A table with a line of column names.
#[derive(Debug)]
pub struct Csv;

impl Importer for Csv {
    fn format(&self) -> Format {
        Format {
            name: "csv",
            about: "Any table with a line of column names; which column is what, --column or --map says",
            ending: "csv",
            reads: &[ImportOption::Columns],
            airborne_by: None,
            is_built_in: true,
        }
    }

    fn contents(&self, bytes: &[u8], _: &str, options: &ImportOptions) -> Imported<Vec<String>> {
        Ok(table::column_names(bytes, &options.columns)?)
    }

    fn import(&self, bytes: &[u8], file: &str, options: &ImportOptions) -> Imported {
        table::parse(bytes, file, &options.columns)
    }
}
