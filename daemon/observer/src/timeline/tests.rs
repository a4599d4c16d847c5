use super::*;
use crate::design::{ChannelDesign, DisturbanceBounds, FeaturePoint, GradientOptions};
use crate::designs::{body_channel, oscillator};
use crate::law::dead_zone::{DeadZone, DeadZoneShape};
use crate::linear_observer::LinearObserver;
use crate::plant::body::{Body, KnownForce};
use crate::plant::linear::LinearOutput;
use crate::plant::position::Position;
use crate::{AnyChannel, Learn};
use nalgebra::{Matrix3, Vector3};

const PERIOD_NS: u64 = 5_000_000;
const PERIOD_S: f64 = 0.005;
const START_NS: u64 = 3_000_000_000;

type Body3 = Timeline<Body<Position>, 3>;

fn design() -> ChannelDesign {
    let dead_zone = DeadZone::new(DeadZoneShape::Saturated, 1e-3, 1e-3).unwrap();
    body_channel(Matrix3::identity() * 4.0, Matrix3::identity() * 100.0, dead_zone)
}

fn timeline(design: &ChannelDesign) -> Body3 {
    let pose = Position::new(Some(Vector3::zeros()), 0.0, 0.0);
    let channel = Channel::of_body(design, KnownForce::Constant(Vector3::zeros()), None, pose).unwrap();
    let certificate = Certificate::of_channel(design, channel.law().function().space());
    Timeline::new(channel, Some(certificate), (design.hold_s, design.coast_step_s))
}

/// An output at a multiple of the period; the command balances the force that acts.
fn accept(timeline: &mut Body3, j: u64, output: Option<Vector3<f64>>) {
    let measured = output.map(|output| Measured { output, teaches: true });
    timeline.accept(START_NS + j * PERIOD_NS, measured, Some(Vector3::zeros()), false, |_| {});
}

/// An unknown force of 2 N along x acts on 4 kg, from rest.
fn pushed(j: u64) -> Vector3<f64> {
    Vector3::new(0.5 * j as f64 * PERIOD_S, 0.0, 0.0)
}

fn weights(timeline: &Body3) -> Vec<Vec<f64>> {
    timeline.channel().law().function().weights().to_vec()
}

fn rate(timeline: &Body3) -> Vector3<f64> {
    timeline.channel().state().rate
}

/// What f̂ has become at the held output.
fn force(timeline: &mut Body3, j: u64) -> f64 {
    timeline.predict(START_NS + j * PERIOD_NS).matched_force.value.norm()
}

#[test]
fn after_an_outage_the_state_begins_again_at_the_output_and_learns_nothing_from_it() {
    let mut timeline = timeline(&design());
    (0..200).for_each(|j| accept(&mut timeline, j, Some(pushed(j))));
    let end = 400;
    let ahead = timeline.predict(START_NS + end * PERIOD_NS).moment.state;
    // A gust has blown during the outage: 0.7 m/s that no force at this speed explains.
    let output = pushed(end) + Vector3::new(0.0, 0.7, 0.0);
    accept(&mut timeline, end, Some(output));
    assert_eq!(rate(&timeline), output);
    assert_eq!(timeline.channel().state().pose, ahead.pose);
    let learned = weights(&timeline);
    accept(&mut timeline, end + 1, Some(output));
    assert_eq!(weights(&timeline), learned, "what the output after the outage taught");
    // What follows teaches again, and there is no gust's worth to learn.
    let before = force(&mut timeline, end + 1);
    (end + 2..end + 20).for_each(|j| accept(&mut timeline, j, Some(output)));
    assert!(weights(&timeline) != learned);
    let after = force(&mut timeline, end + 19);
    assert!((after - before).abs() < 2.1, "of 2 N that act no more: {before} {after}");
}

#[test]
fn after_one_lost_output_the_state_follows_the_next_which_teaches_nothing() {
    let mut timeline = timeline(&design());
    (0..200).for_each(|j| accept(&mut timeline, j, Some(pushed(j))));
    accept(&mut timeline, 201, Some(pushed(201) + Vector3::new(0.0, 0.1, 0.0)));
    assert!((rate(&timeline) - pushed(201)).norm() < 0.05, "not the output with its noise");
    let learned = weights(&timeline);
    accept(&mut timeline, 202, Some(pushed(202)));
    assert_eq!(weights(&timeline), learned);
    accept(&mut timeline, 203, Some(pushed(203)));
    assert!(weights(&timeline) != learned);
}

/// Every output of a sensor that is slower than the hold comes after a coast; that is its rhythm.
#[test]
fn a_sensor_slower_than_the_hold_is_followed_and_learned_from() {
    for every in [2, 4, 10, 40] {
        let mut timeline = timeline(&design());
        let mut follows = 0;
        for j in (0..4000).step_by(every) {
            let output = Vector3::new(0.3 * (0.002 * j as f64).sin(), 0.0, 0.0);
            accept(&mut timeline, j, Some(output));
            follows += usize::from(rate(&timeline) != output);
        }
        // The first starts, the second may seem to come after an outage.
        assert!(follows >= 4000 / every - 2, "{every}: {follows}");
        assert!(timeline.channel().law().function().native_norm() > 0.01, "{every}");
    }
}

/// A sensor that is heard and not believed is no sensor that is silent.
#[test]
fn rejected_outputs_are_no_outage() {
    let mut timeline = timeline(&design());
    timeline.set_innovation_gate(InnovationGate { outliers: OutlierAction::Correction, factor: 8.0 });
    let mut is_rejected = false;
    for j in 0..400 {
        // Spikes to both sides, which do not agree.
        let spike = if j >= 200 { 3.0 * (-1.0_f64).powi(j as i32) } else { 0.0 };
        let output = Vector3::new(0.3 * (0.01 * j as f64).sin(), spike, 0.0);
        accept(&mut timeline, j, Some(output));
        is_rejected |= timeline.predict(START_NS + j * PERIOD_NS).coasting;
        assert!(j == 0 || rate(&timeline) != output, "{j}");
    }
    assert!(is_rejected);
}

/// Features at C x̂, an outage, and a checkpoint at each kind of place: the same bits after it.
#[test]
fn a_checkpoint_continues_to_the_bit_within_an_outage_and_with_features_at_the_estimate() {
    for feature_point in [FeaturePoint::Measured, FeaturePoint::Estimated] {
        let options = GradientOptions { feature_point, max_norm: Some(0.6) };
        let design = ChannelDesign { options, ..design() };
        let output = |j: u64| {
            let t = j as f64 * PERIOD_S;
            let is_there = !(300..420).contains(&j) && j % 7 != 3;
            is_there.then(|| Vector3::new(t.sin(), (0.7 * t).cos(), 0.3 * (2.0 * t).sin()))
        };
        for at in [150, 290, 303, 310, 420, 421] {
            let (mut original, mut other) = (timeline(&design), timeline(&design));
            (0..=at).for_each(|j| accept(&mut original, j, output(j)));
            let state = original.save();
            let mut learned = vec![0.0; original.n_learned()];
            original.read_saved(0, &mut learned);
            other.load(&learned, Some(&state));
            for j in at + 1..600 {
                for timeline in [&mut original, &mut other] {
                    // In the outage there are commands only, and not at every period.
                    if output(j).is_some() || j % 3 == 0 {
                        accept(timeline, j, output(j));
                    }
                }
                let to_ns = START_NS + j * PERIOD_NS + 1_234_567;
                let [a, b] = [&mut original, &mut other].map(|timeline| {
                    let at = timeline.predict(to_ns);
                    format!("{at:?} {:?}", timeline.report(&at, to_ns))
                });
                assert_eq!(a, b, "{feature_point:?}, checkpoint at {at}, sample {j}");
            }
            assert!(original.channel().law().function().native_norm() <= 0.6 * (1.0 + 1e-12));
        }
    }
}

/// Put back at its checkpoint, a channel coasts to the present and begins again at the next output.
#[test]
fn after_a_fallback_the_next_output_begins_again() {
    let mut timeline = timeline(&design());
    (0..100).for_each(|j| accept(&mut timeline, j, Some(pushed(j))));
    let state = timeline.save();
    (100..104).for_each(|j| accept(&mut timeline, j, Some(pushed(j))));
    timeline.restore(Some(&state));
    let output = pushed(104) + Vector3::new(0.0, 0.2, 0.0);
    accept(&mut timeline, 104, Some(output));
    assert_eq!(rate(&timeline), output);
    assert_eq!(timeline.channel().law().held().activation, 0.0);
}

/// A linear plant keeps what the output does not show: the state moves by the least that gives C x̂ = y.
#[test]
fn a_linear_plant_begins_again_with_the_least_change_of_its_state() {
    let mut observer = LinearObserver::new(&oscillator()).unwrap();
    let mut output = LinearOutput::zeros();
    for j in 0..200 {
        output[0] = 1.0 + 0.2 * (0.02 * j as f64).sin();
        observer.accept(j * PERIOD_NS, Some(output), Some(LinearOutput::zeros()), Learn::ALL);
    }
    let stamp_ns = 500 * PERIOD_NS;
    let before = observer.estimate(stamp_ns).state;
    output[0] = 2.0;
    observer.accept(stamp_ns, Some(output), None, Learn::ALL);
    let after = observer.estimate(stamp_ns).state;
    // C = (2, 1).
    assert!((2.0 * after[0] + after[1] - 2.0).abs() < 1e-12);
    let change = after - before;
    assert!((change[0] - 2.0 * change[1]).abs() < 1e-12 && change.norm() > 0.1, "{change}");
}

/// d > d_N and a small ỹ: claimed. Not while coasting, not after a large ỹ, not with a narrow dead zone.
#[test]
fn an_error_bound_is_claimed_where_the_held_output_confirms_it() {
    let report = |width: f64, last_error: f64, later_ns: u64| {
        let dead_zone = DeadZone::new(DeadZoneShape::Saturated, width, 0.01).unwrap();
        let bounds = DisturbanceBounds { noise: 0.01, ..DisturbanceBounds::default() };
        let mut timeline = timeline(&ChannelDesign { dead_zone, bounds, ..design() });
        (0..100).for_each(|j| accept(&mut timeline, j, Some(Vector3::zeros())));
        accept(&mut timeline, 100, Some(Vector3::new(0.0, last_error, 0.0)));
        let to_ns = START_NS + 100 * PERIOD_NS + later_ns;
        let at = timeline.predict(to_ns);
        timeline.report(&at, to_ns).error_bound
    };
    assert_eq!(report(0.03, 0.0, 0), 0.03);
    assert_eq!(report(0.03, 0.015, 3_000_000), 0.03);
    assert_eq!(report(0.03, 0.025, 0), f64::INFINITY);
    assert_eq!(report(0.03, 0.0, 20_000_000), f64::INFINITY);
    assert_eq!(report(0.009, 0.0, 0), f64::INFINITY);
}
