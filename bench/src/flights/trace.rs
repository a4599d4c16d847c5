//! `bench replay --trace`: what the law did at every sample of a flight, as a table.
//!
//! | column | meaning |
//! |---|---|
//! | `t_s` | stamp of the sample (s) |
//! | `v1_hat` … `v3_hat` | v̂ before the sample is used (m/s) |
//! | `f1_hat` … `f3_hat` | f̂ of the step from this sample to the next (N) |
//! | `velocity_std_m_s` | 1 σ of v̂ before the sample is used, root mean square of the axes |
//! | `force_std_n` | 1 σ of f̂ by the covariance after the sample, likewise |
//! | `nis` | e²/S of the sample, mean of its axes |
//! | `weights_norm` | ‖θ‖ of all axes after the sample; of the gradient law ‖f̂‖ in its native space |
//! | `status` | `waiting`, `coasting`, `reacquiring`, `outside` (of the centers) or `tracking`, after the sample |
//!
//! A cell is empty where the law has no such number, and before the first output.

use super::accuracy::Flight;
use anyhow::Context;
use observer::{ChannelReport, Learn, RigidBodyEstimate, RigidBodyObserver};
use std::io::Write;
use std::path::Path;

const HEADER: &str =
    "t_s,v1_hat,v2_hat,v3_hat,f1_hat,f2_hat,f3_hat,velocity_std_m_s,force_std_n,nis,weights_norm,status";

/// Flies the observer over the flight, learning, and writes a row for every sample.
pub(super) fn write(flight: &Flight, mut observer: RigidBodyObserver, file: &Path) -> anyhow::Result<()> {
    let cannot_write = || format!("cannot write the trace '{}'", file.display());
    let mut out = std::io::BufWriter::new(std::fs::File::create(file).with_context(cannot_write)?);
    writeln!(out, "{HEADER}").with_context(cannot_write)?;
    let samples = &flight.samples;
    let mut has_begun = false;
    for (index, sample) in samples.iter().enumerate() {
        let before = observer.estimate(sample.stamp_ns);
        observer.accept(sample, Learn::ALL);
        let after = observer.estimate(sample.stamp_ns);
        // The force of a step is known when the step is: at the next sample.
        let next_ns = samples.get(index + 1).map_or(sample.stamp_ns, |next| next.stamp_ns);
        let step = observer.estimate(next_ns);
        let report = after.translation.context("the configuration has no [translation]")?;
        let t_s = (sample.stamp_ns - samples[0].stamp_ns) as f64 / 1e9;
        let row = row(t_s, [&before, &step], &report, [has_begun, report.output_age_s.is_finite()]);
        writeln!(out, "{row}").with_context(cannot_write)?;
        has_begun |= report.output_age_s.is_finite();
    }
    out.flush().with_context(cannot_write)
}

fn row(
    t_s: f64,
    [before, step]: [&RigidBodyEstimate; 2],
    report: &ChannelReport,
    [had_begun, has_begun]: [bool; 2],
) -> String {
    let number = |value: f64, is_known: bool| match is_known && value.is_finite() {
        true => format!("{value:.16e}"),
        false => String::new(),
    };
    let rms = |std: [f64; 3]| (std.iter().map(|std| std * std).sum::<f64>() / 3.0).sqrt();
    let status = match report {
        _ if !has_begun => "waiting",
        ChannelReport { coasting: true, .. } => "coasting",
        ChannelReport { reacquiring: true, .. } => "reacquiring",
        ChannelReport { outside_centers: true, .. } => "outside",
        _ => "tracking",
    };
    let has_deviations = step.deviations.velocity_m_s[0].is_finite();
    let numbers = before
        .velocity_m_s
        .iter()
        .map(|v| number(*v, had_begun))
        .chain(step.matched_force_n.iter().map(|f| number(*f, has_begun)))
        .chain([
            number(rms(before.deviations.velocity_m_s), had_begun),
            number(rms(step.deviations.matched_force_n), has_begun),
            number(report.nis, has_begun && has_deviations),
            number(report.native_norm, has_begun),
        ]);
    let cells: Vec<String> = std::iter::once(format!("{t_s:.9}")).chain(numbers).collect();
    format!("{},{status}", cells.join(","))
}
