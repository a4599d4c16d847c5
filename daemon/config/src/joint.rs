//! `[translation.joint]` and `[rotation.joint]`: what the joint law assumes of a vehicle, with defaults that fly.
//!
//! Accelerations are forces over mass (m/s²), torques over inertia (rad/s²). docs/method.md has the law.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! joint {
    (
        $(#[$doc:meta])*
        $Joint:ident {
            $bias:ident = $bias_default:literal, $linear:ident = $linear_default:literal,
            $kernel:ident = $kernel_default:literal, input = $input_default:literal, lag = $lag_default:literal,
            $disturbance:ident = $disturbance_default:literal, $process_noise:ident = $process_noise_default:literal,
            lags = $lags_default:expr,
        }
        words { command: $command:tt, motion: $motion:tt }
        last { $($(#[$last_doc:meta])* pub $last:ident = $last_default:literal,)* }
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct $Joint {
            /// Size of a constant unknown acceleration, 1 σ.
            #[schemars(range(min = 0.0))]
            pub $bias: f64,
            #[doc = concat!("Size of an unknown acceleration that is linear in the ", $motion, ", at the edge of the box, 1 σ.")]
            #[schemars(range(min = 0.0))]
            pub $linear: f64,
            #[doc = concat!("Size of what remains as a function of the ", $motion, ", 1 σ.")]
            #[schemars(range(min = 0.0))]
            pub $kernel: f64,
            #[doc = concat!("Relative error of the commanded ", $command, ", 1 σ: of the mass, of the actuators' gain.")]
            #[schemars(range(min = 0.0))]
            pub prior_input: f64,
            /// Relative size of the actuators' lags, 1 σ.
            #[schemars(range(min = 0.0))]
            pub prior_lag: f64,
            /// Size of the fast unknown acceleration that is no function of the motion, 1 σ: gusts.
            #[schemars(range(min = 0.0))]
            pub $disturbance: f64,
            /// How long such a gust lasts.
            #[schemars(extend("exclusiveMinimum" = 0.0))]
            pub disturbance_time_s: f64,
            /// Density of the acceleration's white noise.
            #[schemars(range(min = 0.0))]
            pub $process_noise: f64,
            #[doc = concat!("How long what was learned of the ", $motion, " stays valid.")]
            #[schemars(extend("exclusiveMinimum" = 0.0))]
            pub motion_memory_s: f64,
            /// How long what was learned of the commands and their lags stays valid.
            #[schemars(extend("exclusiveMinimum" = 0.0))]
            pub input_memory_s: f64,
            /// Time constants of the actuators' lags.
            pub lag_times_s: [f64; 2],
            /// After so many samples the noise levels follow what the sensor shows; 0: the configured noises stand.
            #[schemars(range(min = 0.0))]
            pub noise_memory_samples: f64,
            /// How much of the filter's own corrections counts as what may not teach; 0: everything teaches.
            #[schemars(range(min = 0.0))]
            pub correction_share: f64,
            /// The recent mean of the motion, from which what varies teaches, is over this time.
            #[schemars(extend("exclusiveMinimum" = 0.0))]
            pub excitation_mean_time_s: f64,
            /// What varies is measured over this time.
            #[schemars(extend("exclusiveMinimum" = 0.0))]
            pub excitation_variation_time_s: f64,
            /// How fast that mean follows while nothing teaches, as a part of its own rate.
            #[schemars(range(min = 0.0))]
            pub excitation_idle_rate: f64,
            $($(#[$last_doc])* #[schemars(range(min = 0.0))] pub $last: f64,)*
        }

        impl Default for $Joint {
            fn default() -> Self {
                Self {
                    $bias: $bias_default,
                    $linear: $linear_default,
                    $kernel: $kernel_default,
                    prior_input: $input_default,
                    prior_lag: $lag_default,
                    $disturbance: $disturbance_default,
                    disturbance_time_s: 0.2,
                    $process_noise: $process_noise_default,
                    motion_memory_s: 300.0,
                    input_memory_s: 3600.0,
                    lag_times_s: $lags_default,
                    noise_memory_samples: 500.0,
                    correction_share: 0.3,
                    excitation_mean_time_s: 5.0,
                    excitation_variation_time_s: 0.2,
                    excitation_idle_rate: 0.05,
                    $($last: $last_default,)*
                }
            }
        }
    };
}

joint! {
    /// What the joint law assumes of the translation.
    TranslationJoint {
        prior_bias_m_s2 = 0.5, prior_linear_m_s2 = 0.3, prior_kernel_m_s2 = 0.35, input = 0.15, lag = 0.3,
        disturbance_std_m_s2 = 0.1, process_noise_m2_s3 = 1.5e-3, lags = [0.05, 0.2],
    }
    words { command: "force", motion: "velocity" }
    last {
        /// Relative size of an added mass that differs along the body's axes, 1 σ: of the force ω × v of a vehicle that turns. With
        /// force_axes = "body".
        pub prior_turn = 0.3,
        /// White noise of measured specific forces, 1 σ of each axis, where their samples and sensors say none; 0: they are not used.
        ///
        /// That of an accelerometer on a vehicle that vibrates is 0.5 and more. They need the attitude, and `gravity_m_s2` as it
        /// is: buoyancy belongs into `known_force_n`.
        pub specific_force_noise_m_s2 = 0.0,
        /// Slow error of measured specific forces, 1 σ: bias, misalignment, what vibration makes of them.
        pub specific_force_bias_m_s2 = 0.5,
        /// How long that error stays alike.
        pub specific_force_bias_time_s = 10.0,
    }
}

joint! {
    /// What the joint law assumes of the rotation.
    RotationJoint {
        prior_bias_rad_s2 = 15.0, prior_linear_rad_s2 = 9.0, prior_kernel_rad_s2 = 10.5, input = 0.5, lag = 0.5,
        disturbance_std_rad_s2 = 3.0, process_noise_rad2_s3 = 0.1, lags = [0.05, 0.1],
    }
    words { command: "torque", motion: "angular velocity" }
    last {
        /// Size of the gyroscope's bias, 1 σ of each axis; 0: it has none. Attitude fixes tell it.
        pub gyro_bias_std_rad_s = 0.0,
        /// Random walk of the gyroscope's bias.
        pub gyro_bias_walk_rad_s_sqrt_s = 0.0,
    }
}

/// The fields of the joint law's design, and the keys of `[translation]` that set them.
pub(crate) const TRANSLATION_NAMES: &[(&str, &str)] = &[
    ("noise", "velocity_noise_m_s"),
    ("box", "speed_box_m_s"),
    ("position_noise", "position_noise_m"),
    ("bias", "joint.prior_bias_m_s2"),
    ("linear", "joint.prior_linear_m_s2"),
    ("kernel", "joint.prior_kernel_m_s2"),
    ("disturbance", "joint.disturbance_std_m_s2"),
    ("process_noise", "joint.process_noise_m2_s3"),
    ("disturbance_time_s", "joint.disturbance_time_s"),
    ("motion_memory_s", "joint.motion_memory_s"),
    ("input_memory_s", "joint.input_memory_s"),
    ("lags_s", "joint.lag_times_s"),
    ("noise_samples", "joint.noise_memory_samples"),
    ("correction_share", "joint.correction_share"),
    ("mean_time_s", "joint.excitation_mean_time_s"),
    ("variation_time_s", "joint.excitation_variation_time_s"),
    ("idle_rate", "joint.excitation_idle_rate"),
    ("input", "joint.prior_input"),
    ("lag", "joint.prior_lag"),
    ("turn", "joint.prior_turn"),
    ("accelerometer_noise", "joint.specific_force_noise_m_s2"),
    ("accelerometer_bias", "joint.specific_force_bias_m_s2"),
    ("accelerometer_bias_time_s", "joint.specific_force_bias_time_s"),
];

/// The fields of the joint law's design, and the keys of `[rotation]` that set them.
pub(crate) const ROTATION_NAMES: &[(&str, &str)] = &[
    ("noise", "angular_velocity_noise_rad_s"),
    ("box", "rate_box_rad_s"),
    ("attitude_noise_rad", "attitude_noise_rad"),
    ("bias", "joint.prior_bias_rad_s2"),
    ("linear", "joint.prior_linear_rad_s2"),
    ("kernel", "joint.prior_kernel_rad_s2"),
    ("disturbance", "joint.disturbance_std_rad_s2"),
    ("process_noise", "joint.process_noise_rad2_s3"),
    ("disturbance_time_s", "joint.disturbance_time_s"),
    ("motion_memory_s", "joint.motion_memory_s"),
    ("input_memory_s", "joint.input_memory_s"),
    ("lags_s", "joint.lag_times_s"),
    ("noise_samples", "joint.noise_memory_samples"),
    ("correction_share", "joint.correction_share"),
    ("mean_time_s", "joint.excitation_mean_time_s"),
    ("variation_time_s", "joint.excitation_variation_time_s"),
    ("idle_rate", "joint.excitation_idle_rate"),
    ("input", "joint.prior_input"),
    ("lag", "joint.prior_lag"),
    ("bias_std_rad_s", "joint.gyro_bias_std_rad_s"),
    ("bias_walk_rad_s_sqrt_s", "joint.gyro_bias_walk_rad_s_sqrt_s"),
];
