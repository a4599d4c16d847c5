//! Logs of the flight stack of the laboratory that published the method.
//!
//! A line is `[date] [thread] [tag] [line] [level] ` and values separated by `, `; the first line holds names with
//! units. Axes north-east-down. The commanded force is the thrust U1 along −z of the body: `R(q) (0, 0, −U1)`.
//!
//! The logs of the multicopters have the attitude as a quaternion, those of the winged vehicles as Euler angles (3-2-1).
//!
//! # Source
//! Public repositories andrealaffly/ACSL-flightstack-accessories, Flight_Data, and ACSL-flightstack-winged-accessories,
//! flight_log

use crate::collector::{Collector, ROUNDED_NORM_TOLERANCE, parse_ns, unit};
use crate::error::{ImportError, Imported};
use crate::flight::SkipReason;
use crate::importer::{Format, ImportOptions, Importer};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::Measurement;
use std::ops::Range;

/// Thrust above which the vehicle is in the air (N).
const AIRBORNE_THRUST_N: f64 = 5.0;
/// Higher than this above the lowest point, the vehicle is clear of the ground (m).
const CLEAR_OF_GROUND_M: f64 = 0.1;
/// A shorter loss of thrust is no landing (s).
const MAX_GAP_S: f64 = 0.5;

/// Which columns hold what.
struct Layout {
    time: &'static str,
    position: [&'static str; 3],
    /// A quaternion, or Euler angles.
    attitude: &'static [&'static str],
    velocity: [&'static str; 3],
    angular_velocity: [&'static str; 3],
    /// U1 … U4.
    inputs: [&'static str; 4],
}

const POSITION: [&str; 3] = ["Position x [m]", "Position y [m]", "Position z [m]"];
const VELOCITY: [&str; 3] = ["Velocity x [m/s]", "Velocity y [m/s]", "Velocity z [m/s]"];
const LAYOUTS: [Layout; 2] = [
    Layout {
        time: "Current time [s]",
        position: POSITION,
        attitude: &["Quaternion q0 [-]", "Quaternion q1 [-]", "Quaternion q2 [-]", "Quaternion q3 [-]"],
        velocity: VELOCITY,
        angular_velocity: [
            "Angular velocity x [rad/s]",
            "Angular velocity y [rad/s]",
            "Angular velocity z [rad/s]",
        ],
        inputs: [
            "U control input U1 [N]",
            "U control input U2 [Nm]",
            "U control input U3 [Nm]",
            "U control input U4 [Nm]",
        ],
    },
    Layout {
        time: "Controller Time [s]",
        position: POSITION,
        attitude: &["Phi [rad]", "Theta [rad]", "Psi [rad]"],
        velocity: VELOCITY,
        angular_velocity: ["omega_x [rad/s]", "omega_y [rad/s]", "omega_z [rad/s]"],
        inputs: ["u1 [N]", "u2 [Nm]", "u3 [Nm]", "u4 [Nm]"],
    },
];

impl Layout {
    /// In the order in which [`sample_of`] takes them.
    fn columns(&self) -> impl Iterator<Item = &'static str> {
        let groups =
            [&self.position[..], self.attitude, &self.velocity, &self.angular_velocity, &self.inputs];
        groups.map(<[&str]>::to_vec).into_iter().flatten()
    }
}

/// A log of the ACSL flight stack.
#[derive(Debug)]
pub struct Acsl;

impl Importer for Acsl {
    fn format(&self) -> Format {
        Format {
            name: "acsl",
            about: "Log of the ACSL flight stack: inertial velocity, body rates, position, attitude, thrust and torques",
            ending: "log",
            reads: &[],
            airborne_by: Some("thrust above 5 N"),
            is_built_in: true,
        }
    }

    fn import(&self, bytes: &[u8], file: &str, _: &ImportOptions) -> Imported {
        parse(bytes, file)
    }
}

fn parse(bytes: &[u8], path: &str) -> Imported {
    let mut lines =
        bytes.split(|&b| b == b'\n').zip(1u64..).filter(|(line, _)| !line.trim_ascii().is_empty());
    let (header, _) = lines.next().ok_or_else(|| ImportError::Empty(path.into()))?;
    let header = String::from_utf8_lossy(header);
    let names = values(&header);
    let place_of = |column: &str| {
        names.iter().position(|name| *name == column).ok_or_else(|| ImportError::MissingColumn {
            path: path.into(),
            column: column.into(),
            found: names.iter().filter(|name| !name.is_empty()).copied().collect::<Vec<_>>().join(", "),
        })
    };
    let layout = LAYOUTS.iter().find(|layout| names.contains(&layout.time)).unwrap_or(&LAYOUTS[0]);
    let time_place = place_of(layout.time)?;
    let places = layout.columns().map(place_of).collect::<Imported<Vec<usize>>>()?;
    let n_needed = 1 + names.iter().rposition(|name| !name.is_empty()).unwrap_or(0);

    let mut flight = Collector::default();
    let mut thrusts_n = Vec::new();
    let is_last = |line: &[u8]| std::ptr::eq(line.as_ptr_range().end, bytes.as_ptr_range().end);
    for (line, line_number) in lines {
        let text = String::from_utf8_lossy(line);
        let mut row = values(&text);
        if is_last(line) {
            // Without an end of line, what follows the last comma may be half a number.
            row.pop();
        }
        match read_row(&row, n_needed, time_place, &places) {
            Ok((time_ns, thrust_n, sample)) => {
                if flight.add(line_number, time_ns, sample) {
                    thrusts_n.push(thrust_n);
                }
            }
            Err(reason) => flight.skipped.add(reason, line_number),
        }
    }
    let airborne = airborne(&flight.samples, &thrusts_n);
    flight.finish(path, airborne)
}

/// The values of a line, without the logger's five brackets.
fn values(line: &str) -> Vec<&str> {
    let mut rest = line.trim();
    for _ in 0..5 {
        match rest.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            Some((_, after)) => rest = after.trim_start(),
            None => break,
        }
    }
    rest.split(',').map(str::trim).collect()
}

fn read_row(
    row: &[&str],
    n_needed: usize,
    time_place: usize,
    places: &[usize],
) -> Result<(i128, f64, Measurement), SkipReason> {
    if row.len() < n_needed {
        return Err(SkipReason::TooFewValues);
    }
    let time_ns = parse_ns(row[time_place], 1_000_000_000).ok_or(SkipReason::NotANumber)?;
    let mut numbers = Vec::with_capacity(places.len());
    for &place in places {
        numbers.push(row[place].parse().ok().filter(|x: &f64| x.is_finite()).ok_or(SkipReason::NotANumber)?);
    }
    let (thrust_n, sample) = sample_of(&numbers)?;
    Ok((time_ns, thrust_n, sample))
}

fn sample_of(numbers: &[f64]) -> Result<(f64, Measurement), SkipReason> {
    let (&[px, py, pz, ref attitude @ ..], &[vx, vy, vz, wx, wy, wz, u1, u2, u3, u4]) =
        numbers.split_at(numbers.len() - 10)
    else {
        return Err(SkipReason::TooFewValues);
    };
    let rotation = match *attitude {
        [q0, q1, q2, q3] => {
            let [w, x, y, z] =
                unit([q0, q1, q2, q3], ROUNDED_NORM_TOLERANCE).ok_or(SkipReason::NoUnitQuaternion)?;
            UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
        }
        [roll, pitch, yaw] => UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        _ => return Err(SkipReason::TooFewValues),
    };
    let [w, x, y, z] = [rotation.w, rotation.i, rotation.j, rotation.k];
    let sample = Measurement::default()
        .with_velocity_m_s([vx, vy, vz])
        .with_angular_velocity_rad_s([wx, wy, wz])
        .with_position_m([px, py, pz])
        .with_attitude_wxyz([w, x, y, z])
        .with_force_n((rotation * Vector3::new(0.0, 0.0, -u1)).into())
        .with_torque_n_m([u2, u3, u4]);
    Ok((u1, sample))
}

/// The longest run of samples with thrust, short gaps bridged, without its ends on the ground.
fn airborne(samples: &[Measurement], thrusts_n: &[f64]) -> Option<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for index in (0..samples.len()).filter(|&index| thrusts_n[index] > AIRBORNE_THRUST_N) {
        let after_gap_ns = |run: &Range<usize>| samples[index].stamp_ns - samples[run.end - 1].stamp_ns;
        match runs.last_mut() {
            Some(run) if after_gap_ns(run) as f64 * 1e-9 <= MAX_GAP_S => run.end = index + 1,
            _ => runs.push(index..index + 1),
        }
    }
    let run = runs.into_iter().max_by_key(Range::len)?;
    // On the ground, the force of the ground is not a function of the motion. The flight is therefore the part between the
    // first and the last sample clear of its lowest point (down is positive).
    let down_m = |index: usize| samples[index].position_m[2];
    let lowest_m = run.clone().map(down_m).fold(f64::NEG_INFINITY, f64::max);
    let is_clear = |index: &usize| lowest_m - down_m(*index) > CLEAR_OF_GROUND_M;
    match (run.clone().find(is_clear), run.clone().rev().find(is_clear)) {
        (Some(first), Some(last)) => Some(first..last + 1),
        _ => Some(run),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::payload::valid;
    use std::path::PathBuf;

    const PREFIX: &str = "[2024-06-13 12:18:02.8] [0x7f] [LogDataTag] [0x2ff1] [1] ";

    fn header() -> String {
        format!(
            "{PREFIX}Initial timestamp, {}, User-defined position x [m], {}, Other [-], ",
            LAYOUTS[0].time,
            LAYOUTS[0].columns().collect::<Vec<_>>().join(", ")
        )
    }

    /// A row at `t` with yaw 90°, 1 m/s to the north, 1 rad/s of roll rate and this thrust; more values than names.
    fn row(t: f64, thrust_n: f64) -> String {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        format!(
            "{PREFIX}1718295482836884, {t}, 9, 1, 2, 3, {half}, 0, 0, {half}, 1, 0, 0, 1, 0, 0, {thrust_n}, 0.1, 0.2, 0.3, 7, 8, 8, "
        )
    }

    fn log(rows: &[String]) -> String {
        format!("{}\n{}\n", header(), rows.join("\n"))
    }

    #[test]
    fn columns_are_found_by_name_and_the_thrust_turned_into_inertial_axes() {
        let tilted =
            row(0.5, 20.0).replace(", 0.7071067811865476, 0, 0, 0.7071067811865476,", ", 0.6, 0.8, 0, 0,");
        let flight = parse(log(&[row(0.25, 10.0), tilted]).as_bytes(), "log").unwrap();
        let [first, second] = flight.samples[..] else { panic!("two rows") };
        assert_eq!((first.sequence, first.stamp_ns, second.stamp_ns), (0, 0, 250_000_000));
        assert_eq!(first.valid, valid::RIGID_BODY);
        assert_eq!((first.velocity_m_s, first.position_m), ([1.0, 0.0, 0.0], [1.0, 2.0, 3.0]));
        assert_eq!((first.angular_velocity_rad_s, first.torque_n_m), ([1.0, 0.0, 0.0], [0.1, 0.2, 0.3]));
        assert_eq!(first.force_n, [0.0, 0.0, -10.0]);
        // Roll φ with cos φ/2 = 0.6, so cos φ = −0.28, sin φ = 0.96; R_x (0, 0, −20) = (0, 20 sin φ, −20 cos φ).
        assert!((second.force_n[1] - 19.2).abs() < 1e-12 && (second.force_n[2] - 5.6).abs() < 1e-12);
    }

    /// Roll 0.2, pitch 0.3, yaw 0.4 by the matrix of the 3-2-1 sequence: its third column times −20 N.
    #[test]
    fn euler_angles_of_a_winged_vehicle_turn_the_thrust() {
        let columns = LAYOUTS[1].columns().collect::<Vec<_>>().join(", ");
        let text = format!(
            "{PREFIX}, Controller Time [s], {columns}, \n{PREFIX}1.5, 1, 2, 3, 0.2, 0.3, 0.4, 4, 5, 6, 7, 8, 9, 20, 1, 2, 3, \n"
        );
        let text = text.replace(&format!("{PREFIX}1.5"), &format!("{PREFIX}, 1.5"));
        let flight = parse(text.as_bytes(), "log").unwrap();
        let ((sr, cr), (sp, cp), (sy, cy)) = (0.2_f64.sin_cos(), 0.3_f64.sin_cos(), 0.4_f64.sin_cos());
        let third = [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr];
        let sample = &flight.samples[0];
        assert!((0..3).all(|axis| (sample.force_n[axis] + 20.0 * third[axis]).abs() < 1e-12), "{sample:?}");
        assert_eq!((sample.velocity_m_s, sample.angular_velocity_rad_s), ([4.0, 5.0, 6.0], [7.0, 8.0, 9.0]));
        assert_eq!((sample.position_m, sample.torque_n_m), ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]));
    }

    #[test]
    fn bad_rows_are_skipped_and_counted_by_reason() {
        let rows = [
            row(0.0, 1.0),
            row(0.01, f64::NAN),
            row(0.01, 1.0).replace("0.1, 0.2", "0.1, word"),
            row(0.0, 1.0),
            row(0.02, 1.0).replace("0.7071067811865476", "0.2"),
            format!("{PREFIX}1718295482836884, 0.03, 9, 1"),
            "rubbish \u{0}".into(),
            row(0.04, 1.0),
        ];
        let flight = parse(log(&rows).as_bytes(), "log").unwrap();
        assert_eq!(flight.samples.len(), 2);
        for (reason, rows) in [
            (SkipReason::NotANumber, 2),
            (SkipReason::TimeNotIncreasing, 1),
            (SkipReason::NoUnitQuaternion, 1),
            (SkipReason::TooFewValues, 2),
        ] {
            assert_eq!(flight.skipped.for_reason(reason), rows, "{}", reason.words());
        }
        assert_eq!(flight.skipped_rows(), 6);
        let text = flight.skipped.to_string();
        assert!(
            text.starts_with("6 rows skipped: 2 × a needed value is not a finite number (first: line 3)"),
            "{text}"
        );
    }

    #[test]
    fn the_flight_is_the_longest_run_of_thrust_with_short_gaps_bridged() {
        let thrust = |k: usize| match k {
            5..=8 | 100..=149 | 160..=200 => 20.0,
            _ => 0.0,
        };
        let rows: Vec<_> = (0..300).map(|k| row(k as f64 * 0.01, thrust(k))).collect();
        let flight = parse(log(&rows).as_bytes(), "log").unwrap();
        assert_eq!(flight.airborne, Some(100..201));
        assert_eq!(flight.airborne_s(), Some((1.0, 2.0)));
        let part = flight.airborne_only().unwrap();
        assert_eq!((part.samples.len(), part.samples[0].sequence, part.samples[0].stamp_ns), (101, 0, 0));
        assert_eq!(part.duration_s(), 1.0);
        let grounded = parse(log(&[row(0.0, 0.0)]).as_bytes(), "log").unwrap();
        assert!(grounded.airborne.is_none() && grounded.airborne_only().is_none());
    }

    #[test]
    fn unusable_files_are_refused_with_a_sentence() {
        let message = |text: &str| parse(text.as_bytes(), "a.log").unwrap_err().to_string();
        assert!(message("").contains("'a.log' is empty"));
        assert!(message("\n \n").contains("'a.log' is empty"));
        let missing = message(&header().replace("Velocity y [m/s]", "Velocity b [m/s]"));
        assert!(
            missing.contains("no column 'Velocity y [m/s]'; its columns are: Initial timestamp,"),
            "{missing}"
        );
        let nothing = message(&log(&["nonsense".into()]));
        assert!(nothing.contains("no usable row; 1 rows skipped: 1 × fewer values"), "{nothing}");
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn a_log_cut_anywhere_keeps_its_whole_rows(cut in 0.0..1.0f64) {
            let text = log(&(0..5).map(|k| row(f64::from(k) * 0.01, 6.5)).collect::<Vec<_>>());
            let cut = (text.len() as f64 * cut) as usize;
            let n_lines = text[..cut].matches('\n').count();
            match parse(&text.as_bytes()[..cut], "log") {
                // The last line is whole from the comma after its last named value on.
                Ok(flight) => {
                    prop_assert!((n_lines - 1..=n_lines).contains(&flight.samples.len()));
                    prop_assert!(flight.samples.iter().all(|s| s.torque_n_m == [0.1, 0.2, 0.3]));
                }
                Err(_) => prop_assert!(n_lines <= 1),
            }
        }
    }

    fn recorded() -> Option<PathBuf> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/acsl");
        let Ok(entries) = std::fs::read_dir(&folder) else {
            testkit::skip("the recorded flight", &format!("no folder {}", folder.display()));
            return None;
        };
        entries.flatten().map(|entry| entry.path()).find(|path| path.extension().is_some_and(|e| e == "log"))
    }

    #[test]
    fn the_laboratory_s_flight_is_as_its_readme_describes_it() {
        let Some(path) = recorded() else { return };
        let flight = parse(&std::fs::read(path).unwrap(), "log").unwrap();
        println!("{} samples, {}, airborne {:?}", flight.samples.len(), flight.skipped, flight.airborne_s());
        assert_eq!(flight.samples.len() + flight.skipped_rows(), 2901);
        assert_eq!(flight.skipped_rows(), 0);
        let airborne = flight.airborne.clone().unwrap();
        // With thrust from about row 1000 to 2900; clear of the ground for about 15 s of that.
        assert!(
            (1000..1060).contains(&airborne.start) && (2450..2550).contains(&airborne.end),
            "{airborne:?}"
        );
        let part = flight.airborne_only().unwrap();
        let steps: Vec<_> = part.samples.windows(2).map(|s| s[1].stamp_ns - s[0].stamp_ns).collect();
        assert!(*steps.iter().max().unwrap() <= 13_900_001);
        let speed = |s: &Measurement| s.velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
        let fastest = part.samples.iter().map(speed).fold(0.0, f64::max);
        assert!((fastest - 4.9).abs() < 0.1, "{fastest} m/s");
        // Thrust over gravity in hover is the mass that the readme names.
        let lift = part.samples.iter().map(|s| -s.force_n[2]).sum::<f64>() / part.samples.len() as f64;
        assert!((2.0..2.5).contains(&(lift / 9.81)), "{lift} N");
    }
}
