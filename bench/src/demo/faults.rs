//! The effect of each fault of a demo: the largest error, the time until the estimate is back, and the service's counters.
//!
//! The reference is the same run without faults: the simulation with the same seed through the same library, at the
//! instants of the recorded estimates. Its RMS error from 2 s before a fault to 2 s after it is the fault's *fault-free
//! level*. The estimate is *back* at the first instant after the fault from which on its RMS error over 0.5 s is at most
//! 1.5 times that level. The RMS error from 2 s to 5 s after the fault, or until the next one, shows lasting effects.

use super::errors::{Quantity, Run};
use crate::harness::output::table;
use crate::plot::{Line, LineStyle, Panel, Shade};
use anyhow::{Context, bail};
use daemon::config::ConfigFile;
use observer::Learn;
use serde_json::{Map, Value, json};
use shared_types::outln;
use shared_types::payload::{Estimate, Measurement, Rejection, Status};
use sim_publisher::faults::{Fault, Reach};
use sim_publisher::{Simulation, SimulationOptions};

/// Before and after a fault, the time over which the fault-free level is taken (s).
const AROUND_S: f64 = 2.0;
/// The estimate is back when its RMS over this time (s) …
const WINDOW_S: f64 = 0.5;
/// … is at most this many times the fault-free level.
const BACK_WITHIN: f64 = 1.5;
/// The service's counts until then (s) are attributed to the fault, unless another one starts before.
const COUNTED_FOR_S: f64 = 2.0;
/// Lasting effects of a fault are measured from then on (s) …
const AFTERWARDS_S: f64 = 2.0;
/// … until then (s).
const AFTERWARDS_END_S: f64 = 5.0;

/// The estimates of the same run without faults, at the instants of the run's own.
pub(super) fn without_faults(
    run: &Run,
    options: &SimulationOptions,
    config: &ConfigFile,
) -> anyhow::Result<Vec<Estimate>> {
    let start_ns = run.truths[0].stamp_ns;
    let measured = Simulation::new(options)?.filter_map(|sample| sample.measurement);
    let measured = measured.map(|sample| Measurement { stamp_ns: start_ns + sample.stamp_ns, ..sample });
    let taken_at_ns = |sample: &Measurement, estimate: &Estimate| {
        (sample.stamp_ns <= estimate.stamp_ns).then_some(sample.stamp_ns)
    };
    run.flown_again(config, measured, taken_at_ns, Learn::ALL)
}

/// An error over time: (s after the start, error), in the order of time.
type Curve = Vec<(f64, f64)>;

fn between(curve: &Curve, from_s: f64, to_s: f64) -> &[(f64, f64)] {
    let start = curve.partition_point(|point| point.0 < from_s);
    let end = curve.partition_point(|point| point.0 <= to_s);
    &curve[start..end.max(start)]
}

fn rms(points: &[(f64, f64)]) -> Option<f64> {
    let sum: f64 = points.iter().map(|point| point.1 * point.1).sum();
    (!points.is_empty()).then(|| (sum / points.len() as f64).sqrt())
}

/// The first instant from `from_s` on, at most `until_s`, from which on the RMS over a window is within the limit.
fn back_at(curve: &Curve, limit: f64, from_s: f64, until_s: f64) -> Option<f64> {
    let candidates = between(curve, from_s, until_s - WINDOW_S).iter();
    candidates
        .map(|point| point.0)
        .find(|&t_s| rms(between(curve, t_s, t_s + WINDOW_S)).is_some_and(|rms| rms <= limit))
}

/// Everything that the service counts beside its ticks and the samples it used, by name.
fn counters(status: &Status) -> Vec<(String, u64)> {
    let rejected = Rejection::ALL.into_iter().map(|reason| {
        (format!("rejected_{}", reason.words().replace(' ', "_")), status.counters.rejected(reason))
    });
    let others = [
        ("samples_lost", status.counters.samples_lost),
        ("velocities_held_back", status.counters.outputs_held_back[0]),
        ("angular_velocities_held_back", status.counters.outputs_held_back[1]),
        ("velocities_stuck", status.counters.outputs_stuck[0]),
        ("angular_velocities_stuck", status.counters.outputs_stuck[1]),
        ("ticks_coasting", status.counters.ticks_coasting),
        ("ticks_clamped", status.counters.ticks_clamped),
        ("state_resets", status.counters.state_resets),
        ("source_changes", status.counters.source_changes),
        ("deadline_misses", status.counters.deadline_misses),
    ];
    others.into_iter().map(|(name, count)| (name.to_owned(), count)).chain(rejected).collect()
}

/// The counters that increased from one status to another; a service that started in between counts from 0.
fn rises(before: &Status, after: &Status) -> Vec<(String, u64)> {
    let restarted = before.start_stamp_ns != after.start_stamp_ns;
    let before = if restarted { Status::default() } else { *before };
    let pairs = counters(&before).into_iter().zip(counters(after));
    let risen = pairs.map(|((name, before), (_, after))| (name, after.saturating_sub(before)));
    let restart = restarted.then(|| ("service_starts".to_owned(), 1));
    restart.into_iter().chain(risen.filter(|(_, count)| *count > 0)).collect()
}

/// A fault's effect on one error.
#[derive(Debug, Clone, Copy)]
struct Judged {
    worst: Option<f64>,
    rms_before: Option<f64>,
    fault_free: Option<f64>,
    rms_afterwards: Option<f64>,
    /// After the fault's end (s).
    back_after_s: Option<f64>,
}

/// The effect of one fault.
#[derive(Debug, Clone)]
struct Effect {
    fault: Fault,
    /// `None` where no samples are concerned: a fault of the service.
    samples: Option<u64>,
    /// On the motion's error, and on the learned force's.
    on: [Judged; 2],
    rises: Vec<(String, u64)>,
}

/// The error of one quantity with faults, and in the same run without.
#[derive(Debug)]
struct Errors {
    quantity: Quantity,
    with: Curve,
    without: Curve,
}

impl Errors {
    fn new(run: &Run, without: &[Estimate], quantity: Quantity) -> Self {
        let curve = |estimates: &[Estimate]| -> Curve {
            let point = |e: &Estimate| Some((run.seconds(e.stamp_ns), quantity.error(&run.truths, e)?));
            estimates.iter().filter_map(point).collect()
        };
        Self { quantity, with: curve(&run.estimates), without: curve(without) }
    }

    /// The effect of a fault from `start_s` to `end_s`; what is after `until_s` belongs to another.
    fn judge(&self, start_s: f64, end_s: f64, until_s: f64) -> Judged {
        let with = &self.with;
        let fault_free = rms(between(&self.without, start_s - AROUND_S, end_s + AROUND_S));
        let back_s =
            fault_free.and_then(|level| back_at(with, BACK_WITHIN * level, end_s, until_s.max(end_s)));
        let worst = between(with, start_s, back_s.unwrap_or(until_s.max(end_s)));
        let afterwards = between(with, end_s + AFTERWARDS_S, until_s.min(end_s + AFTERWARDS_END_S));
        Judged {
            worst: worst.iter().map(|point| point.1).reduce(f64::max),
            rms_before: rms(between(with, start_s - AROUND_S, start_s)),
            fault_free,
            rms_afterwards: rms(afterwards),
            back_after_s: back_s.map(|back_s| back_s - end_s),
        }
    }

    /// The evaluated error, with its unit.
    fn label(&self) -> String {
        let (name, _) = self.quantity.names();
        name.replacen(" (", " error (", 1)
    }
}

/// The effects of all faults of a run.
#[derive(Debug)]
pub(super) struct FaultReport {
    /// Of velocity and force, or of angular velocity and torque where there is no translation.
    errors: [Errors; 2],
    effects: Vec<Effect>,
    estimates_not_finite: usize,
}

impl FaultReport {
    /// From the run, the same run without faults, the recorded statuses, and the vehicle's report on each of its faults.
    pub(super) fn new(
        run: &Run,
        without: &[Estimate],
        faults: &[Fault],
        statuses: &[Status],
        summary: &Value,
    ) -> anyhow::Result<Self> {
        let judged = match run.estimates.iter().any(|estimate| estimate.translation.error_bound > 0.0) {
            true => [Quantity::Velocity, Quantity::Force],
            false => [Quantity::AngularVelocity, Quantity::Torque],
        };
        let errors = judged.map(|quantity| Errors::new(run, without, quantity));
        let status_at = |t_s: f64| {
            let seen = statuses.iter().rev().find(|status| run.seconds(status.stamp_ns) <= t_s);
            seen.copied().unwrap_or_default()
        };
        let starts: Vec<f64> = faults.iter().map(|fault| fault.span.start_s).collect();
        let tallies = summary["faults"].as_array().context("the vehicle's summary has no faults")?;
        let mut tallies = tallies.iter();
        let mut effects = Vec::with_capacity(faults.len());
        for fault in faults {
            let (start_s, end_s) = (fault.span.start_s, fault.span.end_s().min(run.duration_s()));
            let next_s =
                starts.iter().copied().filter(|&other_s| other_s > start_s).fold(f64::INFINITY, f64::min);
            let until_s = next_s.min(run.duration_s());
            let samples = match fault.kind.reach() {
                Reach::Service => None,
                Reach::Samples | Reach::Source => {
                    let tally = tallies.next().context("the vehicle's summary lacks a fault")?;
                    if tally["fault"] != fault.to_string().as_str() {
                        bail!("the vehicle's summary has {} where {fault} was asked for", tally["fault"]);
                    }
                    tally["samples"].as_u64()
                }
            };
            let counted_until_s = until_s.min(fault.span.end_s() + COUNTED_FOR_S);
            effects.push(Effect {
                fault: *fault,
                samples,
                on: errors.each_ref().map(|errors| errors.judge(start_s, end_s, until_s)),
                rises: rises(&status_at(start_s), &status_at(counted_until_s)),
            });
        }
        let estimates_not_finite = run.estimates.iter().filter(|estimate| !estimate.is_finite()).count();
        Ok(Self { errors, effects, estimates_not_finite })
    }

    pub(super) fn print(&self) {
        let of = self.errors.each_ref().map(Errors::label);
        let columns = of.iter().flat_map(|label| {
            let first = format!("{label}\nworst");
            [
                first,
                "\nbefore".into(),
                "\nwithout faults".into(),
                "\nback after (s)".into(),
                "\n2 s later".into(),
            ]
        });
        let header: Vec<String> = ["".to_owned(), "fault".into(), "samples".into()]
            .into_iter()
            .chain(columns)
            .chain(["the service counted".into()])
            .collect();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.4}"));
        let row = |(i, effect): (usize, &Effect)| {
            let rises =
                effect.rises.iter().map(|(name, count)| format!("{} {count}", name.replace('_', " ")));
            let first = [
                (i + 1).to_string(),
                effect.fault.to_string().replacen(',', "\n", 1),
                effect.samples.map_or("-".into(), |samples| samples.to_string()),
            ];
            let judged = effect.on.iter().flat_map(|on| {
                let back = on.back_after_s.map_or("not seen".into(), |s| format!("{s:.2}"));
                [
                    number(on.worst),
                    number(on.rms_before),
                    number(on.fault_free),
                    back,
                    number(on.rms_afterwards),
                ]
            });
            first.into_iter().chain(judged).chain([rises.collect::<Vec<_>>().join("\n")]).collect::<Vec<_>>()
        };
        outln!("{}", table(&header, header.len(), self.effects.iter().enumerate().map(row)));
        outln!(
            "before, without faults, later: RMS; back: RMS over {WINDOW_S} s at most {BACK_WITHIN} times that of the same run without faults; \
             counted until {COUNTED_FOR_S} s after the fault or the next one\n"
        );
        if self.estimates_not_finite > 0 {
            outln!("{} estimates were not finite\n", self.estimates_not_finite);
        }
    }

    pub(super) fn put_json(&self, document: &mut Map<String, Value>) {
        let effect = |effect: &Effect| {
            let rises: Map<String, Value> =
                effect.rises.iter().map(|(name, count)| (name.clone(), (*count).into())).collect();
            let mut value = json!({
                "fault": effect.fault.to_string(),
                "kind": effect.fault.kind.name(),
                "start_s": effect.fault.span.start_s,
                "length_s": effect.fault.span.length_s,
                "samples": effect.samples,
                "counted": rises,
            });
            for ((errors, on), prefix) in self.errors.iter().zip(&effect.on).zip(["", "force_"]) {
                let key = errors.quantity.names().1.replace("{}", "error");
                value[format!("worst_{key}")] = on.worst.into();
                value[format!("rms_{key}_before")] = on.rms_before.into();
                value[format!("rms_{key}_without_faults")] = on.fault_free.into();
                value[format!("rms_{key}_afterwards")] = on.rms_afterwards.into();
                value[format!("{prefix}back_after_s")] = on.back_after_s.into();
                if on.back_after_s.is_none() {
                    value[format!("{prefix}back_after_s_reason")] =
                        "not back before the next fault or the end of the run".into();
                }
            }
            value
        };
        document.insert("faults".into(), self.effects.iter().map(effect).collect());
        document.insert("estimates_not_finite".into(), self.estimates_not_finite.into());
    }

    /// The error with and without faults.
    pub(super) fn panel(&self) -> Panel {
        let errors = &self.errors[0];
        let lines = vec![
            Line::new("with faults", LineStyle::Estimate, errors.with.clone()),
            Line::new("the same without faults", LineStyle::Comparison, errors.without.clone()),
        ];
        Panel { log_y: true, ..Panel::new(&errors.label(), lines) }
    }

    /// The faults' times, with their numbers in the table.
    pub(super) fn shades(&self) -> Vec<Shade> {
        let shade = |(i, effect): (usize, &Effect)| Shade {
            from: effect.fault.span.start_s,
            to: effect.fault.span.end_s(),
            label: (i + 1).to_string(),
        };
        self.effects.iter().enumerate().map(shade).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_is_back_where_half_a_second_stays_within_the_limit() {
        // 0.01 but for 1 … 2.3 s, and one bad point at 2.5 s.
        let error = |i: u32| match i {
            100..230 => 0.5,
            250 => 0.2,
            _ => 0.01,
        };
        let curve: Curve = (0..400).map(|i| (f64::from(i) / 100.0, error(i))).collect();
        assert_eq!(back_at(&curve, 0.015, 2.0, 4.0), Some(2.51));
        assert_eq!(back_at(&curve, 0.05, 2.0, 4.0), Some(2.3));
        assert_eq!(back_at(&curve, 0.015, 2.0, 2.9), None, "the window does not fit");
        assert_eq!(back_at(&curve, 0.005, 2.0, 4.0), None);
        assert!((rms(between(&curve, 0.0, 0.5)).unwrap() - 0.01).abs() < 1e-12);
        assert_eq!(rms(between(&curve, 5.0, 6.0)), None);
    }

    #[test]
    fn what_rose_is_named_and_a_new_service_counts_from_zero() {
        let mut before = Status { start_stamp_ns: 1, ..Status::default() };
        before.counters.samples_lost = 5;
        before.counters.samples_rejected[Rejection::NotFinite as usize] = 2;
        let mut after = before;
        (after.counters.samples_lost, after.counters.source_changes) = (9, 1);
        after.counters.samples_rejected[Rejection::RepeatedStamp as usize] = 3;
        let named = |rises: Vec<(String, u64)>| {
            rises.iter().map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
        };
        let rose = named(rises(&before, &after));
        assert_eq!(rose, "samples_lost 4, source_changes 1, rejected_repeated_stamp 3");
        let mut restarted = Status { start_stamp_ns: 2, ..Status::default() };
        restarted.counters.samples_lost = 1;
        assert_eq!(named(rises(&before, &restarted)), "service_starts 1, samples_lost 1");
    }
}
