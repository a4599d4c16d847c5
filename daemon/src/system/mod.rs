//! What the service asks of the machine: real-time settings, what the machine grants, what systemd is told.
//!
//! May use the configuration and the tick's own wait; knows neither engine nor ports.

pub(crate) mod doctor;
pub mod machine;
pub mod real_time;
pub mod service_manager;
pub mod settings;
pub mod state_directory;
