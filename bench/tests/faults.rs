//! Every kind of fault: afterwards the estimate must be back at its level, and every affected sample must be counted.
//!
//! Faults of samples are tested with the engine on simulated time, where the counts are exact. Faults of processes, and some
//! of samples with them, are tested with the demo: real processes, where a busy machine may add losses of its own.

use crate::programs::{bench, document};
use daemon::config::ConfigFile;
use daemon::engine::Engine;
use serde_json::Value;
use shared_types::payload::Counters;
use shared_types::payload::Rejection;
use sim_publisher::delivery::Delivery;
use sim_publisher::faults::{Faults, Faulty, read_faults};
use sim_publisher::{Scenario, Simulation, SimulationOptions};
use std::collections::BTreeMap;

/// How often a counter must rise.
#[derive(Debug, Clone, Copy)]
enum Count {
    /// By one for each sample that the fault concerned.
    Each,
    /// By so much.
    By(u64),
    /// At least by one.
    Some,
}

/// A fault, the samples that it concerns (`None`: by chance), and the counters that rise. No other counter of lost or
/// rejected samples may.
type Case = (&'static str, Option<u64>, &'static [(&'static str, Count)]);

const TOO_OLD: &str = "rejected_too_far_behind_the_clock";

#[rustfmt::skip]
const OF_SAMPLES: [Case; 18] = [
    // Spikes come first: if they were learned from, the learned force would be wrong for the later faults.
    ("spike@5:1.5,size=3,every=10", Some(30), &[("velocities_held_back", Count::Each)]),
    ("spike@9:1,field=angular-velocity,size=5,every=10", Some(20), &[("angular_velocities_held_back", Count::Each)]),
    ("nan@13:0.5", Some(100), &[("rejected_not_finite", Count::Each)]),
    ("nan@17:0.5,field=attitude,every=3", Some(34), &[("rejected_not_finite", Count::Each)]),
    // Each sample is plausible by itself: no check of a single sample detects them.
    ("drift@21:1,per_s=0.3", Some(200), &[]),
    ("bias@25:0.5,size=0.5", Some(100), &[]),
    // From the fiftieth repetition on.
    ("freeze@29:0.5,field=velocity", Some(100), &[("velocities_stuck", Count::By(51))]),
    ("drop@33:1,probability=0.4", None, &[("samples_lost", Count::Each)]),
    ("burst@37:0.3", Some(60), &[("samples_lost", Count::Each), ("ticks_coasting", Count::Some)]),
    ("rate-change@41:1,divide_by=4", Some(150), &[("samples_lost", Count::Each)]),
    // Of a sample that lacks a field nothing is lost: its channel coasts.
    ("burst@45:0.3,field=velocity", Some(60), &[("ticks_coasting", Count::Some)]),
    ("rate-change@49:1,field=angular-velocity,divide_by=4", Some(150), &[("ticks_coasting", Count::Some)]),
    // Young enough: late, but used. Those of the 0.1 s after it queue behind the last delayed one.
    ("delay@53:1,by_s=0.1", Some(219), &[]),
    // The late one is put where it belongs, and is then no longer lost.
    ("reorder@57:1,every=4", Some(50), &[]),
    ("duplicate@61:1", Some(200), &[("rejected_repeated_stamp", Count::Each)]),
    ("clock-jump@65:0.5,by_s=2", Some(100), &[("rejected_too_far_ahead_of_the_clock", Count::Each)]),
    ("clock-jump@69:0.5,by_s=-2", Some(100), &[(TOO_OLD, Count::Each)]),
    // 0.7 s late: the 200 samples of that second are too old, and of those that queue behind them the 40 that wait for
    // more than 0.5 s.
    ("delay@73:1,by_s=0.7", Some(339), &[(TOO_OLD, Count::By(240))]),
];
/// The run ends some seconds after the last of them.
const DURATION_S: f64 = 78.0;

/// Fails unless what a fault concerned and what was counted is the case's; counts may be off by `slack`.
#[track_caller]
fn assert_case(
    &(fault, samples, counts): &Case,
    concerned: u64,
    counted: &BTreeMap<String, u64>,
    slack: u64,
) {
    if let Some(samples) = samples {
        assert_eq!(concerned, samples, "{fault}");
    }
    assert!(concerned > 0, "{fault}: it concerned no sample");
    for (counter, count) in counts {
        let found = counted.get(*counter).copied().unwrap_or(0);
        let expected = match count {
            Count::Each => concerned,
            Count::By(count) => *count,
            Count::Some => found.max(1),
        };
        assert!(found.abs_diff(expected) <= slack, "{fault}: {counter}: {expected} expected: {counted:?}");
    }
    let is_expected = |name: &str| counts.iter().any(|(counter, _)| *counter == name);
    for (name, &count) in counted {
        if (name.starts_with("rejected_") || name == "samples_lost") && !is_expected(name) {
            assert!(count <= slack, "{fault}: {name} {count}: {counted:?}");
        }
    }
}

/// A tick of the engine: the velocity's error against the truth (m/s), and what was counted until its end.
struct Tick {
    velocity_error_m_s: f64,
    counters: Counters,
}

const TICK_HZ: f64 = 200.0;

/// A run of the preset with these faults, a tick 1 ms after each sample; how many samples each fault concerned.
fn through_engine(faults: &[&str]) -> (Vec<Tick>, Vec<u64>) {
    const START_NS: u64 = 1_000_000_000_000;
    let file = ConfigFile::preset("rigid-body").unwrap();
    let mut engine = Engine::new(&file.config, daemon::assemble::estimator(&file).unwrap());
    let faults = faults.iter().map(|fault| (*fault).to_owned()).collect::<Vec<_>>();
    let options =
        SimulationOptions { duration_s: Some(DURATION_S), ..SimulationOptions::of(Scenario::RigidBody) };
    let faults = Faults::new(&read_faults(&faults).unwrap(), 7);
    let mut sent = Faulty::new(Simulation::new(&options).unwrap(), faults);
    let mut ticks = Vec::new();
    let mut next = sent.next();
    for tick in 0..(DURATION_S * TICK_HZ) as u64 {
        let wake_ns = START_NS + tick * 5_000_000 + 1_000_000;
        engine.begin(wake_ns, 0);
        let mut truth = None;
        while let Some(outgoing) = next.take_if(|outgoing| START_NS + outgoing.at_ns <= wake_ns) {
            truth = outgoing.truth.or(truth);
            if let Some(Delivery { mut measurement, clock_error_ns, .. }) = outgoing.delivery {
                measurement.stamp_ns = (START_NS + measurement.stamp_ns).wrapping_add_signed(clock_error_ns);
                engine.take(&measurement, 1);
            }
            next = sent.next();
        }
        let estimate = engine.conclude();
        assert!(estimate.is_finite(), "tick {tick}");
        let truth = truth.expect("a true state at each tick");
        let square = |axis: usize| (estimate.velocity_m_s[axis] - truth.velocity_m_s[axis]).powi(2);
        let velocity_error_m_s = (0..3).map(square).sum::<f64>().sqrt();
        ticks.push(Tick { velocity_error_m_s, counters: *engine.counters() });
    }
    (ticks, sent.tallies().iter().map(|tally| tally.samples).collect())
}

/// What rose between two ticks, under the names of the demo's document.
fn rises(before: &Counters, after: &Counters) -> BTreeMap<String, u64> {
    let mut rises = BTreeMap::from([
        ("samples_lost".to_owned(), after.samples_lost - before.samples_lost),
        ("velocities_held_back".into(), after.outputs_held_back[0] - before.outputs_held_back[0]),
        ("angular_velocities_held_back".into(), after.outputs_held_back[1] - before.outputs_held_back[1]),
        ("velocities_stuck".into(), after.outputs_stuck[0] - before.outputs_stuck[0]),
        ("ticks_coasting".into(), after.ticks_coasting - before.ticks_coasting),
    ]);
    for reason in Rejection::ALL {
        let count = |counters: &Counters| counters.samples_rejected[reason as usize];
        rises.insert(format!("rejected_{}", reason.words().replace(' ', "_")), count(after) - count(before));
    }
    rises
}

fn rms(ticks: &[Tick]) -> f64 {
    let sum: f64 = ticks.iter().map(|tick| tick.velocity_error_m_s.powi(2)).sum();
    (sum / ticks.len() as f64).sqrt()
}

/// After 2 s the error is at most twice that of the same run without faults. A sensor that repeats a value while the vehicle
/// moves is believed for its first 50 samples; the noise levels that this raises take their memory of 500 samples to fall.
#[test]
fn each_fault_of_samples_is_counted_exactly_and_gone_after_two_seconds() {
    let faults = OF_SAMPLES.map(|(fault, ..)| fault);
    let (ticks, concerned) = through_engine(&faults);
    let (without, _) = through_engine(&[]);
    let spans = read_faults(&faults.map(str::to_owned)).unwrap();
    let mut not_back = Vec::new();
    for ((case, fault), concerned) in OF_SAMPLES.iter().zip(spans).zip(concerned) {
        let at = |t_s: f64| (t_s * TICK_HZ) as usize;
        let (start_s, end_s) = (fault.span.start_s, fault.span.end_s());
        let counted = rises(&ticks[at(start_s) - 1].counters, &ticks[at(end_s + 2.0)].counters);
        assert_case(case, concerned, &counted, 0);
        let after = rms(&ticks[at(end_s + 2.0)..at(end_s + 2.5)]);
        let level = rms(&without[at(start_s - 2.0)..at(end_s + 2.0)]);
        println!("{}: {after:.4} m/s, {level:.4} m/s without faults", case.0);
        if after > 2.0 * level {
            not_back.push(case.0);
        }
    }
    assert!(not_back.is_empty(), "{not_back:?}");
}

/// What the demo says about one fault.
struct Effect(Value);

impl Effect {
    fn counted(&self) -> BTreeMap<String, u64> {
        serde_json::from_value(self.0["counted"].clone()).unwrap()
    }

    /// By how much a counter of the service rose.
    fn count(&self, counter: &str) -> u64 {
        self.counted().get(counter).copied().unwrap_or(0)
    }

    fn samples(&self) -> u64 {
        self.0["samples"].as_u64().unwrap()
    }

    /// What a busy machine did beside the fault: the loop was late, turned samples away, or found its queue full.
    fn disturbances(&self) -> u64 {
        let late = self.count("deadline_misses") + self.count("rejected_the_loop_was_late");
        if late > 0 { late + self.count("samples_lost") } else { 0 }
    }

    /// Within 2 s, unless the machine kept the loop from more than 20 ticks: then it is not the fault that is judged.
    #[track_caller]
    fn assert_back(&self) {
        let is_back = self.0["back_after_s"].as_f64().is_some_and(|s| s <= 2.0);
        assert!(is_back || self.disturbances() > 20, "not back in time: {}", self.0);
    }
}

/// Runs the demo with these faults; what it says of each, in the order of time.
fn through_demo(duration_s: f64, faults: &[&str]) -> Vec<Effect> {
    let out = tempfile::tempdir().unwrap();
    let duration = duration_s.to_string();
    let mut arguments =
        vec!["demo", "--json", "--duration", &duration, "--out", out.path().to_str().unwrap()];
    arguments.extend(faults.iter().flat_map(|fault| ["--faults", *fault]));
    let document = document(&arguments);
    assert_eq!(document["estimates_not_finite"], 0);
    let effects: Vec<Value> = serde_json::from_value(document["faults"].clone()).unwrap();
    println!("{effects:?}");
    assert_eq!(effects.len(), faults.len());
    effects.into_iter().map(Effect).collect()
}

#[test]
fn processes_that_stop_or_die_are_noticed_and_taken_back() {
    let faults = ["stop@5:0.8", "kill@9:0.7", "service-stop@13:0.5", "service-kill@17:0.5"];
    let [stop, kill, service_stop, service_kill] = through_demo(20.0, &faults).try_into().ok().unwrap();
    for effect in [&stop, &kill, &service_stop] {
        effect.assert_back();
    }
    assert!(stop.count("ticks_coasting") > 0 && kill.count("ticks_coasting") > 0, "{} {}", stop.0, kill.0);
    // Overdue samples come in one burst, which may be longer than the queue: the newest are kept. Of 0.8 s, the first
    // 0.3 s are too old for the service, if the queue held them at all.
    assert_eq!(stop.samples(), 160, "{}", stop.0);
    assert!(stop.count(TOO_OLD) + stop.count("samples_lost") >= 50, "{}", stop.0);
    // A new process counts anew, and so says nothing of what was lost meanwhile.
    assert!(kill.samples() >= 140 && kill.count("source_changes") == 1, "{}", kill.0);
    assert!(service_stop.count("deadline_misses") >= 90, "{}", service_stop.0);
    // The new service starts with nothing learned: how long that takes is no matter of this test.
    assert_eq!(service_kill.count("service_starts"), 1, "{}", service_kill.0);
}

#[test]
#[ignore = "takes 80 s and needs an idle machine; run: cargo test -p bench faults -- --ignored"]
fn each_fault_of_samples_is_counted_by_a_live_service() {
    // Of the last one the service's queue keeps the newest samples alone.
    let cases = &OF_SAMPLES[..OF_SAMPLES.len() - 1];
    let faults: Vec<_> = cases.iter().map(|(fault, ..)| *fault).collect();
    for (case, effect) in cases.iter().zip(through_demo(DURATION_S - 4.0, &faults)) {
        effect.assert_back();
        assert_case(case, effect.samples(), &effect.counted(), effect.disturbances());
    }
}

#[test]
fn wrong_faults_are_refused_before_anything_is_started() {
    for (faults, expected) in [
        ("spiek@1:1", "kind 'spiek'; needed: one of drop, burst"),
        ("burst@30:1", "it starts after the end of 20 s"),
        ("service-kill@1:2;service-stop@2:2", "it overlaps"),
    ] {
        let ended = bench(&["demo", "--faults", faults]);
        assert!(ended.code == Some(2) && ended.log.contains(expected), "{ended:?}");
    }
}
