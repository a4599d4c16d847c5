//! The values of the paper's first example, as an independent program computes them.

use super::design::{JointDesign, PriorDeviations};
use super::filter::JointFilter;
use super::predict::LearnedAcceleration;
use super::rows::{DISTURBANCE, KERNEL, POSITION, VELOCITY, WEIGHTS};
use super::sensor::SensorUse;
use super::teaches::Teaches;
use crate::designs::{Random, joint_law};
use nalgebra::Vector3;

const MASS_KG: f64 = 4.0;

fn force_n(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new((v.x * v.x).cos(), (v.y * v.y).sin() + v.x.sin(), v.z.cos() + v.y.sin())
}

/// The plant of the example with its own controller, by RK4 with steps of 1 ms at most.
struct Example {
    t_s: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
}

impl Example {
    fn command_n(&self) -> Vector3<f64> {
        let t = self.t_s;
        let r = Vector3::new(t.sin(), t.cos(), (2.0 * t).sin());
        let v = Vector3::new(t.cos(), -t.sin(), 2.0 * (2.0 * t).cos());
        let a = Vector3::new(-t.sin(), -t.cos(), -4.0 * (2.0 * t).sin());
        -(self.position - r) - (self.velocity - v) + MASS_KG * a
    }

    fn measured(&self) -> Vector3<f64> {
        self.velocity.add_scalar(0.008 * ((0.5 * self.t_s).sin() + (0.5 * self.t_s).cos()))
    }

    fn advance(&mut self, to_s: f64, command_n: &Vector3<f64>) {
        let h = to_s - self.t_s;
        let n = (h * 1000.0 - 1e-9).ceil();
        let dt = h / n;
        let a = |v: Vector3<f64>| (command_n + force_n(&v)) / MASS_KG;
        for _ in 0..n as usize {
            let v = self.velocity;
            let k1 = a(v);
            let k2 = a(v + 0.5 * dt * k1);
            let k3 = a(v + 0.5 * dt * k2);
            let k4 = a(v + dt * k3);
            self.position += dt * v + dt * dt / 6.0 * (k1 + k2 + k3);
            self.velocity += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        self.t_s = to_s;
    }
}

/// Before sample j: v̂; used in the step from it: f̂ (N); then √P_00 before and the deviation of f̂ (N), each of three
/// axes; ‖θ‖ and tr P_θθ of three axes after the sample.
type Row = [f64; 16];

/// Samples that are missing, and what is added to one (m/s).
struct Run {
    name: &'static str,
    design: JointDesign,
    step_ms: fn(u64) -> u64,
    is_missing: fn(u64) -> bool,
    spike_m_s: fn(u64) -> f64,
}

/// The rows, and the true velocity and force at each sample.
fn rows(run: &Run, n: u64) -> Vec<(Row, [Vector3<f64>; 2])> {
    let design = &run.design;
    let mut filter = JointFilter::new(design).unwrap();
    let mut state = filter.new_state();
    let mut example =
        Example { t_s: 0.0, position: Vector3::new(0.0, 1.0, 0.0), velocity: Vector3::new(1.0, 0.0, 2.0) };
    let mut rows = Vec::new();
    let mut last_s = None;
    for j in 0..n {
        let (t_s, h_s) = (example.t_s, (run.step_ms)(j) as f64 / 1000.0);
        let command_n = example.command_n();
        let y = example.measured().add_scalar((run.spike_m_s)(j));
        let (before, std) = (state.velocity(), state.velocity_std());
        if !(run.is_missing)(j) {
            let since_s = last_s.replace(t_s).map_or(0.0, |last_s| t_s - last_s);
            let y = [y.x, y.y, y.z].map(Some);
            filter.update_velocity(
                &mut state,
                &y,
                &design.noise,
                since_s,
                (SensorUse::default(), Teaches::All),
            );
        }
        let norm = state.weights_norm();
        let traces = [0, 1, 2].map(|axis| state.weights_trace(axis));
        let command = (command_n / MASS_KG).into();
        let learned = filter.predict(&mut state, h_s, &command, &[0.0; 3], Teaches::All);
        let learned_std = filter.learned_std(&state, &learned).map(|a| MASS_KG * a);
        let matched_n = learned.value.map(|a| MASS_KG * a);
        let row = [before, matched_n, std, learned_std].concat().into_iter().chain([norm]).chain(traces);
        let truth = [example.velocity, force_n(&example.velocity)];
        rows.push((row.collect::<Vec<_>>().try_into().unwrap(), truth));
        example.advance(t_s + h_s, &command_n);
    }
    rows
}

/// Of `tests/joint_reference.py`, which shares no code with this one.
const REFERENCE: &str = include_str!("../../../tests/joint_reference.csv");

fn even(name: &'static str, design: JointDesign) -> Run {
    Run { name, design, step_ms: |_| 5, is_missing: |_| false, spike_m_s: |_| 0.0 }
}

#[test]
fn the_paper_s_first_example_gives_the_values_of_an_independent_program() {
    let mut plain = joint_law([0.01; 3]);
    (plain.noise_samples, plain.excitation.correction_share) = (0.0, 0.0);
    let axes = JointDesign { noise: [0.01, 0.02, 0.005], ..joint_law([0.01; 3]) };
    let runs = [
        even("even", joint_law([0.01; 3])),
        even("plain", plain),
        Run { step_ms: |j| 2 + j * 7919 % 6, ..even("uneven", joint_law([0.01; 3])) },
        Run { is_missing: |j| j % 7 == 6, ..even("missing", joint_law([0.01; 3])) },
        Run {
            spike_m_s: |j| if j % 50 == 49 { if j / 50 % 2 == 0 { 1.0 } else { -1.0 } } else { 0.0 },
            ..even("spikes", joint_law([0.01; 3]))
        },
        even("axes", axes),
    ];
    let mut compared = 0;
    for run in runs {
        let rows = rows(&run, 2001);
        for line in REFERENCE.lines().filter(|line| line.split(',').next() == Some(run.name)) {
            let numbers: Vec<f64> = line.split(',').skip(1).map(|number| number.parse().unwrap()).collect();
            let sample = numbers[0] as usize;
            for (column, (found, expected)) in rows[sample].0.iter().zip(&numbers[1..]).enumerate() {
                // The values are printed with 14 digits; the rest is rounding over 2000 steps.
                let error = (found - expected).abs() / expected.abs().max(1e-3);
                assert!(error < 1e-9, "{}, sample {sample}, column {column}: {found} {expected}", run.name);
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 6 * 7 * 16);
}

/// joint.md §7: RMS over the second half of 10 s and of 120 s.
#[test]
fn the_paper_s_first_example_has_the_errors_that_were_found_elsewhere() {
    for (samples, velocity_m_s, force_n) in [(2000, 0.015279, 0.09979), (24_000, 0.01366, 0.0323)] {
        let rows = rows(&even("even", joint_law([0.01; 3])), samples);
        let half = &rows[rows.len() / 2..];
        let rms = |first: usize, truth: usize| {
            let error = |row: &(Row, [Vector3<f64>; 2])| {
                (Vector3::from_column_slice(&row.0[first..first + 3]) - row.1[truth]).norm_squared()
            };
            (half.iter().map(error).sum::<f64>() / half.len() as f64).sqrt()
        };
        let found = (rms(0, 0), rms(3, 1));
        let agrees = |found: f64, expected: f64| (found / expected - 1.0).abs() < 2e-3;
        assert!(agrees(found.0, velocity_m_s) && agrees(found.1, force_n), "{samples}: {found:?}");
    }
}

/// Without features, without noise levels that follow: the textbook's filter for v' = a + d, d' = −d/τ.
#[test]
fn without_features_it_is_the_kalman_filter_with_a_gauss_markov_disturbance() {
    let mut design = joint_law([0.01; 3]);
    design.prior =
        PriorDeviations { bias: 0.0, linear: 0.0, kernel: 0.0, input: 0.0, lag: 0.0, disturbance: 0.7 };
    (design.noise_samples, design.excitation.correction_share) = (0.0, 0.0);
    let mut filter = JointFilter::new(&design).unwrap();
    let mut state = filter.new_state();
    let mut random = Random(1);
    let (r, q) = (design.noise[0], design.process_noise);
    let mut x = nalgebra::Vector2::new(0.3, 0.0);
    let mut p = nalgebra::Matrix2::new(r * r, 0.0, 0.0, 0.49);
    for j in 0..2000 {
        let y = if j == 0 { 0.3 } else { x[0] + 3.0 * r * random.normal() };
        let h = 0.005 + 0.004 * random.next();
        let a = 2.0 * random.next();
        filter.update_velocity(
            &mut state,
            &[Some(y); 3],
            &design.noise,
            h,
            (SensorUse::default(), Teaches::All),
        );
        filter.predict(&mut state, h, &[a; 3], &[0.0; 3], Teaches::All);
        // Textbook: Joseph form, then the transition; a stray sample counts as a noisier one, as the law has it.
        let e: f64 = y - x[0];
        let s = p[(0, 0)] + r * r;
        let s_w = s * (e.abs() / s.sqrt() / 4.0).max(1.0);
        let k = p.column(0) / s_w;
        let i_kh = nalgebra::Matrix2::identity() - k * nalgebra::RowVector2::new(1.0, 0.0);
        let noise = s_w - p[(0, 0)];
        p = i_kh * p * i_kh.transpose() + noise * k * k.transpose();
        x += k * e;
        let decay = (-h / 0.2_f64).exp();
        let f = nalgebra::Matrix2::new(1.0, 0.2 * (1.0 - decay), 0.0, decay);
        let driven = 0.49 * (1.0 - decay * decay);
        p = f * p * f.transpose()
            + nalgebra::Matrix2::new(
                q * h + driven * h * h / 3.0,
                driven * h / 2.0,
                driven * h / 2.0,
                driven,
            );
        x = f * x + nalgebra::Vector2::new(h * a, 0.0);
        for axis in 0..3 {
            assert!((state.mean[axis][VELOCITY] - x[0]).abs() < 1e-10, "step {j}");
            assert!((state.mean[axis][DISTURBANCE] - x[1]).abs() < 1e-10, "step {j}");
        }
        for (i, k) in [(0, 0), (0, 1), (1, 1)] {
            assert!((state.covariances[0].at(i, k) - p[(i, k)]).abs() < 1e-12, "step {j}");
        }
    }
}

/// A design that forgets nothing, with neither process noise nor disturbance.
fn without_forgetting() -> JointDesign {
    let mut design = joint_law([0.01; 3]);
    (design.noise_samples, design.excitation.correction_share) = (0.0, 0.0);
    (design.motion_memory_s, design.input_memory_s) = (1e15, 1e15);
    (design.process_noise, design.prior.disturbance) = (0.0, 0.0);
    // The part that the centers cannot represent is noise over this time: none.
    design.disturbance_time_s = 1e-18;
    design
}

/// θ̂ and v̂ minimise ‖y_0 − v_0‖²/r² + Σ‖y_j − v_j‖²/r² + ‖θ‖² on the features that the filter saw.
#[test]
fn without_forgetting_it_is_regularised_least_squares() {
    let design = without_forgetting();
    let mut filter = JointFilter::new(&design).unwrap();
    let mut state = filter.new_state();
    let mut random = Random(2);
    let (n, h, r) = (120, 0.02, design.noise[0]);
    // Unknown: v_0 and θ. Row j: v_j = v_0 + Σ h (a + ψᵀθ).
    let width = filter.n_padded + 1;
    let (mut normal, mut right) = (nalgebra::DMatrix::zeros(width, width), nalgebra::DVector::zeros(width));
    let mut row = nalgebra::DVector::zeros(width);
    (row[0], normal[(0, 0)]) = (1.0, 0.0);
    let mut known = 0.0;
    for i in 1..width {
        normal[(i, i)] = 1.0;
    }
    let mut truth = 0.4;
    for j in 0..n {
        let y: f64 = truth;
        // The first y stands twice: it begins the filter and is an update, too.
        let weight = if j == 0 { 2.0 } else { 1.0 } / (r * r);
        normal += weight * &row * row.transpose();
        right += weight * (y - known) * &row;
        filter.update_velocity(
            &mut state,
            &[Some(y); 3],
            &design.noise,
            h,
            (SensorUse::default(), Teaches::All),
        );
        let a = (0.3 * j as f64).sin();
        let solution = normal.clone().cholesky().unwrap().solve(&right);
        let v = known + row.dot(&solution);
        assert!((v - state.mean[0][VELOCITY]).abs() < 1e-9, "sample {j}: {v} {}", state.mean[0][VELOCITY]);
        for i in 0..filter.n_padded {
            let is_weight = i >= WEIGHTS && i != POSITION;
            assert!(!is_weight || (solution[1 + i] - state.mean[0][i]).abs() < 1e-7, "sample {j}, row {i}");
        }
        filter.predict(&mut state, h, &[a; 3], &[0.0; 3], Teaches::All);
        for i in 0..filter.n_padded {
            row[1 + i] += h * filter.features[i];
        }
        known += h * a;
        truth += h * (a + 0.3 * (2.0 * truth).cos() + 0.01 * random.normal());
    }
}

/// Of a function in the span of the features: the error is at most the deviation times √(‖θ‖² + Σε²/r²).
#[test]
fn the_error_of_the_learned_acceleration_is_within_the_deviation_times_the_norm() {
    let design = without_forgetting();
    let mut filter = JointFilter::new(&design).unwrap();
    let mut state = filter.new_state();
    let mut random = Random(3);
    let theta: Vec<f64> = (0..filter.n_padded)
        .map(|i| {
            if (WEIGHTS..POSITION).contains(&i) || (KERNEL..filter.n).contains(&i) {
                random.next()
            } else {
                0.0
            }
        })
        .collect();
    let mut squares: f64 = theta.iter().map(|t| t * t).sum();
    let (h, r) = (0.02, design.noise[0]);
    let mut velocity = 0.2;
    let mut closest: f64 = 0.0;
    for j in 0..400 {
        let noise = 0.3 * r * random.normal();
        squares += noise * noise / (r * r);
        filter.update_velocity(
            &mut state,
            &[Some(velocity + noise); 3],
            &design.noise,
            h,
            (SensorUse::default(), Teaches::All),
        );
        let a = (0.11 * j as f64).sin();
        let learned = filter.predict(&mut state, h, &[a; 3], &[0.0; 3], Teaches::All);
        let std = filter.learned_std(&state, &LearnedAcceleration { power_function: 0.0, ..learned });
        let truth: f64 = filter.features.iter().zip(&theta).map(|(psi, t)| psi * t).sum();
        let after: f64 = filter.features.iter().zip(&state.mean[0]).map(|(psi, t)| psi * t).sum();
        velocity += h * (a + truth);
        // The first y stands twice.
        let bound = std[0] * (squares + if j == 0 { 1.0 } else { 0.0 }).sqrt();
        assert!((after - truth).abs() <= bound, "sample {j}: {} {bound}", (after - truth).abs());
        closest = closest.max((after - truth).abs() / bound);
    }
    assert!(closest > 0.1, "a bound that nothing comes near proves little: {closest}");
}

/// θ is Ornstein–Uhlenbeck with stationary covariance I and measuring only reduces it; P stays symmetric to the bit and
/// positive definite.
#[test]
fn the_weights_covariance_never_exceeds_the_prior_excited_or_not() {
    let design = joint_law([0.01; 3]);
    let mut filter = JointFilter::new(&design).unwrap();
    let mut state = filter.new_state();
    let mut random = Random(4);
    for j in 0..20_000 {
        let moving = (j / 2000) % 2 == 0;
        let level = if moving { 1.0 } else { 0.0 };
        let y: [f64; 3] = std::array::from_fn(|axis| {
            level * (0.01 * (axis + 1) as f64 * j as f64).sin() + 0.01 * random.normal()
        });
        // An outage in each thousand.
        if j % 1000 < 900 {
            filter.update_velocity(
                &mut state,
                &y.map(Some),
                &design.noise,
                0.005,
                (SensorUse::default(), Teaches::All),
            );
        }
        let a = y.map(|y| level * y - 0.1 * y);
        filter.predict(&mut state, 0.005, &a, &[0.0; 3], Teaches::All);
        if j % 500 == 499 {
            let n = filter.n;
            let rows: Vec<usize> = (0..n).filter(|&row| row != POSITION).collect();
            let p = nalgebra::DMatrix::from_fn(rows.len(), rows.len(), |i, k| {
                let (here, there) =
                    (state.covariances[0].at(rows[i], rows[k]), state.covariances[0].at(rows[k], rows[i]));
                assert_eq!(here.to_bits(), there.to_bits());
                here
            });
            assert!(p.clone().cholesky().is_some(), "step {j}: not positive definite");
            let weights = p.view((2, 2), (rows.len() - 2, rows.len() - 2)).into_owned();
            let largest = weights.symmetric_eigenvalues().max();
            assert!(largest <= 1.0 + 1e-12, "step {j}: {largest}");
        }
    }
}

/// With P_θθ held at p₀ I and constant features the gain settles, and θ += h Γ ψ e with Γ = p₀/P_00: the gradient law.
#[test]
fn with_a_frozen_covariance_of_the_weights_it_is_the_gradient_law() {
    let mut design = without_forgetting();
    design.process_noise = 1e-3;
    let mut filter = JointFilter::new(&design).unwrap();
    let mut state = filter.new_state();
    let (h, p0, n) = (0.005, 1e-6, filter.n);
    let at_rest = [Some(0.5); 3];
    for _ in 0..5000 {
        filter.update_velocity(&mut state, &at_rest, &design.noise, h, (SensorUse::default(), Teaches::All));
        // The estimate stays where the features are constant.
        for axis in 0..3 {
            state.mean[axis].fill(0.0);
            state.mean[axis][VELOCITY] = 0.5;
        }
        filter.predict(&mut state, h, &[0.0; 3], &[0.0; 3], Teaches::All);
        for i in WEIGHTS..n {
            for k in WEIGHTS..=i {
                state.covariances[0].set(i, k, if i == k && i != POSITION { p0 } else { 0.0 });
            }
        }
    }
    for axis in 0..3 {
        state.mean[axis].fill(0.0);
        state.mean[axis][VELOCITY] = 0.5;
    }
    let (error, p_00) = (1e-3, state.covariances[0].at(VELOCITY, VELOCITY));
    filter.update_velocity(
        &mut state,
        &[Some(0.5 + error); 3],
        &design.noise,
        h,
        (SensorUse::default(), Teaches::All),
    );
    for i in (WEIGHTS..n).filter(|&i| i != POSITION) {
        let expected = h * p0 / p_00 * filter.features[i] * error;
        let found = state.mean[0][i];
        // The settled p is (1 − K) p + h p₀ ψ. Within a step the update takes p²/S from p₀, some 1e-6 of it.
        assert!((found - expected).abs() <= 1e-5 * expected.abs() + 1e-18, "row {i}: {found} {expected}");
    }
}
