use super::*;
use crate::function::dense::DenseFunction;
use nalgebra::Vector3;

const KERNEL: Kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };

fn paper() -> NativeSpace {
    let centers = Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap();
    NativeSpace::new(KERNEL, &LengthScale::Isotropic(1.0), centers, 0.0).unwrap()
}

fn features(space: &NativeSpace, y: [f64; 3]) -> (Vec<f64>, f64) {
    let mut buffers = FeatureBuffers::new(space);
    let squares = space.features(&y, &mut buffers);
    (buffers.features().to_vec(), squares)
}

#[test]
fn the_papers_lattice_has_the_known_condition() {
    let space = paper();
    let eigenvalues = space.gram().symmetric_eigenvalues();
    let exact = eigenvalues.max() / eigenvalues.min();
    assert!((exact - 291.7).abs() < 0.05, "{exact}");
    assert!((space.gram_condition() / exact - 1.0).abs() < 1e-4, "{}", space.gram_condition());
}

/// φᵀφ = kᵀ K⁻¹ k, with K⁻¹k from nalgebra's LU and not from our factor.
#[test]
fn the_features_are_orthonormal() {
    let space = paper();
    let gram = space.gram();
    for y in [[0.1, 0.2, -0.7], [0.9, -0.9, 0.4], [3.0, 0.0, 0.0], [1.0, 1.0, 1.0]] {
        let (phi, squares) = features(&space, y);
        let k = DMatrix::from_vec(27, 1, space.kernel_vector(&y));
        let expected = k.dot(&gram.clone().lu().solve(&k).unwrap());
        assert!((squares - expected).abs() < 1e-12, "{y:?}");
        assert!((phi.iter().map(|x| x * x).sum::<f64>() - expected).abs() < 1e-12, "{y:?}");
    }
}

/// The power function vanishes at a center and nears √κ(0) far away.
#[test]
fn the_power_function_measures_cover() {
    let space = paper();
    let power = |y: [f64; 3]| space.power_function(features(&space, y).1);
    assert!(power([1.0, 0.0, -1.0]) < 1e-6);
    assert!((power([60.0, 0.0, 0.0]) - space.value_at_zero().sqrt()).abs() < 1e-12);
    // Its supremum over the lattice's box, at the middle of a cell: 0.443.
    assert!((power([0.5, 0.5, 0.5]) - 0.443).abs() < 5e-4, "{}", power([0.5; 3]));
}

#[test]
fn equal_or_nearly_equal_centers_are_refused_by_name() {
    for gap in [0.0, 1e-12] {
        let centers = Centers::listed([[0.0; 3], [1.0, 0.0, 0.0], [1.0, gap, 0.0]]).unwrap();
        let error =
            NativeSpace::new(KERNEL, &LengthScale::Isotropic(1.0), centers, 0.0).unwrap_err().to_string();
        assert!(error.contains("centers 2 and 3"), "{error}");
    }
    let centers = Centers::listed([[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]).unwrap();
    assert!(NativeSpace::new(KERNEL, &LengthScale::Isotropic(1.0), centers, 1e-8).is_ok(), "a nugget helps");
}

/// Lattices of one, two and three axes with several points, even and odd; kernels and nuggets.
fn mirrored_cases() -> Vec<(Kernel, LengthScale, Centers, f64)> {
    let three =
        |per_axis: [usize; 3]| Centers::lattice([-1.0, 0.5, -2.0], [1.0, 2.0, 2.5], per_axis).unwrap();
    let per_axis = || LengthScale::PerAxis(vec![0.4, 0.3, 0.8]);
    let matern = |dimension, order| Kernel::SobolevMatern { dimension, order };
    vec![
        (matern(3, 3), per_axis(), three([4; 3]), 0.0),
        (matern(3, 2), per_axis(), three([6, 5, 4]), 0.0),
        (Kernel::WendlandC2, LengthScale::Isotropic(2.0), three([7; 3]), 0.0),
        (Kernel::Gaussian, LengthScale::Isotropic(0.5), three([6, 1, 6]), 1e-6),
        (Kernel::Gaussian, per_axis(), three([3, 5, 2]), 1e-6),
        (
            matern(2, 2),
            LengthScale::PerAxis(vec![0.3, 0.2]),
            Centers::lattice([0.0; 2], [2.0, 1.0], [12, 9]).unwrap(),
            0.0,
        ),
        (matern(1, 2), LengthScale::Isotropic(0.2), Centers::lattice([-1.0], [1.0], [30]).unwrap(), 0.0),
        (
            matern(4, 4),
            LengthScale::Isotropic(1.0),
            Centers::lattice([-1.0; 4], [1.0; 4], [3, 1, 2, 4]).unwrap(),
            1e-8,
        ),
    ]
}

fn both_ways(case: &(Kernel, LengthScale, Centers, f64)) -> [NativeSpace; 2] {
    let (kernel, scale, centers, nugget) = case;
    [true, false].map(|is_mirrored| {
        let space =
            NativeSpace::with_mirrors_where(*kernel, scale, centers.clone(), *nugget, |_| is_mirrored);
        let space = space.unwrap();
        assert_eq!(matches!(space.inverse_factor, InverseFactor::Mirrored(_)), is_mirrored);
        space
    })
}

/// Points in and around the box, some of them centers.
fn queries(space: &NativeSpace, n: usize) -> Vec<Vec<f64>> {
    let (lower, upper) = space.bounding_box();
    let anywhere = (0..n).map(|q| {
        let at = |axis: usize| ((q * 7919 + axis * 3571 + 13) % 1009) as f64 / 1009.0;
        let point = |axis: usize| lower[axis] + (1.4 * at(axis) - 0.2) * (upper[axis] - lower[axis] + 0.1);
        (0..lower.len()).map(point).collect()
    });
    anywhere.chain(space.centers().points().step_by(17).map(<[f64]>::to_vec)).collect()
}

/// φᵀφ and all coordinates against nalgebra's LU of the whole Gram matrix.
#[test]
fn in_mirror_images_it_is_the_same_native_space() {
    for case in mirrored_cases() {
        let [space, whole] = both_ways(&case);
        let n = space.n_centers();
        let gram = space.gram() + DMatrix::identity(n, n) * (case.3 * space.value_at_zero());
        let lu = gram.clone().lu();
        let mut buffers = FeatureBuffers::new(&space);
        for y in queries(&space, 20) {
            let k = DMatrix::from_vec(n, 1, space.kernel_vector(&y));
            for (k, xi) in k.iter().zip(space.centers().points()) {
                assert!((k - space.kernel().value(xi, &y)).abs() < 1e-12, "{case:?}");
            }
            let expected = k.dot(&lu.solve(&k).unwrap());
            let squares = space.features(&y, &mut buffers);
            assert!((squares - expected).abs() < 1e-9, "{case:?}: {squares} {expected}");
            let sum: f64 = buffers.features().iter().map(|phi| phi * phi).sum();
            assert!((squares - sum).abs() < 1e-12 * (1.0 + sum), "{case:?}");
        }
        let beta = DMatrix::from_fn(n, 2, |i, column| ((i * (3 + column)) as f64 * 0.7).sin());
        let alpha = lu.solve(&beta).unwrap();
        let theta = space.weights_of_nodal_values(&beta);
        assert!(theta.iter().all(|theta| theta.len() == space.n_padded()));
        assert!((space.nodal_values(&theta) - &beta).amax() < 1e-9, "{case:?}");
        assert!((space.coefficients(&theta) - &alpha).amax() < 1e-9 * (1.0 + alpha.amax()), "{case:?}");
        let norm = alpha.dot(&(gram * &alpha)).sqrt();
        let found = theta.iter().flatten().map(|theta| theta * theta).sum::<f64>().sqrt();
        assert!((found / norm - 1.0).abs() < 1e-9, "{case:?}: {found} {norm}");
        assert!((space.gram_condition() / whole.gram_condition() - 1.0).abs() < 1e-4, "{case:?}");
        // The search takes thousands of evaluations of both.
        if n > 64 || space.centers().dimension() > 3 {
            continue;
        }
        let (found, expected) = (space.sup_power_function(), whole.sup_power_function());
        assert!((found.value - expected.value).abs() < 1e-6, "{case:?}: {found:?} {expected:?}");
        let (found, expected) = (space.fill_distance(), whole.fill_distance());
        assert!((found.value - expected.value).abs() < 1e-12, "{case:?}: {found:?} {expected:?}");
    }
}

#[test]
fn in_mirror_images_the_same_function_is_learned() {
    for case in mirrored_cases().into_iter().filter(|case| case.2.dimension() <= 3) {
        let [mut mirrored, mut whole] = both_ways(&case).map(DenseFunction::<3>::zero);
        let points = queries(whole.space(), 200);
        for (step, y) in points.iter().enumerate() {
            let increment = Vector3::new(0.3, -0.2, 0.1) * (step as f64).cos();
            for function in [&mut mirrored, &mut whole] {
                function.hold(y);
                function.learn(&increment);
            }
        }
        let none = Vector3::zeros();
        let norm = whole.native_norm();
        assert!((mirrored.native_norm() / norm - 1.0).abs() < 1e-9, "{case:?}");
        for y in points.iter().step_by(7) {
            let (found, expected) = (mirrored.at(y, &none).value, whole.at(y, &none).value);
            assert!(
                (found - expected).amax() < 1e-9 * (1.0 + expected.amax()),
                "{case:?}: {found} {expected}"
            );
        }
    }
}

#[test]
fn mirror_images_are_used_where_they_pay() {
    let is_mirrored = |centers: Centers| {
        let scale = LengthScale::Isotropic(0.5);
        let kernel = Kernel::SobolevMatern { dimension: 3, order: 2 };
        let space = NativeSpace::new(kernel, &scale, centers, 0.0).unwrap();
        matches!(space.inverse_factor, InverseFactor::Mirrored(_))
    };
    let lattice = |per_axis: [usize; 3]| Centers::lattice([-1.0; 3], [1.0; 3], per_axis).unwrap();
    for per_axis in [[1; 3], [3; 3], [5, 5, 3], [1, 1, 30]] {
        assert!(!is_mirrored(lattice(per_axis)), "{per_axis:?}");
    }
    for per_axis in [[6; 3], [7; 3], [20, 1, 20]] {
        assert!(is_mirrored(lattice(per_axis)), "{per_axis:?}");
    }
    let listed: Vec<Vec<f64>> = lattice([6; 3]).points().map(<[f64]>::to_vec).collect();
    assert!(!is_mirrored(Centers::listed(listed).unwrap()), "no order of listed centers is known");
}

#[test]
fn a_lattice_too_narrow_is_refused_with_its_closest_pair_as_a_whole_one_is() {
    let centers = Centers::lattice([0.0; 3], [0.2, 1.0, 1.0], [6; 3]).unwrap();
    let scale = LengthScale::Isotropic(2.0);
    let errors = [true, false].map(|is_mirrored| {
        let space =
            NativeSpace::with_mirrors_where(Kernel::Gaussian, &scale, centers.clone(), 0.0, |_| is_mirrored);
        space.unwrap_err().to_string()
    });
    // Which of the pairs that are equally close depends on rounding, and is the same for both.
    assert!(errors[0].contains("closest pair, centers ") && errors[0].contains("is 2.000e-2 length scales"));
    assert_eq!(errors[0], errors[1], "the condition as well");
}
