use super::*;
use crate::channels::ChannelState;
use crate::designs::{body_channel, joint_law};
use crate::innovation_gate::{InnovationGate, OutlierAction};
use crate::joint_channel::JointChannelDesign;
use crate::law::channel::BodyChannel;
use crate::law::dead_zone::{DeadZone, DeadZoneShape};
use crate::law::gradient::Learning;
use crate::space::centers::Centers;
use crate::space::scaled_kernel::LengthScale;
use nalgebra::Matrix3;

const PERIOD_NS: u64 = 5_000_000;
const PERIOD_S: f64 = 0.005;
const START_NS: u64 = 77_000_000_000;

fn channel(inertia: Matrix3<f64>, adaptation_rate: f64) -> ChannelDesign {
    let dead_zone = DeadZone::new(DeadZoneShape::Saturated, 1e-3, 1e-3).unwrap();
    ChannelDesign {
        length_scale: LengthScale::Isotropic(2.0),
        centers: Centers::lattice([-2.0; 3], [2.0; 3], [3; 3]).unwrap(),
        ..body_channel(inertia, Matrix3::identity() * adaptation_rate, dead_zone)
    }
}

fn translation(known_force_n: [f64; 3]) -> TranslationDesign {
    TranslationDesign {
        channel: channel(Matrix3::identity() * 2.0, 100.0),
        known_force_n: known_force_n.into(),
        velocity_error_to_position: 0.0,
        position_fix_gain_per_s: 0.5,
        position_fix_hold_s: 10.0,
    }
}

fn rotation(gyroscopic_torque: GyroscopicTorque) -> RotationDesign {
    RotationDesign {
        channel: channel(Matrix3::from_diagonal(&Vector3::new(0.1, 0.2, 0.3)), 5.0),
        gyroscopic_torque,
        attitude_fix_gain_per_s: 2.0,
        attitude_fix_hold_s: 10.0,
    }
}

fn both() -> RigidBodyObserver {
    let rotation = rotation(GyroscopicTorque::Learned);
    RigidBodyObserver::new(Some(translation([0.0; 3]).into()), Some(rotation.into()), InitialState::default())
        .unwrap()
}

fn feed(observer: &mut RigidBodyObserver, samples: &[Sample]) {
    for sample in samples {
        observer.accept(sample, Learn::ALL);
    }
}

fn save(observer: &mut RigidBodyObserver) -> [(ChannelName, ChannelState); 2] {
    [ChannelName::Translation, ChannelName::Rotation]
        .map(|name| (name, observer.channel_mut(name).unwrap().save()))
}

/// A stream with everything in it: three rates, body-frame velocities, fixes, jitter and an outage.
fn varied_samples() -> Vec<Sample> {
    let mut samples = Vec::new();
    for j in 0..2000_u64 {
        let t = j as f64 * PERIOD_S;
        if (900..1000).contains(&j) {
            continue;
        }
        let every = |n: u64, vector: Vector3<f64>| j.is_multiple_of(n).then_some(vector);
        let v = Vector3::new(t.sin(), (0.7 * t).cos(), 0.3 * (2.0 * t).sin());
        samples.push(Sample {
            stamp_ns: START_NS + j * PERIOD_NS + (j * 7919 % 1000) * 500,
            velocity: every(2, v).map(if j < 500 { Velocity::Inertial } else { Velocity::Body }),
            angular_velocity_rad_s: Some(Vector3::new((2.0 * t).cos(), t.sin(), -0.5)),
            position_m: every(100, v),
            attitude: every(50, v).map(UnitQuaternion::new),
            force_n: every(3, -v),
            torque_n_m: every(1, 0.1 * v),
            // Some samples say how good they are, and some lack a component.
            velocity_quality: Quality {
                std: [0.02 * (j % 3) as f64; 3],
                missing: [j % 40 == 7, false, false],
                repeats: j % 5 == 0,
            },
            position_quality: Quality {
                std: [0.0; 3],
                missing: [j % 200 == 0, j % 200 == 0, false],
                repeats: false,
            },
            ..Sample::default()
        });
    }
    samples
}

/// A checkpoint in the middle of a stream, resumed by an observer with nothing learned, continues with the same bits;
/// the learned numbers alone do not.
#[test]
fn another_observer_goes_on_from_a_checkpoint_to_the_bit() {
    const CHANNELS: [ChannelName; 2] = [ChannelName::Translation, ChannelName::Rotation];
    let samples = varied_samples();
    let mut observer = both();
    feed(&mut observer, &samples[..500]);
    let fixed_attitude = observer.fixed_attitude();
    let saved = CHANNELS.map(|name| {
        let channel = observer.channel_mut(name).unwrap();
        let state = channel.save();
        assert_eq!(state.stamp_ns(), Some(samples[499].stamp_ns));
        let mut learned = vec![0.0; channel.n_learned()];
        learned.chunks_mut(37).enumerate().for_each(|(j, chunk)| channel.read_saved(37 * j, chunk));
        (name, learned, state)
    });
    for with_state in [true, false] {
        let (mut original, mut other) = (observer.clone(), both());
        for (name, learned, state) in &saved {
            other.channel_mut(*name).unwrap().load(learned, with_state.then_some(state));
        }
        if with_state {
            other.set_fixed_attitude(fixed_attitude);
        }
        let same = samples[500..].iter().all(|sample| {
            original.accept(sample, Learn::ALL);
            other.accept(sample, Learn::ALL);
            let later_ns = sample.stamp_ns + PERIOD_NS / 3;
            let texts =
                [&mut original, &mut other].map(|observer| format!("{:?}", observer.estimate(later_ns)));
            texts[0] == texts[1]
        });
        assert_eq!(same, with_state);
    }
}

#[test]
fn an_outlier_is_treated_as_configured() {
    let run = |outliers: OutlierAction, spike: f64| {
        let mut observer = both();
        let channel = observer.channel_mut(ChannelName::Translation).unwrap();
        channel.set_innovation_gate(InnovationGate { outliers, factor: 8.0 });
        let (mut worst, mut n_outliers) = (0.0_f64, 0);
        for j in 0..1000_u64 {
            let v = Vector3::new(0.3 * (0.002 * j as f64).sin(), 0.0, 0.0);
            let error = if j == 700 { spike } else { 0.0 };
            let velocity = Some(Velocity::Inertial(v + Vector3::new(0.0, error, 0.0)));
            let stamp_ns = START_NS + j * PERIOD_NS;
            let sample = Sample { stamp_ns, velocity, ..Sample::default() };
            n_outliers += usize::from(observer.accept(&sample, Learn::ALL)[0]);
            if j >= 700 {
                let estimate = observer.estimate(stamp_ns + PERIOD_NS);
                worst = worst.max((estimate.velocity_m_s - v).norm());
            }
        }
        let norm = observer.estimate(START_NS + 5_000_000_000).translation.unwrap().native_norm;
        (worst, norm, n_outliers)
    };
    let clean = run(OutlierAction::Off, 0.0);
    let accepted = run(OutlierAction::Off, 4.0);
    let corrected = run(OutlierAction::Adaptation, 4.0);
    let held_back = run(OutlierAction::Correction, 4.0);
    assert_eq!((accepted.2, held_back.2), (0, 1));
    // As the spike moves the estimate, the next outputs are outliers, too.
    assert!((2..20).contains(&corrected.2), "{corrected:?}");
    assert_eq!(run(OutlierAction::Correction, 0.0).2, 0);
    assert!(held_back.0 < 1.1 * clean.0 + 1e-3, "{held_back:?} {clean:?}");
    // It corrects: by 1 − e^{−λh} of the spike.
    assert!(corrected.0 > 0.15 && accepted.0 > 0.15, "{corrected:?} {accepted:?}");
    assert!((held_back.1 - clean.1).abs() < 0.05 * clean.1 + 1e-3, "{held_back:?} {clean:?}");
    assert!((accepted.1 - clean.1).abs() > 5.0 * (corrected.1 - clean.1).abs(), "{accepted:?} {corrected:?}");
}

/// The output of a stuck sensor corrects the state, and nothing is learned from it.
#[test]
fn what_does_not_teach_is_not_learned_from() {
    let mut observer = both();
    let learn = Learn { teaches: [false, true, true], ..Learn::ALL };
    for sample in varied_samples() {
        observer.accept(&sample, learn);
    }
    let estimate = observer.estimate(START_NS);
    assert_eq!(estimate.translation.unwrap().native_norm, 0.0);
    assert!(estimate.rotation.unwrap().native_norm > 0.0);
    assert!(estimate.velocity_m_s.norm() > 0.0);
}

#[test]
fn estimates_do_not_depend_on_who_asked_before() {
    let samples = varied_samples();
    let (mut asked, mut silent) = (both(), both());
    for (j, sample) in samples.iter().enumerate() {
        asked.accept(sample, Learn::ALL);
        silent.accept(sample, Learn::ALL);
        let next_ns = samples.get(j + 1).map_or(sample.stamp_ns + 500_000_000, |next| next.stamp_ns);
        // Many requests, also for times after samples that arrive late.
        for k in 0..(j % 7) as u64 {
            asked.estimate(sample.stamp_ns + k * 3_700_000 + (j as u64 * 13) % 1_000_000);
        }
        if j % 97 == 0 {
            asked.estimate(next_ns + 400_000_000);
        }
        if j % 11 == 0 {
            let at_ns = sample.stamp_ns + (next_ns - sample.stamp_ns) * 2 / 3;
            assert_eq!(asked.estimate(at_ns), silent.estimate(at_ns), "sample {j}");
        }
    }
    let last_ns = samples.last().unwrap().stamp_ns;
    assert_eq!(asked.estimate(last_ns + 333_000_000), silent.estimate(last_ns + 333_000_000));
    assert!(silent.estimate(last_ns).translation.unwrap().native_norm > 0.1);
}

/// Between samples the time line is the law's own step, with the true time between the stamps.
#[test]
fn the_time_line_steps_the_law_over_the_true_time() {
    let design = translation([0.0; 3]);
    let mut law = BodyChannel::new(&design.channel).unwrap();
    let initial = InitialState { velocity_m_s: Some(Vector3::zeros()), ..InitialState::default() };
    let mut observer = RigidBodyObserver::new(Some(design.into()), None, initial).unwrap();
    let mut stamp_ns = START_NS;
    for j in 0..500_u64 {
        let y = Vector3::new((j as f64 * 0.01).sin(), 0.5, -0.2);
        let u = Vector3::new(0.0, 1.0, j as f64 * 0.01);
        let velocity = Some(Velocity::Inertial(y));
        observer.accept(&Sample { stamp_ns, velocity, force_n: Some(u), ..Sample::default() }, Learn::ALL);
        let h_ns = 3_000_000 + j % 5 * 1_000_000;
        let v = law.step(&y, &u, h_ns as f64 / 1e9).state.rate;
        stamp_ns += h_ns;
        let estimate = observer.estimate(stamp_ns);
        assert_eq!(estimate.velocity_m_s, v, "sample {j}");
        assert!(!estimate.translation.unwrap().coasting);
    }
}

#[test]
fn a_silent_sensor_means_coasting_from_the_end_of_the_hold() {
    let mut observer =
        RigidBodyObserver::new(Some(translation([0.0, 0.0, 19.62]).into()), None, InitialState::default())
            .unwrap();
    let velocity = Some(Velocity::Inertial(Vector3::new(1.0, 0.0, 0.0)));
    let position_m = Some(Vector3::new(10.0, 20.0, 30.0));
    observer.accept(&Sample { stamp_ns: START_NS, velocity, position_m, ..Sample::default() }, Learn::ALL);
    let hold_end_ns = START_NS + PERIOD_NS * 3 / 2;
    assert!(!observer.estimate(hold_end_ns).translation.unwrap().coasting);
    let start = observer.estimate(hold_end_ns);
    let estimate = observer.estimate(hold_end_ns + 2_000_000_000);
    // Nothing was learned, so it falls freely: 2 kg under 19.62 N for 2 s.
    let fall = Vector3::new(0.0, 0.0, 9.81 * 2.0);
    assert!((estimate.velocity_m_s - start.velocity_m_s - fall).norm() < 1e-9);
    let way = start.velocity_m_s * 2.0 + fall;
    assert!((estimate.position_m - start.position_m - way).norm() < 1e-9);
    let report = estimate.translation.unwrap();
    assert!(report.coasting && report.outside_centers && report.error_bound == f64::INFINITY);
    assert!((report.output_age_s - 2.0075).abs() < 1e-12);
}

/// v' = −v³/4: learned while measured, then used without measurements.
#[test]
fn what_was_learned_makes_coasting_better() {
    let coast_error = |frozen: bool| {
        let mut observer =
            RigidBodyObserver::new(Some(translation([0.0; 3]).into()), None, InitialState::default())
                .unwrap();
        let learn = if frozen { Learn::FROZEN } else { Learn::ALL };
        let (mut v, mut stamp_ns) = (1.5_f64, START_NS);
        let push = |t: f64| 2.0 + (0.8 * t).sin();
        let mut advance = |t: f64| {
            for i in 0..10 {
                v += PERIOD_S / 10.0 * (push(t + i as f64 * PERIOD_S / 10.0) - 0.5 * v.powi(3)) / 2.0;
            }
            v
        };
        for j in 0..8000 {
            let t = j as f64 * PERIOD_S;
            let velocity = Some(Velocity::Inertial(Vector3::new(advance(t), 0.0, 0.0)));
            let force_n = Some(Vector3::new(push(t + PERIOD_S), 0.0, 0.0));
            let velocity = if j < 7800 { velocity } else { None };
            stamp_ns += PERIOD_NS;
            observer.accept(&Sample { stamp_ns, velocity, force_n, ..Sample::default() }, learn);
        }
        (observer.estimate(stamp_ns).velocity_m_s.x - advance(8000.0 * PERIOD_S)).abs()
    };
    let (with, without) = (coast_error(false), coast_error(true));
    assert!(with < without / 4.0, "after 1 s without measurements: {with} with, {without} without");
}

#[test]
fn a_constant_turn_is_integrated_exactly() {
    let mut observer = RigidBodyObserver::new(
        None,
        Some(rotation(GyroscopicTorque::Learned).into()),
        InitialState::default(),
    )
    .unwrap();
    let omega = Vector3::new(0.0, 0.0, 1.5);
    for j in 0..=2000 {
        let stamp_ns = START_NS + j * PERIOD_NS;
        observer.accept(
            &Sample { stamp_ns, angular_velocity_rad_s: Some(omega), ..Sample::default() },
            Learn::ALL,
        );
    }
    let estimate = observer.estimate(START_NS + 2000 * PERIOD_NS);
    let expected = UnitQuaternion::new(omega * 10.0);
    assert!(estimate.attitude.angle_to(&expected) < 1e-10);
    assert!((estimate.attitude.coords.norm() - 1.0).abs() < 1e-14);
    let yaw = 15.0 - 4.0 * std::f64::consts::PI;
    assert!((estimate.euler_rad()[2] - yaw).abs() < 1e-9);
}

/// A torque-free body keeps its rates only if −ω × Iω is accounted for.
#[test]
fn the_gyroscopic_feedforward_coasts_a_torque_free_body() {
    let initial =
        InitialState { angular_velocity_rad_s: Some(Vector3::new(1.0, 0.2, -0.5)), ..Default::default() };
    let mut observer =
        RigidBodyObserver::new(None, Some(rotation(GyroscopicTorque::Feedforward).into()), initial).unwrap();
    let omega = initial.angular_velocity_rad_s.unwrap();
    observer.accept(
        &Sample { stamp_ns: START_NS, angular_velocity_rad_s: Some(omega), ..Sample::default() },
        Learn::ALL,
    );
    let inertia = Vector3::new(0.1, 0.2, 0.3);
    // Euler's equations I ω' = −ω × Iω by RK4.
    let slope = |w: Vector3<f64>| -w.cross(&w.component_mul(&inertia)).component_div(&inertia);
    let (mut expected, h) = (omega, 1e-3);
    for _ in 0..1000 {
        let k1 = slope(expected);
        let k2 = slope(expected + 0.5 * h * k1);
        let k3 = slope(expected + 0.5 * h * k2);
        expected += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(expected + h * k3));
    }
    let estimate = observer.estimate(START_NS + 1_000_000_000);
    assert!((expected - omega).norm() > 0.1, "it tumbles");
    // Euler steps of 5 ms and more: right to first order in the step.
    let error = (estimate.angular_velocity_rad_s - expected).norm();
    assert!(error < 0.02, "{error}");
}

/// A held output, its pending update and the coast after it, against the law's own pieces.
#[test]
fn the_time_line_coasts_on_what_the_last_output_taught() {
    let design = translation([0.0; 3]);
    let mut law = BodyChannel::new(&design.channel).unwrap();
    let initial = InitialState { velocity_m_s: Some(Vector3::zeros()), ..InitialState::default() };
    let mut observer = RigidBodyObserver::new(Some(design.into()), None, initial).unwrap();
    let (y, u) = (Vector3::new(0.5, -0.4, 0.3), Vector3::new(0.1, 0.2, 0.3));
    let sample = Sample {
        stamp_ns: START_NS,
        velocity: Some(Velocity::Inertial(y)),
        force_n: Some(u),
        ..Sample::default()
    };
    observer.accept(&sample, Learn::ALL);

    let mut v = law.step(&y, &u, 1.5 * PERIOD_S).state.rate;
    for _ in 0..20 {
        let force = law.law_mut().matched_force_at(&v, &Learning::none()).value;
        v = law.plant().integrator().coast(&v, &(u + force), PERIOD_S).end;
    }
    let end_ns = START_NS + PERIOD_NS * 3 / 2 + 20 * PERIOD_NS;
    assert!((observer.estimate(end_ns).velocity_m_s - v).norm() < 1e-12);
    assert!(law.law().function().native_norm() > 0.1);
    // The next sample commits just what was learned while the output was held.
    observer.accept(&Sample { stamp_ns: end_ns, ..sample }, Learn::ALL);
    for (ours, theirs) in
        observer.translation().unwrap().function().weights().iter().zip(law.law().function().weights())
    {
        assert!(ours.iter().zip(theirs).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

#[test]
fn fixes_pull_position_and_attitude_exponentially() {
    let initial = InitialState {
        position_m: Some(Vector3::zeros()),
        velocity_m_s: Some(Vector3::zeros()),
        attitude: Some(UnitQuaternion::identity()),
        angular_velocity_rad_s: Some(Vector3::zeros()),
    };
    let turned = UnitQuaternion::new(Vector3::new(0.0, 0.3, 0.0));
    for sign in [1.0, -1.0] {
        let rotation = rotation(GyroscopicTorque::Learned);
        let mut observer =
            RigidBodyObserver::new(Some(translation([0.0; 3]).into()), Some(rotation.into()), initial)
                .unwrap();
        let still = Sample {
            velocity: Some(Velocity::Inertial(Vector3::zeros())),
            angular_velocity_rad_s: Some(Vector3::zeros()),
            ..Sample::default()
        };
        let attitude = Some(UnitQuaternion::new_unchecked(turned.into_inner() * sign));
        let position_m = Some(Vector3::new(8.0, 0.0, 0.0));
        observer.accept(&Sample { stamp_ns: START_NS, attitude, position_m, ..still }, Learn::ALL);
        for j in 1..=200 {
            observer.accept(&Sample { stamp_ns: START_NS + j * PERIOD_NS, ..still }, Learn::ALL);
        }
        let estimate = observer.estimate(START_NS + 200 * PERIOD_NS);
        assert!((estimate.position_m.x - 8.0 * (1.0 - (-0.5_f64).exp())).abs() < 1e-9);
        assert!((estimate.attitude.angle_to(&turned) - 0.3 * (-2.0_f64).exp()).abs() < 1e-9);
    }
}

#[test]
fn a_body_velocity_is_turned_into_the_inertial_frame() {
    let quarter = UnitQuaternion::new(Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
    for rotation in [Some(rotation(GyroscopicTorque::Learned)), None] {
        let mut observer = RigidBodyObserver::new(
            Some(translation([0.0; 3]).into()),
            rotation.map(Into::into),
            InitialState::default(),
        )
        .unwrap();
        observer.accept(
            &Sample {
                stamp_ns: START_NS,
                velocity: Some(Velocity::Body(Vector3::new(2.0, 0.0, 0.0))),
                angular_velocity_rad_s: Some(Vector3::zeros()),
                attitude: Some(quarter),
                ..Sample::default()
            },
            Learn::ALL,
        );
        let velocity = observer.estimate(START_NS).velocity_m_s;
        assert!((velocity - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-12);
    }
}

/// With the joint law, too; the noise is the largest of the axes and that of the direction.
#[test]
fn with_the_joint_law_a_body_velocity_is_turned_and_is_no_surer_than_an_inertial_one() {
    let turn = UnitQuaternion::new(Vector3::new(0.1, -0.2, 1.0));
    let fly = |turned_by: Option<UnitQuaternion<f64>>| {
        let channel = |noise| JointChannelDesign {
            filter: joint_law(noise),
            inertia: Matrix3::identity(),
            hold_s: 0.0075,
        };
        let translation = JointTranslationDesign {
            channel: channel([0.01, 0.02, 0.05]),
            known_force_n: Vector3::zeros(),
            gravity_m_s2: Vector3::zeros(),
        };
        let rotation = JointRotationDesign {
            channel: channel([0.01; 3]),
            gyroscopic_torque: GyroscopicTorque::Learned,
            attitude_noise_rad: 0.01,
            bias_std_rad_s: 0.0,
            bias_walk_rad_s_sqrt_s: 0.0,
        };
        let laws = (TranslationLaw::Joint(translation), RotationLaw::Joint(rotation));
        let mut observer =
            RigidBodyObserver::new(Some(laws.0), Some(laws.1), InitialState::default()).unwrap();
        for j in 0..400 {
            let t_s = j as f64 * PERIOD_NS as f64 / 1e9;
            let velocity = Vector3::new(t_s.sin(), 0.5, (2.0 * t_s).cos());
            let sample = Sample {
                stamp_ns: START_NS + j * PERIOD_NS,
                velocity: Some(match turned_by {
                    Some(turn) => Velocity::Body(turn.inverse() * velocity),
                    None => Velocity::Inertial(velocity),
                }),
                angular_velocity_rad_s: Some(Vector3::zeros()),
                attitude: Some(turn),
                force_n: Some(Vector3::new(t_s.cos(), 0.0, -2.0 * (2.0 * t_s).sin())),
                ..Sample::default()
            };
            observer.accept(&sample, Learn::ALL);
        }
        let end_s = 399.0 * PERIOD_NS as f64 / 1e9;
        let estimate = observer.estimate(START_NS + 399 * PERIOD_NS);
        let error = estimate.velocity_m_s - Vector3::new(end_s.sin(), 0.5, (2.0 * end_s).cos());
        assert!(error.norm() < 0.01, "{error}");
        estimate.deviations.velocity_m_s
    };
    let (inertial, body) = (fly(None), fly(Some(turn)));
    assert!((0..3).all(|axis| body[axis] >= inertial[axis]), "{inertial:?} {body:?}");
}

#[test]
fn a_body_velocity_waits_for_an_attitude() {
    let mut observer = both();
    let sample = Sample {
        stamp_ns: START_NS,
        velocity: Some(Velocity::Body(Vector3::new(2.0, 0.0, 0.0))),
        angular_velocity_rad_s: Some(Vector3::zeros()),
        ..Sample::default()
    };
    observer.accept(&sample, Learn::ALL);
    let before = observer.estimate(START_NS);
    assert!(before.translation.unwrap().coasting && before.velocity_m_s == Vector3::zeros());
    let turned = Some(UnitQuaternion::new(Vector3::new(0.0, 0.0, std::f64::consts::PI)));
    observer.accept(&Sample { stamp_ns: START_NS + PERIOD_NS, attitude: turned, ..sample }, Learn::ALL);
    let after = observer.estimate(START_NS + PERIOD_NS);
    assert!((after.velocity_m_s - Vector3::new(-2.0, 0.0, 0.0)).norm() < 1e-12);
}

/// Ten hours without samples, with some requests: the work is bounded, and a sample still continues from there.
#[test]
fn a_long_silence_costs_little() {
    let samples = varied_samples();
    let mut observer = both();
    feed(&mut observer, &samples[..500]);
    let last_ns = samples[499].stamp_ns;
    let end_ns = last_ns + 36_000 * 1_000_000_000;
    // 0.25 s a step: some 144 000 evaluations in all, not 7 200 000.
    assert!(observer.estimate(end_ns).translation.unwrap().coasting);
    // Asking half a second back finds a point of the trail.
    let late = observer.estimate(end_ns - 400_000_000);
    assert_eq!(late, observer.clone().estimate(end_ns - 400_000_000));
}

#[test]
fn a_restarted_observer_keeps_what_it_learned_and_takes_earlier_stamps() {
    let samples = varied_samples();
    let mut observer = both();
    feed(&mut observer, &samples);
    let learned = observer.translation().unwrap().function().weights().to_vec();
    observer.restart();
    observer.accept(&samples[0], Learn::ALL);
    assert_eq!(observer.translation().unwrap().function().weights(), learned);
    let estimate = observer.estimate(samples[0].stamp_ns);
    assert_eq!(Some(Velocity::Inertial(estimate.velocity_m_s)), samples[0].velocity);
}

#[test]
fn a_reset_observer_is_a_new_one() {
    let samples = varied_samples();
    let mut used = both();
    feed(&mut used, &samples);
    used.reset();
    let mut new = both();
    for sample in &samples[..300] {
        used.accept(sample, Learn::ALL);
        new.accept(sample, Learn::ALL);
    }
    assert_eq!(used.estimate(samples[299].stamp_ns), new.estimate(samples[299].stamp_ns));
}

#[test]
fn a_poisoned_state_comes_back_to_the_checkpoint() {
    let samples = varied_samples();
    let mut observer = both();
    feed(&mut observer, &samples[..800]);
    let saved = save(&mut observer);
    let good = observer.estimate(samples[799].stamp_ns);
    // What the gate would never let through.
    let poison = Vector3::new(f64::NAN, 0.0, 0.0);
    let stamp_ns = samples[800].stamp_ns;
    let velocity = Some(Velocity::Inertial(poison));
    let angular_velocity_rad_s = Some(poison);
    observer.accept(&Sample { stamp_ns, velocity, angular_velocity_rad_s, ..Sample::default() }, Learn::ALL);
    observer.accept(&samples[801], Learn::ALL);
    assert!(observer.estimate(samples[801].stamp_ns).velocity_m_s.x.is_nan());
    for (name, state) in saved {
        observer.channel_mut(name).unwrap().restore(Some(&state));
    }
    let restored = observer.estimate(samples[801].stamp_ns);
    // Coasted from the checkpoint for two samples.
    assert!((restored.velocity_m_s - good.velocity_m_s).norm() < 0.1);
    assert_eq!(restored.translation.unwrap().native_norm, good.translation.unwrap().native_norm);
    observer.accept(&samples[802], Learn::ALL);
    assert!(observer.estimate(samples[802].stamp_ns).velocity_m_s.norm().is_finite());
}

#[test]
fn before_the_first_output_there_is_the_initial_state() {
    let position = Vector3::new(1.0, 2.0, 3.0);
    let mut observer = both();
    assert!(observer.estimate(START_NS).translation.unwrap().coasting);
    observer
        .accept(&Sample { stamp_ns: START_NS, position_m: Some(position), ..Sample::default() }, Learn::ALL);
    let estimate = observer.estimate(START_NS + 5_000_000_000);
    assert_eq!(estimate.position_m, position);
    assert_eq!(estimate.translation.unwrap().output_age_s, f64::INFINITY);
    assert!(RigidBodyObserver::new(None, None, InitialState::default()).is_err());
}
