//! The report of a demo: a table and a figure, or one JSON document.

use super::errors::{Quantity, RmsMax, Run, quaternion, truth_at};
use super::faults::FaultReport;
use super::outages::{COMPARED, OutageReport, SUFFIXES};
use crate::harness::latency::latency_table;
use crate::harness::output::table;
use crate::plot::{Line, LineStyle, Panel};
use serde_json::{Map, Value, json};
use shared_types::Truth;
use shared_types::outln;
use shared_types::payload::{Estimate, Rejection, Status};
use sim_publisher::Scenario;
use std::path::PathBuf;

/// Everything that was measured.
pub(super) struct Report {
    pub(super) scenario: &'static str,
    pub(super) preset: &'static str,
    pub(super) rate_hz: f64,
    pub(super) duration_s: f64,
    pub(super) samples_sent: u64,
    pub(super) status: Status,
    /// Over the second half, of the three that are compared.
    pub(super) errors: [(Quantity, [Option<RmsMax>; 3]); 6],
    /// Of the faults that were asked for.
    pub(super) faults: Option<FaultReport>,
    pub(super) outages: Option<OutageReport>,
}

impl Report {
    pub(super) fn print(&self, plots: &[PathBuf]) {
        let status = &self.status;
        outln!(
            "{} with preset {}: {:.1} s at {} Hz, service and vehicle as two processes\n",
            self.scenario,
            self.preset,
            self.duration_s,
            self.rate_hz
        );
        let rows = self.errors.iter().filter_map(|&(quantity, errors)| {
            errors[0]?;
            let cells = errors.iter().flat_map(|error| {
                let number = |value: fn(&RmsMax) -> f64| {
                    error.as_ref().map_or("-".into(), |error| format!("{:.4}", value(error)))
                };
                [number(|error| error.rms), number(|error| error.max)]
            });
            Some(std::iter::once(quantity.names().0.to_owned()).chain(cells).collect::<Vec<_>>())
        });
        let columns = COMPARED.iter().flat_map(|whose| [format!("{whose}\nRMS"), "\nmax".into()]);
        let header: Vec<String> = std::iter::once("error, second half".into()).chain(columns).collect();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        outln!("{}", table(&header, 1, rows));
        outln!("Kalman filter: velocity and a random-walk force, the best of 17 tunings for each row\n");
        if let Some(outages) = &self.outages {
            outages.print();
        }
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
        plots.iter().for_each(|plot| outln!("{}", plot.display()));
    }

    /// The document of `--json`; a quantity that the scenario does not have is null, with its reason.
    pub(super) fn json(&self, plots: &[PathBuf]) -> Value {
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
            for (suffix, error) in SUFFIXES.into_iter().zip(errors) {
                for (statistic, pick) in [("rms", (|e| e.rms) as fn(RmsMax) -> f64), ("max", |e| e.max)] {
                    let key = quantity.names().1.replace("{}", statistic) + suffix;
                    match error {
                        Some(error) => put(key, pick(*error).into()),
                        None => {
                            let reason = match errors[0] {
                                Some(_) => "the compared filter has no rotation".into(),
                                None => format!("scenario {} has no such channel", self.scenario),
                            };
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
        if let Some(outages) = &self.outages {
            outages.put_json(&mut document);
        }
        let plots: Vec<String> = plots.iter().map(|plot| plot.display().to_string()).collect();
        document.insert("plots".into(), json!(plots));
        Value::Object(document)
    }
}

/// The figure: what is estimated against what is true.
pub(super) fn panels(
    run: &Run,
    without: &[Estimate],
    filter: Option<&[Estimate]>,
    scenario: Scenario,
) -> Vec<Panel> {
    let panel = |label: &str,
                 of_truth: fn(&Truth) -> f64,
                 of_estimate: fn(&Estimate) -> f64,
                 compare: bool| {
        let truth = run.truths.iter().map(|truth| (run.seconds(truth.stamp_ns), of_truth(truth))).collect();
        let curve = |estimates: &[Estimate]| {
            estimates.iter().map(|estimate| (run.seconds(estimate.stamp_ns), of_estimate(estimate))).collect()
        };
        let mut lines = vec![Line::new("truth", LineStyle::Truth, truth)];
        if let Some(filter) = filter.filter(|_| compare) {
            lines.push(Line::new("Kalman filter", LineStyle::Comparison, curve(filter)));
        }
        if compare {
            lines.push(Line::new("without learning", LineStyle::Comparison, curve(without)));
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
        let filter = filter.map(|filter| Line::new("Kalman filter", LineStyle::Comparison, curve(filter)));
        let without = Line::new("without learning", LineStyle::Comparison, curve(without));
        let own = Line::new("estimate", LineStyle::Estimate, curve(&run.estimates));
        Panel::new(label, filter.into_iter().chain([without, own]).collect())
    };
    let translation = || {
        vec![
            panel("position x (m)", |t| t.position_m[0], |e| e.position_m[0], true),
            panel("velocity x (m/s)", |t| t.velocity_m_s[0], |e| e.velocity_m_s[0], true),
            panel("force x (N)", |t| t.matched_force_n[0], |e| e.matched_force_n[0], true),
            panel("force y (N)", |t| t.matched_force_n[1], |e| e.matched_force_n[1], true),
            panel("force z (N)", |t| t.matched_force_n[2], |e| e.matched_force_n[2], true),
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
