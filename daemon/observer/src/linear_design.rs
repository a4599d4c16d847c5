//! The design of the observer of a general linear plant, `x' = A x + B (u + f(y)) + ξ`, `y = C x + δ`, and its checks.

use crate::design::{DisturbanceBounds, GradientOptions, positive, positive_definite};
use crate::error::{DesignError, Parameter};
use crate::function::learned::LearnedFunction;
use crate::function::solver::Solver;
use crate::law::dead_zone::DeadZone;
use crate::plant::linear::{MAX_OUTPUTS, MAX_STATES};
use crate::plant::linear_algebra::{complement, reachable_subspace};
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use crate::space::scaled_kernel::LengthScale;
use nalgebra::{DMatrix, DVector};

/// The largest ‖A‖ h; beyond it e^{Ah} is meaningless.
const MAX_GROWTH: f64 = 1e6;

/// The design of the observer of a linear plant.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearDesign {
    /// A, n×n.
    pub a: DMatrix<f64>,
    /// B, n×m.
    pub b: DMatrix<f64>,
    /// C, m×n.
    pub c: DMatrix<f64>,
    /// L, n×m.
    pub gain: DMatrix<f64>,
    /// κ.
    pub kernel: Kernel,
    /// ℓ > 0, in the output's unit.
    pub length_scale: LengthScale,
    /// Ξ_N, points of ℝ^m.
    pub centers: Centers,
    /// Added to the Gram matrix's diagonal, as a multiple of κ(0); ≥ 0.
    pub nugget: f64,
    /// How f̂ is computed.
    pub solver: Solver,
    /// Γ_f, m×m, symmetric positive definite.
    pub adaptation_rate: DMatrix<f64>,
    /// σ.
    pub dead_zone: DeadZone,
    /// Where the law departs from the paper's.
    pub options: GradientOptions,
    /// Bounds on the disturbances; ξ̄ bounds a rate of the state.
    pub bounds: DisturbanceBounds,
    /// An output is held for at most this long (s).
    pub hold_s: f64,
    /// Step of coasting (s).
    pub coast_step_s: f64,
    /// x̂(0); `None` takes the least x̂ with C x̂ = y at the first output.
    pub initial_state: Option<DVector<f64>>,
}

/// The observable part of a plant, in the coordinates x_o = Oᵀx, with O an orthonormal basis of the observable subspace. The
/// unobservable part does not act on it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ObservablePart {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
    pub(crate) c: DMatrix<f64>,
    pub(crate) gain: DMatrix<f64>,
}

impl ObservablePart {
    pub(crate) fn error_dynamics(&self) -> DMatrix<f64> {
        &self.a - &self.gain * &self.c
    }
}

impl LinearDesign {
    /// n.
    pub fn n_states(&self) -> usize {
        self.a.nrows()
    }

    /// m.
    pub fn n_outputs(&self) -> usize {
        self.c.nrows()
    }

    /// A_e = A − LC.
    pub fn error_dynamics(&self) -> DMatrix<f64> {
        &self.a - &self.gain * &self.c
    }

    /// An orthonormal basis of the unobservable subspace of (A, C), n×(n−r).
    pub fn unobservable_subspace(&self) -> DMatrix<f64> {
        complement(&reachable_subspace(&self.a.transpose(), &self.c.transpose()))
    }

    pub(crate) fn observable_part(&self) -> ObservablePart {
        let basis = reachable_subspace(&self.a.transpose(), &self.c.transpose());
        // All of it: keep the plant's own coordinates.
        let basis = match basis.ncols() == self.n_states() {
            true => DMatrix::identity(self.n_states(), self.n_states()),
            false => basis,
        };
        let transposed = basis.transpose();
        ObservablePart {
            a: &transposed * &self.a * &basis,
            b: &transposed * &self.b,
            c: &self.c * &basis,
            gain: &transposed * &self.gain,
        }
    }

    /// f̂ = 0 with the design's solver; whether the observer is stable is another question.
    ///
    /// # Errors
    /// As [`crate::LinearObserver::new`], but for what is stable.
    ///
    /// # Cost
    /// As [`crate::NativeSpace::new`] with the dense solver.
    pub fn function(&self) -> Result<LearnedFunction<MAX_OUTPUTS>, DesignError> {
        self.check()?;
        LearnedFunction::zero((self.kernel, &self.length_scale), &self.centers, self.nugget, &self.solver)
    }

    pub(crate) fn check(&self) -> Result<(), DesignError> {
        let (n, m) = (self.a.nrows(), self.b.ncols());
        let refuse =
            |parameter, found: String, needed: String| Err(DesignError::new(parameter, found, needed));
        if !(1..=MAX_STATES).contains(&n) || self.a.ncols() != n {
            let found = format!("A of {}×{}", n, self.a.ncols());
            return refuse(Parameter::Plant, found, format!("a square A with 1 to {MAX_STATES} states"));
        }
        if !(1..=MAX_OUTPUTS.min(n)).contains(&m) {
            let needed = format!("1 to {} inputs, as many as outputs", MAX_OUTPUTS.min(n));
            return refuse(Parameter::PlantInput, format!("B with {m} columns"), needed);
        }
        for (parameter, name, matrix, rows, columns) in [
            (Parameter::PlantInput, "B", &self.b, n, m),
            (Parameter::PlantOutput, "C", &self.c, m, n),
            (Parameter::Gain, "L", &self.gain, n, m),
            (Parameter::AdaptationRate, "Γ_f", &self.adaptation_rate, m, m),
        ] {
            if matrix.shape() != (rows, columns) {
                let found = format!("{name} of {}×{}", matrix.nrows(), matrix.ncols());
                return refuse(parameter, found, format!("{rows}×{columns}, as A is {n}×{n} and B {n}×{m}"));
            }
        }
        for (parameter, name, matrix) in [
            (Parameter::Plant, "A", &self.a),
            (Parameter::PlantInput, "B", &self.b),
            (Parameter::PlantOutput, "C", &self.c),
            (Parameter::Gain, "L", &self.gain),
        ] {
            if matrix.iter().any(|entry| !entry.is_finite()) {
                return refuse(
                    parameter,
                    format!("{name} with an entry that is not finite"),
                    "finite numbers".into(),
                );
            }
        }
        for (parameter, name, matrix) in
            [(Parameter::PlantInput, "B", &self.b), (Parameter::PlantOutput, "C", &self.c)]
        {
            let sizes = matrix.singular_values();
            if sizes.min() <= 1e-9 * sizes.max() {
                let found = format!("{name} with singular values {:?}", sizes.as_slice());
                return refuse(
                    parameter,
                    found,
                    format!("{m} independent directions: nothing can be learned along the others"),
                );
            }
        }
        let growth =
            self.a.amax().max(self.error_dynamics().amax()) * n as f64 * self.hold_s.max(self.coast_step_s);
        if growth > MAX_GROWTH {
            let found = format!(
                "A or A − LC that changes the state {growth:.1e} times within a hold of {} s",
                self.hold_s
            );
            return refuse(
                Parameter::Plant,
                found,
                format!("at most {MAX_GROWTH:.0e}: a shorter hold, or other units"),
            );
        }
        if self.centers.dimension() != m {
            let found = format!("centers with {} coordinates", self.centers.dimension());
            return refuse(Parameter::Centers, found, format!("{m}, one per output"));
        }
        if let Some(initial) = &self.initial_state
            && (initial.len() != n || initial.iter().any(|x| !x.is_finite()))
        {
            return refuse(
                Parameter::InitialState,
                format!("{:?}", initial.as_slice()),
                format!("{n} finite numbers"),
            );
        }
        positive(Parameter::Hold, self.hold_s)?;
        positive(Parameter::CoastStep, self.coast_step_s)?;
        self.bounds.check()?;
        self.options.check()?;
        positive_definite(Parameter::AdaptationRate, &self.adaptation_rate)
    }
}
