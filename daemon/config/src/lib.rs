//! The service's configuration as pure data: its types, reading and printing TOML, error messages, the reference.
//!
//! Nothing is built here: `daemon::assemble` makes observers of a configuration. Depends on no other crate of this workspace.
//!
//! | module | holds |
//! |---|---|
//! | [`service`] | the root, and the tables that do not belong to a channel |
//! | [`channels`] | the table of the channels' keys |
//! | [`joint`] | what the joint law assumes of a vehicle |
//! | [`values`] | matrices, kernels, solvers, words |
//! | [`sensors`] | `[[sensor]]` |
//! | [`real_time`] | `[real_time]` |
//! | [`file`](mod@file) | a configuration with its text: reading, messages, printing |
//! | [`checks`] | bounds and combinations of keys |
//! | [`schema`], [`reference`](mod@reference) | the JSON schema and the reference, made from the types |
//!
//! Keys carry their units; an unknown key is an error. Every error message names file and line, what was found, and
//! what would be accepted. A new key is one field of a type here. Reference and schema are made anew by
//! `UPDATE_REFERENCE=1 cargo test -p daemon_config`.

pub mod channels;
pub mod checks;
pub mod file;
pub mod joint;
pub mod presets;
pub mod real_time;
pub mod reference;
pub mod schema;
pub mod sensors;
pub mod service;
pub mod values;

pub use channels::{CommonKeys, KeyNames, LawKeys, LinearConfig, RotationConfig, TranslationConfig};
pub use file::{ConfigError, ConfigFile};
pub use joint::{RotationJoint, TranslationJoint};
pub use presets::PRESETS;
pub use real_time::RealTimeConfig;
pub use sensors::{MAX_SENSOR, OutlierWeight, SensorClock, SensorConfig};
pub use service::{
    Clock, Config, DeadlineConfig, InitialConfig, InputConfig, SnapshotConfig, SourcePolicy, Trigger,
};
pub use values::{
    AxisValues, DeadZoneName, FeaturesAtName, ForceAxesName, GyroscopicTorqueName, KernelName, LawName,
    LengthScaleConfig, OutlierAction, SolverConfig, SolverName, SolverOptions, SquareMatrix, SymmetricMatrix,
};
