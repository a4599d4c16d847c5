//! `daemon check`: prints what is proven for a configuration.

use super::arguments::DesignArguments;
use crate::check::{
    self, ChannelCheck, LateSample, LawReport, MAX_CENTERS_TO_COMPARE, StepTime, Units, checks,
};
use crate::config::{ConfigError, ConfigFile};
use clap::Args;
use comfy_table::{ContentArrangement, Table, presets::NOTHING};
use observer::{
    Certificate, DesignReport, ExpectedStd, JointReport, LengthScaleEffect, SolverInUse, Verdict,
};
use rustix::stdio::stdout;
use rustix::termios::tcgetwinsize;
use serde_json::{Value, json};
use shared_types::outln;

mod sensors;

#[derive(Debug, Args)]
pub(super) struct CheckArguments {
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    design: DesignArguments,
}

/// Runs `daemon check`.
pub(super) fn run(arguments: &CheckArguments) -> anyhow::Result<()> {
    let file = arguments.design.read()?;
    let checks = checks(&file)?;
    // The same refusal as that of `daemon run`, and the same exit code.
    let refusal = refusal(&file, &checks);
    if arguments.json {
        outln!("{}", serde_json::to_string_pretty(&document(&file, &checks, refusal.as_ref()))?);
    } else {
        outln!("{}: {}\n", if refusal.is_none() { "ready" } else { "not ready" }, file.name());
        checks.iter().for_each(|check| print(&file, check));
        file.config.sensor.iter().for_each(|sensor| outln!("{}", sensors::in_words(&file, sensor)));
        outln!("{}", late_in_words(&file, check::time_of_late_sample(&file).as_ref()));
    }
    refusal.map_or(Ok(()), |refusal| Err(refusal.into()))
}

/// Why `daemon run` refuses the configuration, if it does.
fn refusal(file: &ConfigFile, checks: &[ChannelCheck]) -> Option<ConfigError> {
    let of_channel = checks.iter().find_map(ChannelCheck::refusal).cloned();
    let times = || checks.iter().filter_map(|check| check.step_time.as_ref().ok());
    let all = StepTime {
        median_ns: times().map(|time| time.median_ns).sum(),
        samples: times().map(|time| time.samples).min().unwrap_or(0),
    };
    of_channel.or_else(|| check::fits(file, &all).err())
}

/// The document of `--json`.
fn document(file: &ConfigFile, checks: &[ChannelCheck], refusal: Option<&ConfigError>) -> Value {
    let channels: Vec<_> = checks
        .iter()
        .map(|check| {
            let mut document = match &check.report {
                LawReport::Gradient { report, length_scales } => {
                    gradient_document(check, report, length_scales)
                }
                LawReport::Joint(report) => joint_document(check, report),
            };
            document["period_ns"] = check::period_ns(file).into();
            document
        })
        .collect();
    json!({
        "configuration": file.name(),
        "ready": refusal.is_none(),
        "reasons": refusal.map(ToString::to_string).into_iter().collect::<Vec<_>>(),
        "channels": channels,
        "sensors": file.config.sensor.iter().map(|sensor| sensors::document(file, sensor)).collect::<Vec<_>>(),
        "late_sample": check::time_of_late_sample(file).map(|late| {
            json!({
                "late_s": late.late_s,
                "samples_fused_again": late.n_fused_again,
                "tick_ns": late.tick.median_ns,
                "ticks": late.tick.samples,
            })
        }),
    })
}

/// What late samples cost.
fn late_in_words(file: &ConfigFile, late: Option<&LateSample>) -> String {
    let Some(LateSample { late_s, n_fused_again, tick }) = late else {
        return "late samples: too late, none is used: the local solver cannot go back".into();
    };
    format!(
        "late samples: up to {} s (input.max_age_s); one that is {late_s} s late has {n_fused_again} samples at rate_hz fused \
         again in its tick, which takes {:.0} µs of a period of {:.0} µs (median of {} here)",
        file.config.input.max_age_s,
        tick.median_ns as f64 / 1e3,
        check::period_ns(file) as f64 / 1e3,
        tick.samples,
    )
}

/// The keys of the theorems, which are about the gradient law.
const KEYS_OF_THEOREMS: [&str; 11] = [
    "hurwitz",
    "lambda_min",
    "pl_norm",
    "e0",
    "sup_power_function",
    "d_n",
    "dead_zone_width",
    "dead_zone_admissible",
    "sampled_data_stable",
    "largest_stable_adaptation_rate",
    "adaptation_rate",
];

fn joint_document(check: &ChannelCheck, report: &JointReport) -> Value {
    let expected = |expected: &ExpectedStd| {
        let mut document = json!({ "coast_s": expected.coast_s });
        for (name, unit, std) in [
            ("output", check.units.output, expected.output),
            ("pose", check.units.pose, expected.pose),
            ("force", check.units.force, expected.force),
        ] {
            document[format!("{name}_std_{}", in_key(unit))] = json!(std);
        }
        document
    };
    let mut document = json!({
        "name": check.name,
        "law": "joint",
        "output_unit": check.units.output,
        "controllable": true,
        "observable": report.unobservable.is_empty(),
        "unobservable": report.unobservable,
        "n_rows": report.n_rows,
        "n_centers": report.n_centers,
        "gram_condition": report.gram_condition,
        "bytes": report.bytes,
        "memory_bytes": report.memory_bytes,
        "step_ns": check.step_time.as_ref().ok().map(|time| time.median_ns),
        "step_samples": check.step_time.as_ref().map_or(0, |time| time.samples),
        "expected_std": report.expected_std.iter().map(expected).collect::<Vec<_>>(),
    });
    if let Err(refusal) = &check.step_time {
        document["step_ns_reason"] = format!("daemon run refuses this channel: {refusal}").into();
    }
    for key in KEYS_OF_THEOREMS {
        document[key] = Value::Null;
        document[format!("{key}_reason")] = "belongs to the theorems of law = \"gradient\"".into();
    }
    document
}

/// A unit at the end of a key.
fn in_key(unit: &str) -> String {
    unit.replace("N·m", "n_m").replace('/', "_").replace('N', "n")
}

fn rows(matrix: &nalgebra::DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

fn gradient_document(
    check: &ChannelCheck,
    report: &DesignReport,
    length_scales: &[LengthScaleEffect],
) -> Value {
    let certificate = report.certificate.as_ref();
    let pair = report.lure.as_ref().ok();
    let mut document = json!({
        "name": check.name,
        "law": "gradient",
        "output_unit": check.units.output,
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
        "step_ns": check.step_time.as_ref().ok().map(|time| time.median_ns),
        "step_samples": check.step_time.as_ref().map_or(0, |time| time.samples),
        "length_scale_effect": length_scales,
        "findings": report.findings(),
    });
    let reasons = document.as_object_mut().expect("an object was made");
    reasons
        .extend(numbers.as_object().into_iter().flatten().map(|(key, value)| (key.clone(), value.clone())));
    let nothing_compared = format!("not compared with more than {MAX_CENTERS_TO_COMPARE} centers");
    if length_scales.is_empty() {
        reasons.insert("length_scale_effect".into(), Value::Null);
    }
    let missing: Vec<_> =
        reasons.iter().filter(|(_, value)| value.is_null()).map(|(key, _)| key.clone()).collect();
    for key in missing {
        let reason = match (key.as_str(), &report.lure, &check.step_time) {
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

/// Prints one channel for people.
fn print(file: &ConfigFile, check: &ChannelCheck) {
    match &check.report {
        LawReport::Gradient { report, length_scales } => print_gradient(file, check, report, length_scales),
        LawReport::Joint(report) => print_joint(file, check, report),
    }
}

fn print_joint(file: &ConfigFile, check: &ChannelCheck, report: &JointReport) {
    outln!("{}, joint law, {} centers, {} rows", check.name, report.n_centers, report.n_rows);
    let mut facts = wide_table();
    for hidden in &report.unobservable {
        facts.add_row(["not observable", hidden]);
    }
    facts.add_row(["memory", &format!("{} bytes", report.memory_bytes)]);
    facts.add_row(["one step", &format!("{} bytes read, {}", report.bytes, step_in_words(file, check))]);
    outln!("{facts}\n");
    let mut table = Table::new();
    table.load_style(NOTHING);
    let Units { output, pose, force, .. } = check.units;
    let column = |name: &str, unit: &str| format!("{name} ({unit})");
    let (pose_name, output_name, force_name) = match check.name {
        "translation" => ("position", "velocity", "force"),
        _ => ("attitude", "rate", "torque"),
    };
    table.set_header([
        "expected 1 σ".to_owned(),
        column(output_name, output),
        column(pose_name, pose),
        column(force_name, force),
    ]);
    for expected in &report.expected_std {
        let when = match expected.coast_s > 0.0 {
            true => format!("after {} s without outputs", Number(expected.coast_s)),
            false => "after 10 s of flight".to_owned(),
        };
        let largest = |std: [f64; 3]| Number(std.into_iter().fold(0.0, f64::max)).to_string();
        table.add_row([when, largest(expected.output), largest(expected.pose), largest(expected.force)]);
    }
    outln!("{table}\n");
}

/// Three digits.
struct Number(f64);

impl std::fmt::Display for Number {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text = format!("{:.3}", Short(self.0));
        match text.contains('.') && !text.contains('e') {
            true => f.write_str(text.trim_end_matches('0').trim_end_matches('.')),
            false => f.write_str(&text),
        }
    }
}

/// `3.21 µs of the period's 5000 (median of 400 here)`
fn step_in_words(file: &ConfigFile, check: &ChannelCheck) -> String {
    match &check.step_time {
        Ok(time) => format!(
            "{:.2} µs of a period of {:.0} µs (median of {} here)",
            time.median_ns as f64 / 1e3,
            check::period_ns(file) as f64 / 1e3,
            time.samples
        ),
        Err(_) => "not measured: daemon run would refuse this channel".into(),
    }
}

fn print_gradient(
    file: &ConfigFile,
    check: &ChannelCheck,
    report: &DesignReport,
    length_scales: &[LengthScaleEffect],
) {
    let unit = |unit: &str| if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let (output_unit, rate_unit) = (unit(check.units.output), unit(check.units.adaptation_rate));
    outln!("{}, gradient law, {} centers", check.name, report.n_centers);
    let mut table = wide_table();
    for finding in report.findings() {
        table.add_row([word(finding.verdict), &finding.condition, &finding.detail]);
    }
    outln!("{table}\n");

    let mut facts = wide_table();
    let mut fact = |name: &str, value: String| {
        facts.add_row([name, &value]);
    };
    fact("solver", report.solver.to_string());
    fact("memory", format!("{} bytes", report.memory_bytes));
    fact("one step", format!("{} bytes read, {}", report.bytes, step_in_words(file, check)));
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

    if !length_scales.is_empty() {
        let mut table = Table::new();
        table.load_style(NOTHING);
        table.set_header(["length scale ×", "cond(K)", "sup P_N / √κ(0)"]);
        let or_singular =
            |value: Option<f64>| value.map_or("singular".into(), |x| format!("{:.4}", Short(x)));
        for effect in length_scales {
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
