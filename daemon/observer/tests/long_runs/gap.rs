//! Two seconds without samples and without commands, while the vehicle manoeuvres (joint.md §3b).

use crate::flight::{FliesOn, Flight, Kind, Motion, Reaches, RootMeanSquare, largest, median, multicopter};
use crate::random::Random;
use nalgebra::Vector3;

const GAP_S: f64 = 2.0;
const BEFORE_S: f64 = 20.0;
/// Windows after the return (s).
const WINDOWS_S: [(f64, f64); 5] = [(0.0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.5)];
/// The force is back at its level after this time (s).
const BACK_S: f64 = 0.5;
/// The velocity error may exceed this many deviations,
const DEVIATIONS: f64 = 4.0;
/// while the status says that it tracks, for this long (s).
const MAX_UNTOLD_S: f64 = 0.5;

struct Outcome {
    before: RootMeanSquare,
    after: [RootMeanSquare; WINDOWS_S.len()],
    /// Longest time beyond the deviations that the status does not tell of (s).
    untold_s: f64,
    /// From the return until the status tracks (s), and the largest velocity error in deviations in the gap and after it.
    reacquiring_s: f64,
    largest_ratio: f64,
}

fn outcome(kind: &Kind, flies_on: FliesOn, seed: u64) -> Outcome {
    let mut flight = Flight::new(kind, &kind.design(), flies_on, seed);
    let motion = Motion::new(kind, Vector3::zeros(), &mut Random::new(seed, 4));
    let (mut before, mut after) = (RootMeanSquare::default(), [RootMeanSquare::default(); WINDOWS_S.len()]);
    let (mut untold_s, mut longest_s, mut reacquiring_s, mut largest_ratio) =
        (0.0, 0.0_f64, f64::NAN, 0.0_f64);
    let h_s = kind.h_s();
    for j in 0..((BEFORE_S + GAP_S + 3.0) / h_s).round() as u64 {
        let t_s = j as f64 * h_s;
        let since_s = t_s - BEFORE_S - GAP_S;
        let reaches = if (-GAP_S - 1e-9..-1e-9).contains(&since_s) { Reaches::Nothing } else { Reaches::All };
        let step = flight.step(&motion.at(t_s), reaches);
        if (-GAP_S - 10.0..-GAP_S).contains(&since_s) {
            before.add(&step.force_error_n);
        }
        for ((from, to), window) in WINDOWS_S.iter().zip(&mut after) {
            if (from - 1e-9..to - 1e-9).contains(&since_s) {
                window.add(&step.force_error_n);
            }
        }
        let std = Vector3::from(step.estimate.prediction.velocity_std);
        let ratio = step.velocity_error_m_s.component_div(&std).amax();
        if t_s > BEFORE_S {
            largest_ratio = largest_ratio.max(ratio);
        }
        let is_untold = ratio > DEVIATIONS && !step.estimate.report.reacquiring;
        untold_s = if is_untold { untold_s + h_s } else { 0.0 };
        longest_s = longest_s.max(untold_s);
        if since_s >= 0.0 && reacquiring_s.is_nan() && !step.estimate.report.reacquiring {
            reacquiring_s = since_s;
        }
    }
    Outcome { before, after, untold_s: longest_s, reacquiring_s, largest_ratio }
}

fn check(kind: &Kind, seeds: u64) {
    for flies_on in [FliesOn::Truth, FliesOn::Estimate] {
        let outcomes: Vec<Outcome> = (1..=seeds).map(|seed| outcome(kind, flies_on, seed)).collect();
        let mut before = RootMeanSquare::default();
        outcomes.iter().for_each(|outcome| before.join(&outcome.before));
        let mut ratios = Vec::new();
        for (i, (from, to)) in WINDOWS_S.iter().enumerate() {
            let mut window = RootMeanSquare::default();
            outcomes.iter().for_each(|outcome| window.join(&outcome.after[i]));
            let each: Vec<f64> = outcomes.iter().map(|o| o.after[i].value() / o.before.value()).collect();
            println!(
                "{}, {flies_on:?}, {from} … {to} s after the return: force {:.4} N, before the gap {:.4} N, ratio {:.3} (median {:.3}, \
                 worst {:.3})",
                kind.air(),
                window.value(),
                before.value(),
                window.value() / before.value(),
                median(&each),
                largest(&each),
            );
            ratios.push(window.value() / before.value());
        }
        let of = |value: fn(&Outcome) -> f64| outcomes.iter().map(value).collect::<Vec<_>>();
        let untold = largest(&of(|o| o.untold_s));
        println!(
            "{flies_on:?}: untold for {untold:.3} s at most; reacquiring for {:.3} s (worst {:.3}); largest error {:.2} \
             deviations (median {:.2})",
            median(&of(|o| o.reacquiring_s)),
            largest(&of(|o| o.reacquiring_s)),
            largest(&of(|o| o.largest_ratio)),
            median(&of(|o| o.largest_ratio)),
        );
        for ((from, _), ratio) in WINDOWS_S.iter().zip(&ratios) {
            assert!(*from < BACK_S || *ratio < 1.5, "{flies_on:?}: {from} s after the return {ratio}");
        }
        assert!(untold <= MAX_UNTOLD_S, "{flies_on:?}: {untold} s");
    }
}

#[test]
fn after_a_gap_the_force_is_back_within_half_a_second_and_the_status_tells() {
    check(&multicopter(), 10);
    check(&multicopter().in_calm_air(), 10);
}

#[test]
#[ignore = "two hundred flights"]
fn long_run_of_two_hundred_gaps_the_force_is_back_within_half_a_second_and_the_status_tells() {
    check(&multicopter(), 200);
    check(&multicopter().in_calm_air(), 200);
}
