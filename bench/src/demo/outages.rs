//! Times without a measured velocity: the errors at their ends, beside what the estimate says of its own error.

use super::errors::{Quantity, Run, truth_at};
use crate::harness::output::table;
use crate::plot::{Band, Figure, Line, LineStyle, Panel, Shade};
use serde_json::{Map, Value, json};
use shared_types::outln;
use shared_types::payload::Estimate;
use sim_publisher::faults::{Fault, Field, Kind};
use sim_publisher::sensors::Span;

/// Half of a 95 % interval, in deviations.
const DEVIATIONS_OF_95: f64 = 1.96;
/// The figure begins this long before the outage, and ends this long after it (s).
const AROUND_S: f64 = 1.0;

/// Whose estimates: of the service, of the same without learning, of the Kalman filter.
pub(super) const COMPARED: [&str; 3] = ["service", "no learning", "Kalman filter"];
pub(super) const SUFFIXES: [&str; 3] = ["", "_without_adaptation", "_kalman"];

/// The estimates of the three, at the same instants.
pub(super) type Compared<'a> = [&'a [Estimate]; 3];

/// One outage.
struct Outage {
    span: Span,
    /// At its end: the norm of the velocity's error (m/s).
    velocity_errors_m_s: [f64; 3],
    /// At its end: the error of the position since its start (m).
    position_errors_m: [f64; 3],
    /// RMS of the force's error during it (N).
    force_errors_n: [f64; 3],
    /// The largest deviation of the service's velocity at its end (m/s); infinite where the law has none.
    velocity_std_m_s: f64,
}

/// All outages of a run.
pub(super) struct OutageReport {
    outages: Vec<Outage>,
    figure: Figure,
}

/// Whether no velocity is measured during a fault.
fn is_outage(fault: &Fault) -> bool {
    fault.kind == Kind::Burst && [Field::ALL, Field::VELOCITY].contains(&fault.field)
}

/// The index of the last estimate up to a time; `None` before the first.
fn index_at(run: &Run, estimates: &[Estimate], t_s: f64) -> Option<usize> {
    estimates.partition_point(|estimate| run.seconds(estimate.stamp_ns) <= t_s).checked_sub(1)
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn norm(a: [f64; 3]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The tuning whose velocity errs least at the ends of the outages.
pub(super) fn best_in_outages<'a>(
    run: &Run,
    tunings: &'a [Vec<Estimate>],
    faults: &[Fault],
) -> Option<&'a [Estimate]> {
    let error = |estimates: &[Estimate]| -> f64 {
        let spans = faults.iter().filter(|fault| is_outage(fault)).map(|fault| fault.span);
        let ends = spans.filter_map(|span| index_at(run, estimates, span.end_s()));
        ends.filter_map(|end| Quantity::Velocity.error(&run.truths, &estimates[end]))
            .map(|error| error * error)
            .sum()
    };
    tunings.iter().map(Vec::as_slice).min_by(|a, b| error(a).total_cmp(&error(b)))
}

impl OutageReport {
    /// `None` where there is no outage of the velocity, or no translation.
    pub(super) fn new(run: &Run, compared: Compared, faults: &[Fault]) -> Option<Self> {
        let spans: Vec<Span> =
            faults.iter().filter(|fault| is_outage(fault)).map(|fault| fault.span).collect();
        let outages: Vec<Outage> = spans.iter().filter_map(|&span| outage(run, compared, span)).collect();
        let last = outages.last()?;
        let figure = figure(run, compared, last.span)?;
        Some(Self { outages, figure })
    }

    pub(super) fn figure(&self) -> &Figure {
        &self.figure
    }

    pub(super) fn shades(&self) -> impl Iterator<Item = Shade> {
        let shade = |outage: &Outage| Shade {
            from: outage.span.start_s,
            to: outage.span.end_s(),
            label: "no velocity".into(),
        };
        self.outages.iter().map(shade)
    }

    pub(super) fn print(&self) {
        let [service, without, filter] = COMPARED;
        let header = [
            "outage (s)",
            &format!("velocity (m/s)\n{service}"),
            &format!("\n{without}"),
            &format!("\n{filter}"),
            "\n1 σ said",
            &format!("position (m)\n{service}"),
            &format!("\n{without}"),
            &format!("\n{filter}"),
        ];
        let row = |outage: &Outage| {
            let numbers = |errors: [f64; 3]| errors.map(|error| format!("{error:.3}"));
            let said = match outage.velocity_std_m_s.is_finite() {
                true => format!("{:.3}", outage.velocity_std_m_s),
                false => "-".into(),
            };
            std::iter::once(format!("{} … {}", outage.span.start_s, outage.span.end_s()))
                .chain(numbers(outage.velocity_errors_m_s))
                .chain([said])
                .chain(numbers(outage.position_errors_m))
                .collect::<Vec<_>>()
        };
        outln!(
            "errors at the end of times without a measured velocity; of the position, since their start\n{}\n",
            table(&header, 1, self.outages.iter().map(row))
        );
    }

    pub(super) fn put_json(&self, document: &mut Map<String, Value>) {
        let value = |outage: &Outage| {
            let mut value = json!({
                "start_s": outage.span.start_s,
                "length_s": outage.span.length_s,
                "velocity_std_m_s": Some(outage.velocity_std_m_s).filter(|std| std.is_finite()),
            });
            if !outage.velocity_std_m_s.is_finite() {
                value["velocity_std_m_s_reason"] = "the law has no deviations".into();
            }
            for (i, suffix) in SUFFIXES.iter().enumerate() {
                value[format!("velocity_error_m_s{suffix}")] = outage.velocity_errors_m_s[i].into();
                value[format!("position_error_m{suffix}")] = outage.position_errors_m[i].into();
                value[format!("force_rms_n{suffix}")] = outage.force_errors_n[i].into();
            }
            value
        };
        document.insert("outages".into(), self.outages.iter().map(value).collect());
    }
}

fn outage(run: &Run, compared: Compared, span: Span) -> Option<Outage> {
    let position_error = |estimates: &[Estimate], index: usize| {
        let truth = truth_at(&run.truths, estimates[index].stamp_ns)?;
        Some(difference(estimates[index].position_m, truth.position_m))
    };
    let mut outage = Outage {
        span,
        velocity_errors_m_s: [0.0; 3],
        position_errors_m: [0.0; 3],
        force_errors_n: [0.0; 3],
        velocity_std_m_s: f64::INFINITY,
    };
    for (i, estimates) in compared.into_iter().enumerate() {
        let start = index_at(run, estimates, span.start_s)?;
        let end = index_at(run, estimates, span.end_s()).filter(|&end| end > start)?;
        let drift = difference(position_error(estimates, end)?, position_error(estimates, start)?);
        outage.velocity_errors_m_s[i] = Quantity::Velocity.error(&run.truths, &estimates[end])?;
        outage.position_errors_m[i] = norm(drift);
        let forces = estimates[start..end].iter();
        let squares: Vec<f64> =
            forces.filter_map(|e| Some(Quantity::Force.error(&run.truths, e)?.powi(2))).collect();
        outage.force_errors_n[i] = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    }
    let end = index_at(run, compared[0], span.end_s())?;
    outage.velocity_std_m_s = compared[0][end].velocity_std_m_s.into_iter().fold(0.0, f64::max);
    Some(outage)
}

/// Through one outage: the velocity along the axis on which the Kalman filter errs most, with the 95 % band of the service,
/// and how far the position has drifted since the outage began.
fn figure(run: &Run, compared: Compared, span: Span) -> Option<Figure> {
    let (from_s, to_s) = (span.start_s - AROUND_S, span.end_s() + AROUND_S);
    let seen = |estimates: &[Estimate]| -> Vec<Estimate> {
        let within = |estimate: &&Estimate| (from_s..=to_s).contains(&run.seconds(estimate.stamp_ns));
        estimates.iter().filter(within).copied().collect()
    };
    let filter = compared[2];
    let end = &filter[index_at(run, filter, span.end_s())?];
    let truth = truth_at(&run.truths, end.stamp_ns)?;
    let error = difference(end.velocity_m_s, truth.velocity_m_s);
    let axis = (0..3).max_by(|&a, &b| error[a].abs().total_cmp(&error[b].abs()))?;

    let [service, without, filter] = compared.map(seen);
    let of = |estimates: &[Estimate], value: &dyn Fn(&Estimate) -> f64| -> Vec<(f64, f64)> {
        estimates.iter().map(|estimate| (run.seconds(estimate.stamp_ns), value(estimate))).collect()
    };
    let lines = |value: &dyn Fn(&Estimate) -> f64| {
        vec![
            Line::new("this service", LineStyle::Estimate, of(&service, value)),
            Line::new("Kalman filter, best tuning", LineStyle::Comparison, of(&filter, value)),
            Line::new("without learning", LineStyle::Comparison, of(&without, value)),
        ]
    };
    let truths = run.truths.iter().map(|truth| (run.seconds(truth.stamp_ns), truth.velocity_m_s[axis]));
    let truths = truths.filter(|(t_s, _)| (from_s..=to_s).contains(t_s)).collect();
    let mut of_velocity = lines(&|estimate| estimate.velocity_m_s[axis]);
    of_velocity.push(Line::new("truth", LineStyle::Truth, truths));
    let band = service.iter().map(|estimate| {
        let (v, half) = (estimate.velocity_m_s[axis], DEVIATIONS_OF_95 * estimate.velocity_std_m_s[axis]);
        (run.seconds(estimate.stamp_ns), v - half, v + half)
    });
    let band = Band { label: "its 95 % band".into(), points: band.collect() };
    let has_band = band.points.iter().any(|(_, low, _)| low.is_finite());
    let velocity = Panel {
        band: has_band.then_some(band),
        ..Panel::new(&format!("velocity {} (m/s)", ["x", "y", "z"][axis]), of_velocity)
    };

    // Against the position's error at the start, which each has from before.
    let error_of = |estimate: &Estimate| {
        let truth = truth_at(&run.truths, estimate.stamp_ns).unwrap_or_default();
        difference(estimate.position_m, truth.position_m)
    };
    let drift = |estimates: &[Estimate]| -> Vec<(f64, f64)> {
        let start = index_at(run, estimates, span.start_s).map(|start| error_of(&estimates[start]));
        let start = start.unwrap_or_default();
        let after = estimates.iter().filter(|estimate| run.seconds(estimate.stamp_ns) >= span.start_s);
        after.map(|e| (run.seconds(e.stamp_ns), norm(difference(error_of(e), start)))).collect()
    };
    let of_position = vec![
        Line::new("this service", LineStyle::Estimate, drift(&service)),
        Line::new("Kalman filter, best tuning", LineStyle::Comparison, drift(&filter)),
        Line::new("without learning", LineStyle::Comparison, drift(&without)),
    ];
    let position = Panel::new("position error since (m)", of_position);
    let title = format!("{} s without a measured velocity", span.length_s);
    let shade = Shade { from: span.start_s, to: span.end_s(), label: "no velocity sensor".into() };
    Some(Figure { shades: vec![shade], ..Figure::new(&title, "time (s)", vec![velocity, position]) })
}
