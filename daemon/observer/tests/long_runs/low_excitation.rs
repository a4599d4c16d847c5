//! After a long time without motion the filter knows what a fresh one knows (joint.md §3a).
//!
//! A vehicle rests, hovers or cruises; then it moves. Beside it flies a fresh filter that began 2 s before the motion, in a
//! loop of its own with the same random numbers. Compared are the force over the first 2 s of motion, and the velocity at
//! the end of four outages of 0.5 s in that time, commands flowing.

use crate::flight::{
    FliesOn, Flight, Kind, Motion, Reaches, RootMeanSquare, largest, median, multicopter, underwater_vehicle,
};
use crate::random::Random;
use nalgebra::Vector3;

const FRESH_S: f64 = 2.0;
const MOTION_S: f64 = 2.0;
const OUTAGE_S: f64 = 0.5;
/// The bound on each ratio.
const MAX_RATIO: f64 = 1.2;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Before {
    Rest,
    Cruise,
}

/// Force over the motion, velocity after the outages.
#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    force: RootMeanSquare,
    velocity: RootMeanSquare,
}

impl Errors {
    fn of(flight: &mut Flight, motion: &Motion) -> Self {
        let mut errors = Self::default();
        let h_s = flight.kind.h_s();
        let steps = (MOTION_S / h_s).round() as u64;
        let between = (OUTAGE_S / h_s).round() as u64;
        for j in 0..=steps {
            if j > 0 && j % between == 0 {
                let mut coasting = flight.clone();
                let mut last = Vector3::zeros();
                for k in 0..between {
                    let wanted = motion.at((j + k) as f64 * h_s);
                    last = coasting.step(&wanted, Reaches::Command).velocity_error_m_s;
                }
                errors.velocity.add(&last);
            }
            if j < steps {
                let step = flight.step(&motion.at(j as f64 * h_s), Reaches::All);
                errors.force.add(&step.force_error_n);
            }
        }
        errors
    }
}

struct Outcome {
    long: Errors,
    fresh: Errors,
    largest_weights_square: f64,
}

fn outcome(kind: &Kind, before: Before, flies_on: FliesOn, duration_s: f64, seed: u64) -> Outcome {
    let design = kind.design();
    let mut flight = Flight::new(kind, &design, flies_on, seed);
    let wanted = match before {
        Before::Rest => Vector3::zeros(),
        Before::Cruise => Vector3::new(kind.cruise_m_s, 0.0, 0.0),
    };
    let n_steps = |t_s: f64| (t_s / kind.h_s()).round() as u64;
    let mut largest_weights_square: f64 = 0.0;
    let look = |flight: &Flight, so_far: &mut f64| *so_far = so_far.max(flight.largest_weights_square());
    for j in 0..n_steps(duration_s - FRESH_S) {
        flight.step(&wanted, Reaches::All);
        if j % 100 == 0 {
            look(&flight, &mut largest_weights_square);
        }
    }
    let mut fresh = flight.clone();
    fresh.channel = kind.channel(&design);
    for _ in 0..n_steps(FRESH_S) {
        flight.step(&wanted, Reaches::All);
        fresh.step(&wanted, Reaches::All);
    }
    let motion = Motion::new(kind, wanted, &mut Random::new(seed, 4));
    let long = Errors::of(&mut flight, &motion);
    let fresh = Errors::of(&mut fresh, &motion);
    look(&flight, &mut largest_weights_square);
    Outcome { long, fresh, largest_weights_square }
}

/// Prints and asserts a case over seeds.
fn check(kind: &Kind, before: Before, duration_s: f64, seeds: u64) {
    let mut failures = Vec::new();
    for flies_on in [FliesOn::Truth, FliesOn::Estimate] {
        let (mut long, mut fresh) = (Errors::default(), Errors::default());
        let (mut forces, mut velocities, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 1..=seeds {
            let outcome = outcome(kind, before, flies_on, duration_s, seed);
            forces.push(outcome.long.force.value() / outcome.fresh.force.value());
            velocities.push(outcome.long.velocity.value() / outcome.fresh.velocity.value());
            weights.push(outcome.largest_weights_square);
            long.force.join(&outcome.long.force);
            long.velocity.join(&outcome.long.velocity);
            fresh.force.join(&outcome.fresh.force);
            fresh.velocity.join(&outcome.fresh.velocity);
        }
        let force = long.force.value() / fresh.force.value();
        let velocity = long.velocity.value() / fresh.velocity.value();
        println!(
            "{}, {}, {before:?} of {duration_s} s, on the {flies_on:?}, {seeds} seeds: force {:.4} N, fresh {:.4} N, ratio {force:.3} \
             (median {:.3}, worst {:.3}); velocity after an outage {:.4} m/s, fresh {:.4} m/s, ratio {velocity:.3} (median {:.3}, \
             worst {:.3}); ‖θ‖² at most {:.1} (median {:.1})",
            kind.name,
            kind.air(),
            long.force.value(),
            fresh.force.value(),
            median(&forces),
            largest(&forces),
            long.velocity.value(),
            fresh.velocity.value(),
            median(&velocities),
            largest(&velocities),
            largest(&weights),
            median(&weights),
        );
        let n_weights = kind.channel(&kind.design()).n_weights() as f64;
        let bounds = [
            ("force", force, MAX_RATIO),
            ("velocity", velocity, MAX_RATIO),
            ("‖θ‖²", largest(&weights), 2.0 * n_weights),
        ];
        for (name, value, bound) in bounds {
            if value.is_nan() || value >= bound {
                failures.push(format!("on the {flies_on:?}: {name} {value}, at most {bound}"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn after_two_minutes_of_hover_a_multicopter_s_filter_is_as_good_as_a_fresh_one() {
    check(&multicopter(), Before::Rest, 120.0, 4);
    check(&multicopter().in_calm_air(), Before::Rest, 120.0, 4);
}

#[test]
fn after_two_minutes_of_cruise_a_multicopter_s_filter_is_as_good_as_a_fresh_one() {
    check(&multicopter(), Before::Cruise, 120.0, 4);
    check(&multicopter().in_calm_air(), Before::Cruise, 120.0, 4);
}

#[test]
fn after_ten_minutes_of_rest_an_underwater_vehicle_s_filter_is_as_good_as_a_fresh_one() {
    check(&underwater_vehicle(), Before::Rest, 600.0, 4);
}

#[test]
fn after_ten_minutes_of_cruise_an_underwater_vehicle_s_filter_is_as_good_as_a_fresh_one() {
    check(&underwater_vehicle(), Before::Cruise, 600.0, 4);
}

#[test]
#[ignore = "hours of flight: minutes"]
fn long_run_after_an_hour_of_hover_a_multicopter_s_filter_is_as_good_as_a_fresh_one() {
    check(&multicopter(), Before::Rest, 3600.0, 8);
    check(&multicopter().in_calm_air(), Before::Rest, 3600.0, 8);
}

#[test]
#[ignore = "hours of flight: minutes"]
fn long_run_after_an_hour_of_cruise_a_multicopter_s_filter_is_as_good_as_a_fresh_one() {
    check(&multicopter(), Before::Cruise, 3600.0, 8);
    check(&multicopter().in_calm_air(), Before::Cruise, 3600.0, 8);
}

#[test]
#[ignore = "days of flight: minutes"]
fn long_run_after_ten_hours_of_rest_an_underwater_vehicle_s_filter_is_as_good_as_a_fresh_one() {
    check(&underwater_vehicle(), Before::Rest, 36_000.0, 4);
}

#[test]
#[ignore = "days of flight: minutes"]
fn long_run_after_ten_hours_of_cruise_an_underwater_vehicle_s_filter_is_as_good_as_a_fresh_one() {
    check(&underwater_vehicle(), Before::Cruise, 36_000.0, 4);
}
