//! The paper's figures: truth and estimate against time, one panel for each axis.

use super::rows::{Motion, Row};
use super::settings::Example;
use crate::plot::{Figure, Line, LineStyle, PageSize, Panel};
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

/// Draws the figures of an example into a directory, each as SVG, and returns the files.
pub(super) fn draw(directory: &Path, example: Example, rows: &[Row]) -> anyhow::Result<Vec<PathBuf>> {
    let pose: fn(&Motion) -> Vector3<f64> = |motion| motion.pose;
    let rate: fn(&Motion) -> Vector3<f64> = |motion| motion.rate;
    let figures = match example {
        Example::Translation => vec![("position", ["r₁ (m)", "r₂ (m)", "r₃ (m)"], pose)],
        Example::Rotation => vec![
            ("euler_angles", ["φ (rad)", "θ (rad)", "ψ (rad)"], pose),
            ("angular_rate", ["ω₁ (rad/s)", "ω₂ (rad/s)", "ω₃ (rad/s)"], rate),
        ],
    };
    let mut files = Vec::new();
    for (name, labels, of) in figures {
        let panel = |axis: usize| {
            let curve = |motion: fn(&Row) -> &Motion| -> Vec<(f64, f64)> {
                let points = rows.iter().map(|row| (row.t_s, of(motion(row))[axis]));
                if name == "euler_angles" { without_wraps(points) } else { points.collect() }
            };
            let truth = curve(|row| &row.truth);
            let estimate = curve(|row| &row.estimate);
            let lines = vec![
                Line::new("truth", LineStyle::Truth, truth),
                Line::new("estimate", LineStyle::Estimate, estimate),
            ];
            Panel::new(labels[axis], lines)
        };
        // A paper has the title below the figure.
        let figure = Figure::new("", "time (s)", [0, 1, 2].map(panel).to_vec());
        let file = directory.join(format!("{name}.svg"));
        Figure { page: PageSize::Column, ..figure }.write(&file)?;
        files.push(file);
    }
    Ok(files)
}

/// The points with a gap where an angle jumps from one side of ±π to the other; the curve reaches ±π on both.
fn without_wraps(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut curve: Vec<(f64, f64)> = Vec::new();
    for (t, angle) in points {
        if let Some(&(before_t, before)) = curve.last().filter(|(_, before)| (angle - before).abs() > PI) {
            let side = PI.copysign(before);
            // The angle goes on from `before` through `side` to where it would be without the wrap.
            let unwrapped = angle + TAU.copysign(before);
            let share = ((side - before) / (unwrapped - before)).clamp(0.0, 1.0);
            let crossing = before_t + share * (t - before_t);
            curve.extend([(crossing, side), (crossing, f64::NAN), (crossing, -side)]);
        }
        curve.push((t, angle));
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of slope 2 that leaves at the top and comes back from below, and its mirror image.
    #[test]
    fn a_wrapped_angle_leaves_a_gap_at_pi_and_no_vertical_line() {
        for sign in [1.0, -1.0] {
            let angle = |t: f64| sign * (2.0 * t + PI).rem_euclid(TAU) - sign * PI;
            let times = (0..60).map(|i| f64::from(i) * 0.1);
            let curve = without_wraps(times.map(|t| (t, angle(t))));
            let gaps: Vec<_> = curve.iter().filter(|point| point.1.is_nan()).collect();
            assert_eq!(gaps.len(), 2, "2 · 5.9 rad pass π twice");
            assert!((gaps[0].0 - PI / 2.0).abs() < 1e-12 && (gaps[1].0 - 3.0 * PI / 2.0).abs() < 1e-12);
            for run in curve.split(|point| point.1.is_nan()) {
                for ends in run.windows(2) {
                    let slope = (ends[1].1 - ends[0].1) / (ends[1].0 - ends[0].0);
                    assert!((slope - 2.0 * sign).abs() < 1e-9 || ends[0].0 == ends[1].0, "{slope}");
                }
            }
        }
    }
}
