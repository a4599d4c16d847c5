//! The reference figures of the two examples, from the true plant of `sim_publisher` and the library: 200 Hz,
//! x̂(0) = x(0), λ = 10, L_r = 0; RMS of the error's norm over the second half of 120 s.

use daemon::assemble;
use daemon::config::{ConfigFile, DeadZoneName, SymmetricMatrix};
use daemon::gate::Gate;
use nalgebra::Vector3;
use observer::{Learn, RigidBodyObserver};
use shared_types::Truth;
use sim_publisher::{Scenario, Simulation, SimulationOptions};

/// The figures must be met within this part of them; less error is welcome.
const WITHIN: f64 = 1.1;

struct Errors {
    position_m: f64,
    velocity_m_s: f64,
    force_n: f64,
}

fn run(
    scenario: Scenario,
    duration_s: f64,
    observer: &mut RigidBodyObserver,
    mut row: impl FnMut(f64, &Truth, &observer::RigidBodyEstimate, Vector3<f64>),
) {
    let options = SimulationOptions { duration_s: Some(duration_s), ..SimulationOptions::of(scenario) };
    let mut gate = Gate::new(Default::default(), false);
    for sample in Simulation::new(&options).unwrap() {
        let stamp_ns = sample.truth.stamp_ns;
        let measurement = sample.measurement.unwrap();
        let accepted = gate.judge(&measurement, 0, &gate.in_order(&measurement, 0)).unwrap();
        if stamp_ns == 0 {
            observer.accept(&accepted.sample, Learn::ALL);
        }
        // The estimate for t_j, before sample j is used; the force as used in the step from t_j.
        let estimate = observer.estimate(stamp_ns);
        if stamp_ns > 0 {
            observer.accept(&accepted.sample, Learn::ALL);
        }
        let used = observer.estimate(stamp_ns + 5_000_000);
        let force =
            if scenario == Scenario::Translation { used.matched_force_n } else { used.matched_torque_n_m };
        row(stamp_ns as f64 / 1e9, &sample.truth, &estimate, force);
    }
}

fn translation(change: impl FnOnce(&mut daemon::config::TranslationConfig)) -> Errors {
    let mut config = ConfigFile::preset("paper-translation").unwrap();
    change(config.config.translation.as_mut().unwrap());
    let (mut sums, mut rows) = ([0.0; 3], 0.0);
    run(
        Scenario::Translation,
        120.0,
        &mut assemble::rigid_body(&config).unwrap(),
        |t_s, truth, estimate, force| {
            if t_s >= 60.0 {
                sums[0] += (estimate.position_m - Vector3::from(truth.position_m)).norm_squared();
                sums[1] += (estimate.velocity_m_s - Vector3::from(truth.velocity_m_s)).norm_squared();
                sums[2] += (force - Vector3::from(truth.matched_force_n)).norm_squared();
                rows += 1.0;
            }
        },
    );
    let [position_m, velocity_m_s, force_n] = sums.map(|sum: f64| (sum / rows).sqrt());
    println!("position {position_m:.4} m, velocity {velocity_m_s:.5} m/s, force {force_n:.4} N");
    Errors { position_m, velocity_m_s, force_n }
}

#[track_caller]
fn assert_met(found: &Errors, velocity_m_s: f64, force_n: f64, position_m: f64) {
    assert!(found.velocity_m_s < WITHIN * velocity_m_s, "velocity {} m/s", found.velocity_m_s);
    assert!(found.force_n < WITHIN * force_n, "force {} N", found.force_n);
    assert!(found.position_m < WITHIN * position_m, "position {} m", found.position_m);
}

#[test]
fn translation_with_the_saturated_dead_zone() {
    let found = translation(|_| {});
    assert_met(&found, 0.01566, 0.2924, 0.2070);
}

#[test]
fn translation_with_the_papers_dead_zone_and_adaptation_rate() {
    let found = translation(|t| {
        t.dead_zone = DeadZoneName::Quadratic;
        t.adaptation_rate_kg_s2 = Some(SymmetricMatrix::Scalar(1.0));
    });
    assert_met(&found, 0.03523, 1.308, 1.965);
}

#[test]
fn translation_with_a_low_gain() {
    let found = translation(|t| {
        t.adaptation_rate_kg_s2 = Some(SymmetricMatrix::Scalar(10.0));
        t.gain_per_s = Some(2.0);
    });
    assert_met(&found, 0.01861, 0.2262, 0.1380);
}

/// The paper's settings, the whole 100 s, per axis.
#[test]
fn rotation_with_the_papers_settings() {
    let config = ConfigFile::preset("paper-rotation").unwrap();
    let (mut angles, mut rates, mut rows) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    run(Scenario::Rotation, 100.0, &mut assemble::rigid_body(&config).unwrap(), |_, truth, estimate, _| {
        let [w, x, y, z] = truth.attitude_wxyz;
        let q = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        let (roll, pitch, yaw) = q.euler_angles();
        // Angles on both sides of π differ by little, not by a turn.
        let turn = std::f64::consts::TAU;
        let difference = Vector3::from(estimate.euler_rad()) - Vector3::new(roll, pitch, yaw);
        let angle_error = difference.map(|angle: f64| angle - turn * (angle / turn).round());
        let rate_error = estimate.angular_velocity_rad_s - Vector3::from(truth.angular_velocity_rad_s);
        angles += angle_error.component_mul(&angle_error);
        rates += rate_error.component_mul(&rate_error);
        rows += 1.0;
    });
    let (angles, rates) = ((angles / rows).map(f64::sqrt), (rates / rows).map(f64::sqrt));
    println!("angles {angles:?} rad, rates {rates:?} rad/s");
    for (axis, reference_rad) in [0.01607, 0.01742, 0.01289].into_iter().enumerate() {
        assert!(angles[axis] < WITHIN * reference_rad, "axis {axis}: {}", angles[axis]);
        assert!(rates[axis] < WITHIN * 0.0316, "axis {axis}: {}", rates[axis]);
    }
}
