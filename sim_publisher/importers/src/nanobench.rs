//! Flights of the NanoBench data set: a Crazyflie 2.1 in a motion-capture arena, one table at 100 Hz.
//!
//! World axes with z up. The velocity is the motion capture's, a derivative smoothed over some rows in both directions; where
//! a frame was lost it is left out. The force is the thrust along z of the body: mass × k Σ (PWM/65535)² V², with the battery's
//! voltage V. One k is fitted on the first quarter of the time with running motors, to the specific force that the
//! accelerometer measures along z. From where the motors are one straight line for a second, the radio was lost: the flight ends
//! there. Where the table has the on-board filter's velocity, a remark says its error against the motion capture's.
//!
//! # Source
//! Public repository syediu/nanobench-iros2026, datasets/dataset

use crate::collector::{Collector, ROUNDED_NORM_TOLERANCE, parse_ns, unit};
use crate::error::{ImportError, Imported};
use crate::flight::SkipReason;
use crate::importer::{Format, ImportOptions, Importer};
use csv::ByteRecord;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::Measurement;
use shared_types::payload::valid;
use std::ops::Range;

/// The vehicle with its deck (kg).
const MASS_KG: f64 = 0.035;
const GRAVITY_M_S2: f64 = 9.81;
/// Higher than this above the lowest point, the vehicle is clear of the ground (m).
const CLEAR_OF_GROUND_M: f64 = 0.1;
/// Where a row follows after more than this (s), a frame was lost.
const MAX_STEP_S: f64 = 0.015;
/// The derivative of so many rows on both sides has the lost frame in it.
const SPOILED_ROWS: usize = 6;
/// So many rows of motors on one straight line are no log of motors.
const STRAIGHT_ROWS: usize = 100;

/// In the order in which [`Row`] takes them.
const COLUMNS: [&str; 21] = [
    "px",
    "py",
    "pz",
    "qw",
    "qx",
    "qy",
    "qz",
    "vx",
    "vy",
    "vz",
    "imu_gyro_x",
    "imu_gyro_y",
    "imu_gyro_z",
    "imu_acc_x",
    "imu_acc_y",
    "imu_acc_z",
    "motor_motor_m1",
    "motor_motor_m2",
    "motor_motor_m3",
    "motor_motor_m4",
    "pwr_pm_vbat",
];
const TIME: &str = "t";
/// The on-board filter's velocity; not needed.
const ON_BOARD: [&str; 3] = ["est_stateEstimate_vx", "est_stateEstimate_vy", "est_stateEstimate_vz"];

/// A flight of the NanoBench data set.
#[derive(Debug)]
pub struct Nanobench;

impl Importer for Nanobench {
    fn format(&self) -> Format {
        Format {
            name: "nanobench",
            about: "Table of the NanoBench data set: motion capture, rates, and thrust from motors and battery; --format nanobench",
            ending: "csv",
            reads: &[],
            airborne_by: Some("running motors, 0.1 m above the lowest point"),
            is_built_in: true,
        }
    }

    fn import(&self, bytes: &[u8], file: &str, _: &ImportOptions) -> Imported {
        parse(bytes, file)
    }
}

/// Whether a table has this data set's columns.
pub fn is_nanobench(bytes: &[u8]) -> bool {
    let header = bytes.split(|&byte| byte == b'\n').next().unwrap_or_default();
    let header = String::from_utf8_lossy(header);
    let names: Vec<_> = header.split(',').map(str::trim).collect();
    COLUMNS.iter().all(|column| names.contains(column))
}

/// One row of the table.
struct Row {
    line: u64,
    time_ns: i128,
    numbers: [f64; COLUMNS.len()],
    on_board_m_s: Option<Vector3<f64>>,
}

impl Row {
    fn velocity_m_s(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.numbers[7..10])
    }

    fn motors(&self) -> [f64; 4] {
        std::array::from_fn(|motor| self.numbers[16 + motor])
    }

    /// Σ (PWM/65535)² V².
    fn thrust_level(&self) -> f64 {
        let levels = self.motors().iter().map(|pwm| (pwm / 65535.0).powi(2)).sum::<f64>();
        levels * self.numbers[20].powi(2)
    }

    fn specific_force_m_s2(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.numbers[13..16]) * GRAVITY_M_S2
    }

    fn sample(&self, thrust_n: f64, has_velocity: bool) -> Result<Measurement, SkipReason> {
        let [px, py, pz, w, x, y, z, vx, vy, vz, wx, wy, wz, ..] = self.numbers;
        let attitude = unit([w, x, y, z], ROUNDED_NORM_TOLERANCE).ok_or(SkipReason::NoUnitQuaternion)?;
        let [w, x, y, z] = attitude;
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        let sample = Measurement::default()
            .with_position_m([px, py, pz])
            .with_attitude_wxyz(attitude)
            .with_angular_velocity_rad_s([wx, wy, wz])
            .with_specific_force_m_s2(self.specific_force_m_s2().into())
            .with_force_n((rotation * Vector3::new(0.0, 0.0, thrust_n)).into());
        Ok(if has_velocity { sample.with_velocity_m_s([vx, vy, vz]) } else { sample })
    }
}

fn parse(bytes: &[u8], path: &str) -> Imported {
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(bytes);
    let header = match reader.byte_headers() {
        Ok(header) if !header.is_empty() => header.clone(),
        _ => return Err(ImportError::Empty(path.into())),
    };
    let names: Vec<_> = header.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect();
    let place_of = |column: &str| {
        names.iter().position(|name| name == column).ok_or_else(|| ImportError::MissingColumn {
            path: path.into(),
            column: column.into(),
            found: names.join(", "),
        })
    };
    let time = place_of(TIME)?;
    let places = COLUMNS.iter().map(|column| place_of(column)).collect::<Imported<Vec<usize>>>()?;
    let on_board: Vec<usize> =
        ON_BOARD.iter().filter_map(|column| names.iter().position(|name| name == column)).collect();
    let mut flight = Collector::default();
    let mut rows = Vec::new();
    let mut record = ByteRecord::new();
    // Reading bytes of memory into a flexible record leaves no error but the end.
    while reader.read_byte_record(&mut record).unwrap_or(false) {
        let line = record.position().map_or(0, csv::Position::line);
        match read_row(&record, line, time, (&places, &on_board)) {
            Ok(row) => rows.push(row),
            Err(reason) => flight.skipped.add(reason, line),
        }
    }
    rows.truncate(end_of_motors(&rows));
    let k = thrust_scale(&rows);
    let mut is_running = Vec::with_capacity(rows.len());
    let has_gap: Vec<bool> =
        rows.windows(2).map(|pair| (pair[1].time_ns - pair[0].time_ns) as f64 * 1e-9 > MAX_STEP_S).collect();
    for (index, row) in rows.iter().enumerate() {
        let around = index.saturating_sub(SPOILED_ROWS)..(index + SPOILED_ROWS).min(has_gap.len());
        let has_velocity = !has_gap[around].contains(&true);
        match row.sample(MASS_KG * k * row.thrust_level(), has_velocity) {
            Ok(sample) => {
                if flight.add(row.line, row.time_ns, sample) {
                    is_running.push(row.thrust_level() > 0.0);
                }
            }
            Err(reason) => flight.skipped.add(reason, row.line),
        }
    }
    let airborne = airborne(&flight.samples, &is_running);
    if let Some(airborne) = &airborne {
        // The time in which estimators of ours are judged, too.
        let judged = &flight.samples[airborne.start + airborne.len() / 2..airborne.end];
        flight.remarks.extend(on_board_error(judged, &rows, flight.first_ns.unwrap_or(0)));
    }
    flight.finish(path, airborne)
}

fn read_row(
    record: &ByteRecord,
    line: u64,
    time: usize,
    (places, on_board): (&[usize], &[usize]),
) -> Result<Row, SkipReason> {
    let text = |place: usize| -> Result<&str, SkipReason> {
        let cell = record.get(place).ok_or(SkipReason::TooFewValues)?;
        str::from_utf8(cell).map(str::trim).map_err(|_| SkipReason::NotANumber)
    };
    let mut numbers = [0.0; COLUMNS.len()];
    for (number, &place) in numbers.iter_mut().zip(places) {
        let value: f64 = text(place)?.parse().map_err(|_| SkipReason::NotANumber)?;
        *number = Some(value).filter(|value| value.is_finite()).ok_or(SkipReason::NotANumber)?;
    }
    let time_ns = parse_ns(text(time)?, 1_000_000_000).ok_or(SkipReason::NotANumber)?;
    let on_board =
        on_board.iter().map(|&place| text(place).ok()?.parse().ok().filter(|v: &f64| v.is_finite()));
    let on_board_m_s = match on_board.collect::<Option<Vec<f64>>>().as_deref() {
        Some(&[vx, vy, vz]) => Some(Vector3::new(vx, vy, vz)),
        _ => None,
    };
    Ok(Row { line, time_ns, numbers, on_board_m_s })
}

/// RMS of the on-board filter's velocity error against the motion capture's, in the time of these samples.
fn on_board_error(samples: &[Measurement], rows: &[Row], first_ns: i128) -> Option<String> {
    let has_velocity = |row: &&Row| {
        let at =
            samples.binary_search_by_key(&(row.time_ns - first_ns), |sample| i128::from(sample.stamp_ns));
        at.is_ok_and(|at| samples[at].has(valid::VELOCITY))
    };
    let of_row = |row: &Row| row.on_board_m_s.map(|velocity| (velocity - row.velocity_m_s()).norm_squared());
    let squares: Vec<f64> = rows.iter().filter(has_velocity).filter_map(of_row).collect();
    let rms_m_s = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    (!squares.is_empty()).then(|| {
        format!("on-board filter: velocity error {rms_m_s:.3} m/s (RMS, second half in the air, against motion capture)")
    })
}

/// The row from which on the running motors are one straight line, or all rows.
fn end_of_motors(rows: &[Row]) -> usize {
    let mut straight = 0;
    for index in 2..rows.len() {
        let [a, b, c] = [&rows[index - 2], &rows[index - 1], &rows[index]].map(Row::motors);
        let is_running = c.iter().any(|pwm| *pwm > 0.0);
        let is_straight = (0..4).all(|motor| (a[motor] - 2.0 * b[motor] + c[motor]).abs() < 1e-3);
        straight = if is_running && is_straight { straight + 1 } else { 0 };
        if straight >= STRAIGHT_ROWS {
            return index - STRAIGHT_ROWS;
        }
    }
    rows.len()
}

/// k of the first quarter of the time with running motors ((m/s²)/V²); 0 without any.
fn thrust_scale(rows: &[Row]) -> f64 {
    let running: Vec<&Row> = rows.iter().filter(|row| row.thrust_level() > 0.0).collect();
    let quarter = &running[..running.len() / 4];
    let level: f64 = quarter.iter().map(|row| row.thrust_level()).sum();
    let acceleration: f64 = quarter.iter().map(|row| row.specific_force_m_s2().z).sum();
    if level > 0.0 { acceleration / level } else { 0.0 }
}

/// The longest run of samples with running motors, from the first to the last one clear of the lowest point.
fn airborne(samples: &[Measurement], is_running: &[bool]) -> Option<Range<usize>> {
    let mut start = 0;
    let runs = is_running.chunk_by(|a, b| a == b).map(|run| {
        start += run.len();
        (run[0], start - run.len()..start)
    });
    let (_, run) = runs.filter(|(is_running, _)| *is_running).max_by_key(|(_, run)| run.len())?;
    let height_m = |index: &usize| samples[*index].position_m[2];
    let lowest_m = samples.iter().map(|sample| sample.position_m[2]).fold(f64::INFINITY, f64::min);
    let is_clear = |index: &usize| height_m(index) - lowest_m > CLEAR_OF_GROUND_M;
    Some(run.clone().find(is_clear)?..run.rev().find(is_clear)? + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hover at 1 m with yaw 90°: 100 rows of a motor that flickers, from row 20 on; a frame is lost after row 60.
    fn table(rows: usize, pwm: impl Fn(usize) -> f64) -> String {
        let mut text = format!("t,{},more\n", COLUMNS.join(","));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for row in 0..rows {
            let t = 0.01 * row as f64 + if row > 60 { 0.01 } else { 0.0 };
            let height = if row < 20 { 0.0 } else { 1.0 };
            let m = pwm(row);
            text += &format!(
                "{:.3},1,2,{height},{half},0,0,{half},3,4,5,0.1,0.2,0.3,0.01,0.02,1.0,{m},{m},{m},{m},4.0,x\n",
                1_772_681_685.0 + t
            );
        }
        text
    }

    #[test]
    fn thrust_is_that_of_the_accelerometer_and_spoiled_velocities_are_left_out() {
        let flicker = |row: usize| if row < 20 { 0.0 } else { 30000.0 + 100.0 * (row % 2) as f64 };
        let text = table(100, flicker);
        assert!(is_nanobench(text.as_bytes()));
        let flight = parse(text.as_bytes(), "b.csv").unwrap();
        assert_eq!((flight.samples.len(), flight.airborne.clone()), (100, Some(20..100)));
        let hover = &flight.samples[30];
        // 1 g along z of the body, which points up: the weight of the nominal mass, within the motor's flicker.
        assert!((hover.force_n[2] / (MASS_KG * GRAVITY_M_S2) - 1.0).abs() < 0.01, "{:?}", hover.force_n);
        let [x, y, z] = hover.specific_force_m_s2.map(|force| force / GRAVITY_M_S2);
        assert!((x - 0.01).abs() < 1e-12 && (y - 0.02).abs() < 1e-12 && (z - 1.0).abs() < 1e-12);
        assert_eq!((hover.velocity_m_s, hover.angular_velocity_rad_s), ([3., 4., 5.], [0.1, 0.2, 0.3]));
        let without: Vec<usize> =
            (0..100).filter(|&index| !flight.samples[index].has(valid::VELOCITY)).collect();
        assert_eq!(without, (55..=66).collect::<Vec<_>>());
    }

    #[test]
    fn motors_on_a_straight_line_end_the_flight() {
        let lost =
            |row: usize| if row < 150 { 30000.0 + 100.0 * (row % 2) as f64 } else { 30000.0 + row as f64 };
        let flight = parse(table(400, lost).as_bytes(), "b.csv").unwrap();
        assert!((148..=153).contains(&flight.samples.len()), "{}", flight.samples.len());
    }

    #[test]
    fn a_table_of_another_kind_is_refused_with_its_columns() {
        let message = parse(b"t,px,py\n0,1,2\n", "b.csv").unwrap_err().to_string();
        assert!(message.contains("no column 'pz'") && message.contains("t, px, py"), "{message}");
    }
}
