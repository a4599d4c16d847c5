//! A linear plant of a few states, sampled exactly for held inputs.
//!
//! ```text
//! x̂_{j+1} = x̂_j + ∫₀^h e^{A_e s} ds · (A_e x̂_j + L y + B F),    A_e = A − LC
//! ```
//!
//! which is e^{A_e h} x̂_j + ∫₀^h e^{A_e s} ds (L y + B F); while coasting, A stands for A_e and L for 0.

use crate::plant::nominal::{Moment, Plant};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// The largest n.
pub const MAX_STATES: usize = 12;
/// The largest m.
pub const MAX_OUTPUTS: usize = 6;
/// x̂, its first n entries; the others are 0.
pub type LinearState = SVector<f64, MAX_STATES>;
/// u, y or f̂, the first m entries; the others are 0.
pub type LinearOutput = SVector<f64, MAX_OUTPUTS>;

type StateMatrix = SMatrix<f64, MAX_STATES, MAX_STATES>;

/// A smaller matrix in the upper left corner of a fixed one.
pub(crate) fn padded<const R: usize, const C: usize>(matrix: &DMatrix<f64>) -> SMatrix<f64, R, C> {
    SMatrix::from_fn(|i, j| matrix.get((i, j)).copied().unwrap_or(0.0))
}

/// `x̂' = A x̂ + L (y − C x̂) + B F` in arrays of fixed size, so that steps allocate nothing.
#[derive(Debug, Clone)]
pub(crate) struct LinearPlant {
    n_states: usize,
    a: StateMatrix,
    a_e: StateMatrix,
    b: SMatrix<f64, MAX_STATES, MAX_OUTPUTS>,
    c: SMatrix<f64, MAX_OUTPUTS, MAX_STATES>,
    gain: SMatrix<f64, MAX_STATES, MAX_OUTPUTS>,
    /// Cᵀ(CCᵀ)⁺.
    c_pseudo_inverse: SMatrix<f64, MAX_STATES, MAX_OUTPUTS>,
    initial_state: Option<LinearState>,
    holding: HeldIntegral,
    coasting: HeldIntegral,
}

/// ∫₀^h e^{Ms} ds of the step before: most steps are as long as the one before.
#[derive(Debug, Clone, Copy)]
struct HeldIntegral {
    h_s: f64,
    integral: StateMatrix,
}

impl HeldIntegral {
    fn of(&mut self, m: &StateMatrix, n: usize, h_s: f64) -> &StateMatrix {
        if self.h_s != h_s {
            *self = Self { h_s, integral: held_integral(m, n, h_s) };
        }
        &self.integral
    }
}

/// `∫₀^h e^{Ms} ds = h Σ_k (Mh)^k / (k+1)!` of the leading n×n block, by the series on h/2^q with ‖M‖h/2^q ≤ 1/4 and
/// `Ψ(2h) = Ψ(h) (2I + MΨ(h))`.
pub(crate) fn held_integral(m: &StateMatrix, n: usize, h_s: f64) -> StateMatrix {
    let norm = m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
    let doublings = (4.0 * norm * h_s).max(1.0).log2().ceil() as i32;
    let step_s = h_s / 2.0_f64.powi(doublings);
    let scaled = m * step_s;
    let mut term = StateMatrix::identity();
    let mut sum = term;
    // The first term left out is below (1/4)^13/14! of the sum.
    for k in 1..=12 {
        term = block_product(&scaled, &term, n) / (k + 1) as f64;
        sum += term;
    }
    let mut integral = sum * step_s;
    for _ in 0..doublings {
        let grown = StateMatrix::identity() * 2.0 + block_product(m, &integral, n);
        integral = block_product(&integral, &grown, n);
    }
    integral
}

/// The product of the leading n×n blocks: most plants have few states.
fn block_product(a: &StateMatrix, b: &StateMatrix, n: usize) -> StateMatrix {
    let mut product = StateMatrix::zeros();
    for j in 0..n {
        for k in 0..n {
            for i in 0..n {
                product[(i, j)] += a[(i, k)] * b[(k, j)];
            }
        }
    }
    product
}

impl LinearPlant {
    /// Of matrices whose shapes fit, and x̂(0) where it is known.
    pub(crate) fn new(
        (a, b, c, gain): (&DMatrix<f64>, &DMatrix<f64>, &DMatrix<f64>, &DMatrix<f64>),
        initial_state: Option<&DVector<f64>>,
    ) -> Self {
        let pseudo_inverse = c.clone().pseudo_inverse(1e-12).expect("the tolerance is not negative");
        let never = HeldIntegral { h_s: 0.0, integral: StateMatrix::zeros() };
        Self {
            n_states: a.nrows(),
            a: padded(a),
            a_e: padded(&(a - gain * c)),
            b: padded(b),
            c: padded(c),
            gain: padded(gain),
            c_pseudo_inverse: padded(&pseudo_inverse),
            initial_state: initial_state
                .map(|x| LinearState::from_fn(|i, _| x.get(i).copied().unwrap_or(0.0))),
            holding: never,
            coasting: never,
        }
    }

    /// x̂(0); 0 where it is not known.
    pub(crate) fn initial_state(&self) -> LinearState {
        self.initial_state.unwrap_or_default()
    }
}

impl Plant<MAX_OUTPUTS> for LinearPlant {
    type State = LinearState;

    fn output(&self, state: &LinearState) -> LinearOutput {
        self.c * state
    }

    fn start(&self, waiting: &LinearState, output: &LinearOutput) -> LinearState {
        if self.initial_state.is_some() { *waiting } else { self.c_pseudo_inverse * output }
    }

    fn at_output(&self, state: &LinearState, output: &LinearOutput) -> LinearState {
        state + self.c_pseudo_inverse * (output - self.c * state)
    }

    fn loaded(&self, _own: &LinearState, saved: &LinearState) -> LinearState {
        *saved
    }

    fn follow(
        &mut self,
        from: &Moment<LinearState>,
        output: &LinearOutput,
        force: &LinearOutput,
        h_s: f64,
    ) -> LinearState {
        let slope = self.a_e * from.state + self.gain * output + self.b * force;
        from.state + self.holding.of(&self.a_e, self.n_states, h_s) * slope
    }

    fn coast(&mut self, from: &Moment<LinearState>, force: &LinearOutput, h_s: f64) -> LinearState {
        let slope = self.a * from.state + self.b * force;
        from.state + self.coasting.of(&self.a, self.n_states, h_s) * slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against nalgebra's matrix exponential of [[M, I], [0, 0]], whose upper right block is the integral.
    #[test]
    fn the_held_integral_is_that_of_the_matrix_exponential() {
        let small = DMatrix::from_row_slice(3, 3, &[-2.0, 1.0, 0.5, 3.0, -40.0, 2.0, 0.0, 7.0, 1.0]);
        for h in [1e-6, 0.005, 0.3, 1.5] {
            let mut block = DMatrix::zeros(6, 6);
            block.view_mut((0, 0), (3, 3)).copy_from(&(&small * h));
            block.view_mut((0, 3), (3, 3)).copy_from(&(DMatrix::<f64>::identity(3, 3) * h));
            let expected = block.exp();
            let found = held_integral(&padded(&small), 3, h);
            for i in 0..3 {
                for j in 0..3 {
                    let size = expected.view((0, 3), (3, 3)).amax();
                    assert!((found[(i, j)] - expected[(i, 3 + j)]).abs() < 1e-13 * size, "h {h}");
                }
            }
        }
    }
}
