//! What the sensor's noise alone does to f̂: it grows in proportion to the time, at a rate that is known beforehand.
//!
//! A body hovers: v = v₀, u = 0, f = 0, y_j = v₀ + δ_j with white noise of the variance s² on each axis. The estimate v̂_j does
//! not know δ_j yet, so that E[δ_j ỹ_jᵀ] = s² I, and with φ(y) = φ(v₀) + ∇φ δ + …
//!
//! ```text
//! E[Δθ] = h E[σ φ(y) ỹᵀ] Γ_f = h η s² ∇φ(v₀) Γ_f        (and a part along φ(v₀), which the loop over v̂ takes back)
//! η = E[σ ‖ỹ‖²]/(m (s² + p)),   p I = E[(v̂ − v₀)(v̂ − v₀)ᵀ];     1 with σ = 1
//! f̂(z) = η t Γ_f s² ∇φ(v₀)ᵀφ(z) ≈ η t Γ_f s² ∇φᵀ∇φ (z − v₀)     a force that grows with the speed and drives it
//! ```
//!
//! With φ at v̂ the same expectation is −p ∇φ: some λh/2 of it, and a drag.

use crate::designs::{Random, body_channel};
use crate::{isotropic, space_of, zone};
use nalgebra::{Matrix3, Vector3};
use observer::*;

const H_S: f64 = 0.005;
const MASS_KG: f64 = 4.0;
const RATE: f64 = 100.0;
/// s (m/s).
const NOISE: f64 = 0.02;

fn hovering(shape_and_width: (DeadZoneShape, f64), options: GradientOptions) -> ChannelDesign {
    let dead_zone = zone(shape_and_width.0, shape_and_width.1);
    ChannelDesign { options, ..body_channel(isotropic(MASS_KG), isotropic(RATE), dead_zone) }
}

const ESTIMATED: GradientOptions = GradientOptions { feature_point: FeaturePoint::Estimated, max_norm: None };

/// Normal to the fourth moment: twelve uniform numbers.
fn noise(random: &mut Random) -> Vector3<f64> {
    Vector3::from_fn(|_, _| NOISE * 0.5 * (0..12).map(|_| random.next()).sum::<f64>())
}

/// What a hover of some length leaves behind.
struct Hover {
    channel: BodyChannel,
    /// Mean over all samples of σ‖ỹ‖², and of ‖ỹ‖².
    weighted_square: f64,
    square: f64,
    /// Largest ‖f̂‖, and whether anything was clamped.
    largest_norm: f64,
    clamped: bool,
}

fn hover(design: &ChannelDesign, at: Vector3<f64>, duration_s: f64, seed: u64) -> Hover {
    let mut channel = BodyChannel::new(design).unwrap();
    channel.set_rate(at);
    let mut random = Random(seed);
    let n = (duration_s / H_S) as usize;
    let (mut weighted_square, mut square, mut largest_norm, mut clamped) = (0.0, 0.0, 0.0_f64, false);
    for _ in 0..n {
        let learning = channel.step(&(at + noise(&mut random)), &Vector3::zeros(), H_S).learning;
        let held = channel.law().held();
        square += held.output_error.norm_squared() / n as f64;
        weighted_square += held.activation * held.output_error.norm_squared() / n as f64;
        largest_norm = largest_norm.max(channel.law().function().native_norm());
        clamped |= learning.clamped;
    }
    Hover { channel, weighted_square, square, largest_norm, clamped }
}

impl Hover {
    fn force(&mut self, v: Vector3<f64>) -> Vector3<f64> {
        self.channel.law_mut().matched_force_at(&v, &Learning::none()).value
    }

    /// ∂f̂/∂v.
    fn slope(&mut self, at: Vector3<f64>) -> Matrix3<f64> {
        let columns: [_; 3] = std::array::from_fn(|axis| {
            let step = Vector3::ith(axis, 1e-3);
            (self.force(at + step) - self.force(at - step)) / 2e-3
        });
        Matrix3::from_columns(&columns)
    }
}

/// ∇φ(v), one column for each axis.
fn feature_gradient(space: &NativeSpace, v: Vector3<f64>) -> [Vec<f64>; 3] {
    let mut buffers = FeatureBuffers::new(space);
    let mut features = |v: Vector3<f64>| {
        space.features(v.as_slice(), &mut buffers);
        buffers.features().to_vec()
    };
    std::array::from_fn(|axis| {
        let step = Vector3::ith(axis, 1e-4);
        let (after, before) = (features(v + step), features(v - step));
        after.iter().zip(before).map(|(a, b)| (a - b) / 2e-4).collect()
    })
}

fn products(a: &[Vec<f64>; 3], b: &[Vec<f64>; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[i].iter().zip(&b[j]).map(|(a, b)| a * b).sum())
}

/// s² Γ_f ∇φᵀ∇φ in four minutes at σ = 1: the norm and the slope of f̂, at the middle of the centers and beside it.
#[test]
fn noise_alone_makes_f_hat_grow_at_the_predicted_rate() {
    let design = hovering((DeadZoneShape::Step, 0.0), GradientOptions::default());
    let space = space_of(&design);
    let duration_s = 240.0;
    for at in [Vector3::zeros(), Vector3::new(0.3, -0.2, 0.5)] {
        let gradient = feature_gradient(&space, at);
        let rate = RATE * NOISE * NOISE;
        let slope = rate * duration_s * products(&gradient, &gradient);
        let norm = rate * duration_s * products(&gradient, &gradient).trace().sqrt();
        let mut run = hover(&design, at, duration_s, 7);
        let (found_slope, found_norm) = (run.slope(at), run.largest_norm);
        println!(
            "hover at {:?} for {duration_s} s: slope {:.2} … {:.2} N s/m of {:.2} … {:.2} predicted, norm {found_norm:.2} of \
             {norm:.2}, {:.2} N at 0.5 m/s more",
            at.as_slice(),
            found_slope.diagonal().min(),
            found_slope.diagonal().max(),
            slope.diagonal().min(),
            slope.diagonal().max(),
            run.force(at + Vector3::new(0.5, 0.0, 0.0)).norm(),
        );
        assert!((found_slope - slope).norm() < 0.1 * slope.norm(), "{found_slope} {slope}");
        assert!((found_norm / norm - 1.0).abs() < 0.1, "{found_norm} {norm}");
        // It drives: f̂ᵀ(z − v₀) > 0.
        assert!(found_slope.symmetric_eigenvalues().min() > 0.0);
    }
}

/// It grows for ever: nothing in the mean of the law feels it, as long as the body stays where it is.
#[test]
fn four_times_the_time_is_four_times_the_norm() {
    let design = hovering((DeadZoneShape::Step, 0.0), GradientOptions::default());
    let [short, long] = [150.0, 600.0].map(|t_s| hover(&design, Vector3::zeros(), t_s, 3).largest_norm);
    assert!((long / short - 4.0).abs() < 0.4, "{short} {long}");
}

/// A dead zone as wide as one deviation slows it by η and does not stop it.
#[test]
fn a_dead_zone_slows_the_growth_by_its_share_of_the_errors() {
    let design = hovering((DeadZoneShape::Saturated, NOISE), GradientOptions::default());
    let gradient = feature_gradient(&space_of(&design), Vector3::zeros());
    let mut run = hover(&design, Vector3::zeros(), 240.0, 11);
    let eta = run.weighted_square / run.square;
    let slope = eta * RATE * NOISE * NOISE * 240.0 * products(&gradient, &gradient);
    let found = run.slope(Vector3::zeros());
    println!(
        "a dead zone of s: η = {eta:.3}, slope {:.2} of {:.2} N s/m",
        found.trace() / 3.0,
        slope.trace() / 3.0
    );
    assert!((found - slope).norm() < 0.15 * slope.norm(), "{found} {slope}");
    assert!(eta > 0.5);
}

/// p, the variance of v̂ on one axis, from e⁺ = E e + (1 − E) δ + (b/m) F⁺, F⁺ = F + h g (δ − e), g = γ φᵀφ.
fn estimate_variance(squared_features: f64) -> f64 {
    let decay = (-10.0 * H_S).exp();
    let b = (1.0 - decay) / 10.0 / MASS_KG;
    let learned = H_S * RATE * squared_features;
    let map = nalgebra::Matrix2::new(decay - b * learned, b, -learned, 1.0);
    let input = nalgebra::Vector2::new(1.0 - decay + b * learned, learned);
    let mut covariance = nalgebra::Matrix2::zeros();
    for _ in 0..20_000 {
        covariance = map * covariance * map.transpose() + NOISE * NOISE * input * input.transpose();
    }
    covariance[(0, 0)]
}

/// φ(C x̂) leaves −p ∇φ in place of s² ∇φ: a drag, and 4 % of the rate.
#[test]
fn features_at_the_estimate_leave_a_drag_of_four_percent() {
    let step = (DeadZoneShape::Step, 0.0);
    let space = space_of(&hovering(step, ESTIMATED));
    let power = space.power_function_at(&[0.0; 3]);
    let share = estimate_variance(space.value_at_zero() - power * power) / (NOISE * NOISE);
    let gradient = feature_gradient(&space, Vector3::zeros());
    let duration_s = 240.0;
    let slope = |options, seed| {
        let mut run = hover(&hovering(step, options), Vector3::zeros(), duration_s, seed);
        (run.slope(Vector3::zeros()).trace() / 3.0, run.largest_norm)
    };
    let predicted = -share * RATE * NOISE * NOISE * duration_s * products(&gradient, &gradient).trace() / 3.0;
    let (mut found, mut norm) = (0.0, 0.0);
    for seed in 0..4 {
        let (slope, largest_norm) = slope(ESTIMATED, 100 + seed);
        (found, norm) = (found + slope / 4.0, norm + largest_norm / 4.0);
    }
    let (at_output, norm_at_output) = slope(GradientOptions::default(), 100);
    println!(
        "features at the estimate, {duration_s} s: slope {found:.3} N s/m of {predicted:.3} predicted (p/s² = {share:.4}), norm \
         {norm:.3}; at the output {at_output:.2}, {norm_at_output:.2}"
    );
    assert!(share < 0.05);
    assert!((found / predicted - 1.0).abs() < 0.25, "{found} {predicted}");
    assert!(found.abs() < 0.05 * at_output && norm < 0.1 * norm_at_output);
}

/// The bound is met and not passed, with either solver; what would be refused is reported as clamped.
#[test]
fn a_bound_on_the_norm_is_not_passed() {
    let step = (DeadZoneShape::Step, 0.0);
    let local = Solver::Local(LocalSolver { block: Some(4), ..LocalSolver::default() });
    for (solver, at) in [Solver::Dense, local]
        .into_iter()
        .flat_map(|s| [(s, Vector3::zeros()), (s, Vector3::new(0.3, 0.1, 0.7))])
    {
        let centers = Centers::lattice([-1.0; 3], [1.0; 3], [5; 3]).unwrap();
        let bounded = |max_norm| {
            let options = GradientOptions { max_norm, ..GradientOptions::default() };
            ChannelDesign { centers: centers.clone(), solver, ..hovering(step, options) }
        };
        let max_norm = 4.0;
        let run = hover(&bounded(Some(max_norm)), at, 120.0, 5);
        assert!(run.clamped && run.largest_norm <= max_norm * (1.0 + 1e-12), "{}", run.largest_norm);
        assert!(run.largest_norm > 0.99 * max_norm, "{}", run.largest_norm);
        // One that is not reached changes no bit.
        let [free, wide] = [None, Some(1e6)].map(|max_norm| hover(&bounded(max_norm), at, 20.0, 5));
        assert!(!wide.clamped && free.largest_norm == wide.largest_norm);
        assert_eq!(free.channel.state(), wide.channel.state());
    }
}

/// At the bound, what lowers the norm is learned in full: a force that has changed its sign is unlearned.
#[test]
fn at_its_bound_f_hat_still_follows_a_force_that_is_within_it() {
    let options = GradientOptions { max_norm: Some(2.0), ..GradientOptions::default() };
    let mut channel = BodyChannel::new(&hovering((DeadZoneShape::Step, 0.0), options)).unwrap();
    let kappa_0 = channel.law().function().space().value_at_zero();
    // 𝒦(0,·) a/κ(0) with |a| = √κ(0) ‖·‖_H at the point 0, a center.
    let largest = 2.0 * kappa_0.sqrt();
    for force in [2.0 * largest, -0.5 * largest] {
        let mut held = Vector3::zeros();
        for _ in 0..8000 {
            let ahead = channel.step(&Vector3::zeros(), &Vector3::new(-force, 0.0, 0.0), H_S);
            held = ahead.matched_force.value;
        }
        let expected = force.min(largest);
        assert!((held.x - expected).abs() < 1e-3 * largest, "{} {expected}", held.x);
    }
}

#[test]
fn a_bound_on_the_norm_that_is_no_positive_number_is_refused() {
    for max_norm in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = GradientOptions { max_norm: Some(max_norm), ..GradientOptions::default() };
        let error = BodyChannel::new(&hovering((DeadZoneShape::Step, 0.0), options)).unwrap_err();
        assert_eq!(error.parameter, Parameter::MaxNorm);
    }
}
