//! Every number of a run: the options of `bench paper`, checked.

use clap::{Args, ValueEnum};
use observer::{DeadZoneShape, DesignError, Parameter};
use serde::Serialize;
use sim_publisher::Scenario;
use sim_publisher::simulation::HIGHEST_RATE_HZ;
use std::fmt;
use std::path::PathBuf;

/// A run keeps all of its rows: half a gigabyte of them.
const MAX_SAMPLES: f64 = 2e6;

fn number(text: &str, accepted: fn(f64) -> bool, needed: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(value) if f64::is_finite(value) && accepted(value) => Ok(value),
        _ => Err(format!("needed: {needed}")),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, |value| value > 0.0, "a finite number > 0")
}

fn not_negative(text: &str) -> Result<f64, String> {
    number(text, |value| value >= 0.0, "a finite number ≥ 0")
}

/// The examples of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Example {
    /// A point mass with a velocity-dependent unknown force.
    Translation,
    /// A rotating body with drag and gyroscopic torque unknown.
    Rotation,
}

impl Example {
    /// Plant, reference and measurement error.
    pub fn scenario(self) -> Scenario {
        match self {
            Self::Translation => Scenario::Translation,
            Self::Rotation => Scenario::Rotation,
        }
    }
}

/// Shapes of σ; see [`DeadZoneShape`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// The paper's σ₀, corrected: 0 up to d, (e − d)²/2ε up to d + ε, then e − d − ε/2.
    Quadratic,
    /// 0 up to d, s²(3 − 2s) with s = (e − d)/ε up to d + ε, then 1.
    Saturated,
    /// 0 below d, then 1; ε is unused.
    Step,
}

impl From<Shape> for DeadZoneShape {
    fn from(shape: Shape) -> Self {
        match shape {
            Shape::Quadratic => Self::Quadratic,
            Shape::Saturated => Self::Saturated,
            Shape::Step => Self::Step,
        }
    }
}

/// Velocity, or angular velocity, that the estimate starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Initial {
    /// With the true velocity, which is the reference's.
    Reference,
    /// With velocity zero.
    ZeroVelocity,
}

/// Which weights make the force of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// f̂ of a step is that of the weights after their update: the library's.
    UpdateFirst,
    /// f̂ of a step is that of the weights before their update, with the same ỹ.
    PredictFirst,
}

/// Where the plant feels f.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeltAt {
    /// At the true velocity: f(v(t)).
    True,
    /// At the measured one, without pause: f(v(t) + δ(t)), the paper's E_{y(t)} f.
    Measured,
}

/// Every number of a run.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
pub struct Settings {
    /// Which example: plant, reference, measurement error and centers.
    #[arg(id = "scenario", long, value_name = "SCENARIO", value_enum)]
    pub example: Example,
    /// Shape of the dead zone σ.
    #[arg(long, value_enum, default_value_t = Shape::Quadratic)]
    pub dead_zone: Shape,
    /// Width d ≥ 0 of the dead zone (m/s for translation, rad/s for rotation); a wide one, 1e9 say, learns nothing
    /// [default: 0.01 for translation, 0.1 for rotation].
    #[arg(
        long,
        value_name = "D",
        value_parser = not_negative,
        default_value = "0.01",
        default_value_if("scenario", "rotation", "0.1"),
        hide_default_value = true,
        allow_negative_numbers = true
    )]
    pub width: f64,
    /// Buffer ε of the dead zone (m/s for translation, rad/s for rotation).
    #[arg(long, value_name = "EPSILON", value_parser = positive, default_value = "0.01", allow_negative_numbers = true)]
    pub buffer: f64,
    /// Adaptation rate Γ_f (kg/s² for translation, N·m for rotation).
    #[arg(long, value_name = "GAMMA", value_parser = positive, default_value = "1", allow_negative_numbers = true)]
    pub adaptation_rate: f64,
    /// Order k of the Sobolev–Matérn kernel, from 2 (no unit).
    #[arg(long, value_name = "K", default_value_t = 3)]
    pub kernel_order: usize,
    /// Length scale ℓ of the kernel (m/s for translation, rad/s for rotation).
    #[arg(long, value_name = "L", value_parser = positive, default_value = "1", allow_negative_numbers = true)]
    pub length_scale: f64,
    /// Gain λ of the output error (1/s).
    #[arg(long = "gain", value_name = "LAMBDA", value_parser = positive, default_value = "10", allow_negative_numbers = true)]
    pub gain_per_s: f64,
    /// Where the estimate starts; the position or the attitude is the true one in any case.
    #[arg(long, value_enum, default_value_t = Initial::Reference)]
    pub initial: Initial,
    /// Rate of samples (Hz).
    #[arg(long, value_name = "HZ", value_parser = positive, default_value = "200", allow_negative_numbers = true)]
    pub rate_hz: f64,
    /// Length of the run (s): the samples are those at `0 ≤ j/rate < duration` [default: 60 for translation, 100 for
    /// rotation].
    #[arg(
        long = "duration",
        value_name = "S",
        value_parser = positive,
        default_value = "60",
        default_value_if("scenario", "rotation", "100"),
        hide_default_value = true,
        allow_negative_numbers = true
    )]
    pub duration_s: f64,
    /// Order of learning and predicting within a step.
    #[arg(long, value_enum, default_value_t = Scheme::UpdateFirst)]
    pub scheme: Scheme,
    /// Which velocity the plant's unknown force is a function of.
    #[arg(long = "f-at", value_enum, default_value_t = FeltAt::True)]
    pub felt_at: FeltAt,
}

/// Arguments of `bench paper`.
#[derive(Debug, Clone, Args)]
pub struct PaperArguments {
    #[command(flatten)]
    settings: Settings,
    /// Where table and figures go; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "paper")]
    pub(super) out: PathBuf,
    /// Print one JSON document instead of the summary.
    #[arg(long)]
    pub(super) json: bool,
}

impl Settings {
    /// How many samples the run has.
    pub fn n_samples(&self) -> usize {
        // The margin keeps 60 s of 200 Hz at 12 000.
        (self.duration_s * self.rate_hz - 1e-9).ceil() as usize
    }
}

impl PaperArguments {
    /// The numbers of the run.
    ///
    /// # Errors
    /// `--rate-hz` or `--duration` out of the example's range.
    pub fn settings(&self) -> Result<Settings, UsageError> {
        let settings = self.settings;
        let Settings { example, rate_hz, duration_s, .. } = settings;
        let lowest_hz = example.scenario().definition().lowest_rate_hz;
        if !(lowest_hz..=HIGHEST_RATE_HZ).contains(&rate_hz) {
            return Err(UsageError {
                option: "--rate-hz".into(),
                found: rate_hz.to_string(),
                needed: format!(
                    "{lowest_hz} to {HIGHEST_RATE_HZ} Hz for this example, whose controller runs at the samples' rate"
                ),
            });
        }
        if duration_s * rate_hz > MAX_SAMPLES || settings.n_samples() < 2 {
            return Err(UsageError {
                option: "--duration".into(),
                found: format!("{duration_s} s, {:.0} samples at {rate_hz} Hz", duration_s * rate_hz),
                needed: format!("2 to {MAX_SAMPLES} samples"),
            });
        }
        Ok(settings)
    }
}

/// An option's value that no run can have: exit code 2.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsageError {
    /// Which option, or options.
    pub option: String,
    /// Its value, or what follows from it.
    pub found: String,
    /// What would be accepted.
    pub needed: String,
}

impl fmt::Display for UsageError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: found {}; needed: {}", self.option, self.found, self.needed)
    }
}

impl std::error::Error for UsageError {}

impl From<DesignError> for UsageError {
    fn from(error: DesignError) -> Self {
        let option = match error.parameter {
            Parameter::Kernel => "--kernel-order",
            Parameter::LengthScale => "--length-scale",
            Parameter::Gain => "--gain",
            Parameter::AdaptationRate => "--adaptation-rate",
            Parameter::DeadZoneWidth => "--width",
            Parameter::DeadZoneBuffer => "--buffer",
            Parameter::Hold | Parameter::CoastStep => "--rate-hz",
            // The centers are the paper's; what can be changed is the kernel between them.
            Parameter::Centers => "--length-scale, --kernel-order",
            _ => "the example itself, a defect of this program",
        };
        Self { option: option.into(), found: error.found, needed: error.needed }
    }
}
