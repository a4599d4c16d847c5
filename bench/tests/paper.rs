//! `bench paper` against a reference that shares no code with it, and the command as a user runs it.

use bench::paper::run::Run;
use bench::paper::{Example, PaperArguments, rows, run};
use clap::Parser;
use std::path::{Path, PathBuf};
use testkit::Ended;

/// What the command's flags are read with.
#[derive(Parser)]
struct CommandLine {
    #[command(flatten)]
    paper: PaperArguments,
}

fn arguments(flags: &str) -> PaperArguments {
    CommandLine::parse_from(["paper"].into_iter().chain(flags.split_whitespace())).paper
}

fn paper(flags: &str) -> Run {
    run::run(&arguments(flags).settings().unwrap()).unwrap()
}

/// Made by paper_reference.py: another language, the paper's own coordinates α̂, K⁻¹ by Cholesky, its own plants.
const REFERENCE: &str = include_str!("paper_reference.csv");

/// Rows of `paper_reference.csv` by case.
fn reference() -> Vec<(&'static str, Vec<[f64; rows::N_COLUMNS]>)> {
    let mut cases: Vec<(&str, Vec<_>)> = Vec::new();
    for line in REFERENCE.lines().skip(2) {
        let (case, numbers) = line.split_once(',').unwrap();
        let numbers: Vec<f64> = numbers.split(',').map(|number| number.parse().unwrap()).collect();
        if cases.last().is_none_or(|(last, _)| *last != case) {
            cases.push((case, Vec::new()));
        }
        cases.last_mut().unwrap().1.push(numbers.try_into().unwrap());
    }
    cases
}

/// Two programs that do the same arithmetic in another order differ by rounding only, 1e-16 in each of the some
/// thousand steps, which the observer forgets with its gain and the position adds up.
const TOLERANCE: f64 = 1e-9;

#[test]
fn every_row_of_the_reference_is_met() {
    let cases = reference();
    assert_eq!(cases.len(), 8);
    for (case, expected) in cases {
        // The table continues to the row at 10 s, which a run of 10 s does not have.
        let run = paper(&format!("--scenario {case} --duration 10.1"));
        let example = if case.starts_with("translation") { Example::Translation } else { Example::Rotation };
        let mut largest: [f64; rows::N_COLUMNS] = [0.0; rows::N_COLUMNS];
        for expected in &expected {
            let t_s = expected[0];
            let row = run.rows.iter().find(|row| (row.t_s - t_s).abs() < 1e-9).unwrap().values();
            for (column, name) in rows::columns(example).into_iter().enumerate() {
                let difference = (row[column] - expected[column]).abs();
                // On a center P_N is the root of rounding errors, of 1e-16 and so itself of 1e-8: there P_N² is
                // what can be compared.
                let square_difference = (row[column].powi(2) - expected[column].powi(2)).abs();
                let is_met = difference < TOLERANCE || (name == "coverage" && square_difference < 1e-13);
                assert!(
                    is_met,
                    "{case}, {name} at {t_s} s: {} here, {} there",
                    row[column], expected[column]
                );
                largest[column] = largest[column].max(difference);
            }
        }
        let largest = largest.map(|difference| format!("{difference:.0e}")).join(" ");
        println!("{case}: {} rows, largest differences {largest}", expected.len());
        assert_eq!(run.n_clamped, 0, "the reference knows no clamp");
    }
}

#[test]
fn a_run_has_the_samples_before_its_end() {
    assert_eq!(paper("--scenario translation").rows.len(), 12_000);
    let rows = paper("--scenario rotation --rate-hz 300 --duration 0.7").rows;
    assert_eq!(rows.len(), 210);
    assert!(rows.iter().enumerate().all(|(j, row)| row.t_s == j as f64 / 300.0));
}

#[test]
fn the_paper_s_settings_are_the_defaults() {
    let given = "--scenario translation --dead-zone quadratic --width 0.01 --buffer 0.01 --adaptation-rate 1 \
                 --kernel-order 3 --length-scale 1 --gain 10 --initial reference --rate-hz 200 --duration 60 \
                 --scheme update-first --f-at true";
    assert_eq!(arguments(given).settings(), arguments("--scenario translation").settings());
    let rotation =
        given.replace("translation", "rotation").replace("0.01 --b", "0.1 --b").replace("60", "100");
    assert_eq!(arguments(&rotation).settings(), arguments("--scenario rotation").settings());
}

/// f felt at y(t), δ moving within the steps: the true pose and rate at 5 s, from paper_reference.py with the
/// plants' rates changed by hand to take f at v + δ(t) at every stage.
#[test]
fn a_force_felt_at_the_measured_velocity_moves_the_truth() {
    let translation = [
        0.2336913425861,
        0.5916111835073,
        -0.5120224388798,
        0.4965790641775,
        0.8975260730804,
        -1.372222292025,
    ];
    let rotation = [
        0.4814263587278,
        0.06052091881408,
        0.08318810615618,
        0.08737552101573,
        0.03867186015504,
        0.03033247355942,
    ];
    for (scenario, expected) in [("translation", translation), ("rotation", rotation)] {
        let flags = format!("--scenario {scenario} --duration 5.1");
        let at_5_s = |flags: &str| paper(flags).rows[1000].values();
        let (truly, measured) = (at_5_s(&flags), at_5_s(&format!("{flags} --f-at measured")));
        for (column, expected) in (1..).zip(expected) {
            assert!((measured[column] - expected).abs() < TOLERANCE, "{scenario}: {}", measured[column]);
        }
        let moved = (1..7).map(|column| (measured[column] - truly[column]).abs()).fold(0.0, f64::max);
        assert!(moved > 1e-4, "{scenario}: the same plant, but for {moved:e}");
    }
}

/// A start far off, the paper's unbounded σ₀, and an adaptation rate near the largest.
#[test]
fn a_run_in_which_sigma_was_held_down_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let flags = [
        "--scenario",
        "translation",
        "--initial",
        "zero-velocity",
        "--adaptation-rate",
        "2e5",
        "--duration",
        "5",
    ];
    let run = paper(&flags.join(" "));
    assert!(run.n_clamped > 0 && run.n_clamped < run.rows.len());
    let summary = output_of(&flags, directory.path());
    assert!(summary.out.contains(&format!("held down in {} steps", run.n_clamped)));
    let document = output_of(&[&flags[..], &["--json"]].concat(), directory.path());
    let document: serde_json::Value = serde_json::from_str(&document.out).unwrap();
    assert_eq!(document["sigma_clamped_steps"], run.n_clamped);
}

/// What the options are there to show: the paper's settings hardly learn the force, others do.
#[test]
fn the_paper_s_settings_hardly_learn_and_others_do() {
    let force_rms = |flags: &str| {
        let settings = arguments(flags).settings().unwrap();
        let report = bench::paper::report::Report::new(&settings, &run::run(&settings).unwrap());
        (report.force.second_half.norm, report.true_force.second_half.norm)
    };
    let (error, truth) = force_rms("--scenario translation");
    assert!(error > 0.95 * truth && error < truth, "{error} of {truth} N");
    let (error, truth) = force_rms("--scenario translation --dead-zone saturated --adaptation-rate 100");
    assert!(error < 0.3 * truth, "{error} of {truth} N");
    let (error, truth) = force_rms("--scenario rotation");
    assert_eq!(error, truth, "no output error leaves the rotation's dead zone");
}

fn output_of(flags: &[&str], out: &Path) -> Ended {
    crate::programs::bench(&[&["paper", "--out", out.to_str().unwrap()], flags].concat())
}

#[test]
fn the_table_gives_the_same_numbers_back() {
    let directory = tempfile::tempdir().unwrap();
    for (scenario, example) in [("translation", Example::Translation), ("rotation", Example::Rotation)] {
        let flags = ["--scenario", scenario, "--duration", "2", "--dead-zone", "step", "--width", "0.02"];
        output_of(&flags, directory.path()).ok();
        let table = std::fs::read_to_string(directory.path().join(format!("{scenario}.csv"))).unwrap();
        let mut lines = table.lines();
        assert_eq!(lines.next().unwrap().split(',').collect::<Vec<_>>(), rows::columns(example));
        let rows = paper(&flags.join(" ")).rows;
        assert_eq!(lines.clone().count(), rows.len());
        for (line, row) in lines.zip(rows) {
            let read = line.split(',').map(|number| number.parse::<f64>().unwrap().to_bits());
            assert!(read.eq(row.values().map(f64::to_bits)), "{line}");
        }
    }
}

#[test]
fn the_command_writes_its_files_and_prints_one_document() {
    let parent = tempfile::tempdir().unwrap();
    let directory = parent.path().join("made/when/missing");
    for (scenario, figures, pose, force) in [
        ("translation", &["position"][..], "position_rms_m", "force_rms_n"),
        ("rotation", &["euler_angles", "angular_rate"], "euler_angle_rms_rad", "torque_rms_n_m"),
    ] {
        let output = output_of(&["--scenario", scenario, "--duration", "5", "--json"], &directory);
        let document: serde_json::Value = serde_json::from_str(&output.ok()).unwrap();
        assert_eq!(document["scenario"], scenario);
        assert_eq!((&document["rate_hz"], &document["duration_s"]), (&200.0.into(), &5.0.into()));
        assert_eq!(
            (&document["dead_zone"], &document["initial"]),
            (&"quadratic".into(), &"reference".into())
        );
        assert_eq!((&document["scheme"], &document["f_at"]), (&"update-first".into(), &"true".into()));
        for key in ["kernel_order", "gain_per_s", "samples", "sigma_mean", "sigma_clamped_steps"] {
            assert!(document[key].is_number(), "{key}");
        }
        let (rate, adaptation) = if scenario == "translation" { ("m_s", "kg_s2") } else { ("rad_s", "n_m") };
        for key in ["width_", "buffer_", "length_scale_"].map(|key| format!("{key}{rate}")) {
            assert!(document[&key].is_number(), "{key}");
        }
        assert_eq!(document[format!("adaptation_rate_{adaptation}")], 1.0);
        for key in [pose, force] {
            assert!(document[key]["whole_run"]["norm"].is_number(), "{key}");
            assert_eq!(document[key]["second_half"]["axes"].as_array().unwrap().len(), 3, "{key}");
        }
        let mut expected = vec![directory.join(format!("{scenario}.csv"))];
        expected.extend(figures.iter().map(|name| directory.join(format!("{name}.svg"))));
        let files: Vec<PathBuf> = serde_json::from_value(document["files"].clone()).unwrap();
        assert_eq!(files, expected);
        for file in files {
            assert!(std::fs::metadata(&file).unwrap().len() > 10_000, "{}", file.display());
        }
    }
}

/// Each refused with exit code 2, the option's name, and what would be accepted; nothing is written.
#[test]
fn impossible_options_are_refused_by_name() {
    let cases = [
        ("", "--scenario"),
        ("--scenario boat", "possible values: translation, rotation"),
        ("--scenario rotation --dead-zone round", "possible values: quadratic, saturated, step"),
        ("--scenario rotation --width -0.1", "a finite number ≥ 0"),
        ("--scenario rotation --buffer 0", "a finite number > 0"),
        ("--scenario rotation --gain nan", "a finite number > 0"),
        ("--scenario rotation --length-scale inf", "a finite number > 0"),
        ("--scenario rotation --kernel-order 1", "--kernel-order: found"),
        ("--scenario rotation --rate-hz 20", "--rate-hz: found 20; needed: 50 to 10000 Hz"),
        ("--scenario translation --duration 0.001", "--duration: found 0.001 s"),
        ("--scenario translation --duration 1e9", "needed: 2 to 2000000 samples"),
        ("--scenario translation --adaptation-rate 1e9", "--adaptation-rate: found 1000000000 is unstable"),
        ("--scenario translation --adaptation-rate 1e9", "needed: an adaptation rate below"),
        ("--scenario rotation --length-scale 1e6", "--length-scale, --kernel-order: found the Gram matrix"),
    ];
    let parent = tempfile::tempdir().unwrap();
    let out = parent.path().join("nothing");
    for (flags, expected) in cases {
        let output = output_of(&flags.split_whitespace().collect::<Vec<_>>(), &out);
        assert_eq!(output.code, Some(2), "{flags}: {output:?}");
        assert!(output.log.contains(expected), "{flags}: {output:?}");
        assert!(output.out.is_empty() && !out.exists(), "{flags}");
    }
}

#[test]
fn failures_while_running_have_an_exit_code_of_their_own() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("a file");
    std::fs::write(&file, "").unwrap();
    let output = output_of(&["--scenario", "translation", "--duration", "1"], &file);
    assert!(output.code == Some(1) && output.log.contains("cannot make the output directory"), "{output:?}");

    let unstable =
        "--scenario translation --scheme predict-first --dead-zone saturated --adaptation-rate 2e5";
    let output = output_of(&unstable.split_whitespace().collect::<Vec<_>>(), directory.path());
    assert!(output.code == Some(1) && output.log.contains("the estimate is not finite after"), "{output:?}");
}
