//! A configuration that cannot work is refused: the message has the place, what was found and what would be accepted, and
//! nothing is started.

use crate::common::{Ended, TestDomain, run_daemon};
use daemon::assemble;
use daemon::config::ConfigFile;
use std::io::Write;
use std::process::Command;

/// The smallest useful file; tests spoil one line of it.
const GOOD: &str = "rate_hz = 200.0

[translation]
mass_kg = 4.0
gain_per_s = 10.0
adaptation_rate_kg_s2 = 100.0
length_scale_m_s = 1.0
centers_lower_m_s = [-1.0, -1.0, -1.0]
centers_upper_m_s = [1.0, 1.0, 1.0]
centers_per_axis = [3, 3, 3]
dead_zone_width_m_s = 0.01
dead_zone_buffer_m_s = 0.01
noise_bound_m_s = 0.02
law = \"gradient\"
";

fn refusal(text: &str) -> String {
    let file = match ConfigFile::parse("vehicle.toml".into(), text.into()) {
        Err(error) => return error.to_string(),
        Ok(file) => file,
    };
    assemble::estimator(&file).expect_err(text).to_string()
}

#[track_caller]
fn assert_refused(text: &str, parts: &[&str]) {
    let message = refusal(text);
    for part in parts {
        assert!(message.contains(part), "'{part}' is missing in: {message}");
    }
}

#[test]
fn unknown_keys_and_wrong_units_name_the_line_and_the_key_that_was_meant() {
    assert_refused(
        &GOOD.replace("mass_kg", "mass_lb"),
        &["vehicle.toml, line 4", "mass_lb", "did you mean `mass_kg`"],
    );
    assert_refused(&GOOD.replace("rate_hz", "rate_khz"), &["line 1", "did you mean `rate_hz`"]);
    assert_refused(&GOOD.replace("width_m_s", "width_mm_s"), &["line 11", "dead_zone_width_m_s"]);
    assert_refused(&(GOOD.to_owned() + "\n[rotaton]\n"), &["line 16", "did you mean `rotation`"]);
}

#[test]
fn missing_keys_and_wrong_types_say_what_is_needed() {
    assert_refused(
        &GOOD.replace("mass_kg = 4.0\n", ""),
        &["line 3", "missing field `mass_kg`", "Nominal mass"],
    );
    assert_refused(&GOOD.replace("4.0", "\"heavy\""), &["line 4", "expected f64"]);
    assert_refused(&GOOD.replace("= 100.0", "= [1.0, 2.0]"), &["line 6", "three numbers (a diagonal)"]);
    assert_refused(&GOOD.replace("[3, 3, 3]", "[3, 3]"), &["line 10", "array of length 3"]);
    assert_refused(
        &GOOD.replace("rate_hz = 200.0", "rate_hz = 200.0\ntrigger = \"never\""),
        &["line 2", "`timer`"],
    );
    assert_refused("rate_hz = = 3", &["line 1"]);
    assert_refused("rate_hz = 200.0\n", &["neither [translation] nor [rotation]"]);
}

#[test]
fn values_out_of_range_name_their_line() {
    assert_refused(&GOOD.replace("200.0", "0.1"), &["line 1", "rate_hz", "found 0.1", "1 … 10000"]);
    assert_refused(&GOOD.replace("4.0", "-4.0"), &["line 4", "mass_kg", "positive definite"]);
    assert_refused(&GOOD.replace("10.0", "0.0"), &["line 5", "gain_per_s", "> 0"]);
    assert_refused(
        &GOOD.replace("width_m_s = 0.01", "width_m_s = -1.0"),
        &["line 11", "dead_zone_width_m_s"],
    );
    assert_refused(
        &GOOD.replace("buffer_m_s = 0.01", "buffer_m_s = 0.0"),
        &["line 12", "dead_zone_buffer_m_s"],
    );
    assert_refused(&GOOD.replace("0.02", "nan"), &["line 13", "noise_bound_m_s"]);
    assert_refused(&(GOOD.to_owned() + "sample_rate_hz = 0.0\n"), &["line 15", "sample_rate_hz"]);
    assert_refused(&(GOOD.to_owned() + "\n[input]\nmax_age_s = 0.0\n"), &["line 17", "max_age_s"]);
    let attitude = "\n[initial]\nattitude_wxyz = [1.0, 1.0, 0.0, 0.0]\n";
    assert_refused(&(GOOD.to_owned() + attitude), &["line 17", "unit quaternion"]);
    assert_refused(&GOOD.replace("200.0", "200.0\nspin_us = 6000.0"), &["line 2", "0 … 5000"]);
}

#[test]
fn unstable_gains_are_refused_with_the_largest_stable_rate() {
    assert_refused(
        &GOOD.replace("= 100.0", "= 1e7"),
        &["line 6", "adaptation_rate_kg_s2", "unstable", "below 1"],
    );
    // The same rate is unstable where samples are rare: the hold is longer.
    let rare = GOOD.replace("= 100.0", "= 2000.0") + "sample_rate_hz = 2.0\n";
    assert_refused(&rare, &["adaptation_rate_kg_s2", "held for 0.75 s"]);
}

#[test]
fn equal_centers_are_named() {
    let lattice = "centers_lower_m_s = [-1.0, -1.0, -1.0]\ncenters_upper_m_s = [1.0, 1.0, 1.0]\ncenters_per_axis = [3, 3, 3]\n";
    let listed = "centers_listed_m_s = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]\n";
    assert_refused(&GOOD.replace(lattice, listed), &["centers 2 and 3", "length scale"]);
    assert_refused(&(GOOD.to_owned() + listed), &["a lower corner", "either centers_lower_…"]);
    assert_refused(&GOOD.replace(lattice, ""), &["found none"]);
}

#[test]
fn a_linear_plant_of_wrong_shape_is_refused_by_its_key() {
    let good = include_str!("../presets/linear.toml");
    assert_refused(
        &good.replace("b = [[0.0], [0.5]]", "b = [[0.0]]"),
        &["line 9", "linear.b", "B of 1×1", "2×1"],
    );
    assert_refused(
        &good.replace("[-3.0, -0.2]]", "[-3.0]]"),
        &["line 8", "linear.a", "rows of [2, 1] numbers"],
    );
    assert_refused(
        &good.replace("gain = [[1.0], [8.0]]", "gain = [[-9.0], [-9.0]]"),
        &["linear.gain", "a pole at"],
    );
    assert_refused(&good.replace("rate = 50.0", "rate = 1e9"), &["linear.adaptation_rate", "below"]);
    assert_refused(&good.replace("[[0.0], [0.5]]", "[[0.0], [-0.5]]"), &["positive real"]);
    assert_refused(
        &good.replace("[[2.0, 1.0]]", "[[0.0, 0.0]]"),
        &["line 10", "linear.c", "singular values"],
    );
    assert_refused(&good.replace("[13]", "[400000000]"), &["line 1", "linear.centers_", "at most"]);
    let dense = good.replace("[13]", "[30000]") + "solver = \"dense\"\n";
    assert_refused(&dense, &["linear.centers_lower", "7 GB", "at most 20000"]);
    // The local solver, which "auto" takes here, has no such matrix.
    let local = ConfigFile::parse("vehicle.toml".into(), good.replace("[13]", "[30000]")).unwrap();
    assert!(
        assemble::estimator(&local)
            .unwrap()
            .linear
            .unwrap()
            .law()
            .function()
            .solver()
            .to_string()
            .contains("local")
    );
    assert_refused(&good.replace("200.0", "0.0"), &["line 4", "rate_hz"]);
    assert_refused(&good.replace("[13]", "[13, 2]"), &["linear.centers_lower"]);
    assert_refused(&good.replace("\"velocity\"", "\"velocity\", \"x\""), &["3 state_names for 2 states"]);
    assert_refused(&good.replace("noise_bound = 0.01", "noise_bound = -1.0"), &["linear.noise_bound"]);
}

#[test]
fn kernels_of_every_kind_are_taken_and_unknown_ones_refused() {
    for kernel in ["sobolev-matern-2", "sobolev-matern-7", "gaussian", "wendland-c2", "wendland-c4"] {
        let text = GOOD.to_owned() + &format!("kernel = \"{kernel}\"\n");
        let file = ConfigFile::parse("vehicle.toml".into(), text).unwrap();
        assemble::estimator(&file).unwrap();
    }
    assert_refused(&(GOOD.to_owned() + "kernel = \"matern\"\n"), &["line 15", "sobolev-matern-K"]);
    assert_refused(&(GOOD.to_owned() + "kernel = \"sobolev-matern-1\"\n"), &["line 15", "from 2 to"]);
    let scales = GOOD.replace("length_scale_m_s = 1.0", "length_scale_m_s = [1.0, 2.0]");
    assert_refused(&scales, &["length_scale_m_s", "one for each of the 3 axes"]);
}

#[test]
fn solvers_are_taken_by_name_or_with_options() {
    let with = |solver: &str| GOOD.to_owned() + solver + "\n";
    let local = "solver = { kind = \"local\", block = 4, accuracy = 1e-3, truncation = 1e-4 }";
    for solver in ["solver = \"auto\"", "solver = \"dense\"", "solver = \"local\"", local] {
        let file = ConfigFile::parse("vehicle.toml".into(), with(solver)).unwrap();
        assemble::estimator(&file).unwrap();
        // What `daemon config` prints means the same.
        let again = ConfigFile::parse("again".into(), file.commented_toml()).unwrap();
        assert_eq!(again.config, file.config, "{}", file.commented_toml());
    }
    assert_refused(&with("solver = \"fast\""), &["line 15", "\"local\""]);
    assert_refused(
        &with("solver = { kind = \"local\", block = 5 }"),
        &["line 15", "even number from 4 to 12"],
    );
    assert_refused(&with("solver = { kind = \"local\", truncation = 2.0 }"), &["line 15", "truncation at 2"]);
    assert_refused(&with("solver = { kind = \"local\", blocks = 4 }"), &["line 15"]);
}

/// Dense where that is cheap, local where it is not; both say so.
#[test]
fn the_automatic_solver_goes_by_the_number_of_centers() {
    let solver = |per_axis: usize| {
        let counts = format!("centers_per_axis = [{per_axis}, {per_axis}, {per_axis}]");
        let text = GOOD.replace("centers_per_axis = [3, 3, 3]", &counts);
        let file = ConfigFile::parse("vehicle.toml".into(), text).unwrap();
        let estimator = assemble::estimator(&file).unwrap();
        estimator.rigid_body.unwrap().translation().unwrap().function().solver().to_string()
    };
    assert_eq!(solver(3), "dense, exact");
    assert!(solver(13).contains("local, from a block of"), "{}", solver(13));
    // Listed centers have no local solver: the message says what to do.
    let listed = GOOD.lines().filter(|line| !line.starts_with("centers_")).collect::<Vec<_>>().join("\n");
    let point = |i: i32| format!("[{}.0, {}.0, {}.0]", i % 15, i / 15 % 15, i / 225);
    let points = (0..3001).map(point).collect::<Vec<_>>().join(", ");
    let listed = format!("{listed}\ncenters_listed_m_s = [{points}]\n");
    assert_refused(&listed, &["solver", "3001 listed centers", "lattice", "solver = \"dense\""]);
}

#[test]
fn a_refused_configuration_starts_nothing() {
    let domain = TestDomain::new();
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(GOOD.replace("4.0", "0.0").as_bytes()).unwrap();
    let Ended { code, log, .. } = run_daemon(&domain, &["--config", file.path().to_str().unwrap()]).finish();
    assert_eq!(code, Some(2), "{log}");
    assert!(log.contains("line 4") && log.contains("mass_kg"), "{log}");
    domain.assert_clean();

    let Ended { code, log, .. } = run_daemon(&domain, &["--config", "/nowhere/vehicle.toml"]).finish();
    assert!(code == Some(2) && log.contains("/nowhere/vehicle.toml"), "{log}");
    let Ended { code, log, .. } = run_daemon(&domain, &["--preset", "boat"]).finish();
    assert!(code == Some(2) && log.contains("paper-translation"), "{log}");
    let Ended { code, log, .. } = run_daemon(&domain, &["--instance", "a/b"]).finish();
    assert!(code == Some(2) && log.contains("letters, digits"), "{log}");
    domain.assert_clean();
}

#[test]
fn what_is_merely_unproven_is_one_sentence() {
    let file = ConfigFile::preset("paper-translation").unwrap();
    let sentences = daemon::check::unproven(&file, &assemble::estimator(&file).unwrap());
    assert_eq!(sentences.len(), 1, "{sentences:?}");
    assert!(sentences[0].contains("position cannot be observed"), "{sentences:?}");
    assert!(sentences[0].contains("d_N = 0.0196"), "{sentences:?}");
}

#[test]
fn config_prints_the_effective_configuration() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_daemon"));
    command.args(["config", "--preset", "auv", "--rate-hz", "50"]);
    let Ended { code, out: text, log } = Ended::of(&mut command);
    assert_eq!(code, Some(0), "{log}");
    let mut expected = ConfigFile::preset("auv").unwrap();
    expected.config.rate_hz = 50.0;
    assert_eq!(text, expected.commented_toml());
}
