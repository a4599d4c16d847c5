//! Regression: the estimates of every preset in every scenario, and of a recorded flight, have not changed by a bit.
//!
//! Simulated samples go through the engine, and through the observers alone, without clock and ports. The hashes of all
//! estimates are in `regression.txt`. This code made them, so they show that something changed, not that it is right. After
//! an intended change: `REGRESSION_WRITE=1 cargo test -p bench --test regression`, with the reason in the commit.

use daemon::assemble;
use daemon::config::{Clock, ConfigFile};
use daemon::engine::{Checkpoint, Engine, LoopCommand, to_payload};
use daemon::gate::{Gate, sample_of};
use importers::{Acsl, ImportOptions, read_flight};
use observer::Learn;
use shared_types::payload::status_bits;
use shared_types::{Estimate, Measurement};
use sim_publisher::delivery::Delivery;
use sim_publisher::faults::{Faults, Faulty, read_faults};
use sim_publisher::{Scenario, Simulation, SimulationOptions};
use std::fmt::Write;
use std::path::Path;

const HASHES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/regression.txt");
const FLIGHT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/acsl/log_20240613_121802.log");
/// Of the simulated runs: the tick's clock, and the start of the simulated time (ns).
const START_NS: u64 = 1_000_000_000_000;

/// FNV-1a, 64 bit.
struct Hash(u64);

impl Hash {
    fn add(&mut self, estimate: &Estimate) {
        // The hashes are older than `sensors`, which no estimate depends on: it is left out.
        let Estimate {
            sequence, source_sequence, stamp_ns, source_stamp_ns, publish_stamp_ns, status, ..
        } = *estimate;
        let before = [sequence, source_sequence, stamp_ns, source_stamp_ns, publish_stamp_ns, status];
        let place = postcard::to_allocvec(&before).unwrap().len();
        let mut bytes = postcard::to_allocvec(&Estimate { sensors: 0, ..*estimate }).unwrap();
        bytes.remove(place);
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

/// Samples as they arrive: at what time, and from which source.
type Arrivals = Vec<(u64, u128, Measurement)>;

/// A simulated run with faults, shifted to `START_NS`.
fn arrivals(scenario: Scenario, duration_s: f64, faults: &[&str]) -> Arrivals {
    let options = SimulationOptions {
        duration_s: Some(duration_s),
        jitter_us: 300.0,
        dropout_probability: 0.02,
        ..SimulationOptions::of(scenario)
    };
    let faults = faults.iter().map(|fault| (*fault).to_owned()).collect::<Vec<_>>();
    let faults = Faults::new(&read_faults(&faults).unwrap(), 7);
    let sent = Faulty::new(Simulation::new(&options).unwrap(), faults);
    let mut arrivals = Arrivals::new();
    for outgoing in sent {
        let Some(Delivery { at_ns, mut measurement, clock_error_ns, .. }) = outgoing.delivery else {
            continue;
        };
        measurement.stamp_ns = (START_NS + measurement.stamp_ns).wrapping_add_signed(clock_error_ns);
        arrivals.push((START_NS + at_ns, 1, measurement));
    }
    arrivals
}

/// An oscillator's output and input, for the preset `linear`.
fn linear_arrivals(duration_s: f64) -> Arrivals {
    (0..(duration_s * 200.0) as u64)
        .filter(|j| j % 17 != 3 && !(600..700).contains(j))
        .map(|j| {
            let t = j as f64 * 0.005;
            let stamp_ns = START_NS + j * 5_000_000;
            let output = [1.4 * (0.9 * t).sin() + 0.01 * (37.0 * t).cos()];
            let sample =
                Measurement::at(stamp_ns, j).with_output(&output).with_input(&[2.0 * (0.7 * t).cos()]);
            (stamp_ns, 1, sample)
        })
        .collect()
}

/// Everything through an engine at `tick_hz`, with commands, checkpoints and a resumption in another engine.
fn through_engine(file: &ConfigFile, arrivals: &Arrivals, tick_hz: f64) -> u64 {
    let new = || Engine::new(&file.config, assemble::estimator(file).unwrap());
    let (mut engine, mut hash) = (new(), Hash(0xcbf2_9ce4_8422_2325));
    let period_ns = (1e9 / tick_hz) as u64;
    let mut arrivals = arrivals.iter().peekable();
    let mut tick = 0_u64;
    // The hashes were made when an engine that had taken over another one's counters reported, once, the outliers counted
    // before as new ones.
    let mut has_counted_before = false;
    while arrivals.peek().is_some() {
        let wake_ns = START_NS + tick * period_ns + tick % 7 * 11_000;
        // A busy machine, now and then.
        let late = (tick % 1000).saturating_sub(985);
        engine.begin(wake_ns, late);
        let n_accepted = engine.counters().samples_accepted;
        while let Some((_, source, measurement)) = arrivals.next_if(|(at_ns, ..)| *at_ns <= wake_ns) {
            engine.take(measurement, *source);
        }
        let mut estimate = engine.conclude();
        if has_counted_before && engine.counters().samples_accepted > n_accepted {
            estimate.status |= status_bits::HELD_BACK;
            has_counted_before = false;
        }
        hash.add(&estimate);
        match tick {
            1500 => engine.carry_out(LoopCommand::Freeze),
            1700 => engine.carry_out(LoopCommand::Thaw),
            4100 => engine.carry_out(LoopCommand::Reset),
            _ => {}
        }
        if engine.checkpoint_is_due() {
            engine.save();
        }
        // Another engine continues from the checkpoint.
        if tick == 2900 {
            engine.save();
            let mut learned = vec![0.0; engine.n_learned()];
            engine.read_saved(0, &mut learned);
            let checkpoint = Checkpoint { learned, state: engine.saved_state() };
            let counters = *engine.counters();
            has_counted_before = counters.outputs_held_back != [0; 3];
            engine = new();
            engine.load(&checkpoint).unwrap();
            *engine.counters_mut() = counters;
        }
        tick += 1;
    }
    hash.0
}

/// What the gate accepts, through the observers alone: an estimate at each sample and between two.
fn through_library(file: &ConfigFile, arrivals: &Arrivals) -> u64 {
    let mut observer = assemble::estimator(file).unwrap();
    let mut gate = Gate::new(file.config.input, true);
    let mut hash = Hash(0xcbf2_9ce4_8422_2325);
    for (at_ns, source, measurement) in arrivals {
        let Ok(accepted) = gate.judge(measurement, *source, &gate.in_order(measurement, *at_ns)) else {
            continue;
        };
        observer.accept(&accepted.sample, &accepted.linear, Learn::ALL);
        for later_ns in [0, 1_500_000, 40_000_000] {
            hash.add(&to_payload(&observer.estimate(accepted.sample.stamp_ns + later_ns)));
        }
    }
    hash.0
}

fn preset_with(name: &str, change: impl FnOnce(&mut String)) -> ConfigFile {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../daemon/presets/{name}.toml"));
    let mut text = std::fs::read_to_string(path).unwrap();
    change(&mut text);
    ConfigFile::parse(name.into(), text).unwrap()
}

#[test]
fn no_estimate_of_a_preset_or_of_the_recorded_flight_has_changed() {
    let every_fault = [
        "spike@4:2,size=3",
        "nan@6:0.2",
        "freeze@8:1.5",
        "duplicate@10:0.5",
        "clock-jump@11:0.3,by_s=-2",
        "delay@12:0.5,by_s=0.1",
        "reorder@14:1",
        "bias@16:1,size=0.5",
        "drift@17:1,per_s=0.3",
        "burst@18:0.7",
    ];
    let nothing: [&str; 0] = [];
    let mut found = String::new();
    let mut add = |name: &str, hash: u64| writeln!(found, "{name} {hash:016x}").unwrap();
    let pairs = [
        ("rigid-body", Scenario::RigidBody),
        ("acsl-x8", Scenario::RigidBody),
        ("auv", Scenario::Auv),
        ("paper-translation", Scenario::Translation),
        ("paper-rotation", Scenario::Rotation),
    ];
    for (preset, scenario) in pairs {
        let file = ConfigFile::preset(preset).unwrap();
        for (faults, kind) in [(nothing.as_slice(), "plain"), (&every_fault, "faults")] {
            let arrivals = arrivals(scenario, 20.0, faults);
            add(&format!("{preset} {kind} engine"), through_engine(&file, &arrivals, 400.0));
            add(&format!("{preset} {kind} library"), through_library(&file, &arrivals));
        }
    }
    let file = ConfigFile::preset("million-centers").unwrap();
    add("million-centers engine", through_engine(&file, &arrivals(Scenario::Translation, 5.0, &[]), 400.0));
    let file = ConfigFile::preset("linear").unwrap();
    add("linear engine", through_engine(&file, &linear_arrivals(20.0), 400.0));
    add("linear library", through_library(&file, &linear_arrivals(20.0)));

    // What the presets leave at its default.
    let input = "\n[input]\noutliers = \"adaptation\"\nstuck = \"correction\"\n";
    let faulty = arrivals(Scenario::RigidBody, 20.0, &every_fault);
    let file = preset_with("rigid-body", |text| text.push_str(input));
    add("rigid-body outliers=adaptation", through_engine(&file, &faulty, 400.0));
    let file = preset_with("rigid-body", |text| {
        *text = text
            .replacen(
                "kernel = \"sobolev-matern-3\"",
                "kernel = \"wendland-c2\"\nsolver = { kind = \"local\", block = 4 }",
                1,
            )
            .replacen("centers_per_axis = [5, 5, 3]", "centers_per_axis = [6, 6, 6]", 1);
    });
    add("rigid-body local wendland", through_engine(&file, &faulty, 400.0));
    add("rigid-body local wendland library", through_library(&file, &faulty));
    let file = preset_with("rigid-body", |text| {
        *text = text
            .replacen(
                "adaptation_rate_kg_s2",
                "solver = { kind = \"local\", block = 4 }\nadaptation_rate_kg_s2",
                1,
            )
            .replacen("centers_per_axis = [5, 5, 3]", "centers_per_axis = [5, 5, 5]", 1)
            .replacen("inertia_kg_m2", "gyroscopic_torque = \"feedforward\"\ninertia_kg_m2", 1);
    });
    add("rigid-body local matern feedforward", through_engine(&file, &faulty, 400.0));
    let mut file = ConfigFile::preset("rigid-body").unwrap();
    file.config.clock = Clock::Samples;
    add("rigid-body clock=samples", through_engine(&file, &faulty, 400.0));

    let has_flight = Path::new(FLIGHT).exists();
    if has_flight {
        let file = ConfigFile::preset("acsl-x8").unwrap();
        let flight = read_flight(&Acsl, Path::new(FLIGHT), &ImportOptions::default()).unwrap();
        let mut arrivals: Arrivals = Vec::new();
        for mut measurement in flight.samples {
            assert!(sample_of(&measurement, &file.config.input).is_ok());
            measurement.stamp_ns += START_NS;
            arrivals.push((measurement.stamp_ns, 1, measurement));
        }
        add("acsl-x8 recorded-flight engine", through_engine(&file, &arrivals, 400.0));
        add("acsl-x8 recorded-flight library", through_library(&file, &arrivals));
    } else {
        testkit::skip("estimates of the recorded flight", &format!("{FLIGHT} is not here"));
    }

    let unit = observer::vector_unit();
    let found: String = found.lines().map(|line| format!("{unit} {line}\n")).collect();
    if std::env::var_os("REGRESSION_WRITE").is_some() {
        std::fs::write(HASHES, &found).unwrap();
    }
    let mut wanted = of_unit(&std::fs::read_to_string(HASHES).unwrap(), unit);
    if wanted.is_empty() {
        testkit::skip(
            "estimates to the bit",
            &format!("found vector unit {unit}, needed: one that {HASHES} lists"),
        );
        return;
    }
    if !has_flight {
        wanted.retain(|line| !line.contains(" recorded-flight "));
    }
    let differences = differences(&wanted, &of_unit(&found, unit));
    assert!(differences.is_empty(), "{}", differences.join("\n"));
}

/// The lines of a vector unit.
fn of_unit(hashes: &str, unit: &str) -> Vec<String> {
    let lines =
        hashes.lines().filter(|line| line.strip_prefix(unit).is_some_and(|rest| rest.starts_with(' ')));
    lines.map(str::to_owned).collect()
}

/// Lines that only one side has.
fn differences(wanted: &[String], found: &[String]) -> Vec<String> {
    let missing =
        wanted.iter().filter(|line| !found.contains(line)).map(|line| format!("listed, not found: {line}"));
    let added =
        found.iter().filter(|line| !wanted.contains(line)).map(|line| format!("found, not listed: {line}"));
    missing.chain(added).collect()
}

#[test]
fn a_hash_that_changes_a_case_that_disappears_and_one_that_is_new_are_found() {
    let listed = of_unit("AVX2 a plain 01\nAVX2 b plain 02\nAVX-512 a plain 03\n", "AVX2");
    assert_eq!(listed, ["AVX2 a plain 01", "AVX2 b plain 02"]);
    assert_eq!(differences(&listed, &listed), Vec::<String>::new());
    assert_eq!(differences(&listed, &listed[..1]), ["listed, not found: AVX2 b plain 02"]);
    assert_eq!(differences(&listed[..1], &listed), ["found, not listed: AVX2 b plain 02"]);
    let changed = of_unit("AVX2 a plain 01\nAVX2 b plain 04\n", "AVX2");
    assert_eq!(differences(&listed, &changed).len(), 2);
}
