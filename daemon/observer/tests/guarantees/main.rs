//! The claims of the theorems, tested on the law itself: where they hold, how sharp they are, and where they fail; and
//! properties of every space and every step.
//!
//! | file | what |
//! |---|---|
//! | `native_function`, `reference_law`, `lyapunov_function` | the paper's objects that only tests need: elements of H, the law in H, V and V' |
//! | `bounds`, `convergence`, `lyapunov` | E₀ and d_N, the convergence of the centers, V along the law's samples |
//! | `designs` | designs and random numbers, shared with the unit tests |
//! | `properties`, `reference_tables` | spaces and kernels, on random ones and against mpmath and SciPy |
//! | `noise_growth` | how the norm of f̂ grows under noise, with φ at the output and at the estimate, and bounded |
//! | `no_allocation` | steps allocate nothing |
//!
//! Measured figures are printed: `cargo test -p observer --test guarantees -- --nocapture`.

mod bounds;
mod convergence;
mod designs;
mod flight;
mod lyapunov;
mod lyapunov_function;
mod native_function;
mod no_allocation;
mod noise_growth;
mod properties;
mod reference_law;
mod reference_tables;

use designs::{Random, body_channel as channel};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use observer::{BodyChannel, ChannelDesign, DeadZone, DeadZoneShape, Moment, NativeSpace};

/// δ̄ of the paper's translation: 0.008 √2 on each of three axes (m/s).
const NOISE_BOUND: f64 = 0.019_596;

fn zone(shape: DeadZoneShape, width: f64) -> DeadZone {
    DeadZone::new(shape, width, 0.01).unwrap()
}

/// A step of a channel, of which the output teaches or not.
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
