//! The channels' tables `[translation]`, `[rotation]` and `[linear]`: one table of keys for the three.
//!
//! The body of the macro is the table of the keys that every channel has. The macro is used three times, each time with a
//! channel's names (with units), types, words, examples, and the keys that only this channel has.

use crate::joint::{ROTATION_NAMES, RotationJoint, TRANSLATION_NAMES, TranslationJoint};
use crate::values::{
    AxisValues, DeadZoneName, FeaturesAtName, ForceAxesName, GyroscopicTorqueName, KernelName, LawName,
    LengthScaleConfig, SolverConfig, SquareMatrix, SymmetricMatrix,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// The keys that every channel has, by one name each. What a law does not need is `None`.
#[derive(Debug, Clone, PartialEq)]
pub struct CommonKeys<'a> {
    /// The law.
    pub law: LawName,
    /// Outputs per second; `rate_hz` where absent.
    pub sample_rate_hz: Option<f64>,
    /// κ.
    pub kernel: KernelName,
    /// ℓ.
    pub length_scale: Option<&'a LengthScaleConfig>,
    /// Lower corner of the lattice.
    pub centers_lower: Option<&'a [f64]>,
    /// Upper corner of the lattice.
    pub centers_upper: Option<&'a [f64]>,
    /// Centers along each axis of the lattice.
    pub centers_per_axis: Option<&'a [usize]>,
    /// Centers one by one.
    pub centers_listed: Option<Vec<&'a [f64]>>,
    /// Added to the Gram matrix's diagonal as a multiple of κ(0).
    pub nugget: f64,
    /// How f̂ is computed.
    pub solver: SolverConfig,
    /// Shape of σ.
    pub dead_zone: DeadZoneName,
    /// Where φ is taken.
    pub features_at: FeaturesAtName,
    /// A bound on ‖f̂_N‖_H, in the input's unit.
    pub max_native_norm: Option<f64>,
    /// d, in the output's unit.
    pub dead_zone_width: Option<f64>,
    /// ε, in the output's unit.
    pub dead_zone_buffer: Option<f64>,
    /// δ̄, in the output's unit.
    pub noise_bound: Option<f64>,
    /// ξ̄, in the input's unit.
    pub unmatched_bound: f64,
    /// r_f.
    pub residual_norm_bound: f64,
}

/// The keys of one law.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LawKeys {
    /// Those that must be there.
    pub required: &'static [&'static str],
    /// The others that only this law has.
    pub optional: &'static [&'static str],
}

impl LawKeys {
    /// All of them.
    fn all(self) -> impl Iterator<Item = &'static str> {
        self.required.iter().chain(self.optional).copied()
    }

    /// Those that the other law does not have.
    pub fn without(self, other: Self) -> impl Iterator<Item = &'static str> {
        self.all().filter(move |key| other.all().all(|known| known != *key))
    }
}

/// What a channel's schema says of its laws and its centers: of each alternative the required keys, and as `false` those
/// that belong to the other law.
fn alternatives([joint, gradient]: [LawKeys; 2], lattice: &[&str], listed: &str) -> Vec<Value> {
    let has_two_laws = !joint.required.is_empty();
    let alternative = |law: LawName, own: LawKeys, other: LawKeys, centers: &[&str]| {
        let law_key = (has_two_laws && law != LawName::default()).then_some("law");
        let required: Vec<_> = law_key.iter().chain(own.required).chain(centers).collect();
        let mut alternative = json!({ "required": required });
        if has_two_laws {
            let mut properties: Map<_, _> =
                other.without(own).map(|key| (key.to_owned(), Value::Bool(false))).collect();
            properties.insert("law".into(), json!({ "const": law.name() }));
            alternative["properties"] = properties.into();
        }
        alternative
    };
    let joint_alternative = has_two_laws.then(|| alternative(LawName::Joint, joint, gradient, &[]));
    let gradient_alternatives =
        [lattice, &[listed]].map(|centers| alternative(LawName::Gradient, gradient, joint, centers));
    joint_alternative.into_iter().chain(gradient_alternatives).collect()
}

/// What a channel calls its keys, for messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeyNames {
    /// The mass, the inertia, or A.
    pub inertia: &'static str,
    /// The observer's gain.
    pub gain: &'static str,
    /// The gain of position or attitude fixes; empty where there are none.
    pub fix_gain: &'static str,
    /// Γ_f.
    pub adaptation_rate: &'static str,
    /// ℓ.
    pub length_scale: &'static str,
    /// The first key of a lattice.
    pub centers_lower: &'static str,
    /// d.
    pub dead_zone_width: &'static str,
    /// ε.
    pub dead_zone_buffer: &'static str,
    /// δ̄.
    pub noise_bound: &'static str,
    /// ξ̄.
    pub unmatched_bound: &'static str,
    /// r_f.
    pub residual_norm_bound: &'static str,
    /// The bound on ‖f̂_N‖_H.
    pub max_native_norm: &'static str,
    /// Of the joint law: a field of its design, and the key that sets it.
    pub joint: &'static [(&'static str, &'static str)],
}

impl KeyNames {
    /// The key that sets a field of the joint law's design.
    pub fn joint_key(&self, field: &str) -> &'static str {
        self.joint.iter().find(|(known, _)| *known == field).map_or("law", |(_, key)| key)
    }
}

/// The keys that only the gradient law has, but for its centers.
macro_rules! gradient_keys {
    (required $rate:ident $length_scale:ident $width:ident $buffer:ident $noise:ident $($more:ident)*;
     optional $lower:ident $upper:ident $listed:ident $unmatched:ident $residual:ident $max_norm:ident $($other:ident)*) => {
        LawKeys {
            required: &[
                $(stringify!($more),)* stringify!($rate), stringify!($length_scale), stringify!($width),
                stringify!($buffer), stringify!($noise),
            ],
            optional: &[
                stringify!($lower), stringify!($upper), stringify!($listed), stringify!($unmatched),
                stringify!($residual), stringify!($max_norm), "nugget", "solver", "dead_zone", "features_at", $(stringify!($other),)*
            ],
        }
    };
}

macro_rules! channel {
    (
        $(#[$doc:meta])*
        $Config:ident, messages name $inertia:tt $gain:tt $fix_gain:tt, law $law:expr;
        types { $Point:ty, $Counts:ty, $Rate:ty }
        gradient { required $($needed:ident)*; optional $($possible:ident)* }
        joint { required $($joint_needed:ident)*; optional $($joint_possible:ident)*; names $joint_names:expr }
        words {
            sensor: $sensor:tt, output: $output:tt, outputs: $outputs:tt, measured: $measured:tt,
            rate: $rate_text:tt, unmatched: $unmatched_text:tt, unknown: $unknown:tt
        }
        keys {
            $rate:ident = $rate_example:tt, $length_scale:ident = $length_example:tt,
            $lower:ident = $lower_example:tt, $upper:ident = $upper_example:tt, per_axis = $counts_example:tt,
            $listed:ident = $listed_example:tt,
            $width:ident = $width_example:tt, $buffer:ident = $buffer_example:tt, $noise:ident = $noise_example:tt,
            $unmatched:ident, $residual:ident, $max_norm:ident, sample_rate_hz = $sample_rate_example:tt
        }
        first { $($first:tt)* }
        last { $($last:tt)* }
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[schemars(extend("oneOf" = alternatives(
            Self::LAWS, &[stringify!($lower), stringify!($upper), "centers_per_axis"], stringify!($listed)
        )))]
        pub struct $Config {
            $($first)*
            #[doc = concat!($sensor, " per second (default rate_hz); each is held for 1.5 periods, then the channel coasts.")]
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(range(min = 0.01, max = 10000.0), example = $sample_rate_example)]
            pub sample_rate_hz: Option<f64>,
            #[doc = concat!("Adaptation rate Γ_f, symmetric positive definite: ", $rate_text, ".")]
            ///
            /// Higher learns faster and noisier. A rate that makes the sampled law unstable is refused with the
            /// largest stable one.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(example = $rate_example)]
            pub $rate: Option<$Rate>,
            /// Kernel κ: "sobolev-matern-K" with its order K (the higher, the smoother what is learned), "gaussian",
            /// "wendland-c2" or "wendland-c4".
            #[serde(default)]
            pub kernel: KernelName,
            #[doc = concat!("Length scale ℓ of the kernel: ", $outputs, " this far apart share what is learned. One number, or one per axis.")]
            ///
            /// One to two times the distance between centers, several times it with Wendland kernels; smaller
            /// resolves finer detail and learns it more slowly. Of the joint law the box's half-widths where absent.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(example = $length_example)]
            pub $length_scale: Option<LengthScaleConfig>,
            #[doc = concat!("Lower corner of the lattice of kernel centers, in the space of the ", $output, ".")]
            ///
            #[doc = concat!("The box must hold the ", $measured, ": outside of it the learned function fades, and the estimate says outside the centers. Needs the upper corner and the number per axis.")]
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(example = vec!$lower_example)]
            pub $lower: Option<$Point>,
            #[doc = concat!("Upper corner of the lattice of kernel centers, in the space of the ", $output, ".")]
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(example = vec!$upper_example)]
            pub $upper: Option<$Point>,
            /// Centers along each axis of the lattice; of the joint law's box 3, 3, 3 where absent.
            ///
            /// Spacing of about half a length scale to one; the memory and the time per step grow with the product.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(example = vec!$counts_example)]
            pub centers_per_axis: Option<$Counts>,
            /// Centers one by one, instead of a lattice.
            ///
            /// For a flight envelope that is no box. No two may be equal.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(example = vec!$listed_example)]
            pub $listed: Option<Vec<$Point>>,
            /// Added to the Gram matrix's diagonal as a multiple of κ(0); 0 is the paper's law.
            ///
            /// 1e-8 or so where the Gram matrix is refused as not positive definite: centers that lie too close for
            /// the length scale.
            #[serde(default)]
            #[schemars(range(min = 0.0))]
            pub nugget: f64,
            /// How the learned function is computed: "dense" from all centers, exact; "local" from those around the
            /// output, with an error estimate in every estimate; "auto" by the number of centers. Or a table of
            /// options.
            ///
            /// "auto" takes "dense" up to 2000 centers of a lattice and "local" beyond. Listed centers have no local
            /// solver: "auto" takes "dense" up to 3000 of them, and more need solver = "dense". `daemon check` says
            /// which one you get, its error and its memory.
            #[serde(default)]
            pub solver: SolverConfig,
            /// Shape of the dead zone σ: "saturated", "quadratic" (the paper's, corrected) or "step" (Theorem 1;
            /// ignores the buffer).
            #[serde(default)]
            pub dead_zone: DeadZoneName,
            /// Dead zone d: output errors up to this are taken for noise.
            ///
            /// Just above what the error is when nothing is to be learned: narrower learns noise, wider stops
            /// learning early.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(range(min = 0.0), example = $width_example)]
            pub $width: Option<f64>,
            /// Buffer ε over which the dead zone opens.
            ///
            /// About the width.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(extend("exclusiveMinimum" = 0.0), example = $buffer_example)]
            pub $buffer: Option<f64>,
            #[doc = concat!("Bound δ̄ on the norm of the ", $output, "'s measurement error.")]
            ///
            /// It widens the error bounds that `daemon check` and every estimate report, not the estimate.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(range(min = 0.0), example = $noise_example)]
            pub $noise: Option<f64>,
            #[doc = concat!("Bound ξ̄ on ", $unmatched_text, "; it widens the guarantees, not the estimate.")]
            #[serde(default)]
            #[schemars(range(min = 0.0))]
            pub $unmatched: f64,
            #[doc = concat!("Bound r_f on the native norm of what the centers cannot represent of the unknown ", $unknown, "; it widens the guarantees.")]
            #[serde(default)]
            #[schemars(range(min = 0.0))]
            pub $residual: f64,
            /// Where the features of what is learned are taken: "measured" (the paper) or "estimated".
            ///
            /// With "measured" sensor noise alone makes the learned function grow, in proportion to the time.
            #[serde(default)]
            pub features_at: FeaturesAtName,
            #[doc = concat!("Bound on the native norm of the learned ", $unknown, ": an update that would exceed it is made smaller.")]
            ///
            /// It limits what noise alone can teach. Absent: none, as in the paper.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(extend("exclusiveMinimum" = 0.0), example = 20.0)]
            pub $max_norm: Option<f64>,
            $($last)*
        }

        impl $Config {
            /// What messages call the keys.
            pub const NAMES: KeyNames = KeyNames {
                inertia: $inertia,
                gain: $gain,
                fix_gain: $fix_gain,
                adaptation_rate: stringify!($rate),
                length_scale: stringify!($length_scale),
                centers_lower: stringify!($lower),
                dead_zone_width: stringify!($width),
                dead_zone_buffer: stringify!($buffer),
                noise_bound: stringify!($noise),
                unmatched_bound: stringify!($unmatched),
                residual_norm_bound: stringify!($residual),
                max_native_norm: stringify!($max_norm),
                joint: $joint_names,
            };

            /// The keys that only the gradient law has.
            pub const GRADIENT: LawKeys = gradient_keys! {
                required $rate $length_scale $width $buffer $noise $($needed)*;
                optional $lower $upper $listed $unmatched $residual $max_norm $($possible)*
            };
            /// The keys that only the joint law has, and those that it may have and the gradient law must.
            pub const JOINT: LawKeys = LawKeys {
                required: &[$(stringify!($joint_needed)),*],
                optional: &[$(stringify!($joint_possible)),*],
            };

            /// The keys of the joint law and of the gradient law.
            pub const LAWS: [LawKeys; 2] = [Self::JOINT, Self::GRADIENT];

            /// The law of the channel.
            pub fn law(&self) -> LawName {
                let law: fn(&Self) -> LawName = $law;
                law(self)
            }

            /// The keys that every channel has.
            pub fn common(&self) -> CommonKeys<'_> {
                CommonKeys {
                    law: self.law(),
                    sample_rate_hz: self.sample_rate_hz,
                    kernel: self.kernel,
                    length_scale: self.$length_scale.as_ref(),
                    centers_lower: self.$lower.as_ref().map(|point| &point[..]),
                    centers_upper: self.$upper.as_ref().map(|point| &point[..]),
                    centers_per_axis: self.centers_per_axis.as_ref().map(|counts| &counts[..]),
                    centers_listed: self.$listed.as_ref().map(|list| list.iter().map(|point| &point[..]).collect()),
                    nugget: self.nugget,
                    solver: self.solver,
                    dead_zone: self.dead_zone,
                    dead_zone_width: self.$width,
                    dead_zone_buffer: self.$buffer,
                    noise_bound: self.$noise,
                    unmatched_bound: self.$unmatched,
                    residual_norm_bound: self.$residual,
                    features_at: self.features_at,
                    max_native_norm: self.$max_norm,
                }
            }
        }
    };
}

channel! {
    /// The translation channel.
    TranslationConfig, messages name "mass_kg" "gain_per_s" "position_fix_gain_per_s", law |config| config.law;
    types { [f64; 3], [usize; 3], SymmetricMatrix }
    gradient {
        required gain_per_s;
        optional velocity_error_to_position position_fix_gain_per_s position_fix_hold_s
    }
    joint { required velocity_noise_m_s speed_box_m_s; optional position_noise_m joint force_axes length_scale_m_s; names TRANSLATION_NAMES }
    words {
        sensor: "Velocity measurements", output: "velocity", outputs: "speeds",
        measured: "velocities that are flown", rate: "a number, three numbers (diagonal) or 3 × 3",
        unmatched: "the force that is no function of the velocity (gusts)", unknown: "force"
    }
    keys {
        adaptation_rate_kg_s2 = 100.0, length_scale_m_s = 3.0,
        centers_lower_m_s = [-4.0, -4.0, -2.0], centers_upper_m_s = [4.0, 4.0, 2.0], per_axis = [5, 5, 3],
        centers_listed_m_s = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
        dead_zone_width_m_s = 0.02, dead_zone_buffer_m_s = 0.02, noise_bound_m_s = 0.06,
        unmatched_force_bound_n, residual_norm_bound_n, max_native_norm_n, sample_rate_hz = 10.0
    }
    first {
        /// How velocity and force are estimated: "joint" or "gradient".
        #[serde(default)]
        pub law: LawName,
        /// Nominal mass; under water with the added mass.
        ///
        /// What it gets wrong is learned as a force.
        #[schemars(extend("exclusiveMinimum" = 0.0), example = 2.0)]
        pub mass_kg: f64,
        /// Gravity along the inertial axes where the commanded force carries the weight; [0, 0, 9.81] with axes
        /// north-east-down.
        ///
        /// Zero where the commanded force is net of weight, and for a vehicle that floats.
        #[serde(default)]
        pub gravity_m_s2: [f64; 3],
        /// Another known constant force along the inertial axes, buoyancy say.
        #[serde(default)]
        pub known_force_n: [f64; 3],
        /// Noise of the measured velocity, 1 σ of each axis: one number, or three.
        ///
        /// A factor of three off is found in flight. As of the sensor's data sheet, or of a log at rest.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(example = 0.05)]
        pub velocity_noise_m_s: Option<AxisValues>,
        /// Speeds that are flown, up to this along each inertial axis: one number, or three.
        ///
        /// The unknown force is learned as a function of the velocity within this box, and fades beyond.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(example = vec![4.0, 4.0, 2.0])]
        pub speed_box_m_s: Option<AxisValues>,
        /// Noise of a position fix, 1 σ of each axis.
        #[serde(default = "position_noise_m")]
        #[schemars(extend("exclusiveMinimum" = 0.0))]
        pub position_noise_m: f64,
        /// Observer gain λ: how fast the velocity estimate follows the measurement.
        ///
        /// Higher trusts the sensor more, and lets more of its noise through; a few times below the sample rate.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(extend("exclusiveMinimum" = 0.0), example = 10.0)]
        pub gain_per_s: Option<f64>,
    }
    last {
        /// Axes along which the unknown force is learned: "inertial" or "body".
        ///
        /// "body" for an underwater vehicle, whose drag and added mass are other ones across than along. A multicopter is better off with
        /// "inertial". Measured in docs/accuracy.md.
        #[serde(default)]
        pub force_axes: ForceAxesName,
        /// What the joint law assumes of a vehicle; the defaults fly.
        #[serde(default)]
        pub joint: TranslationJoint,
        /// Gain L_r of the velocity error into the position; 0 is dead reckoning.
        ///
        /// Dimensionless. Position is not observable from velocity: it changes where errors go, not that they
        /// grow.
        #[serde(default)]
        pub velocity_error_to_position: f64,
        /// Gain L_p of position fixes; 0 uses only the first one.
        ///
        /// About one over the time in which a fix shall pull the position to itself.
        #[serde(default)]
        #[schemars(range(min = 0.0))]
        pub position_fix_gain_per_s: f64,
        /// How long a position fix keeps correcting.
        ///
        /// Between one and two periods of the fixes.
        #[serde(default = "fix_hold_s")]
        #[schemars(range(min = 0.0))]
        pub position_fix_hold_s: f64,
    }
}

channel! {
    /// The rotation channel.
    RotationConfig, messages name "inertia_kg_m2" "gain_per_s" "attitude_fix_gain_per_s", law |config| config.law;
    types { [f64; 3], [usize; 3], SymmetricMatrix }
    gradient { required gain_per_s; optional attitude_fix_gain_per_s attitude_fix_hold_s }
    joint { required angular_velocity_noise_rad_s rate_box_rad_s; optional attitude_noise_rad joint length_scale_rad_s; names ROTATION_NAMES }
    words {
        sensor: "Angular-velocity measurements", output: "angular velocity", outputs: "rates",
        measured: "angular velocities that are flown", rate: "a number, three numbers (diagonal) or 3 × 3",
        unmatched: "the torque that is no function of the angular velocity", unknown: "torque"
    }
    keys {
        adaptation_rate_n_m = 1.0, length_scale_rad_s = 2.0,
        centers_lower_rad_s = [-2.0, -2.0, -1.0], centers_upper_rad_s = [2.0, 2.0, 1.0], per_axis = [3, 3, 3],
        centers_listed_rad_s = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        dead_zone_width_rad_s = 0.01, dead_zone_buffer_rad_s = 0.01, noise_bound_rad_s = 0.015,
        unmatched_torque_bound_n_m, residual_norm_bound_n_m, max_native_norm_n_m, sample_rate_hz = 100.0
    }
    first {
        /// How angular velocity and torque are estimated: "joint" or "gradient".
        #[serde(default)]
        pub law: LawName,
        /// Nominal inertia, symmetric positive definite: a number, three numbers (diagonal) or 3 × 3.
        ///
        /// In body axes. What it gets wrong is learned as a torque.
        #[schemars(example = vec![0.02, 0.02, 0.035])]
        pub inertia_kg_m2: SymmetricMatrix,
        /// −ω × Iω: "learned" with the rest (the paper), or "feedforward" from the estimate.
        ///
        /// "feedforward" for bodies that spin fast and whose inertia is known well.
        #[serde(default)]
        pub gyroscopic_torque: GyroscopicTorqueName,
        /// Noise of the measured angular velocity, 1 σ of each axis: one number, or three.
        ///
        /// A factor of three off is found in flight. As of the sensor's data sheet, or of a log at rest.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(example = 0.01)]
        pub angular_velocity_noise_rad_s: Option<AxisValues>,
        /// Angular velocities that are flown, up to this about each body axis: one number, or three.
        ///
        /// The unknown torque is learned as a function of the angular velocity within this box, and fades beyond.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(example = vec![2.0, 2.0, 1.0])]
        pub rate_box_rad_s: Option<AxisValues>,
        /// Noise of an attitude fix, 1 σ of each component of its rotation vector.
        #[serde(default = "attitude_noise_rad")]
        #[schemars(extend("exclusiveMinimum" = 0.0))]
        pub attitude_noise_rad: f64,
        /// Observer gain λ: how fast the angular-velocity estimate follows the measurement.
        ///
        /// Higher trusts the sensor more, and lets more of its noise through; a few times below the sample rate.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(extend("exclusiveMinimum" = 0.0), example = 40.0)]
        pub gain_per_s: Option<f64>,
    }
    last {
        /// What the joint law assumes of a vehicle; the defaults fly.
        #[serde(default)]
        pub joint: RotationJoint,
        /// Gain L_q of attitude fixes; 0 uses only the first one.
        ///
        /// About one over the time in which a fix shall pull the attitude to itself.
        #[serde(default)]
        #[schemars(range(min = 0.0))]
        pub attitude_fix_gain_per_s: f64,
        /// How long an attitude fix keeps correcting.
        ///
        /// Between one and two periods of the fixes.
        #[serde(default = "fix_hold_s")]
        #[schemars(range(min = 0.0))]
        pub attitude_fix_hold_s: f64,
    }
}

channel! {
    /// `x' = A x + B (u + f(y)) + ξ`, `y = C x + δ`, with `output` and `input` of the measurement for y and u.
    LinearConfig, messages name "a" "gain" "", law |_| LawName::Gradient;
    types { Vec<f64>, Vec<usize>, SquareMatrix }
    gradient { required; optional }
    joint { required; optional; names &[] }
    words {
        sensor: "Outputs", output: "output", outputs: "outputs", measured: "outputs",
        rate: "a number, one per output (diagonal), or m × m",
        unmatched: "what else acts on x' and is no function of the output", unknown: "input"
    }
    keys {
        adaptation_rate = 50.0, length_scale = 1.0,
        centers_lower = [-3.0], centers_upper = [3.0], per_axis = [13],
        centers_listed = [[-1.0], [0.0], [1.0]],
        dead_zone_width = 0.02, dead_zone_buffer = 0.02, noise_bound = 0.01,
        unmatched_bound, residual_norm_bound, max_native_norm, sample_rate_hz = 100.0
    }
    first {
        /// A, row after row.
        ///
        /// 1/s in the units of its states: n rows of n numbers, n at most 12.
        #[schemars(example = vec![[0.0, 1.0], [-3.0, -0.2]])]
        pub a: Vec<Vec<f64>>,
        /// B, row after row.
        ///
        /// n rows of m numbers.
        #[schemars(example = vec![[0.0], [0.5]])]
        pub b: Vec<Vec<f64>>,
        /// C, row after row: as many outputs as inputs.
        ///
        /// m rows of n numbers; y = C x is `output` of the measurement.
        #[schemars(example = vec![[2.0, 1.0]])]
        pub c: Vec<Vec<f64>>,
        /// Observer gain L, row after row; A − LC must be Hurwitz on what is observable.
        ///
        /// n rows of m numbers. `daemon check` prints the poles of A − LC and whether they suffice for the
        /// guarantees.
        #[schemars(example = vec![[1.0], [8.0]])]
        pub gain: Vec<Vec<f64>>,
        /// Names of the states, for reports.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(example = vec!["position", "velocity"])]
        pub state_names: Option<Vec<String>>,
        /// The state before the first sample; default: the least one with the first output.
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(example = vec![0.5, 0.0])]
        pub initial_state: Option<Vec<f64>>,
    }
    last {}
}

fn fix_hold_s() -> f64 {
    0.25
}

fn position_noise_m() -> f64 {
    0.5
}

fn attitude_noise_rad() -> f64 {
    0.02
}
