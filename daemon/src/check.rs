//! `daemon check`: what is proven for a configuration, and what would be proven for a better one.

use crate::assemble;
use crate::config::{ConfigError, ConfigFile, DeadZoneName};
use crate::estimator::Estimator;
use comfy_table::{ContentArrangement, Table, presets::NOTHING};
use nalgebra::Vector3;
use observer::{
    Centers, Certificate, ChannelDesign, DesignError, DesignReport, InitialState, Kernel, LearnedFunction,
    LengthScale, LengthScaleEffect, LinearObserver, LinearOutput, RigidBodyObserver, Sample, SolverInUse,
    Velocity, Verdict, length_scale_effect,
};
use rustix::stdio::stdout;
use rustix::termios::tcgetwinsize;
use serde::Serialize;
use serde_json::{Value, json};
use shared_types::outln;
use std::borrow::Cow;
use std::time::{Duration, Instant};

/// Multiples of the length scale that are compared with it.
const SHORTER: [f64; 2] = [0.5, 0.7];
const LONGER: [f64; 2] = [1.4, 2.0];
/// Comparing length scales factors a Gram matrix for each: not with more centers than this.
const MOST_CENTERS_TO_COMPARE: usize = 729;
/// Steps timed for the time per step, at most, …
const MOST_TIMED_STEPS: usize = 400;
/// … as many as begin within this time, …
const TIMING: Duration = Duration::from_millis(500);
/// … and at least.
const LEAST_TIMED_STEPS: usize = 11;

/// The report of one channel.
pub struct ChannelCheck {
    /// Its table in the configuration.
    pub name: &'static str,
    /// Of the output, and of the adaptation rate; empty where they are the user's own.
    units: (&'static str, &'static str),
    report: DesignReport,
    length_scales: Vec<LengthScaleEffect>,
    /// What one step takes on this machine, or why `daemon run` refuses the channel.
    step_time: Result<StepTime, ConfigError>,
}

struct StepTime {
    median_ns: u64,
    samples: usize,
}

type Report<'a> = dyn Fn(&LearnedFunction<3>) -> Result<DesignReport, DesignError> + 'a;

impl ChannelCheck {
    /// Why `daemon run` refuses the channel, if it does.
    pub fn refusal(&self) -> Option<&ConfigError> {
        self.step_time.as_ref().err()
    }
}

/// Everything that `daemon check` tells of a configuration.
///
/// # Errors
/// What [`ConfigFile::estimator`] refuses, but for an unstable design: that is a finding.
pub fn checks(file: &ConfigFile) -> Result<Vec<ChannelCheck>, ConfigError> {
    let mut checks = Vec::new();
    assemble::check(file)?;
    let refuse = |table: &'static str| move |error: DesignError| assemble::refusal(file, table, &error);
    // With many centers a space takes long to build: what the observer has built is what is reported on.
    let body =
        |name, units, channel: &ChannelDesign, observer: Result<RigidBodyObserver, _>, report: &Report| {
            let law = observer.as_ref().ok().and_then(|body| body.translation().or(body.rotation()));
            let built = law
                .map_or_else(|| channel.function().map(Cow::Owned), |law| Ok(Cow::Borrowed(law.function())));
            let report = built.and_then(|function| report(&function)).map_err(refuse(name))?;
            let length_scales = compared_length_scales(
                &report,
                (channel.kernel, &channel.length_scale, &channel.centers, channel.nugget),
            );
            let step_time = observer.map(time_steps).map_err(refuse(name));
            Ok::<_, ConfigError>(ChannelCheck { name, units, report, length_scales, step_time })
        };
    if let Some(design) = assemble::translation_design(file)? {
        let observer = RigidBodyObserver::new(Some(design.clone()), None, InitialState::default());
        let report = |function: &LearnedFunction<3>| DesignReport::of_translation(&design, function);
        checks.push(body("translation", ("m/s", "kg/s²"), &design.channel, observer, &report)?);
    }
    if let Some(design) = assemble::rotation_design(file)? {
        let observer = RigidBodyObserver::new(None, Some(design.clone()), InitialState::default());
        let report = |function: &LearnedFunction<3>| DesignReport::of_rotation(&design, function);
        checks.push(body("rotation", ("rad/s", "N·m"), &design.channel, observer, &report)?);
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
        checks.push(ChannelCheck { name: "linear", units: ("", ""), report, length_scales, step_time });
    }
    match checks.is_empty() {
        true => assemble::estimator(file).map(|_| checks),
        false => Ok(checks),
    }
}

/// cond(K) and cover for shorter and longer length scales; the design's own are those of its report.
fn compared_length_scales(
    report: &DesignReport,
    (kernel, length_scale, centers, nugget): (Kernel, &LengthScale, &Centers, f64),
) -> Vec<LengthScaleEffect> {
    if centers.n_centers() > MOST_CENTERS_TO_COMPARE {
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

/// What a service runs with although it is not proven: one sentence for each channel that has some.
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
    let body = estimator.rigid_body.as_ref();
    if let Some(translation) = &file.config.translation {
        let hidden = if translation.position_fix_gain_per_s > 0.0 { "" } else { "position" };
        let certificate = body.and_then(RigidBodyObserver::translation_certificate);
        warn("translation", hidden.into(), certificate, translation.dead_zone);
    }
    if let Some(rotation) = &file.config.rotation {
        let certificate = body.and_then(RigidBodyObserver::rotation_certificate);
        warn("rotation", String::new(), certificate, rotation.dead_zone);
    }
    if let (Some(linear), Ok(Some(design))) = (&file.config.linear, assemble::linear_design(file)) {
        let hidden = design.unobservable_states(linear.state_names.as_deref()).join(", ");
        let certificate = estimator.linear.as_ref().and_then(LinearObserver::certificate);
        warn("linear", hidden, certificate, linear.dead_zone);
    }
    sentences
}

/// One sentence for each channel whose f̂ is computed by the local solver.
pub fn local_solvers(estimator: &Estimator) -> Vec<String> {
    let body = estimator.rigid_body.as_ref();
    let channels = [
        ("translation", body.and_then(RigidBodyObserver::translation).map(|law| law.solver())),
        ("rotation", body.and_then(RigidBodyObserver::rotation).map(|law| law.solver())),
        ("linear", estimator.linear.as_ref().map(|linear| linear.law().solver())),
    ];
    let local = channels.into_iter().filter_map(|(name, solver)| Some((name, solver?)));
    local
        .filter(|(_, solver)| *solver != SolverInUse::Dense)
        .map(|(name, solver)| format!("{name}: the solver is {solver}"))
        .collect()
}

/// The time of a step, outputs wandering through the box of the centers.
fn time_steps(mut observer: RigidBodyObserver) -> StepTime {
    let law = observer.translation().or(observer.rotation()).expect("one channel was built");
    let (lower, upper) = law.bounding_box();
    let (lower, upper) = (Vector3::from_column_slice(lower), Vector3::from_column_slice(upper));
    time(|j, wander| {
        let output = lower + (upper - lower).component_mul(&Vector3::from(wander));
        observer.accept(&Sample {
            stamp_ns: jittered_ns(j),
            velocity: Some(Velocity::Inertial(output)),
            angular_velocity_rad_s: Some(output),
            ..Sample::default()
        });
    })
}

fn time_linear_steps(mut observer: LinearObserver) -> StepTime {
    let (lower, upper) = observer.law().bounding_box();
    let (lower, upper) = (lower.to_vec(), upper.to_vec());
    time(|j, wander| {
        let at = |axis: usize| lower[axis] + (upper[axis] - lower[axis]) * wander[axis % 3];
        let output = LinearOutput::from_fn(|axis, _| if axis < lower.len() { at(axis) } else { 0.0 });
        observer.accept(jittered_ns(j), Some(output), None);
    })
}

/// Stamps of a source at 1 kHz as they really come: no two steps are of the same length.
fn jittered_ns(j: u64) -> u64 {
    j * 1_000_000 + j * 7919 % 1009
}

fn time(mut step: impl FnMut(u64, [f64; 3])) -> StepTime {
    let mut durations_ns = Vec::with_capacity(MOST_TIMED_STEPS);
    let begin = Instant::now();
    while durations_ns.len() < LEAST_TIMED_STEPS
        || (durations_ns.len() < MOST_TIMED_STEPS && begin.elapsed() < TIMING)
    {
        let j = durations_ns.len() as u64;
        let t = j as f64 * 0.1;
        let wander = [t.sin(), (1.3 * t).cos(), (0.7 * t).sin()].map(|x| 0.5 + 0.5 * x);
        let start = Instant::now();
        step(j, wander);
        durations_ns.push(start.elapsed().as_nanos() as u64);
    }
    durations_ns.sort_unstable();
    StepTime { median_ns: durations_ns[durations_ns.len() / 2], samples: durations_ns.len() }
}

/// The document of `daemon check --json`.
pub fn document(file: &ConfigFile, checks: &[ChannelCheck]) -> Value {
    let channels: Vec<_> = checks.iter().map(ChannelCheck::document).collect();
    json!({ "configuration": file.name(), "channels": channels })
}

/// A matrix as its rows.
fn rows(matrix: &nalgebra::DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

#[derive(Serialize)]
struct FindingDocument {
    condition: String,
    verdict: &'static str,
    detail: String,
}

impl ChannelCheck {
    fn document(&self) -> Value {
        let report = &self.report;
        let certificate = report.certificate.as_ref();
        let pair = report.lure.as_ref().ok();
        let findings: Vec<_> = report
            .findings()
            .into_iter()
            .map(|finding| FindingDocument {
                verdict: word(finding.verdict),
                condition: finding.condition,
                detail: finding.detail,
            })
            .collect();
        let length_scales: Vec<_> = self
            .length_scales
            .iter()
            .map(|effect| {
                json!({
                    "factor": effect.factor,
                    "gram_condition": effect.gram_condition,
                    "relative_power_function": effect.relative_power_function,
                })
            })
            .collect();
        let mut document = json!({
            "name": self.name,
            "output_unit": self.units.0,
            "states": report.states,
            "controllable": report.controllable,
            "observable": report.observable,
            "unobservable": report.unobservable,
            "hurwitz": report.hurwitz,
            "hurwitz_on_observable_part": report.observable_hurwitz,
            "poles_per_s": report.poles.iter().map(|pole| [pole.re, pole.im]).collect::<Vec<_>>(),
            "strictly_positive_real": pair.is_some(),
            "p": pair.map(|pair| rows(&pair.p)),
            "w": pair.map(|pair| rows(&pair.w)),
            "epsilon_per_s": pair.map(|pair| pair.epsilon),
            "lambda_min": pair.map(|pair| pair.lambda_min),
            "pl_norm": pair.map(|pair| pair.pl_norm),
            "lure_input_residual": pair.map(|pair| pair.input_residual),
            "lure_lyapunov_residual": pair.map(|pair| pair.lyapunov_residual),
            "level_set_factor": pair.map(|_| report.level_set_factor()),
        });
        let (block, predicted_error) = match &report.solver {
            SolverInUse::Dense => (None, None),
            SolverInUse::Local { block, predicted_error } => (Some(block.clone()), Some(predicted_error)),
            SolverInUse::Neighbours { n_neighbours, predicted_error } => {
                (Some(vec![*n_neighbours]), Some(predicted_error))
            }
        };
        let numbers = json!({
            "noise_bound": report.bounds.noise,
            "unmatched_bound": report.bounds.unmatched,
            "residual_norm_bound": report.bounds.residual_norm,
            "e0": certificate.map(Certificate::e0),
            "d_n": certificate.map(Certificate::d_n),
            "n_centers": report.n_centers,
            "kernel_at_zero": report.value_at_zero,
            "sup_power_function": report.sup_power_function.value,
            "sup_power_function_upper_bound": report.sup_power_function.upper_bound,
            "sup_power_function_at": report.sup_power_function.at,
            "fill_distance_length_scales": report.fill_distance.value,
            "separation_length_scales": report.separation,
            "dead_zone_width": report.dead_zone_width,
            "dead_zone_admissible": certificate.is_some_and(Certificate::is_admissible) && report.dead_zone_is_smooth,
            "smallest_admissible_dead_zone_width": certificate.map(Certificate::d_n),
            "sampled_data_stable": report.sampled_data_stable(),
            "adaptation_rate": report.adaptation_rate,
            "largest_stable_adaptation_rate": report.largest_stable_adaptation_rate,
            "hold_s": report.hold_s,
            "gram_condition": report.gram_condition,
            "bytes": report.bytes,
            "memory_bytes": report.memory_bytes,
            "solver": if report.solver == SolverInUse::Dense { "dense" } else { "local" },
            "solver_block": block,
            "solver_predicted_error": predicted_error,
            "step_ns": self.step_time.as_ref().ok().map(|time| time.median_ns),
            "step_samples": self.step_time.as_ref().map_or(0, |time| time.samples),
            "length_scale_effect": length_scales,
            "findings": findings,
        });
        let reasons = document.as_object_mut().expect("an object was made");
        reasons.extend(
            numbers.as_object().into_iter().flatten().map(|(key, value)| (key.clone(), value.clone())),
        );
        let nothing_compared = format!("not compared with more than {MOST_CENTERS_TO_COMPARE} centers");
        if self.length_scales.is_empty() {
            reasons.insert("length_scale_effect".into(), Value::Null);
        }
        let missing: Vec<_> =
            reasons.iter().filter(|(_, value)| value.is_null()).map(|(key, _)| key.clone()).collect();
        for key in missing {
            let reason = match (key.as_str(), &report.lure, &self.step_time) {
                ("length_scale_effect", ..) => nothing_compared.clone(),
                ("solver_block" | "solver_predicted_error", ..) => "the dense solver is exact".into(),
                ("separation_length_scales", ..) => "there is a single center".into(),
                ("step_ns", _, Err(refusal)) => format!("daemon run refuses this channel: {refusal}"),
                (_, Err(reason), _) => reason.clone(),
                _ => "not finite".into(),
            };
            reasons.insert(format!("{key}_reason"), reason.into());
        }
        document
    }

    fn print(&self) {
        let report = &self.report;
        let unit = |unit: &str| if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let (output_unit, rate_unit) = (unit(self.units.0), unit(self.units.1));
        outln!("{}, {} centers", self.name, report.n_centers);
        let mut table = wide_table();
        for finding in report.findings() {
            table.add_row([word(finding.verdict), &finding.condition, &finding.detail]);
        }
        outln!("{table}\n");

        let mut facts = wide_table();
        let mut fact = |name: &str, value: String| {
            facts.add_row([name, &value]);
        };
        let step = match &self.step_time {
            Ok(time) => {
                format!("{:.2} µs (median of {} here)", time.median_ns as f64 / 1e3, time.samples)
            }
            Err(_) => "not measured: daemon run would refuse this channel".into(),
        };
        fact("solver", report.solver.to_string());
        fact("memory", format!("{} bytes", report.memory_bytes));
        fact("one step", format!("{} bytes read, {step}", report.bytes));
        fact(
            if report.solver == SolverInUse::Dense { "centers" } else { "centers of one block" },
            format!(
                "cond(K) = {:.4}, κ(0) = {:.4}, fill distance {:.3}, separation {} length scales",
                Short(report.gram_condition),
                report.value_at_zero,
                report.fill_distance.value,
                report.separation.map_or("–".into(), |q| format!("{q:.3}"))
            ),
        );
        if let Some(certificate) = &report.certificate {
            let d_n = format!("wider than {}{output_unit}", Short(certificate.d_n()));
            fact("smallest admissible dead zone", d_n);
        }
        let largest = report.largest_stable_adaptation_rate;
        fact("largest stable adaptation rate", format!("{:.4}{rate_unit}", Short(largest)));
        outln!("{facts}");

        if !self.length_scales.is_empty() {
            let mut table = Table::new();
            table.load_style(NOTHING);
            table.set_header(["length scale ×", "cond(K)", "sup P_N / √κ(0)"]);
            let or_singular =
                |value: Option<f64>| value.map_or("singular".into(), |x| format!("{:.4}", Short(x)));
            for effect in &self.length_scales {
                table.add_row([
                    effect.factor.to_string(),
                    or_singular(effect.gram_condition),
                    or_singular(effect.relative_power_function),
                ]);
            }
            outln!("\n{table}");
        }
        outln!();
    }
}

/// A table that wraps at the edge of the terminal, if stdout is one.
fn wide_table() -> Table {
    let mut table = Table::new();
    table.load_style(NOTHING).set_content_arrangement(ContentArrangement::Dynamic);
    if let Ok(size) = tcgetwinsize(stdout())
        && size.ws_col > 0
    {
        table.set_width(size.ws_col);
    }
    table
}

/// A number of any size in few characters.
struct Short(f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let digits = f.precision().unwrap_or(4);
        match self.0.abs() {
            size if (1e-3..1e5).contains(&size) => {
                let decimals = (digits as i32 - 1 - size.log10().floor() as i32).max(0) as usize;
                write!(f, "{:.decimals$}", self.0)
            }
            _ => write!(f, "{:.*e}", digits - 1, self.0),
        }
    }
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::Fails => "fails",
        Verdict::Claimed => "claimed",
        Verdict::NotApplicable => "not applicable",
    }
}

/// Prints the table for people.
pub fn print(file: &ConfigFile, checks: &[ChannelCheck]) {
    outln!("{}\n", file.name());
    checks.iter().for_each(ChannelCheck::print);
}
