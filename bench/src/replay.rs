//! `bench replay`: how well the observer predicts a recorded flight, beside a Kalman filter.
//!
//! On the same samples, over the second half of the time in the air: the error of the next sample's
//! prediction, and the error after a coast of `--coast-s` with the recorded commands, started every 0.25 s; and
//! the same coasts over the whole flight but its first 2 s, learning as it goes. The Kalman filter's q is
//! swept, and each of its columns shows the best of all q: in its favour.

use crate::check;
use crate::kalman::KalmanFilter;
use crate::plot::{self, Line, LineStyle, Panel};
use anyhow::{Context, ensure};
use clap::Args;
use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use daemon::config::ConfigFile;
use daemon::gate::sample_of;
use nalgebra::Vector3;
use observer::{RigidBodyObserver, Sample, Velocity};
use serde::Serialize;
use shared_types::{logln, outln};
use sim_publisher::{CsvMap, Format, read_flight};
use std::path::PathBuf;

/// From one coast's start to the next (s).
const COAST_EVERY_S: f64 = 0.25;
/// Coasts over the whole flight start after this (s).
const LEARN_IN_S: f64 = 2.0;
/// Variance of the velocity measurement that the filter is told (m²/s²). Only q/r matters in the long run.
const KALMAN_NOISE_M2_S2: f64 = 0.01;
/// Densities of the filter's random-walk force (N²/s).
const KALMAN_DENSITIES_N2_S: [f64; 14] =
    [0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 1e5, 1e6];

/// Arguments of `bench replay`.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// The recorded flight.
    file: PathBuf,
    /// How it is written.
    #[arg(long, value_enum, required_unless_present = "check")]
    format: Option<Format>,
    /// The file is a record of `daemon run --record`: replay it and compare every estimate to the bit.
    #[arg(long, conflicts_with_all = ["format", "config", "preset", "column", "map", "plot", "coast_s"])]
    check: bool,
    /// Configuration file [default: preset acsl-x8 for --format acsl, rigid-body otherwise].
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Built-in configuration.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Length of the coasts: that of the outages to be expected.
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    coast_s: f64,
    /// For --format csv: which column holds what, as quantity=column; may be given several times.
    #[arg(long, value_name = "QUANTITY=COLUMN")]
    column: Vec<String>,
    /// For --format csv: the same from a TOML file.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Draw the coasts into FILE.svg or FILE.png.
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

/// What `--json` prints.
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
///
/// # Errors
/// The flight or the configuration cannot be read, or the flight is too short.
pub fn run(arguments: &ReplayArguments) -> anyhow::Result<()> {
    let Some(format) = arguments.format else { return check::run(&arguments.file, arguments.json) };
    let (config, configuration) = match (&arguments.config, &arguments.preset, format) {
        (Some(path), _, _) => (ConfigFile::read(path)?, path.display().to_string()),
        (None, Some(name), _) => (ConfigFile::preset(name)?, format!("preset {name}")),
        (None, None, Format::Acsl) => (ConfigFile::preset("acsl-x8")?, "preset acsl-x8".into()),
        (None, None, Format::Csv) => (ConfigFile::preset("rigid-body")?, "preset rigid-body".into()),
    };
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    let map = CsvMap::read(arguments.map.as_deref(), &arguments.column)?;
    let flight = read_flight(format, &arguments.file, &map)?;
    if flight.skipped_rows() > 0 {
        logln!("bench: {}", flight.skipped);
    }
    let flown = flight.airborne_only().unwrap_or(flight);
    let samples: Vec<Sample> =
        flown.samples.iter().filter_map(|m| sample_of(m, &config.config.input).ok()).collect();
    let samples_rejected = flown.samples.len() - samples.len();

    let flight = Flight::new(samples, arguments.coast_s)?;
    let translation = config.config.translation.as_ref().context("the configuration has no [translation]")?;
    let known_force_n = translation.mass_kg * Vector3::from(translation.gravity_m_s2)
        + Vector3::from(translation.known_force_n);
    let learning = evaluate(&flight, ObserverEstimator(config.observer()?))?;
    let fixed = evaluate(&flight, ObserverEstimator(config.observer_without_adaptation()?))?;
    let mut kalman = Vec::new();
    for q in KALMAN_DENSITIES_N2_S {
        let filter =
            |velocity: &Vector3<f64>| KalmanFilter::new(translation.mass_kg, q, KALMAN_NOISE_M2_S2, velocity);
        kalman.push((q, evaluate(&flight, KalmanEstimator::new(&filter, known_force_n))?));
    }
    let best = |of: fn(&Accuracy) -> f64| {
        kalman.iter().min_by(|(_, a), (_, b)| of(a).total_cmp(&of(b))).expect("at least one density")
    };
    let (best_step, best_coast) = (best(|a| a.one_step_rms_m_s), best(|a| a.coast_rms_m_s));
    let best_whole = best(|a| a.whole_flight_coast_rms_m_s);
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
        file: arguments.file.display().to_string(),
        configuration,
        samples: flight.samples.len(),
        samples_rejected,
        rows_skipped: flown.skipped_rows(),
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
    match arguments.json {
        true => outln!("{}", serde_json::to_string_pretty(&document)?),
        false => print_table(&document),
    }
    Ok(())
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
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED);
    let coast = format!("{} s coast (m/s)", document.coast_s);
    table.set_header(["estimator", "next sample (m/s)", &coast, "coast, whole flight (m/s)"]);
    for row in &document.rows {
        let with_q = |value: f64, q: Option<f64>| match q {
            Some(q) => format!("{value:.4}  (q = {q} N²/s)"),
            None => format!("{value:.4}"),
        };
        table.add_row([
            row.estimator.to_owned(),
            with_q(row.one_step_rms_m_s, row.one_step_q_n2_s),
            with_q(row.coast_rms_m_s, row.coast_q_n2_s),
            with_q(row.whole_flight_coast_rms_m_s, row.whole_flight_coast_q_n2_s),
        ]);
    }
    outln!("{table}");
}

/// Samples with an inertial velocity each, where their second half begins, and how long they are to be coasted.
struct Flight {
    samples: Vec<Sample>,
    half: usize,
    coast_s: f64,
}

impl Flight {
    fn new(samples: Vec<Sample>, coast_s: f64) -> anyhow::Result<Self> {
        ensure!(coast_s > 0.0 && coast_s <= 3600.0, "--coast-s {coast_s}: needed: above 0, at most 3600 s");
        let start = samples.iter().position(|sample| sample.velocity.is_some()).unwrap_or(samples.len());
        let samples = samples[start..].to_vec();
        let body = samples.iter().any(|sample| matches!(sample.velocity, Some(Velocity::Body(_))));
        ensure!(
            !body,
            "velocities along the body axes; needed: inertial ones, which can be compared with a prediction"
        );
        ensure!(
            samples.iter().any(|sample| sample.force_n.is_some()),
            "no commanded force in this flight; needed: force columns, so that a coast knows what was commanded"
        );
        let duration_s = match (samples.first(), samples.last()) {
            (Some(first), Some(last)) => (last.stamp_ns - first.stamp_ns) as f64 / 1e9,
            _ => 0.0,
        };
        ensure!(
            duration_s >= 4.0 * coast_s,
            "{duration_s:.2} s of usable samples in the air; needed: at least {} s, four coasts",
            4.0 * coast_s
        );
        let half_ns = samples[0].stamp_ns + (duration_s / 2.0 * 1e9) as u64;
        let half =
            samples.iter().position(|sample| sample.stamp_ns >= half_ns).expect("the last one is later");
        Ok(Self { samples, half, coast_s })
    }

    fn seconds_from(&self, from: usize, to: usize) -> f64 {
        (self.samples[to].stamp_ns - self.samples[from].stamp_ns) as f64 / 1e9
    }

    fn extreme_velocity(&self, extreme: fn(f64, f64) -> f64) -> [f64; 3] {
        let velocities = (0..self.samples.len()).filter_map(|index| self.velocity(index));
        velocities.reduce(|a, b| a.zip_map(&b, extreme)).expect("the first sample has one").into()
    }

    fn velocity(&self, index: usize) -> Option<Vector3<f64>> {
        match self.samples[index].velocity {
            Some(Velocity::Inertial(velocity)) => Some(velocity),
            _ => None,
        }
    }
}

/// What is compared: take a sample, say the velocity of a later instant.
trait Estimator: Clone {
    /// The prediction for this stamp, before the sample of the same stamp is taken.
    fn predict(&mut self, stamp_ns: u64) -> Vector3<f64>;
    /// Takes the sample of that stamp; in a coast it comes without measurements of the translation.
    fn take(&mut self, sample: &Sample) -> anyhow::Result<()>;
}

#[derive(Clone)]
struct ObserverEstimator(RigidBodyObserver);

impl Estimator for ObserverEstimator {
    fn predict(&mut self, stamp_ns: u64) -> Vector3<f64> {
        self.0.estimate(stamp_ns).velocity_m_s
    }

    fn take(&mut self, sample: &Sample) -> anyhow::Result<()> {
        self.0.accept(sample);
        Ok(())
    }
}

#[derive(Clone)]
struct KalmanEstimator<'a, New> {
    new: &'a New,
    known_force_n: Vector3<f64>,
    input_n: Vector3<f64>,
    stamp_ns: u64,
    filter: Option<KalmanFilter>,
}

impl<'a, New: Fn(&Vector3<f64>) -> KalmanFilter> KalmanEstimator<'a, New> {
    fn new(new: &'a New, known_force_n: Vector3<f64>) -> Self {
        Self { new, known_force_n, input_n: Vector3::zeros(), stamp_ns: 0, filter: None }
    }
}

impl<New: Fn(&Vector3<f64>) -> KalmanFilter> Estimator for KalmanEstimator<'_, New>
where
    Self: Clone,
{
    fn predict(&mut self, stamp_ns: u64) -> Vector3<f64> {
        let Some(filter) = &mut self.filter else { return Vector3::zeros() };
        let h_s = (stamp_ns - self.stamp_ns) as f64 / 1e9;
        if h_s > 0.0 {
            filter.predict(&(self.input_n + self.known_force_n), h_s);
        }
        self.stamp_ns = stamp_ns;
        filter.velocity_m_s()
    }

    fn take(&mut self, sample: &Sample) -> anyhow::Result<()> {
        self.predict(sample.stamp_ns);
        self.stamp_ns = sample.stamp_ns;
        self.input_n = sample.force_n.unwrap_or(self.input_n);
        match (sample.velocity, &mut self.filter) {
            (Some(Velocity::Inertial(velocity)), Some(filter)) => filter.correct(&velocity),
            (Some(Velocity::Inertial(velocity)), None) => {
                self.filter = Some((self.new)(&velocity));
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

/// One estimator over one flight.
struct Accuracy {
    one_step_rms_m_s: f64,
    coast_rms_m_s: f64,
    whole_flight_coast_rms_m_s: f64,
    /// Of each coast of the second half: stamp and predicted velocity at its start, its end and in between.
    coasts: Vec<Vec<(u64, Vector3<f64>)>>,
}

fn evaluate(flight: &Flight, mut estimator: impl Estimator) -> anyhow::Result<Accuracy> {
    let mut one_step = MeanSquare::default();
    let mut whole_flight = MeanSquare::default();
    let mut coast = MeanSquare::default();
    let mut coasts = Vec::new();
    let every_ns = (COAST_EVERY_S * 1e9) as u64;
    let half_ns = flight.samples[flight.half].stamp_ns;
    // The grid of starts has a point at the beginning of the second half.
    let learned_in_ns = flight.samples[0].stamp_ns + (LEARN_IN_S * 1e9) as u64;
    let mut next_ns = half_ns - half_ns.saturating_sub(learned_in_ns) / every_ns * every_ns;
    for (index, sample) in flight.samples.iter().enumerate() {
        let predicted = estimator.predict(sample.stamp_ns);
        let measured = flight.velocity(index);
        if let Some(measured) = measured.filter(|_| index >= flight.half) {
            one_step.add(&(predicted - measured));
        }
        estimator.take(sample)?;
        if sample.stamp_ns >= next_ns && measured.is_some() {
            if let Some((path, error)) = coast_from(flight, index, estimator.clone())? {
                whole_flight.add(&error);
                if sample.stamp_ns >= half_ns {
                    coast.add(&error);
                    coasts.push(path);
                }
            }
            next_ns += every_ns;
        }
    }
    Ok(Accuracy {
        one_step_rms_m_s: one_step.root(),
        coast_rms_m_s: coast.root(),
        whole_flight_coast_rms_m_s: whole_flight.root(),
        coasts,
    })
}

type Path = Vec<(u64, Vector3<f64>)>;

/// Predicts without measurements of the translation; `None` where the flight ends before.
fn coast_from(
    flight: &Flight,
    start: usize,
    mut estimator: impl Estimator,
) -> anyhow::Result<Option<(Path, Vector3<f64>)>> {
    let end_ns = flight.samples[start].stamp_ns + (flight.coast_s * 1e9) as u64;
    let mut path = vec![(flight.samples[start].stamp_ns, estimator.predict(flight.samples[start].stamp_ns))];
    for index in start + 1..flight.samples.len() {
        let sample = &flight.samples[index];
        path.push((sample.stamp_ns, estimator.predict(sample.stamp_ns)));
        if let (true, Some(measured)) = (sample.stamp_ns >= end_ns, flight.velocity(index)) {
            let error = path.last().expect("just pushed").1 - measured;
            return Ok(Some((path, error)));
        }
        estimator.take(&Sample { velocity: None, position_m: None, ..*sample })?;
    }
    Ok(None)
}

#[derive(Default)]
struct MeanSquare {
    sum: f64,
    count: usize,
}

impl MeanSquare {
    fn add(&mut self, error: &Vector3<f64>) {
        self.sum += error.norm_squared();
        self.count += 1;
    }

    fn root(&self) -> f64 {
        (self.sum / self.count as f64).sqrt()
    }
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
            // So many that they do not overlap; a break between two.
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
            Panel {
                y_label: (*label).into(),
                lines: vec![
                    Line { label: "measured".into(), points: measured, style: LineStyle::Truth },
                    Line {
                        label: "Kalman filter, coasting".into(),
                        points: coasts(kalman),
                        style: LineStyle::Comparison,
                    },
                    Line {
                        label: "observer, coasting".into(),
                        points: coasts(ours),
                        style: LineStyle::Estimate,
                    },
                ],
                log_x: false,
                log_y: false,
            }
        })
        .collect();
    let title = format!("Velocity predicted for {} s without measurements", flight.coast_s);
    plot::draw_to(file, &title, "time in the air (s)", &panels)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// v' = u/m, known exactly to the filter and to the observer: coasting has no error.
    #[test]
    fn a_flight_without_unknown_forces_is_predicted_exactly() {
        let samples: Vec<Sample> = (0..600)
            .map(|j| {
                let t = j as f64 * 0.01;
                Sample {
                    stamp_ns: j * 10_000_000,
                    velocity: Some(Velocity::Inertial(Vector3::new(0.5 * t, 0.0, 0.0))),
                    force_n: Some(Vector3::new(1.1, 0.0, -2.2 * 9.81)),
                    ..Sample::default()
                }
            })
            .collect();
        let flight = Flight::new(samples, 0.5).unwrap();
        let config = ConfigFile::preset("acsl-x8").unwrap();
        let ours = evaluate(&flight, ObserverEstimator(config.observer().unwrap())).unwrap();
        let filter = |velocity: &Vector3<f64>| KalmanFilter::new(2.2, 0.0, 0.01, velocity);
        let gravity = Vector3::new(0.0, 0.0, 2.2 * 9.81);
        let theirs = evaluate(&flight, KalmanEstimator::new(&filter, gravity)).unwrap();
        assert_eq!(ours.coasts.len(), 10);
        // A held velocity lags by half a sample; the dead zone hides that, and it is no force.
        assert!(ours.coast_rms_m_s < 0.01, "{}", ours.coast_rms_m_s);
        assert!(theirs.coast_rms_m_s < 1e-9 && theirs.one_step_rms_m_s < 1e-9, "{}", theirs.coast_rms_m_s);
    }

    #[test]
    fn a_flight_that_is_too_short_is_refused_with_its_length() {
        let sample = Sample {
            velocity: Some(Velocity::Inertial(Vector3::zeros())),
            force_n: Some(Vector3::zeros()),
            ..Sample::default()
        };
        let flight = Flight::new(vec![sample; 3], 0.5).err().unwrap().to_string();
        assert!(flight.contains("0.00 s") && flight.contains("at least 2 s"), "{flight}");
    }
}
