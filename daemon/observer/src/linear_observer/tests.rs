use super::*;
use crate::design::DisturbanceBounds;
use crate::designs::{Random, matrix, oscillator};
use crate::law::dead_zone::{DeadZone, DeadZoneShape};
use crate::law::linear_stability::largest_gain;
use crate::plant::linear::{MAX_STATES, held_integral};
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use nalgebra::{DMatrix, DVector};

/// The oscillator driven by u, with the unknown force −0.8 y |y|, by RK4 with small steps.
fn run(
    (observer, learn): (&mut LinearObserver, Learn),
    n: u64,
    measured: impl Fn(u64) -> bool,
) -> (LinearEstimate, DVector<f64>, f64) {
    let design = oscillator();
    let (h, substeps) = (0.005, 10);
    let force = |y: f64| -0.8 * y * y.abs();
    let mut x = DVector::from_vec(vec![0.5, 0.0]);
    for j in 0..n {
        let u = 4.0 * (0.9 * j as f64 * h).sin() + 2.0 * (2.3 * j as f64 * h).cos();
        let y = (&design.c * &x)[0];
        let output = measured(j).then(|| LinearOutput::from_fn(|i, _| if i == 0 { y } else { 0.0 }));
        let input = LinearOutput::from_fn(|i, _| if i == 0 { u } else { 0.0 });
        observer.accept(j * 5_000_000, output, Some(input), learn);
        let slope = |x: &DVector<f64>| &design.a * x + &design.b * (u + force((&design.c * x)[0]));
        let dt = h / f64::from(substeps);
        for _ in 0..substeps {
            let k1 = slope(&x);
            let k2 = slope(&(&x + 0.5 * dt * &k1));
            let k3 = slope(&(&x + 0.5 * dt * &k2));
            let k4 = slope(&(&x + dt * &k3));
            x += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
    }
    let y = (&design.c * &x)[0];
    (observer.estimate(n * 5_000_000), x, force(y))
}

#[test]
fn the_force_on_an_oscillator_is_learned_and_carries_it_through_an_outage() {
    let coast_error = |frozen: bool| {
        let mut observer = LinearObserver::new(&oscillator()).unwrap();
        let learn = if frozen { Learn::FROZEN } else { Learn::ALL };
        // A minute of measurements, then half a second without.
        let (estimate, truth, _) = run((&mut observer, learn), 12_100, |j| j < 12_000);
        assert!(estimate.report.coasting);
        (estimate.state.fixed_rows::<2>(0) - truth.fixed_rows::<2>(0)).norm()
    };
    let (with, without) = (coast_error(false), coast_error(true));
    assert!(with < 0.3 * without, "{with} with, {without} without learning");

    let mut observer = LinearObserver::new(&oscillator()).unwrap();
    let (estimate, truth, force) = run((&mut observer, Learn::ALL), 12_000, |_| true);
    assert!((estimate.state[0] - truth[0]).abs() < 5e-3 && (estimate.state[1] - truth[1]).abs() < 2e-2);
    assert!((estimate.matched_input[0] - force).abs() < 0.1, "{} {force}", estimate.matched_input[0]);
    assert!(estimate.state.iter().skip(2).all(|&x| x == 0.0));
}

/// The clamp and the refusal rest on the spectral radius of the frozen-output map; for a plant that is a
/// channel of the rigid body the closed form says the same.
#[test]
fn the_bound_of_a_channel_is_the_closed_form() {
    let (mass, gain, rate, h) = (4.0, 10.0, 100.0, 0.0075);
    let identity = DMatrix::<f64>::identity(3, 3);
    let design = LinearDesign {
        a: DMatrix::zeros(3, 3),
        b: &identity / mass,
        c: identity.clone(),
        gain: gain * &identity,
        adaptation_rate: rate * &identity,
        centers: Centers::lattice([-1.0; 3], [1.0; 3], [2; 3]).unwrap(),
        hold_s: h,
        initial_state: None,
        ..oscillator()
    };
    for h in [h, 0.1, 1.0] {
        let closed = crate::law::stability::largest_learning_rate(gain, h) * h * mass / rate;
        assert!(
            (largest_gain(&design.observable_part(), &design.adaptation_rate, h) / closed - 1.0).abs() < 1e-6,
            "h {h}"
        );
    }
}

/// The bound of the law itself, with its clamp out of the way: the oscillator at rest at y = 0, σ ≡ 1,
/// nothing to learn.
#[test]
fn one_percent_inside_of_the_general_bound_the_law_settles_and_one_percent_outside_it_diverges() {
    let unlimited = StepLimit::OfEveryStep { largest_learning: f64::INFINITY };
    let dead_zone = DeadZone::new(DeadZoneShape::Step, 0.0, 1.0).unwrap();
    let design = oscillator();
    let function = design.function().unwrap();
    let space = function.space();
    let squared_features = space.value_at_zero() - space.power_function_at(&[0.0]).powi(2);
    let (at_rest, no_input) = (LinearOutput::zeros(), LinearOutput::zeros());
    let last_error = |h_s: f64, factor: f64| {
        let scale = factor * largest_gain(&design.observable_part(), &design.adaptation_rate, h_s)
            / (h_s * squared_features);
        let rate = padded(&(scale * &design.adaptation_rate));
        let law = GradientLaw::new(function.clone(), dead_zone, rate, unlimited, design.options);
        let matrices = (&design.a, &design.b, &design.c, &design.gain);
        let start = padded::<MAX_STATES, 1>(&matrix(2, &[0.1, -0.2]));
        let mut channel = Channel::of(law, LinearPlant::new(matrices, None), start);
        let mut last = 0.0_f64;
        for j in 0..20_000 {
            let ahead = channel.step(&at_rest, &no_input, h_s);
            assert!(!ahead.learning.clamped && ahead.learning.activation == 1.0);
            let state = ahead.state;
            if state.norm() > 1e6 {
                return f64::INFINITY;
            }
            last = if j >= 18_000 { last.max(state.norm()) } else { last };
        }
        last
    };
    for h_s in [0.005, 0.05] {
        let inside = last_error(h_s, 0.99);
        assert!(inside < 1e-3, "h {h_s}: {inside}");
        assert_eq!(last_error(h_s, 1.01), f64::INFINITY, "h {h_s}");
    }
}

/// e' = A_e e − Lδ + ξ of random strictly positive real plants, exact for held δ and ξ: switched at random,
/// and always to where V grows most. With f̃ = 0, V falls outside of the ball of radius E₀, hence ‖e‖ ≤
/// √cond(P) E₀ in the end; the ball itself is no level set of V.
#[test]
fn noise_and_disturbances_within_their_bounds_keep_the_error_within_e0_times_the_root_of_the_condition_of_p()
{
    let mut random = Random(1);
    let (noise_bound, unmatched_bound, h_s) = (0.02, 0.03, 2e-3);
    let (mut closest, mut beyond_e0) = (0.0_f64, 0.0_f64);
    for case in 0..48 {
        let (n, m) = ([2, 3, 4][case % 3], [1, 1, 2, 2][case % 4]);
        let (p, q) = (random.positive(n, 0.2), random.positive(n, 0.2));
        let (skew, b, gain) = (random.matrix(n, n), random.matrix(n, m), random.matrix(n, m));
        let skew = 2.0 * (&skew - skew.transpose());
        let c = b.tr_mul(&p);
        let a_e = p.clone().try_inverse().unwrap() * (skew - 0.5 * q);
        let design = LinearDesign {
            a: &a_e + &gain * &c,
            b,
            c,
            gain,
            kernel: Kernel::Gaussian,
            centers: Centers::lattice(vec![-1.0; m], vec![1.0; m], vec![2; m]).unwrap(),
            adaptation_rate: 1e-3 * DMatrix::identity(m, m),
            bounds: DisturbanceBounds { noise: noise_bound, unmatched: unmatched_bound, residual_norm: 0.0 },
            initial_state: None,
            ..oscillator()
        };
        let e0 = LinearObserver::new(&design).unwrap().channel().certificate().unwrap().e0();
        let pair = design.observable_part().lure_pair().unwrap();
        let spread = pair.p.clone().symmetric_eigenvalues();
        let bound = (spread.max() / spread.min()).sqrt() * e0;
        let integral = held_integral(&padded(&a_e), n, h_s).view((0, 0), (n, n)).into_owned();
        let integral = DMatrix::from_fn(n, n, |i, j| integral[(i, j)]);
        let settle_s = 12.0 / -spectral_abscissa(&a_e);
        for greedy in [false, true] {
            let unit = |x: DVector<f64>| if x.norm() > 0.0 { x.normalize() } else { x };
            let mut error = DVector::from_element(n, 1e-6);
            let (mut noise, mut unmatched) = (DVector::zeros(m), DVector::zeros(n));
            let mut largest = 0.0_f64;
            for j in 0..(2.0 * settle_s / h_s) as usize {
                if greedy {
                    noise = -noise_bound * unit(design.gain.tr_mul(&(&pair.p * &error)));
                    unmatched = unmatched_bound * unit(&pair.p * &error);
                } else if random.next() > 0.99 {
                    noise = noise_bound * unit(DVector::from_fn(m, |_, _| random.next()));
                    unmatched = unmatched_bound * unit(DVector::from_fn(n, |_, _| random.next()));
                }
                error += &integral * (&a_e * &error - &design.gain * &noise + &unmatched);
                if j as f64 * h_s > settle_s {
                    largest = largest.max(error.norm());
                }
            }
            assert!(largest <= bound, "case {case}: {largest} {bound}");
            closest = closest.max(largest / bound);
            beyond_e0 = beyond_e0.max(largest / e0);
        }
    }
    println!("‖e‖ up to {closest:.3} of √cond(P) E₀ and {beyond_e0:.3} of E₀");
    assert!(closest > 0.2, "bounds that nothing comes near prove little: {closest}");
}

#[test]
fn designs_that_cannot_work_are_refused_by_name() {
    type Change = fn(&mut LinearDesign);
    let cases: [(Parameter, Change); 13] = [
        (Parameter::Plant, |d| d.a = matrix(1, &[0.0, 1.0])),
        (Parameter::Plant, |d| d.a[(0, 0)] = -1e308),
        (Parameter::PlantInput, |d| d.b = matrix(2, &[0.0, 0.0])),
        (Parameter::PlantInput, |d| d.b = DMatrix::zeros(1, 1)),
        (Parameter::PlantOutput, |d| d.c = matrix(2, &[0.0, 1.0, 1.0, 0.0])),
        (Parameter::PlantOutput, |d| d.c = matrix(1, &[0.0, 0.0])),
        // An unstable mode that the output does not see.
        (Parameter::PlantOutput, |d| {
            d.a = matrix(2, &[5.0, 0.0, 0.0, -1.0]);
            d.c = matrix(1, &[0.0, 1.0]);
        }),
        (Parameter::Plant, |d| d.a[(0, 0)] = f64::NAN),
        (Parameter::Gain, |d| d.gain = matrix(2, &[-9.0, -9.0])),
        (Parameter::AdaptationRate, |d| d.adaptation_rate[(0, 0)] = 1e9),
        (Parameter::AdaptationRate, |d| d.adaptation_rate[(0, 0)] = -1.0),
        (Parameter::Centers, |d| d.centers = Centers::lattice([0.0; 2], [1.0; 2], [2; 2]).unwrap()),
        (Parameter::InitialState, |d| d.initial_state = Some(DVector::zeros(3))),
    ];
    for (parameter, change) in cases {
        let mut design = oscillator();
        change(&mut design);
        assert_eq!(LinearObserver::new(&design).unwrap_err().parameter, parameter);
    }
}

/// Learning through an output of the wrong sign is unstable however slowly it is done.
#[test]
fn a_plant_that_is_not_positive_real_has_no_stable_rate() {
    let mut design = oscillator();
    design.b = -design.b;
    let error = LinearObserver::new(&design).unwrap_err();
    assert_eq!(error.parameter, Parameter::AdaptationRate);
    assert!(error.needed.contains("positive real"), "{error}");
}

/// Position measured, force learned, no gain: relative degree two, poles −2 and −3. The continuous law is stable for
/// γ σ κ(0) < 30 (Routh: (2 + 3) · 6 > γ σ κ(0)); short steps come near it, and no step is held to less than that
/// by the bound of another.
#[test]
fn short_steps_have_the_bound_of_the_continuous_law() {
    let design = LinearDesign {
        a: matrix(2, &[0.0, 1.0, -6.0, -5.0]),
        b: matrix(2, &[0.0, 1.0]),
        c: matrix(1, &[1.0, 0.0]),
        gain: matrix(2, &[0.0, 0.0]),
        adaptation_rate: matrix(1, &[1.0]),
        ..oscillator()
    };
    let bound = largest_learning_of_every_step(&design);
    assert!((0.95..1.0001).contains(&(bound / 30.0)), "{bound}");
}

/// A lightly damped plant that is sampled slowly has narrow bands of steps in which it is least stable.
#[test]
fn no_step_of_a_lightly_damped_plant_is_less_stable_than_the_bound() {
    let design = LinearDesign {
        a: matrix(2, &[0.0, 1.0, -3600.0, -0.6]),
        b: matrix(2, &[0.0, 1.0]),
        c: matrix(1, &[0.3, 1.0]),
        gain: matrix(2, &[0.0, 0.2]),
        adaptation_rate: matrix(1, &[35.0]),
        hold_s: 0.15,
        ..oscillator()
    };
    let bound = largest_learning_of_every_step(&design);
    let part = design.observable_part();
    for i in 1..=2000 {
        let h_s = 0.15 * f64::from(i) / 2000.0;
        let here = largest_gain(&part, &design.adaptation_rate, h_s) / h_s;
        // Half of that is what a step is held to.
        assert!(bound < 1.1 * here, "h {h_s}: {here}, bound {bound}");
    }
}

/// A client that leaves garbage behind the m entries of its output changes nothing.
#[test]
fn entries_beyond_the_outputs_are_ignored() {
    let (mut clean, mut dirty) =
        (LinearObserver::new(&oscillator()).unwrap(), LinearObserver::new(&oscillator()).unwrap());
    for j in 0..100_u64 {
        let output = LinearOutput::from_fn(|i, _| if i == 0 { (j as f64 * 0.1).sin() } else { 0.0 });
        let garbage = LinearOutput::from_fn(|i, _| if i == 0 { output[0] } else { 1e6 });
        clean.accept(j * 5_000_000, Some(output), None, Learn::ALL);
        dirty.accept(j * 5_000_000, Some(garbage), Some(garbage - output), Learn::ALL);
    }
    assert_eq!(clean.estimate(500_000_000), dirty.estimate(500_000_000));
}
