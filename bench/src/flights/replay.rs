//! `bench replay`: how well the observer predicts a recorded flight, beside a Kalman filter.
//!
//! Both get the same samples. Three errors are computed: that of the next sample's prediction, and that after a coast of
//! `--coast-s` with the recorded commands, started every 0.25 s, both over the second half of the time in the air; and that
//! of the same coasts over the whole flight except its first 2 s, while the observer learns. The q of the Kalman filter is
//! swept, and each of its columns has the best value of all q, which favours the filter.

use super::accuracy::{
    Accuracy, COAST_EVERY_S, Flight, LEARN_IN_S, ObserverEstimator, best, evaluate, evaluate_kalman,
};
use super::arguments::{FlightArguments, Replay};
use super::{check, trace};
use crate::harness::output::{show, table};
use crate::plot::{self, Figure, Line, LineStyle, Panel};
use anyhow::Context;
use clap::Args;
use daemon::assemble;
use observer::Learn;
use serde::Serialize;
use shared_types::outln;
use std::path::PathBuf;

/// Arguments of `bench replay`.
#[derive(Debug, Args)]
pub(crate) struct ReplayArguments {
    #[command(flatten)]
    flight: FlightArguments,
    /// The file is a record of `daemon run --record`: replay it and compare every estimate to the bit.
    #[arg(long, conflicts_with_all = ["format", "config", "preset", "column", "map", "plot", "coast_s"])]
    check: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Write what the law did at every sample to FILE.csv: estimate, force, deviations, NIS, weights, status.
    #[arg(long, value_name = "FILE", conflicts_with = "check")]
    trace: Option<PathBuf>,
    /// Draw the coasts to FILE.svg.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Accuracy of one estimator.
#[derive(Debug, Clone, Copy, Serialize)]
struct Row {
    estimator: &'static str,
    one_step_rms_m_s: f64,
    coast_rms_m_s: f64,
    whole_flight_coast_rms_m_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    one_step_q_n2_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    coast_q_n2_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    whole_flight_coast_q_n2_s: Option<f64>,
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    file: String,
    configuration: String,
    samples: usize,
    samples_rejected: usize,
    rows_skipped: usize,
    /// Least and greatest measured velocity of each axis: where kernel centers are needed.
    lowest_velocity_m_s: [f64; 3],
    highest_velocity_m_s: [f64; 3],
    evaluated_s: f64,
    coast_s: f64,
    coasts: usize,
    rows: Vec<Row>,
}

/// Runs `bench replay`.
pub(crate) fn run(arguments: &ReplayArguments) -> anyhow::Result<()> {
    if arguments.check {
        return check::run(arguments.flight.file(), arguments.json);
    }
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    let Replay { config, flight, samples_rejected, rows_skipped } = arguments.flight.read()?;
    let translation = config.config.translation.as_ref().context("the configuration has no [translation]")?;
    let observer = assemble::rigid_body(&config)?;
    if let Some(file) = &arguments.trace {
        trace::write(&flight, observer.clone(), file)?;
    }
    let learning = evaluate(&flight, ObserverEstimator(observer.clone(), Learn::ALL))?;
    let fixed = evaluate(&flight, ObserverEstimator(observer, Learn::FROZEN))?;
    let kalman = evaluate_kalman(&flight, translation)?;
    let best_step = best(&kalman, |accuracy| accuracy.one_step_rms_m_s);
    let best_coast = best(&kalman, |accuracy| accuracy.coast_rms_m_s);
    let best_whole = best(&kalman, |accuracy| accuracy.whole_flight_coast_rms_m_s);
    let row = |estimator, accuracy: &Accuracy| Row {
        estimator,
        one_step_rms_m_s: accuracy.one_step_rms_m_s,
        coast_rms_m_s: accuracy.coast_rms_m_s,
        whole_flight_coast_rms_m_s: accuracy.whole_flight_coast_rms_m_s,
        one_step_q_n2_s: None,
        coast_q_n2_s: None,
        whole_flight_coast_q_n2_s: None,
    };
    let document = Document {
        file: arguments.flight.file().display().to_string(),
        configuration: config.name().to_owned(),
        samples: flight.samples.len(),
        samples_rejected,
        rows_skipped,
        evaluated_s: flight.seconds_from(flight.half, flight.samples.len() - 1),
        lowest_velocity_m_s: flight.extreme_velocity(f64::min),
        highest_velocity_m_s: flight.extreme_velocity(f64::max),
        coast_s: flight.coast_s,
        coasts: learning.coasts.len(),
        rows: vec![
            row("observer", &learning),
            row("observer-without-adaptation", &fixed),
            Row {
                estimator: "kalman",
                one_step_rms_m_s: best_step.1.one_step_rms_m_s,
                coast_rms_m_s: best_coast.1.coast_rms_m_s,
                whole_flight_coast_rms_m_s: best_whole.1.whole_flight_coast_rms_m_s,
                one_step_q_n2_s: Some(best_step.0),
                coast_q_n2_s: Some(best_coast.0),
                whole_flight_coast_q_n2_s: Some(best_whole.0),
            },
        ],
    };
    if let Some(file) = &arguments.plot {
        draw(file, &flight, &learning, &best_coast.1)?;
    }
    show(arguments.json, &document, || print_table(&document))
}

fn print_table(document: &Document) {
    outln!(
        "{} with {}: {} samples used, {} rejected, {} rows skipped\n\
         velocities flown: {:.1?} to {:.1?} m/s; centers are needed there\n\
         RMS of the velocity error's norm over the last {:.1} s in the air; {} coasts of {} s, one every {COAST_EVERY_S} s\n\
         (and coasts over the whole flight but its first {LEARN_IN_S} s)",
        document.file,
        document.configuration,
        document.samples,
        document.samples_rejected,
        document.rows_skipped,
        document.lowest_velocity_m_s,
        document.highest_velocity_m_s,
        document.evaluated_s,
        document.coasts,
        document.coast_s,
    );
    let coast = format!("{} s coast (m/s)", document.coast_s);
    let header = ["estimator", "next sample (m/s)", &coast, "coast, whole flight (m/s)"];
    let rows = document.rows.iter().map(|row| {
        let with_q = |value: f64, q: Option<f64>| match q {
            Some(q) => format!("{value:.4}  (q = {q:.3} N²/s)"),
            None => format!("{value:.4}"),
        };
        [
            row.estimator.to_owned(),
            with_q(row.one_step_rms_m_s, row.one_step_q_n2_s),
            with_q(row.coast_rms_m_s, row.coast_q_n2_s),
            with_q(row.whole_flight_coast_rms_m_s, row.whole_flight_coast_q_n2_s),
        ]
    });
    // The densities stand beside the numbers: nothing is aligned at the right.
    outln!("{}", table(&header, header.len(), rows));
}

fn draw(file: &std::path::Path, flight: &Flight, ours: &Accuracy, kalman: &Accuracy) -> anyhow::Result<()> {
    let start_ns = flight.samples[0].stamp_ns;
    let seconds = |stamp_ns: u64| (stamp_ns - start_ns) as f64 / 1e9;
    let panels: Vec<Panel> = ["north (m/s)", "east (m/s)", "down (m/s)"]
        .iter()
        .enumerate()
        .map(|(axis, label)| {
            let measured = (flight.half..flight.samples.len())
                .filter_map(|index| {
                    Some((seconds(flight.samples[index].stamp_ns), flight.velocity(index)?[axis]))
                })
                .collect();
            // Only coasts that do not overlap, with a break between two.
            let every = (flight.coast_s / COAST_EVERY_S).ceil() as usize;
            let coasts = |accuracy: &Accuracy| {
                let paths = accuracy.coasts.iter().step_by(every);
                paths
                    .flat_map(|path| {
                        let points = path.iter().map(move |(stamp_ns, v)| (seconds(*stamp_ns), v[axis]));
                        points.chain([(f64::NAN, f64::NAN)])
                    })
                    .collect()
            };
            let lines = vec![
                Line::new("measured", LineStyle::Truth, measured),
                Line::new("Kalman filter, coasting", LineStyle::Comparison, coasts(kalman)),
                Line::new("observer, coasting", LineStyle::Estimate, coasts(ours)),
            ];
            Panel::new(label, lines)
        })
        .collect();
    let title = format!("Velocity predicted for {} s without measurements", flight.coast_s);
    Figure::new(&title, "time in the air (s)", panels).write(file)
}
