//! Velocity and command in one sample or in two: the estimates are as good.

use crate::flight::{
    FliesOn, Flight, Kind, Motion, Reaches, RootMeanSquare, multicopter, underwater_vehicle,
};
use crate::random::Random;
use nalgebra::Vector3;

struct Outcome {
    force: f64,
    velocity: f64,
    deviation: f64,
}

/// What is lost with a part of the samples.
#[derive(Debug, Clone, Copy)]
struct Losses {
    part: f64,
    leaves: Reaches,
}

const NONE: Losses = Losses { part: 0.0, leaves: Reaches::All };

/// The command reaches plant and channel at the same instant in each case, but for the delay.
fn outcome(kind: &Kind, command_delay_ns: Option<u64>, losses: Losses) -> Outcome {
    let (mut force, mut velocity, mut deviation) =
        <(RootMeanSquare, RootMeanSquare, RootMeanSquare)>::default();
    for seed in 1..=4 {
        let mut flight = Flight::new(kind, &kind.design(), FliesOn::Truth, seed);
        flight.command_delay_ns = command_delay_ns;
        let motion = Motion::new(kind, Vector3::zeros(), &mut Random::new(seed, 4));
        let mut link = Random::new(seed, 5);
        for j in 0..(60.0 / kind.h_s()) as u64 {
            let t_s = j as f64 * kind.h_s();
            let step = flight.step(
                &motion.at(t_s),
                if link.uniform() < losses.part { losses.leaves } else { Reaches::All },
            );
            if t_s > 20.0 {
                force.add(&step.force_error_n);
                velocity.add(&step.velocity_error_m_s);
                deviation.add(&Vector3::from(step.estimate.prediction.velocity_std));
            }
        }
    }
    Outcome { force: force.value(), velocity: velocity.value(), deviation: deviation.value() }
}

#[test]
fn a_command_in_a_sample_of_its_own_serves_as_well_as_one_beside_the_velocity() {
    let mut failures = Vec::new();
    for kind in [multicopter(), underwater_vehicle()] {
        let together = outcome(&kind, None, NONE);
        for delay_ns in [0, 100_000, 1_000_000] {
            let apart = outcome(&kind, Some(delay_ns), NONE);
            println!(
                "{}, {delay_ns} ns: force {:.4} N, together {:.4} N; velocity {:.4} m/s, together {:.4} m/s; deviation {:.4} m/s, \
                 together {:.4} m/s",
                kind.name,
                apart.force,
                together.force,
                apart.velocity,
                together.velocity,
                apart.deviation,
                together.deviation,
            );
            // The delay itself costs a little.
            for (name, ratio) in [
                ("force", apart.force / together.force),
                ("velocity", apart.velocity / together.velocity),
                ("deviation", apart.deviation / together.deviation),
            ] {
                if ratio > 1.05 {
                    failures.push(format!("{}, {delay_ns} ns: {name} × {ratio:.3}", kind.name));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn lost_frames_cost_little_more_than_lost_velocities() {
    let mut failures = Vec::new();
    for actuators_s in [0.0, 0.1] {
        let kind = Kind { actuators_s, ..multicopter() };
        let all = outcome(&kind, None, NONE);
        for part in [0.02, 0.1] {
            let velocities = outcome(&kind, None, Losses { part, leaves: Reaches::Command });
            let frames = outcome(&kind, None, Losses { part, leaves: Reaches::Nothing });
            println!(
                "actuators of {actuators_s} s, {part} lost: force {:.4} N; velocities {:.4} N; frames {:.4} N; velocity {:.4} m/s; \
                 {:.4} m/s; {:.4} m/s; deviation {:.4} m/s; {:.4} m/s; {:.4} m/s",
                all.force,
                velocities.force,
                frames.force,
                all.velocity,
                velocities.velocity,
                frames.velocity,
                all.deviation,
                velocities.deviation,
                frames.deviation,
            );
            // The lags start anew after each lost frame.
            if frames.force > 1.25 * velocities.force {
                failures
                    .push(format!("{actuators_s} s, {part}: force × {:.3}", frames.force / velocities.force));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
