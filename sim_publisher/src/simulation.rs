//! Simulates a vehicle with sensors and faults, as an iterator over samples. No clock, no file: the same options give the
//! same bits.
//!
//! Sample j is taken at `t_j`; the command computed from the true state at `t_j`, and the disturbance, are held
//! until `t_{j+1}`. The truth beside a sample is the true state at `t_j`, with f and ξ of the same instant.

use crate::disturbance::GaussMarkov;
use crate::plant::{State, Wrench, integrate};
use crate::scenario::{Definition, Scenario};
use crate::sensors::{Chance, Losses, Outage, SampleTimes, Schedule, Sensors, VectorSensor, stamp_ns, wxyz};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use shared_types::{Measurement, Truth};

/// The default rate of samples (Hz).
pub const DEFAULT_RATE_HZ: f64 = 200.0;

/// Highest rate of samples (Hz).
pub const HIGHEST_RATE_HZ: f64 = 10_000.0;

/// What to simulate. `None` leaves the scenario's own value.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationOptions {
    /// Which vehicle.
    pub scenario: Scenario,
    /// Rate of samples (Hz), from the scenario's lowest to [`HIGHEST_RATE_HZ`].
    pub rate_hz: f64,
    /// Length of the run (s): samples at `0 ≤ j/rate < duration`; `None` never ends.
    pub duration_s: Option<f64>,
    /// Seed of all random streams.
    pub seed: u64,
    /// White noise of the velocity, standard deviation of each axis (m/s).
    pub velocity_noise_m_s: Option<f64>,
    /// White noise of the angular velocity, standard deviation of each axis (rad/s).
    pub angular_velocity_noise_rad_s: Option<f64>,
    /// Constant error of the velocity, along the sensor's axes (m/s).
    pub velocity_bias_m_s: Option<[f64; 3]>,
    /// Rate of noisy position fixes (Hz).
    pub position_fix_hz: Option<f64>,
    /// Whether gusts, or the variation of the current, act; `None` and `true` differ in nothing.
    pub disturbed: Option<bool>,
    /// Sample instants deviate from `j/rate` by up to this (µs).
    pub jitter_us: f64,
    /// Probability that a sample is lost, 0 … 1.
    pub dropout_probability: f64,
    /// Times in which all samples are lost.
    pub outages: Vec<Outage>,
}

impl SimulationOptions {
    /// The scenario as it is, at 200 Hz, without faults, without end, seed 1.
    pub fn of(scenario: Scenario) -> Self {
        Self {
            scenario,
            rate_hz: DEFAULT_RATE_HZ,
            duration_s: None,
            seed: 1,
            velocity_noise_m_s: None,
            angular_velocity_noise_rad_s: None,
            velocity_bias_m_s: None,
            position_fix_hz: None,
            disturbed: None,
            jitter_us: 0.0,
            dropout_probability: 0.0,
            outages: Vec::new(),
        }
    }
}

/// Why a simulation cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// A number is outside of its range.
    #[error("{option} {found}: needed: {needed}")]
    OutOfRange {
        /// Which option.
        option: &'static str,
        /// Its value.
        found: f64,
        /// What would be accepted.
        needed: String,
    },
    /// The scenario's samples do not carry the quantity.
    #[error(
        "{option}: scenario '{scenario}' does not measure {quantity}; leave the option out, or choose another --scenario"
    )]
    NotMeasured {
        /// Which option.
        option: &'static str,
        /// Which scenario.
        scenario: &'static str,
        /// What it does not measure.
        quantity: &'static str,
    },
}

fn check(
    option: &'static str,
    found: f64,
    accepted: impl Fn(f64) -> bool,
    needed: impl Into<String>,
) -> Result<(), SimulationError> {
    if accepted(found) {
        return Ok(());
    }
    Err(SimulationError::OutOfRange { option, found, needed: needed.into() })
}

fn is_size(value: f64) -> bool {
    value.is_finite() && value >= 0.0
}

fn is_positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}

/// One sample and the truth at the same instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedSample {
    /// The measurement; `None` if the sample is lost. Its sequence number is used up in any case.
    pub measurement: Option<Measurement>,
    /// The true state; stamps count from the start of the run.
    pub truth: Truth,
    /// What is commanded from then on, the force along inertial axes.
    pub command: Wrench,
    /// What an ideal accelerometer at the center of mass reads, body axes (m/s²); gravity is 9.81 m/s² along z.
    pub specific_force_m_s2: Vector3<f64>,
}

/// Gravity of a vehicle outside of the paper: inertial axes, z down (m/s²).
const GRAVITY_M_S2: Vector3<f64> = Vector3::new(0.0, 0.0, 9.81);

/// A run of a scenario.
#[derive(Debug)]
pub struct Simulation {
    definition: Definition,
    disturbance: Option<GaussMarkov>,
    disturbance_chance: ChaCha8Rng,
    disturbance_value: Vector3<f64>,
    sensors: Sensors,
    losses: Losses,
    times: SampleTimes,
    remaining: Option<u64>,
    sequence: u64,
    t_s: f64,
    state: State,
}

impl Simulation {
    /// A run with these options, at its start.
    ///
    /// # Errors
    /// `OutOfRange` for a number that no run can have, `NotMeasured` for an option about a quantity that the
    /// scenario does not measure.
    pub fn new(options: &SimulationOptions) -> Result<Self, SimulationError> {
        let mut definition = options.scenario.definition();
        override_sensors(&mut definition, options)?;
        check_run(&definition, options)?;

        let seed = options.seed;
        let disturbance = definition.disturbance.filter(|_| options.disturbed != Some(false));
        let mut disturbance_chance = Chance::Disturbance.stream(seed);
        let mut times = SampleTimes::new(options.rate_hz, options.jitter_us * 1e-6, seed);
        Ok(Self {
            disturbance,
            disturbance_value: disturbance
                .map_or(Vector3::zeros(), |process| process.stationary(&mut disturbance_chance)),
            disturbance_chance,
            sensors: Sensors::new(definition.sensors, options.rate_hz, seed),
            losses: Losses::new(options.dropout_probability, options.outages.clone(), seed),
            t_s: times.next(),
            times,
            // Samples at j/rate < duration; the margin keeps 60 s of 200 Hz at 12 000.
            remaining: options.duration_s.map(|d| (d * options.rate_hz - 1e-9).ceil() as u64),
            sequence: 0,
            state: definition.vehicle.initial_state(),
            definition,
        })
    }

    /// The true state at the next sample.
    pub fn state(&self) -> &State {
        &self.state
    }
}

fn override_sensors(definition: &mut Definition, options: &SimulationOptions) -> Result<(), SimulationError> {
    let present = |sensor: &VectorSensor, option, quantity| {
        let scenario = options.scenario.name();
        if sensor.exists() {
            return Ok(());
        }
        Err(SimulationError::NotMeasured { option, scenario, quantity })
    };
    let sensors = &mut definition.sensors;
    if let Some(noise) = options.velocity_noise_m_s {
        present(&sensors.velocity, "--velocity-noise-m-s", "velocity")?;
        check("--velocity-noise-m-s", noise, is_size, "a standard deviation in m/s, 0 or more")?;
        sensors.velocity.noise = noise;
    }
    if let Some(noise) = options.angular_velocity_noise_rad_s {
        let option = "--angular-velocity-noise-rad-s";
        present(&sensors.angular_velocity, option, "angular velocity")?;
        check(option, noise, is_size, "a standard deviation in rad/s, 0 or more")?;
        sensors.angular_velocity.noise = noise;
    }
    if let Some(bias) = options.velocity_bias_m_s {
        present(&sensors.velocity, "--velocity-bias-m-s", "velocity")?;
        for axis in bias {
            check("--velocity-bias-m-s", axis, f64::is_finite, "a finite number of m/s for each axis")?;
        }
        sensors.velocity.bias = bias.into();
    }
    if let Some(fixes_hz) = options.position_fix_hz {
        present(&sensors.position, "--position-fix-hz", "position")?;
        check("--position-fix-hz", fixes_hz, is_positive, "a rate in Hz above 0")?;
        sensors.position.schedule = Schedule::AtHz(fixes_hz);
    }
    Ok(())
}

fn check_run(definition: &Definition, options: &SimulationOptions) -> Result<(), SimulationError> {
    let lowest_hz = definition.lowest_rate_hz;
    check(
        "--rate-hz",
        options.rate_hz,
        |rate_hz| (lowest_hz..=HIGHEST_RATE_HZ).contains(&rate_hz),
        format!(
            "{lowest_hz} to {HIGHEST_RATE_HZ} Hz for scenario '{}', whose controller runs at the samples' rate",
            options.scenario.name()
        ),
    )?;
    if let Some(duration_s) = options.duration_s {
        check("--duration", duration_s, |d| is_positive(d) && d <= 1e8, "0 to 1e8 s, without 0")?;
    }
    check("--jitter-us", options.jitter_us, |j| is_size(j) && j <= 1e6, "0 to 1e6 µs")?;
    check(
        "--dropout-probability",
        options.dropout_probability,
        |p| (0.0..=1.0).contains(&p),
        "a probability, 0 to 1",
    )?;
    for outage in &options.outages {
        check("--outage start", outage.start_s, is_size, "seconds after the start of the run, 0 or more")?;
        check("--outage length", outage.length_s, is_positive, "a length in s above 0")?;
    }
    Ok(())
}

impl Iterator for Simulation {
    type Item = SimulatedSample;

    fn next(&mut self) -> Option<SimulatedSample> {
        if let Some(remaining) = &mut self.remaining {
            *remaining = remaining.checked_sub(1)?;
        }
        let Definition { vehicle, nominal, .. } = &self.definition;
        let (t_s, sequence, state) = (self.t_s, self.sequence, self.state);

        let command = vehicle.command(t_s, &state);
        let unknown = nominal.unknown(*vehicle, &state, &command, &self.disturbance_value);
        let truth = Truth {
            sequence,
            stamp_ns: stamp_ns(t_s),
            position_m: state.position_m.into(),
            velocity_m_s: state.velocity_m_s.into(),
            attitude_wxyz: wxyz(&state.rotation()),
            angular_velocity_rad_s: state.angular_velocity_rad_s.into(),
            matched_force_n: unknown.matched.force_n.into(),
            matched_torque_n_m: unknown.matched.torque_n_m.into(),
            unmatched_force_n: unknown.unmatched.force_n.into(),
            unmatched_torque_n_m: unknown.unmatched.torque_n_m.into(),
        };
        let acceleration = vehicle.acceleration(&state, &command, &self.disturbance_value);
        let specific_force_m_s2 = state.rotation().inverse() * (acceleration.linear_m_s2 - GRAVITY_M_S2);
        let noise = self.sensors.draw();
        let is_lost = self.losses.loses(t_s);
        let measurement = (!is_lost).then(|| self.sensors.measure(sequence, t_s, &noise, &state, &command));

        self.t_s = self.times.next();
        self.sequence += 1;
        let step_s = self.t_s - t_s;
        self.state = integrate(*vehicle, &state, &command, &self.disturbance_value, step_s);
        if let Some(process) = self.disturbance {
            self.disturbance_value =
                process.next(&self.disturbance_value, step_s, &mut self.disturbance_chance);
        }
        Some(SimulatedSample { measurement, truth, command, specific_force_m_s2 })
    }
}

/// The largest of a number over a run of this length, made of the time (s) and the true state.
#[cfg(test)]
pub(crate) fn largest(scenario: Scenario, duration_s: f64, of: impl Fn(f64, &Truth) -> f64) -> f64 {
    let options = SimulationOptions { duration_s: Some(duration_s), ..SimulationOptions::of(scenario) };
    let truths = Simulation::new(&options).unwrap().map(|sample| sample.truth);
    let largest = truths.map(|truth| of(truth.stamp_ns as f64 * 1e-9, &truth)).fold(0.0, f64::max);
    println!("{}: at most {largest:?}", scenario.name());
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::translation;
    use shared_types::payload::{frame, valid};

    fn options(scenario: Scenario, duration_s: f64) -> SimulationOptions {
        SimulationOptions { duration_s: Some(duration_s), ..SimulationOptions::of(scenario) }
    }

    fn run(options: &SimulationOptions) -> Vec<SimulatedSample> {
        Simulation::new(options).unwrap().collect()
    }

    /// Debug texts of finite numbers differ where their bits do.
    fn bits(samples: &[SimulatedSample]) -> String {
        format!("{samples:?}")
    }

    #[test]
    fn the_same_options_give_the_same_bits_and_another_seed_others() {
        for scenario in [Scenario::RigidBody, Scenario::Auv] {
            let faulty = SimulationOptions {
                jitter_us: 800.0,
                dropout_probability: 0.05,
                outages: vec![Outage { start_s: 1.0, length_s: 0.3 }],
                position_fix_hz: Some(5.0),
                ..options(scenario, 3.0)
            };
            assert_eq!(bits(&run(&faulty)), bits(&run(&faulty)));
            let other = SimulationOptions { seed: 2, ..faulty.clone() };
            assert_ne!(bits(&run(&faulty)), bits(&run(&other)));
        }
    }

    #[test]
    fn lost_samples_leave_gaps_and_change_nothing_else() {
        let plain = options(Scenario::RigidBody, 5.0);
        let outage = Outage { start_s: 2.0, length_s: 0.5 };
        let lossy = SimulationOptions { dropout_probability: 0.2, outages: vec![outage], ..plain.clone() };
        let (plain, lossy) = (run(&plain), run(&lossy));
        assert_eq!((plain.len(), lossy.len()), (1000, 1000));
        let mut lost = 0;
        for (sequence, (plain, lossy)) in plain.iter().zip(&lossy).enumerate() {
            assert_eq!(lossy.truth, plain.truth);
            assert_eq!(lossy.truth.sequence, sequence as u64);
            match lossy.measurement {
                Some(measurement) => assert_eq!(Some(measurement), plain.measurement),
                None => lost += 1,
            }
            let in_outage = (400..500).contains(&sequence);
            assert!(!(in_outage && lossy.measurement.is_some()), "sample {sequence}");
        }
        // All 100 of the outage, and 900 chances of 0.2: mean 180, standard deviation 12.
        assert!((232..=328).contains(&lost), "{lost} samples were lost");
    }

    #[test]
    fn the_first_published_sample_carries_the_start_even_where_the_first_is_lost() {
        let late = SimulationOptions {
            outages: vec![Outage { start_s: 0.0, length_s: 0.1 }],
            ..options(Scenario::RigidBody, 1.0)
        };
        let published: Vec<_> = run(&late).into_iter().filter(|s| s.measurement.is_some()).collect();
        let (first, truth) = (published[0].measurement.unwrap(), published[0].truth);
        assert_eq!(first.sequence, 20);
        assert_eq!(first.position_m, truth.position_m);
        assert!(published[1..].iter().all(|s| !s.measurement.unwrap().has(valid::POSITION)));
    }

    #[test]
    fn stamps_and_counts_are_those_of_the_rate() {
        let samples = run(&options(Scenario::Translation, 60.0));
        assert_eq!(samples.len(), 12_000);
        for (j, sample) in samples.iter().enumerate() {
            assert_eq!(sample.truth.stamp_ns, j as u64 * 5_000_000);
            assert_eq!(sample.measurement.unwrap().stamp_ns, sample.truth.stamp_ns);
        }
        let endless = SimulationOptions::of(Scenario::Translation);
        assert_eq!(Simulation::new(&endless).unwrap().take(20_000).count(), 20_000);
    }

    #[test]
    fn samples_carry_the_fields_of_their_scenario() {
        let fields = |scenario| {
            let samples = run(&options(scenario, 0.5));
            let bits = |j: usize| samples[j].measurement.unwrap().valid;
            (bits(0), bits(1), bits(20), samples[0].measurement.unwrap().velocity_frame)
        };
        use valid::{ANGULAR_VELOCITY, ATTITUDE, FORCE, POSITION, TORQUE, VELOCITY};
        let later = VELOCITY | FORCE;
        assert_eq!(fields(Scenario::Translation), (later | POSITION, later, later, frame::INERTIAL));
        let later = ANGULAR_VELOCITY | TORQUE;
        assert_eq!(fields(Scenario::Rotation), (later | ATTITUDE, later, later, frame::INERTIAL));
        let every = ANGULAR_VELOCITY | ATTITUDE | FORCE | TORQUE;
        let log = every | VELOCITY;
        assert_eq!(fields(Scenario::RigidBody), (valid::RIGID_BODY, log, log, frame::INERTIAL));
        assert_eq!(fields(Scenario::Auv), (valid::RIGID_BODY, every, log, frame::BODY));
    }

    #[test]
    fn the_paper_s_measurement_errors_are_added_exactly() {
        for sample in run(&options(Scenario::Translation, 10.0)) {
            let (m, t_s) = (sample.measurement.unwrap(), sample.truth.stamp_ns as f64 * 1e-9);
            let delta = 0.008 * ((0.5 * t_s).sin() + (0.5 * t_s).cos());
            let v = Vector3::from(sample.truth.velocity_m_s);
            for axis in 0..3 {
                assert!((m.velocity_m_s[axis] - v[axis] - delta).abs() < 1e-15);
            }
            let f = translation::unknown_force_n(&v);
            assert!((Vector3::from(sample.truth.matched_force_n) - f).norm() < 1e-13);
            assert_eq!(sample.truth.unmatched_force_n, [0.0; 3]);
        }
        for sample in run(&options(Scenario::Rotation, 10.0)) {
            let (m, t_s) = (sample.measurement.unwrap(), sample.truth.stamp_ns as f64 * 1e-9);
            for axis in 0..3 {
                let delta = m.angular_velocity_rad_s[axis] - sample.truth.angular_velocity_rad_s[axis];
                assert!((delta - 0.05 * (5.0 * t_s).sin()).abs() < 1e-15);
            }
        }
    }

    /// Independent of `plant`: Euler steps a thousand times finer, of the sampled closed loop written out here.
    #[test]
    fn the_translation_example_follows_its_equations() {
        let samples = run(&options(Scenario::Translation, 2.0));
        let (mut r, mut v) = ([0.0, 1.0, 0.0], [1.0, 0.0, 2.0]);
        for (j, sample) in samples.iter().enumerate() {
            let t = j as f64 / 200.0;
            // Euler's global error: about its step, 5 µs, times the size of the derivatives, of order one.
            for axis in 0..3 {
                assert!((sample.truth.position_m[axis] - r[axis]).abs() < 5e-5, "sample {j}");
                assert!((sample.truth.velocity_m_s[axis] - v[axis]).abs() < 5e-5, "sample {j}");
            }
            let reference = [
                [t.sin(), t.cos(), (2.0 * t).sin()],
                [t.cos(), -t.sin(), 2.0 * (2.0 * t).cos()],
                [-t.sin(), -t.cos(), -4.0 * (2.0 * t).sin()],
            ];
            let u: [f64; 3] = std::array::from_fn(|i| {
                -(r[i] - reference[0][i]) - (v[i] - reference[1][i]) + 4.0 * reference[2][i]
            });
            for _ in 0..1000 {
                let f = [(v[0] * v[0]).cos(), (v[1] * v[1]).sin() + v[0].sin(), v[2].cos() + v[1].sin()];
                for i in 0..3 {
                    r[i] += 5e-6 * v[i];
                    v[i] += 5e-6 * (u[i] + f[i]) / 4.0;
                }
            }
        }
    }

    #[test]
    fn a_finer_rate_of_a_jittered_run_keeps_the_truth_close() {
        // The same motion, sampled at other instants: only the hold of the command differs.
        let calm = SimulationOptions { disturbed: Some(false), ..options(Scenario::RigidBody, 6.0) };
        let jittered = SimulationOptions { jitter_us: 2000.0, ..calm.clone() };
        let (even, uneven) = (run(&calm), run(&jittered));
        let (a, b) = (even.last().unwrap().truth, uneven.last().unwrap().truth);
        let dt_s = (b.stamp_ns as f64 - a.stamp_ns as f64) * 1e-9;
        assert!(dt_s.abs() < 0.002 && dt_s != 0.0);
        for axis in 0..3 {
            let moved = a.position_m[axis] + dt_s * a.velocity_m_s[axis];
            assert!((b.position_m[axis] - moved).abs() < 5e-3);
        }
    }

    #[test]
    fn impossible_options_are_refused_by_name() {
        let base = || SimulationOptions::of(Scenario::RigidBody);
        let cases = [
            (SimulationOptions { rate_hz: 20.0, ..base() }, "--rate-hz 20: needed: 50 to 10000 Hz"),
            (SimulationOptions { rate_hz: f64::NAN, ..base() }, "--rate-hz NaN"),
            (SimulationOptions { duration_s: Some(0.0), ..base() }, "--duration 0"),
            (SimulationOptions { dropout_probability: 1.5, ..base() }, "--dropout-probability 1.5"),
            (SimulationOptions { jitter_us: -1.0, ..base() }, "--jitter-us -1"),
            (SimulationOptions { velocity_noise_m_s: Some(-0.1), ..base() }, "--velocity-noise-m-s -0.1"),
            (SimulationOptions { position_fix_hz: Some(0.0), ..base() }, "--position-fix-hz 0"),
            (
                SimulationOptions { outages: vec![Outage { start_s: 1.0, length_s: 0.0 }], ..base() },
                "--outage length 0",
            ),
            (
                SimulationOptions {
                    velocity_noise_m_s: Some(0.1),
                    ..SimulationOptions::of(Scenario::Rotation)
                },
                "scenario 'rotation' does not measure velocity",
            ),
        ];
        for (options, expected) in cases {
            let message = Simulation::new(&options).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    /// Prints what an engineer needs to place kernel centers: `cargo test -p sim_publisher ranges -- --nocapture`.
    #[test]
    fn every_scenario_stays_in_plausible_ranges_for_a_minute() {
        // Largest speed of an axis, largest angular velocity of an axis, largest matched force and torque of an axis.
        for (scenario, speed, rate, force, torque) in [
            (Scenario::Translation, 2.6, 0.0, 2.0, 0.0),
            (Scenario::Rotation, 0.0, 0.2, 0.0, 1.0),
            (Scenario::RigidBody, 5.0, 3.0, 8.0, 0.2),
            (Scenario::Auv, 2.0, 1.0, 50.0, 25.0),
        ] {
            let lowest_rate_hz = scenario.definition().lowest_rate_hz;
            let slow = run(&SimulationOptions { rate_hz: lowest_rate_hz, ..options(scenario, 60.0) });
            let usual = run(&options(scenario, 60.0));
            let check = |name: &str, limit: f64, quantity: fn(&Truth) -> [f64; 3]| {
                for samples in [&slow, &usual] {
                    let mut largest = [0.0f64; 3];
                    for sample in samples {
                        for (largest, value) in largest.iter_mut().zip(quantity(&sample.truth)) {
                            assert!(value.is_finite());
                            *largest = largest.max(value.abs());
                        }
                    }
                    println!("{} {name}: at most {largest:.3?}", scenario.name());
                    assert!(
                        largest.iter().all(|largest| *largest <= limit),
                        "{name}: {largest:?}, limit {limit}"
                    );
                }
            };
            check("velocity (m/s)", speed, |t| t.velocity_m_s);
            check("angular velocity (rad/s)", rate, |t| t.angular_velocity_rad_s);
            check("matched force (N)", force, |t| t.matched_force_n);
            check("matched torque (N·m)", torque, |t| t.matched_torque_n_m);
            check("unmatched force (N)", 12.0, |t| t.unmatched_force_n);
            check("unmatched torque (N·m)", 5.0, |t| t.unmatched_torque_n_m);
        }
    }
}
