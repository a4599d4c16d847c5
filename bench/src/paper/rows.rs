//! One row of a run, and the table as a file.
//!
//! Row j is taken at t_j *before* sample j is used:
//!
//! | columns | what | unit (translation; rotation) |
//! |---|---|---|
//! | `t_s` | t_j | s |
//! | `r1` … `r3`; `phi`, `theta`, `psi` | true position; true 3-2-1 Euler angles in (−π, π] | m; rad |
//! | `v1` … `v3`; `w1` … `w3` | true velocity, inertial; true angular velocity, body axes | m/s; rad/s |
//! | the same with `_hat` | the estimate for t_j | |
//! | `f1` … `f3` | f at the true state, wherever the plant feels it | N; N·m |
//! | `f1_hat` … `f3_hat` | f̂(y_j) as used in the step from t_j | N; N·m |
//! | `output_error` | ‖ỹ_j‖ | m/s; rad/s |
//! | `sigma` | σ as used | that of ỹ for the quadratic shape, else 1 |
//! | `coverage` | P_N(y_j), from 0 to √κ(0) | 1 |

use super::settings::Example;
use nalgebra::Vector3;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Numbers in a row.
pub const N_COLUMNS: usize = 22;

/// Pose and rate at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Position (m), or 3-2-1 Euler angles in (−π, π] (rad).
    pub pose: Vector3<f64>,
    /// Velocity (m/s), or angular velocity (rad/s).
    pub rate: Vector3<f64>,
}

/// Truth, estimate and the observer's quantities at one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// t_j (s).
    pub t_s: f64,
    /// The truth at t_j.
    pub truth: Motion,
    /// The estimate for t_j, before sample j is used.
    pub estimate: Motion,
    /// f at the true state (N; N·m).
    pub force: Vector3<f64>,
    /// f̂(y_j), as used in the step from t_j (N; N·m).
    pub force_estimate: Vector3<f64>,
    /// y_j (m/s; rad/s); not a column of the table.
    pub output: Vector3<f64>,
    /// ‖ỹ_j‖ (m/s; rad/s).
    pub output_error: f64,
    /// σ as used.
    pub activation: f64,
    /// P_N(y_j), from 0 to √κ(0).
    pub power_function: f64,
}

impl Row {
    /// The row's numbers, in the order of [`columns`].
    pub fn values(&self) -> [f64; N_COLUMNS] {
        let vectors = [
            self.truth.pose,
            self.truth.rate,
            self.estimate.pose,
            self.estimate.rate,
            self.force,
            self.force_estimate,
        ];
        let mut values = [0.0; N_COLUMNS];
        values[0] = self.t_s;
        for (place, value) in values[1..].iter_mut().zip(vectors.iter().flatten()) {
            *place = *value;
        }
        values[19..].copy_from_slice(&[self.output_error, self.activation, self.power_function]);
        values
    }
}

/// The columns' names.
pub fn columns(example: Example) -> Vec<&'static str> {
    let names = match example {
        Example::Translation => {
            "t_s r1 r2 r3 v1 v2 v3 r1_hat r2_hat r3_hat v1_hat v2_hat v3_hat f1 f2 f3 f1_hat f2_hat f3_hat \
             output_error sigma coverage"
        }
        Example::Rotation => {
            "t_s phi theta psi w1 w2 w3 phi_hat theta_hat psi_hat w1_hat w2_hat w3_hat f1 f2 f3 f1_hat f2_hat \
             f3_hat output_error sigma coverage"
        }
    };
    names.split(' ').collect()
}

/// Writes the rows as comma-separated values under one line of names.
///
/// Every number has the fewest digits that read back as the same f64.
///
/// # Errors
/// The file cannot be written.
pub fn write(file: &Path, example: Example, rows: &[Row]) -> io::Result<()> {
    let mut table = BufWriter::new(File::create(file)?);
    writeln!(table, "{}", columns(example).join(","))?;
    for row in rows {
        // Of the two formats that keep every bit, `{:?}` is the one that writes 5e-8 and not 0.00000005.
        let values = row.values().map(|value| format!("{value:?}"));
        writeln!(table, "{}", values.join(","))?;
    }
    table.flush()
}
