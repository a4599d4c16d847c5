//! Arguments that several commands share: the recorded flight, and options that its file does not determine.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use importers::{CsvMap, IMPORTERS, ImportError, ImportOptions, Importer};
use std::path::PathBuf;

/// A recorded flight, and what it does not say of itself.
#[derive(Debug, Clone, clap::Args)]
pub struct ImportArguments {
    /// The recorded flight
    pub file: PathBuf,
    /// How it is written [default: by the file's ending]
    #[arg(long, value_parser = format_parser())]
    format: Option<&'static dyn Importer>,
    /// Which column holds what (csv; mcap: KEY=/topic:path.to.field), KEY=COLUMN; may be repeated, and wins over --map
    #[arg(long, value_name = "KEY=COLUMN")]
    column: Vec<String>,
    /// TOML file of such pairs (csv, mcap)
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Which measurements (mcap), for example /vehicle/measurement [default: the only ones]
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Force of a thrust set-point of 1 (ulog) [default: from --mass-kg and the log's hover thrust]
    #[arg(long, value_name = "N")]
    thrust_n: Option<f64>,
    /// Mass, which the log's hover thrust carries (ulog)
    #[arg(long, value_name = "KG")]
    mass_kg: Option<f64>,
    /// Torque of a torque set-point of 1 (ulog): one number, or three with commas [default: no torque]
    #[arg(long, value_name = "N_M", value_parser = parse_axes)]
    torque_n_m: Option<[f64; 3]>,
}

impl ImportArguments {
    /// The format that was stated, or that of the file's ending.
    ///
    /// # Errors
    /// Neither.
    pub fn importer(&self) -> Result<&'static dyn Importer, ImportError> {
        self.format.or_else(|| importers::by_ending(&self.file)).ok_or_else(|| {
            let file = self.file.display();
            ImportError::Option(format!("'{file}': its ending tells no format; needed: --format"))
        })
    }

    /// What the file does not say of itself.
    ///
    /// # Errors
    /// The map of columns cannot be read.
    pub fn options(&self) -> Result<ImportOptions, ImportError> {
        let &Self { thrust_n, mass_kg, torque_n_m, .. } = self;
        let columns = CsvMap::read(self.map.as_deref(), &self.column)?;
        Ok(ImportOptions { columns, topic: self.topic.clone(), thrust_n, mass_kg, torque_n_m })
    }
}

fn format_parser() -> impl TypedValueParser<Value = &'static dyn Importer> {
    let names =
        IMPORTERS.map(|importer| PossibleValue::new(importer.format().name).help(importer.format().about));
    PossibleValuesParser::new(names).map(|name| importers::by_name(&name).expect("a listed name"))
}

pub(crate) fn parse_axes(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[each]) => Ok([each; 3]),
        Ok(&[x, y, z]) => Ok([x, y, z]),
        _ => Err(format!("'{text}': needed: one number, or three with commas, for example 0.1,0,0")),
    }
}
