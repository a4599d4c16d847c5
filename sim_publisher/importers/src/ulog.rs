//! PX4's ULog. The reader is a Cargo feature.

#[cfg(feature = "ulog")]
mod read;

use crate::importer::{ImportOption, Importer};
#[cfg(feature = "ulog")]
use crate::{error::ImportError, flight::RecordedFlight, importer::ImportOptions};

/// PX4's ULog.
#[derive(Debug)]
pub struct Ulog;

impl Importer for Ulog {
    fn name(&self) -> &'static str {
        "ulog"
    }

    fn about(&self) -> &'static str {
        "PX4's ULog, topics joined by time stamp; the force of a full set-point, --thrust-n or --mass-kg says"
    }

    fn ending(&self) -> &'static str {
        "ulg"
    }

    fn tells_airborne_by(&self) -> Option<&'static str> {
        Some("its land detection")
    }

    fn reads(&self) -> &'static [ImportOption] {
        &[ImportOption::Scales]
    }

    fn is_built_in(&self) -> bool {
        cfg!(feature = "ulog")
    }

    #[cfg(feature = "ulog")]
    fn contents(&self, bytes: &[u8], _: &str, _: &ImportOptions) -> Result<Vec<String>, ImportError> {
        Ok(read::contents(bytes))
    }

    #[cfg(feature = "ulog")]
    fn import(
        &self,
        bytes: &[u8],
        file: &str,
        options: &ImportOptions,
    ) -> Result<RecordedFlight, ImportError> {
        read::parse(bytes, file, options)
    }
}
