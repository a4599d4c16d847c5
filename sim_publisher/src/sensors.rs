//! The sensors: measurements of the truth, with their errors, instants and dropouts.
//!
//! Each source of randomness has a random stream of its own, from which it draws once per sample, whether the value is used
//! or not. Neither dropouts nor another rate of fixes therefore change the noise.

use crate::disturbance::white;
use crate::plant::{State, Wrench};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shared_types::Measurement;

/// The purpose of a random stream.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Chance {
    Disturbance,
    Velocity,
    AngularVelocity,
    Position,
    Attitude,
    Jitter,
    Dropouts,
    /// The fault of this index.
    Faults(u64),
    /// The sensor of this place in a set.
    Sensor(u64),
}

impl Chance {
    /// The stream of this purpose, independent of all others of the same seed.
    pub(crate) fn stream(self, seed: u64) -> ChaCha8Rng {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(match self {
            Self::Disturbance => 0,
            Self::Velocity => 1,
            Self::AngularVelocity => 2,
            Self::Position => 3,
            Self::Attitude => 4,
            Self::Jitter => 5,
            Self::Dropouts => 6,
            Self::Faults(index) => 7 + index,
            Self::Sensor(place) => (1 << 32) + place,
        });
        random
    }
}

/// In which samples a quantity is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Schedule {
    /// In none.
    Never,
    /// In the first published one.
    Start,
    /// In every one.
    EverySample,
    /// At this rate (Hz): in the first sample, and then in the first one at or after each period's end.
    AtHz(f64),
}

impl Schedule {
    /// Whether sample `index` of samples at `rate_hz` carries the quantity.
    fn is_due(self, index: u64, rate_hz: f64, is_start: bool) -> bool {
        match self {
            Self::Never => false,
            Self::Start => is_start,
            Self::EverySample => true,
            Self::AtHz(fixes_hz) => {
                // The margin keeps 10 Hz of 200 Hz at every 20th sample where the quotient has lost a bit.
                let period = |index: u64| (index as f64 * fixes_hz / rate_hz + 1e-9).floor();
                index == 0 || period(index) > period(index - 1)
            }
        }
    }
}

/// A sensor of three quantities: `y = x + bias + δ(t) + noise · n ,  n ~ N(0, 1)`, independent for each axis and sample.
#[derive(Debug, Clone, Copy)]
pub struct VectorSensor {
    /// In which samples it measures.
    pub schedule: Schedule,
    /// Standard deviation of the white noise of each axis, in the quantity's unit.
    pub noise: f64,
    /// Constant error, in the quantity's unit.
    pub bias: Vector3<f64>,
    /// δ(t), the same for each axis, in the quantity's unit; its argument is in s.
    pub fixed_error: Option<fn(f64) -> f64>,
}

impl VectorSensor {
    /// An exact sensor with this schedule.
    pub fn at(schedule: Schedule) -> Self {
        Self { schedule, noise: 0.0, bias: Vector3::zeros(), fixed_error: None }
    }

    /// A sensor with white noise that measures in every sample.
    pub fn each_sample(noise: f64) -> Self {
        Self { noise, ..Self::at(Schedule::EverySample) }
    }

    /// Whether it ever measures.
    pub fn exists(&self) -> bool {
        self.schedule != Schedule::Never
    }

    fn error(&self, t_s: f64, white: &Vector3<f64>) -> Vector3<f64> {
        self.bias + self.noise * white + Vector3::repeat(self.fixed_error.map_or(0.0, |error| error(t_s)))
    }
}

/// Axes of a measured velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VelocityFrame {
    /// Inertial axes.
    Inertial,
    /// Body axes: a Doppler log.
    Body,
}

/// The sensors of a vehicle and the commands that it reports.
#[derive(Debug, Clone, Copy)]
pub struct SensorSuite {
    /// Velocity (m/s).
    pub velocity: VectorSensor,
    /// Axes of the velocity.
    pub velocity_frame: VelocityFrame,
    /// Angular velocity, body axes (rad/s).
    pub angular_velocity: VectorSensor,
    /// Position, inertial (m). The first published sample carries it without error: the start is known.
    pub position: VectorSensor,
    /// Attitude; the error is a small rotation about the body axes (rad).
    pub attitude: VectorSensor,
    /// Whether samples carry the commanded force.
    pub commands_force: bool,
    /// Whether samples carry the commanded torque.
    pub commands_torque: bool,
}

impl SensorSuite {
    /// No sensor at all.
    pub fn nothing() -> Self {
        let none = VectorSensor::at(Schedule::Never);
        Self {
            velocity: none,
            velocity_frame: VelocityFrame::Inertial,
            angular_velocity: none,
            position: none,
            attitude: none,
            commands_force: false,
            commands_torque: false,
        }
    }
}

/// The white noise of one sample: of velocity, angular velocity, position and attitude.
type Noise = [Vector3<f64>; 4];

/// The sensors of a run.
#[derive(Debug, Clone)]
pub(crate) struct Sensors {
    suite: SensorSuite,
    rate_hz: f64,
    started: bool,
    /// In the order of [`Noise`].
    streams: [ChaCha8Rng; 4],
}

impl Sensors {
    pub(crate) fn new(suite: SensorSuite, rate_hz: f64, seed: u64) -> Self {
        let chances = [Chance::Velocity, Chance::AngularVelocity, Chance::Position, Chance::Attitude];
        Self { suite, rate_hz, started: false, streams: chances.map(|chance| chance.stream(seed)) }
    }

    /// Draws the noise of a sample; once for each, lost ones included.
    pub(crate) fn draw(&mut self) -> Noise {
        self.streams.each_mut().map(white)
    }

    /// Sample `index`, taken at `t_s`. The first one asked for is the start.
    pub(crate) fn measure(
        &mut self,
        index: u64,
        t_s: f64,
        noise: &Noise,
        state: &State,
        command: &Wrench,
    ) -> Measurement {
        let is_start = !std::mem::replace(&mut self.started, true);
        let suite = &self.suite;
        let [velocity_noise, angular_noise, position_noise, attitude_noise] = noise;
        let is_due = |sensor: &VectorSensor| sensor.schedule.is_due(index, self.rate_hz, is_start);
        let mut sample = Measurement::at(stamp_ns(t_s), index);
        if is_due(&suite.velocity) {
            let error = suite.velocity.error(t_s, velocity_noise);
            sample = match suite.velocity_frame {
                VelocityFrame::Inertial => sample.with_velocity_m_s((state.velocity_m_s + error).into()),
                VelocityFrame::Body => {
                    let velocity = state.rotation().inverse() * state.velocity_m_s;
                    sample.with_body_velocity_m_s((velocity + error).into())
                }
            };
        }
        if is_due(&suite.angular_velocity) {
            let error = suite.angular_velocity.error(t_s, angular_noise);
            sample = sample.with_angular_velocity_rad_s((state.angular_velocity_rad_s + error).into());
        }
        if suite.position.exists() && is_start {
            sample = sample.with_position_m(state.position_m.into());
        } else if is_due(&suite.position) {
            let error = suite.position.error(t_s, position_noise);
            sample = sample.with_position_m((state.position_m + error).into());
        }
        if is_due(&suite.attitude) {
            let error = UnitQuaternion::new(suite.attitude.error(t_s, attitude_noise));
            sample = sample.with_attitude_wxyz(wxyz(&(state.rotation() * error)));
        }
        if suite.commands_force {
            sample = sample.with_force_n(command.force_n.into());
        }
        if suite.commands_torque {
            sample = sample.with_torque_n_m(command.torque_n_m.into());
        }
        sample
    }
}

/// w, x, y, z of a rotation.
pub(crate) fn wxyz(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k]
}

/// The stamp of an instant, to the nearest nanosecond.
pub(crate) fn stamp_ns(t_s: f64) -> u64 {
    (t_s * 1e9).round() as u64
}

/// The instants of the samples: `t₀ = 0 ,  t_j = j/rate + U(−jitter, jitter)`, at least 1 µs after `t_{j−1}`.
#[derive(Debug, Clone)]
pub(crate) struct SampleTimes {
    rate_hz: f64,
    jitter_s: f64,
    random: ChaCha8Rng,
    next_index: u64,
    previous_s: f64,
}

impl SampleTimes {
    const LEAST_STEP_S: f64 = 1e-6;

    pub(crate) fn new(rate_hz: f64, jitter_s: f64, seed: u64) -> Self {
        Self { rate_hz, jitter_s, random: Chance::Jitter.stream(seed), next_index: 0, previous_s: 0.0 }
    }

    pub(crate) fn next(&mut self) -> f64 {
        let planned_s = self.next_index as f64 / self.rate_hz;
        let offset_s = self.jitter_s * self.random.random_range(-1.0..1.0);
        if self.next_index > 0 {
            self.previous_s = (planned_s + offset_s).max(self.previous_s + Self::LEAST_STEP_S);
        }
        self.next_index += 1;
        self.previous_s
    }
}

/// A stretch of the run, its end excluded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Its start, after the start of the run (s).
    pub start_s: f64,
    /// How long it lasts (s).
    pub length_s: f64,
}

impl Span {
    /// Its end, after the start of the run (s).
    pub fn end_s(&self) -> f64 {
        self.start_s + self.length_s
    }

    /// Whether an instant lies in it.
    pub fn contains(&self, t_s: f64) -> bool {
        (self.start_s..self.end_s()).contains(&t_s)
    }

    /// Whether a stamp lies in it, counted from the start of the run.
    pub fn contains_ns(&self, at_ns: u64) -> bool {
        // Compared as stamps are made: 1.2 s is sample 240 of 200 Hz, whatever the last bit of 0.2 + 1.0.
        (stamp_ns(self.start_s)..stamp_ns(self.end_s())).contains(&at_ns)
    }

    /// Whether they share an instant.
    pub fn overlaps(&self, other: &Self) -> bool {
        self.start_s < other.end_s() && other.start_s < self.end_s()
    }

    /// Reads `START:LENGTH`.
    ///
    /// # Errors
    /// What was found and what is needed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let needed = || format!("'{text}': needed: START:LENGTH in s, for example 30:2.5");
        let (start, length) = text.split_once(':').ok_or_else(needed)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| needed());
        Ok(Self { start_s: number(start)?, length_s: number(length)? })
    }
}

/// A time in which no sample arrives.
pub type Outage = Span;

/// Which samples never arrive.
#[derive(Debug, Clone)]
pub(crate) struct Losses {
    dropout_probability: f64,
    outages: Vec<Outage>,
    random: ChaCha8Rng,
}

impl Losses {
    pub(crate) fn new(dropout_probability: f64, outages: Vec<Outage>, seed: u64) -> Self {
        Self { dropout_probability, outages, random: Chance::Dropouts.stream(seed) }
    }

    /// Whether the sample at `t_s` is lost; asked once for each sample.
    pub(crate) fn loses(&mut self, t_s: f64) -> bool {
        let drops: f64 = self.random.random();
        drops < self.dropout_probability || self.outages.iter().any(|outage| outage.contains(t_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use shared_types::payload::{frame, valid};

    #[test]
    fn every_kind_of_chance_draws_from_a_stream_of_its_own() {
        use std::collections::HashSet;
        let mut streams = Sensors::new(SensorSuite::nothing(), 100.0, 4).streams.to_vec();
        streams.extend([
            Chance::Disturbance.stream(4),
            SampleTimes::new(100.0, 0.0, 4).random,
            Losses::new(0.0, Vec::new(), 4).random,
            Chance::Faults(0).stream(4),
            Chance::Faults(1).stream(4),
        ]);
        let firsts: HashSet<u64> = streams.into_iter().map(|mut stream| stream.random()).collect();
        assert_eq!(firsts.len(), 9);
    }

    #[test]
    fn ten_hertz_of_two_hundred_is_every_twentieth_sample() {
        for (rate_hz, fixes_hz, expected) in [(200.0, 10.0, 20), (100.0, 10.0, 10), (300.0, 0.3, 1000)] {
            for index in 0..5_000u64 {
                let due = Schedule::AtHz(fixes_hz).is_due(index, rate_hz, false);
                assert_eq!(due, index.is_multiple_of(expected), "sample {index} of {fixes_hz}/{rate_hz} Hz");
            }
        }
        let due = (0..7000).filter(|&index| Schedule::AtHz(30.0).is_due(index, 70.0, false)).count();
        assert_eq!(due, 3000, "a rate that does not divide the samples' is kept on average");
        assert!((0..100).all(|index| Schedule::AtHz(1e4).is_due(index, 100.0, false)));
    }

    #[test]
    fn instants_increase_strictly_even_where_the_jitter_exceeds_the_period() {
        let mut times = SampleTimes::new(200.0, 0.02, 3);
        let mut previous_s = times.next();
        assert_eq!(previous_s, 0.0);
        let mut backwards = 0;
        for index in 1..10_000 {
            let t_s = times.next();
            assert!(t_s >= previous_s + 0.9e-6);
            // One microsecond for each sample that had to wait for its predecessor.
            assert!((t_s - f64::from(index) / 200.0).abs() <= 0.02 + 1e-4);
            backwards += u32::from(t_s - previous_s < 2e-6);
            previous_s = t_s;
        }
        assert!(backwards > 1000, "the jitter was to be larger than the period");
    }

    #[test]
    fn without_jitter_the_instants_are_multiples_of_the_period() {
        let mut times = SampleTimes::new(300.0, 0.0, 3);
        assert!((0..1000).all(|index| times.next() == f64::from(index) / 300.0));
    }

    #[test]
    fn outages_are_half_open_and_dropouts_as_frequent_as_asked() {
        let outages = vec![Outage { start_s: 1.0, length_s: 0.5 }, Outage { start_s: 3.0, length_s: 0.1 }];
        let mut losses = Losses::new(0.0, outages, 1);
        for (t_s, lost) in [(0.999, false), (1.0, true), (1.499, true), (1.5, false), (3.05, true)] {
            assert_eq!(losses.loses(t_s), lost, "at {t_s} s");
        }
        let mut losses = Losses::new(0.1, Vec::new(), 1);
        let n = (0..100_000).filter(|_| losses.loses(0.0)).count() as f64;
        // Four standard deviations of the binomial distribution.
        assert!((n - 1e4).abs() < 4.0 * (1e5f64 * 0.1 * 0.9).sqrt(), "{n}");
    }

    #[test]
    fn errors_enter_in_the_sensor_s_own_frame_with_the_stated_size() {
        let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let state = State {
            velocity_m_s: Vector3::new(0.0, 2.0, 0.0),
            position_m: Vector3::new(7.0, 8.0, 9.0),
            attitude: turned.into_inner(),
            ..State::at_rest()
        };
        let suite = SensorSuite {
            velocity: VectorSensor { bias: Vector3::new(0.1, 0.0, 0.0), ..VectorSensor::each_sample(0.2) },
            velocity_frame: VelocityFrame::Body,
            position: VectorSensor { noise: 0.5, ..VectorSensor::at(Schedule::AtHz(100.0)) },
            attitude: VectorSensor::each_sample(0.005),
            ..SensorSuite::nothing()
        };
        let mut sensors = Sensors::new(suite, 100.0, 9);
        let n = 20_000u64;
        let (mut velocity, mut position, mut attitude) = ([0.0; 2], 0.0, 0.0);
        for index in 0..n {
            let noise = sensors.draw();
            let sample = sensors.measure(index, 0.0, &noise, &state, &Wrench::zero());
            assert_eq!(sample.velocity_frame, frame::BODY);
            assert!(!sample.has(valid::ANGULAR_VELOCITY) && !sample.has(valid::FORCE));
            // The body looks east: 2 m/s to the east is 2 m/s ahead.
            velocity[0] += (sample.velocity_m_s[0] - 2.0) / n as f64;
            velocity[1] += (sample.velocity_m_s[0] - 2.1).powi(2) / n as f64;
            position += (sample.position_m[2] - 9.0).powi(2) / n as f64;
            let [w, x, y, z] = sample.attitude_wxyz;
            let measured = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            attitude += measured.angle_to(&turned).powi(2) / n as f64;
            assert_eq!(index == 0, sample.position_m == [7.0, 8.0, 9.0], "only the start is exact");
        }
        // Four standard deviations: of a mean s/√n, of a variance s² √(2/n).
        let relative = 4.0 * (2.0 / n as f64).sqrt();
        assert!((velocity[0] - 0.1).abs() < 4.0 * 0.2 / (n as f64).sqrt());
        assert!((velocity[1] / 0.04 - 1.0).abs() < relative);
        assert!((position / 0.25 - 1.0).abs() < relative);
        assert!((attitude / (3.0 * 0.005f64.powi(2)) - 1.0).abs() < relative);
    }
}
