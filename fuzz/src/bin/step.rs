//! Any samples at any times through gate, observers and guard, with an operator's commands in between: no panic, no
//! hang, and every estimate that would be published is finite.

#![no_main]

use daemon::config::{Clock, ConfigFile, InputConfig};
use daemon::cycle::to_payload;
use daemon::estimator::{Estimator, VehicleEstimate};
use daemon::gate::{Accepted, Gate};
use fuzz::Bytes;
use libfuzzer_sys::fuzz_target;
use shared_types::Measurement;
use shared_types::payload::{Channel, Estimate};
use std::cell::LazyCell;

/// A small lattice for the local solver, in the air and under samples' own clock.
const LOCAL: &str = r#"
rate_hz = 100.0
clock = "samples"

[translation]
mass_kg = 2.0
gain_per_s = 10.0
adaptation_rate_kg_s2 = 50.0
kernel = "wendland-c2"
length_scale_m_s = 2.0
centers_lower_m_s = [-4.0, -4.0, -4.0]
centers_upper_m_s = [4.0, 4.0, 4.0]
centers_per_axis = [8, 8, 8]
solver = { kind = "local", block = 4 }
dead_zone_width_m_s = 0.01
dead_zone_buffer_m_s = 0.01
noise_bound_m_s = 0.02
position_fix_gain_per_s = 1.0
"#;

thread_local! {
    static ENGINES: LazyCell<Vec<Engine>> = const { LazyCell::new(|| {
        let mut files = ["rigid-body", "auv", "linear"].map(|name| ConfigFile::preset(name).unwrap()).to_vec();
        files.push(ConfigFile::parse("local".into(), LOCAL.into()).unwrap());
        let mut by_samples = files[0].clone();
        by_samples.config.clock = Clock::Samples;
        files.push(by_samples);
        files.iter().map(Engine::new).collect()
    }) };
}

/// What the loop does with samples and ticks, without its ports and its clock.
#[derive(Clone)]
struct Engine {
    observer: Estimator,
    gate: Gate,
    limits: InputConfig,
    clock: Clock,
    n_accepted: u64,
    n_rejected: u64,
}

impl Engine {
    fn new(file: &ConfigFile) -> Self {
        let config = &file.config;
        Self {
            observer: file.estimator().unwrap(),
            gate: Gate::new(config.input, config.clock == Clock::Monotonic),
            limits: config.input,
            clock: config.clock,
            n_accepted: 0,
            n_rejected: 0,
        }
    }

    fn take(&mut self, measurement: &Measurement, source: u128, wake_ns: u64) {
        match self.gate.judge(measurement, source, wake_ns) {
            Ok(Accepted { sample, linear, new_time, .. }) => {
                if new_time {
                    self.observer.restart();
                }
                self.observer.accept(&sample, &linear);
                self.n_accepted += 1;
            }
            Err(_) => self.n_rejected += 1,
        }
    }

    fn estimate(&mut self, wake_ns: u64) -> Estimate {
        let stamp_ns = match self.clock {
            Clock::Monotonic => wake_ns.max(self.gate.newest_stamp_ns().unwrap_or(0)),
            Clock::Samples => self.gate.newest_stamp_ns().unwrap_or(wake_ns),
        };
        to_payload(&self.guarded_estimate(stamp_ns))
    }

    fn guarded_estimate(&mut self, stamp_ns: u64) -> VehicleEstimate {
        let state = self.observer.estimate(stamp_ns);
        if self.is_within(&state) {
            return state;
        }
        self.restore_good_copy();
        let restored = self.observer.estimate(stamp_ns);
        if self.is_within(&restored) {
            return restored;
        }
        self.observer.reset();
        self.observer.estimate(stamp_ns)
    }

    fn restore_good_copy(&mut self) {
        if let Some(body) = &mut self.observer.rigid_body {
            body.restore_translation();
            body.restore_rotation();
        }
        if let Some(linear) = &mut self.observer.linear {
            linear.restore_good_copy();
        }
    }

    fn is_within(&self, state: &VehicleEstimate) -> bool {
        let limits = &self.limits;
        let body = state.rigid_body.as_ref().is_none_or(|body| {
            body.velocity_m_s.norm() <= limits.max_speed_m_s
                && body.position_m.norm() <= limits.max_position_m
                && body.matched_force_n.norm() <= limits.max_unknown_force_n
                && body.angular_velocity_rad_s.norm() <= limits.max_angular_rate_rad_s
                && body.attitude.coords.norm().is_finite()
                && body.matched_torque_n_m.norm() <= limits.max_unknown_torque_n_m
        });
        body && state.linear.as_ref().is_none_or(|linear| {
            linear.state.amax() <= limits.max_state && linear.matched_input.amax() <= limits.max_input
        })
    }
}

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = Bytes(bytes);
    let kind = bytes.byte();
    let mut engine = ENGINES.with(|engines| engines[usize::from(kind) % engines.len()].clone());
    let mut wake_ns = 1_000_000_000_000_u64;
    let mut n_samples = 0;
    let mut newest_ns = 0;
    while !bytes.is_empty() {
        match bytes.byte() {
            0..=15 => {
                engine.observer.reset();
                engine.observer.keep_good_copy();
                engine.gate.forget();
                newest_ns = 0;
            }
            16..=23 => engine.observer.set_frozen(true),
            24..=31 => engine.observer.set_frozen(false),
            32..=47 => engine.observer.keep_good_copy(),
            48..=55 => engine.restore_good_copy(),
            // Some minutes without a tick at most, rarely: a coast takes 4 steps a second.
            56 => wake_ns += u64::from(bytes.byte()) * 1_000_000_000,
            57..=63 => wake_ns += u64::from(bytes.byte()) * 50_000_000,
            64..=119 => wake_ns += u64::from(bytes.byte()) * 1_000_000,
            event => {
                let near_ns =
                    if event % 2 == 0 { wake_ns } else { engine.gate.newest_stamp_ns().unwrap_or(wake_ns) };
                let sample = bytes.measurement(near_ns, engine.gate.newest_sequence().unwrap_or(0));
                engine.take(&sample, u128::from(event % 3 / 2), wake_ns);
                n_samples += 1;
                if event < 140 {
                    continue; // several samples in one tick
                }
            }
        }
        let estimate = engine.estimate(wake_ns);
        assert!(estimate.is_finite(), "{estimate:?}");
        for channel in [estimate.translation, estimate.rotation, estimate.linear] {
            assert_sound(&channel);
        }
        let norm = estimate.attitude_wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() < 1e-6, "{estimate:?}");
        assert_eq!(engine.n_accepted + engine.n_rejected, n_samples);
        if engine.clock == Clock::Monotonic {
            assert!(estimate.stamp_ns >= newest_ns.max(wake_ns), "{estimate:?}");
            newest_ns = engine.gate.newest_stamp_ns().unwrap_or(0);
        }
    }
});

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
    } = *channel;
    let finite = [output_error, activation, power_function, native_norm, solver_error];
    assert!(finite.iter().all(|x| x.is_finite() && *x >= 0.0), "{channel:?}");
    assert!(power_function <= 1.0 + 1e-6, "{channel:?}");
    assert!(error_bound >= 0.0 && output_age_s >= 0.0, "{channel:?}");
}
