//! The service and its machine: real-time settings, the doctor, the service manager.
//!
//! May depend on the configuration and on the wait of the tick, not on engine or ports.

pub(crate) mod doctor;
pub mod machine;
pub mod real_time;
pub mod service_manager;
pub mod settings;
pub mod state_directory;
