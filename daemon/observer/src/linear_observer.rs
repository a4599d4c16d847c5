//! The observer of a general linear plant, `x' = A x + B (u + f(y)) + ξ`, `y = C x + δ`.
//!
//! ```text
//! x̂' = A x̂ + L ỹ + B (u + f̂_N(y)),    θ' = σ(‖ỹ‖) φ(y) (Γ_f ỹ)ᵀ,    ỹ = y − C x̂
//! ```
//!
//! sampled as the rigid body's channels are: update first, then predict, exact for held inputs.
//!
//! | symbol | name | shape |
//! |---|---|---|
//! | x, x̂ | `state` | n ≤ 12 |
//! | u, y, f̂ | `input`, `output`, `matched_input` | m ≤ 6 |
//! | A, B, C, L | `a`, `b`, `c`, `gain` | n×n, n×m, m×n, n×m |
//!
//! # Source
//! Niu et al., eqs. (plant dynamics), (state estimator), (final learning laws).

use crate::channels::{AnyChannel, ChannelName, Learn};
use crate::error::{DesignError, Parameter};
use crate::law::channel::Channel;
use crate::law::gradient::GradientLaw;
use crate::law::linear_stability::largest_learning_of_every_step;
use crate::law::stability::StepLimit;
use crate::linear_design::LinearDesign;
use crate::plant::linear::{LinearOutput, LinearPlant, LinearState, MAX_OUTPUTS, padded};
use crate::plant::linear_algebra::{inverse_norm, spectral_abscissa, spectral_norm};
use crate::report::certificate::{Certificate, sup_if_needed};
use crate::space::scaled_kernel::ScaledKernel;
use crate::timeline::{ChannelReport, Measured, Timeline};

/// The adaptive observer of a linear plant (Niu et al., eqs. (state estimator), (final learning laws)).
///
/// Samples go in with their stamps; estimates come out for any instant not before the newest sample. The same
/// samples give the same bits, whenever and however often estimates are requested.
#[derive(Debug, Clone)]
pub struct LinearObserver {
    timeline: Timeline<LinearPlant, MAX_OUTPUTS>,
}

/// State, learned input and trust at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearEstimate {
    /// Time of the state (ns).
    pub stamp_ns: u64,
    /// x̂.
    pub state: LinearState,
    /// f̂.
    pub matched_input: LinearOutput,
    /// How far it can be trusted.
    pub report: ChannelReport,
}

impl LinearObserver {
    /// Checks the design and builds the observer. Everything is allocated here.
    ///
    /// # Errors
    /// `Plant`, `Gain`, `AdaptationRate`, … where a shape or a number is wrong; `Gain` where the observable part of
    /// A − LC is not Hurwitz; `AdaptationRate` beyond the sampled-data bound; `Centers` as
    /// [`crate::NativeSpace::new`].
    pub fn new(design: &LinearDesign) -> Result<Self, DesignError> {
        design.check()?;
        let kernel = ScaledKernel::new(design.kernel, &design.length_scale, design.n_outputs())?;
        let part = design.observable_part();
        let slowest = spectral_abscissa(&part.error_dynamics());
        if slowest >= 0.0 {
            return Err(DesignError::new(
                Parameter::Gain,
                format!("A − LC with a pole at {slowest:.3e} 1/s on the observable subspace"),
                "a gain L that moves all of these poles to the left half plane",
            ));
        }
        let hidden = design.unobservable_subspace();
        let drift = spectral_abscissa(&(hidden.transpose() * &design.a * &hidden));
        if drift > 1e-9 * (1.0 + design.a.amax()) {
            return Err(DesignError::new(
                Parameter::PlantOutput,
                format!("a mode that no output tells of and that grows by itself, at {drift:.3e} 1/s"),
                "outputs from which every unstable mode is seen (a detectable plant)",
            ));
        }
        let largest_learning = largest_learning_of_every_step(design);
        let factor = largest_learning / kernel.value_at_zero();
        if factor <= 1.0 {
            let largest = design.adaptation_rate.clone().symmetric_eigenvalues().max();
            let needed = match factor > 0.0 {
                true => format!("an adaptation rate below {:.4}, or a shorter hold", largest * factor),
                false => {
                    "a plant and gain that are strictly positive real from B to C: with these no adaptation \
                          rate is stable"
                        .into()
                }
            };
            return Err(DesignError::new(
                Parameter::AdaptationRate,
                format!("{largest} is unstable when an output is held for {} s", design.hold_s),
                needed,
            ));
        }
        let function = design.function()?;
        let certificate = part.lure_pair().ok().map(|pair| {
            Certificate::new(
                (pair.lambda_min, pair.pl_norm),
                (spectral_norm(&part.c), inverse_norm(&part.c), pair.p_norm),
                design.bounds,
                &design.dead_zone,
                sup_if_needed(&design.bounds, || function.space().sup_power_function()),
            )
        });
        let rate = padded(&design.adaptation_rate);
        let limit = StepLimit::OfEveryStep { largest_learning };
        let law = GradientLaw::new(function, design.dead_zone, rate, limit, design.options);
        let matrices = (&design.a, &design.b, &design.c, &design.gain);
        let plant = LinearPlant::new(matrices, design.initial_state.as_ref());
        let initial = plant.initial_state();
        let channel = Channel::of(law, plant, initial);
        let steps_s = (design.hold_s, design.coast_step_s);
        Ok(Self { timeline: Timeline::new(channel, certificate, steps_s) })
    }

    /// Takes what was measured and commanded at `stamp_ns`, later than the sample before. All values are finite:
    /// the caller checks. Returns whether the output was an outlier ([`crate::InnovationGate`]).
    ///
    /// # Cost
    /// One evaluation of the features with a new output; no allocation.
    pub fn accept(
        &mut self,
        stamp_ns: u64,
        output: Option<LinearOutput>,
        input: Option<LinearOutput>,
        learn: Learn,
    ) -> bool {
        // Entries beyond m are ignored.
        let m = self.law().function().n_outputs();
        let own = |vector: LinearOutput| LinearOutput::from_fn(|i, _| if i < m { vector[i] } else { 0.0 });
        let teaches = learn.teaches[ChannelName::Linear as usize];
        let measured = output.map(|output| Measured { output: own(output), teaches });
        self.timeline.accept(stamp_ns, measured, input.map(own), learn.frozen, |_| {})
    }

    /// The estimate at `stamp_ns`, or at the newest sample where that is later. No allocation.
    pub fn estimate(&mut self, stamp_ns: u64) -> LinearEstimate {
        let at = self.timeline.predict(stamp_ns);
        LinearEstimate {
            stamp_ns,
            state: at.moment.state,
            matched_input: at.matched_force.value,
            report: self.timeline.report(&at, stamp_ns),
        }
    }

    /// The channel, behind the face that all channels share.
    pub fn channel(&self) -> &dyn AnyChannel {
        &self.timeline
    }

    /// The channel, behind the face that all channels share.
    pub fn channel_mut(&mut self) -> &mut dyn AnyChannel {
        &mut self.timeline
    }

    /// The law and f̂.
    pub fn law(&self) -> &GradientLaw<MAX_OUTPUTS> {
        self.timeline.channel().law()
    }
}

#[cfg(test)]
mod tests;
