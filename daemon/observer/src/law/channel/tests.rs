use super::*;
use crate::designs::body_channel;
use crate::error::Parameter;
use crate::function::solver::{LocalSolver, Solver};
use crate::law::dead_zone::{DeadZone, DeadZoneShape};
use crate::law::stability::{StepLimit, largest_learning_rate};
use crate::space::centers::Centers;
use crate::space::scaled_kernel::LengthScale;
use nalgebra::{DMatrix, DVector, Matrix3};

fn design() -> ChannelDesign {
    let inertia = Matrix3::new(4.0, 0.5, 0.0, 0.5, 3.0, 0.2, 0.0, 0.2, 5.0);
    let rate = Matrix3::new(80.0, 5.0, 0.0, 5.0, 120.0, 0.0, 0.0, 0.0, 100.0);
    body_channel(inertia, rate, DeadZone::new(DeadZoneShape::Saturated, 0.01, 0.01).unwrap())
}

/// A path through the centers' box, with errors on both sides of the dead zone.
fn output(j: usize) -> Vector3<f64> {
    let t = j as f64 * 0.037;
    Vector3::new(t.sin(), (1.3 * t).cos(), (0.7 * t).sin() * 0.9)
}

/// The paper's law in its own coordinates, α̂' = σ K⁻¹ k (Γ_f ỹ)ᵀ, and in nodal values β = Kα̂, both with
/// nalgebra's LU instead of our factor: three coordinates, one function.
#[test]
fn weights_coefficients_and_nodal_values_are_the_same_law() {
    let design = design();
    let (inertia, rate, zone) = (design.inertia, design.adaptation_rate, design.dead_zone);
    let mut channel = BodyChannel::new(&design).unwrap();
    let gram = channel.law().function().space().gram();
    let gram_lu = gram.clone().lu();
    let mut alpha = DMatrix::<f64>::zeros(27, 3);
    let mut beta = DMatrix::<f64>::zeros(27, 3);
    let mut theirs = Vector3::zeros();
    for j in 0..2000 {
        let h = [0.003, 0.005, 0.007][j % 3];
        let (y, u) = (output(j), Vector3::new(0.3, -0.2, 0.1));
        let mut k = DVector::zeros(27);
        k.copy_from_slice(&channel.law().function().space().kernel_vector(y.as_slice()));
        let y_error: Vector3<f64> = y - theirs;
        let increment = h * zone.activation(y_error.norm()) * rate * y_error;
        alpha += gram_lu.solve(&k).unwrap() * increment.transpose();
        beta += &k * increment.transpose();
        let f_alpha = alpha.tr_mul(&k);
        let f_beta = gram_lu.solve(&beta).unwrap().tr_mul(&k);
        let force = Vector3::from_column_slice((u + &f_alpha).as_slice());
        let decay = (-10.0 * h).exp();
        theirs = decay * theirs + (1.0 - decay) / 10.0 * (10.0 * y + inertia.try_inverse().unwrap() * force);

        let Ahead { matched_force: f_theta, state: ours, .. } = channel.step(&y, &u, h);
        let scale = f_alpha.norm().max(1.0);
        assert!(
            (f_theta.value - Vector3::from_column_slice(f_alpha.as_slice())).norm() < 1e-10 * scale,
            "step {j}"
        );
        assert!((f_beta - f_alpha).norm() < 1e-10 * scale, "step {j}");
        assert!((ours.rate - theirs).norm() < 1e-11, "step {j}");
    }
    let coefficients = channel.law().function().space().coefficients(channel.law().function().weights());
    assert!((&coefficients - &alpha).norm() < 1e-9 * alpha.norm());
    let norm = (alpha.transpose() * gram * &alpha).trace().sqrt();
    assert!((channel.law().function().native_norm() / norm - 1.0).abs() < 1e-10);
    assert!(norm > 1.0, "it learned something: {norm}");
}

/// In the loop, where each estimate depends on all that was learned before: an unmodelled drag.
#[test]
fn the_local_solver_learns_what_the_dense_one_learns() {
    let channel = |solver| {
        let centers = Centers::lattice([-1.5; 3], [1.5; 3], [8, 7, 6]).unwrap();
        BodyChannel::new(&ChannelDesign { centers, solver, ..design() }).unwrap()
    };
    let local = LocalSolver { block: Some(6), ..LocalSolver::default() };
    let mut dense = channel(Solver::Dense);
    let mut local = channel(Solver::Local(local));
    let (mut difference, mut learned, mut estimate) = (0.0_f64, 0.0_f64, 0.0_f64);
    for j in 0..6000 {
        // y moves as it does whatever is estimated; u is the force that this takes, but for a drag.
        let (y, next) = (output(j), output(j + 1));
        let drag = -0.8 * y.norm() * y;
        let input = design().inertia * (next - y) / 0.005 - drag;
        let step = |channel: &mut BodyChannel| channel.step(&y, &input, 0.005).matched_force;
        let (exact, found) = (step(&mut dense), step(&mut local));
        if j > 3000 {
            difference = difference.max((exact.value - found.value).norm());
            learned = learned.max(exact.value.norm());
            estimate = estimate.max(found.error);
        }
    }
    assert!(learned > 1.0, "{learned}");
    assert!(difference < 0.01 * learned, "{difference} of {learned}");
    assert!(difference > 0.0 && estimate > difference, "{difference}, at most {estimate} expected");
}

#[test]
fn an_unstable_adaptation_rate_is_refused_with_the_largest_stable_one() {
    let mut design = ChannelDesign { inertia: Matrix3::identity() * 4.0, ..design() };
    design.adaptation_rate = Matrix3::identity() * 1e7;
    let error = BodyChannel::new(&design).unwrap_err();
    assert_eq!(error.parameter, Parameter::AdaptationRate);
    let largest: f64 = error.needed.split_whitespace().nth(4).unwrap().trim_end_matches(',').parse().unwrap();
    // g h (1 − E)/(λ m) = 2 (1 + E) with g = γ κ(0), by hand.
    let (h, decay) = (0.0075, (-0.075_f64).exp());
    let expected =
        2.0 * (1.0 + decay) * 10.0 * 4.0 / (h * (1.0 - decay)) / (std::f64::consts::PI.powi(2) / 4.0);
    assert!((largest / expected - 1.0).abs() < 1e-4, "{largest} {expected}");
    for (factor, accepted) in [(0.999, true), (1.001, false)] {
        design.adaptation_rate = Matrix3::identity() * (factor * expected);
        assert_eq!(BodyChannel::new(&design).is_ok(), accepted);
    }
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    type Change = fn(&mut ChannelDesign);
    let cases: [(Parameter, Change); 8] = [
        (Parameter::Gain, |d| d.gain_per_s = 0.0),
        (Parameter::Hold, |d| d.hold_s = f64::NAN),
        (Parameter::CoastStep, |d| d.coast_step_s = -1.0),
        (Parameter::NoiseBound, |d| d.bounds.noise = -1.0),
        (Parameter::Inertia, |d| d.inertia[(0, 1)] = 9.0),
        (Parameter::AdaptationRate, |d| d.adaptation_rate[(2, 2)] = -1.0),
        (Parameter::LengthScale, |d| d.length_scale = LengthScale::Isotropic(0.0)),
        (Parameter::Nugget, |d| d.nugget = f64::INFINITY),
    ];
    for (parameter, change) in cases {
        let mut design = design();
        change(&mut design);
        assert_eq!(BodyChannel::new(&design).unwrap_err().parameter, parameter);
    }
}

/// The paper's σ₀ grows with the error without bound: the clamp keeps the sampled law stable.
#[test]
fn a_huge_error_cannot_break_the_sampled_bound() {
    let mut design = design();
    design.dead_zone = DeadZone::new(DeadZoneShape::Quadratic, 0.01, 0.01).unwrap();
    design.adaptation_rate = Matrix3::identity() * 1e4;
    let mut channel = BodyChannel::new(&design).unwrap();
    let (mut clamped, mut largest) = (false, 0.0_f64);
    channel.set_rate(Vector3::new(1e4, 0.0, 0.0));
    let y = Vector3::new(0.1, 0.2, 0.3);
    for _ in 0..20_000 {
        clamped |= channel.step(&y, &Vector3::zeros(), 0.005).learning.clamped;
        largest = largest.max((channel.output_estimate() - y).norm());
    }
    let end = channel.output_estimate();
    assert!(clamped);
    assert!(largest < 2e5 && (end - y).norm() < 0.1, "{largest} {end}");
}

#[test]
fn an_output_that_does_not_teach_corrects_and_leaves_what_was_learned() {
    let mut channel = BodyChannel::new(&design()).unwrap();
    for j in 0..200 {
        channel.step(&output(j), &Vector3::zeros(), 0.005);
    }
    let learned = channel.law().function().weights().to_vec();
    let before = channel.output_estimate();
    channel.observe(&output(200), false);
    let ahead = channel.predict(&Vector3::zeros(), 0.005);
    channel.commit(&ahead.learning, Moment { stamp_ns: 0, state: ahead.state });
    assert_eq!(channel.law().function().weights(), learned);
    assert!(channel.output_estimate() != before);
}

/// A prediction changes nothing: any number of them gives the same bits, and so does the step after them.
#[test]
fn predicting_changes_nothing() {
    let mut channel = BodyChannel::new(&design()).unwrap();
    (0..50).for_each(|j| _ = channel.step(&output(j), &Vector3::zeros(), 0.005));
    let mut other = channel.clone();
    channel.observe(&output(50), true);
    let ahead = channel.predict(&Vector3::x(), 0.004);
    channel.predict(&Vector3::y(), 0.02);
    assert_eq!(channel.predict(&Vector3::x(), 0.004), ahead);
    assert_eq!(other.step(&output(50), &Vector3::x(), 0.004), ahead);
}

const UNLIMITED: StepLimit = StepLimit::OfEveryStep { largest_learning: f64::INFINITY };
const HELD: Vector3<f64> = Vector3::new(0.3, -0.6, 0.8);
const STEPS: usize = 20_000;

#[derive(Clone, Copy, PartialEq)]
enum Order {
    UpdateThenPredict,
    PredictThenUpdate,
}

/// A channel whose run-time clamp is out of the way: σ ≡ 1, `factor` times the adaptation rate at which the
/// bound on the sampled law says that the fastest direction of M⁻¹Γ_f begins to diverge where the output
/// stays at `HELD`.
fn unlimited_channel(
    inertia: Matrix3<f64>,
    rate: Matrix3<f64>,
    (gain_per_s, h_s): (f64, f64),
    factor: f64,
) -> BodyChannel {
    let dead_zone = DeadZone::new(DeadZoneShape::Step, 0.0, 1.0).unwrap();
    let design = ChannelDesign {
        gain_per_s,
        hold_s: h_s,
        coast_step_s: h_s,
        ..body_channel(inertia, 1e-6 * rate, dead_zone)
    };
    let BodyChannel { law, plant, at } = BodyChannel::new(&design).unwrap();
    let power = law.function().space().power_function_at(HELD.as_slice());
    let squared_features = law.function().space().value_at_zero() - power * power;
    // The eigenvalues of M⁻¹Γ_f by LU and Schur, where the library has a Cholesky factor and symmetric ones.
    let learning = inertia.lu().solve(&rate).unwrap().complex_eigenvalues();
    let fastest = learning.iter().map(|eigenvalue| eigenvalue.re).fold(0.0, f64::max);
    let scale = factor * largest_learning_rate(gain_per_s, h_s) / (fastest * squared_features);
    let function = law.function().clone();
    let law = GradientLaw::new(function, dead_zone, scale * rate, UNLIMITED, design.options);
    Channel::of(law, plant, at.state)
}

/// The largest output error in the first and in the last tenth of a run at a frozen output, with nothing to
/// learn. Stops early, with +∞, where it has grown a million times.
fn first_and_last_error(mut channel: BodyChannel, h_s: f64, order: Order) -> (f64, f64) {
    let start = Vector3::new(0.1, 0.1, -0.1);
    channel.set_rate(HELD - start);
    let (mut first, mut last) = (0.0_f64, 0.0_f64);
    for j in 0..STEPS {
        channel.observe(&HELD, true);
        let Channel { law, plant, at } = &mut channel;
        let learning = law.learning(h_s);
        assert!(!learning.clamped && learning.activation == 1.0, "the law itself is on trial");
        let prior = Learning { activation: 1.0, ..Learning::none() };
        let known = if order == Order::UpdateThenPredict { &learning } else { &prior };
        let state = plant.follow(at, &HELD, &law.matched_force(known).value, h_s);
        channel.commit(&learning, Moment { stamp_ns: 0, state });
        let error = (HELD - channel.output_estimate()).norm();
        if error > 1e6 * start.norm() {
            return (first, f64::INFINITY);
        }
        // Rounding would bring ‖ỹ‖ to an exact 0, where a step dead zone of width 0 has σ = 1 all the same.
        first = if j < STEPS / 10 { first.max(error) } else { first };
        last = if j >= STEPS - STEPS / 10 { last.max(error) } else { last };
    }
    (first, last)
}

fn isotropic_and_full() -> [(Matrix3<f64>, Matrix3<f64>); 2] {
    [
        (Matrix3::identity() * 4.0, Matrix3::identity()),
        (
            Matrix3::new(4.0, 1.5, 0.0, 1.5, 3.0, 0.2, 0.0, 0.2, 5.0),
            Matrix3::new(0.8, 0.3, 0.0, 0.3, 1.2, -0.4, 0.0, -0.4, 1.0),
        ),
    ]
}

#[test]
fn one_percent_inside_of_the_sampled_bound_the_law_settles_and_one_percent_outside_it_diverges() {
    for (inertia, rate) in isotropic_and_full() {
        for sampling in [(10.0, 0.005), (4.0, 0.05)] {
            let end = |factor| {
                let channel = unlimited_channel(inertia, rate, sampling, factor);
                first_and_last_error(channel, sampling.1, Order::UpdateThenPredict)
            };
            let (first, last) = end(0.99);
            // The alternating eigenvalue lies near −1 and is not normal to the other: a factor 2/(1 − E) < 50.
            assert!(first < 50.0 && last < 1e-3, "λ, h {sampling:?}: {first} … {last}");
            assert_eq!(end(1.01).1, f64::INFINITY, "λ, h {sampling:?}");
        }
    }
}

/// Predict first, and determinant E + b h g/m of the error's map passes 1 at g h = λ m: 2 (1 + E)/(1 − E) ≈
/// 4/(λh) times earlier, 80 times at λ = 10 1/s and 200 Hz, 400 times at λ = 2 1/s.
#[test]
fn predicting_before_the_update_diverges_at_a_rate_eighty_to_four_hundred_times_lower() {
    let (inertia, rate) = (Matrix3::identity() * 4.0, Matrix3::identity());
    for (gain, ratio) in [(10.0, 80.0), (2.0, 400.0)] {
        let end = |factor, order| {
            first_and_last_error(unlimited_channel(inertia, rate, (gain, 0.005), factor), 0.005, order)
        };
        // The pair of eigenvalues has the modulus 1 ± 0.025 (1 − E): e^{±2.2} in all at least.
        let (first, last) = end(0.95 / ratio, Order::PredictThenUpdate);
        assert!(last < 0.3 * first, "inside: {first} … {last}");
        let (first, last) = end(1.05 / ratio, Order::PredictThenUpdate);
        assert!(last > 3.0 * first, "outside: {first} … {last}");
        let (first, last) = end(1.05 / ratio, Order::UpdateThenPredict);
        assert!(last < 0.3 * first, "update first bears it: {first} … {last}");
    }
}
