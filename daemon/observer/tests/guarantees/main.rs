//! The claims of the theorems, tested on the law itself: where they hold, how sharp they are, and where they fail; and
//! properties of every space and every step.
//!
//! | file | what |
//! |---|---|
//! | `native_function`, `reference_law`, `lyapunov_function` | the paper's objects that only tests need: elements of H, the law in H, V and V' |
//! | `bounds`, `convergence`, `lyapunov` | E₀ and d_N, the convergence of the centers, V along the law's samples |
//! | `properties`, `reference_tables` | spaces and kernels, on random ones and against mpmath and SciPy |
//! | `no_allocation` | steps allocate nothing |
//!
//! Measured figures are printed: `cargo test -p observer --test guarantees -- --nocapture`.

mod bounds;
mod convergence;
mod flight;
mod lyapunov;
mod lyapunov_function;
mod native_function;
mod no_allocation;
mod properties;
mod reference_law;
mod reference_tables;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use observer::{
    BodyChannel, Centers, ChannelDesign, DeadZone, DeadZoneShape, DisturbanceBounds, Kernel, LengthScale,
    Moment, NativeSpace, Solver,
};

/// δ̄ of the paper's translation: 0.008 √2 on each of three axes (m/s).
const NOISE_BOUND: f64 = 0.019_596;

fn zone(shape: DeadZoneShape, width: f64) -> DeadZone {
    DeadZone::new(shape, width, 0.01).unwrap()
}

/// The paper's translation but for inertia, rate and dead zone: 27 centers on [−1, 1]³, λ = 10 1/s.
fn channel(inertia: Matrix3<f64>, adaptation_rate: Matrix3<f64>, dead_zone: DeadZone) -> ChannelDesign {
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
        bounds: DisturbanceBounds::default(),
        hold_s: 0.0075,
        coast_step_s: 0.005,
    }
}

/// A step of a channel that learns from its output or not.
fn step(channel: &mut BodyChannel, output: &Vector3<f64>, input: &Vector3<f64>, (h_s, teaches): (f64, bool)) {
    channel.observe(output, teaches);
    let ahead = channel.predict(input, h_s);
    channel.commit(&ahead.learning, Moment { stamp_ns: 0, state: ahead.state });
}

fn space_of(design: &ChannelDesign) -> NativeSpace {
    NativeSpace::new(design.kernel, &design.length_scale, design.centers.clone(), design.nugget).unwrap()
}

fn isotropic(entry: f64) -> Matrix3<f64> {
    Matrix3::identity() * entry
}

fn full_inertia() -> Matrix3<f64> {
    Matrix3::new(4.0, 1.5, 0.0, 1.5, 3.0, 0.2, 0.0, 0.2, 5.0)
}

/// Does not commute with [`full_inertia`].
fn full_rate() -> Matrix3<f64> {
    Matrix3::new(80.0, 30.0, 0.0, 30.0, 120.0, -40.0, 0.0, -40.0, 100.0)
}

fn dynamic(matrix: &Matrix3<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(3, 3, matrix.as_slice())
}

fn vector(v: &Vector3<f64>) -> DVector<f64> {
    DVector::from_column_slice(v.as_slice())
}

/// Numbers in [−1, 1), the same in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.next())
    }

    fn vector3(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next())
    }
}
