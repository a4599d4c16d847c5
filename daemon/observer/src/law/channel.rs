//! A channel: the law over a plant, step by step. The service runs this code; read it beside the paper.
//!
//! ```text
//! observe(y)     ỹ = y − C x̂_j,   φ = φ(y),   σ = σ(‖ỹ‖)
//! predict(u, h)  Δθ = h σ φ (Γ_f ỹ)ᵀ,   f̂ = (θ_j + Δθ)ᵀ φ,   x̂_{j+1} = x̂_j + ∫₀ʰ A x̂ + L (y − C x̂) + B (u + f̂) dt
//! commit         θ_{j+1} = θ_j + Δθ,   x̂ = x̂_{j+1}
//! ```
//!
//! The continuous law is `x̂' = A x̂ + L ỹ + B (u + f̂(y))`, `θ' = σ(‖ỹ‖) φ(y) (Γ_f ỹ)ᵀ`, sampled with y and u held: update
//! first, then predict, and the integral is exact. On the rigid body A = 0, B = M⁻¹, C = I, L = λI:
//!
//! ```text
//! v̂_{j+1} = e^{−λh} v̂_j + (1 − e^{−λh})/λ · (λ y + M⁻¹ (u + f̂))
//! ```
//!
//! | symbol | name | shape | unit (translation; rotation) |
//! |---|---|---|---|
//! | x̂ | [`Channel::state`] | n | v̂: m/s; rad/s |
//! | y, ỹ | `output`, `output_error` | m | m/s; rad/s |
//! | u, f̂ | `input`, `matched_force` | m | N; N·m |
//! | M | `inertia` | 3×3 | kg; kg·m² |
//! | Γ_f | `adaptation_rate` | m×m | kg/s²; N·m |
//! | λ | `gain_per_s` | 1 | 1/s |
//!
//! A [`crate::RigidBodyObserver`] runs this on a time line. The time for which an output is held is known only when the next
//! sample arrives, so the observer may predict many times, and commits once.
//!
//! # Source
//! Niu et al., eqs. (state estimator), (final learning laws).

use crate::design::ChannelDesign;
use crate::error::DesignError;
use crate::function::evaluation::Evaluation;
use crate::law::gradient::{GradientLaw, Learning};
use crate::plant::body::{Body, BodyState, Kinematics, KnownForce};
use crate::plant::integrator::Integrator;
use crate::plant::nominal::{Moment, Plant};
use nalgebra::{SVector, Vector3};

/// The law over a plant with at most M outputs. Everything is allocated at construction; steps allocate nothing.
#[derive(Debug, Clone)]
pub struct Channel<P: Plant<M>, const M: usize> {
    law: GradientLaw<M>,
    plant: P,
    /// x̂_j.
    at: Moment<P::State>,
}

/// A channel of the rigid body on its own, without a pose: `M v' = u + f(v)`, `y = v + δ`.
pub type BodyChannel = Channel<Body<()>, 3>;

/// The prediction if the observed output is held for h.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ahead<S, const M: usize> {
    /// θ_{j+1} − θ_j.
    pub learning: Learning<M>,
    /// f̂ = θ_{j+1}ᵀ φ.
    pub matched_force: Evaluation<M>,
    /// x̂_{j+1}.
    pub state: S,
}

impl<P: Plant<M>, const M: usize> Channel<P, M> {
    pub(crate) fn of(law: GradientLaw<M>, plant: P, initial: P::State) -> Self {
        Self { law, plant, at: Moment { stamp_ns: 0, state: initial } }
    }

    /// ỹ = y − C x̂, φ(y), σ(‖ỹ‖). With `learn` false, σ = 0: the output corrects the state only.
    ///
    /// # Cost
    /// As [`GradientLaw::observe`].
    pub fn observe(&mut self, output: &SVector<f64, M>, learn: bool) {
        self.law.observe(output, &self.plant.output(&self.at.state), learn);
    }

    /// The same with the output that is held already, against a newer x̂ and θ.
    pub fn observe_again(&mut self, learn: bool) {
        self.law.observe_again(&self.plant.output(&self.at.state), learn);
    }

    /// Δθ, f̂ and x̂ after `h_s` with the held output and input. Changes neither θ nor x̂.
    ///
    /// # Cost
    /// Independent of N; no allocation.
    pub fn predict(&mut self, input: &SVector<f64, M>, h_s: f64) -> Ahead<P::State, M> {
        let learning = self.law.learning(h_s);
        let matched_force = self.law.matched_force(&learning);
        let state = match h_s == 0.0 {
            true => self.at.state,
            false => {
                let force = input + matched_force.value;
                self.plant.follow(&self.at, &self.law.held().output, &force, h_s)
            }
        };
        Ahead { learning, matched_force, state }
    }

    /// θ_{j+1} and x̂_{j+1}.
    ///
    /// # Cost
    /// As [`GradientLaw::learn`].
    pub fn commit(&mut self, learning: &Learning<M>, at: Moment<P::State>) {
        self.law.learn(learning);
        self.at = at;
    }

    /// One whole step of the law with an output that is held for `h_s`.
    ///
    /// # Cost
    /// Dense: N(N+1)/2 + 2 N m multiply-adds and N kernel values; no allocation.
    pub fn step(
        &mut self,
        output: &SVector<f64, M>,
        input: &SVector<f64, M>,
        h_s: f64,
    ) -> Ahead<P::State, M> {
        self.observe(output, true);
        let ahead = self.predict(input, h_s);
        // To the nearest ns; `round` is a library call on the baseline of x86-64.
        let stamp_ns = self.at.stamp_ns + (h_s * 1e9 + 0.5) as u64;
        self.commit(&ahead.learning, Moment { stamp_ns, state: ahead.state });
        ahead
    }

    /// x̂, and what is integrated along with it.
    pub fn state(&self) -> &P::State {
        &self.at.state
    }

    /// C x̂.
    pub fn output_estimate(&self) -> SVector<f64, M> {
        self.plant.output(&self.at.state)
    }

    /// x̂ with its time.
    pub(crate) fn at(&self) -> &Moment<P::State> {
        &self.at
    }

    pub(crate) fn at_mut(&mut self) -> &mut Moment<P::State> {
        &mut self.at
    }

    /// θ, φ, f̂.
    pub fn law(&self) -> &GradientLaw<M> {
        &self.law
    }

    /// The law, to run a part of a step.
    pub fn law_mut(&mut self) -> &mut GradientLaw<M> {
        &mut self.law
    }

    /// A, B, C and L.
    pub fn plant(&self) -> &P {
        &self.plant
    }

    pub(crate) fn plant_mut(&mut self) -> &mut P {
        &mut self.plant
    }
}

impl<K: Kinematics> Channel<Body<K>, 3> {
    /// Builds the native space and checks the design; see [`BodyChannel::new`].
    pub(crate) fn of_body(
        design: &ChannelDesign,
        known_force: KnownForce,
        initial_rate: Option<Vector3<f64>>,
        pose: K,
    ) -> Result<Self, DesignError> {
        design.check()?;
        let step_limit = design.step_limit()?;
        let law = GradientLaw::new(
            design.function()?,
            design.dead_zone,
            design.adaptation_rate,
            step_limit,
            design.options,
        );
        let integrator = Integrator::new(design.gain_per_s, &design.inertia);
        let body = Body::new(integrator, known_force, initial_rate);
        Ok(Self::of(law, body, BodyState { rate: initial_rate.unwrap_or_default(), pose }))
    }
}

impl BodyChannel {
    /// A channel at rest that has learned nothing.
    ///
    /// # Errors
    /// The parameter that is out of range, with what would be accepted: gains and times that are not
    /// positive, an inertia or adaptation rate that is not symmetric positive definite, centers without a
    /// positive definite Gram matrix, or an adaptation rate beyond the sampled-data bound.
    pub fn new(design: &ChannelDesign) -> Result<Self, DesignError> {
        Self::of_body(design, KnownForce::Constant(Vector3::zeros()), None, ())
    }

    /// Sets v̂; what was learned is kept.
    pub fn set_rate(&mut self, rate: Vector3<f64>) {
        self.at.state.rate = rate;
    }
}

#[cfg(test)]
mod tests;
