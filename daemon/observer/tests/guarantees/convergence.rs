//! The law on N centers against the law in H.

use crate::designs::oscillator;
use crate::native_function::{NativeFunction, projection};
use crate::reference_law::ReferenceLaw;
use crate::{Random, channel, full_inertia, full_rate, isotropic, zone};
use nalgebra::{DMatrix, DVector, Matrix1, Vector1, Vector3};
use observer::*;

/// What both laws made of the same outputs.
struct Pair {
    space: NativeSpace,
    weights: Vec<Vec<f64>>,
    reference: NativeFunction,
}

/// Both laws on the same outputs and output estimates: the same output errors, hence the same increments.
fn learn_side_by_side(shape: DeadZoneShape) -> Pair {
    let design = channel(full_inertia(), full_rate(), zone(shape, 0.1));
    let mut channel = BodyChannel::new(&design).unwrap();
    let law = channel.law_mut();
    let mut reference =
        ReferenceLaw::new(law.function().space().kernel().clone(), design.dead_zone, design.adaptation_rate);
    let mut random = Random(7);
    let mut learned = 0;
    for j in 0..150 {
        let (output, estimate_error) = (1.2 * random.vector3(), 0.2 * random.vector3());
        let h_s = [0.003, 0.005, 0.007][j % 3];
        let estimate = output - estimate_error;
        law.observe(&output, &estimate, true);
        let learning = law.learning(h_s);
        let step = reference.step(&output, &estimate, h_s);
        assert!(!learning.clamped);
        assert_eq!(law.held().output_error, step.output_error);
        assert_eq!((learning.activation, learning.increment), (step.activation, step.increment));
        learned += usize::from(learning.activation > 0.0);
        law.learn(&learning);
    }
    assert!((50..150).contains(&learned), "on both sides of the dead zone: {learned}");
    assert_eq!(reference.function().n_terms(), learned);
    Pair {
        space: law.function().space().clone(),
        weights: law.function().weights().to_vec(),
        reference: reference.function().clone(),
    }
}

/// f̂_N = Π_N f̂_∞ to rounding: the condition 300 of K times 1e-16 times 150 additions.
#[test]
fn the_law_on_centers_is_the_projection_of_the_law_in_the_native_space() {
    for shape in [DeadZoneShape::Saturated, DeadZoneShape::Quadratic, DeadZoneShape::Step] {
        let Pair { space, weights, reference } = learn_side_by_side(shape);
        let size = reference.norm();
        for (ours, projected) in weights.iter().zip(projection(&space, &reference)) {
            for (a, b) in ours.iter().zip(&projected) {
                assert!((a - b).abs() < 1e-11 * size, "{shape:?}: {a} {b}");
            }
        }
    }
}

/// |f̂_∞(y) − f̂_N(y)| ≤ P_N(y) ‖(I − Π_N) f̂_∞‖_H, attained to a good part.
#[test]
fn the_power_function_bounds_what_the_centers_lose() {
    let Pair { space, weights, reference } = learn_side_by_side(DeadZoneShape::Saturated);
    let ours = NativeFunction::of(&space, &weights);
    let lost = reference.minus(&NativeFunction::projected(&space, &reference)).norm();
    assert!(lost > 0.1 * reference.norm(), "there is something to lose: {lost}");
    let mut random = Random(11);
    let mut largest = 0.0_f64;
    for _ in 0..300 {
        let y = 1.2 * random.vector3();
        let difference = Vector3::from_column_slice(&reference.value(y.as_slice()))
            - Vector3::from_column_slice(&ours.value(y.as_slice()));
        let bound = space.power_function_at(y.as_slice()) * lost;
        assert!(difference.norm() <= bound * (1.0 + 1e-9), "{} {bound}", difference.norm());
        largest = largest.max(difference.norm() / bound);
    }
    println!("lost in norm {:.2} of {:.2}; the bound is attained to {largest:.3}", lost, reference.norm());
    assert!(largest > 0.1, "{largest}");
}

const H_S: f64 = 0.005;
const INERTIA: f64 = 2.0;
const GAIN_PER_S: f64 = 5.0;
const RATE: f64 = 40.0;

/// A curve inside of [−1, 1], never the same twice.
fn curve(j: usize) -> f64 {
    let t_s = j as f64 * H_S;
    0.6 * (1.7 * t_s).sin() + 0.35 * (4.1 * t_s + 0.5).cos()
}

fn scalar_zone() -> DeadZone {
    DeadZone::new(DeadZoneShape::Saturated, 1e-3, 1e-2).unwrap()
}

/// f̂ along the run of the law in H in its own closed loop, `m v̂' = mλ(y − v̂) + f̂`, exact for held y.
fn reference_run(kernel: Kernel, n: usize) -> Vec<f64> {
    let kernel = ScaledKernel::new(kernel, &LengthScale::Isotropic(1.0), 1).unwrap();
    let mut law = ReferenceLaw::new(kernel, scalar_zone(), Matrix1::new(RATE));
    let decay = (-GAIN_PER_S * H_S).exp();
    let mut estimate = Vector1::new(0.0);
    (0..n)
        .map(|j| {
            let output = Vector1::new(curve(j));
            let force = law.step(&output, &estimate, H_S).matched_force;
            estimate = decay * estimate + (1.0 - decay) * (output + force / (GAIN_PER_S * INERTIA));
            force[0]
        })
        .collect()
}

/// The same of the law on `n_centers` of [−1, 1], with sup P_N over it.
fn run_on_centers(kernel: Kernel, n_centers: usize, n: usize) -> (Vec<f64>, f64) {
    let one = |entry: f64| DMatrix::from_element(1, 1, entry);
    let mut observer = LinearObserver::new(&LinearDesign {
        a: one(0.0),
        b: one(1.0 / INERTIA),
        c: one(1.0),
        gain: one(GAIN_PER_S),
        kernel,
        centers: Centers::lattice([-1.0], [1.0], [n_centers]).unwrap(),
        adaptation_rate: one(RATE),
        dead_zone: scalar_zone(),
        hold_s: 1.5 * H_S,
        coast_step_s: H_S,
        initial_state: Some(DVector::zeros(1)),
        ..oscillator()
    })
    .unwrap();
    let stamp_ns = |j: usize| (j as f64 * H_S * 1e9).round() as u64;
    let forces = (0..n)
        .map(|j| {
            let mut output = LinearOutput::zeros();
            output[0] = curve(j);
            observer.accept(stamp_ns(j), Some(output), Some(LinearOutput::zeros()), Learn::ALL);
            let estimate = observer.estimate(stamp_ns(j + 1));
            assert!(!estimate.report.clamped && !estimate.report.coasting);
            estimate.matched_input[0]
        })
        .collect();
    (forces, observer.law().function().space().sup_power_function().value)
}

/// The slope of ln(ordinates) over ln(abscissas), by least squares.
fn order_of(abscissas: &[f64], ordinates: &[f64]) -> f64 {
    let centered = |of: &[f64]| {
        let mean = of.iter().map(|x| x.ln()).sum::<f64>() / of.len() as f64;
        of.iter().map(|x| x.ln() - mean).collect::<Vec<_>>()
    };
    let (x, y) = (centered(abscissas), centered(ordinates));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    product(&x, &y) / product(&x, &x)
}

/// Matérn kernels on ℝ¹, ν = k − 1/2: sup P_N ~ h^ν for the spacing h. f̂_∞ − f̂_N at y is Σ_j a_j (𝔎 −
/// 𝔎_N)(y_j, y), and each term is at most P_N(y_j) P_N(y): so the error falls at least as h^{2ν}, twice as fast
/// as one P_N promises. Samples that lie densely on a curve make f̂_∞ smoother than one kernel, up to h^{2k}:
/// the orders found lie between.
#[test]
fn in_closed_loop_the_law_on_centers_converges_twice_as_fast_as_the_power_function() {
    let n = 1200;
    for (order, lattices) in [(1, 12..=40), (2, 6..=24), (3, 4..=14)] {
        let kernel = Kernel::SobolevMatern { dimension: 1, order };
        let reference = reference_run(kernel, n);
        let largest = reference.iter().fold(0.0_f64, |largest, f| largest.max(f.abs()));
        let (mut spacings, mut errors, mut powers) = (Vec::new(), Vec::new(), Vec::new());
        for n_centers in lattices.step_by(2) {
            let (forces, power) = run_on_centers(kernel, n_centers, n);
            let differences = forces.iter().zip(&reference).map(|(a, b)| (a - b).abs());
            spacings.push(2.0 / (n_centers - 1) as f64);
            errors.push(differences.fold(0.0, f64::max) / largest);
            powers.push(power);
        }
        let (error_order, power_order) = (order_of(&spacings, &errors), order_of(&spacings, &powers));
        let (nu, last) = (order as f64 - 0.5, errors.len() - 1);
        println!(
            "ν {nu}: relative error {:.1e} … {:.1e}, order {error_order:.2}; sup P_N of the order {power_order:.2}",
            errors[0], errors[last]
        );
        // The spacings are not yet small against ℓ = 1: 0.16 for k = 3.
        assert!((power_order - nu).abs() < 0.2, "{power_order}");
        // Where along a cell the samples fall moves the maximum of single lattices, and the slope by 0.1.
        assert!(error_order > 2.0 * power_order - 0.2, "{error_order} {power_order}");
        assert!(error_order < 2.0 * order as f64 + 0.2, "{error_order}");
        assert!(errors[last] < 0.05, "{errors:?}");
    }
}

/// The same in three dimensions on few samples, sup P_N along the run.
#[test]
fn in_three_dimensions_it_converges_too() {
    let design = channel(isotropic(4.0), isotropic(200.0), zone(DeadZoneShape::Saturated, 1e-3));
    let kernel = ScaledKernel::new(design.kernel, &design.length_scale, 3).unwrap();
    let mut reference = ReferenceLaw::new(kernel, design.dead_zone, design.adaptation_rate);
    let output = |j: usize| {
        let t_s = j as f64 * H_S;
        Vector3::new(0.9 * (2.0 * t_s).sin(), 0.8 * (3.1 * t_s).cos(), 0.85 * (1.3 * t_s + 0.4).sin())
    };
    let integrator = *BodyChannel::new(&design).unwrap().plant().integrator();
    let mut estimate = Vector3::zeros();
    let truth: Vec<_> = (0..400)
        .map(|j| {
            let force = reference.step(&output(j), &estimate, H_S).matched_force;
            estimate = integrator.follow(&estimate, &output(j), &force, H_S).end;
            force
        })
        .collect();
    let largest = truth.iter().fold(0.0_f64, |largest, f| largest.max(f.norm()));
    let (errors, powers): (Vec<f64>, Vec<f64>) = [2, 3, 5, 9]
        .iter()
        .map(|&per_axis| {
            let centers = Centers::lattice([-1.0; 3], [1.0; 3], [per_axis; 3]).unwrap();
            let mut channel = BodyChannel::new(&ChannelDesign { centers, ..design.clone() }).unwrap();
            let (mut error, mut power) = (0.0_f64, 0.0_f64);
            for (j, expected) in truth.iter().enumerate() {
                let Ahead { learning, matched_force, .. } = channel.step(&output(j), &Vector3::zeros(), H_S);
                assert!(!learning.clamped);
                error = error.max((matched_force.value - expected).norm() / largest);
                power = power.max(channel.law().power_function());
            }
            (error, power)
        })
        .unzip();
    let spacings = [2.0, 1.0, 0.5, 0.25];
    let (error_order, power_order) = (order_of(&spacings, &errors), order_of(&spacings, &powers));
    println!(
        "d = 3, ν 1.5: relative error {:.1e} … {:.1e}, order {error_order:.2}; sup P_N of the order {power_order:.2}",
        errors[0], errors[3]
    );
    assert!(error_order > 2.0 * power_order - 0.2, "{error_order} {power_order}");
    assert!(errors[3] < 0.02, "{errors:?}");
}
