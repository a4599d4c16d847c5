//! `bench step`: the cost of one step of a channel by the number of centers N.
//!
//! | contestant | a step |
//! |---|---|
//! | dense | [`observer::Channel::step`], all centers |
//! | local | the same with the local solver, on lattices up to a million centers |
//! | joint | [`observer::JointChannel::accept`], the joint law's update and prediction, all centers |
//! | literal | the same law as it is printed, with nalgebra: 3×3N and 3N×3N matrices, left to right |
//! | Kalman | adskalman's filter with 6 states (velocity, disturbance) and 3 outputs |
//! | memory | reading memory: the lower bound of a step whose factor is in no cache |
//!
//! The contestants take turns (`measure`). Before the measurement, our step and the literal formula must give the same force.
//!
//! | file | what lives there |
//! |---|---|
//! | `arguments` | options, and the sweep that follows from them |
//! | `channel` | the design and the outputs |
//! | `subject` | the channel with its solver |
//! | `literal`, `kalman`, `memory` | the other contestants |
//! | `measure` | the turns |
//! | `report`, `figure` | table, JSON document and findings; the plot |

mod arguments;
mod channel;
mod figure;
mod kalman;
mod literal;
mod measure;
mod memory;
mod report;
mod subject;

use crate::harness::machine::Machine;
use crate::harness::output::{progress_bar, show, warn_of_debug_build};
use crate::plot;
use anyhow::Context;
pub(crate) use arguments::StepArguments;
use indicatif::ProgressBar;
use memory::MemoryProbe;
use shared_types::outln;
use std::time::Duration;
use subject::Subject;

/// Measures, and prints the table or the JSON document.
///
/// Pins the calling thread to the core it runs on, and leaves it there.
pub(crate) fn run(arguments: &StepArguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    warn_of_debug_build();
    // Before the core is pinned: the bar's thread must not run on the core that is measured.
    let length = arguments.sweep().len() as u64 * measure::PROGRESS;
    let progress = progress_bar(length, "{spinner} {msg:28} {bar:40} {elapsed}");
    progress.enable_steady_tick(Duration::from_millis(250));
    let machine = Machine::found();
    let rows = rows(arguments, &progress)?;
    progress.finish_and_clear();
    show(arguments.json, &report::document(&machine, &rows), || report::print(&machine, &rows))?;
    if let Some(file) = &arguments.plot {
        figure::draw(file, &rows)?;
        if !arguments.json {
            outln!("plot: {}", file.display());
        }
    }
    Ok(())
}

fn rows(arguments: &StepArguments, progress: &ProgressBar) -> anyhow::Result<Vec<report::Row>> {
    // Sizes are built one after the other: the largest fill the memory.
    let sweep = arguments.sweep();

    let mut memory = MemoryProbe::new();
    let mut rows = Vec::with_capacity(sweep.len());
    for (i, (solver, n_centers)) in sweep.into_iter().enumerate() {
        let size = format!("{solver} N = {n_centers}");
        progress.set_message(format!("{size}: factoring"));
        let subject = Subject::build(solver, n_centers).with_context(|| size.clone())?;
        progress.set_message(size.clone());
        rows.push(measure::measure(subject, &mut memory, arguments, progress).context(size)?);
        progress.set_position((i as u64 + 1) * measure::PROGRESS);
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::subject::Solver;
    use super::*;

    /// The times depend on the machine; the test looks at which figures there are, and at their order.
    #[test]
    fn a_short_measurement_fills_its_rows() {
        let arguments = StepArguments {
            centers: vec![8, 20],
            lattices: vec![8],
            quick: false,
            samples: 250,
            seconds_per_size: 8.0,
            literal_up_to: 8,
            json: false,
            plot: None,
        };
        let rows = rows(&arguments, &ProgressBar::hidden()).unwrap();
        for row in &rows {
            assert_eq!(row.samples, 250);
            assert!(row.quantiles_ns.is_sorted());
            assert!(row.dead_zone_open > 0.9, "{}", row.dead_zone_open);
            assert!(row.memory_gb_per_s > 0.0 && row.kalman.samples > 0);
        }
        assert!(rows[0].literal.is_ok() && rows[0].literal_force_difference.is_some());
        assert!(rows[1].literal.is_err());
        let solvers: Vec<_> = rows.iter().map(|row| (row.solver, row.n_centers)).collect();
        let expected = [
            (Solver::Dense, 8),
            (Solver::Dense, 20),
            (Solver::Joint, 8),
            (Solver::Joint, 20),
            (Solver::Local(4), 512),
            (Solver::Local(6), 512),
        ];
        assert_eq!(solvers, expected);
        let errors: Vec<_> = rows.iter().filter_map(|row| row.predicted_error).collect();
        assert!(errors.len() == 2 && errors[1] < errors[0], "{errors:?}");
    }
}
