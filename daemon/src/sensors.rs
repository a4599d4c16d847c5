//! The sensors of the configuration: a sample as its sensor reads it becomes one in body axes, at the instant of the reading, with
//! deviations.
//!
//! With M the rotation of the mounting, from the sensor's axes to the body's:
//!
//! ```text
//! v = M v_s,   ω = M ω_s,   a = M a_s,   q = q_s M⁻¹,   t = t_s − latency
//! σ_i² = Σ_k M_ik² σ_k²        of v, ω, a, and of the rotation vector of q
//! ```
//!
//! The lever arm is the observer's: it needs the estimated attitude and angular velocity of that instant.

use crate::config::{InputConfig, OutlierWeight, SensorConfig};
use crate::gate::{missing, sample_of};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use observer::{MAX_SENSORS, Outliers, Sample, SensorUse};
use shared_types::Measurement;
use shared_types::payload::{Rejection, absent, frame, valid};

/// A mounting that turns an axis by less than this (rad) into another one leaves it where it is.
const LEAST_SHARE: f64 = 1e-6;

/// Where a sensor sits, and what becomes of its outliers.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Installed {
    /// From the center of mass, body axes (m).
    pub lever_arm_m: Vector3<f64>,
    /// Which one it is.
    pub sensor: SensorUse,
}

/// The sensors by their numbers.
#[derive(Debug, Clone, Default)]
pub struct Sensors {
    /// At 0, where there are others, samples of no sensor.
    of_number: [Option<Sensor>; MAX_SENSORS],
    has_any: bool,
}

#[derive(Debug, Clone, Copy)]
struct Sensor {
    installed: Installed,
    /// `None` where the axes are the body's.
    mounting: Option<UnitQuaternion<f64>>,
    latency_ns: u64,
    /// 1 σ of velocity, angular velocity, specific force, position, attitude, where the sample has none.
    noises: [f64; 5],
}

impl Sensors {
    /// Those of a configuration that is checked.
    pub fn new(configs: &[SensorConfig]) -> Self {
        let mut sensors = Self { of_number: [None; MAX_SENSORS], has_any: !configs.is_empty() };
        for config in configs {
            if let Some(sensor) = sensors.of_number.get_mut(config.number as usize) {
                *sensor = Some(Sensor::of(config));
            }
        }
        sensors
    }

    /// The sample in body axes, and where its sensor sits. Values that are not valid stay as they are.
    ///
    /// # Errors
    /// `UnknownSensor`; `Malformed` where a mounting leaves nothing of a reading of which components are missing.
    pub fn read(&self, measurement: &Measurement) -> Result<(Measurement, Installed), Rejection> {
        if !self.has_any || measurement.sensor == 0 {
            return Ok((*measurement, Installed::default()));
        }
        let sensor = self.of_number.get(measurement.sensor as usize).copied().flatten();
        let sensor = sensor.ok_or(Rejection::UnknownSensor)?;
        Ok((sensor.in_body_axes(measurement)?, sensor.installed))
    }

    /// The measurement as a sample for the observer of the rigid body.
    ///
    /// # Errors
    /// As [`Sensors::read`] and [`sample_of`].
    pub fn sample(&self, measurement: &Measurement, limits: &InputConfig) -> Result<Sample, Rejection> {
        let (measurement, Installed { lever_arm_m, sensor }) = self.read(measurement)?;
        Ok(Sample { lever_arm_m, sensor, ..sample_of(&measurement, limits)? })
    }
}

impl Sensor {
    fn of(config: &SensorConfig) -> Self {
        let [w, x, y, z] = config.mounting_wxyz;
        let mounting = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Self {
            installed: Installed {
                lever_arm_m: config.lever_arm_m.into(),
                sensor: SensorUse {
                    place: config.number as usize,
                    outliers: match config.outliers {
                        OutlierWeight::Weigh => Outliers::Weigh,
                        OutlierWeight::Reject => Outliers::Reject,
                        OutlierWeight::Off => Outliers::Off,
                    },
                    ..SensorUse::default()
                },
            },
            mounting: Some(mounting).filter(|_| config.mounting_wxyz != [1.0, 0.0, 0.0, 0.0]),
            latency_ns: (config.latency_s * 1e9).round() as u64,
            noises: [
                config.velocity_noise_m_s,
                config.angular_velocity_noise_rad_s,
                config.specific_force_noise_m_s2,
                config.position_noise_m,
                config.attitude_noise_rad,
            ],
        }
    }

    fn in_body_axes(&self, measurement: &Measurement) -> Result<Measurement, Rejection> {
        let mut m = *measurement;
        m.stamp_ns = m.stamp_ns.saturating_sub(self.latency_ns);
        let stds = [
            &mut m.velocity_std_m_s,
            &mut m.angular_velocity_std_rad_s,
            &mut m.specific_force_std_m_s2,
            &mut m.position_std_m,
            &mut m.attitude_std_rad,
        ];
        for (std, noise) in stds.into_iter().zip(self.noises) {
            std.iter_mut().filter(|std| **std == 0.0).for_each(|std| *std = noise);
        }
        let Some(mounting) = self.mounting else { return Ok(m) };
        let squares: Matrix3<f64> = mounting.to_rotation_matrix().matrix().map(|entry| entry * entry);
        let turn_std = |std: &mut [f64; 3]| {
            let variances = Vector3::from(*std).map(|std| std * std);
            *std = (squares * variances).map(f64::sqrt).into();
        };
        let is_body = m.has(valid::VELOCITY) && m.velocity_frame == frame::BODY;
        let vectors = [
            (is_body, absent::VELOCITY_X, &mut m.velocity_m_s, &mut m.velocity_std_m_s),
            (
                measurement.has(valid::ANGULAR_VELOCITY),
                absent::ANGULAR_VELOCITY_X,
                &mut m.angular_velocity_rad_s,
                &mut m.angular_velocity_std_rad_s,
            ),
            (
                measurement.has(valid::SPECIFIC_FORCE),
                absent::SPECIFIC_FORCE_X,
                &mut m.specific_force_m_s2,
                &mut m.specific_force_std_m_s2,
            ),
        ];
        let rotation = mounting.to_rotation_matrix();
        for (is_there, first_absent, value, std) in vectors {
            if !is_there {
                continue;
            }
            let missing = missing(measurement, first_absent);
            let known = Vector3::from_fn(|k, _| if missing[k] { 0.0 } else { value[k] });
            *value = (mounting * known).into();
            turn_std(std);
            // A component that has a share of a missing one is missing.
            m.absent &= !(0b111 * first_absent);
            for axis in 0..3 {
                let share = |k: usize| missing[k] && rotation[(axis, k)].abs() > LEAST_SHARE;
                m.absent |= if (0..3).any(share) { first_absent << axis } else { 0 };
            }
            if m.absent & (0b111 * first_absent) == 0b111 * first_absent {
                return Err(Rejection::Malformed);
            }
        }
        if m.has(valid::ATTITUDE) {
            let [w, x, y, z] = m.attitude_wxyz;
            let turned = Quaternion::new(w, x, y, z) * mounting.inverse().into_inner();
            m.attitude_wxyz = [turned.w, turned.i, turned.j, turned.k];
            turn_std(&mut m.attitude_std_rad);
        }
        Ok(m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(number: u32) -> SensorConfig {
        toml::from_str(&format!("name = \"s{number}\"\nnumber = {number}")).unwrap()
    }

    /// By matrices, against the quaternions above, there and back.
    #[test]
    fn a_mounting_turns_every_reading_and_back() {
        let mounting = UnitQuaternion::new(Vector3::new(0.3, -2.0, 0.7));
        let q = mounting.coords;
        let sensors = |wxyz: [f64; 4]| Sensors::new(&[SensorConfig { mounting_wxyz: wxyz, ..config(3) }]);
        let there = sensors([q.w, q.x, q.y, q.z]);
        let back = sensors([q.w, -q.x, -q.y, -q.z]);
        let attitude = UnitQuaternion::new(Vector3::new(-0.4, 0.1, 1.1));
        let told = attitude.coords;
        let read = Measurement::at(5, 0)
            .with_body_velocity_m_s([1.0, -2.0, 0.5])
            .with_velocity_std_m_s([0.1; 3])
            .with_angular_velocity_rad_s([0.3, 0.2, -0.1])
            .with_specific_force_m_s2([0.0, 1.0, -9.8])
            .with_position_m([7.0, 8.0, 9.0])
            .with_attitude_wxyz([told.w, told.x, told.y, told.z])
            .of_sensor(3);
        let (turned, _) = there.read(&read).unwrap();
        let matrix = mounting.to_rotation_matrix();
        for (found, of_sensor) in [
            (turned.velocity_m_s, read.velocity_m_s),
            (turned.angular_velocity_rad_s, read.angular_velocity_rad_s),
            (turned.specific_force_m_s2, read.specific_force_m_s2),
        ] {
            let wanted = matrix.matrix() * Vector3::from(of_sensor);
            assert!((Vector3::from(found) - wanted).norm() < 1e-12);
        }
        // A direction fixed to the world is the same, whichever axes it is told in.
        let north = attitude.to_rotation_matrix().matrix() * Vector3::x();
        let [w, x, y, z] = turned.attitude_wxyz;
        let body = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix();
        assert!((body.matrix() * (matrix.matrix() * Vector3::x()) - north).norm() < 1e-12);
        assert_eq!(turned.position_m, read.position_m);
        assert!(turned.velocity_std_m_s.iter().all(|std| (std - 0.1).abs() < 1e-15));
        let (again, _) = back.read(&turned).unwrap();
        for (found, wanted) in [
            (again.velocity_m_s, read.velocity_m_s),
            (again.angular_velocity_rad_s, read.angular_velocity_rad_s),
        ] {
            assert!((Vector3::from(found) - Vector3::from(wanted)).norm() < 1e-12);
        }
    }

    #[test]
    fn noise_latency_and_place_are_those_of_the_number() {
        let dvl = SensorConfig {
            latency_s: 0.15,
            velocity_noise_m_s: 0.02,
            lever_arm_m: [0.3, 0.0, 0.1],
            outliers: OutlierWeight::Reject,
            ..config(2)
        };
        let sensors = Sensors::new(&[config(1), dvl]);
        let sample = Measurement::at(1_000_000_000, 4)
            .with_body_velocity_m_s([1.0, 0.0, 0.0])
            .with_velocity_std_m_s([0.5, 0.0, 0.0]);
        let (read, installed) = sensors.read(&sample.of_sensor(2)).unwrap();
        assert_eq!((read.stamp_ns, read.velocity_std_m_s), (850_000_000, [0.5, 0.02, 0.02]));
        assert_eq!(installed.lever_arm_m, Vector3::new(0.3, 0.0, 0.1));
        assert_eq!(
            installed.sensor,
            SensorUse { place: 2, outliers: Outliers::Reject, ..SensorUse::default() }
        );
        assert_eq!(sensors.read(&sample).unwrap(), (sample, Installed::default()));
        for number in [3, 15, 16, u32::MAX] {
            assert_eq!(sensors.read(&sample.of_sensor(number)), Err(Rejection::UnknownSensor), "{number}");
        }
        let none = Sensors::new(&[]);
        assert!(none.read(&sample.of_sensor(7)).is_ok(), "nothing is known of numbers: they do not matter");
    }

    #[test]
    fn what_a_mounting_makes_of_a_missing_component_is_missing() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let read = |mounting_wxyz: [f64; 4], absent: u32| {
            let sensors = Sensors::new(&[SensorConfig { mounting_wxyz, ..config(1) }]);
            let sample = Measurement::at(1, 0).with_angular_velocity_rad_s([1.0, f64::NAN, 3.0]).of_sensor(1);
            sensors.read(&Measurement { absent, ..sample }).map(|(read, _)| read)
        };
        // A quarter turn about z.
        let (x, y) = (absent::ANGULAR_VELOCITY_X, absent::ANGULAR_VELOCITY_Y);
        let turned = read([half, 0.0, 0.0, half], y | absent::POSITION_X).unwrap();
        assert_eq!(turned.absent, x | absent::POSITION_X);
        assert!((turned.angular_velocity_rad_s[1] - 1.0).abs() < 1e-12);
        assert!((turned.angular_velocity_rad_s[2] - 3.0).abs() < 1e-12);
        // Half of that: both x and y have a share of what is missing.
        let eighth = std::f64::consts::FRAC_PI_8;
        let turned = read([eighth.cos(), 0.0, 0.0, eighth.sin()], y).unwrap();
        assert_eq!(turned.absent, x | y);
        // About (1, 1, 1): every one has.
        assert_eq!(read([0.6, half * 0.8, half * 0.4, half * 0.8], y), Err(Rejection::Malformed));
    }
}
