//! Sensors of several processes: each with its own rate, delay, noise, place on the vehicle, dropouts and silences, read from a file.
//!
//! A sensor measures at `k/rate` of its own, which is a whole number of the simulation's steps; its sample is sent after the delay,
//! and never before the one that it sent last. Every sensor has a random stream of its own, from which it draws as often whatever
//! is lost: another delay, or a silence, changes no reading.

use crate::delivery::{Delivery, Outgoing};
use crate::disturbance::white;
use crate::scenario::Scenario;
use crate::sensors::{Chance, Span, stamp_ns, wxyz};
use crate::simulation::{SimulatedSample, Simulation, SimulationError, SimulationOptions};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use shared_types::Measurement;
use shared_types::service::MAX_SOURCES;
use std::collections::VecDeque;
use std::path::Path;

/// The sets that are built in: name and text.
pub const SENSOR_SETS: [(&str, &str); 3] = [
    ("auv-survey", include_str!("../sensor_sets/auv-survey.toml")),
    ("multicopter-gnss", include_str!("../sensor_sets/multicopter-gnss.toml")),
    ("multicopter-imu", include_str!("../sensor_sets/multicopter-imu.toml")),
];

/// What a sensor can measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Of the sensor's place, inertial axes.
    Velocity,
    /// Of the sensor's place, along its axes.
    BodyVelocity,
    /// Along its axes.
    AngularVelocity,
    /// Of the center of mass, along its axes.
    SpecificForce,
    /// Of the sensor's place, inertial axes.
    Position,
    /// z of that.
    Depth,
    /// Of its axes.
    Attitude,
    /// Not measured: the force and torque that are commanded.
    Commands,
}

/// One sensor, which a process of its own publishes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetSensor {
    /// Its name.
    pub name: String,
    /// `sensor` of its samples.
    #[serde(default)]
    pub number: u32,
    /// What its samples carry.
    pub measures: Vec<Quantity>,
    /// Its rate (Hz), of which the set's rate is a multiple.
    pub rate_hz: f64,
    /// From the reading to the sending (s).
    #[serde(default)]
    pub delay_s: f64,
    /// The delay is up to this longer (s).
    #[serde(default)]
    pub delay_jitter_s: f64,
    /// Whether it stamps its samples when it sends them, in place of when it read.
    #[serde(default)]
    pub stamps_on_arrival: bool,
    /// White noise of each component, 1 σ (m/s).
    #[serde(default)]
    pub velocity_noise_m_s: f64,
    /// White noise of each component, 1 σ (rad/s).
    #[serde(default)]
    pub angular_velocity_noise_rad_s: f64,
    /// White noise of each component, 1 σ (m/s²).
    #[serde(default)]
    pub specific_force_noise_m_s2: f64,
    /// Constant error along its axes (m/s²).
    #[serde(default)]
    pub specific_force_bias_m_s2: [f64; 3],
    /// White noise of each component, 1 σ (m).
    #[serde(default)]
    pub position_noise_m: f64,
    /// White noise of each component of the rotation vector, 1 σ (rad).
    #[serde(default)]
    pub attitude_noise_rad: f64,
    /// Whether its samples carry these.
    #[serde(default)]
    pub tells_noise: bool,
    /// Where it sits, from the center of mass, body axes (m).
    #[serde(default)]
    pub lever_arm_m: [f64; 3],
    /// The rotation of its axes into the body's.
    #[serde(default = "identity")]
    pub mounting_wxyz: [f64; 4],
    /// Probability that a sample is lost on its way; its sequence is used up.
    #[serde(default)]
    pub dropout_probability: f64,
    /// `START:LENGTH` (s): its driver says nothing.
    #[serde(default)]
    pub silences: Vec<String>,
    /// `START:LENGTH` (s): its driver says zeros, as if they were valid.
    #[serde(default)]
    pub zeros: Vec<String>,
}

fn identity() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

/// A vehicle with sensors of several processes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSet {
    /// Which vehicle.
    pub scenario: Scenario,
    /// Steps of the simulation and its controller (Hz).
    pub rate_hz: f64,
    /// The sensors.
    pub sensor: Vec<SetSensor>,
}

/// Why a set of sensors is refused.
#[derive(Debug, thiserror::Error)]
pub enum SensorSetError {
    /// The file cannot be read.
    #[error("cannot read '{path}': {cause}; built in: {}", SENSOR_SETS.map(|(name, _)| name).join(", "))]
    File {
        /// Its path.
        path: String,
        /// Why.
        cause: std::io::Error,
    },
    /// It is no such file.
    #[error("'{name}': {cause}")]
    Format {
        /// Its path or name.
        name: String,
        /// What is wrong, and where.
        cause: String,
    },
    /// A value is out of range.
    #[error("sensor '{sensor}': {key}: found {found}; needed: {needed}")]
    Value {
        /// The sensor's name.
        sensor: String,
        /// The key.
        key: &'static str,
        /// Its value.
        found: String,
        /// What would be accepted.
        needed: String,
    },
    /// As of a simulation.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
}

impl SensorSet {
    /// A built-in set by its name, or a file.
    ///
    /// # Errors
    /// `File`, `Format`, `Value`.
    pub fn read(name: &str) -> Result<Self, SensorSetError> {
        if let Some((_, text)) = SENSOR_SETS.iter().find(|(known, _)| *known == name) {
            return Self::parse(name, text);
        }
        let text = std::fs::read_to_string(Path::new(name))
            .map_err(|cause| SensorSetError::File { path: name.into(), cause })?;
        Self::parse(name, &text)
    }

    fn parse(name: &str, text: &str) -> Result<Self, SensorSetError> {
        let format = |cause: String| SensorSetError::Format { name: name.into(), cause };
        let set: Self = toml::from_str(text).map_err(|error| format(error.to_string()))?;
        if set.sensor.is_empty() || set.sensor.len() > MAX_SOURCES {
            return Err(format(format!("{} sensors; needed: 1 … {MAX_SOURCES}", set.sensor.len())));
        }
        set.sensor.iter().try_for_each(|sensor| sensor.check(set.rate_hz))?;
        Ok(set)
    }

    /// Flies: the truth of each step, and what is sent then by each sensor.
    ///
    /// # Errors
    /// As [`Simulation::new`]; `Value` where a stretch of time is no `START:LENGTH`.
    pub fn fly(&self, duration_s: Option<f64>, seed: u64) -> Result<SensorFlight, SensorSetError> {
        let options = SimulationOptions {
            duration_s,
            rate_hz: self.rate_hz,
            seed,
            ..SimulationOptions::of(self.scenario)
        };
        let sources = self.sensor.iter().zip(0..);
        let sources = sources.map(|(sensor, place)| Source::new(sensor, place, self.rate_hz, seed));
        Ok(SensorFlight {
            simulation: Simulation::new(&options)?,
            sources: sources.collect::<Result<_, _>>()?,
            next_step: 0,
            simulated_ns: None,
            on_the_way: VecDeque::new(),
        })
    }
}

impl SetSensor {
    fn check(&self, set_rate_hz: f64) -> Result<(), SensorSetError> {
        let refuse = |key, found: String, needed: &str| {
            Err(SensorSetError::Value { sensor: self.name.clone(), key, found, needed: needed.into() })
        };
        let steps = set_rate_hz / self.rate_hz;
        if !(steps >= 1.0 - 1e-9 && (steps - steps.round()).abs() < 1e-6 * steps) {
            let needed = format!("a rate of which {set_rate_hz} Hz, the set's, is a multiple");
            return refuse("rate_hz", self.rate_hz.to_string(), &needed);
        }
        let sizes = [
            ("delay_s", self.delay_s),
            ("delay_jitter_s", self.delay_jitter_s),
            ("velocity_noise_m_s", self.velocity_noise_m_s),
            ("angular_velocity_noise_rad_s", self.angular_velocity_noise_rad_s),
            ("specific_force_noise_m_s2", self.specific_force_noise_m_s2),
            ("position_noise_m", self.position_noise_m),
            ("attitude_noise_rad", self.attitude_noise_rad),
        ];
        for (key, size) in sizes {
            if !(size.is_finite() && size >= 0.0) {
                return refuse(key, size.to_string(), "a finite number, 0 or more");
            }
        }
        if !(0.0..=1.0).contains(&self.dropout_probability) {
            return refuse("dropout_probability", self.dropout_probability.to_string(), "0 … 1");
        }
        let norm = Quaternion::from(self.mounting_xyzw()).norm();
        if !(0.999..=1.001).contains(&norm) {
            return refuse("mounting_wxyz", format!("{:?}", self.mounting_wxyz), "a unit quaternion");
        }
        if self.measures.is_empty() {
            return refuse("measures", "nothing".into(), "at least one quantity");
        }
        let has = |quantity| self.measures.contains(&quantity);
        if has(Quantity::Velocity) && has(Quantity::BodyVelocity)
            || has(Quantity::Position) && has(Quantity::Depth)
        {
            let needed = "one velocity and one position at most";
            return refuse("measures", format!("{:?}", self.measures), needed);
        }
        Ok(())
    }

    fn mounting_xyzw(&self) -> [f64; 4] {
        let [w, x, y, z] = self.mounting_wxyz;
        [x, y, z, w]
    }

    fn mounting(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_quaternion(Quaternion::from(self.mounting_xyzw()))
    }

    /// Its reading of a step, with this noise.
    fn read(&self, at: &SimulatedSample, sequence: u64, noise: &Noise) -> Measurement {
        let truth = &at.truth;
        let [w, x, y, z] = truth.attitude_wxyz;
        let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let (mounting, arm) = (self.mounting(), Vector3::from(self.lever_arm_m));
        let rate = Vector3::from(truth.angular_velocity_rad_s);
        let velocity = Vector3::from(truth.velocity_m_s) + attitude * rate.cross(&arm);
        let position =
            Vector3::from(truth.position_m) + attitude * arm + self.position_noise_m * noise.position;
        let velocity_noise = self.velocity_noise_m_s * noise.velocity;
        let mut sample = Measurement::at(truth.stamp_ns, sequence).of_sensor(self.number);
        for quantity in &self.measures {
            sample = match quantity {
                Quantity::Velocity => sample.with_velocity_m_s((velocity + velocity_noise).into()),
                Quantity::BodyVelocity => {
                    let along = (attitude * mounting).inverse() * velocity;
                    sample.with_body_velocity_m_s((along + velocity_noise).into())
                }
                Quantity::AngularVelocity => {
                    let noise = self.angular_velocity_noise_rad_s * noise.angular_velocity;
                    sample.with_angular_velocity_rad_s((mounting.inverse() * rate + noise).into())
                }
                Quantity::SpecificForce => {
                    let noise = self.specific_force_noise_m_s2 * noise.specific_force;
                    let bias = Vector3::from(self.specific_force_bias_m_s2);
                    let force = mounting.inverse() * at.specific_force_m_s2 + bias;
                    sample.with_specific_force_m_s2((force + noise).into())
                }
                Quantity::Position => sample.with_position_m(position.into()),
                Quantity::Depth => sample.with_position_z_m(position.z),
                Quantity::Attitude => {
                    let error = UnitQuaternion::new(self.attitude_noise_rad * noise.attitude);
                    sample.with_attitude_wxyz(wxyz(&(attitude * mounting * error)))
                }
                Quantity::Commands => sample
                    .with_force_n(at.command.force_n.into())
                    .with_torque_n_m(at.command.torque_n_m.into()),
            };
        }
        if self.tells_noise {
            sample.velocity_std_m_s = [self.velocity_noise_m_s; 3];
            sample.angular_velocity_std_rad_s = [self.angular_velocity_noise_rad_s; 3];
            sample.specific_force_std_m_s2 = [self.specific_force_noise_m_s2; 3];
            sample.position_std_m = [self.position_noise_m; 3];
            sample.attitude_std_rad = [self.attitude_noise_rad; 3];
        }
        sample
    }
}

/// White noise of one reading, of deviation 1.
#[derive(Debug)]
struct Noise {
    velocity: Vector3<f64>,
    angular_velocity: Vector3<f64>,
    specific_force: Vector3<f64>,
    position: Vector3<f64>,
    attitude: Vector3<f64>,
}

impl Noise {
    fn draw(random: &mut ChaCha8Rng) -> Self {
        let [velocity, angular_velocity, specific_force, position, attitude] =
            std::array::from_fn(|_| white(random));
        Self { velocity, angular_velocity, specific_force, position, attitude }
    }
}

#[derive(Debug)]
struct Source {
    sensor: SetSensor,
    place: usize,
    every: u64,
    silences: Vec<Span>,
    zeros: Vec<Span>,
    random: ChaCha8Rng,
    sequence: u64,
    newest_sent_ns: u64,
}

impl Source {
    fn new(sensor: &SetSensor, place: usize, set_rate_hz: f64, seed: u64) -> Result<Self, SensorSetError> {
        let spans = |key, texts: &[String]| {
            let spans = texts.iter().map(|text| Span::parse(text));
            spans.collect::<Result<Vec<_>, _>>().map_err(|found| SensorSetError::Value {
                sensor: sensor.name.clone(),
                key,
                found,
                needed: "START:LENGTH in s".into(),
            })
        };
        Ok(Self {
            place,
            every: (set_rate_hz / sensor.rate_hz).round() as u64,
            silences: spans("silences", &sensor.silences)?,
            zeros: spans("zeros", &sensor.zeros)?,
            random: Chance::Sensor(place as u64).stream(seed),
            sequence: 0,
            newest_sent_ns: 0,
            sensor: sensor.clone(),
        })
    }

    /// What it sends of this step.
    fn send(&mut self, step: u64, at: &SimulatedSample) -> Option<Outgoing> {
        if !step.is_multiple_of(self.every) {
            return None;
        }
        let noise = Noise::draw(&mut self.random);
        let (drops, late): (f64, f64) = (self.random.random(), self.random.random());
        let is_in = |spans: &[Span]| spans.iter().any(|span| span.contains_ns(at.truth.stamp_ns));
        if is_in(&self.silences) {
            return None;
        }
        let mut measurement = self.sensor.read(at, self.sequence, &noise);
        self.sequence += 1;
        if is_in(&self.zeros) {
            measurement.velocity_m_s = [0.0; 3];
            measurement.angular_velocity_rad_s = [0.0; 3];
        }
        let delay_ns = stamp_ns(self.sensor.delay_s + late * self.sensor.delay_jitter_s);
        let at_ns = (at.truth.stamp_ns + delay_ns).max(self.newest_sent_ns);
        self.newest_sent_ns = at_ns;
        if self.sensor.stamps_on_arrival {
            measurement.stamp_ns = at_ns;
        }
        let is_lost = drops < self.sensor.dropout_probability;
        let delivery = Delivery { at_ns, measurement, clock_error_ns: 0, source: self.place };
        Some(Outgoing { at_ns, truth: None, delivery: (!is_lost).then_some(delivery), is_lost })
    }
}

/// A flight with sensors of several processes, in the order of sending.
#[derive(Debug)]
pub struct SensorFlight {
    simulation: Simulation,
    sources: Vec<Source>,
    next_step: u64,
    /// Stamp of the newest step.
    simulated_ns: Option<u64>,
    /// By the instant of sending; the truth of a step before what is sent then.
    on_the_way: VecDeque<Outgoing>,
}

impl SensorFlight {
    fn put(&mut self, outgoing: Outgoing) {
        let place = self.on_the_way.partition_point(|other| other.at_ns <= outgoing.at_ns);
        self.on_the_way.insert(place, outgoing);
    }
}

impl Iterator for SensorFlight {
    type Item = Outgoing;

    fn next(&mut self) -> Option<Outgoing> {
        // What a later step sends comes after that step.
        while self
            .on_the_way
            .front()
            .map(|first| first.at_ns)
            .is_none_or(|at_ns| Some(at_ns) > self.simulated_ns)
        {
            let Some(at) = self.simulation.next() else { break };
            let at_ns = at.truth.stamp_ns;
            self.simulated_ns = Some(at_ns);
            self.put(Outgoing { at_ns, truth: Some(at.truth), delivery: None, is_lost: false });
            for k in 0..self.sources.len() {
                if let Some(outgoing) = self.sources[k].send(self.next_step, &at) {
                    self.put(outgoing);
                }
            }
            self.next_step += 1;
        }
        self.on_the_way.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::payload::{absent, frame, valid};

    fn flown(text: &str, duration_s: f64) -> Vec<Outgoing> {
        SensorSet::parse("test", text).unwrap().fly(Some(duration_s), 3).unwrap().collect()
    }

    fn of(flown: &[Outgoing], source: usize) -> Vec<Delivery> {
        let deliveries = flown.iter().filter_map(|outgoing| outgoing.delivery);
        deliveries.filter(|delivery| delivery.source == source).collect()
    }

    #[test]
    fn each_sensor_of_the_survey_sends_at_its_rate_after_its_delay() {
        let flown = flown(SENSOR_SETS[0].1, 20.0);
        assert!(flown.is_sorted_by_key(|outgoing| outgoing.at_ns));
        assert_eq!(flown.iter().filter(|outgoing| outgoing.truth.is_some()).count(), 2000);
        for (source, n, delay_ns, carried) in [
            (0, 2000, 0, valid::ANGULAR_VELOCITY | valid::ATTITUDE | valid::FORCE | valid::TORQUE),
            (1, 100, 150_000_000, valid::VELOCITY),
            (2, 200, 0, valid::POSITION),
            (3, 4, 1_000_000_000, valid::POSITION),
        ] {
            let sent = of(&flown, source);
            assert_eq!(sent.len(), n, "source {source}");
            for (k, Delivery { at_ns, measurement, .. }) in sent.iter().enumerate() {
                assert_eq!((measurement.sequence, measurement.valid), (k as u64, carried));
                assert_eq!(at_ns - measurement.stamp_ns, delay_ns);
            }
        }
        let depth = of(&flown, 2)[5].measurement;
        assert_eq!(depth.absent, absent::POSITION_X | absent::POSITION_Y);
        assert_eq!(depth.position_std_m, [0.02; 3]);
        assert_eq!(of(&flown, 1)[0].measurement.velocity_frame, frame::BODY);
    }

    #[test]
    fn another_delay_or_a_silence_changes_no_reading() {
        let text = SENSOR_SETS[1].1;
        let plain = of(&flown(text, 10.0), 1);
        let other = text.replace(
            "delay_s = 0.12",
            "delay_s = 0.02\ndelay_jitter_s = 0.5\nsilences = [\"2:1\"]\nzeros = [\"5:1\"]\ndropout_probability = 0.2",
        );
        let other = of(&flown(&other, 10.0), 1);
        assert!(other.len() < plain.len() - 5);
        assert!(other.is_sorted_by_key(|delivery| delivery.at_ns));
        for Delivery { measurement, .. } in &other {
            let same = plain.iter().find(|plain| plain.measurement.stamp_ns == measurement.stamp_ns).unwrap();
            let t_s = measurement.stamp_ns as f64 * 1e-9;
            assert!(!(2.0..3.0).contains(&t_s));
            let wanted = match (5.0..6.0).contains(&t_s) {
                true => [0.0; 3],
                false => same.measurement.velocity_m_s,
            };
            assert_eq!(measurement.velocity_m_s, wanted);
        }
    }

    #[test]
    fn a_set_that_cannot_be_flown_says_why() {
        let set = |key: &str| {
            let text = format!(
                "scenario = \"auv\"\nrate_hz = 100\n[[sensor]]\nname = \"dvl\"\nmeasures = [\"velocity\"]\n{key}"
            );
            let set = SensorSet::parse("my.toml", &text);
            set.and_then(|set| set.fly(Some(1.0), 1)).map(|_| ()).unwrap_err().to_string()
        };
        for (key, needed) in [
            ("rate_hz = 30", "sensor 'dvl': rate_hz: found 30; needed: a rate of which 100 Hz"),
            ("rate_hz = 5\ndelay_s = -1", "delay_s: found -1; needed: a finite number, 0 or more"),
            ("rate_hz = 5\nsilences = [\"x\"]", "needed: START:LENGTH in s"),
            ("rate_hz = 5\nmounting_wxyz = [1, 1, 0, 0]", "needed: a unit quaternion"),
            ("rate_hz = 5\nspeed = 3", "unknown field `speed`"),
        ] {
            assert!(set(key).contains(needed), "{key}: {}", set(key));
        }
        let missing = SensorSet::read("no-such-set").unwrap_err().to_string();
        assert!(missing.contains("built in: auv-survey, multicopter-gnss"), "{missing}");
    }
}
