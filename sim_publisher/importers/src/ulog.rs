//! PX4's ULog. The reader is a Cargo feature.

#[cfg(feature = "ulog")]
mod read;

use crate::importer::{Format, ImportOption, Importer};
#[cfg(feature = "ulog")]
use crate::{error::Imported, importer::ImportOptions};

/// PX4's ULog.
#[derive(Debug)]
pub struct Ulog;

impl Importer for Ulog {
    fn format(&self) -> Format {
        Format {
            name: "ulog",
            about: "PX4's ULog, topics joined by time stamp; the force of a full set-point, --thrust-n or --mass-kg says",
            ending: "ulg",
            reads: &[ImportOption::Scales],
            airborne_by: Some("its land detection"),
            is_built_in: cfg!(feature = "ulog"),
        }
    }

    #[cfg(feature = "ulog")]
    fn contents(&self, bytes: &[u8], _: &str, _: &ImportOptions) -> Imported<Vec<String>> {
        Ok(read::contents(bytes))
    }

    #[cfg(feature = "ulog")]
    fn import(&self, bytes: &[u8], file: &str, options: &ImportOptions) -> Imported {
        read::parse(bytes, file, options)
    }
}
