//! `bench hover`: what the sensor's noise alone teaches the gradient law.
//!
//! A multicopter of 2 kg hovers in still air: there is no unknown force, and all that f̂ becomes is false. A controller acts on
//! the estimate, u = −m (4 r̂ + 4 v̂). The design is the gradient law's for such a vehicle; three variants see the same noise:
//!
//! | variant | |
//! |---|---|
//! | φ(y) | the paper's law |
//! | φ(C x̂) | [`FeaturePoint::Estimated`] |
//! | φ(y), bounded | ‖f̂‖ ≤ 5 N |
//!
//! # Source
//! docs/method.md, *What noise teaches*, derives the predicted line `‖f̂‖ = η γ s² ‖∇φ‖_F t`.

use crate::harness::output::{show, table};
use crate::harness::random::Random;
use crate::plot::{self, Figure, Line, LineStyle, Panel};
use clap::Args;
use nalgebra::{Matrix3, Vector3};
use observer::{
    BodyChannel, Centers, ChannelDesign, DeadZone, DeadZoneShape, DisturbanceBounds, FeatureBuffers,
    FeaturePoint, GradientOptions, Kernel, Learning, LengthScale, NativeSpace, Solver,
};
use serde::Serialize;
use shared_types::outln;
use std::path::PathBuf;

const H_S: f64 = 0.005;
const MASS_KG: f64 = 2.0;
const ADAPTATION_RATE: f64 = 100.0;
const MAX_NORM: f64 = 5.0;
/// The false force is given at this much speed (m/s).
const AWAY: Vector3<f64> = Vector3::new(1.0, 0.0, 0.0);

/// Arguments of `bench hover`.
#[derive(Debug, Clone, Args)]
pub(crate) struct HoverArguments {
    /// Length of the hover (min).
    #[arg(long, value_name = "MIN", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=600))]
    minutes: u32,
    /// Deviation of the velocity's noise on each axis (m/s).
    #[arg(long, value_name = "S", default_value_t = 0.02, value_parser = deviation)]
    noise: f64,
    /// Draw f̂ against time to FILE.svg.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    json: bool,
}

fn deviation(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(value) if (1e-4..=1.0).contains(&value) => Ok(value),
        _ => Err("needed: a number from 0.0001 to 1".into()),
    }
}

/// f̂ of one variant over the hover.
#[derive(Debug, Serialize)]
struct Learned {
    variant: &'static str,
    /// Every second: time (s), ‖f̂‖_H (N), |f̂| at 1 m/s (N).
    #[serde(skip)]
    course: Vec<[f64; 3]>,
    /// At the end.
    native_norm: f64,
    force_at_1_m_s_n: f64,
    /// f̂ᵀv/|v| at 1 m/s (N): positive where it drives.
    driving_at_1_m_s_n: f64,
    /// What the derivation says of the norm; none is derived for the other variants.
    predicted_norm: Option<f64>,
    velocity_rms_m_s: f64,
}

/// Runs `bench hover`.
///
/// # Errors
/// A plot that cannot be written.
pub(crate) fn run(arguments: &HoverArguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    let duration_s = 60.0 * f64::from(arguments.minutes);
    let variant = |name, options| hover(name, options, arguments.noise, duration_s);
    let paper = GradientOptions::default();
    let variants = [
        variant("φ(y)", paper)?,
        variant("φ(Cx̂)", GradientOptions { feature_point: FeaturePoint::Estimated, ..paper })?,
        variant("φ(y), bounded", GradientOptions { max_norm: Some(MAX_NORM), ..paper })?,
    ];
    show(arguments.json, &variants, || {
        let row = |learned: &Learned| {
            let predicted = learned.predicted_norm.map_or("–".into(), |norm| format!("{norm:.2}"));
            let numbers = [learned.native_norm, learned.driving_at_1_m_s_n].map(|x| format!("{x:.2}"));
            let [norm, driving] = numbers;
            [learned.variant.into(), norm, predicted, driving, format!("{:.4}", learned.velocity_rms_m_s)]
        };
        let header =
            ["features", "‖f̂‖ (N)", "predicted (N)", "f̂ along 1 m/s (N)", "velocity error, RMS (m/s)"];
        outln!("{}", table(&header, 1, variants.iter().map(row)));
    })?;
    if let Some(file) = &arguments.plot {
        draw(file, &variants, duration_s)?;
    }
    Ok(())
}

fn design(options: GradientOptions) -> anyhow::Result<ChannelDesign> {
    Ok(ChannelDesign {
        kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
        length_scale: LengthScale::Isotropic(3.0),
        centers: Centers::lattice([-4.0, -4.0, -2.0], [4.0, 4.0, 2.0], [5, 5, 3])?,
        nugget: 0.0,
        solver: Solver::Dense,
        inertia: Matrix3::identity() * MASS_KG,
        gain_per_s: 10.0,
        adaptation_rate: Matrix3::identity() * ADAPTATION_RATE,
        dead_zone: DeadZone::new(DeadZoneShape::Saturated, 0.02, 0.02)?,
        options,
        bounds: DisturbanceBounds::default(),
        hold_s: 0.0075,
        coast_step_s: H_S,
    })
}

fn hover(
    variant: &'static str,
    options: GradientOptions,
    noise: f64,
    duration_s: f64,
) -> anyhow::Result<Learned> {
    let mut channel = BodyChannel::new(&design(options)?)?;
    let mut random = Random(20_241);
    let [mut v, mut position_estimate] = [Vector3::<f64>::zeros(); 2];
    let (mut course, mut squared_error) = (Vec::new(), 0.0);
    let (mut weighted_square, mut square) = (0.0, 0.0);
    let n = (duration_s / H_S) as u64;
    for j in 0..n {
        let estimate = channel.output_estimate();
        squared_error += (v - estimate).norm_squared() / n as f64;
        let input = -MASS_KG * (4.0 * position_estimate + 4.0 * estimate);
        let output = v + Vector3::from_fn(|_, _| noise * random.normal());
        channel.step(&output, &input, H_S);
        position_estimate += 0.5 * H_S * (estimate + channel.output_estimate());
        v += H_S / MASS_KG * input;
        let held = channel.law().held();
        square += held.output_error.norm_squared();
        weighted_square += held.activation * held.output_error.norm_squared();
        if j % 200 == 199 {
            let norm = channel.law().function().native_norm();
            let force = channel.law_mut().matched_force_at(&AWAY, &Learning::none()).value;
            course.push([(j + 1) as f64 * H_S, norm, force.norm()]);
        }
    }
    let away = channel.law_mut().matched_force_at(&AWAY, &Learning::none()).value;
    let rate = weighted_square / square * ADAPTATION_RATE * noise * noise;
    let growth = rate * gradient_norm(channel.law().function().space()) * duration_s;
    Ok(Learned {
        variant,
        course,
        native_norm: channel.law().function().native_norm(),
        force_at_1_m_s_n: away.norm(),
        driving_at_1_m_s_n: away.dot(&AWAY),
        predicted_norm: (options == GradientOptions::default()).then_some(growth),
        velocity_rms_m_s: squared_error.sqrt(),
    })
}

/// ‖∇φ(0)‖_F.
fn gradient_norm(space: &NativeSpace) -> f64 {
    const STEP: f64 = 1e-4;
    let mut buffers = FeatureBuffers::new(space);
    let mut features = |v: Vector3<f64>| {
        space.features(v.as_slice(), &mut buffers);
        buffers.features().to_vec()
    };
    let square = |axis| -> f64 {
        let [after, before] = [STEP, -STEP].map(|step| features(Vector3::ith(axis, step)));
        after.iter().zip(before).map(|(a, b)| ((a - b) / (2.0 * STEP)).powi(2)).sum()
    };
    [0, 1, 2].map(square).iter().sum::<f64>().sqrt()
}

fn draw(file: &std::path::Path, variants: &[Learned], duration_s: f64) -> anyhow::Result<()> {
    let curve = |learned: &Learned, column: usize| -> Vec<(f64, f64)> {
        learned.course.iter().map(|row| (row[0] / 60.0, row[column])).collect()
    };
    let lines = |column| -> Vec<Line> {
        variants.iter().map(|l| Line::new(l.variant, LineStyle::Estimate, curve(l, column))).collect()
    };
    let mut norms = lines(1);
    for predicted in variants.iter().filter_map(|learned| learned.predicted_norm) {
        let line = vec![(0.0, 0.0), (duration_s / 60.0, predicted)];
        norms.insert(0, Line::new("predicted, φ(y)", LineStyle::Truth, line));
    }
    let panels = vec![Panel::new("‖f̂‖ (N)", norms), Panel::new("|f̂| at 1 m/s (N)", lines(2))];
    Figure::new("Hover in still air: the true force is 0", "time (min)", panels).write(file)
}
