//! `bench sensors`: the engine of the service with sensors of several processes, slow and late ones, in simulated time.
//!
//! Each case flies several times, with the same readings:
//!
//! | run | |
//! |---|---|
//! | at once | every sample arrives when it was taken, in the order of the stamps |
//! | late | each sensor's samples arrive with its delay |
//! | late, silent | likewise, and the velocity's sensor says nothing for a minute while commands flow |
//! | late, zeros | likewise, and it repeats exact zeros, as if they were valid; where the preset expects that |
//! | late, two axes | likewise, and a velocity along the body's axes lacks its third component |
//! | late, ahead only | likewise, and it lacks the second one, too |
//! | late, outliers told | likewise, and a tenth of the velocities has ten times the noise, and says so |
//! | late, outliers | likewise, and they do not say so |
//! | late, outliers rejected | likewise, and the sensor has `outliers = "reject"` |
//!
//! The sensors are those of `sim_publisher run --sensors`. The estimate of each tick is compared with the truth of that instant, after the first minute.

use crate::harness::latency::summary;
use crate::harness::output::{show, table};
use crate::harness::random::Random;
use clap::Args;
use daemon::assemble;
use daemon::config::{ConfigFile, OutlierAction, OutlierWeight, SensorClock, SensorConfig};
use daemon::engine::Engine;
use nalgebra::Vector3;
use serde::Serialize;
use shared_types::payload::{absent, frame, valid};
use shared_types::{Estimate, Measurement, Truth, outln};
use sim_publisher::delivery::{Delivery, Outgoing};
use sim_publisher::sensor_set::{Quantity, SetSensor};
use sim_publisher::{Scenario, SensorSet};
use std::time::Instant;

const START_NS: u64 = 1_000_000_000_000;
const FLIGHT_S: f64 = 300.0;
/// Errors are counted from here on (s).
const SETTLED_S: f64 = 60.0;
/// When the velocity's sensor is silent (s).
const SILENT_S: std::ops::Range<f64> = 180.0..240.0;

/// Arguments of `bench sensors`.
#[derive(Debug, Clone, Args)]
pub(crate) struct SensorsArguments {
    /// One set of sensors only: a built-in one of sim_publisher run --sensors, or a file like it.
    #[arg(long, value_name = "NAME|FILE")]
    sensors: Option<String>,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    json: bool,
}

/// A vehicle with its sensors.
struct Case {
    name: String,
    set: SensorSet,
    config: ConfigFile,
}

impl Case {
    /// The set, with the preset of its vehicle, of which the sensors that have a number are told: place and noise, if their samples
    /// do not tell it.
    fn of(name: &str) -> anyhow::Result<Self> {
        let set = SensorSet::read(name)?;
        let mut config = ConfigFile::preset(match set.scenario {
            Scenario::Auv => "auv",
            Scenario::RigidBody => "rigid-body",
            Scenario::Translation => "paper-translation-joint",
            Scenario::Rotation => "paper-rotation",
        })?;
        let velocity = |sensor: &&SetSensor| {
            sensor.measures.iter().any(|q| [Quantity::Velocity, Quantity::BodyVelocity].contains(q))
        };
        let rates_hz = set.sensor.iter().filter(velocity).map(|sensor| sensor.rate_hz);
        if let Some(translation) = &mut config.config.translation {
            translation.sample_rate_hz = rates_hz.reduce(f64::max);
        }
        let longest_s = set.sensor.iter().map(|sensor| sensor.delay_s + sensor.delay_jitter_s);
        let longest_s = longest_s.fold(0.0, f64::max);
        config.config.rate_hz = set.rate_hz;
        config.config.input.max_age_s = config.config.input.max_age_s.max(1.5 * longest_s);
        if let (Some(translation), Some(noise_m_s2)) = (
            &mut config.config.translation,
            set.sensor.iter().map(|s| s.specific_force_noise_m_s2).find(|n| *n > 0.0),
        ) {
            translation.joint.specific_force_noise_m_s2 = noise_m_s2;
        }
        config.config.sensor = set.sensor.iter().filter(|sensor| sensor.number > 0).map(installed).collect();
        Ok(Self { name: name.into(), set, config })
    }
}

fn installed(sensor: &SetSensor) -> SensorConfig {
    SensorConfig {
        name: sensor.name.clone(),
        number: sensor.number,
        lever_arm_m: sensor.lever_arm_m,
        mounting_wxyz: sensor.mounting_wxyz,
        velocity_noise_m_s: sensor.velocity_noise_m_s,
        angular_velocity_noise_rad_s: sensor.angular_velocity_noise_rad_s,
        specific_force_noise_m_s2: sensor.specific_force_noise_m_s2,
        position_noise_m: sensor.position_noise_m,
        attitude_noise_rad: sensor.attitude_noise_rad,
        latency_s: if sensor.stamps_on_arrival { sensor.delay_s } else { 0.0 },
        clock: SensorClock::Monotonic,
        rate_hz: sensor.rate_hz,
        outliers: OutlierWeight::Weigh,
    }
}

/// How a case is flown.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Run {
    AtOnce,
    Late,
    LateAndSilent,
    LateAndZeros,
    /// Of velocities along body axes, these bits are absent.
    LateInPart(u32),
    LateWithOutliers(Outliers),
}

const TWO_AXES: u32 = absent::VELOCITY_Z;
const AHEAD_ONLY: u32 = absent::VELOCITY_Y | absent::VELOCITY_Z;

/// What is known of the outliers.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outliers {
    /// Their samples tell their noise.
    Told,
    /// Nothing.
    Untold,
    /// Nothing, but the configuration rejects outliers of sensors that have a number.
    Rejected,
}

/// Errors and counts of one run.
#[derive(Debug, Serialize)]
struct Flown {
    case: String,
    delivery: &'static str,
    velocity_rms_m_s: f64,
    /// The largest one.
    velocity_max_m_s: f64,
    /// Mean of the squares of the velocity's errors in their deviations; 1 where these are right.
    velocity_nees: f64,
    position_rms_m: f64,
    samples_sent: u64,
    samples_used: u64,
    samples_rejected: u64,
    samples_lost: u64,
    /// Ticks in which samples were fused again, how many in the mean, and the median time of such a tick, the estimate included.
    late_ticks: usize,
    fused_again: f64,
    late_tick_us: Option<f64>,
}

/// Runs `bench sensors`.
///
/// # Errors
/// A configuration that is refused.
pub(crate) fn run(arguments: &SensorsArguments) -> anyhow::Result<()> {
    let names = match &arguments.sensors {
        Some(only) => vec![only.as_str()],
        None => sim_publisher::SENSOR_SETS.map(|(name, _)| name).to_vec(),
    };
    let mut flown = Vec::new();
    for name in names {
        let case = Case::of(name)?;
        let (truths, sent) = fly(&case, arguments.seed)?;
        let mut runs = vec![Run::AtOnce, Run::Late, Run::LateAndSilent];
        if case.config.config.input.stuck == OutlierAction::Correction {
            runs.push(Run::LateAndZeros);
        }
        if case.set.sensor.iter().any(|sensor| sensor.measures.contains(&Quantity::BodyVelocity)) {
            runs.extend([TWO_AXES, AHEAD_ONLY].map(Run::LateInPart));
        }
        runs.extend([Outliers::Told, Outliers::Untold, Outliers::Rejected].map(Run::LateWithOutliers));
        for run in runs {
            flown.push(estimate(&case, &truths, &sent, run)?);
        }
    }
    show(arguments.json, &flown, || {
        let header = [
            "case",
            "samples arrive",
            "velocity, RMS (m/s)",
            "largest (m/s)",
            "NEES",
            "position, RMS (m)",
            "sent",
            "used",
            "rejected",
            "lost",
            "fused again in a tick",
            "that tick (µs)",
        ];
        let row = |flown: &Flown| {
            let counts = [flown.samples_sent, flown.samples_used, flown.samples_rejected, flown.samples_lost];
            let errors = [
                format!("{:.4}", flown.velocity_rms_m_s),
                format!("{:.3}", flown.velocity_max_m_s),
                format!("{:.2}", flown.velocity_nees),
                format!("{:.2}", flown.position_rms_m),
            ];
            let late = [
                format!("{:.1}", flown.fused_again),
                flown.late_tick_us.map_or("-".into(), |time_us| format!("{time_us:.1}")),
            ];
            let names = [flown.case.clone(), flown.delivery.into()];
            names
                .into_iter()
                .chain(errors)
                .chain(counts.map(|count| count.to_string()))
                .chain(late)
                .collect::<Vec<_>>()
        };
        outln!("{}", table(&header, 2, flown.iter().map(row)));
    })
}

/// The truth, and what each sensor sends of it.
fn fly(case: &Case, seed: u64) -> anyhow::Result<(Vec<Truth>, Vec<Delivery>)> {
    let (mut truths, mut sent) = (Vec::new(), Vec::new());
    for Outgoing { truth, delivery, .. } in case.set.fly(Some(FLIGHT_S), seed)? {
        truths.extend(truth.map(|truth| Truth { stamp_ns: START_NS + truth.stamp_ns, ..truth }));
        sent.extend(delivery.map(|sent| Delivery {
            at_ns: START_NS + sent.at_ns,
            measurement: Measurement { stamp_ns: START_NS + sent.measurement.stamp_ns, ..sent.measurement },
            ..sent
        }));
    }
    Ok((truths, sent))
}

/// Runs the engine tick by tick, one for each instant of the truth.
fn estimate(case: &Case, truths: &[Truth], sent: &[Delivery], run: Run) -> anyhow::Result<Flown> {
    let mut config = case.config.config.clone();
    if run == Run::LateWithOutliers(Outliers::Rejected) {
        config.sensor.iter_mut().for_each(|sensor| sensor.outliers = OutlierWeight::Reject);
    }
    let mut engine = Engine::new(&config, assemble::estimator(&case.config)?);
    let mut sent = sent.to_vec();
    let mut random = Random(77);
    for sent in &mut sent {
        let sample = &mut sent.measurement;
        if !sample.has(valid::VELOCITY) {
            continue;
        }
        let is_outlier = random.uniform() < 0.1;
        let noise = Vector3::from_fn(|_, _| random.normal());
        let sensor = &case.set.sensor[sent.source];
        if let Run::LateWithOutliers(outliers) = run
            && is_outlier
        {
            let more = 99.0_f64.sqrt() * sensor.velocity_noise_m_s * noise;
            sample.velocity_m_s = (Vector3::from(sample.velocity_m_s) + more).into();
            if outliers == Outliers::Told {
                sample.velocity_std_m_s = [10.0 * sensor.velocity_noise_m_s; 3];
            }
        }
    }
    let is_broken = |sent: &Delivery| {
        let t_s = (sent.measurement.stamp_ns - START_NS) as f64 / 1e9;
        sent.measurement.has(valid::VELOCITY) && SILENT_S.contains(&t_s)
    };
    match run {
        Run::AtOnce => sent.iter_mut().for_each(|sent| sent.at_ns = sent.measurement.stamp_ns),
        Run::LateAndSilent => sent.retain(|sent| !is_broken(sent)),
        Run::LateAndZeros => {
            let broken = sent.iter_mut().filter(|sent| is_broken(sent));
            broken.for_each(|sent| sent.measurement.velocity_m_s = [0.0; 3]);
        }
        Run::LateInPart(missing) => {
            let read = sent.iter_mut().map(|sent| &mut sent.measurement);
            let of_body = read.filter(|m| m.has(valid::VELOCITY) && m.velocity_frame == frame::BODY);
            of_body.for_each(|measurement| measurement.absent |= missing);
        }
        Run::Late | Run::LateWithOutliers(_) => {}
    }
    sent.sort_by_key(|sent| sent.at_ns);
    // What is silent is not lost: its driver does not count on.
    let mut sequences = vec![0; case.set.sensor.len()];
    for sent in &mut sent {
        sent.measurement.sequence = sequences[sent.source];
        sequences[sent.source] += 1;
    }

    let (mut late_ns, mut fused_again) = (Vec::new(), 0);
    let mut arriving = sent.iter().peekable();
    let (mut n, mut n_sent, mut squares, mut largest, mut nees, mut positions) =
        (0, 0, 0.0, 0.0_f64, 0.0, 0.0);
    for truth in truths {
        engine.begin(truth.stamp_ns, 0);
        while let Some(sent) = arriving.next_if(|sent| sent.at_ns <= truth.stamp_ns) {
            engine.take(&sent.measurement, sent.source as u128);
            n_sent += 1;
        }
        let begin = Instant::now();
        let estimate: Estimate = engine.conclude();
        let n_fused_again = engine.window().n_fused_again();
        if n_fused_again > 0 {
            late_ns.push(begin.elapsed().as_nanos() as u64);
            fused_again += n_fused_again;
        }
        if engine.checkpoint_is_due() {
            engine.save();
        }
        if ((truth.stamp_ns - START_NS) as f64) < SETTLED_S * 1e9 {
            continue;
        }
        let error = Vector3::from(estimate.velocity_m_s) - Vector3::from(truth.velocity_m_s);
        let std = Vector3::from(estimate.velocity_std_m_s);
        n += 1;
        squares += error.norm_squared();
        largest = largest.max(error.norm());
        nees += error.component_div(&std).norm_squared() / 3.0;
        positions += (Vector3::from(estimate.position_m) - Vector3::from(truth.position_m)).norm_squared();
    }
    let (counters, n) = (engine.counters(), f64::from(n));
    Ok(Flown {
        case: case.name.clone(),
        delivery: match run {
            Run::AtOnce => "at once",
            Run::Late => "late",
            Run::LateAndSilent => "late, silent",
            Run::LateAndZeros => "late, zeros",
            Run::LateInPart(TWO_AXES) => "late, two axes",
            Run::LateInPart(_) => "late, ahead only",
            Run::LateWithOutliers(Outliers::Told) => "late, outliers told",
            Run::LateWithOutliers(Outliers::Untold) => "late, outliers",
            Run::LateWithOutliers(Outliers::Rejected) => "late, outliers rejected",
        },
        velocity_rms_m_s: f64::sqrt(squares / n),
        velocity_max_m_s: largest,
        velocity_nees: nees / n,
        position_rms_m: f64::sqrt(positions / n),
        samples_sent: n_sent,
        samples_used: counters.samples_accepted,
        samples_rejected: counters.samples_rejected.iter().sum(),
        samples_lost: counters.samples_lost,
        late_ticks: late_ns.len(),
        fused_again: fused_again as f64 / late_ns.len().max(1) as f64,
        late_tick_us: summary(&mut late_ns).map(|time| time.p50 as f64 / 1e3),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_samples_of_several_processes_are_all_used_and_cost_little() {
        let case = Case::of("auv-survey").unwrap();
        let (truths, sent) = fly(&case, 2).unwrap();
        let in_part = Run::LateInPart(TWO_AXES);
        let [at_once, late, zeros, in_part] = [Run::AtOnce, Run::Late, Run::LateAndZeros, in_part]
            .map(|run| estimate(&case, &truths, &sent, run).unwrap());
        for flown in [&at_once, &late, &zeros, &in_part] {
            let counts = (flown.samples_used, flown.samples_rejected, flown.samples_lost);
            assert_eq!(counts, (flown.samples_sent, 0, 0), "{flown:?}");
            assert!(flown.velocity_nees < 1.1, "{flown:?}");
        }
        assert!(late.velocity_rms_m_s < 0.03, "{late:?}");
        assert!(late.velocity_rms_m_s < 1.5 * at_once.velocity_rms_m_s, "{late:?}");
        assert!(in_part.velocity_rms_m_s < 0.03, "{in_part:?}");
        assert!(late.position_rms_m < 0.5, "{late:?}");
        assert!(zeros.velocity_max_m_s < 1.0, "{zeros:?}");
    }
}
