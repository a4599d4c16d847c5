//! A vehicle, its pilot, its sensor, and the channel that listens.

use crate::random::Random;
use crate::vehicle::{Pilot, Vehicle};
use nalgebra::{Matrix3, Vector3};
use observer::{
    Centers, ExcitationDesign, JointChannel, JointChannelDesign, JointDesign, JointEstimate, JointSample,
    JointTranslationDesign, Kernel, LengthScale, PriorDeviations, Teaches,
};

/// What reaches the channel in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reaches {
    All,
    /// The velocity is out.
    Command,
    /// The link is out.
    Nothing,
}

/// Which velocity the pilot flies with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FliesOn {
    Truth,
    Estimate,
}

/// A kind of vehicle, with the noises that its observer is told of.
#[derive(Debug, Clone)]
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    pub(crate) mass_kg: f64,
    pub(crate) gravity_m_s2: f64,
    pub(crate) drag: f64,
    pub(crate) wind_m_s: f64,
    pub(crate) load_n: f64,
    pub(crate) actuators_s: f64,
    pub(crate) gust: (f64, f64),
    pub(crate) white_noise: f64,
    pub(crate) half_widths_m_s: [f64; 3],
    /// True deviation of the velocity sensor (m/s).
    pub(crate) noise_m_s: f64,
    /// Of the commands.
    pub(crate) period_ns: u64,
    /// A velocity with each of so many commands.
    pub(crate) commands_per_velocity: u64,
    pub(crate) gains: (f64, f64, f64),
    pub(crate) max_m_s2: f64,
    pub(crate) cruise_m_s: f64,
    /// Amplitudes (m/s) and rates (rad/s) of the motion.
    pub(crate) motion: ([f64; 3], [f64; 3]),
}

/// 2 kg, velocity and commands at 200 Hz.
pub(crate) fn multicopter() -> Kind {
    Kind {
        name: "multicopter",
        mass_kg: 2.0,
        gravity_m_s2: 9.81,
        drag: 0.25,
        wind_m_s: 1.6,
        load_n: 1.0,
        actuators_s: 0.0,
        gust: (0.1, 0.2),
        white_noise: 1.5e-3,
        half_widths_m_s: [4.0, 4.0, 2.0],
        noise_m_s: 0.06,
        period_ns: 5_000_000,
        commands_per_velocity: 1,
        gains: (2.0, 3.0, 0.5),
        max_m_s2: 6.0,
        cruise_m_s: 3.0,
        motion: ([2.5, 2.0, 0.8], [1.2, 0.9, 1.5]),
    }
}

/// 45 kg, neutrally buoyant, velocity at 10 Hz and commands at 100 Hz.
pub(crate) fn underwater_vehicle() -> Kind {
    Kind {
        name: "underwater vehicle",
        mass_kg: 45.0,
        gravity_m_s2: 0.0,
        drag: 30.0,
        wind_m_s: 0.3,
        load_n: 5.0,
        actuators_s: 0.0,
        gust: (0.02, 0.5),
        white_noise: 2e-5,
        half_widths_m_s: [1.5, 1.0, 1.0],
        noise_m_s: 0.015,
        period_ns: 10_000_000,
        commands_per_velocity: 10,
        gains: (0.3, 1.0, 0.02),
        max_m_s2: 2.0,
        cruise_m_s: 1.2,
        motion: ([0.9, 0.7, 0.5], [0.9, 0.7, 1.1]),
    }
}

impl Kind {
    /// Neither gusts nor white noise: what is unknown is a function of the motion.
    pub(crate) fn in_calm_air(self) -> Self {
        Self { gust: (0.0, self.gust.1), white_noise: 0.0, ..self }
    }

    pub(crate) fn air(&self) -> &'static str {
        if self.gust.0 > 0.0 { "gusts" } else { "calm air" }
    }

    /// The defaults of the translation, with this vehicle's noise, mass and box.
    pub(crate) fn design(&self) -> JointChannelDesign {
        let half = self.half_widths_m_s;
        JointChannelDesign {
            filter: JointDesign {
                kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
                length_scale: LengthScale::PerAxis(half.to_vec()),
                centers: Centers::lattice(half.map(|half| -half), half, [3; 3]).unwrap(),
                prior: PriorDeviations {
                    bias: 0.5,
                    linear: 0.3,
                    kernel: 0.35,
                    input: 0.15,
                    lag: 0.3,
                    disturbance: 0.1,
                },
                disturbance_time_s: 0.2,
                process_noise: 1.5e-3,
                motion_memory_s: 300.0,
                input_memory_s: 3600.0,
                lags_s: [0.05, 0.2],
                noise: [self.noise_m_s; 3],
                position_noise: None,
                body_axes: None,
                accelerometer: None,
                noise_samples: 500.0,
                excitation: ExcitationDesign {
                    correction_share: 0.3,
                    mean_time_s: 5.0,
                    variation_time_s: 0.2,
                    idle_rate: 0.05,
                },
            },
            inertia: Matrix3::identity() * self.mass_kg,
            hold_s: 1.5e-9 * (self.period_ns * self.commands_per_velocity) as f64,
        }
    }

    pub(crate) fn channel(&self, design: &JointChannelDesign) -> JointChannel<()> {
        let known_force_n = Vector3::new(0.0, 0.0, -self.mass_kg * self.gravity_m_s2);
        let design =
            JointTranslationDesign { channel: design.clone(), known_force_n, gravity_m_s2: Vector3::zeros() };
        JointChannel::translation(&design, None, None).unwrap()
    }

    pub(crate) fn h_s(&self) -> f64 {
        self.period_ns as f64 / 1e9
    }
}

/// What is wanted of a vehicle: smooth and never the same, of bounded speed.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    start_m_s: Vector3<f64>,
    amplitudes_m_s: Vector3<f64>,
    rates_rad_s: Vector3<f64>,
}

impl Motion {
    /// Begins with this velocity.
    pub(crate) fn new(kind: &Kind, start_m_s: Vector3<f64>, random: &mut Random) -> Self {
        let (amplitudes, rates) = kind.motion;
        let mut varied = |value: f64| value * (0.8 + 0.4 * random.uniform());
        let amplitudes = amplitudes.map(&mut varied);
        let rates = rates.map(&mut varied);
        let mut sign = |value: f64| if random.uniform() < 0.5 { -value } else { value };
        Self {
            start_m_s,
            amplitudes_m_s: Vector3::from(amplitudes.map(&mut sign)),
            rates_rad_s: Vector3::from(rates),
        }
    }

    pub(crate) fn at(&self, t_s: f64) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| {
            let (sine, cosine) = (self.rates_rad_s[axis] * t_s).sin_cos();
            self.start_m_s[axis] * cosine + self.amplitudes_m_s[axis] * sine
        })
    }
}

/// Errors of one step, all at its end but the force.
pub(crate) struct Step {
    pub(crate) estimate: JointEstimate<()>,
    /// Mean of the unknown force over the step, less its estimate (N).
    pub(crate) force_error_n: Vector3<f64>,
    /// v − v̂, before the sample at that instant (m/s).
    pub(crate) velocity_error_m_s: Vector3<f64>,
    /// Mean of e²/S of the sample at the step's start.
    pub(crate) nis: Option<f64>,
}

#[derive(Debug, Clone)]
pub(crate) struct Flight {
    pub(crate) kind: Kind,
    pub(crate) vehicle: Vehicle,
    pub(crate) pilot: Pilot,
    pub(crate) flies_on: FliesOn,
    /// The command reaches the channel in a sample of its own, this much after the velocity; `None`: in the same one.
    pub(crate) command_delay_ns: Option<u64>,
    pub(crate) channel: JointChannel<()>,
    sensor: Random,
    /// v̂ at the end of the step before.
    estimated_m_s: Option<Vector3<f64>>,
    /// Steps so far.
    pub(crate) n: u64,
}

impl Flight {
    pub(crate) fn new(kind: &Kind, design: &JointChannelDesign, flies_on: FliesOn, seed: u64) -> Self {
        let mut random = Random::new(seed, 1);
        let mut away = |size: f64, vertical: f64| {
            let angle = std::f64::consts::TAU * random.uniform();
            size * Vector3::new(angle.cos(), angle.sin(), vertical * (2.0 * random.uniform() - 1.0))
        };
        let vehicle = Vehicle {
            mass_kg: kind.mass_kg,
            gravity_m_s2: Vector3::new(0.0, 0.0, -kind.gravity_m_s2),
            drag: kind.drag,
            wind_m_s: away(kind.wind_m_s, 0.2),
            load_n: away(kind.load_n, 1.0),
            actuators_s: kind.actuators_s,
            actual_n: Vector3::new(0.0, 0.0, kind.mass_kg * kind.gravity_m_s2),
            gust: kind.gust,
            white_noise: kind.white_noise,
            position_m: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            gust_m_s2: Vector3::zeros(),
            random: Random::new(seed, 2),
        };
        let pilot = Pilot {
            gains: kind.gains,
            reference_s: 0.3,
            max_m_s2: kind.max_m_s2,
            reference_m: Vector3::zeros(),
            reference_m_s: Vector3::zeros(),
            integral_m_s: Vector3::zeros(),
        };
        Self {
            kind: kind.clone(),
            vehicle,
            pilot,
            flies_on,
            command_delay_ns: None,
            channel: kind.channel(design),
            sensor: Random::new(seed, 3),
            estimated_m_s: None,
            n: 0,
        }
    }

    pub(crate) fn stamp_ns(&self) -> u64 {
        1_000_000_000 + self.n * self.kind.period_ns
    }

    /// One period of the commands.
    pub(crate) fn step(&mut self, wanted_m_s: &Vector3<f64>, reaches: Reaches) -> Step {
        let (h_s, stamp_ns) = (self.kind.h_s(), self.stamp_ns());
        let velocity = match self.flies_on {
            // While the link is out the pilot has the vehicle's own sensors.
            _ if reaches == Reaches::Nothing => self.vehicle.velocity_m_s,
            FliesOn::Truth => self.vehicle.velocity_m_s,
            FliesOn::Estimate => self.estimated_m_s.unwrap_or(self.vehicle.velocity_m_s),
        };
        let command_n = self.pilot.command_n(&self.vehicle, &velocity, wanted_m_s, h_s);
        let mut nis = None;
        let is_velocity = self.n.is_multiple_of(self.kind.commands_per_velocity);
        // The sensor's numbers do not depend on what is lost.
        let noise = if is_velocity { self.sensor.normals() } else { Vector3::zeros() };
        if reaches != Reaches::Nothing {
            let measured = self.vehicle.velocity_m_s + self.kind.noise_m_s * noise;
            let is_measured = is_velocity && reaches == Reaches::All;
            let output = std::array::from_fn(|axis| is_measured.then_some(measured[axis]));
            let mut sample = JointSample { output, command: Some(command_n), ..JointSample::default() };
            if let Some(delay_ns) = self.command_delay_ns {
                let velocity = JointSample { command: None, ..sample };
                nis = self.accept(stamp_ns, &velocity);
                sample.output = [None; 3];
                self.accept(stamp_ns + delay_ns, &sample);
            } else {
                nis = self.accept(stamp_ns, &sample);
            }
        }
        let force_n = self.vehicle.advance(&command_n, h_s);
        self.n += 1;
        let estimate = self.channel.estimate(self.stamp_ns());
        let estimated = Vector3::from(estimate.prediction.velocity);
        self.estimated_m_s = Some(estimated);
        Step {
            force_error_n: force_n - estimate.matched_force,
            velocity_error_m_s: self.vehicle.velocity_m_s - estimated,
            estimate,
            nis,
        }
    }

    fn accept(&mut self, stamp_ns: u64, sample: &JointSample) -> Option<f64> {
        self.channel
            .accept(stamp_ns, sample, Teaches::All, None::<fn(&mut ())>)
            .map(|agreement| agreement.nis)
    }

    /// Largest ‖θ‖² of the three axes.
    pub(crate) fn largest_weights_square(&self) -> f64 {
        (0..3).map(|axis| self.channel.state().weights_square(axis)).fold(0.0, f64::max)
    }
}

/// Root of the mean square of vectors.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RootMeanSquare {
    sum: f64,
    n: f64,
}

impl RootMeanSquare {
    pub(crate) fn add(&mut self, error: &Vector3<f64>) {
        self.sum += error.norm_squared();
        self.n += 1.0;
    }

    pub(crate) fn join(&mut self, other: &Self) {
        self.sum += other.sum;
        self.n += other.n;
    }

    pub(crate) fn value(&self) -> f64 {
        (self.sum / self.n).sqrt()
    }
}

pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    0.5 * (sorted[(n - 1) / 2] + sorted[n / 2])
}

pub(crate) fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}
