//! Noises that are stated three times too large or too small (joint.md §2a).

use crate::flight::{FliesOn, Flight, Motion, Reaches, RootMeanSquare, multicopter};
use crate::random::Random;
use nalgebra::Vector3;

/// Factors of the deviations: of the sensor, of the process.
const STATED: [(f64, f64); 7] = [
    (1.0, 1.0),
    (3.0, 1.0),
    (1.0 / 3.0, 1.0),
    (1.0, 3.0),
    (1.0, 1.0 / 3.0),
    (3.0, 1.0 / 3.0),
    (1.0 / 3.0, 3.0),
];
/// What is judged begins after this time (s).
const SETTLED_S: f64 = 60.0;
/// Bounds of the errors, as multiples of those with the noises rightly stated.
const MAX_RATIO: f64 = 1.3;

#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    force: RootMeanSquare,
    velocity: RootMeanSquare,
    coast: RootMeanSquare,
    nis: f64,
    n_nis: f64,
    levels: (f64, f64),
}

fn errors(
    (sensor, process): (f64, f64),
    flies_on: FliesOn,
    duration_s: f64,
    seeds: u64,
    is_adapting: bool,
) -> Errors {
    let kind = multicopter();
    let mut design = kind.design();
    design.filter.noise = design.filter.noise.map(|noise| sensor * noise);
    design.filter.process_noise *= process * process;
    design.filter.prior.disturbance *= process;
    if !is_adapting {
        design.filter.noise_samples = 0.0;
    }
    let mut errors = Errors::default();
    for seed in 1..=seeds {
        let mut flight = Flight::new(&kind, &design, flies_on, seed);
        let motion = Motion::new(&kind, Vector3::zeros(), &mut Random::new(seed, 4));
        let n = (duration_s / kind.h_s()).round() as u64;
        for j in 0..n {
            let t_s = j as f64 * kind.h_s();
            // 0.5 s without velocity in every 5 s.
            let outage = t_s % 5.0 >= 4.5;
            let step = flight.step(&motion.at(t_s), if outage { Reaches::Command } else { Reaches::All });
            if t_s < SETTLED_S {
                continue;
            }
            if let Some(nis) = step.nis {
                errors.nis += nis;
                errors.n_nis += 1.0;
                errors.force.add(&step.force_error_n);
                errors.velocity.add(&step.velocity_error_m_s);
            } else if t_s % 5.0 > 5.0 - 1.5 * kind.h_s() {
                errors.coast.add(&step.velocity_error_m_s);
            }
        }
        let (rho, lambda) = flight.channel.state().noise_levels();
        errors.levels.0 += rho / seeds as f64;
        errors.levels.1 += lambda / seeds as f64;
    }
    errors
}

fn check(duration_s: f64, seeds: u64) {
    let mut failures = Vec::new();
    for flies_on in [FliesOn::Truth, FliesOn::Estimate] {
        let right = errors(STATED[0], flies_on, duration_s, seeds, true);
        for (sensor, process) in STATED {
            let stated = errors((sensor, process), flies_on, duration_s, seeds, true);
            let as_configured = errors((sensor, process), flies_on, duration_s, seeds, false);
            let nis = stated.nis / stated.n_nis;
            let ratios = [
                ("force", stated.force.value() / right.force.value()),
                ("velocity", stated.velocity.value() / right.velocity.value()),
                ("coast", stated.coast.value() / right.coast.value()),
            ];
            println!(
                "{flies_on:?}, sensor × {sensor:.2}, process × {process:.2}: NIS {nis:.3} (as configured {:.3}), ρ {:.3}, λ {:.3}; \
                 force {:.4} N × {:.3}, velocity {:.5} m/s × {:.3}, after outages {:.4} m/s × {:.3}; as configured × {:.3}, \
                 {:.3}, {:.3}",
                as_configured.nis / as_configured.n_nis,
                stated.levels.0,
                stated.levels.1,
                stated.force.value(),
                ratios[0].1,
                stated.velocity.value(),
                ratios[1].1,
                stated.coast.value(),
                ratios[2].1,
                as_configured.force.value() / right.force.value(),
                as_configured.velocity.value() / right.velocity.value(),
                as_configured.coast.value() / right.coast.value(),
            );
            if !(0.8..1.2).contains(&nis) {
                failures.push(format!("{flies_on:?}, × {sensor:.2}, × {process:.2}: NIS {nis:.3}"));
            }
            for (name, ratio) in ratios {
                if ratio >= MAX_RATIO {
                    failures
                        .push(format!("{flies_on:?}, × {sensor:.2}, × {process:.2}: {name} × {ratio:.3}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn noises_stated_three_times_wrong_are_found_and_cost_little() {
    check(120.0, 2);
}

#[test]
#[ignore = "hours of flight: minutes"]
fn long_run_noises_stated_three_times_wrong_are_found_and_cost_little() {
    check(600.0, 6);
}
