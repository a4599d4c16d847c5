//! Errors of a run, and their table.

use super::rows::Row;
use super::run::Run;
use super::settings::{Example, FeltAt, Initial, Scheme, Settings, Shape};
use crate::harness::output::table;
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Map, Value, json};
use shared_types::outln;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// Root of the mean square of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rms {
    /// Of each axis.
    pub axes: [f64; 3],
    /// Of the norm.
    pub norm: f64,
}

/// The same over two parts of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parts {
    /// All rows.
    pub whole_run: Rms,
    /// The rows from half the duration on.
    pub second_half: Rms,
}

/// Everything that is reported of a run.
#[derive(Debug, Clone, Copy)]
pub struct Report {
    settings: Settings,
    n_samples: usize,
    /// Of the position (m), or of the Euler angles, the shorter way round (rad).
    pub pose: Parts,
    /// Of the velocity (m/s), or of the angular velocity (rad/s).
    pub rate: Parts,
    /// Of f̂(y_j) against f at the true state (N; N·m).
    pub force: Parts,
    /// Of the measured velocity, for comparison (m/s; rad/s).
    pub measured_rate: Parts,
    /// Of f itself, for comparison: the error where nothing is learned (N; N·m).
    pub true_force: Parts,
    /// Largest ‖ỹ‖ (m/s; rad/s).
    pub largest_output_error: f64,
    /// Mean of σ.
    pub mean_activation: f64,
    /// Part of the samples with σ > 0.
    pub learning_share: f64,
    n_clamped: usize,
}

/// The difference of two angles, the shorter way round: in [−π, π] (rad).
pub fn wrapped(difference_rad: f64) -> f64 {
    difference_rad - TAU * (difference_rad / TAU).round()
}

fn rms<'a>(rows: impl Iterator<Item = &'a Row>, error: impl Fn(&Row) -> Vector3<f64>) -> Rms {
    let (mut squares, mut n) = (Vector3::<f64>::zeros(), 0.0);
    for row in rows {
        squares += error(row).map(|axis| axis * axis);
        n += 1.0;
    }
    let mean = squares / n;
    Rms { axes: mean.map(f64::sqrt).into(), norm: mean.sum().sqrt() }
}

impl Report {
    /// The errors of a run with these settings.
    pub fn new(settings: &Settings, run: &Run) -> Self {
        let rows = &run.rows;
        let half_s = settings.duration_s / 2.0;
        let parts = |error: fn(&Row) -> Vector3<f64>| Parts {
            whole_run: rms(rows.iter(), error),
            second_half: rms(rows.iter().filter(|row| row.t_s >= half_s), error),
        };
        let n = rows.len() as f64;
        Self {
            settings: *settings,
            n_samples: rows.len(),
            pose: match settings.example {
                Example::Translation => parts(|row| row.estimate.pose - row.truth.pose),
                Example::Rotation => parts(|row| (row.estimate.pose - row.truth.pose).map(wrapped)),
            },
            rate: parts(|row| row.estimate.rate - row.truth.rate),
            force: parts(|row| row.force_estimate - row.force),
            measured_rate: parts(|row| row.output - row.truth.rate),
            true_force: parts(|row| row.force),
            largest_output_error: rows.iter().map(|row| row.output_error).fold(0.0, f64::max),
            mean_activation: rows.iter().map(|row| row.activation).sum::<f64>() / n,
            learning_share: rows.iter().filter(|row| row.activation > 0.0).count() as f64 / n,
            n_clamped: run.n_clamped,
        }
    }

    /// The document of `--json`.
    pub fn json(&self, files: &[PathBuf]) -> Value {
        let settings = &self.settings;
        let (rate_unit, adaptation_unit) = match settings.example {
            Example::Translation => ("m_s", "kg_s2"),
            Example::Rotation => ("rad_s", "n_m"),
        };
        let [pose, rate, force] = match settings.example {
            Example::Translation => ["position_rms_m", "velocity_rms_m_s", "force_rms_n"],
            Example::Rotation => ["euler_angle_rms_rad", "angular_velocity_rms_rad_s", "torque_rms_n_m"],
        };
        let entries = [
            ("scenario".into(), json!(settings.example.scenario().name())),
            ("dead_zone".into(), json!(settings.dead_zone)),
            (format!("width_{rate_unit}"), json!(settings.width)),
            (format!("buffer_{rate_unit}"), json!(settings.buffer)),
            (format!("adaptation_rate_{adaptation_unit}"), json!(settings.adaptation_rate)),
            ("kernel_order".into(), json!(settings.kernel_order)),
            (format!("length_scale_{rate_unit}"), json!(settings.length_scale)),
            ("gain_per_s".into(), json!(settings.gain_per_s)),
            ("initial".into(), json!(settings.initial)),
            ("rate_hz".into(), json!(settings.rate_hz)),
            ("duration_s".into(), json!(settings.duration_s)),
            ("scheme".into(), json!(settings.scheme)),
            ("f_at".into(), json!(settings.felt_at)),
            ("samples".into(), json!(self.n_samples)),
            (pose.into(), json!(self.pose)),
            (rate.into(), json!(self.rate)),
            (force.into(), json!(self.force)),
            (format!("measured_{rate}"), json!(self.measured_rate)),
            (format!("true_{force}"), json!(self.true_force)),
            (format!("output_error_max_{rate_unit}"), json!(self.largest_output_error)),
            ("sigma_mean".into(), json!(self.mean_activation)),
            ("learning_share".into(), json!(self.learning_share)),
            ("sigma_clamped_steps".into(), json!(self.n_clamped)),
            ("files".into(), files.iter().map(|file| file.display().to_string()).collect()),
        ];
        Value::Object(Map::from_iter(entries))
    }

    /// The summary.
    pub fn print(&self, files: &[PathBuf]) {
        let settings = &self.settings;
        let Settings { width, buffer, adaptation_rate, length_scale, gain_per_s, .. } = settings;
        let (rate_unit, adaptation_unit, axes) = match settings.example {
            Example::Translation => ("m/s", "kg/s²", ["1", "2", "3"]),
            Example::Rotation => ("rad/s", "N·m", ["1 (φ)", "2 (θ)", "3 (ψ)"]),
        };
        outln!(
            "{}: {} s at {} Hz, {} samples; estimate from {}, {}, f at the {} velocity",
            settings.example.scenario().name(),
            settings.duration_s,
            settings.rate_hz,
            self.n_samples,
            match settings.initial {
                Initial::Reference => "the true start",
                Initial::ZeroVelocity => "velocity zero",
            },
            match settings.scheme {
                Scheme::UpdateFirst => "update first",
                Scheme::PredictFirst => "predict first",
            },
            match settings.felt_at {
                FeltAt::True => "true",
                FeltAt::Measured => "measured",
            },
        );
        let dead_zone = match settings.dead_zone {
            Shape::Quadratic => format!("quadratic, d = {width} {rate_unit}, ε = {buffer} {rate_unit}"),
            Shape::Saturated => format!("saturated, d = {width} {rate_unit}, ε = {buffer} {rate_unit}"),
            Shape::Step => format!("step, d = {width} {rate_unit}"),
        };
        outln!(
            "σ {dead_zone}; Γ_f = {adaptation_rate} {adaptation_unit}; λ = {gain_per_s} /s; kernel order {}, ℓ = {length_scale} {rate_unit}\n",
            settings.kernel_order,
        );

        let quantities = match settings.example {
            Example::Translation => [
                ("position (m)", self.pose),
                ("velocity (m/s)", self.rate),
                ("  as measured", self.measured_rate),
                ("unknown force (N)", self.force),
                ("  taken for zero", self.true_force),
            ],
            Example::Rotation => [
                ("Euler angles (rad)", self.pose),
                ("angular velocity (rad/s)", self.rate),
                ("  as measured", self.measured_rate),
                ("unknown torque (N·m)", self.force),
                ("  taken for zero", self.true_force),
            ],
        };
        let rows = quantities.into_iter().flat_map(|(name, parts)| {
            [(name, "whole run", parts.whole_run), ("", "second half", parts.second_half)]
        });
        let rows = rows.map(|(name, part, rms)| {
            let numbers = rms.axes.into_iter().chain([rms.norm]).map(four_digits);
            [name.to_owned(), part.to_owned()].into_iter().chain(numbers)
        });
        let header = [&["RMS error", "part"], axes.as_slice(), &["norm"]].concat();
        outln!("{}", table(&header, 2, rows));

        if self.learning_share == 0.0 {
            outln!("nothing was learned: no output error left the dead zone");
        }
        outln!(
            "largest ‖ỹ‖: {} {rate_unit}; σ > 0 in {:.1} % of the samples; mean of Γ_f σ: {} {}",
            four_digits(self.largest_output_error),
            100.0 * self.learning_share,
            four_digits(adaptation_rate * self.mean_activation),
            // The quadratic σ carries the unit of ỹ.
            match (settings.dead_zone, settings.example) {
                (Shape::Quadratic, Example::Translation) => "kg·m/s³",
                (Shape::Quadratic, Example::Rotation) => "N·m·rad/s",
                _ => adaptation_unit,
            }
        );
        if self.n_clamped > 0 {
            outln!(
                "σ was held down in {} steps, in which the sampled law would have been unstable",
                self.n_clamped
            );
        }
        for file in files {
            outln!("{}", file.display());
        }
    }
}

/// Four significant digits.
fn four_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    match value.abs().log10().floor() as i32 {
        power @ -4..=3 => format!("{value:.*}", (3 - power) as usize),
        _ => format!("{value:.3e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::rows::Motion;

    fn row(t_s: f64, error: f64) -> Row {
        let at = |pose: f64| Motion { pose: Vector3::new(pose, 0.0, 0.0), rate: Vector3::zeros() };
        Row {
            t_s,
            truth: at(3.0),
            estimate: at(3.0 + error),
            force: Vector3::zeros(),
            force_estimate: Vector3::zeros(),
            output: Vector3::zeros(),
            output_error: 0.0,
            activation: 0.0,
            power_function: 0.0,
        }
    }

    #[test]
    fn the_second_half_begins_at_half_the_duration() {
        let settings = Settings {
            example: Example::Rotation,
            dead_zone: Shape::Step,
            width: 0.0,
            buffer: 1.0,
            adaptation_rate: 1.0,
            kernel_order: 3,
            length_scale: 1.0,
            gain_per_s: 1.0,
            initial: Initial::Reference,
            rate_hz: 1.0,
            duration_s: 4.0,
            scheme: Scheme::UpdateFirst,
            felt_at: FeltAt::True,
        };
        // The last error is a turn and −0.4.
        let rows = vec![row(0.0, 0.5), row(1.0, 0.7), row(2.0, 0.3), row(3.0, TAU - 0.4)];
        let pose = Report::new(&settings, &Run { rows, n_clamped: 0 }).pose;
        // 0.25 + 0.49 + 0.09 + 0.16 = 0.99, by hand.
        assert!((pose.whole_run.axes[0] - (0.99f64 / 4.0).sqrt()).abs() < 1e-14);
        assert!((pose.second_half.axes[0] - (0.25f64 / 2.0).sqrt()).abs() < 1e-14);
        assert_eq!((pose.whole_run.axes[1], pose.whole_run.norm), (0.0, pose.whole_run.axes[0]));
    }

    #[test]
    fn angles_on_both_sides_of_pi_differ_by_little() {
        assert!((wrapped(-3.1 - 3.1) - (TAU - 6.2)).abs() < 1e-15);
        assert!((wrapped(3.1 + 3.1) - (6.2 - TAU)).abs() < 1e-15);
        assert_eq!(wrapped(0.5), 0.5);
    }

    #[test]
    fn numbers_have_four_digits() {
        let shown = [1.234567, 0.0123456, 1234.56, 1.2e-7, 0.0, 12345.0].map(four_digits);
        assert_eq!(shown, ["1.235", "0.01235", "1235", "1.200e-7", "0", "1.234e4"]);
    }
}
