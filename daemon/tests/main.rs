//! The daemon's integration tests, in one program.
//!
//! Each file has one topic. `engine`, `same_bits` and `properties` test what determines an estimate, without a clock. The
//! other files start the real program in a domain of its own (`common`).

mod access;
mod c_client;
mod check;
mod common;
mod config_reference;
mod configuration;
mod doctor;
mod engine;
mod iceoryx2_config;
mod late_samples;
mod no_allocation;
mod properties;
mod python;
mod real_time;
mod same_bits;
mod service;
mod service_manager;
mod snapshot;
