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
//!
//! The estimate of each tick is compared with the truth of that instant, after the first minute.

use crate::harness::output::{show, table};
use crate::harness::random::Random;
use clap::{Args, ValueEnum};
use daemon::assemble;
use daemon::config::{ConfigFile, OutlierAction};
use daemon::engine::Engine;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;
use shared_types::payload::valid;
use shared_types::{Estimate, Measurement, Truth, outln};
use sim_publisher::{Scenario, Simulation, SimulationOptions};

const START_NS: u64 = 1_000_000_000_000;
const FLIGHT_S: f64 = 300.0;
/// Errors are counted from here on (s).
const SETTLED_S: f64 = 60.0;
/// When the velocity's sensor is silent (s).
const SILENT_S: std::ops::Range<f64> = 180.0..240.0;

/// Arguments of `bench sensors`.
#[derive(Debug, Clone, Args)]
pub(crate) struct SensorsArguments {
    /// One case only.
    #[arg(long, value_name = "NAME")]
    scenario: Option<CaseName>,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum CaseName {
    /// Rates, attitude and commands at 100 Hz, a Doppler log at 5 Hz 150 ms late, depth at 10 Hz, a USBL fix every 5 s 1 s late.
    AuvSurvey,
    /// Rates, attitude and commands at 200 Hz, GNSS velocity and position at 5 Hz 120 ms late.
    MulticopterGnss,
}

/// What a process measures.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Quantity {
    /// Angular velocity, attitude, and the commands.
    RatesAndAttitude,
    BodyVelocity,
    VelocityAndPosition,
    Depth,
    Position,
}

/// The process of a sensor.
#[derive(Debug, Clone, Copy)]
struct Sensor {
    quantity: Quantity,
    /// One in so many samples of the simulation.
    every: u64,
    delay_s: f64,
    /// 1 σ of the velocity (m/s) or rate (rad/s), and of the position (m) or attitude (rad).
    noise: [f64; 2],
}

/// A vehicle with its sensors.
struct Case {
    name: &'static str,
    scenario: Scenario,
    preset: &'static str,
    rate_hz: f64,
    max_age_s: f64,
    sensors: Vec<Sensor>,
}

impl Case {
    fn of(name: CaseName) -> Self {
        let sensor = |quantity, every, delay_s, noise| Sensor { quantity, every, delay_s, noise };
        match name {
            CaseName::AuvSurvey => Self {
                name: "auv-survey",
                scenario: Scenario::Auv,
                preset: "auv",
                rate_hz: 100.0,
                max_age_s: 1.5,
                sensors: vec![
                    sensor(Quantity::RatesAndAttitude, 1, 0.0, [0.002, 0.005]),
                    sensor(Quantity::BodyVelocity, 20, 0.15, [0.01, 0.0]),
                    sensor(Quantity::Depth, 10, 0.0, [0.0, 0.02]),
                    sensor(Quantity::Position, 500, 1.0, [0.0, 0.5]),
                ],
            },
            CaseName::MulticopterGnss => Self {
                name: "multicopter-gnss",
                scenario: Scenario::RigidBody,
                preset: "rigid-body",
                rate_hz: 200.0,
                max_age_s: 0.5,
                sensors: vec![
                    sensor(Quantity::RatesAndAttitude, 1, 0.0, [0.005, 0.005]),
                    sensor(Quantity::VelocityAndPosition, 40, 0.12, [0.05, 0.3]),
                ],
            },
        }
    }
}

/// A sample of the process of this number.
#[derive(Debug, Clone, Copy)]
struct Sent {
    arrival_ns: u64,
    source: u128,
    sample: Measurement,
}

/// How a case is flown.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Delivery {
    AtOnce,
    Late,
    LateAndSilent,
    LateAndZeros,
}

/// Errors and counts of one run.
#[derive(Debug, Serialize)]
struct Flown {
    case: &'static str,
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
}

/// Runs `bench sensors`.
///
/// # Errors
/// A configuration that is refused.
pub(crate) fn run(arguments: &SensorsArguments) -> anyhow::Result<()> {
    let names = CaseName::value_variants().iter().copied();
    let names = names.filter(|name| arguments.scenario.is_none_or(|only| only == *name));
    let mut flown = Vec::new();
    for case in names.map(Case::of) {
        let (truths, sent) = fly(&case, arguments.seed)?;
        for delivery in [Delivery::AtOnce, Delivery::Late, Delivery::LateAndSilent] {
            flown.push(estimate(&case, &truths, &sent, delivery)?);
        }
        if ConfigFile::preset(case.preset)?.config.input.stuck == OutlierAction::Correction {
            flown.push(estimate(&case, &truths, &sent, Delivery::LateAndZeros)?);
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
        ];
        let row = |flown: &Flown| {
            let counts = [flown.samples_sent, flown.samples_used, flown.samples_rejected, flown.samples_lost];
            let errors = [
                format!("{:.4}", flown.velocity_rms_m_s),
                format!("{:.3}", flown.velocity_max_m_s),
                format!("{:.2}", flown.velocity_nees),
                format!("{:.2}", flown.position_rms_m),
            ];
            let names = [flown.case, flown.delivery].map(String::from);
            names.into_iter().chain(errors).chain(counts.map(|count| count.to_string())).collect::<Vec<_>>()
        };
        outln!("{}", table(&header, 2, flown.iter().map(row)));
    })
}

/// The truth, and what each sensor reads of it, in the order of the stamps.
fn fly(case: &Case, seed: u64) -> anyhow::Result<(Vec<Truth>, Vec<Sent>)> {
    let options = SimulationOptions {
        duration_s: Some(FLIGHT_S),
        rate_hz: case.rate_hz,
        seed,
        ..SimulationOptions::of(case.scenario)
    };
    let mut noises: Vec<_> = (0..).map(|k| Random(1000 * seed + k)).take(case.sensors.len()).collect();
    let (mut truths, mut sent) = (Vec::new(), Vec::new());
    for (j, simulated) in (0_u64..).zip(Simulation::new(&options)?) {
        let mut truth = simulated.truth;
        truth.stamp_ns = START_NS + (j as f64 * 1e9 / case.rate_hz) as u64;
        truths.push(truth);
        let Some(command) = simulated.measurement else { continue };
        for (source, (sensor, noise)) in (1..).zip(case.sensors.iter().zip(&mut noises)) {
            if j.is_multiple_of(sensor.every) {
                let sample = read(sensor, &truth, &command, j / sensor.every, noise);
                let arrival_ns = truth.stamp_ns + (sensor.delay_s * 1e9) as u64;
                sent.push(Sent { arrival_ns, source, sample });
            }
        }
    }
    Ok((truths, sent))
}

fn read(
    sensor: &Sensor,
    truth: &Truth,
    command: &Measurement,
    sequence: u64,
    random: &mut Random,
) -> Measurement {
    let [w, x, y, z] = truth.attitude_wxyz;
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let [first, second] = sensor.noise.map(|noise| Vector3::from_fn(|_, _| noise * random.normal()));
    let (velocity, position) = (Vector3::from(truth.velocity_m_s), Vector3::from(truth.position_m) + second);
    let sample = Measurement::at(truth.stamp_ns, sequence);
    match sensor.quantity {
        Quantity::RatesAndAttitude => {
            let told = (attitude * UnitQuaternion::new(second)).coords;
            sample
                .with_angular_velocity_rad_s((Vector3::from(truth.angular_velocity_rad_s) + first).into())
                .with_attitude_wxyz([told.w, told.x, told.y, told.z])
                .with_force_n(command.force_n)
                .with_torque_n_m(command.torque_n_m)
        }
        Quantity::BodyVelocity => {
            sample.with_body_velocity_m_s((attitude.inverse() * velocity + first).into())
        }
        Quantity::VelocityAndPosition => sample
            .with_velocity_m_s((velocity + first).into())
            .with_velocity_std_m_s([sensor.noise[0]; 3])
            .with_position_m(position.into())
            .with_position_std_m([sensor.noise[1]; 3]),
        Quantity::Depth => {
            sample.with_position_z_m(position.z).with_position_std_m([0.0, 0.0, sensor.noise[1]])
        }
        Quantity::Position => {
            sample.with_position_m(position.into()).with_position_std_m([sensor.noise[1]; 3])
        }
    }
}

/// Runs the engine tick by tick, one for each instant of the truth.
fn estimate(case: &Case, truths: &[Truth], sent: &[Sent], delivery: Delivery) -> anyhow::Result<Flown> {
    let mut file = ConfigFile::preset(case.preset)?;
    (file.config.rate_hz, file.config.input.max_age_s) = (case.rate_hz, case.max_age_s);
    let mut engine = Engine::new(&file.config, assemble::estimator(&file)?);

    let is_broken = |sent: &Sent| {
        let t_s = (sent.sample.stamp_ns - START_NS) as f64 / 1e9;
        sent.sample.has(valid::VELOCITY) && SILENT_S.contains(&t_s)
    };
    let mut sent = sent.to_vec();
    match delivery {
        Delivery::AtOnce | Delivery::Late => {}
        Delivery::LateAndSilent => sent.retain(|sent| !is_broken(sent)),
        Delivery::LateAndZeros => {
            let broken = sent.iter_mut().filter(|sent| is_broken(sent));
            broken.for_each(|sent| sent.sample.velocity_m_s = [0.0; 3]);
        }
    }
    if delivery == Delivery::AtOnce {
        sent.iter_mut().for_each(|sent| sent.arrival_ns = sent.sample.stamp_ns);
    }
    sent.sort_by_key(|sent| sent.arrival_ns);
    // What is silent is not lost: its driver does not count on.
    let mut sequences = std::collections::BTreeMap::new();
    for sent in &mut sent {
        let sequence = sequences.entry(sent.source).or_insert(0);
        sent.sample.sequence = *sequence;
        *sequence += 1;
    }

    let mut arriving = sent.iter().peekable();
    let (mut n, mut n_sent, mut squares, mut largest, mut nees, mut positions) =
        (0, 0, 0.0, 0.0_f64, 0.0, 0.0);
    for truth in truths {
        engine.begin(truth.stamp_ns, 0);
        while let Some(sent) = arriving.next_if(|sent| sent.arrival_ns <= truth.stamp_ns) {
            engine.take(&sent.sample, sent.source);
            n_sent += 1;
        }
        let estimate: Estimate = engine.conclude();
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
        case: case.name,
        delivery: match delivery {
            Delivery::AtOnce => "at once",
            Delivery::Late => "late",
            Delivery::LateAndSilent => "late, silent",
            Delivery::LateAndZeros => "late, zeros",
        },
        velocity_rms_m_s: f64::sqrt(squares / n),
        velocity_max_m_s: largest,
        velocity_nees: nees / n,
        position_rms_m: f64::sqrt(positions / n),
        samples_sent: n_sent,
        samples_used: counters.samples_accepted,
        samples_rejected: counters.samples_rejected.iter().sum(),
        samples_lost: counters.samples_lost,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_samples_of_several_processes_are_all_used_and_cost_little() {
        let case = Case::of(CaseName::AuvSurvey);
        let (truths, sent) = fly(&case, 2).unwrap();
        let [at_once, late, zeros] = [Delivery::AtOnce, Delivery::Late, Delivery::LateAndZeros]
            .map(|delivery| estimate(&case, &truths, &sent, delivery).unwrap());
        for flown in [&at_once, &late, &zeros] {
            let counts = (flown.samples_used, flown.samples_rejected, flown.samples_lost);
            assert_eq!(counts, (flown.samples_sent, 0, 0), "{flown:?}");
            assert!(flown.velocity_nees < 1.1, "{flown:?}");
        }
        assert!(late.velocity_rms_m_s < 0.03, "{late:?}");
        assert!(late.velocity_rms_m_s < 1.5 * at_once.velocity_rms_m_s, "{late:?}");
        assert!(late.position_rms_m < 0.5, "{late:?}");
        assert!(zeros.velocity_max_m_s < 1.0, "{zeros:?}");
    }
}
