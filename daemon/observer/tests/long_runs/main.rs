//! What the joint law promises over long flights, most of them with little motion, through the channel's public interface.
//!
//! | file | what |
//! |---|---|
//! | `random`, `vehicle`, `flight` | random numbers; true plants and their pilots; a vehicle with the channel that listens |
//! | `low_excitation` | after hours of rest or cruise the filter is as good as a fresh one |
//! | `mixed_flight` | nothing grows, and the covariance stays one |
//! | `gap` | two seconds without samples and commands |
//! | `delivery` | velocity and command in one sample or in two; lost frames |
//! | `misstated_noise` | noises that are stated three times wrong |
//! | `switches` | noise levels and excitation, each switched off by itself |
//! | `attitude` | how honest the attitude's deviations are |
//!
//! Measured figures are printed: `cargo test --release -p observer --test long_runs -- --nocapture`; with `--ignored` the
//! long ones.

mod attitude;
mod delivery;
mod flight;
mod gap;
mod low_excitation;
mod misstated_noise;
mod mixed_flight;
mod random;
mod switches;
mod vehicle;
