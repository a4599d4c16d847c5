//! Options that several subcommands share: which configuration, which domain and instance.

use crate::config::{ConfigError, ConfigFile, PRESETS};
use clap::Args;
use shared_types::{Domain, DomainError};
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct DesignArguments {
    /// Configuration file (TOML).
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Built-in configuration.
    #[arg(long, value_name = "NAME", default_value = PRESETS[0].0, value_parser = PRESETS.map(|(name, _)| name))]
    preset: String,
    /// Ticks per second, instead of the configuration's.
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
}

impl DesignArguments {
    pub(super) fn read(&self) -> Result<ConfigFile, ConfigError> {
        let mut file = match &self.config {
            Some(path) => ConfigFile::read(path)?,
            None => ConfigFile::preset(&self.preset)?,
        };
        if let Some(rate_hz) = self.rate_hz {
            file.config.rate_hz = rate_hz;
        }
        Ok(file)
    }
}

#[derive(Debug, Args)]
pub(super) struct PlaceArguments {
    /// Name of the vehicle; its services are NAME/measurement, NAME/estimate, …
    #[arg(long, value_name = "NAME", default_value = "vehicle")]
    pub(super) instance: String,
    /// Root path of the shared-memory domain [default: /dev/shm/observer-UID].
    #[arg(long, value_name = "PATH", env = shared_types::domain::ROOT_VARIABLE)]
    root: Option<PathBuf>,
}

impl PlaceArguments {
    pub(super) fn domain(&self) -> Result<Domain, DomainError> {
        Domain::at_or_of_user(self.root.as_deref())
    }
}
