//! After construction the observer allocates nothing: not while it learns, not while it coasts.

use allocation_counter::measure;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use observer::*;
fn channel(inertia: f64) -> ChannelDesign {
    ChannelDesign {
        kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
        length_scale: LengthScale::Isotropic(1.0),
        centers: Centers::lattice([-1.0; 3], [1.0; 3], [4; 3]).unwrap(),
        nugget: 0.0,
        inertia: Matrix3::identity() * inertia,
        gain_per_s: 10.0,
        adaptation_rate: Matrix3::identity() * 10.0,
        dead_zone: DeadZone::new(DeadZoneShape::Saturated, 1e-3, 1e-3).unwrap(),
        bounds: DisturbanceBounds::default(),
        hold_s: 0.0075,
        coast_step_s: 0.005,
    }
}

#[test]
fn accepting_estimating_and_restoring_allocate_nothing() {
    let translation = TranslationDesign {
        channel: channel(4.0),
        known_force_n: Vector3::zeros(),
        velocity_error_to_position: 0.0,
        position_fix_gain_per_s: 1.0,
        position_fix_hold_s: 0.1,
    };
    let rotation = RotationDesign {
        channel: channel(0.5),
        gyroscopic_torque: GyroscopicTorque::Feedforward,
        attitude_fix_gain_per_s: 1.0,
        attitude_fix_hold_s: 0.1,
    };
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
            observer.accept(&Sample {
                stamp_ns,
                velocity: Some(Velocity::Body(v)),
                angular_velocity_rad_s: Some(0.1 * v),
                position_m: Some(v),
                attitude: Some(UnitQuaternion::identity()),
                force_n: Some(-v),
                torque_n_m: Some(v),
            });
        }
        std::hint::black_box(observer.estimate(stamp_ns + 2_000_000));
    }
    observer.keep_good_copy();
    observer.restore_translation();
    observer.restore_rotation();
    observer.set_frozen(true);
    observer.reset();
}
