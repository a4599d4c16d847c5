//! The sampled-data stability bound of the law over a general linear plant. [`crate::stability`] has that of a rigid body.

use crate::linear_design::{LinearDesign, ObservablePart};
use crate::plant::linear::{held_integral, padded};
use crate::plant::linear_algebra::{eigenvalues, spectral_abscissa, spectral_norm};
use nalgebra::{Complex, DMatrix};

/// The largest σ φᵀφ (1/s²) that keeps the sampled law stable for every step up to the longest hold; 0 if none does.
///
/// With the output frozen at y, the errors e of the state and F of the matched input follow, on the observable part,
///
/// ```text
/// F⁺ = F − s Γ_f C e,    e⁺ = e^{A_e h} e + ∫₀^h e^{A_e τ} dτ B F⁺,    s = h σ φᵀφ
/// ```
///
/// The bound is where the spectral radius of this map first exceeds 1; it has no closed form here. It is searched
/// on a grid of steps, fine against the fastest oscillation of A_e, and in the limit of short steps, that of the
/// continuous law.
pub(crate) fn largest_learning_of_every_step(design: &LinearDesign) -> f64 {
    let part = design.observable_part();
    let fastest = eigenvalues(&part.error_dynamics()).iter().map(|pole| pole.im.abs()).fold(0.0, f64::max);
    let n_steps = (8.0 * fastest * design.hold_s).ceil().clamp(24.0, 400.0) as usize;
    let grid = (1..=n_steps).map(|i| i as f64 / n_steps as f64);
    grid.map(|share| share * design.hold_s)
        .map(|h_s| largest_gain(&part, &design.adaptation_rate, h_s) / h_s)
        .chain([largest_continuous_learning(&part, &design.adaptation_rate)])
        .fold(f64::INFINITY, f64::min)
}

pub(crate) fn largest_gain(part: &ObservablePart, adaptation_rate: &DMatrix<f64>, h_s: f64) -> f64 {
    let (n, m) = part.b.shape();
    let a_e = part.error_dynamics();
    let integral = held_integral(&padded(&a_e), n, h_s);
    let integral = DMatrix::from_fn(n, n, |i, j| integral[(i, j)]);
    let transition = DMatrix::identity(n, n) + &a_e * &integral;
    let to_state = &integral * &part.b;
    let learning = adaptation_rate * &part.c;
    let excess = |s: f64| {
        let mut map = DMatrix::identity(n + m, n + m);
        map.view_mut((n, 0), (m, n)).copy_from(&(-s * &learning));
        map.view_mut((0, n), (n, m)).copy_from(&to_state);
        map.view_mut((0, 0), (n, n)).copy_from(&(&transition - s * &to_state * &learning));
        let size = |x: &Complex<f64>| if x.re.is_nan() { f64::INFINITY } else { x.norm() };
        eigenvalues(&map).iter().map(size).fold(0.0, f64::max) - 1.0
    };
    // Where s ‖∫e^{A_e τ}B‖ ‖Γ_f C‖ is 1, learning acts within a step.
    first_crossing(1.0 / (spectral_norm(&to_state) * spectral_norm(&learning)), excess)
}

/// The largest σ φᵀφ of the continuous law, `e' = A_e e + B F,  F' = −σ φᵀφ Γ_f C e`: the limit of short steps.
fn largest_continuous_learning(part: &ObservablePart, adaptation_rate: &DMatrix<f64>) -> f64 {
    let (n, m) = part.b.shape();
    let a_e = part.error_dynamics();
    let learning = adaptation_rate * &part.c;
    let rate = spectral_norm(&a_e);
    let excess = |g: f64| {
        let mut dynamics = DMatrix::zeros(n + m, n + m);
        dynamics.view_mut((0, 0), (n, n)).copy_from(&a_e);
        dynamics.view_mut((0, n), (n, m)).copy_from(&part.b);
        dynamics.view_mut((n, 0), (m, n)).copy_from(&(-g * &learning));
        spectral_abscissa(&dynamics) / rate
    };
    first_crossing(rate * rate / (spectral_norm(&part.b) * spectral_norm(&learning)), excess)
}

/// The least x > 0 from which on `excess` is positive, searched from far below `unit`, the usual size of x, to far above; 0
/// if it is positive from the start.
fn first_crossing(unit: f64, excess: impl Fn(f64) -> f64) -> f64 {
    // Where x is small, the largest eigenvalue is at the edge of stability, up to rounding.
    const ROUNDING: f64 = 1e-8;
    let scan = |from: f64, to: f64, steps: i32| {
        (0..=steps).map(move |i| from * (to / from).powf(f64::from(i) / f64::from(steps)))
    };
    let (mut below, mut above) = (0.0, None);
    for x in scan(1e-10 * unit, 1e5 * unit, 60) {
        if excess(x) > ROUNDING {
            above = Some(x);
            break;
        }
        below = x;
    }
    while let Some(mut outside) = above {
        if below == 0.0 {
            return 0.0;
        }
        for _ in 0..40 {
            let middle = 0.5 * (below + outside);
            if excess(middle) <= ROUNDING { below = middle } else { outside = middle }
        }
        // If `excess` grows with x from the start, it only seemed stable because of rounding.
        if (0.3 * ROUNDING..=ROUNDING).contains(&excess(0.5 * below)) {
            return 0.0;
        }
        // A narrow window of instability may lie before.
        let mut last = 0.0;
        above = scan(0.05 * below, 0.999 * below, 24).find(|&x| {
            let is_outside = excess(x) > ROUNDING;
            last = if is_outside { last } else { x };
            is_outside
        });
        below = if above.is_some() { last } else { below };
    }
    below
}
