//! `bench tune --sensor`: lever arm and latency of one velocity sensor, from a flight record.
//!
//! The residual of a velocity is what it says more than the prediction before it. It is a function of the sensor's place and latency,
//! with the whole filter in between. Gauss–Newton steps, with derivatives by finite differences over whole replays and Huber's weights,
//! minimise it on the first half of the flight; the second half decides whether it is better.
//!
//! The latency comes first, from the accelerometer ([`super::latency`]). Without one it stays: a learned force explains a delay, in a
//! simulated flight of figure-eights more than half of it.

use super::latency::{Moment, Reading, latency_s};
use crate::harness::output::{show, table};
use anyhow::{Context, ensure};
use daemon::assemble;
use daemon::config::{ConfigFile, SensorConfig};
use daemon::sensors::Sensors;
use flight_record::{Entry, Frame, Reader};
use nalgebra::{Matrix3, Vector3, Vector4};
use observer::{Learn, Sample, Velocity};
use serde::Serialize;
use shared_types::{Measurement, outln};
use std::path::Path;

/// Step of the finite differences along each axis of the lever arm (m).
const STEP_M: f64 = 0.02;
/// With a larger deviation than this, a number is not observable in the flight, and stays as it was.
const LARGEST_STD_M: f64 = 0.15;
/// Likewise of the latency (s).
const LARGEST_STD_S: f64 = 0.05;
const NAMES: [&str; 4] = ["lever arm x (m)", "lever arm y (m)", "lever arm z (m)", "latency (s)"];
const ITERATIONS: usize = 5;
/// Residuals count from this part of the flight on: before, the filter learns.
const SETTLED: f64 = 0.1;
/// In units of the residuals' deviation; larger ones count linearly.
const HUBER: f64 = 1.5;

/// The document of `--json`.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    file: String,
    sensor: String,
    samples: usize,
    before: [f64; 4],
    after: [f64; 4],
    std: [f64; 4],
    is_observable: [bool; 4],
    /// RMS of the residuals (m/s): of the first half, before and after, of the second half likewise.
    first_half_rms_m_s: [f64; 2],
    second_half_rms_m_s: [f64; 2],
    written: Option<String>,
}

/// Finds the sensor's place and latency, and writes the configuration where it is better on the second half.
pub(super) fn tune(
    start: &ConfigFile,
    record: &Path,
    number: u32,
    out: &Path,
    is_json: bool,
) -> anyhow::Result<()> {
    let samples = samples_of(record)?;
    let found = Fit::new(start, &samples, number)?.run()?;
    let mut document = Document { file: record.display().to_string(), ..found.document };
    let [before, after] = document.second_half_rms_m_s;
    if after < before {
        let text = format!(
            "# Sensor '{}' tuned by `bench tune --sensor` on the first half of {}.\n\
             # Residuals of its velocity on the second half: {before:.4} m/s before, {after:.4} after.\n{}",
            document.sensor,
            document.file,
            found.config.commented_toml()
        );
        std::fs::write(out, text).with_context(|| format!("cannot write '{}'", out.display()))?;
        document.written = Some(out.display().to_string());
    }
    show(is_json, &document, || print(&document))
}

fn print(document: &Document) {
    outln!("{}, sensor '{}': {} velocities", document.file, document.sensor, document.samples);
    let rows = (0..4).map(|k| {
        let after = match document.is_observable[k] {
            true => format!("{:.3} ± {:.3}", document.after[k], document.std[k]),
            false => "not observable".into(),
        };
        [NAMES[k].to_owned(), format!("{:.3}", document.before[k]), after]
    });
    outln!("{}", table(&["", "before", "found"], 1, rows));
    let [first, second] = [document.first_half_rms_m_s, document.second_half_rms_m_s];
    outln!(
        "residuals: first half, on which it was found: {:.4} → {:.4} m/s; second half: {:.4} → {:.4} m/s",
        first[0],
        first[1],
        second[0],
        second[1]
    );
    match &document.written {
        Some(file) => outln!("written to '{file}'"),
        None => outln!("not better on the second half: nothing is written"),
    }
}

/// The samples of a record's first session, of every source.
fn samples_of(path: &Path) -> anyhow::Result<Vec<Measurement>> {
    let cannot_read = || format!("cannot read '{}'", path.display());
    let mut reader = Reader::open(path).with_context(cannot_read)?;
    let (mut samples, mut sessions) = (Vec::new(), 0);
    while let Some(frame) = reader.next_frame().with_context(cannot_read)? {
        match frame {
            Frame::Session(_) => sessions += 1,
            Frame::Entry(entry) => {
                if let (1, Entry::Sample { measurement, .. }) = (sessions, *entry) {
                    samples.push(measurement);
                }
            }
        }
    }
    ensure!(
        !samples.is_empty(),
        "'{}' holds no samples; needed: a file of `daemon run --record`",
        path.display()
    );
    Ok(samples)
}

struct Fit<'a> {
    start: &'a ConfigFile,
    samples: &'a [Measurement],
    number: u32,
    /// Stamps between which a residual counts: of the first half, and of the second.
    halves: [std::ops::Range<u64>; 2],
}

struct Found {
    config: ConfigFile,
    document: Document,
}

impl<'a> Fit<'a> {
    fn new(start: &'a ConfigFile, samples: &'a [Measurement], number: u32) -> anyhow::Result<Self> {
        ensure!(
            start.config.sensor.iter().any(|sensor| sensor.number == number),
            "--sensor {number}: the configuration has no [[sensor]] of that number; needed: one of {:?}",
            start.config.sensor.iter().map(|sensor| sensor.number).collect::<Vec<_>>()
        );
        let stamps = || samples.iter().map(|sample| sample.stamp_ns);
        let (first, last) = (stamps().min().unwrap_or(0), stamps().max().unwrap_or(0));
        let at = |part: f64| first + (part * (last - first) as f64) as u64;
        Ok(Self { start, samples, number, halves: [at(SETTLED)..at(0.5), at(0.5)..last + 1] })
    }

    fn configured(&self, numbers: &Vector4<f64>) -> ConfigFile {
        let mut file = self.start.clone();
        for sensor in file.config.sensor.iter_mut().filter(|sensor| sensor.number == self.number) {
            sensor.lever_arm_m = [numbers[0], numbers[1], numbers[2]];
            sensor.latency_s = numbers[3].max(0.0);
        }
        file
    }

    /// The samples with this configuration, in the order of their stamps, each with its place in the record.
    fn read(&self, file: &ConfigFile) -> Vec<(Sample, usize)> {
        let sensors = Sensors::new(&file.config.sensor);
        let read = self.samples.iter().zip(0..);
        let read = read.filter_map(|(m, place)| Some((sensors.sample(m, &file.config.input).ok()?, place)));
        let mut read: Vec<(Sample, usize)> = read.collect();
        read.sort_by_key(|(sample, _)| sample.stamp_ns);
        read
    }

    /// The residual of each velocity of the sensor, with its stamp as recorded; in the record's order.
    fn residuals(&self, numbers: &Vector4<f64>) -> anyhow::Result<Vec<(u64, Vector3<f64>)>> {
        let file = self.configured(numbers);
        let mut observer = assemble::rigid_body(&file)?;
        let mut residuals = Vec::new();
        for (sample, place) in self.read(&file) {
            let measurement = &self.samples[place];
            if measurement.sensor == self.number
                && let Some(velocity) = sample.velocity
            {
                let before = observer.estimate(sample.stamp_ns);
                let is_known = before.translation.is_some_and(|report| report.output_age_s.is_finite());
                let of_arm = before.angular_velocity_rad_s.cross(&sample.lever_arm_m);
                let of_center = match velocity {
                    Velocity::Body(velocity) => before.attitude * (velocity - of_arm),
                    Velocity::Inertial(velocity) => velocity - before.attitude * of_arm,
                };
                let residual = if is_known { of_center - before.velocity_m_s } else { Vector3::zeros() };
                residuals.push((place, measurement.stamp_ns, residual));
            }
            observer.accept(&sample, Learn::ALL);
        }
        residuals.sort_by_key(|(place, ..)| *place);
        Ok(residuals.into_iter().map(|(_, stamp_ns, residual)| (stamp_ns, residual)).collect())
    }

    fn of_half(&self, residuals: &[(u64, Vector3<f64>)], half: usize) -> Vec<f64> {
        let counted = residuals.iter().filter(|(stamp_ns, _)| self.halves[half].contains(stamp_ns));
        counted.flat_map(|(_, residual)| [residual.x, residual.y, residual.z]).collect()
    }

    fn run(&self) -> anyhow::Result<Found> {
        let sensor = self.start.config.sensor.iter().find(|sensor| sensor.number == self.number);
        let SensorConfig { name, lever_arm_m: [x, y, z], latency_s, .. } =
            sensor.context("no such sensor")?.clone();
        let before = Vector4::new(x, y, z, latency_s);
        let at_start = self.residuals(&before)?;
        ensure!(
            self.of_half(&at_start, 0).len() >= 100,
            "{} velocities of sensor {} in the first half; needed: more than 30",
            self.of_half(&at_start, 0).len() / 3,
            self.number
        );
        let latency = self.latency()?;
        let mut numbers = before;
        numbers[3] = latency.map_or(before[3], |(latency_s, _)| latency_s);
        let mut moves = [true; 3];
        let mut arm_std_m = [f64::INFINITY; 3];
        for _ in 0..ITERATIONS {
            let (step, found) = self.step(&numbers, &moves)?;
            for k in 0..3 {
                if moves[k] && found[k] > LARGEST_STD_M {
                    (moves[k], numbers[k]) = (false, before[k]);
                }
                if moves[k] {
                    numbers[k] += step[k];
                }
            }
            arm_std_m = found;
        }
        let [x_std, y_std, z_std] = arm_std_m;
        let std = [x_std, y_std, z_std, latency.map_or(f64::INFINITY, |(_, std_s)| std_s)];
        let is_observable = [moves[0], moves[1], moves[2], latency.is_some()];
        let at_end = self.residuals(&numbers)?;
        let rms = |residuals, half| rms(&self.of_half(residuals, half));
        Ok(Found {
            config: self.configured(&numbers),
            document: Document {
                file: String::new(),
                sensor: name,
                samples: at_start.len(),
                before: before.into(),
                after: numbers.into(),
                std,
                is_observable,
                first_half_rms_m_s: [rms(&at_start, 0), rms(&at_end, 0)],
                second_half_rms_m_s: [rms(&at_start, 1), rms(&at_end, 1)],
                written: None,
            },
        })
    }

    /// From the specific forces of the first half, if there are any.
    fn latency(&self) -> anyhow::Result<Option<(f64, f64)>> {
        let gravity = self.start.config.translation.as_ref().context("no [translation]")?.gravity_m_s2;
        let mut file = self.start.clone();
        for sensor in file.config.sensor.iter_mut().filter(|sensor| sensor.number == self.number) {
            (sensor.lever_arm_m, sensor.latency_s) = ([0.0; 3], 0.0);
        }
        let mut observer = assemble::rigid_body(&file)?;
        let (mut moments, mut readings) = (Vec::<Moment>::new(), Vec::new());
        for (sample, place) in self.read(&file) {
            observer.accept(&sample, Learn::ALL);
            if !self.halves[0].contains(&sample.stamp_ns) {
                continue;
            }
            let t_s = (sample.stamp_ns - self.halves[0].start) as f64 / 1e9;
            let now = observer.estimate(sample.stamp_ns);
            let turn = now.attitude.to_rotation_matrix().into_inner();
            if let Some(force) = sample.specific_force_m_s2 {
                let acceleration = turn * force + Vector3::from(gravity);
                let of_arm_per_s = turn * now.angular_velocity_rad_s.cross_matrix();
                moments.push(Moment::after(moments.last(), t_s, &acceleration, &turn, of_arm_per_s));
            }
            match sample.velocity.filter(|_| self.samples[place].sensor == self.number) {
                Some(Velocity::Inertial(velocity_m_s)) => readings.push(Reading { t_s, velocity_m_s }),
                // Turned with the attitude of its stamp: a slow vehicle turns little within the latency.
                Some(Velocity::Body(velocity)) => {
                    readings.push(Reading { t_s, velocity_m_s: now.attitude * velocity });
                }
                None => {}
            }
        }
        let found = if moments.is_empty() { None } else { latency_s(&moments, &readings) };
        Ok(found.filter(|(_, std_s)| *std_s < LARGEST_STD_S))
    }

    /// A Gauss–Newton step of the lever arm on the first half, and its deviations (m); 0 for what stays.
    fn step(&self, at: &Vector4<f64>, moves: &[bool; 3]) -> anyhow::Result<(Vector3<f64>, [f64; 3])> {
        let residuals = self.of_half(&self.residuals(at)?, 0);
        let mut columns = Vec::new();
        for k in 0..3 {
            let mut there = *at;
            there[k] += STEP_M;
            let moved = if moves[k] { self.of_half(&self.residuals(&there)?, 0) } else { residuals.clone() };
            let pairs = moved.iter().zip(&residuals);
            columns.push(pairs.map(|(moved, here)| (moved - here) / STEP_M).collect::<Vec<_>>());
        }
        let mut sizes: Vec<f64> = residuals.iter().map(|residual| residual.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let scale = (1.4826 * sizes[sizes.len() / 2]).max(1e-9);
        let (mut normal, mut right, mut squares, mut total) =
            (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros(), 0.0, 0.0);
        for (j, residual) in residuals.iter().enumerate() {
            let weight = (HUBER * scale / residual.abs()).min(1.0);
            let row = Vector3::from_fn(|k, _| columns[k][j]);
            normal += weight * row * row.transpose();
            right -= weight * *residual * row;
            squares += weight * residual * residual;
            total += weight;
        }
        for (k, moves) in moves.iter().enumerate() {
            if !moves || normal[(k, k)] == 0.0 {
                normal.row_mut(k).fill(0.0);
                normal.column_mut(k).fill(0.0);
                (normal[(k, k)], right[k]) = (1.0, 0.0);
            }
        }
        let inverse = normal.try_inverse().context("the sensor's place cannot be told from this flight")?;
        let variance = squares / total;
        let std = std::array::from_fn(|k| if moves[k] { (variance * inverse[(k, k)]).sqrt() } else { 0.0 });
        Ok((inverse * right, std))
    }
}

fn rms(residuals: &[f64]) -> f64 {
    (residuals.iter().map(|residual| residual * residual).sum::<f64>() / residuals.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use daemon::config::PRESETS;
    use sim_publisher::SensorSet;

    const ARM_M: [f64; 3] = [0.9, -0.2, 0.4];

    /// A multicopter whose receiver sits where the configuration does not say, and stamps on arrival.
    fn found(set: &str, configured: &str) -> Document {
        let mut set = SensorSet::read(set).unwrap();
        let gnss = set.sensor.iter_mut().find(|sensor| sensor.name == "gnss").unwrap();
        (gnss.lever_arm_m, gnss.stamps_on_arrival, gnss.delay_s) = (ARM_M, true, 0.15);
        let flown = set.fly(Some(300.0), 5).unwrap().filter_map(|outgoing| outgoing.delivery);
        let samples: Vec<_> = flown.map(|delivery| delivery.measurement).collect();
        let preset = PRESETS.iter().find(|(name, _)| *name == "rigid-body").unwrap().1;
        let sensor = format!(
            "[[sensor]]\nname = \"ahrs\"\nnumber = 2\n[[sensor]]\nname = \"gnss\"\nnumber = 1\n{configured}"
        );
        let start = ConfigFile::parse("vehicle".into(), format!("{preset}\n{sensor}")).unwrap();
        let document = Fit::new(&start, &samples, 1).unwrap().run().unwrap().document;
        println!("{document:?}");
        document
    }

    #[test]
    fn a_wrong_lever_arm_and_a_latency_are_found() {
        let Document { after, std, is_observable, second_half_rms_m_s: [before, tuned], .. } =
            found("multicopter-imu", "lever_arm_m = [0.3, 0, 0.1]\nlatency_s = 0.02");
        assert_eq!(is_observable, [true; 4]);
        assert!(tuned < before, "{before} → {tuned} m/s");
        for k in 0..3 {
            assert!((after[k] - ARM_M[k]).abs() < 3.0 * std[k] && std[k] < 0.1, "{}", NAMES[k]);
        }
        assert!((after[3] - 0.15).abs() < 3.0 * std[3] && std[3] < 0.005, "{} ± {} s", after[3], std[3]);
    }

    #[test]
    fn without_an_accelerometer_the_lever_arm_is_found_and_the_latency_stays() {
        let Document { after, std, is_observable, .. } = found("multicopter-gnss", "latency_s = 0.15");
        assert_eq!(is_observable, [true, true, true, false]);
        assert_eq!(after[3], 0.15);
        for k in 0..3 {
            assert!((after[k] - ARM_M[k]).abs() < 3.0 * std[k] && std[k] < 0.1, "{}", NAMES[k]);
        }
    }
}
