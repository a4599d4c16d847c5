use super::*;
use crate::assemble;
use crate::config::ConfigFile;
use shared_types::payload::valid;

const START_NS: u64 = 1_000_000_000_000;
const PERIOD_NS: u64 = 5_000_000;

fn engine_of(preset: &str, change: impl FnOnce(&mut Config)) -> Engine {
    let mut file = ConfigFile::preset(preset).unwrap();
    change(&mut file.config);
    Engine::new(&file.config, assemble::estimator(&file).unwrap())
}

/// With the gradient law, which has learned nothing where its numbers are zero.
fn engine(change: impl FnOnce(&mut Config)) -> Engine {
    engine_of("rigid-body-gradient", change)
}

/// A body that moves gently, pulled by a force along x that is not commanded.
fn tick(engine: &mut Engine, j: u64, late_ticks_in_a_row: u64, unknown_force_n: f64) -> Estimate {
    let (t_s, stamp_ns) = (j as f64 * 0.005, START_NS + j * PERIOD_NS);
    engine.begin(stamp_ns, late_ticks_in_a_row);
    let velocity_m_s = [(0.5 * t_s).sin(), 0.0, 0.01 * (7.0 * t_s).sin()];
    // m = 2 kg, and the preset's gravity.
    let force_n = [(0.5 * t_s).cos() - unknown_force_n, 0.0, -19.62];
    engine.take(&Measurement::at(stamp_ns, j).with_velocity_m_s(velocity_m_s).with_force_n(force_n), 1);
    let estimate = engine.conclude();
    if engine.checkpoint_is_due() {
        engine.save();
    }
    estimate
}

fn force_x_n(estimate: &Estimate) -> f64 {
    estimate.matched_force_n[0]
}

#[test]
fn a_loop_that_is_late_warns_then_predicts_only_then_says_invalid() {
    let mut engine = engine(|config| {
        config.deadline =
            DeadlineConfig { warn_after_ticks: 2, predict_only_after_ticks: 4, invalid_after_ticks: 6 };
    });
    let levels = [status_bits::LATE, status_bits::PREDICT_ONLY, status_bits::INVALID];
    let mut bits = |j: u64, late: u64| {
        let status = tick(&mut engine, j, late, 0.0).status;
        (
            levels.map(|bit| status & bit != 0),
            engine.counters().samples_rejected[Rejection::Overload as usize],
        )
    };
    assert_eq!(bits(0, 1), ([false, false, false], 0));
    assert_eq!(bits(1, 2), ([true, false, false], 0));
    assert_eq!(bits(2, 3), ([true, false, false], 0));
    assert_eq!(bits(3, 4), ([true, true, false], 1));
    assert_eq!(bits(4, 6), ([true, true, true], 2));
    // In time again: samples are used again, and the rejected ones do not count as lost.
    assert_eq!(bits(5, 0), ([false, false, false], 2));
    let counters = engine.counters();
    assert_eq!((counters.samples_accepted, counters.samples_lost), (4, 0));
    assert_eq!((counters.ticks_predict_only, counters.ticks_invalid), (2, 1));
}

/// A channel that diverges returns to the checkpoint; a checkpoint that does not help is dropped with its weights.
#[test]
fn a_divergence_goes_back_to_the_checkpoint_and_a_second_one_begins_anew() {
    let mut engine = engine(|config| config.input.max_unknown_force_n = 8.0);
    let quiet = (0..400).map(|j| tick(&mut engine, j, 0, 1.0)).last().unwrap();
    assert!((force_x_n(&quiet) - 1.0).abs() < 0.5, "{}", force_x_n(&quiet));
    assert_eq!(engine.counters().state_resets, 0);
    // An unknown force of 20 N drives f̂ beyond 8 N: first the channel returns to the checkpoint, then it begins anew.
    let mut after_reset = Vec::new();
    for j in 400..700 {
        let estimate = tick(&mut engine, j, 0, 20.0);
        let force_n = estimate.matched_force_n.map(|f| f * f).iter().sum::<f64>().sqrt();
        assert!(estimate.is_finite() && force_n <= 8.0, "{estimate:?}");
        if estimate.status & status_bits::DIVERGED != 0 {
            after_reset.push(force_x_n(&estimate));
        }
    }
    assert!(after_reset.len() >= 2, "{after_reset:?}");
    assert!((after_reset[0] - 1.0).abs() < 1.5, "the checkpoint: {after_reset:?}");
    assert_eq!(after_reset[1], 0.0, "nothing learned: {after_reset:?}");
    assert!(engine.n_forgotten() > 0);
    // The dropped checkpoint is not used again.
    let mut learned = vec![0.0; engine.n_learned()];
    engine.read_saved(0, &mut learned);
    let largest = learned.iter().fold(0.0_f64, |largest, number| largest.max(number.abs()));
    assert!(largest < 8.0, "{largest}");
}

/// Without a sensor the prediction eventually exceeds its limits; what was learned is kept, and the other channel is not
/// affected.
#[test]
fn a_coast_beyond_the_limits_costs_the_state_and_nothing_else() {
    let mut engine = engine(|config| config.input.max_speed_m_s = 20.0);
    (0..1000).for_each(|j| _ = tick(&mut engine, j, 0, 1.0));
    let learned = |engine: &Engine| {
        let mut learned = vec![0.0; engine.n_learned()];
        engine.read_saved(0, &mut learned);
        learned
    };
    engine.save();
    let before = learned(&engine);
    // The last commanded force is held, and is not what keeps it up.
    engine.begin(START_NS + 1001 * PERIOD_NS, 0);
    let falls = Measurement::at(START_NS + 1001 * PERIOD_NS, 1001).with_force_n([0.0; 3]);
    engine.take(&falls, 1);
    let mut resets = 0;
    for j in 1002..5000 {
        engine.begin(START_NS + j * PERIOD_NS, 0);
        let estimate = engine.conclude();
        let speed = estimate.velocity_m_s.map(|v| v * v).iter().sum::<f64>().sqrt();
        assert!(speed <= 20.0, "{speed}");
        resets += u64::from(estimate.status & status_bits::DIVERGED != 0);
        if engine.checkpoint_is_due() {
            engine.save();
        }
    }
    assert_eq!((resets, engine.counters().state_resets), (1, 1));
    assert_eq!(learned(&engine), before);
    assert_eq!(engine.n_forgotten(), 0);
    // With measurements again, it continues with what it had learned.
    let back = (5000..5010).map(|j| tick(&mut engine, j, 0, 1.0)).last().unwrap();
    assert!((force_x_n(&back) - 1.0).abs() < 0.5 && back.status & status_bits::TRACKING == 0, "{back:?}");
    assert_eq!(back.status & status_bits::COASTING_TRANSLATION, 0);
}

/// With the joint law, too: beyond the limits is never published, a coast costs the state alone, and on the ground nothing
/// is learned.
#[test]
fn the_guards_hold_with_the_joint_law() {
    let force_n = |estimate: &Estimate| estimate.matched_force_n.map(|f| f * f).iter().sum::<f64>().sqrt();
    let mut engine = engine_of("rigid-body", |config| config.input.max_unknown_force_n = 8.0);
    let quiet = (0..400).map(|j| tick(&mut engine, j, 0, 1.0)).last().unwrap();
    assert!((force_x_n(&quiet) - 1.0).abs() < 0.5, "{}", force_x_n(&quiet));
    for j in 400..1500 {
        let estimate = tick(&mut engine, j, 0, 20.0);
        assert!(estimate.is_finite() && force_n(&estimate) <= 8.0, "{estimate:?}");
    }
    assert!(engine.counters().state_resets > 1 && engine.n_forgotten() > 0, "{:?}", engine.counters());

    let mut engine = engine_of("rigid-body", |config| config.input.max_speed_m_s = 20.0);
    (0..1000).for_each(|j| _ = tick(&mut engine, j, 0, 1.0));
    engine.begin(START_NS + 1001 * PERIOD_NS, 0);
    engine.take(&Measurement::at(START_NS + 1001 * PERIOD_NS, 1001).with_force_n([0.0; 3]), 1);
    for j in 1002..5000 {
        engine.begin(START_NS + j * PERIOD_NS, 0);
        let estimate = engine.conclude();
        let speed = estimate.velocity_m_s.map(|v| v * v).iter().sum::<f64>().sqrt();
        assert!(speed <= 20.0, "{speed}");
    }
    assert_eq!((engine.counters().state_resets, engine.n_forgotten()), (1, 0));
    let back = (5000..5010).map(|j| tick(&mut engine, j, 0, 1.0)).last().unwrap();
    assert!((force_x_n(&back) - 1.0).abs() < 0.5, "{back:?}");

    // On the ground, which bears the weight, that force is a disturbance of the moment: without outputs it is soon forgotten.
    let on_the_ground = |is_flagged: bool| {
        let mut engine = engine_of("rigid-body", |_| {});
        let mut last = Estimate::default();
        for j in 0..800 {
            let stamp_ns = START_NS + j * PERIOD_NS;
            engine.begin(stamp_ns, 0);
            let sample = Measurement::at(stamp_ns, j).with_force_n([0.0; 3]);
            let velocity_m_s = [0.0, 0.0, 1e-3 * (7.0 * j as f64).sin()];
            let sample = if j < 400 { sample.with_velocity_m_s(velocity_m_s) } else { sample };
            engine.take(&if is_flagged { sample.with_on_ground() } else { sample }, 1);
            last = engine.conclude();
        }
        force_n(&last)
    };
    let [without, with] = [false, true].map(on_the_ground);
    assert!(without > 5.0 && with < 1e-2, "{without} N without the flag, {with} N with it");
}

/// A state that is diverging is not saved.
#[test]
fn what_is_beyond_half_of_the_limits_is_not_saved() {
    let mut engine = engine(|config| config.input.max_unknown_force_n = 8.0);
    (0..2000).for_each(|j| _ = tick(&mut engine, j, 0, if j < 300 { 1.0 } else { 6.0 }));
    assert_eq!(engine.counters().state_resets, 0);
    assert!(!engine.is_good());
    let mut other = engine.clone();
    let state = engine.saved_state().unwrap();
    let saved_at = (state.estimator.stamp_ns().unwrap() - START_NS) / PERIOD_NS;
    assert!((200..500).contains(&saved_at), "{saved_at}");
    other.carry_out(LoopCommand::Reset);
    let mut learned = vec![f64::NAN; other.n_learned()];
    other.read_saved(0, &mut learned);
    assert!(learned.iter().all(|number| *number == 0.0), "it is forgotten in the checkpoint, too");
}

#[test]
fn the_checkpoint_is_frozen_as_the_newest_command_says() {
    let mut engine = engine(|_| {});
    for (commands, frozen) in [
        ([LoopCommand::Reset, LoopCommand::Freeze], true),
        ([LoopCommand::Freeze, LoopCommand::Reset], true),
        ([LoopCommand::Freeze, LoopCommand::Thaw], false),
    ] {
        commands.into_iter().for_each(|command| engine.carry_out(command));
        let state = engine.saved_state();
        assert_eq!(state.map(|state| state.frozen), Some(frozen), "{commands:?}");
        let mut other = engine.clone();
        other.load(&Checkpoint { learned: vec![0.0; engine.n_learned()], state }).unwrap();
        assert_eq!(other.frozen(), frozen);
    }
}

#[test]
fn each_channel_is_stale_by_the_age_of_its_own_output() {
    use status_bits::{STALE, STALE_LINEAR, STALE_ROTATION, STALE_TRANSLATION, WAITING};
    let mut engine = engine(|config| config.stale_after_s = 0.5);
    let mut status_at = |j: u64, fields: u32| {
        let stamp_ns = START_NS + j * PERIOD_NS;
        engine.begin(stamp_ns, 0);
        let whole = Measurement::at(stamp_ns, j)
            .with_velocity_m_s([1.0, 0.0, 0.01 * j as f64])
            .with_angular_velocity_rad_s([0.0, 0.0, 0.001 * j as f64]);
        if fields != 0 {
            engine.take(&Measurement { valid: fields, ..whole }, 1);
        }
        let estimate = engine.conclude();
        let bits = STALE | STALE_TRANSLATION | STALE_ROTATION | STALE_LINEAR | WAITING;
        (estimate.status & bits, engine.output_ages_ns(&estimate))
    };
    let both = valid::VELOCITY | valid::ANGULAR_VELOCITY;
    assert_eq!(status_at(0, 0), (STALE | STALE_TRANSLATION | STALE_ROTATION | WAITING, [None; 3]));
    // The rotation has no output yet.
    assert_eq!(status_at(1, valid::VELOCITY), (STALE | STALE_ROTATION, [Some(0), None, None]));
    assert_eq!(status_at(2, both), (0, [Some(0), Some(0), None]));
    // 0.5 s later it is as old as it may be, and a tick later older.
    for j in 3..=102 {
        assert_eq!(status_at(j, valid::VELOCITY).0, 0, "{j}");
    }
    let rotation_is_stale = (STALE | STALE_ROTATION, [Some(0), Some(101 * PERIOD_NS), None]);
    assert_eq!(status_at(103, valid::VELOCITY), rotation_is_stale);
    assert_eq!(status_at(104, both).0, 0);
    let silent = status_at(205, 0);
    assert_eq!(silent.0, STALE | STALE_TRANSLATION | STALE_ROTATION);
}

#[test]
fn on_the_ground_nothing_is_learned_until_a_sample_says_otherwise() {
    let learned = |engine: &mut Engine| {
        engine.save();
        let mut learned = vec![0.0; engine.n_learned()];
        engine.read_saved(0, &mut learned);
        learned
    };
    // The ground bears a weight that is not commanded away.
    let stand = |engine: &mut Engine, j: u64, is_on_ground: bool| {
        let stamp_ns = START_NS + j * PERIOD_NS;
        engine.begin(stamp_ns, 0);
        let sample = Measurement::at(stamp_ns, j)
            .with_velocity_m_s([0.0, 0.0, 1e-3 * (7.0 * j as f64).sin()])
            .with_force_n([0.0; 3]);
        engine.take(&if is_on_ground { sample.with_on_ground() } else { sample }, 1);
        engine.conclude()
    };
    let mut engine = engine(|_| {});
    for j in 0..200 {
        let estimate = stand(&mut engine, j, true);
        assert_ne!(estimate.status & status_bits::ON_GROUND, 0);
        assert_eq!(estimate.status & status_bits::FROZEN, 0);
    }
    assert!(learned(&mut engine).iter().all(|number| *number == 0.0));

    // Another engine goes on from it to the bit, still on the ground: a tick without a sample shows it.
    let mut other = self::engine(|_| {});
    let checkpoint = Checkpoint { learned: learned(&mut engine), state: engine.saved_state() };
    other.load(&checkpoint).unwrap();
    for engine in [&mut engine, &mut other] {
        engine.begin(START_NS + 200 * PERIOD_NS, 0);
    }
    let (before, after) = (engine.conclude(), other.conclude());
    assert_ne!(after.status & status_bits::ON_GROUND, 0);
    assert_eq!(Estimate { sequence: before.sequence, ..after }, before);

    for j in 201..400 {
        assert_eq!(stand(&mut engine, j, false).status & status_bits::ON_GROUND, 0);
    }
    assert!(learned(&mut engine).iter().any(|number| *number != 0.0));
    stand(&mut engine, 400, true);
    engine.carry_out(LoopCommand::Reset);
    engine.begin(START_NS + 401 * PERIOD_NS, 0);
    assert_eq!(engine.conclude().status & status_bits::ON_GROUND, 0, "it is forgotten with the state");
}

#[test]
fn a_channel_that_reacquires_is_not_tracking_and_deviations_and_nis_are_published() {
    let mut engine = engine(|_| {});
    (0..10).for_each(|j| _ = tick(&mut engine, j, 0, 0.0));
    let mut state = engine.estimator.estimate(START_NS + 9 * PERIOD_NS);
    let body = state.rigid_body.as_mut().unwrap();
    for report in [&mut body.translation, &mut body.rotation].into_iter().flatten() {
        report.coasting = false;
    }
    let bits = status_bits::TRACKING | status_bits::REACQUIRING;
    assert_eq!(engine.status_of(&state, Some(0)) & bits, status_bits::TRACKING);
    let unknown = to_payload(&state);
    assert!(unknown.velocity_std_m_s == [f64::INFINITY; 3] && unknown.is_finite());

    let body = state.rigid_body.as_mut().unwrap();
    body.deviations = Deviations {
        position_m: [1.0, 2.0, 3.0],
        velocity_m_s: [4.0, 5.0, 6.0],
        attitude_rad: [7.0, 8.0, 9.0],
        angular_velocity_rad_s: [10.0, 11.0, 12.0],
        matched_force_n: [13.0, 14.0, 15.0],
        matched_torque_n_m: [16.0, 17.0, 18.0],
    };
    let rotation = body.rotation.as_mut().unwrap();
    (rotation.reacquiring, rotation.nis) = (true, 1.25);
    assert_eq!(engine.status_of(&state, Some(0)) & bits, status_bits::REACQUIRING);
    let estimate = to_payload(&state);
    assert_eq!(estimate.position_std_m, [1.0, 2.0, 3.0]);
    assert_eq!(estimate.velocity_std_m_s, [4.0, 5.0, 6.0]);
    assert_eq!(estimate.attitude_std_rad, [7.0, 8.0, 9.0]);
    assert_eq!(estimate.angular_velocity_std_rad_s, [10.0, 11.0, 12.0]);
    assert_eq!(estimate.matched_force_std_n, [13.0, 14.0, 15.0]);
    assert_eq!(estimate.matched_torque_std_n_m, [16.0, 17.0, 18.0]);
    assert_eq!(estimate.channels().map(|channel| channel.nis), [0.0, 1.25, 0.0]);
}

#[test]
fn numbers_that_are_no_learned_ones_are_refused() {
    let mut engine = engine(|_| {});
    let n = engine.n_learned();
    let refused = |learned: Vec<f64>| engine.clone().load(&Checkpoint { learned, state: None }).unwrap_err();
    assert!(refused(vec![0.0; n + 1]).contains(&format!("needed: {n}")));
    assert!(refused(vec![f64::NAN; n]).contains("finite"));
    engine.load(&Checkpoint { learned: vec![0.0; n], state: None }).unwrap();
}
