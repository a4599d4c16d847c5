//! The report of a demo: a table and a figure, or one JSON document.

use super::errors::{Quantity, RmsMax, Run, quaternion, truth_at};
use super::faults::FaultReport;
use crate::harness::latency::latency_table;
use crate::harness::output::table;
use crate::plot::{Line, LineStyle, Panel};
use serde_json::{Map, Value, json};
use shared_types::Truth;
use shared_types::outln;
use shared_types::payload::{Estimate, Rejection, Status};
use sim_publisher::Scenario;
use std::path::Path;

/// Everything that was measured.
pub(super) struct Report {
    pub(super) scenario: &'static str,
    pub(super) preset: &'static str,
    pub(super) rate_hz: f64,
    pub(super) duration_s: f64,
    pub(super) samples_sent: u64,
    pub(super) status: Status,
    /// Over the second half, with and without adaptation.
    pub(super) errors: [(Quantity, [Option<RmsMax>; 2]); 6],
    pub(super) faults: Option<FaultReport>,
}

impl Report {
    pub(super) fn print(&self, plot: &Path) {
        let status = &self.status;
        outln!(
            "{} with preset {}: {:.1} s at {} Hz, service and vehicle as two processes\n",
            self.scenario,
            self.preset,
            self.duration_s,
            self.rate_hz
        );
        let rows = self.errors.iter().filter_map(|&(quantity, errors)| {
            let [Some(with), Some(without)] = errors else { return None };
            let cells = [with.rms, with.max, without.rms, without.max].map(|value| format!("{value:.4}"));
            Some(std::iter::once(quantity.names().0.to_owned()).chain(cells))
        });
        let header = ["error, second half", "RMS", "max", "RMS without adaptation", "max without adaptation"];
        outln!("{}\n", table(&header, 1, rows));
        outln!(
            "samples: {} sent, {} used, {} lost, {} rejected;  ticks: {}, {} deadlines missed, {} coasting",
            self.samples_sent,
            status.counters.samples_accepted,
            status.counters.samples_lost,
            status.counters.samples_rejected_total(),
            status.counters.ticks,
            status.counters.deadline_misses,
            status.counters.ticks_coasting
        );
        for reason in Rejection::ALL.into_iter().filter(|&reason| status.counters.rejected(reason) > 0) {
            outln!("  rejected: {} {}", status.counters.rejected(reason), reason.words());
        }
        let rows = [
            ("wake-up after the deadline", status.wake_up_lateness_ns),
            ("step, wake-up to publication", status.step_ns),
            ("source's stamp to publication", status.source_to_publish_ns),
        ];
        outln!("{}\n", latency_table("latency (µs)", rows));
        if let Some(faults) = &self.faults {
            faults.print();
        }
        outln!("{}", plot.display());
    }

    /// The document of `--json`; a quantity that the scenario does not have is null, with its reason.
    pub(super) fn json(&self, plot: &Path) -> Value {
        let status = &self.status;
        let mut document = Map::new();
        let mut put = |key: String, value: Value| document.insert(key, value);
        put("scenario".into(), self.scenario.into());
        put("preset".into(), self.preset.into());
        put("duration_s".into(), self.duration_s.into());
        put("rate_hz".into(), self.rate_hz.into());
        put("samples_sent".into(), self.samples_sent.into());
        put("samples_used".into(), status.counters.samples_accepted.into());
        put("samples_lost".into(), status.counters.samples_lost.into());
        put("samples_rejected".into(), status.counters.samples_rejected_total().into());
        put("ticks".into(), status.counters.ticks.into());
        put("deadline_misses".into(), status.counters.deadline_misses.into());
        for (quantity, errors) in &self.errors {
            for (suffix, error) in ["", "_without_adaptation"].into_iter().zip(errors) {
                for (statistic, pick) in [("rms", (|e| e.rms) as fn(RmsMax) -> f64), ("max", |e| e.max)] {
                    let key = quantity.names().1.replace("{}", statistic) + suffix;
                    match error {
                        Some(error) => put(key, pick(*error).into()),
                        None => {
                            let reason = format!("scenario {} has no such channel", self.scenario);
                            put(key.clone() + "_reason", reason.into());
                            put(key, Value::Null)
                        }
                    };
                }
            }
        }
        put("step_ns".into(), json!(status.step_ns));
        put("wake_up_lateness_ns".into(), json!(status.wake_up_lateness_ns));
        put("source_to_estimate_ns".into(), json!(status.source_to_publish_ns));
        if let Some(faults) = &self.faults {
            faults.put_json(&mut document);
        }
        let mut put = |key: String, value: Value| document.insert(key, value);
        put("plots".into(), json!([plot.display().to_string()]));
        Value::Object(document)
    }
}

/// The figure: what is estimated against what is true.
pub(super) fn panels(run: &Run, without: &[Estimate], scenario: Scenario) -> Vec<Panel> {
    let panel = |label: &str,
                 of_truth: fn(&Truth) -> f64,
                 of_estimate: fn(&Estimate) -> f64,
                 compare: bool| {
        let truth = run.truths.iter().map(|truth| (run.seconds(truth.stamp_ns), of_truth(truth))).collect();
        let curve = |estimates: &[Estimate]| {
            estimates.iter().map(|estimate| (run.seconds(estimate.stamp_ns), of_estimate(estimate))).collect()
        };
        let mut lines = vec![Line::new("truth", LineStyle::Truth, truth)];
        if compare {
            lines.push(Line::new("without adaptation", LineStyle::Comparison, curve(without)));
        }
        lines.push(Line::new("estimate", LineStyle::Estimate, curve(&run.estimates)));
        Panel::new(label, lines)
    };
    let error = |label: &str, of: fn(&Truth, &Estimate) -> f64| {
        let curve = |estimates: &[Estimate]| -> Vec<(f64, f64)> {
            let truth = |estimate: &Estimate| truth_at(&run.truths, estimate.stamp_ns);
            let errors = estimates.iter().filter_map(|e| Some((run.seconds(e.stamp_ns), of(&truth(e)?, e))));
            errors.collect()
        };
        let lines = vec![
            Line::new("without adaptation", LineStyle::Comparison, curve(without)),
            Line::new("estimate", LineStyle::Estimate, curve(&run.estimates)),
        ];
        Panel::new(label, lines)
    };
    let translation = || {
        vec![
            panel("position x (m)", |t| t.position_m[0], |e| e.position_m[0], true),
            panel("velocity x (m/s)", |t| t.velocity_m_s[0], |e| e.velocity_m_s[0], false),
            panel("force x (N)", |t| t.matched_force_n[0], |e| e.matched_force_n[0], false),
            panel("force y (N)", |t| t.matched_force_n[1], |e| e.matched_force_n[1], false),
            panel("force z (N)", |t| t.matched_force_n[2], |e| e.matched_force_n[2], false),
            error("position error (m)", |t, e| norm(t.position_m, e.position_m)),
        ]
    };
    let rotation = || {
        vec![
            panel("roll (rad)", |t| euler(t.attitude_wxyz, 0), |e| e.euler_rad[0], false),
            panel("pitch (rad)", |t| euler(t.attitude_wxyz, 1), |e| e.euler_rad[1], false),
            panel("yaw (rad)", |t| euler(t.attitude_wxyz, 2), |e| e.euler_rad[2], false),
            panel("rate x (rad/s)", |t| t.angular_velocity_rad_s[0], |e| e.angular_velocity_rad_s[0], false),
            panel("torque x (N·m)", |t| t.matched_torque_n_m[0], |e| e.matched_torque_n_m[0], false),
        ]
    };
    match scenario {
        Scenario::Translation => translation(),
        Scenario::Rotation => rotation(),
        Scenario::RigidBody | Scenario::Auv => {
            let mut panels = translation();
            panels.push(panel("roll (rad)", |t| euler(t.attitude_wxyz, 0), |e| e.euler_rad[0], false));
            panels
        }
    }
}

fn norm(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

fn euler(attitude_wxyz: [f64; 4], axis: usize) -> f64 {
    let (roll, pitch, yaw) = quaternion(attitude_wxyz).euler_angles();
    [roll, pitch, yaw][axis]
}
