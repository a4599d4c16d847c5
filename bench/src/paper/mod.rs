//! `bench paper`: the two examples of the paper, run from its equations: no clock, no chance, no shared memory.
//!
//! The truth comes from `sim_publisher`, the observer from the library that flies. Every number of the paper is an
//! option, so that the effect of each can be seen. The run is written as a table and drawn as the paper's
//! figures.
//!
//! | module | holds |
//! |---|---|
//! | [`settings`] | the options, and every number of a run |
//! | [`mod@run`] | the run: what happens from one sample to the next |
//! | [`rows`] | one row of the table, and the table as a file |
//! | [`report`] | errors of a run; what is printed of them |
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
