//! After construction the observer allocates nothing, neither while it learns nor while it coasts.

use crate::designs::{body_channel, joint_law, oscillator};
use crate::{isotropic, zone};
use allocation_counter::measure;
use nalgebra::{UnitQuaternion, Vector3};
use observer::*;

fn channel(inertia: f64, solver: Solver) -> ChannelDesign {
    let [inertia, rate] = [inertia, 10.0].map(isotropic);
    let centers = Centers::lattice([-1.0; 3], [1.0; 3], [5; 3]).unwrap();
    ChannelDesign { centers, solver, ..body_channel(inertia, rate, zone(DeadZoneShape::Saturated, 1e-3)) }
}

#[test]
fn accepting_estimating_and_restoring_allocate_nothing() {
    let local = LocalSolver { block: Some(4), ..LocalSolver::default() };
    let truncated = LocalSolver { truncation: 0.1, ..local };
    for solver in [Solver::Dense, Solver::Local(local), Solver::Local(truncated)] {
        an_observer_allocates_nothing_after_construction(solver);
    }
}

fn an_observer_allocates_nothing_after_construction(solver: Solver) {
    let options = GradientOptions { feature_point: FeaturePoint::Estimated, max_norm: Some(0.1) };
    let translation = TranslationDesign {
        channel: ChannelDesign { options, ..channel(4.0, solver) },
        known_force_n: Vector3::zeros(),
        velocity_error_to_position: 0.0,
        position_fix_gain_per_s: 1.0,
        position_fix_hold_s: 0.1,
    };
    let rotation = RotationDesign {
        channel: channel(0.5, solver),
        gyroscopic_torque: GyroscopicTorque::Feedforward,
        attitude_fix_gain_per_s: 1.0,
        attitude_fix_hold_s: 0.1,
    };
    allocates_nothing_after_construction(translation.into(), rotation.into());
}

/// One covariance for all axes, and one for each.
#[test]
fn with_the_joint_law_accepting_estimating_and_restoring_allocate_nothing() {
    for noise in [[0.01; 3], [0.01, 0.02, 0.03]] {
        let channel = || JointChannelDesign {
            filter: JointDesign { position_noise: Some(0.5), ..joint_law(noise) },
            inertia: isotropic(4.0),
            hold_s: 0.0075,
        };
        let translation = JointTranslationDesign {
            channel: channel(),
            known_force_n: Vector3::zeros(),
            gravity_m_s2: Vector3::zeros(),
        };
        let rotation = JointRotationDesign {
            channel: channel(),
            gyroscopic_torque: GyroscopicTorque::Feedforward,
            attitude_noise_rad: 0.01,
            bias_std_rad_s: 0.01,
            bias_walk_rad_s_sqrt_s: 1e-4,
        };
        allocates_nothing_after_construction(
            TranslationLaw::Joint(translation),
            RotationLaw::Joint(rotation),
        );
    }
}

fn allocates_nothing_after_construction(translation: TranslationLaw, rotation: RotationLaw) {
    let mut observer = None;
    let construction = measure(|| {
        observer = RigidBodyObserver::new(Some(translation), Some(rotation), InitialState::default()).ok();
    });
    assert!(construction.count_total > 0, "the counter counts");
    let mut observer = observer.unwrap();
    assert_eq!(measure(|| exercise(&mut observer)).count_total, 0);
}

fn exercise(observer: &mut RigidBodyObserver) {
    for j in 0..2000_u64 {
        let t = j as f64 * 0.005;
        let v = Vector3::new(t.sin(), t.cos(), (2.0 * t).sin());
        let stamp_ns = j * 5_000_000;
        if !(500..700).contains(&j) {
            observer.accept(
                &Sample {
                    stamp_ns,
                    velocity: Some(Velocity::Body(v)),
                    angular_velocity_rad_s: Some(0.1 * v),
                    position_m: Some(v),
                    attitude: Some(UnitQuaternion::identity()),
                    force_n: Some(-v),
                    torque_n_m: Some(v),
                    ..Sample::default()
                },
                Learn::ALL,
            );
        }
        std::hint::black_box(observer.estimate(stamp_ns + 2_000_000));
    }
    for name in [ChannelName::Translation, ChannelName::Rotation] {
        let channel = observer.channel_mut(name).unwrap();
        let state = channel.save();
        channel.restore(Some(&state));
    }
    observer.reset();
}

#[test]
fn the_observer_of_a_linear_plant_allocates_nothing_in_its_steps() {
    let mut observer = LinearObserver::new(&oscillator()).unwrap();
    let steps = measure(|| {
        for j in 0..2000_u64 {
            let output = LinearOutput::from_fn(|i, _| if i == 0 { (j as f64 * 0.01).sin() } else { 0.0 });
            // Stamps that jitter, so that every step is of another length; and an outage.
            let stamp_ns = j * 5_000_000 + j * 7919 % 1009;
            observer.accept(
                stamp_ns,
                Some(output).filter(|_| !(500..700).contains(&j)),
                Some(-output),
                Learn::ALL,
            );
            std::hint::black_box(observer.estimate(stamp_ns + 2_000_000));
        }
        let channel = observer.channel_mut();
        let state = channel.save();
        channel.restore(Some(&state));
        channel.forget();
    });
    assert_eq!(steps.count_total, 0);
}
