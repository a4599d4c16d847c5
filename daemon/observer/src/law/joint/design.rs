//! What a joint filter is made of.

use crate::error::{DesignError, Parameter};
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use crate::space::scaled_kernel::LengthScale;

/// Deviations of the prior, which are also the scales of the features (m/s²; rad/s²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorDeviations {
    /// σ_b, of a constant acceleration.
    pub bias: f64,
    /// σ_v, of an acceleration linear in the velocity, at the velocity V.
    pub linear: f64,
    /// σ_f, of the rest as a function of the velocity.
    pub kernel: f64,
    /// σ_u, of an error of the command, per unit of it (1).
    pub input: f64,
    /// σ_l, of the commands' lags, per unit (1).
    pub lag: f64,
    /// σ_d, of the fast disturbance.
    pub disturbance: f64,
}

/// Everything that a joint filter is made of. Translation: m, s; rotation: rad, s.
#[derive(Debug, Clone, PartialEq)]
pub struct JointDesign {
    /// κ; used with κ(0) = 1.
    pub kernel: Kernel,
    /// ℓ.
    pub length_scale: LengthScale,
    /// Ξ_N, on the box of the velocities.
    pub centers: Centers,
    /// Deviations of the prior.
    pub prior: PriorDeviations,
    /// τ_d of the fast disturbance (s).
    pub disturbance_time_s: f64,
    /// q of the acceleration's white noise ((m/s²)² s).
    pub process_noise: f64,
    /// T_k of the bias, the linear and the kernel's weights (s).
    pub motion_memory_s: f64,
    /// T_k of the weights of the command and its lags (s).
    pub input_memory_s: f64,
    /// τ_i of the actuators' lags (s).
    pub lags_s: [f64; 2],
    /// r, one deviation for each axis where the sample has none (m/s).
    pub noise: [f64; 3],
    /// Deviation of a position's component where the sample has none (m); `None` where there is no position.
    pub position_noise: Option<f64>,
    /// Features along the body's axes: they need the attitude. `None`: along inertial axes.
    pub body_axes: Option<BodyAxesDesign>,
    /// `None`: specific forces are not used.
    pub accelerometer: Option<AccelerometerDesign>,
    /// N_a, samples after which the noise levels follow; 0: the configured noises stand.
    pub noise_samples: f64,
    /// What may teach under low excitation.
    pub excitation: ExcitationDesign,
}

/// What is learned along the body's axes only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyAxesDesign {
    /// σ_c, of the acceleration ω × v, per unit (1): of an added mass that differs along the axes, over the mass.
    pub turn: f64,
}

/// An accelerometer whose specific forces are measurements of the unknown acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerometerDesign {
    /// Deviation of its white noise, each axis, where the sample has none (m/s²).
    pub noise: f64,
    /// Deviation of its slow error, each inertial axis: bias, misalignment, what vibration makes of it (m/s²).
    pub bias: f64,
    /// How long that error stays alike (s).
    pub bias_time_s: f64,
}

/// Constants of what may teach (joint.md §3a).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExcitationDesign {
    /// c, how much of the level of the corrections counts; 0: everything teaches.
    pub correction_share: f64,
    /// T_m of the recent mean of the features (s).
    pub mean_time_s: f64,
    /// T_E of the features' variation (s).
    pub variation_time_s: f64,
    /// ε, how fast the mean follows while nothing teaches, as a part of its own rate.
    pub idle_rate: f64,
}

impl JointDesign {
    pub(crate) fn check(&self) -> Result<(), DesignError> {
        let (prior, excitation) = (&self.prior, &self.excitation);
        let positive = [
            ("noise", self.noise[0]),
            ("noise", self.noise[1]),
            ("noise", self.noise[2]),
            ("position_noise", self.position_noise.unwrap_or(1.0)),
            ("accelerometer_noise", self.accelerometer.map_or(1.0, |accelerometer| accelerometer.noise)),
            (
                "accelerometer_bias_time_s",
                self.accelerometer.map_or(1.0, |accelerometer| accelerometer.bias_time_s),
            ),
            ("motion_memory_s", self.motion_memory_s),
            ("input_memory_s", self.input_memory_s),
            ("disturbance_time_s", self.disturbance_time_s),
            ("lags_s", self.lags_s[0]),
            ("lags_s", self.lags_s[1]),
            ("mean_time_s", excitation.mean_time_s),
            ("variation_time_s", excitation.variation_time_s),
        ];
        for (name, value) in positive {
            // A square or a reciprocal that is not finite, or zero, is no number to compute with.
            if !((1e-100..=1e100).contains(&value)) {
                let needed = "a number > 0, from 1e-100 to 1e100";
                return Err(DesignError::new(Parameter::Joint(name), value.to_string(), needed));
            }
        }
        let sizes = [
            ("bias", prior.bias),
            ("linear", prior.linear),
            ("kernel", prior.kernel),
            ("input", prior.input),
            ("lag", prior.lag),
            ("disturbance", prior.disturbance),
            ("process_noise", self.process_noise),
            ("turn", self.body_axes.map_or(0.0, |body_axes| body_axes.turn)),
            ("accelerometer_bias", self.accelerometer.map_or(0.0, |accelerometer| accelerometer.bias)),
            ("noise_samples", self.noise_samples),
            ("correction_share", excitation.correction_share),
            ("idle_rate", excitation.idle_rate),
        ];
        for (name, value) in sizes {
            if !((0.0..=1e100).contains(&value)) {
                let needed = "a number ≥ 0, at most 1e100";
                return Err(DesignError::new(Parameter::Joint(name), value.to_string(), needed));
            }
        }
        if self.centers.dimension() != 3 {
            let found = format!("centers with {} coordinates", self.centers.dimension());
            return Err(DesignError::new(Parameter::Centers, found, "three, one per output"));
        }
        Ok(())
    }
}
