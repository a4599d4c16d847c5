use super::*;
use crate::designs::Random;
use crate::function::solver::LocalSolver;
use nalgebra::Vector3;

fn matern(dimension: usize) -> Kernel {
    Kernel::SobolevMatern { dimension, order: dimension.div_ceil(2) + 1 }
}

fn function(
    kernel: Kernel,
    length_scale: &LengthScale,
    centers: &Centers,
    solver: Solver,
) -> LearnedFunction<3> {
    LearnedFunction::zero((kernel, length_scale), centers, 0.0, &solver).unwrap()
}

fn block_of(points: usize) -> Solver {
    Solver::Local(LocalSolver { block: Some(points), ..LocalSolver::default() })
}

fn lattice(per_axis: &[usize]) -> Centers {
    let m = per_axis.len();
    Centers::lattice(vec![-2.0; m], vec![2.0; m], per_axis).unwrap()
}

/// Where the outputs of a history come from: anywhere, along a path, or around one place.
fn output(kind: usize, j: usize, m: usize, numbers: &mut Random) -> Vec<f64> {
    match kind {
        0 => numbers.point(2.0, m),
        1 => (0..m).map(|axis| 1.95 * (0.011 * (j * (axis + 2)) as f64 + axis as f64).sin()).collect(),
        _ => (0..m).map(|axis| 0.7 - 0.5 * axis as f64 + 0.3 * numbers.next()).collect(),
    }
}

fn predicted_error(function: &LearnedFunction<3>) -> f64 {
    match function.solver() {
        SolverInUse::Dense => 0.0,
        SolverInUse::Local { predicted_error, .. } => predicted_error,
    }
}

/// The one promise of the solver: no evaluation is farther from the dense solver's than it says, after histories
/// of all kinds, where updates were made and elsewhere, inside of the centers' box and outside.
#[test]
fn no_evaluation_is_farther_from_the_dense_one_than_its_estimate() {
    errors_stay_below_their_estimates(9, 1);
}

/// `cargo test --release -p observer --lib many_histories -- --ignored --nocapture`: some ten minutes.
#[test]
#[ignore = "ten minutes"]
fn no_evaluation_after_many_histories_is_farther_from_the_dense_one_than_its_estimate() {
    errors_stay_below_their_estimates(400, 2);
}

fn errors_stay_below_their_estimates(n_histories: usize, seed: u64) {
    let wendland = |n: usize, support: f64| LengthScale::Isotropic(support * 4.0 / (n - 1) as f64);
    let one = LengthScale::Isotropic(1.0);
    let cases = [
        (Kernel::WendlandC2, wendland(9, 4.0), lattice(&[9; 3]), 4, 2e-2),
        (Kernel::WendlandC2, wendland(9, 4.0), lattice(&[9; 3]), 6, 5e-3),
        (Kernel::WendlandC2, wendland(9, 6.0), lattice(&[9; 3]), 6, 3e-3),
        (Kernel::WendlandC4, wendland(9, 4.0), lattice(&[9; 3]), 6, 2e-2),
        (matern(3), one.clone(), lattice(&[8; 3]), 4, 4e-3),
        (matern(3), one.clone(), lattice(&[8; 3]), 6, 6e-4),
        (matern(3), LengthScale::PerAxis(vec![0.7, 1.0, 1.5]), lattice(&[11, 3, 8]), 4, 8e-3),
        (matern(2), one.clone(), lattice(&[20, 14]), 4, 2e-2),
        (Kernel::WendlandC2, wendland(20, 4.0), lattice(&[20; 2]), 6, 5e-3),
        (matern(1), LengthScale::Isotropic(0.3), lattice(&[60]), 4, 2e-2),
        (Kernel::WendlandC2, wendland(60, 5.0), lattice(&[60]), 6, 5e-3),
    ];
    let mut numbers = Random(seed);
    for (kernel, length_scale, centers, points, largest_rms) in cases {
        let m = centers.dimension();
        let mut dense = function(kernel, &length_scale, &centers, Solver::Dense);
        let mut local = function(kernel, &length_scale, &centers, block_of(points));
        let what = format!("{kernel:?}, {} centers, {:?}", centers.n_centers(), local.solver());
        let (mut tightness, mut errors, mut values) = (Vec::new(), 0.0, 0.0);
        for history in 0..n_histories {
            let n_updates = [1, 8, 60, 300][history % 4];
            for j in 0..n_updates {
                let y = output(history % 3, j, m, &mut numbers);
                let increment = Vector3::from_fn(|axis, _| if axis < m { numbers.next() } else { 0.0 });
                dense.hold(&y);
                local.hold(&y);
                local.held();
                dense.learn(&increment);
                local.learn(&increment);
            }
            for j in 0..120 {
                // Along the history, around it, and a little beyond the lattice.
                let near = output(history % 3, j * 5 % n_updates.max(2), m, &mut numbers);
                let point = match j % 3 {
                    0 => near,
                    1 => near.iter().map(|y| y + 0.2 * numbers.next()).collect(),
                    _ => numbers.point(2.5, m),
                };
                // With and without an increment that is not yet learned.
                let size = if j % 4 == 0 { 1.0 } else { 0.0 };
                let pending = Vector3::from_fn(|axis, _| if axis < m { size * numbers.next() } else { 0.0 });
                let (exact, found) = (dense.at(&point, &pending), local.at(&point, &pending));
                let error = (found.value - exact.value).norm();
                let case = format!("{what}, history {history}, at {point:?}");
                assert!(error <= found.error, "{case}: {error:.2e} > {:.2e}", found.error);
                assert!(found.squared_features <= exact.squared_features + 1e-9, "{case}");
                if error > 1e-9 {
                    tightness.push(found.error / error);
                }
                if j % 3 < 2 {
                    errors += error * error;
                    values += exact.value.norm_squared();
                }
            }
            let norms = (dense.native_norm(), local.native_norm());
            // Kept from above: it takes the most that an increment can add.
            assert!(norms.1 > 0.97 * norms.0 && norms.1 < 1.2 * norms.0, "{what}: {norms:?}");
            dense.forget();
            local.forget();
        }
        tightness.sort_by(f64::total_cmp);
        let rms = (errors / values).sqrt();
        let predicted = predicted_error(&local);
        println!(
            "{what}: RMS error {rms:.1e} of f̂, estimate over error: least {:.1}, median {:.0}",
            tightness.first().copied().unwrap_or(f64::NAN),
            tightness.get(tightness.len() / 2).copied().unwrap_or(f64::NAN)
        );
        assert!(rms < largest_rms, "{what}: {rms:.1e}");
        // Of random updates everywhere; these histories are of other kinds too, some of them much smoother.
        assert!(rms < 5.0 * predicted && rms > 0.03 * predicted, "{what}: {rms:.1e}");
    }
}

fn learn_something(f: &mut LearnedFunction<3>, m: usize, n_updates: usize, seed: u64) {
    let mut numbers = Random(seed);
    for j in 0..n_updates {
        let y = output(1, j, m, &mut numbers);
        f.hold(&y);
        f.held();
        f.learn(&Vector3::from_fn(|axis, _| if axis < m { numbers.next() } else { 0.0 }));
    }
}

/// Outputs, function, and how much of a pending increment a truncated kernel leaves out.
fn one_of_each_kind() -> Vec<(usize, LearnedFunction<3>, f64)> {
    let scale = LengthScale::Isotropic(1.0);
    let truncated = Solver::Local(LocalSolver { block: Some(4), truncation: 1e-2, ..LocalSolver::default() });
    vec![
        (3, function(matern(3), &scale, &lattice(&[5; 3]), Solver::Dense), 0.0),
        (3, function(matern(3), &scale, &lattice(&[7, 8, 9]), block_of(4)), 0.0),
        (3, function(Kernel::WendlandC2, &scale, &lattice(&[9, 8, 7]), block_of(4)), 0.0),
        (3, function(matern(3), &LengthScale::Isotropic(0.3), &lattice(&[9; 3]), truncated), 1e-3),
        (2, function(matern(2), &scale, &lattice(&[12, 9]), block_of(4)), 0.0),
        (1, function(matern(1), &scale, &lattice(&[30]), block_of(6)), 0.0),
    ]
}

#[test]
fn a_pending_increment_counts_as_a_learned_one() {
    for (m, mut f, truncated) in one_of_each_kind() {
        let kind = f.solver();
        learn_something(&mut f, m, 50, 3);
        f.hold(&vec![0.4; m]);
        let held = f.held();
        let pending = Vector3::from_fn(|axis, _| if axis < m { 0.3 - 0.2 * axis as f64 } else { 0.0 });
        let points = [vec![0.4; m], vec![0.5; m], vec![-0.1; m], vec![1.9; m]];
        let before: Vec<_> = points.iter().map(|point| f.at(point, &pending).value).collect();
        f.learn(&pending);
        // A truncated kernel is pending as a whole.
        let tolerance = 1e-10 + truncated;
        for (point, before) in points.iter().zip(&before) {
            let after = f.at(point, &Vector3::zeros()).value;
            assert!((after - before).norm() < tolerance, "{kind:?} at {point:?}: {after} {before}");
        }
        // And at the held output it is φᵀφ in.
        assert!((before[0] - held.value - held.squared_features * pending).norm() < 1e-9, "{kind:?}");
    }
}

#[test]
fn a_checkpoint_comes_back_to_the_bit_and_what_is_forgotten_is_gone() {
    for (m, mut f, _) in one_of_each_kind() {
        let bits = |f: &mut LearnedFunction<3>| {
            let mut numbers = Random(9);
            let at: Vec<_> = (0..50).map(|_| f.at(&numbers.point(2.0, m), &Vector3::zeros()).value).collect();
            format!("{at:?} {}", f.native_norm())
        };
        let nothing = bits(&mut f);
        learn_something(&mut f, m, 40, 4);
        f.save();
        let saved_bits = bits(&mut f);
        learn_something(&mut f, m, 40, 5);
        assert_ne!(bits(&mut f), saved_bits);
        f.restore();
        assert_eq!(bits(&mut f), saved_bits);
        // Once more, from a copy of which only a part is new.
        learn_something(&mut f, m, 2, 6);
        f.save();
        let better = bits(&mut f);
        learn_something(&mut f, m, 30, 7);
        f.restore();
        assert_eq!(bits(&mut f), better);
        f.forget();
        assert_eq!(bits(&mut f), nothing);
        f.restore();
        assert_eq!(bits(&mut f), better, "a mistake can be taken back");
        // What was saved is read in parts, and another function of the same design takes it over.
        let mut saved = vec![0.0; f.n_learned()];
        let part = saved.len() / 3 + 1;
        saved.chunks_mut(part).enumerate().for_each(|(j, chunk)| f.read_saved(j * part, chunk));
        let mut other = f.clone();
        other.forget();
        other.save();
        learn_something(&mut other, m, 10, 8);
        other.load(&saved);
        assert_eq!(bits(&mut other), better);
        learn_something(&mut other, m, 10, 9);
        learn_something(&mut f, m, 10, 9);
        assert_eq!(bits(&mut other), bits(&mut f), "and learns on from there");
        other.restore();
        assert_eq!(bits(&mut other), better);
    }
}
