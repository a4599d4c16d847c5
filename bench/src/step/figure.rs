//! Latency over N, on logarithmic axes.

use super::report::{Rival, Row};
use super::subject::Solver;
use crate::plot::{Figure, Line, LineStyle, Panel};
use std::path::Path;

/// Draws all contestants, with the slopes N and N² for comparison.
pub(super) fn draw(file: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let mut rows: Vec<&Row> = rows.iter().collect();
    rows.sort_by_key(|row| row.n_centers);
    let mut lines = Vec::new();
    let mut add = |label: &str, style, latency_ns: &dyn Fn(&Row) -> Option<f64>| {
        let point = |row: &&Row| Some((row.n_centers as f64, 1e-3 * latency_ns(row)?));
        let points: Vec<_> = rows.iter().filter_map(point).collect();
        if !points.is_empty() {
            lines.push(Line::new(label, style, points));
        }
    };
    for solver in Solver::ALL {
        let of_solver = |row: &Row, ns: f64| (row.solver == solver).then_some(ns);
        add(&format!("{solver}, median"), LineStyle::Estimate, &|row| of_solver(row, row.median_ns()));
        add(&format!("{solver}, p99"), LineStyle::Estimate, &|row| of_solver(row, row.p99_ns()));
    }
    let ns = |rival: &Result<Rival, String>| rival.as_ref().ok().map(|rival| rival.median_ns as f64);
    add("literal formula", LineStyle::Comparison, &|row| ns(&row.literal));
    add("Kalman filter", LineStyle::Comparison, &|row| Some(row.kalman.median_ns as f64));
    // The slopes start where the dense step does, and end where it ends.
    let dense: Vec<_> = rows.iter().filter(|row| row.solver == Solver::Dense).collect();
    if let (Some(first), Some(last)) = (dense.first(), dense.last()) {
        let scaled = |from: &Row, row: &Row, power: i32| {
            let ns = from.median_ns() * (row.n_centers as f64 / from.n_centers as f64).powi(power);
            (row.solver == Solver::Dense).then_some(ns)
        };
        add("∝ N", LineStyle::Guide, &|row| scaled(first, row, 1));
        add("∝ N²", LineStyle::Guide, &|row| scaled(last, row, 2));
    }
    let panel = Panel { log_y: true, ..Panel::new("latency of one step (µs)", lines) };
    let title = "One step of a channel by number of centers";
    Figure { log_x: true, ..Figure::new(title, "number of centers N", vec![panel]) }.write(file)
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::row;
    use super::*;

    #[test]
    fn contestants_that_were_not_run_are_not_in_the_legend() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("step.svg");
        draw(&file, &[row(10), row(100), row(1000)]).unwrap();
        let svg = std::fs::read_to_string(file).unwrap();
        for label in ["dense, median", "literal formula", "Kalman filter", "∝ N²"] {
            assert!(svg.contains(label), "{label}");
        }
        assert!(!svg.contains("local"));
    }
}
