//! `bench paper`: runs the two examples of the paper deterministically, without clock and shared memory.
//!
//! `sim_publisher` computes the truth, and the service's own library the estimate. Every number of the paper is an option.
//! The run is written as a table and drawn as the paper's figures.
//!
//! | module | holds |
//! |---|---|
//! | [`settings`] | the options, and every number of a run |
//! | [`mod@run`] | the run: the step from one sample to the next |
//! | [`rows`] | one row of the table, and the table as a file |
//! | [`report`] | errors of a run, and their table |
//! | `figures` | position, Euler angles and angular rate against time |
//!
//! # Source
//! Niu, Wang, Moon, L'Afflitto, Kurdila, Stilwell, *Vector-Valued Native Space Embedding for Adaptive State
//! Observation*, §VI-C

mod figures;
pub mod report;
pub mod rows;
pub mod run;
pub mod settings;

use crate::harness::output::show;
use anyhow::Context;
use report::Report;
pub use settings::{Example, PaperArguments, UsageError};

/// Runs `bench paper`.
///
/// # Errors
/// [`UsageError`] for options that make no run; an estimate that does not stay finite; an output directory that
/// cannot be written.
pub fn run(arguments: &PaperArguments) -> anyhow::Result<()> {
    let settings = arguments.settings()?;
    let run = run::run(&settings)?;

    let out = &arguments.out;
    std::fs::create_dir_all(out)
        .with_context(|| format!("cannot make the output directory {}", out.display()))?;
    let table = out.join(format!("{}.csv", settings.example.scenario().name()));
    rows::write(&table, settings.example, &run.rows)
        .with_context(|| format!("cannot write {}", table.display()))?;
    let mut files = vec![table];
    files.extend(figures::draw(out, settings.example, &run.rows)?);

    let report = Report::new(&settings, &run);
    show(arguments.json, &report.json(&files), || report.print(&files))
}
