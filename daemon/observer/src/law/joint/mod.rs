//! The joint filter: one Kalman filter over velocity, a fast disturbance, and the weights of the unknown acceleration.
//!
//! ```text
//! v' = a_u + g + d + ψ(z)ᵀθ + w        velocity, inertial; or angular velocity, body
//! d' = −d/τ_d + …                       a fast disturbance, stationary deviation σ_d
//! θ_k' = −θ_k/T_k + …                   weights, stationary law N(0, 1): the norm of the native space is the prior
//! ```
//!
//! All of it is in accelerations: a force is the mass times that, a torque the inertia times that. Each axis has a column
//! of its own of the mean X; the columns share one covariance P while the noises of the axes are equal, and have three
//! otherwise. With no features this is the Kalman filter with a Gauss–Markov disturbance; with P_θθ frozen it is the
//! gradient law of Niu et al.
//!
//! | symbol | name | shape | unit (translation) |
//! |---|---|---|---|
//! | X | `mean` | n×3 | v: m/s, d: m/s², θ: 1 |
//! | P | `covariances` | n×n, one or three | products of those |
//! | z | | (v, a_u, lags) | |
//! | ψ(z) | `features` | n, 0 beside the weights' rows | m/s² |
//! | ρ, λ | `noise_levels` | 1 | factors of r² and of q, σ_d² |
//! | g, ψ̄, E | `excitation` | 1, n, 1 | 1, m/s², (m/s²)² |
//!
//! A sample is an [`update`](filter::JointFilter::update_velocity), then a [`predict`](filter::JointFilter::predict) to the next stamp. A
//! missing sample is the prediction alone.
//!
//! # Source
//! The model, the two noise levels and the excitation are ours; docs/method.md derives them.

pub(crate) mod accelerometer;
pub(crate) mod axes;
pub(crate) mod command;
pub(crate) mod covariance;
pub(crate) mod design;
pub(crate) mod excitation;
pub(crate) mod features;
pub(crate) mod filter;
pub(crate) mod lags;
pub(crate) mod noise_levels;
pub(crate) mod predict;
pub(crate) mod rows;
pub(crate) mod sensor;
pub(crate) mod slope;
pub(crate) mod state;
pub(crate) mod stray;
pub(crate) mod teaches;
pub(crate) mod turn;
pub(crate) mod update;

#[cfg(test)]
pub(crate) mod tests;
