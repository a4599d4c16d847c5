use super::*;
use crate::designs::Random;
use crate::function::dense::DenseFunction;
use nalgebra::Vector3;

const MATERN: fn(usize) -> Kernel =
    |dimension| Kernel::SobolevMatern { dimension, order: dimension.div_ceil(2) + 1 };

fn both(
    kernel: Kernel,
    length_scale: &LengthScale,
    per_axis: &[usize],
    options: LocalSolver,
) -> (DenseFunction<3>, LatticeFunction<3>) {
    let m = per_axis.len();
    let centers = Centers::lattice(vec![-2.0; m], vec![2.0; m], per_axis).unwrap();
    let space = NativeSpace::new(kernel, length_scale, centers.clone(), 0.0).unwrap();
    let local = LatticeFunction::zero((kernel, length_scale), &centers, 0.0, &options).unwrap();
    (DenseFunction::zero(space), local)
}

fn block_of(points: usize) -> LocalSolver {
    LocalSolver { block: Some(points), ..LocalSolver::default() }
}

/// β after one update is k(y) in at every center, and f̂ at a center is its nodal value.
#[test]
fn an_update_is_exact_at_every_center() {
    for (kernel, support) in [(Kernel::WendlandC2, 2.1), (Kernel::WendlandC4, 1.0), (MATERN(3), 1.0)] {
        let length_scale = LengthScale::PerAxis(vec![support, 0.8 * support, 1.2 * support]);
        let centers = Centers::lattice([-2.0; 3], [2.0; 3], [9, 6, 11]).unwrap();
        let kappa = ScaledKernel::new(kernel, &length_scale, 3).unwrap();
        for y in [[0.3, -0.2, 0.9], [1.99, -1.9, 2.0], [-2.5, 0.0, 2.2], [-2.0, -2.0, -2.0]] {
            let mut local =
                LatticeFunction::<3>::zero((kernel, &length_scale), &centers, 0.0, &block_of(4)).unwrap();
            let increment = Vector3::new(1.0, -2.0, 0.5);
            local.hold(&y);
            local.held();
            local.learn(&increment);
            for center in centers.points() {
                let found = local.at(center, &Vector3::zeros());
                let expected = kappa.value(&y, center) * increment;
                assert!((found.value - expected).norm() < 1e-9, "{kernel:?} {y:?} at {center:?}");
                assert!(found.error < 1e-6 * increment.norm(), "no error at a center: {}", found.error);
            }
        }
    }
}

/// A truncated kernel omits a part of every update; the error estimate includes it.
#[test]
fn what_a_truncated_kernel_drops_is_within_the_estimate() {
    let length_scale = LengthScale::Isotropic(0.4);
    let options = LocalSolver { truncation: 1e-3, ..block_of(6) };
    let (mut dense, mut local) = both(MATERN(3), &length_scale, &[9; 3], options);
    assert!(local.geometry.reach > 8.0 && local.geometry.reach < 12.0, "{}", local.geometry.reach);
    let mut numbers = Random(11);
    for _ in 0..200 {
        let y = numbers.point(1.9, 3);
        let increment = Vector3::from_fn(|_, _| numbers.next().abs());
        dense.hold(&y);
        local.hold(&y);
        local.held();
        dense.learn(&increment);
        local.learn(&increment);
    }
    let mut largest = 0.0_f64;
    for _ in 0..200 {
        let point = numbers.point(2.0, 3);
        let (exact, found) = (dense.at(&point, &Vector3::zeros()), local.at(&point, &Vector3::zeros()));
        let error = (exact.value - found.value).norm();
        assert!(error <= found.error, "{error:e} > {:e}", found.error);
        largest = largest.max(error / found.error);
    }
    assert!(largest > 1e-4, "the estimate is not vacuous: {largest:e}");
}

/// A truncated update costs what the kernel reaches, not what the lattice holds.
#[test]
fn an_update_touches_only_what_the_kernel_reaches() {
    let centers = Centers::lattice([-2.0; 3], [2.0; 3], [17; 3]).unwrap();
    let kernel = (Kernel::WendlandC2, &LengthScale::Isotropic(1.0));
    let mut local = LatticeFunction::<3>::zero(kernel, &centers, 0.0, &block_of(4)).unwrap();
    local.hold(&[0.13, 0.21, 0.3]);
    local.held();
    local.learn(&Vector3::new(1.0, 1.0, 1.0));
    // Rows within one length scale, four spacings, of the output.
    let expected = (0..17 * 17)
        .filter(|row| {
            let at = |i: usize| -2.0 + 0.25 * i as f64;
            (at(row / 17) - 0.13).hypot(at(row % 17) - 0.21) < 1.0
        })
        .count();
    assert_eq!(local.touched_rows.listed().len(), expected);
}

#[test]
fn what_the_local_solver_cannot_do_is_refused_with_the_reason() {
    let zero = |centers: &Centers, kernel, options| {
        let length_scale = LengthScale::Isotropic(1.0);
        LatticeFunction::<6>::zero((kernel, &length_scale), centers, 0.0, &options).unwrap_err().to_string()
    };
    let cube = Centers::lattice([-1.0; 3], [1.0; 3], [9; 3]).unwrap();
    let listed = Centers::listed([[0.0; 3], [1.0; 3]]).unwrap();
    let hyper = Centers::lattice([-1.0; 4], [1.0; 4], [3; 4]).unwrap();
    assert!(zero(&listed, MATERN(3), block_of(4)).contains("listed centers"));
    assert!(zero(&hyper, Kernel::Gaussian, block_of(4)).contains("4 outputs"));
    assert!(zero(&cube, MATERN(3), block_of(5)).contains("a block of 5"));
    assert!(zero(&cube, MATERN(3), LocalSolver { accuracy: 0.0, ..block_of(4) }).contains("accuracy"));
    assert!(zero(&cube, MATERN(3), LocalSolver { truncation: 1.0, ..block_of(4) }).contains("truncation"));
    assert!(zero(&cube, Kernel::Gaussian, block_of(6)).contains("not numerically positive definite"));
}

/// The default block is the smallest that reaches the accuracy; on a lattice no larger than a block all is exact.
#[test]
fn the_block_is_chosen_by_the_accuracy() {
    let choose = |per_axis: &[usize], accuracy| {
        let options = LocalSolver { accuracy, ..LocalSolver::default() };
        both(MATERN(per_axis.len()), &LengthScale::Isotropic(1.0), per_axis, options).1
    };
    assert_eq!(choose(&[9; 3], 5e-3).block(), [4; 3]);
    assert_eq!(choose(&[9; 3], 1e-3).block(), [6; 3]);
    assert_eq!(choose(&[9; 3], 1e-9).block(), [8; 3], "the largest that is tried");
    assert_eq!(choose(&[9, 3, 5], 1e-3).block(), [6, 3, 5]);
    let whole = choose(&[4, 4, 3], 1e-3);
    assert_eq!((whole.block(), whole.predicted_error()), (vec![4, 4, 3], 0.0));
}
