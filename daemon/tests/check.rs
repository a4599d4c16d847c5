//! `daemon check`: the conditions of the theorems for a configuration, as a document and as a table.

use serde_json::Value;
use std::io::Write;
use std::process::Command;

use crate::common::Ended;

fn check(arguments: &[&str]) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_daemon"));
    command.arg("check").args(arguments);
    Ended::of(&mut command)
}

fn channel(preset: &str, name: &str) -> Value {
    let Ended { code, out: text, log } = check(&["--preset", preset, "--json"]);
    assert_eq!(code, Some(0), "{log}");
    let document: Value = serde_json::from_str(&text).unwrap();
    let channels = document["channels"].as_array().unwrap();
    channels.iter().find(|channel| channel["name"] == name).unwrap().clone()
}

fn assert_close(channel: &Value, key: &str, expected: f64, relative: f64) {
    let found = channel[key].as_f64().unwrap_or_else(|| panic!("{key}: {}", channel[key]));
    assert!((found / expected - 1.0).abs() < relative, "{key}: {found}, by hand {expected}");
}

/// By hand: P = 4 I, Q = 2λP = 80 I, ‖PL‖ = 40, E₀ = d_N = δ̄ = 0.008 √6.
#[test]
fn the_papers_translation_by_hand() {
    let translation = channel("paper-translation", "translation");
    assert_eq!(translation["controllable"], true);
    assert_eq!(translation["observable"], false);
    assert_eq!(translation["unobservable"], serde_json::json!(["position"]));
    assert_eq!(translation["hurwitz"], false);
    assert_eq!(translation["dead_zone_admissible"], false);
    assert_eq!(translation["sampled_data_stable"], true);
    let noise = 0.008 * 6.0_f64.sqrt();
    let pi = std::f64::consts::PI;
    for (key, expected, relative) in [
        ("lambda_min", 80.0, 1e-12),
        ("pl_norm", 40.0, 1e-12),
        ("e0", noise, 1e-12),
        ("d_n", noise, 1e-12),
        ("kernel_at_zero", pi * pi / 4.0, 1e-14),
        ("gram_condition", 291.692_562, 1e-4),
        ("sup_power_function", 0.443_724_775, 1e-6),
        ("dead_zone_width", 0.01, 1e-15),
        // g h (1 − E)/(λ m) = 2 (1 + E), g = γ κ(0), h = 7.5 ms.
        (
            "largest_stable_adaptation_rate",
            2.0 * (1.0 + (-0.075_f64).exp()) * 40.0 / (0.0075 * (1.0 - (-0.075_f64).exp()) * pi * pi / 4.0),
            1e-9,
        ),
        // 27 rows are four panels of eight, 8 + 16 + 24 + 32 columns of eight numbers; and three coordinates of 32.
        ("bytes", 8.0 * (80.0 * 8.0 + 3.0 * 32.0), 1e-15),
    ] {
        assert_close(&translation, key, expected, relative);
    }
    for (i, row) in translation["p"].as_array().unwrap().iter().enumerate() {
        for (j, entry) in row.as_array().unwrap().iter().enumerate() {
            assert!((entry.as_f64().unwrap() - if i == j { 4.0 } else { 0.0 }).abs() < 1e-12);
        }
    }
    assert!(
        translation["sup_power_function_upper_bound"].as_f64() > translation["sup_power_function"].as_f64()
    );
    assert!(translation["step_ns"].as_u64().unwrap() > 0);
}

/// By hand: P = I, ‖PL‖ = 150, λ_min(Q) = 4, E₀ = 75 δ̄ with δ̄ = 0.05 √3.
#[test]
fn the_papers_rotation_by_hand() {
    let rotation = channel("paper-rotation", "rotation");
    assert_eq!(rotation["observable"], true);
    assert_eq!(rotation["unobservable"], serde_json::json!([]));
    assert_eq!(rotation["hurwitz"], true);
    assert_eq!(rotation["dead_zone_admissible"], false);
    assert_close(&rotation, "e0", 75.0 * 0.05 * 3.0_f64.sqrt(), 1e-12);
    assert_close(&rotation, "pl_norm", 150.0, 1e-12);
    assert_close(&rotation, "lambda_min", 4.0, 1e-12);
    assert_close(&rotation, "gram_condition", 522_744.9, 1e-4);
}

#[test]
fn every_preset_is_reported_for_people_and_for_machines() {
    let of_the_gradient_law =
        ["(A, C) observable", "d > d_N (Theorem 2)", "sampled law stable", "solver", "memory"];
    let of_the_joint_law =
        ["not observable", "expected 1 σ", "after 10 s without outputs", "of a period of", "memory"];
    for (preset, parts) in [("rigid-body-gradient", of_the_gradient_law), ("rigid-body", of_the_joint_law)] {
        let Ended { code, out: text, log } = check(&["--preset", preset]);
        assert_eq!(code, Some(0), "{log}");
        for part in parts {
            assert!(text.contains(part), "{part} is missing in: {text}");
        }
    }
    for (name, _) in daemon::config::PRESETS {
        let Ended { code, out: text, log } = check(&["--preset", name, "--json"]);
        assert_eq!(code, Some(0), "{log}");
        let document: Value = serde_json::from_str(&text).unwrap();
        for channel in document["channels"].as_array().unwrap() {
            let keys_of_both_laws = [
                "name",
                "controllable",
                "observable",
                "unobservable",
                "gram_condition",
                "bytes",
                "step_ns",
                "period_ns",
            ];
            for key in keys_of_both_laws {
                assert!(!channel[key].is_null(), "{name}: {key}");
            }
            // What the theorems on the gradient law need; of the joint law it is null, with the reason.
            let is_joint = channel["law"] == "joint";
            for key in [
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
            ] {
                assert_eq!(channel[key].is_null(), is_joint, "{name}: {key}");
                assert_eq!(channel[format!("{key}_reason")].is_string(), is_joint, "{name}: {key}");
            }
            assert_eq!(channel["expected_std"].is_array(), is_joint, "{name}");
        }
    }
}

/// A million centers start at once, in the memory that the report states.
#[test]
fn a_million_centers_are_reported_with_their_solver_and_memory() {
    let translation = channel("million-centers", "translation");
    assert_eq!(translation["n_centers"], 1_000_000);
    assert_eq!(translation["solver"], "local");
    assert_eq!(translation["solver_block"], serde_json::json!([6, 6, 6]));
    let predicted = translation["solver_predicted_error"].as_f64().unwrap();
    assert!(predicted > 1e-4 && predicted < 5e-3, "{predicted}");
    // β and its checkpoint: 10⁴ rows of 104 numbers, three outputs.
    let nodal_values = 2 * 8 * 3 * 10_000 * 104;
    let memory_bytes = translation["memory_bytes"].as_u64().unwrap();
    assert!((nodal_values..nodal_values + 100_000).contains(&memory_bytes), "{memory_bytes}");
    assert!(translation["step_ns"].as_u64().unwrap() > 0);
    let dense = channel("paper-translation", "translation");
    assert_eq!(dense["solver"], "dense");
    assert!(dense["solver_block"].is_null() && dense["solver_block_reason"].is_string());
}

/// The report is made, and then the same sentence and exit code as those of `daemon run`.
#[test]
fn an_unstable_design_is_reported_and_refused() {
    let text = include_str!("../presets/paper-translation.toml");
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(text.replace("adaptation_rate_kg_s2 = 100.0", "adaptation_rate_kg_s2 = 1e7").as_bytes())
        .unwrap();
    let Ended { code, out: text, log } = check(&["--config", file.path().to_str().unwrap(), "--json"]);
    assert_eq!(code, Some(2), "{log}");
    assert!(log.contains("adaptation_rate_kg_s2") && log.contains("unstable"), "{log}");
    let document: Value = serde_json::from_str(&text).unwrap();
    let translation = &document["channels"][0];
    assert_eq!(translation["sampled_data_stable"], false);
    assert!(translation["step_ns"].is_null() && !translation["step_ns_reason"].is_null());
}

/// A plant that is not strictly positive real: every figure that is not proven is null, with the reason.
#[test]
fn what_is_not_proven_is_null_with_its_reason() {
    let text = include_str!("../presets/linear.toml");
    // The output is the position alone: its relative degree is two.
    let text = text
        .replace("c = [[2.0, 1.0]]", "c = [[1.0, 0.0]]")
        .replace("gain = [[1.0], [8.0]]", "gain = [[20.0], [100.0]]");
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    let Ended { out: text, .. } = check(&["--config", file.path().to_str().unwrap(), "--json"]);
    let document: Value = serde_json::from_str(&text).unwrap();
    let linear = &document["channels"][0];
    assert_eq!(linear["strictly_positive_real"], false);
    assert_eq!(linear["noise_bound"], 0.01);
    for key in ["lambda_min", "pl_norm", "e0", "d_n", "p", "level_set_factor"] {
        assert!(linear[key].is_null(), "{key}");
        assert!(linear[format!("{key}_reason")].as_str().unwrap().contains("CB"), "{key}");
    }
}
