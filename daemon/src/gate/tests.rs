use super::*;

const NOW_NS: u64 = 1_000_000_000_000;
const PERIOD_NS: u64 = 5_000_000;

fn gate(source: SourcePolicy) -> Gate {
    Gate::new(InputConfig { source, ..InputConfig::default() }, true)
}

fn sample(sequence: u64) -> Measurement {
    Measurement::at(NOW_NS + sequence * PERIOD_NS, sequence).with_velocity_m_s([1.0, 2.0, 3.0])
}

fn judge(gate: &mut Gate, measurement: &Measurement) -> Result<Accepted, Rejection> {
    judge_at(gate, measurement, 1, measurement.stamp_ns)
}

/// Where nothing late is taken.
fn judge_at(gate: &mut Gate, m: &Measurement, source: u128, now_ns: u64) -> Result<Accepted, Rejection> {
    gate.judge(m, source, &gate.in_order(m, now_ns))
}

#[track_caller]
fn assert_accepted(verdict: Result<Accepted, Rejection>, lost_samples: u64, is_new_source: bool) {
    let Accepted { lost, new_source, .. } = verdict.unwrap();
    assert_eq!((lost, new_source), (lost_samples, is_new_source));
}

#[test]
fn a_part_of_a_reading_and_its_noise_are_taken_and_what_makes_no_sense_is_rejected() {
    let limits = InputConfig::default();
    let depth = sample(0).with_position_z_m(-3.0).with_position_std_m([0.0, 0.0, 0.2]);
    let taken = sample_of(&depth, &limits).unwrap();
    assert_eq!(
        taken.position_quality,
        Quality { std: [0.0, 0.0, 0.2], missing: [true, true, false], repeats: false }
    );
    assert_eq!(taken.velocity_quality, Quality::default());

    let noisy = |std| Measurement { velocity_std_m_s: [0.1, std, 0.1], ..sample(0) };
    assert_eq!(sample_of(&noisy(-0.1), &limits), Err(Rejection::BeyondLimits));
    assert_eq!(sample_of(&noisy(f64::NAN), &limits), Err(Rejection::NotFinite));
    let unknown = Measurement { absent: 1 << 20, ..sample(0) };
    assert_eq!(sample_of(&unknown, &limits), Err(Rejection::Malformed));
    let body = Measurement::at(5, 0).with_body_velocity_m_s([1.0, 0.0, 0.0]);
    let of_two_axes = Measurement { absent: absent::VELOCITY_Z, ..body };
    assert_eq!(sample_of(&of_two_axes, &limits).unwrap().velocity_quality.missing, [false, false, true]);
    let force = Measurement::at(5, 0).with_specific_force_m_s2([0.0, 0.0, -9.8]);
    let of_two_axes = Measurement { absent: absent::SPECIFIC_FORCE_Z, ..force };
    assert_eq!(sample_of(&of_two_axes, &limits), Err(Rejection::Malformed));
}

#[test]
fn values_that_cannot_be_are_rejected() {
    let good = Measurement::at(NOW_NS, 0);
    let one = [1.0, 0.0, 0.0];
    let cases = [
        (good.with_velocity_m_s([f64::NAN, 0.0, 0.0]), Rejection::NotFinite),
        (good.with_angular_velocity_rad_s([0.0, f64::INFINITY, 0.0]), Rejection::NotFinite),
        (good.with_position_m([0.0, 0.0, f64::NEG_INFINITY]), Rejection::NotFinite),
        (good.with_attitude_wxyz([f64::NAN, 0.0, 0.0, 0.0]), Rejection::NotFinite),
        (good.with_velocity_m_s(one).with_force_n([f64::NAN; 3]), Rejection::NotFinite),
        (good.with_velocity_m_s(one).with_torque_n_m([f64::NAN; 3]), Rejection::NotFinite),
        (good.with_velocity_m_s([80.0, 80.0, 0.0]), Rejection::BeyondLimits),
        (good.with_angular_velocity_rad_s([0.0, 51.0, 0.0]), Rejection::BeyondLimits),
        (good.with_position_m([2e6, 0.0, 0.0]), Rejection::BeyondLimits),
        (good.with_force_n([2e5, 0.0, 0.0]), Rejection::BeyondLimits),
        (good.with_torque_n_m([2e5, 0.0, 0.0]), Rejection::BeyondLimits),
        (good.with_attitude_wxyz([1.0, 0.1, 0.0, 0.0]), Rejection::QuaternionNorm),
        (good.with_attitude_wxyz([0.0; 4]), Rejection::QuaternionNorm),
        (good, Rejection::Malformed),
        (Measurement { valid: 1 << 20 | valid::VELOCITY, ..good }, Rejection::Malformed),
        (
            Measurement { flags: flags::ON_GROUND | 1 << 7, ..good.with_velocity_m_s(one) },
            Rejection::Malformed,
        ),
        (good.with_on_ground(), Rejection::Malformed),
        (Measurement { velocity_frame: 2, ..good.with_velocity_m_s(one) }, Rejection::Malformed),
    ];
    for (measurement, reason) in cases {
        assert_eq!(judge(&mut gate(SourcePolicy::First), &measurement), Err(reason));
    }
}

/// The order that [`Rejection`] promises.
#[test]
fn of_several_reasons_the_first_one_counts() {
    let mut gate = gate(SourcePolicy::First);
    assert_accepted(judge(&mut gate, &sample(9)), 0, true);
    // Each sample has all faults that follow its own, too.
    let old = Measurement { stamp_ns: NOW_NS, ..sample(9) };
    let tilted = old.with_attitude_wxyz([2.0, 0.0, 0.0, 0.0]);
    let tilted_then_strong = tilted.with_force_n([2e5, 0.0, 0.0]);
    let fast = tilted_then_strong.with_velocity_m_s([200.0, 0.0, 0.0]);
    let not_finite = fast.with_torque_n_m([f64::NAN; 3]);
    let malformed = Measurement { velocity_frame: 7, ..not_finite };
    let later_ns = NOW_NS + 3_600_000_000_000;
    for (measurement, source, now_ns, reason) in [
        (malformed, 2, later_ns, Rejection::Malformed),
        (not_finite, 2, later_ns, Rejection::NotFinite),
        (fast, 2, later_ns, Rejection::BeyondLimits),
        (tilted_then_strong, 2, later_ns, Rejection::QuaternionNorm),
        (old, 2, later_ns, Rejection::TooOld),
        (old, 2, sample(9).stamp_ns, Rejection::OtherSource),
        (old, 1, sample(9).stamp_ns, Rejection::TooLate),
    ] {
        assert_eq!(judge_at(&mut gate, &measurement, source, now_ns), Err(reason));
    }
}

#[test]
fn a_sensor_that_repeats_one_value_is_stuck() {
    let limits = InputConfig { stuck_after_samples: 5, ..InputConfig::default() };
    let mut gate = Gate::new(limits, true);
    let mut stuck = |sequence: u64, change: &dyn Fn(Measurement) -> Measurement| {
        judge(&mut gate, &change(sample(sequence))).unwrap().stuck
    };
    // The sixth of six equal ones; one that is missing in between is no other value.
    (0..5).for_each(|j| assert_eq!(stuck(j, &|m| m), [false; 3], "{j}"));
    assert_eq!(stuck(5, &|m| m), [true, false, false]);
    let without = |m: Measurement| Measurement { valid: valid::OUTPUT, ..m };
    assert_eq!(stuck(6, &without), [false; 3]);
    assert_eq!(stuck(7, &|m| m.with_angular_velocity_rad_s([0.1; 3])), [true, false, false]);
    assert_eq!(stuck(8, &|m| m.with_velocity_m_s([1.0, 2.0, 3.0 + 1e-15])), [false; 3]);
}

#[test]
fn what_is_turned_away_is_not_lost() {
    let mut gate = gate(SourcePolicy::First);
    assert_accepted(judge(&mut gate, &sample(0)), 0, true);
    gate.turn_away(&sample(2), 1, sample(2).stamp_ns);
    gate.turn_away(&sample(3), 1, sample(3).stamp_ns);
    assert_accepted(judge(&mut gate, &sample(4)), 1, false);
}

#[test]
fn a_field_that_is_not_valid_is_not_looked_at() {
    let nan_but_not_valid = Measurement { position_m: [f64::NAN; 3], ..sample(0) };
    assert_accepted(judge(&mut gate(SourcePolicy::First), &nan_but_not_valid), 0, true);
}

#[test]
fn stamps_must_rise_and_lie_near_the_clock() {
    let mut gate = gate(SourcePolicy::First);
    assert_accepted(judge(&mut gate, &sample(5)), 0, true);
    assert_eq!(judge(&mut gate, &sample(5)), Err(Rejection::RepeatedStamp));
    assert_eq!(judge(&mut gate, &Measurement { sequence: 6, ..sample(4) }), Err(Rejection::TooLate));
    let now_ns = sample(6).stamp_ns;
    assert_eq!(judge_at(&mut gate, &sample(6), 1, now_ns - 51_000_000), Err(Rejection::FarFuture));
    assert_eq!(judge_at(&mut gate, &sample(6), 1, now_ns + 501_000_000), Err(Rejection::TooOld));
    assert_accepted(judge_at(&mut gate, &sample(6), 1, now_ns), 0, false);
}

#[test]
fn gaps_are_counted_and_backward_sequences_rejected() {
    let mut gate = gate(SourcePolicy::First);
    assert_accepted(judge(&mut gate, &sample(3)), 0, true);
    assert_accepted(judge(&mut gate, &sample(10)), 6, false);
    assert_eq!(
        judge(&mut gate, &Measurement { sequence: 7, ..sample(11) }),
        Err(Rejection::SequenceBackwards)
    );
    assert_accepted(judge(&mut gate, &sample(12)), 1, false);
}

#[test]
fn a_restart_of_the_source_is_recognised() {
    let mut gate = gate(SourcePolicy::First);
    assert_accepted(judge(&mut gate, &sample(100)), 0, true);
    // In the same process: sequence from 0 again, newer stamp.
    assert_accepted(judge(&mut gate, &Measurement { sequence: 0, ..sample(101) }), 0, true);
    // As another process, after a silence, even if its first samples were missed.
    let later = Measurement { sequence: 7, stamp_ns: sample(101).stamp_ns + 250_000_000, ..sample(0) };
    assert_accepted(judge_at(&mut gate, &later, 2, later.stamp_ns), 0, true);
    assert_eq!(gate.source(), Some(2));
}

#[test]
fn no_damaged_sequence_keeps_the_gate_closed() {
    let mut gate = gate(SourcePolicy::First);
    assert_accepted(judge(&mut gate, &sample(10)), 0, true);
    assert_eq!(
        judge(&mut gate, &Measurement { sequence: u64::MAX, ..sample(11) }),
        Err(Rejection::SequenceBackwards)
    );
    assert_accepted(judge(&mut gate, &sample(12)), 1, false);
    // A restart whose first sample was lost is refused until the silence is long enough.
    for k in 1..=12 {
        let restarted = Measurement { sequence: k, ..sample(12 + k) };
        assert_eq!(judge(&mut gate, &restarted), Err(Rejection::SequenceBackwards));
    }
    let late = Measurement { sequence: 60, ..sample(60) };
    assert_accepted(judge(&mut gate, &late), 47, false);
    let restarted = Measurement { sequence: 41, ..sample(101) };
    assert_accepted(judge(&mut gate, &restarted), 0, true);
}

#[test]
fn under_newest_the_later_source_wins_until_it_is_silent() {
    let mut gate = gate(SourcePolicy::Newest);
    assert_accepted(judge_at(&mut gate, &sample(0), 1, NOW_NS), 0, true);
    assert_accepted(judge_at(&mut gate, &sample(1), 2, NOW_NS), 0, true);
    assert_eq!(judge_at(&mut gate, &sample(2), 1, NOW_NS), Err(Rejection::OtherSource));
    assert_accepted(judge_at(&mut gate, &sample(2), 3, NOW_NS), 0, true);
    assert_eq!(judge_at(&mut gate, &sample(3), 2, NOW_NS), Err(Rejection::OtherSource));
    assert_eq!(judge_at(&mut gate, &sample(3), 1, NOW_NS), Err(Rejection::OtherSource));
    assert_accepted(judge_at(&mut gate, &sample(3), 3, NOW_NS), 0, false);
    let late = sample(50);
    assert_accepted(judge_at(&mut gate, &late, 1, late.stamp_ns), 0, true);
}

#[test]
fn where_samples_are_the_clock_their_stamps_may_run_ahead() {
    let mut gate = Gate::new(InputConfig::default(), false);
    assert_accepted(judge_at(&mut gate, &sample(0), 1, 0), 0, true);
    assert_accepted(judge_at(&mut gate, &sample(1000), 1, 0), 999, false);
    // But not so far that all later ones would look old.
    let ahead = Measurement { stamp_ns: sample(20_000).stamp_ns, ..sample(1001) };
    assert_eq!(judge_at(&mut gate, &ahead, 1, 0), Err(Rejection::FarFuture));
    assert_eq!(
        judge_at(&mut gate, &Measurement { stamp_ns: u64::MAX, ..sample(1002) }, 1, 0),
        Err(Rejection::FarFuture)
    );
    assert_accepted(judge_at(&mut gate, &sample(1003), 1, 0), 0, false);
    // After a silence another replay may begin, earlier or later.
    let accepted = judge_at(&mut gate, &sample(5), 2, 300_000_000).unwrap();
    assert!(accepted.new_source && accepted.new_time);
    assert!(judge_at(&mut gate, &sample(90_000), 2, 600_000_000).unwrap().new_time);
}
