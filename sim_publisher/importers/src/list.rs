//! The list of formats, and reading a file of any of them.

use crate::error::{ImportError, Imported};
use crate::importer::{ImportOptions, Importer};
use crate::{acsl::Acsl, csv::Csv, mcap::Mcap, nanobench::Nanobench, record::Record, ulog::Ulog};
use std::path::Path;

/// Every format. Commands, fuzz targets and the documentation follow from this list.
pub static IMPORTERS: [&dyn Importer; 6] = [&Acsl, &Csv, &Mcap, &Nanobench, &Record, &Ulog];

/// The format of this name.
pub fn by_name(name: &str) -> Option<&'static dyn Importer> {
    IMPORTERS.into_iter().find(|importer| importer.format().name == name)
}

/// The format of a file's ending, if any; the first of the list, where several have it.
pub fn by_ending(path: &Path) -> Option<&'static dyn Importer> {
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    IMPORTERS.into_iter().find(|importer| importer.format().ending == ending)
}

/// Reads a recorded flight.
///
/// # Errors
/// What is wrong with the file or the options.
pub fn read_flight(importer: &dyn Importer, path: &Path, options: &ImportOptions) -> Imported {
    check(importer, options)?;
    parse_flight(importer, &read_file(path)?, &path.display().to_string(), options)
}

/// A recorded flight from the bytes of its file; `file` is its name in messages.
///
/// # Errors
/// As [`read_flight`], without `Io`.
pub fn parse_flight(importer: &dyn Importer, bytes: &[u8], file: &str, options: &ImportOptions) -> Imported {
    check(importer, options)?;
    importer.import(bytes, file, options)
}

pub(crate) fn read_file(path: &Path) -> Imported<Vec<u8>> {
    std::fs::read(path).map_err(|error| ImportError::Io(path.display().to_string(), error))
}

/// # Errors
/// An option that this format does not read, or a number out of range.
pub(crate) fn check(importer: &dyn Importer, options: &ImportOptions) -> Imported<()> {
    if let Some(option) = options.given().find(|option| !importer.format().reads.contains(option)) {
        let readers: Vec<_> = IMPORTERS
            .iter()
            .filter(|i| i.format().reads.contains(&option))
            .map(|i| i.format().name)
            .collect();
        let (words, found) = (option.words(), importer.format().name);
        return Err(ImportError::Option(format!(
            "{words}: found: --format {found}; needed: --format {}, or leave it out",
            readers.join(" or ")
        )));
    }
    let ImportOptions { thrust_n, mass_kg, torque_n_m, .. } = options;
    let mut numbers = thrust_n.iter().chain(mass_kg).chain(torque_n_m.iter().flatten());
    match numbers.find(|number| !(number.is_finite() && **number > 0.0)) {
        Some(number) => Err(ImportError::Option(format!(
            "--thrust-n, --mass-kg, --torque-n-m: found {number}; needed: above 0"
        ))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_is_named() {
        let error = read_flight(&Acsl, Path::new("/no/such.log"), &ImportOptions::default()).unwrap_err();
        assert!(error.to_string().contains("cannot read '/no/such.log'"), "{error}");
    }

    #[test]
    fn options_of_another_format_are_refused_with_the_formats_that_read_them() {
        let options = ImportOptions { topic: Some("/a".into()), ..ImportOptions::default() };
        let refused = parse_flight(&Acsl, b"", "f", &options).unwrap_err().to_string();
        assert!(refused.contains("--topic: found: --format acsl; needed: --format mcap"), "{refused}");
        let options = ImportOptions { mass_kg: Some(-1.0), ..ImportOptions::default() };
        let refused = parse_flight(&Ulog, b"", "f", &options).unwrap_err().to_string();
        assert!(refused.contains("found -1; needed: above 0"), "{refused}");
    }

    #[test]
    fn every_format_has_a_fuzz_target_and_a_row_in_the_documentation() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let manual = std::fs::read_to_string(root.join("docs/recordings.md")).unwrap();
        for importer in IMPORTERS {
            let name = importer.format().name;
            let row = format!("| `{name}` | `.{}` | {} |", importer.format().ending, importer.format().about);
            assert!(manual.contains(&row), "docs/recordings.md lacks: {row}");
            let targets = [format!("log_{name}.rs"), format!("{name}.rs")];
            assert!(targets.iter().any(|file| root.join("fuzz/src").join(file).exists()), "{name}");
            assert!(by_name(name).is_some_and(|found| found.format().ending == importer.format().ending));
        }
    }

    /// In a build without the readers: what is missing, and the command that has it.
    #[test]
    fn a_format_that_is_not_built_in_is_refused_with_the_command_that_has_it() {
        for importer in IMPORTERS.into_iter().filter(|importer| !importer.format().is_built_in) {
            let refused = parse_flight(importer, b"x", "f", &ImportOptions::default()).unwrap_err();
            assert!(refused.to_string().contains("--features logs"), "{refused}");
        }
    }
}
