//! The arguments that choose a recorded flight and a configuration.

use super::accuracy::Flight;
use anyhow::Context;
use clap::Args;
use daemon::config::ConfigFile;
use daemon::replay::config_of;
use daemon::sensors::Sensors;
use flight_record::{Frame, Reader};
use importers::read_flight;
use shared_types::logln;
use sim_publisher::cli::ImportArguments;
use std::path::{Path, PathBuf};

/// A recorded flight and a configuration.
#[derive(Debug, Args)]
pub(crate) struct FlightArguments {
    #[command(flatten)]
    import: ImportArguments,
    /// Configuration file [default: a flight record's own; preset acsl-x8 for an acsl
    /// log, rigid-body otherwise].
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Built-in configuration.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Length of the coasts: that of the outages to be expected.
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    coast_s: f64,
}

/// A recorded flight, and the configuration for its replay.
pub(crate) struct Replay {
    pub(crate) config: ConfigFile,
    pub(crate) flight: Flight,
    pub(crate) samples_rejected: usize,
    pub(crate) rows_skipped: usize,
}

impl FlightArguments {
    /// The configuration: the one that is named, else the one that goes with the file's format.
    pub(crate) fn configuration(&self) -> anyhow::Result<ConfigFile> {
        match (&self.config, &self.preset, self.import.importer()?.format().name) {
            (Some(path), _, _) => Ok(ConfigFile::read(path)?),
            (None, Some(name), _) => Ok(ConfigFile::preset(name)?),
            (None, None, "acsl") => Ok(ConfigFile::preset("acsl-x8")?),
            (None, None, "record") => configuration_of_record(self.file()),
            (None, None, _) => Ok(ConfigFile::preset("rigid-body")?),
        }
    }

    /// The file of the flight.
    pub(crate) fn file(&self) -> &Path {
        &self.import.file
    }

    /// Reads both; of the flight the part in the air, where its format tells.
    pub(crate) fn read(&self) -> anyhow::Result<Replay> {
        let importer = self.import.importer()?;
        let config = self.configuration()?;
        let flight = read_flight(importer, self.file(), &self.import.options()?)?;
        let file = self.file().display();
        flight.findings().iter().for_each(|finding| logln!("'{file}': {finding}"));
        let flown = flight.airborne_only().unwrap_or(flight);
        let sensors = Sensors::new(&config.config.sensor);
        let read = flown.samples.iter().filter_map(|m| sensors.sample(m, &config.config.input).ok());
        let samples: Vec<_> = read.collect();
        Ok(Replay {
            samples_rejected: flown.samples.len() - samples.len(),
            rows_skipped: flown.skipped_rows(),
            flight: Flight::new(samples, self.coast_s)?,
            config,
        })
    }
}

/// The configuration with which the record's first session was flown.
fn configuration_of_record(path: &Path) -> anyhow::Result<ConfigFile> {
    let name = path.display();
    let cannot_read = || format!("cannot read '{name}'");
    let mut reader = Reader::open(path).with_context(cannot_read)?;
    while let Some(frame) = reader.next_frame().with_context(cannot_read)? {
        if let Frame::Session(session) = frame {
            return Ok(config_of(&session)?);
        }
    }
    anyhow::bail!("'{name}' holds no session; needed: a file of `daemon run --record`")
}
