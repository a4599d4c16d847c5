//! `daemon check`: prints what is proven for a configuration.

use super::arguments::DesignArguments;
use crate::check::{ChannelCheck, MAX_CENTERS_TO_COMPARE, checks};
use crate::config::ConfigFile;
use clap::Args;
use comfy_table::{ContentArrangement, Table, presets::NOTHING};
use observer::{Certificate, SolverInUse, Verdict};
use rustix::stdio::stdout;
use rustix::termios::tcgetwinsize;
use serde_json::{Value, json};
use shared_types::outln;

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
    if arguments.json {
        outln!("{}", serde_json::to_string_pretty(&document(&file, &checks))?);
    } else {
        outln!("{}\n", file.name());
        checks.iter().for_each(print);
    }
    // The same refusal as that of `daemon run`, and the same exit code.
    match checks.iter().find_map(ChannelCheck::refusal) {
        Some(refusal) => Err(refusal.clone().into()),
        None => Ok(()),
    }
}

/// The document of `--json`.
fn document(file: &ConfigFile, checks: &[ChannelCheck]) -> Value {
    let channels: Vec<_> = checks.iter().map(channel_document).collect();
    json!({ "configuration": file.name(), "channels": channels })
}

fn rows(matrix: &nalgebra::DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

fn channel_document(check: &ChannelCheck) -> Value {
    let report = &check.report;
    let certificate = report.certificate.as_ref();
    let pair = report.lure.as_ref().ok();
    let mut document = json!({
        "name": check.name,
        "output_unit": check.units.0,
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
        "length_scale_effect": check.length_scales,
        "findings": report.findings(),
    });
    let reasons = document.as_object_mut().expect("an object was made");
    reasons
        .extend(numbers.as_object().into_iter().flatten().map(|(key, value)| (key.clone(), value.clone())));
    let nothing_compared = format!("not compared with more than {MAX_CENTERS_TO_COMPARE} centers");
    if check.length_scales.is_empty() {
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
fn print(check: &ChannelCheck) {
    let report = &check.report;
    let unit = |unit: &str| if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let (output_unit, rate_unit) = (unit(check.units.0), unit(check.units.1));
    outln!("{}, {} centers", check.name, report.n_centers);
    let mut table = wide_table();
    for finding in report.findings() {
        table.add_row([word(finding.verdict), &finding.condition, &finding.detail]);
    }
    outln!("{table}\n");

    let mut facts = wide_table();
    let mut fact = |name: &str, value: String| {
        facts.add_row([name, &value]);
    };
    let step = match &check.step_time {
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

    if !check.length_scales.is_empty() {
        let mut table = Table::new();
        table.load_style(NOTHING);
        table.set_header(["length scale ×", "cond(K)", "sup P_N / √κ(0)"]);
        let or_singular =
            |value: Option<f64>| value.map_or("singular".into(), |x| format!("{:.4}", Short(x)));
        for effect in &check.length_scales {
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
