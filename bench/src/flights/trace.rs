//! `bench replay --trace`: what the law did at every sample of a flight, as a table.
//!
//! | column | meaning |
//! |---|---|
//! | `t_s` | stamp of the sample (s) |
//! | `v1_hat` … `v3_hat` | v̂ before the sample is used (m/s) |
//! | `f1_hat` … `f3_hat` | f̂ of the step from this sample to the next (N) |
//! | `velocity_std_m_s` | 1 σ of v̂ before the sample is used, root mean square of the axes |
//! | `force_std_n` | 1 σ of f̂ with the covariance after the step, likewise |
//! | `nis` | e²/S of the sample, mean of its axes |
//! | `weights_norm` | ‖θ‖ of all axes after the sample; of the gradient law ‖f̂‖ in its native space |
//! | `status` | `waiting`, `coasting`, `reacquiring`, `outside` (of the centers) or `tracking`, after the sample |
//!
//! A cell is empty where the law has no such number, and before the first output.

use super::accuracy::Flight;
use anyhow::Context;
use nalgebra::Vector3;
use observer::{ChannelReport, Learn, RigidBodyObserver};
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
    let mut before = None;
    for (index, sample) in samples.iter().enumerate() {
        observer.accept(sample, Learn::ALL);
        // The force of a step is known when the step is: at the next sample.
        let next_ns = samples.get(index + 1).map_or(sample.stamp_ns, |next| next.stamp_ns);
        let report = observer.estimate(sample.stamp_ns).translation;
        let report = report.context("the configuration has no [translation]")?;
        let step = report.output_age_s.is_finite().then(|| Step::of(&mut observer, next_ns));
        let t_s = (sample.stamp_ns - samples[0].stamp_ns) as f64 / 1e9;
        writeln!(out, "{}", row(t_s, before.as_ref(), step.as_ref(), &report)).with_context(cannot_write)?;
        before = step;
    }
    out.flush().with_context(cannot_write)
}

/// A step from one sample to the next: what was predicted for its end, and the force of the step.
struct Step {
    velocity_m_s: Vector3<f64>,
    velocity_std_m_s: [f64; 3],
    force_n: Vector3<f64>,
    force_std_n: [f64; 3],
}

impl Step {
    fn of(observer: &mut RigidBodyObserver, next_ns: u64) -> Self {
        if let Some(translation) = observer.joint_translation() {
            let (prediction, force_n, force_std_n) = translation.committed(next_ns);
            let velocity_m_s = prediction.velocity.into();
            return Self { velocity_m_s, velocity_std_m_s: prediction.velocity_std, force_n, force_std_n };
        }
        let estimate = observer.estimate(next_ns);
        Self {
            velocity_m_s: estimate.velocity_m_s,
            velocity_std_m_s: estimate.deviations.velocity_m_s,
            force_n: estimate.matched_force_n,
            force_std_n: estimate.deviations.matched_force_n,
        }
    }
}

fn row(t_s: f64, before: Option<&Step>, step: Option<&Step>, report: &ChannelReport) -> String {
    let number = |value: Option<f64>| {
        value.filter(|value| value.is_finite()).map_or(String::new(), |value| format!("{value:.16e}"))
    };
    let rms = |std: &[f64; 3]| (std.iter().map(|std| std * std).sum::<f64>() / 3.0).sqrt();
    let status = match report {
        _ if step.is_none() => "waiting",
        ChannelReport { coasting: true, .. } => "coasting",
        ChannelReport { reacquiring: true, .. } => "reacquiring",
        ChannelReport { outside_centers: true, .. } => "outside",
        _ => "tracking",
    };
    let has_deviations = step.is_some_and(|step| step.velocity_std_m_s[0].is_finite());
    let velocities = (0..3).map(|axis| before.map(|step| step.velocity_m_s[axis]));
    let forces = (0..3).map(|axis| step.map(|step| step.force_n[axis]));
    let others = [
        before.map(|step| rms(&step.velocity_std_m_s)),
        step.map(|step| rms(&step.force_std_n)),
        has_deviations.then_some(report.nis),
        step.map(|_| report.native_norm),
    ];
    let cells = velocities.chain(forces).chain(others).map(number);
    let cells: Vec<String> = std::iter::once(format!("{t_s:.9}")).chain(cells).collect();
    format!("{},{status}", cells.join(","))
}
