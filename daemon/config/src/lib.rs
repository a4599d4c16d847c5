//! The service's configuration as pure data: TOML in, values out; messages with line and suggestion; the reference.
//!
//! Nothing is built here: `daemon::assemble` makes observers of it. This crate depends on none of ours.
//!
//! | module | holds |
//! |---|---|
//! | [`service`] | the root and the tables without a channel |
//! | [`channels`] | the one table of the channels' keys |
//! | [`values`] | matrices, kernels, solvers, words |
//! | [`real_time`] | `[real_time]` |
//! | [`file`](mod@file) | a configuration with its text: reading, messages, printing |
//! | [`checks`] | bounds and combinations that need neither the mathematics nor a look at the machine |
//! | [`schema`], [`reference`](mod@reference) | what editors and people read, made from the types |
//!
//! Keys carry their units; an unknown key is an error. Every message says where (file and line), what was found, and what
//! would be accepted. A new key is one field of a type here; reference and schema follow by
//! `UPDATE_REFERENCE=1 cargo test -p daemon_config`.

pub mod channels;
pub mod checks;
pub mod file;
pub mod presets;
pub mod real_time;
pub mod reference;
pub mod schema;
pub mod service;
pub mod values;

pub use channels::{CommonKeys, KeyNames, LinearConfig, RotationConfig, TranslationConfig};
pub use file::{ConfigError, ConfigFile};
pub use presets::PRESETS;
pub use real_time::RealTimeConfig;
pub use service::{
    Clock, Config, DeadlineConfig, InitialConfig, InputConfig, SnapshotConfig, SourcePolicy, Trigger,
};
pub use values::{
    DeadZoneName, GyroscopicTorqueName, KernelName, LengthScaleConfig, OutlierAction, SolverConfig,
    SolverName, SolverOptions, SquareMatrix, SymmetricMatrix,
};
