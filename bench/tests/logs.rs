//! Recorded flights: a log that is truncated anywhere, and the result of `bench tune`.

use crate::programs::{bench, document};
use importers::{ImportOptions, parse_flight};
use sim_publisher::{Scenario, Simulation, SimulationOptions};
use std::path::{Path, PathBuf};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");

/// The recorded flight of this name, unless it is not here.
fn recorded(name: &str) -> Option<PathBuf> {
    let path = Path::new(DATA).join(name);
    if !path.exists() {
        testkit::skip("a recorded flight", &format!("{} is not here", path.display()));
    }
    path.exists().then_some(path)
}

/// Pseudo-random places that are the same in every run (xorshift).
fn places(length: usize) -> impl Iterator<Item = usize> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    (0..20).map(move |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % length as u64) as usize
    })
}

/// Cut off at 20 places, it is a shorter flight or a sentence.
#[track_caller]
fn cut_off(importer: &dyn importers::Importer, path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    let parse = |length: usize| parse_flight(importer, &bytes[..length], "cut", &ImportOptions::default());
    let whole = parse(bytes.len()).unwrap();
    // The heads of both formats are shorter than a tenth.
    let heads = [0, 1, 100].into_iter();
    let (mut shorter, mut refused) = (0, 0);
    for place in heads.chain(places(bytes.len())) {
        match parse(place) {
            Ok(flight) => {
                assert!((1..=whole.samples.len()).contains(&flight.samples.len()), "cut at {place}");
                shorter += 1;
            }
            Err(error) => {
                assert!(error.to_string().contains("'cut'"), "cut at {place}: {error}");
                refused += 1;
            }
        }
    }
    println!("{} samples; {shorter} cut ones flew, {refused} were refused", whole.samples.len());
    assert!(shorter > 10 && refused >= 3, "{shorter} flew, {refused} were refused");
}

#[test]
fn an_acsl_log_may_end_anywhere() {
    let Some(path) = recorded("acsl/log_20240613_121802.log") else { return };
    cut_off(&importers::Acsl, &path);
}

#[test]
fn a_ulog_may_end_anywhere() {
    let Some(path) = recorded("ulog/sample_px4_events.ulg") else { return };
    let importer = importers::by_ending(&path).unwrap();
    if importer.format().is_built_in {
        return cut_off(importer, &path);
    }
    let refused = bench(&["replay", path.to_str().unwrap()]);
    assert!(refused.log.contains("--features logs"), "{}", refused.log);
    testkit::skip("a ULog that ends anywhere", "ULogs are not read by this program; needed: --features logs");
}

/// Thirty seconds of the simulated rigid body as a table.
fn simulated(directory: &Path) -> PathBuf {
    let options = SimulationOptions { duration_s: Some(30.0), ..SimulationOptions::of(Scenario::RigidBody) };
    let samples: Vec<_> =
        Simulation::new(&options).unwrap().filter_map(|sample| sample.measurement).collect();
    let path = directory.join("flight.csv");
    importers::write_table(std::fs::File::create(&path).unwrap(), &samples).unwrap();
    path
}

#[test]
fn tuning_mends_a_bad_start_on_the_half_that_it_never_saw() {
    let directory = tempfile::tempdir().unwrap();
    let flight = simulated(directory.path());
    let preset = daemon::config::ConfigFile::preset("rigid-body-gradient").unwrap();
    let start = directory.path().join("start.toml");
    let text_of = |path: &Path| std::fs::read_to_string(path).unwrap();
    // A tenth of the adaptation rate, and a mass a fifth too high.
    let mut bad = preset.clone();
    let translation = bad.config.translation.as_mut().unwrap();
    translation.mass_kg *= 1.2;
    translation.adaptation_rate_kg_s2 = Some(daemon::config::SymmetricMatrix::Scalar(5.0));
    std::fs::write(&start, bad.commented_toml()).unwrap();

    let tuned = directory.path().join("tuned.toml");
    let [flight, start, out] = [&flight, &start, &tuned].map(|path| path.to_str().unwrap());
    let found = document(&[
        "tune",
        flight,
        "--config",
        start,
        "--mass",
        "--evaluations",
        "120",
        "--coast-s",
        "1",
        "--json",
        "--out",
        out,
    ]);
    let coast = |when: usize| found["second_half"][when]["coast_rms_m_s"].as_f64().unwrap();
    println!("coast {} before, {} after; {}", coast(0), coast(1), found["values"]);
    assert!(coast(1) < 0.8 * coast(0), "{} before, {} after", coast(0), coast(1));

    // The configuration says so in its head, is one, and flies as promised.
    assert!(text_of(&tuned).starts_with("# Tuned by `bench tune`"), "{}", text_of(&tuned));
    assert!(text_of(&tuned).contains(&format!("{:.4} m/s before, {:.4} after", coast(0), coast(1))));
    let replayed = document(&["replay", flight, "--config", out, "--coast-s", "1", "--json"]);
    let again = replayed["rows"][0]["coast_rms_m_s"].as_f64().unwrap();
    assert!((again - coast(1)).abs() < 1e-3 * again, "{again} where {} was promised", coast(1));
}

#[test]
fn tuning_says_why_it_cannot() {
    let directory = tempfile::tempdir().unwrap();
    let flight = simulated(directory.path());
    let file = flight.to_str().unwrap();
    for (arguments, needed) in [
        (vec!["tune", file, "--coast-s", "6"], "four coasts"),
        (vec!["tune", file, "--coast-s", "3"], "six coasts"),
        (vec!["tune", file, "--coast-weight", "2"], "needed: 0 … 1"),
        (vec!["tune", "/no/such.ulg"], "cannot read '/no/such.ulg'"),
    ] {
        let ended = bench(&arguments);
        assert!(ended.code != Some(0) && ended.log.contains(needed), "{arguments:?}: {ended:?}");
    }
}

/// The paper's first example through the command line, against the values of docs/method.md §10's independent program
/// (samples 1, 200 and 2000): v̂ and √P before the sample, f̂ of the step from it and its deviation, ‖θ‖ after it.
#[test]
fn a_trace_has_the_values_of_the_joint_law_s_independent_program() {
    let files = tempfile::tempdir().unwrap();
    let [table, trace] = ["flight.csv", "trace.csv"].map(|name| files.path().join(name));
    let [table, trace] = [table.to_str().unwrap(), trace.to_str().unwrap()];
    let flown =
        bench(&["sim_publisher", "run", "--scenario", "translation", "--duration", "10.1", "--table", table]);
    assert_eq!(flown.code, Some(0), "{flown:?}");
    document(&["replay", table, "--preset", "paper-translation-joint", "--trace", trace, "--json"]);
    let rows: Vec<Vec<String>> = std::fs::read_to_string(trace)
        .unwrap()
        .lines()
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    assert_eq!(
        rows[0].join(","),
        "t_s,v1_hat,v2_hat,v3_hat,f1_hat,f2_hat,f3_hat,velocity_std_m_s,force_std_n,nis,weights_norm,status"
    );
    #[rustfmt::skip]
    let reference = [
        (1, [1.008, 0.003, 2.008], [4.016230166672e-2, 6.198283274728e-2, -2.904618959447e-2], [8.418464806456e-3, 2.723366611096], 2.796582927785e-2),
        (200, [6.954329459716e-1, -6.291865141063e-1, -7.985036421675e-1], [8.585848633980e-1, 1.013693500834, 3.574910473898e-1], [5.377322494015e-3, 5.975443297618e-1], 5.678791117507e-1),
        (2000, [-1.159039379083, 1.234456972999e-1, 5.285880470487e-1], [2.400102306284e-1, -8.044632537552e-1, 9.755008069075e-1], [1.913886896499e-3, 3.889369416700e-1], 3.116196333758),
    ];
    for (sample, velocity, force, std, norm) in reference {
        let number = |column: usize| rows[sample + 1][column].parse::<f64>().unwrap();
        let expected = velocity.into_iter().chain(force).chain(std);
        for (column, expected) in (1..=8).zip(expected).chain([(10, norm)]) {
            // The table is printed with 13 digits; the measured velocities pass through a text, exactly.
            let error = (number(column) - expected).abs() / expected.abs().max(1e-3);
            assert!(error < 1e-9, "sample {sample}, column {column}: {} {expected}", number(column));
        }
    }
    assert!(rows[1][1].is_empty() && rows[1][7].is_empty(), "before the first output nothing is known");
}
