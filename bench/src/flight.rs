//! Which recorded flight, and which configuration: the arguments of everything that works on one.

use crate::accuracy::Flight;
use anyhow::Context;
use clap::Args;
use daemon::config::ConfigFile;
use daemon::gate::sample_of;
use shared_types::logln;
use sim_publisher::{Format, ImportOptions, read_flight};
use std::path::PathBuf;

/// A recorded flight and a configuration.
#[derive(Debug, Args)]
pub(crate) struct FlightArguments {
    /// The recorded flight.
    pub(crate) file: PathBuf,
    /// How it is written [default: by the file's ending].
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Configuration file [default: preset acsl-x8 for an acsl log, rigid-body otherwise].
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Built-in configuration.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    #[command(flatten)]
    import: ImportOptions,
    /// Length of the coasts: that of the outages to be expected.
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    coast_s: f64,
}

/// A flight that can be flown again, and with what.
pub(crate) struct Replay {
    pub(crate) config: ConfigFile,
    pub(crate) flight: Flight,
    pub(crate) samples_rejected: usize,
    pub(crate) rows_skipped: usize,
}

impl FlightArguments {
    /// Reads both; of the flight the part in the air, where its format tells.
    ///
    /// # Errors
    /// What cannot be read, or is too short.
    pub(crate) fn read(&self) -> anyhow::Result<Replay> {
        let format = self.format.or_else(|| Format::of(&self.file)).with_context(|| {
            format!("'{}': its ending tells no format; needed: --format", self.file.display())
        })?;
        let config = match (&self.config, &self.preset, format) {
            (Some(path), _, _) => ConfigFile::read(path)?,
            (None, Some(name), _) => ConfigFile::preset(name)?,
            (None, None, Format::Acsl) => ConfigFile::preset("acsl-x8")?,
            (None, None, Format::Csv | Format::Mcap | Format::Ulog) => ConfigFile::preset("rigid-body")?,
        };
        let flight = read_flight(format, &self.file, &self.import)?;
        if flight.skipped_rows() > 0 {
            logln!("bench: {}", flight.skipped);
        }
        let flown = flight.airborne_only().unwrap_or(flight);
        let samples: Vec<_> =
            flown.samples.iter().filter_map(|m| sample_of(m, &config.config.input).ok()).collect();
        Ok(Replay {
            samples_rejected: flown.samples.len() - samples.len(),
            rows_skipped: flown.skipped_rows(),
            flight: Flight::new(samples, self.coast_s)?,
            config,
        })
    }
}
