//! The trait of a log format, and the options that a file does not determine.

use crate::error::{ImportError, Imported};
use crate::table::CsvMap;

/// One log format.
pub trait Importer: std::fmt::Debug + Sync {
    /// Its names, and the options that it reads.
    fn format(&self) -> Format;

    /// The file's topics or columns, as text; empty for a format without them.
    ///
    /// # Errors
    /// The file is damaged from its start.
    fn contents(&self, bytes: &[u8], file: &str, options: &ImportOptions) -> Imported<Vec<String>> {
        let _ = (bytes, file, options);
        Ok(Vec::new())
    }

    /// The flight in the file's bytes; `file` is its name in messages.
    ///
    /// Without an implementation it is refused: the reader's Cargo feature is off.
    ///
    /// # Errors
    /// What is wrong with the file or the options.
    fn import(&self, bytes: &[u8], file: &str, options: &ImportOptions) -> Imported {
        let _ = (bytes, options);
        Err(ImportError::NotBuiltIn(file.into(), self.format().name))
    }
}

/// What a format is called, and what it reads.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Its word on the command line.
    pub name: &'static str,
    /// What it is, in one line for people.
    pub about: &'static str,
    /// The ending of its files, in lower case.
    pub ending: &'static str,
    /// The options that it reads; others are refused.
    pub reads: &'static [ImportOption],
    /// How its files mark when the vehicle was in the air, in a few words; `None` where they do not.
    pub airborne_by: Option<&'static str>,
    /// Whether its reader was built; see [`Importer::import`].
    pub is_built_in: bool,
}

/// An option, or several that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImportOption {
    /// [`ImportOptions::columns`].
    Columns,
    /// [`ImportOptions::topic`].
    Topic,
    /// Force and torque of set-points.
    Scales,
}

impl ImportOption {
    /// Its words on the command line.
    pub fn words(self) -> &'static str {
        match self {
            Self::Columns => "--column and --map",
            Self::Topic => "--topic",
            Self::Scales => "--thrust-n, --mass-kg and --torque-n-m",
        }
    }
}

/// What a file does not determine.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ImportOptions {
    /// Which column holds what.
    pub columns: CsvMap,
    /// The topic of the measurements; `None` if the file has only one.
    pub topic: Option<String>,
    /// Force of a thrust set-point of 1 (N), along the body's axes.
    pub thrust_n: Option<f64>,
    /// Mass (kg), from which the thrust follows with the log's own hover thrust where `thrust_n` is not given.
    pub mass_kg: Option<f64>,
    /// Torque of a torque set-point of 1 (N m), about each axis of the body.
    pub torque_n_m: Option<[f64; 3]>,
}

impl ImportOptions {
    /// Those that are given.
    pub fn given(&self) -> impl Iterator<Item = ImportOption> {
        let scales = self.thrust_n.or(self.mass_kg).is_some() || self.torque_n_m.is_some();
        [
            (ImportOption::Columns, self.columns != CsvMap::default()),
            (ImportOption::Topic, self.topic.is_some()),
            (ImportOption::Scales, scales),
        ]
        .into_iter()
        .filter_map(|(option, is_given)| is_given.then_some(option))
    }
}
