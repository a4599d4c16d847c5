//! Properties of any centers, kernel and history, tested with random ones.

use crate::native_function::NativeFunction;
use nalgebra::{DMatrix, DVector};
use observer::{Centers, FeatureBuffers, Kernel, LengthScale, NativeSpace};
use proptest::prelude::*;

/// A kernel with the dimension it lives on.
fn kernels() -> impl Strategy<Value = (Kernel, usize)> {
    prop_oneof![
        (1_usize..=4, 1_usize..=3).prop_map(|(dimension, above)| {
            (Kernel::SobolevMatern { dimension, order: dimension / 2 + above }, dimension)
        }),
        (1_usize..=3).prop_map(|dimension| (Kernel::Gaussian, dimension)),
        (1_usize..=3).prop_map(|dimension| (Kernel::WendlandC2, dimension)),
        (1_usize..=3).prop_map(|dimension| (Kernel::WendlandC4, dimension)),
    ]
}

/// A space on 2 to 12 random centers in [−2, 2]^d, with a length scale of its own on each axis.
fn spaces() -> impl Strategy<Value = NativeSpace> {
    let coordinate = -2.0_f64..2.0;
    (
        kernels(),
        proptest::collection::vec(proptest::collection::vec(coordinate, 4), 2..12),
        proptest::collection::vec(0.4_f64..2.0, 4),
    )
        .prop_filter_map("centers too close for this kernel", |((kernel, dimension), points, scales)| {
            let points: Vec<_> = points.into_iter().map(|point| point[..dimension].to_vec()).collect();
            let centers = Centers::listed(points).ok()?;
            let scale = LengthScale::PerAxis(scales[..dimension].to_vec());
            // What cannot be factored well cannot be compared to many digits either.
            NativeSpace::new(kernel, &scale, centers, 0.0).ok().filter(|s| s.gram_condition() < 1e6)
        })
}

fn points(n: usize) -> impl Strategy<Value = Vec<Vec<f64>>> {
    proptest::collection::vec(proptest::collection::vec(-2.5_f64..2.5, 4), n)
}

fn kernel_vector(space: &NativeSpace, y: &[f64]) -> DVector<f64> {
    DVector::from_vec(space.kernel_vector(y))
}

/// φ(y) by the library.
fn features(space: &NativeSpace, y: &[f64]) -> Vec<f64> {
    let mut buffers = FeatureBuffers::new(space);
    space.features(y, &mut buffers);
    buffers.features()[..space.n_centers()].to_vec()
}

/// θᵀφ(y) by the library's own features.
fn value_by_weights(space: &NativeSpace, weights: &[Vec<f64>], y: &[f64]) -> Vec<f64> {
    let phi = features(space, y);
    weights.iter().map(|theta| theta.iter().zip(&phi).map(|(a, b)| a * b).sum()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// The law in all three coordinates on the same samples: α̂ += K⁻¹k a, β += k a, θ += φ a.
    #[test]
    fn the_three_coordinates_are_one_function(
        space in spaces(),
        samples in points(20),
        increments in proptest::collection::vec(proptest::collection::vec(-1.0_f64..1.0, 2), 20),
        queries in points(4),
    ) {
        let (n, d) = (space.n_centers(), space.centers().dimension());
        let gram = space.gram().lu();
        let (mut alpha, mut beta) = (DMatrix::zeros(n, 2), DMatrix::zeros(n, 2));
        let mut theta = vec![vec![0.0; n]; 2];
        for (y, a) in samples.iter().zip(&increments) {
            let k = kernel_vector(&space, &y[..d]);
            let a = DVector::from_column_slice(a);
            alpha += gram.solve(&k).unwrap() * a.transpose();
            beta += &k * a.transpose();
            let phi = features(&space, &y[..d]);
            for (theta, a) in theta.iter_mut().zip(&a) {
                theta.iter_mut().zip(&phi).for_each(|(theta, phi)| *theta += a * phi);
            }
        }
        let scale = 1.0 + beta.amax();
        // Condition 1e6 times 1e-16, with room.
        let tolerance = 1e-8 * (1.0 + alpha.amax());
        prop_assert!((space.coefficients(&theta) - &alpha).amax() < tolerance);
        prop_assert!((space.nodal_values(&theta) - &beta).amax() < 1e-9 * scale);
        for (back, theta) in space.weights_of_nodal_values(&beta).iter().zip(&theta) {
            prop_assert!(back.iter().zip(theta).all(|(a, b)| (a - b).abs() < 1e-8 * scale));
        }
        let norm = (alpha.transpose() * space.gram() * &alpha).trace().max(0.0).sqrt();
        let theta_norm = theta.iter().flatten().map(|t| t * t).sum::<f64>().sqrt();
        prop_assert!((norm - theta_norm).abs() < 1e-8 * (1.0 + norm));
        let function = NativeFunction::of(&space, &theta);
        prop_assert!((function.norm() - theta_norm).abs() < 1e-7 * (1.0 + norm));
        for y in &queries {
            let k = kernel_vector(&space, &y[..d]);
            let by_alpha = alpha.tr_mul(&k);
            let by_beta = beta.tr_mul(&gram.solve(&k).unwrap());
            let by_theta = value_by_weights(&space, &theta, &y[..d]);
            let by_function = function.value(&y[..d]);
            for axis in 0..2 {
                prop_assert!((by_alpha[axis] - by_theta[axis]).abs() < tolerance);
                prop_assert!((by_beta[axis] - by_theta[axis]).abs() < tolerance);
                prop_assert!((by_function[axis] - by_theta[axis]).abs() < tolerance);
            }
        }
    }

    /// Niu et al., §II: ⟨E_y* a, f⟩_H = aᵀ f(y).
    #[test]
    fn the_adjoint_of_evaluation_evaluates(
        space in spaces(),
        terms in points(5),
        coefficients in proptest::collection::vec(proptest::collection::vec(-1.0_f64..1.0, 3), 5),
        y in points(1),
        a in proptest::collection::vec(-1.0_f64..1.0, 3),
    ) {
        let d = space.centers().dimension();
        let kernel = space.kernel().clone();
        let mut f = NativeFunction::zero(kernel.clone(), 3);
        for (z, b) in terms.iter().zip(&coefficients) {
            f.add(&z[..d], b);
        }
        let adjoint = NativeFunction::evaluation_adjoint(kernel, &y[0][..d], &a);
        let value: f64 = f.value(&y[0][..d]).iter().zip(&a).map(|(f, a)| f * a).sum();
        prop_assert!((adjoint.inner_product(&f) - value).abs() < 1e-12 * (1.0 + f.norm()));
        prop_assert!((f.inner_product(&adjoint) - value).abs() < 1e-12 * (1.0 + f.norm()));
    }

    /// Π_N f agrees with f at the centers, f − Π_N f is orthogonal to it, and the power function bounds what
    /// is left: ‖E_y (I − Π_N) f‖ ≤ P_N(y) ‖(I − Π_N) f‖_H.
    #[test]
    fn the_projection_is_one_and_the_power_function_bounds_its_error(
        space in spaces(),
        terms in points(6),
        coefficients in proptest::collection::vec(proptest::collection::vec(-1.0_f64..1.0, 2), 6),
        queries in points(6),
    ) {
        let d = space.centers().dimension();
        let mut f = NativeFunction::zero(space.kernel().clone(), 2);
        for (z, a) in terms.iter().zip(&coefficients) {
            f.add(&z[..d], a);
        }
        let projected = NativeFunction::projected(&space, &f);
        let rest = f.minus(&projected);
        for xi in space.centers().points() {
            prop_assert!(rest.value(xi).iter().all(|left| left.abs() < 1e-8));
        }
        prop_assert!(rest.inner_product(&projected).abs() < 1e-7 * (1.0 + f.norm().powi(2)));
        for y in &queries {
            let left = rest.value(&y[..d]).iter().map(|r| r * r).sum::<f64>().sqrt();
            let bound = space.power_function_at(&y[..d]) * rest.norm();
            prop_assert!(left <= bound * (1.0 + 1e-6) + 1e-7, "{left} > {bound}");
        }
    }

    /// Symmetric, and every Gram matrix positive definite.
    #[test]
    fn kernels_are_symmetric_and_positive_definite(space in spaces(), pair in points(2)) {
        let d = space.centers().dimension();
        let (a, b) = (&pair[0][..d], &pair[1][..d]);
        prop_assert_eq!(space.kernel().value(a, b).to_bits(), space.kernel().value(b, a).to_bits());
        prop_assert_eq!(space.kernel().value(a, a), space.value_at_zero());
        prop_assert!(space.gram().symmetric_eigenvalues().min() > 0.0);
    }
}

#[test]
fn kernels_that_are_not_positive_definite_are_refused() {
    for (kernel, dimension) in [
        (Kernel::SobolevMatern { dimension: 3, order: 1 }, 3),
        (Kernel::SobolevMatern { dimension: 4, order: 2 }, 4),
        (Kernel::SobolevMatern { dimension: 2, order: 3 }, 3),
        (Kernel::WendlandC2, 4),
        (Kernel::WendlandC4, 5),
    ] {
        assert!(kernel.radial(dimension).is_err(), "{kernel:?}");
    }
}
