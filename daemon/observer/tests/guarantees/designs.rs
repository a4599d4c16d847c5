//! Designs and random numbers for all tests of the crate; `src/lib.rs` includes this file for its unit tests.
#![allow(dead_code)] // each of the two programs uses its part

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use observer::{
    Centers, ChannelDesign, DeadZone, DeadZoneShape, DisturbanceBounds, ExcitationDesign, GradientOptions,
    JointDesign, Kernel, LengthScale, LinearDesign, PriorDeviations, Solver,
};

/// The paper's translation but for inertia, rate and dead zone: 27 centers on [−1, 1]³, λ = 10 1/s.
pub(crate) fn body_channel(
    inertia: Matrix3<f64>,
    adaptation_rate: Matrix3<f64>,
    dead_zone: DeadZone,
) -> ChannelDesign {
    ChannelDesign {
        kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
        length_scale: LengthScale::Isotropic(1.0),
        centers: Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap(),
        nugget: 0.0,
        solver: Solver::Dense,
        inertia,
        gain_per_s: 10.0,
        adaptation_rate,
        dead_zone,
        options: GradientOptions::default(),
        bounds: DisturbanceBounds::default(),
        hold_s: 0.0075,
        coast_step_s: 0.005,
    }
}

/// A mass on a spring whose sensor mixes position and velocity, so that the transfer function
/// (s + 2)/(s² + …) is strictly positive real: x = (r, v), m = 2.
pub(crate) fn oscillator() -> LinearDesign {
    LinearDesign {
        a: matrix(2, &[0.0, 1.0, -3.0, -0.2]),
        b: matrix(2, &[0.0, 0.5]),
        c: matrix(1, &[2.0, 1.0]),
        gain: matrix(2, &[1.0, 8.0]),
        kernel: Kernel::SobolevMatern { dimension: 1, order: 2 },
        length_scale: LengthScale::Isotropic(1.0),
        centers: Centers::lattice([-3.0], [3.0], [13]).unwrap(),
        nugget: 0.0,
        solver: Solver::Dense,
        adaptation_rate: matrix(1, &[50.0]),
        dead_zone: DeadZone::new(DeadZoneShape::Saturated, 1e-4, 1e-4).unwrap(),
        options: GradientOptions::default(),
        bounds: DisturbanceBounds::default(),
        hold_s: 0.0075,
        coast_step_s: 0.005,
        initial_state: Some(DVector::from_vec(vec![0.5, 0.0])),
    }
}

/// The joint law of the paper's first example with the defaults of the translation: docs/method.md §10. Noise in m/s.
pub(crate) fn joint_law(noise: [f64; 3]) -> JointDesign {
    JointDesign {
        kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
        length_scale: LengthScale::Isotropic(2.2),
        centers: Centers::lattice([-2.2; 3], [2.2; 3], [3; 3]).unwrap(),
        prior: PriorDeviations {
            bias: 0.5,
            linear: 0.3,
            kernel: 0.35,
            input: 0.15,
            lag: 0.3,
            disturbance: 0.1,
        },
        disturbance_time_s: 0.2,
        process_noise: 1.5e-3,
        motion_memory_s: 300.0,
        input_memory_s: 3600.0,
        lags_s: [0.05, 0.2],
        noise,
        position_noise: None,
        body_axes: None,
        accelerometer: None,
        noise_samples: 500.0,
        excitation: ExcitationDesign {
            correction_share: 0.3,
            mean_time_s: 5.0,
            variation_time_s: 0.2,
            idle_rate: 0.05,
        },
    }
}

pub(crate) fn matrix(rows: usize, entries: &[f64]) -> DMatrix<f64> {
    DMatrix::from_row_slice(rows, entries.len() / rows, entries)
}

/// Numbers in [−1, 1), the same in every run.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Of deviation 1, nearly normal.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() * 0.5
    }

    pub(crate) fn point(&mut self, half: f64, m: usize) -> Vec<f64> {
        (0..m).map(|_| half * self.next()).collect()
    }

    pub(crate) fn vector3(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next())
    }

    pub(crate) fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.next())
    }

    /// G Gᵀ + floor·I.
    pub(crate) fn positive(&mut self, n: usize, floor: f64) -> DMatrix<f64> {
        let g = self.matrix(n, n);
        &g * g.transpose() + floor * DMatrix::identity(n, n)
    }
}
