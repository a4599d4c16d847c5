//! Noise levels and excitation can be switched off, each by itself.

use crate::flight::{FliesOn, Flight, Motion, Reaches, multicopter};
use crate::random::Random;
use nalgebra::Vector3;

/// Ranges of ρ, λ and g over a minute of hover and a minute of motion.
struct Ranges {
    sensor: (f64, f64),
    process: (f64, f64),
    /// In the second half of the hover; in the motion.
    teaching_at_rest: (f64, f64),
    teaching_in_motion: (f64, f64),
}

fn ranges(noise_samples: f64, correction_share: f64) -> Ranges {
    let kind = multicopter();
    let mut design = kind.design();
    design.filter.noise_samples = noise_samples;
    design.filter.excitation.correction_share = correction_share;
    let mut flight = Flight::new(&kind, &design, FliesOn::Estimate, 1);
    let motion = Motion::new(&kind, Vector3::zeros(), &mut Random::new(1, 4));
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    let mut ranges = Ranges { sensor: none, process: none, teaching_at_rest: none, teaching_in_motion: none };
    let extend = |range: &mut (f64, f64), value: f64| *range = (range.0.min(value), range.1.max(value));
    for j in 0..24_000 {
        let t_s = j as f64 * kind.h_s();
        let wanted = if t_s < 60.0 { Vector3::zeros() } else { motion.at(t_s - 60.0) };
        flight.step(&wanted, Reaches::All);
        let state = flight.channel.state();
        let (rho, lambda) = state.noise_levels();
        extend(&mut ranges.sensor, rho);
        extend(&mut ranges.process, lambda);
        match t_s {
            30.0..60.0 => extend(&mut ranges.teaching_at_rest, state.teaching()),
            62.0.. => extend(&mut ranges.teaching_in_motion, state.teaching()),
            _ => {}
        }
    }
    println!(
        "N_a = {noise_samples}, c = {correction_share}: ρ {:.3?}, λ {:.3?}, g at rest {:.6?}, in motion {:.6?}",
        ranges.sensor, ranges.process, ranges.teaching_at_rest, ranges.teaching_in_motion
    );
    ranges
}

#[test]
fn by_default_the_noise_levels_follow_and_hover_does_not_teach() {
    let ranges = ranges(500.0, 0.3);
    assert!(ranges.sensor.1 - ranges.sensor.0 > 0.05 && ranges.process.1 - ranges.process.0 > 0.05);
    assert!(ranges.teaching_at_rest.1 < 0.5, "{:?}", ranges.teaching_at_rest);
    assert!(ranges.teaching_in_motion.0 > 0.9, "{:?}", ranges.teaching_in_motion);
}

#[test]
fn without_noise_samples_the_levels_stay_and_hover_still_does_not_teach() {
    let ranges = ranges(0.0, 0.3);
    assert_eq!((ranges.sensor, ranges.process), ((1.0, 1.0), (1.0, 1.0)));
    assert!(ranges.teaching_at_rest.1 < 0.5, "{:?}", ranges.teaching_at_rest);
    assert!(ranges.teaching_in_motion.0 > 0.9, "{:?}", ranges.teaching_in_motion);
}

#[test]
fn without_a_share_of_the_corrections_everything_teaches_and_the_levels_still_follow() {
    let ranges = ranges(500.0, 0.0);
    assert!(ranges.sensor.1 - ranges.sensor.0 > 0.05 && ranges.process.1 - ranges.process.0 > 0.05);
    assert_eq!((ranges.teaching_at_rest, ranges.teaching_in_motion), ((1.0, 1.0), (1.0, 1.0)));
}

#[test]
fn without_both_it_is_the_plain_filter() {
    let ranges = ranges(0.0, 0.0);
    assert_eq!((ranges.sensor, ranges.process), ((1.0, 1.0), (1.0, 1.0)));
    assert_eq!((ranges.teaching_at_rest, ranges.teaching_in_motion), ((1.0, 1.0), (1.0, 1.0)));
}
