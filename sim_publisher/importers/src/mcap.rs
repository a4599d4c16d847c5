//! MCAP recordings. The reader is a Cargo feature.

#[cfg(feature = "mcap")]
mod read;

use crate::importer::{Format, ImportOption, Importer};
#[cfg(feature = "mcap")]
use crate::{error::Imported, importer::ImportOptions};

/// Recordings of `monitor record` and of others.
#[derive(Debug)]
pub struct Mcap;

impl Importer for Mcap {
    fn format(&self) -> Format {
        Format {
            name: "mcap",
            about: "Recording of monitor record, of several vehicles --topic says which; of other recordings --column says what is where",
            ending: "mcap",
            reads: &[ImportOption::Columns, ImportOption::Topic],
            airborne_by: None,
            is_built_in: cfg!(feature = "mcap"),
        }
    }

    #[cfg(feature = "mcap")]
    fn contents(&self, bytes: &[u8], file: &str, _: &ImportOptions) -> Imported<Vec<String>> {
        read::topics(bytes, file)
    }

    #[cfg(feature = "mcap")]
    fn import(&self, bytes: &[u8], file: &str, options: &ImportOptions) -> Imported {
        read::parse(bytes, file, options)
    }
}
