//! `bench tune`: searches a configuration of the translation on the first half of a recorded flight (`search`), and evaluates
//! it on the second half, which the search does not use.

use super::accuracy::{Flight, ObserverEstimator, best, evaluate, evaluate_kalman, mean_nis};
use super::arguments::{FlightArguments, Replay};
use super::candidate::Numbers;
use super::search::Search;
use super::sensor;
use crate::harness::output::{progress_bar, show, table};
use anyhow::{Context, ensure};
use clap::Args;
use daemon::assemble;
use daemon::config::ConfigFile;
use observer::Learn;
use serde::Serialize;
use shared_types::outln;
use std::path::PathBuf;

/// Arguments of `bench tune`.
#[derive(Debug, Args)]
pub(crate) struct TuneArguments {
    #[command(flatten)]
    flight: FlightArguments,
    /// Of a flight record: find lever arm and latency of the velocity sensor of this number instead.
    #[arg(long, value_name = "N", conflicts_with = "mass")]
    sensor: Option<u32>,
    /// Search the nominal mass too, within a quarter of its value: for a vehicle that was not weighed as it flies.
    #[arg(long)]
    mass: bool,
    /// How much the coasts count beside the next sample's prediction, 0 … 1.
    #[arg(long, value_name = "W", default_value_t = 0.8)]
    coast_weight: f64,
    /// Configurations that are tried, about.
    #[arg(long, value_name = "N", default_value_t = 600)]
    evaluations: u64,
    /// Where the configuration is written; not at all where it is no better.
    #[arg(long, value_name = "FILE", default_value = "tuned.toml")]
    out: PathBuf,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// Errors of one configuration on one part of the flight (m/s), and its mean NIS.
#[derive(Debug, Clone, Copy, Serialize)]
struct Errors {
    one_step_rms_m_s: f64,
    coast_rms_m_s: f64,
    /// 1 where the noises are right; none with a law without deviations.
    nis: Option<f64>,
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    file: String,
    start: String,
    improved: bool,
    written: Option<String>,
    evaluations: usize,
    refused_as_unstable_or_out_of_bounds: usize,
    coast_s: f64,
    /// Of the first half, on which it was tuned: before, after.
    tuned_on: [Errors; 2],
    /// μ.
    price: f64,
    /// exp J of each block, by the candidate that is chosen on the other blocks; 1 is the start.
    cross_validated_ratio: f64,
    /// Of the second half, which the search does not use: before, after.
    second_half: [Errors; 2],
    /// The best of each of a Kalman filter's columns there, with the mass of the configuration that was found.
    kalman_second_half: Errors,
    values: Numbers,
}

/// Runs `bench tune`.
pub(crate) fn run(arguments: &TuneArguments) -> anyhow::Result<()> {
    if let Some(number) = arguments.sensor {
        let start = arguments.flight.configuration()?;
        return sensor::tune(&start, arguments.flight.file(), number, &arguments.out, arguments.json);
    }
    let weight = arguments.coast_weight;
    ensure!((0.0..=1.0).contains(&weight), "--coast-weight {weight}: needed: 0 … 1");
    let Replay { config: start, flight, .. } = arguments.flight.read()?;
    assemble::rigid_body(&start)?;
    let first_half = flight.first_half()?;
    let bar =
        progress_bar(arguments.evaluations, "{bar:40} {pos}/{len} configurations, {eta} left; best {msg}");
    let search = Search::new(&start, &first_half, weight, arguments.mass, &bar)?;
    let chosen = search.run(arguments.evaluations)?;
    bar.finish_and_clear();

    let tuned = &chosen.config;
    let translation = tuned.config.translation.as_ref().context("the configuration has no [translation]")?;
    let errors = |config: &ConfigFile, flight: &Flight| -> anyhow::Result<Errors> {
        let accuracy = evaluate(flight, ObserverEstimator(assemble::rigid_body(config)?, Learn::ALL))?;
        Ok(Errors {
            one_step_rms_m_s: accuracy.one_step_rms_m_s,
            coast_rms_m_s: accuracy.coast_rms_m_s,
            nis: mean_nis(flight, assemble::rigid_body(config)?),
        })
    };
    let second_half = [errors(&start, &flight)?, errors(tuned, &flight)?];
    let kalman = evaluate_kalman(&flight, translation)?;
    let improved = second_half[1].coast_rms_m_s < second_half[0].coast_rms_m_s;
    let mut document = Document {
        file: arguments.flight.file().display().to_string(),
        start: start.name().to_owned(),
        improved,
        written: None,
        evaluations: chosen.n_tried,
        refused_as_unstable_or_out_of_bounds: chosen.n_refused,
        coast_s: flight.coast_s,
        tuned_on: [errors(&start, &first_half)?, errors(tuned, &first_half)?],
        price: chosen.price,
        cross_validated_ratio: chosen.cross_validated_ratio,
        second_half,
        kalman_second_half: Errors {
            one_step_rms_m_s: best(&kalman, |accuracy| accuracy.one_step_rms_m_s).1.one_step_rms_m_s,
            coast_rms_m_s: best(&kalman, |accuracy| accuracy.coast_rms_m_s).1.coast_rms_m_s,
            nis: None,
        },
        values: chosen.numbers,
    };
    if improved {
        let text = head(&document) + &tuned.commented_toml();
        let file = arguments.out.display().to_string();
        std::fs::write(&arguments.out, text).with_context(|| format!("cannot write '{file}'"))?;
        document.written = Some(file);
    }
    show(arguments.json, &document, || print(&document))
}

/// The first lines of the written configuration.
fn head(document: &Document) -> String {
    let [before, after] = document.second_half;
    let [trained_before, trained_after] = document.tuned_on;
    format!(
        "# Tuned by `bench tune` on the first half of {}, starting from {}.\n\
         # Coast of {} s: {:.4} m/s before, {:.4} after, on the second half, which the search never saw;\n\
         # {:.4} and {:.4} on the half it was tuned on. Next sample: {:.4} and {:.4} m/s on the second half.{}\n",
        document.file,
        document.start,
        document.coast_s,
        before.coast_rms_m_s,
        after.coast_rms_m_s,
        trained_before.coast_rms_m_s,
        trained_after.coast_rms_m_s,
        before.one_step_rms_m_s,
        after.one_step_rms_m_s,
        match (before.nis, after.nis) {
            (Some(before), Some(after)) =>
                format!("\n# Mean NIS: {before:.2} and {after:.2} on the second half."),
            _ => String::new(),
        },
    )
}

fn print(document: &Document) {
    outln!(
        "{}, from {}: {} configurations tried, {} refused\n{}",
        document.file,
        document.start,
        document.evaluations,
        document.refused_as_unstable_or_out_of_bounds,
        document.values.words(),
    );
    let coast = format!("{} s coast (m/s)", document.coast_s);
    let rows = [
        ("first half, tuned on: before", document.tuned_on[0]),
        ("first half, tuned on: after", document.tuned_on[1]),
        ("second half, never seen: before", document.second_half[0]),
        ("second half, never seen: after", document.second_half[1]),
        ("second half, Kalman filter with that mass", document.kalman_second_half),
    ];
    let rows = rows.map(|(name, errors)| {
        let [step, coast] = [errors.one_step_rms_m_s, errors.coast_rms_m_s].map(|v| format!("{v:.4}"));
        [name.to_owned(), step, coast, errors.nis.map_or("-".into(), |nis| format!("{nis:.2}"))]
    });
    outln!("{}", table(&["RMS of the velocity error's norm", "next sample (m/s)", &coast, "NIS"], 1, rows));
    outln!(
        "cross-validated over time: {:.2} times the start's errors on thirds that did not choose; price of distance {}",
        document.cross_validated_ratio,
        document.price,
    );
    match &document.written {
        Some(file) => outln!("written to '{file}'"),
        None => outln!(
            "not better on the second half: nothing is written. Keep {}, or tune on a flight that moves more alike in both halves",
            document.start
        ),
    }
}
