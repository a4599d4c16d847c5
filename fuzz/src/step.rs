//! Any samples at any times, with commands between them, through gate, observers and guards: no panic, no hang, and every
//! estimate that would be published is finite.

use crate::bytes::Bytes;
use daemon::assemble;
use daemon::config::{Clock, ConfigFile};
use daemon::engine::{Checkpoint, Engine, LoopCommand};
use shared_types::payload::{Channel, status_bits};
use std::cell::LazyCell;

/// A small lattice for the local solver, in the air and under samples' own clock.
const LOCAL: &str = r#"
rate_hz = 100.0
clock = "samples"

[translation]
law = "gradient"
mass_kg = 2.0
gain_per_s = 10.0
adaptation_rate_kg_s2 = 50.0
kernel = "wendland-c2"
length_scale_m_s = 2.0
centers_lower_m_s = [-4.0, -4.0, -4.0]
centers_upper_m_s = [4.0, 4.0, 4.0]
centers_per_axis = [5, 5, 5]
solver = { kind = "local", block = 4 }
dead_zone_width_m_s = 0.01
dead_zone_buffer_m_s = 0.01
noise_bound_m_s = 0.02
position_fix_gain_per_s = 1.0
"#;

thread_local! {
    static ENGINES: LazyCell<Vec<(Engine, Clock)>> = const { LazyCell::new(|| {
        let mut files = ["rigid-body", "auv", "linear", "rigid-body-gradient"].map(with_few_centers).to_vec();
        files.push(ConfigFile::parse("local".into(), LOCAL.into()).unwrap());
        let mut by_samples = files[0].clone();
        by_samples.config.clock = Clock::Samples;
        files.push(by_samples);
        files
            .iter()
            .map(|file| (Engine::new(&file.config, assemble::estimator(file).unwrap()), file.config.clock))
            .collect()
    }) };
}

/// The preset, with the fewest centers that still span each axis: the same code, and many more runs.
fn with_few_centers(name: &str) -> ConfigFile {
    let mut file = ConfigFile::preset(name).unwrap();
    if let Some(translation) = &mut file.config.translation {
        translation.centers_per_axis = Some([2, 2, 3]);
    }
    if let Some(rotation) = &mut file.config.rotation {
        rotation.centers_per_axis = Some([2, 3, 2]);
    }
    file
}

pub(crate) fn run(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let kind = usize::from(bytes.byte());
    let (mut engine, clock) = ENGINES.with(|engines| engines[kind % engines.len()].clone());
    let mut wake_ns = 1_000_000_000_000_u64;
    let mut n_samples = 0;
    let mut newest_ns = 0;
    while !bytes.is_empty() {
        let event = bytes.byte();
        match event {
            0..=15 => {
                engine.carry_out(LoopCommand::Reset);
                newest_ns = 0;
            }
            16..=23 => engine.carry_out(LoopCommand::Freeze),
            24..=31 => engine.carry_out(LoopCommand::Thaw),
            32..=43 => engine.save(),
            44..=51 => resume_from_itself(&mut engine, &mut newest_ns),
            // Half a minute without a tick at most: a coast takes 4 steps a second.
            56 => wake_ns += u64::from(bytes.byte()) * 125_000_000,
            57..=63 => wake_ns += u64::from(bytes.byte()) * 50_000_000,
            _ => wake_ns += u64::from(event % 16) * 1_000_000,
        }
        // Late ticks now and then, up to predicting only and beyond.
        let late_ticks_in_a_row = if event % 32 == 7 { u64::from(bytes.byte()) } else { 0 };
        engine.begin(wake_ns, late_ticks_in_a_row);
        for _ in 0..if event < 64 { 0 } else { event % 4 } {
            let gate = engine.gate();
            let near_ns = if event % 2 == 0 { wake_ns } else { gate.newest_stamp_ns().unwrap_or(wake_ns) };
            let sample = bytes.measurement(near_ns, gate.newest_sequence().unwrap_or(0));
            engine.take(&sample, u128::from(event % 3 / 2));
            n_samples += 1;
        }
        let estimate = engine.conclude();
        assert!(estimate.is_finite(), "{estimate:?}");
        for channel in [estimate.translation, estimate.rotation, estimate.linear] {
            assert_sound(&channel);
        }
        let norm = estimate.attitude_wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() < 1e-6, "{estimate:?}");
        let counters = engine.counters();
        assert_eq!(counters.samples_accepted + counters.samples_rejected.iter().sum::<u64>(), n_samples);
        assert_eq!(estimate.status & status_bits::PREDICT_ONLY != 0, late_ticks_in_a_row >= 10);
        if clock == Clock::Monotonic {
            assert!(estimate.stamp_ns >= newest_ns.max(wake_ns), "{estimate:?}");
            newest_ns = engine.gate().newest_stamp_ns().unwrap_or(0);
        }
        if engine.checkpoint_is_due() {
            engine.save();
        }
    }
}

/// As after a restart with a snapshot, with the state or with what was learned alone.
fn resume_from_itself(engine: &mut Engine, newest_ns: &mut u64) {
    let mut learned = vec![0.0; engine.n_learned()];
    engine.read_saved(0, &mut learned);
    let state = engine.saved_state();
    engine.load(&Checkpoint { learned, state }).unwrap();
    *newest_ns = 0;
}

#[track_caller]
fn assert_sound(channel: &Channel) {
    let Channel {
        output_error,
        activation,
        power_function,
        native_norm,
        solver_error,
        error_bound,
        output_age_s,
        nis,
    } = *channel;
    let finite = [output_error, activation, power_function, native_norm, solver_error, nis];
    assert!(finite.iter().all(|x| x.is_finite() && *x >= 0.0), "{channel:?}");
    assert!(power_function <= 1.0 + 1e-6, "{channel:?}");
    assert!(error_bound >= 0.0 && output_age_s >= 0.0, "{channel:?}");
}
