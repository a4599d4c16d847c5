//! MCAP recordings. The reader is a Cargo feature.

#[cfg(feature = "mcap")]
mod read;

use crate::importer::{ImportOption, Importer};
#[cfg(feature = "mcap")]
use crate::{error::ImportError, flight::RecordedFlight, importer::ImportOptions};

/// Recordings of `monitor record` and of others.
#[derive(Debug)]
pub struct Mcap;

impl Importer for Mcap {
    fn name(&self) -> &'static str {
        "mcap"
    }

    fn about(&self) -> &'static str {
        "Recording of monitor record, of several vehicles --topic says which; of other recordings --column says what is where"
    }

    fn ending(&self) -> &'static str {
        "mcap"
    }

    fn reads(&self) -> &'static [ImportOption] {
        &[ImportOption::Columns, ImportOption::Topic]
    }

    fn is_built_in(&self) -> bool {
        cfg!(feature = "mcap")
    }

    #[cfg(feature = "mcap")]
    fn contents(&self, bytes: &[u8], file: &str, _: &ImportOptions) -> Result<Vec<String>, ImportError> {
        read::topics(bytes, file)
    }

    #[cfg(feature = "mcap")]
    fn import(
        &self,
        bytes: &[u8],
        file: &str,
        options: &ImportOptions,
    ) -> Result<RecordedFlight, ImportError> {
        read::parse(bytes, file, options)
    }
}
