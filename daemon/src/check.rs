//! What is proven for a configuration, and which values would satisfy the conditions that fail.

use crate::assemble;
use crate::config::{ConfigError, ConfigFile, DeadZoneName, LawName};
use crate::engine::Engine;
use crate::estimator::Estimator;
use crate::gate::LinearSample;
use nalgebra::Vector3;
use observer::{
    AnyChannel, Centers, Certificate, ChannelDesign, ChannelName, DesignError, DesignReport, GradientLaw,
    InitialState, JointChannel, JointReport, Kernel, Learn, LearnedFunction, LengthScale, LengthScaleEffect,
    LinearObserver, LinearOutput, RigidBodyObserver, RotationLaw, Sample, SolverInUse, TranslationLaw,
    Velocity, length_scale_effect,
};
use shared_types::Measurement;
use std::borrow::Cow;
use std::time::{Duration, Instant};

/// Multiples of the length scale that are compared with it.
const SHORTER: [f64; 2] = [0.5, 0.7];
const LONGER: [f64; 2] = [1.4, 2.0];
/// Length scales are compared up to this many centers, since each comparison factors a Gram matrix.
pub const MAX_CENTERS_TO_COMPARE: usize = 729;
/// Steps are timed until this many are done, or until this time is over.
const MAX_TIMED_STEPS: usize = 400;
const TIMING: Duration = Duration::from_millis(500);
/// The late sample whose cost is measured is as late as this part of the window,
const PART_OF_WINDOW: f64 = 0.9;
/// so many of them are timed,
const TIMED_LATE_SAMPLES: u64 = 20;
/// with so many ticks between two, in which the engine catches up.
const TICKS_BETWEEN_LATE: u64 = 20;
/// Observers with more learned numbers than this are not copied to time their steps.
const MAX_LEARNED_TO_COPY: usize = 1_000_000;
/// But never fewer than these.
const MIN_TIMED_STEPS: usize = 11;

/// The report of one channel.
pub struct ChannelCheck {
    /// Its table in the configuration.
    pub name: &'static str,
    /// Units of what it estimates; empty if only the user knows them.
    pub units: Units,
    /// What is known of it, by its law.
    pub report: LawReport,
    /// The time of a step on this machine, or why `daemon run` refuses the channel.
    pub step_time: Result<StepTime, ConfigError>,
}

/// Units of what a channel estimates.
#[derive(Debug, Clone, Copy)]
pub struct Units {
    /// Of the output.
    pub output: &'static str,
    /// Of Γ_f.
    pub adaptation_rate: &'static str,
    /// Of what is integrated from the output: position, attitude.
    pub pose: &'static str,
    /// Of the unknown force.
    pub force: &'static str,
}

const TRANSLATION: Units = Units { output: "m/s", adaptation_rate: "kg/s²", pose: "m", force: "N" };
const ROTATION: Units = Units { output: "rad/s", adaptation_rate: "N·m", pose: "rad", force: "N·m" };
const LINEAR: Units = Units { output: "", adaptation_rate: "", pose: "", force: "" };

/// What is known of a channel, by its law.
#[allow(clippy::large_enum_variant)] // there are three of it
pub enum LawReport {
    /// What is proven of the gradient law.
    Gradient {
        /// The conditions of the theorems.
        report: DesignReport,
        /// Condition and cover for other length scales; empty with too many centers.
        length_scales: Vec<LengthScaleEffect>,
    },
    /// What is to be expected of the joint law.
    Joint(JointReport),
}

/// The time of a step.
pub struct StepTime {
    /// Median (ns).
    pub median_ns: u64,
    /// Steps timed.
    pub samples: usize,
}

impl StepTime {
    /// Of these durations (ns), at least one.
    fn of(mut durations_ns: Vec<u64>) -> Self {
        durations_ns.sort_unstable();
        Self { median_ns: durations_ns[durations_ns.len() / 2], samples: durations_ns.len() }
    }
}

impl ChannelCheck {
    /// Why `daemon run` refuses the channel, if it does.
    pub fn refusal(&self) -> Option<&ConfigError> {
        self.step_time.as_ref().err()
    }
}

/// Everything that `daemon check` prints about a configuration.
///
/// # Errors
/// What [`assemble::estimator`] refuses, but for an unstable design: that is a finding.
pub fn checks(file: &ConfigFile) -> Result<Vec<ChannelCheck>, ConfigError> {
    let mut checks = Vec::new();
    assemble::check(file)?;
    let refuse = |table: &'static str| move |error: DesignError| assemble::refusal(file, table, &error);
    let initial = InitialState::default();
    if let Some(design) = assemble::translation_design(file)? {
        let observer = RigidBodyObserver::new(Some(design.clone()), None, initial);
        let report = match &design {
            TranslationLaw::Joint(design) => JointReport::of_translation(design).map(LawReport::Joint),
            TranslationLaw::Gradient(design) => {
                let law = observer.as_ref().ok().and_then(RigidBodyObserver::translation);
                gradient_report(law, &design.channel, |function| {
                    DesignReport::of_translation(design, function)
                })
            }
        };
        let step_time = observer.map(time_steps).map_err(refuse("translation"));
        let report = report.map_err(refuse("translation"))?;
        checks.push(ChannelCheck { name: "translation", units: TRANSLATION, report, step_time });
    }
    if let Some(design) = assemble::rotation_design(file)? {
        let observer = RigidBodyObserver::new(None, Some(design.clone()), initial);
        let report = match &design {
            RotationLaw::Joint(design) => JointReport::of_rotation(design).map(LawReport::Joint),
            RotationLaw::Gradient(design) => {
                let law = observer.as_ref().ok().and_then(RigidBodyObserver::rotation);
                gradient_report(law, &design.channel, |function| DesignReport::of_rotation(design, function))
            }
        };
        let step_time = observer.map(time_steps).map_err(refuse("rotation"));
        let report = report.map_err(refuse("rotation"))?;
        checks.push(ChannelCheck { name: "rotation", units: ROTATION, report, step_time });
    }
    if let Some(design) = assemble::linear_design(file)? {
        let names = file.config.linear.as_ref().and_then(|linear| linear.state_names.as_deref());
        let observer = LinearObserver::new(&design);
        let law = observer.as_ref().ok().map(LinearObserver::law);
        let built =
            law.map_or_else(|| design.function().map(Cow::Owned), |law| Ok(Cow::Borrowed(law.function())));
        let report = DesignReport::of_linear(&design, &*built.map_err(refuse("linear"))?, names);
        let length_scales = compared_length_scales(
            &report,
            (design.kernel, &design.length_scale, &design.centers, design.nugget),
        );
        let step_time = observer.map(time_linear_steps).map_err(refuse("linear"));
        let report = LawReport::Gradient { report, length_scales };
        checks.push(ChannelCheck { name: "linear", units: LINEAR, report, step_time });
    }
    match checks.is_empty() {
        true => assemble::estimator(file).map(|_| checks),
        false => Ok(checks),
    }
}

/// With many centers a space takes long to build: the report uses the one that the observer has built, if it did.
fn gradient_report(
    built: Option<&GradientLaw<3>>,
    channel: &ChannelDesign,
    report: impl Fn(&LearnedFunction<3>) -> Result<DesignReport, DesignError>,
) -> Result<LawReport, DesignError> {
    let function = match built {
        Some(law) => Cow::Borrowed(law.function()),
        None => Cow::Owned(channel.function()?),
    };
    let report = report(&function)?;
    let length_scales = compared_length_scales(
        &report,
        (channel.kernel, &channel.length_scale, &channel.centers, channel.nugget),
    );
    Ok(LawReport::Gradient { report, length_scales })
}

/// cond(K) and cover for shorter and longer length scales; the design's own are those of its report.
fn compared_length_scales(
    report: &DesignReport,
    (kernel, length_scale, centers, nugget): (Kernel, &LengthScale, &Centers, f64),
) -> Vec<LengthScaleEffect> {
    if centers.n_centers() > MAX_CENTERS_TO_COMPARE {
        return Vec::new();
    }
    let compare = |factors: &[f64]| length_scale_effect(kernel, length_scale, centers, nugget, factors);
    let own = LengthScaleEffect {
        factor: 1.0,
        gram_condition: Some(report.gram_condition),
        relative_power_function: Some(report.sup_power_function.value / report.value_at_zero.sqrt()),
    };
    [compare(&SHORTER), vec![own], compare(&LONGER)].concat()
}

/// The conditions that are not proven for a configuration: one sentence for each channel with such conditions.
pub fn unproven(file: &ConfigFile, estimator: &Estimator) -> Vec<String> {
    let mut sentences = Vec::new();
    let mut warn = |name: &str, hidden: String, certificate: Option<&Certificate>, shape: DeadZoneName| {
        let mut facts = Vec::new();
        if !hidden.is_empty() {
            facts.push(format!("{hidden} cannot be observed and is integrated from its start"));
        }
        match certificate {
            None => facts.push("the error dynamics are not strictly positive real".into()),
            Some(certificate) if !certificate.is_admissible() => facts.push(format!(
                "the dead zone d = {} is not wider than d_N = {:.4}, so Theorem 2 promises nothing",
                certificate.dead_zone_width,
                certificate.d_n()
            )),
            _ => {}
        }
        if certificate.is_some_and(|certificate| certificate.bounds.noise > 0.0) {
            facts.push("with measurement noise the error bound is the paper's claim, not proven".into());
        }
        if shape == DeadZoneName::Step {
            facts.push("a step dead zone may chatter".into());
        }
        if !facts.is_empty() {
            sentences.push(format!("{name}: not all is proven: {}; see daemon check", facts.join("; ")));
        }
    };
    let is_gradient = |law: LawName| law == LawName::Gradient;
    if let Some(translation) = file.config.translation.as_ref().filter(|keys| is_gradient(keys.law)) {
        let hidden = if translation.position_fix_gain_per_s > 0.0 { "" } else { "position" };
        let certificate = estimator.channel(ChannelName::Translation).and_then(AnyChannel::certificate);
        warn("translation", hidden.into(), certificate, translation.dead_zone);
    }
    if let Some(rotation) = file.config.rotation.as_ref().filter(|keys| is_gradient(keys.law)) {
        let certificate = estimator.channel(ChannelName::Rotation).and_then(AnyChannel::certificate);
        warn("rotation", String::new(), certificate, rotation.dead_zone);
    }
    if let (Some(linear), Ok(Some(design))) = (&file.config.linear, assemble::linear_design(file)) {
        let hidden = design.unobservable_states(linear.state_names.as_deref()).join(", ");
        let certificate = estimator.channel(ChannelName::Linear).and_then(AnyChannel::certificate);
        warn("linear", hidden, certificate, linear.dead_zone);
    }
    sentences
}

/// One sentence for each channel whose f̂ is computed by the local solver.
pub fn local_solvers(estimator: &Estimator) -> Vec<String> {
    let body = estimator.rigid_body.as_ref();
    let channels = [
        ("translation", body.and_then(RigidBodyObserver::translation).map(|law| law.function().solver())),
        ("rotation", body.and_then(RigidBodyObserver::rotation).map(|law| law.function().solver())),
        ("linear", estimator.linear.as_ref().map(|linear| linear.law().function().solver())),
    ];
    let local = channels.into_iter().filter_map(|(name, solver)| Some((name, solver?)));
    local
        .filter(|(_, solver)| *solver != SolverInUse::Dense)
        .map(|(name, solver)| format!("{name}: the solver is {solver}"))
        .collect()
}

/// That the steps of all channels fit into the period.
///
/// # Errors
/// `rate_hz`, with the period and the time of a step here.
pub fn fits(file: &ConfigFile, step: &StepTime) -> Result<(), ConfigError> {
    let period_ns = period_ns(file);
    if step.median_ns <= period_ns {
        return Ok(());
    }
    let found = format!("{}, a period of {:.0} µs", file.config.rate_hz, period_ns as f64 / 1e3);
    let needed = format!(
        "a period longer than a step, which takes {:.0} µs here (median of {}); fewer centers make it shorter",
        step.median_ns as f64 / 1e3,
        step.samples
    );
    Err(file.refusal("rate_hz", &found, &needed))
}

/// 1/rate_hz (ns).
pub fn period_ns(file: &ConfigFile) -> u64 {
    (1e9 / file.config.rate_hz) as u64
}

/// The time of a step of all channels, on a copy of the observers. `None` with a million numbers, whose copy takes too long:
/// only the local solver has so many, and its steps are short.
pub fn time_of_step(estimator: &Estimator) -> Option<StepTime> {
    if estimator.n_learned() > MAX_LEARNED_TO_COPY {
        return None;
    }
    let mut estimator = estimator.clone();
    Some(time(|j, wander| {
        let output = Vector3::from(wander);
        let sample = Sample {
            stamp_ns: jittered_ns(j),
            velocity: Some(Velocity::Inertial(output)),
            angular_velocity_rad_s: Some(output),
            force_n: Some(output),
            torque_n_m: Some(output),
            ..Sample::default()
        };
        let linear = LinearSample { output: Some(LinearOutput::repeat(wander[0])), input: None };
        estimator.accept(&sample, &linear, Learn::ALL);
        std::hint::black_box(estimator.estimate(jittered_ns(j) + 500_000));
    }))
}

/// What a sample costs that arrives nearly as late as it may.
pub struct LateSample {
    /// How late it is (s).
    pub late_s: f64,
    /// How many samples, at the configured rate, are fused again in its tick; the rest is for the next ticks.
    pub n_fused_again: usize,
    /// The tick.
    pub tick: StepTime,
}

/// Measures it. `None` where no late sample is taken, with the local solver, or the design is refused.
pub fn time_of_late_sample(file: &ConfigFile) -> Option<LateSample> {
    let estimator = assemble::estimator(file).ok()?;
    if estimator.n_learned() > MAX_LEARNED_TO_COPY {
        return None;
    }
    let mut engine = Engine::new(&file.config, estimator);
    if !engine.window().takes_late_samples() {
        return None;
    }
    let (period_ns, late_s) = (period_ns(file), PART_OF_WINDOW * file.config.input.max_age_s);
    let late_ns = (late_s * 1e9) as u64;
    let (start_ns, n_before) = (1_000_000_000_000 + 2 * late_ns, 2 * late_ns / period_ns);
    let mut durations_ns = Vec::new();
    let mut n_fused_again = 0;
    for j in 0..n_before + TICKS_BETWEEN_LATE * TIMED_LATE_SAMPLES {
        let now_ns = start_ns + j * period_ns;
        let at = |stamp_ns, sequence| {
            let wander = (j as f64 * 0.1).sin();
            Measurement::at(stamp_ns, sequence)
                .with_velocity_m_s([0.5 * wander, 0.1, 0.0])
                .with_angular_velocity_rad_s([0.1 * wander, 0.0, 0.05])
                .with_force_n([wander, 0.0, 0.0])
                .with_torque_n_m([0.0, 0.01 * wander, 0.0])
                .with_output(&[0.1 * wander])
        };
        engine.begin(now_ns, 0);
        engine.take(&at(now_ns, j), 1);
        let is_late = j >= n_before && (j - n_before).is_multiple_of(TICKS_BETWEEN_LATE);
        if is_late {
            engine.take(&at(now_ns - late_ns + 1, j), 2);
        }
        let begin = Instant::now();
        std::hint::black_box(engine.conclude());
        if is_late {
            durations_ns.push(begin.elapsed().as_nanos() as u64);
            n_fused_again = engine.window().n_fused_again();
        }
    }
    Some(LateSample { late_s, n_fused_again, tick: StepTime::of(durations_ns) })
}

/// The time of a step and an estimate, outputs wandering through the box of the centers.
fn time_steps(mut observer: RigidBodyObserver) -> StepTime {
    let gradient = observer.translation().or(observer.rotation());
    let joint = observer.joint_translation().map(JointChannel::filter);
    let joint = joint.or(observer.joint_rotation().map(JointChannel::filter));
    let (lower, upper) = match (gradient, joint) {
        (Some(law), _) => {
            let (lower, upper) = law.function().bounding_box();
            (lower.to_vec(), upper.to_vec())
        }
        (None, Some(filter)) => filter.design().centers.bounding_box(),
        (None, None) => unreachable!("one channel was built"),
    };
    let (lower, upper) = (Vector3::from_column_slice(&lower), Vector3::from_column_slice(&upper));
    time(|j, wander| {
        let output = lower + (upper - lower).component_mul(&Vector3::from(wander));
        observer.accept(
            &Sample {
                stamp_ns: jittered_ns(j),
                velocity: Some(Velocity::Inertial(output)),
                angular_velocity_rad_s: Some(output),
                force_n: Some(output),
                torque_n_m: Some(output),
                ..Sample::default()
            },
            Learn::ALL,
        );
        std::hint::black_box(observer.estimate(jittered_ns(j) + 500_000));
    })
}

fn time_linear_steps(mut observer: LinearObserver) -> StepTime {
    let (lower, upper) = observer.law().function().bounding_box();
    let (lower, upper) = (lower.to_vec(), upper.to_vec());
    time(|j, wander| {
        let at = |axis: usize| lower[axis] + (upper[axis] - lower[axis]) * wander[axis % 3];
        let output = LinearOutput::from_fn(|axis, _| if axis < lower.len() { at(axis) } else { 0.0 });
        observer.accept(jittered_ns(j), Some(output), None, Learn::ALL);
        std::hint::black_box(observer.estimate(jittered_ns(j) + 500_000));
    })
}

/// Stamps of a source at 1 kHz with jitter: no two steps have the same length.
fn jittered_ns(j: u64) -> u64 {
    j * 1_000_000 + j * 7919 % 1009
}

fn time(mut step: impl FnMut(u64, [f64; 3])) -> StepTime {
    let mut durations_ns = Vec::with_capacity(MAX_TIMED_STEPS);
    let begin = Instant::now();
    while durations_ns.len() < MIN_TIMED_STEPS
        || (durations_ns.len() < MAX_TIMED_STEPS && begin.elapsed() < TIMING)
    {
        let j = durations_ns.len() as u64;
        let t = j as f64 * 0.1;
        let wander = [t.sin(), (1.3 * t).cos(), (0.7 * t).sin()].map(|x| 0.5 + 0.5 * x);
        let start = Instant::now();
        step(j, wander);
        durations_ns.push(start.elapsed().as_nanos() as u64);
    }
    StepTime::of(durations_ns)
}
