//! V and V_σ along the law's own samples.

use crate::flight::{fly, function_error, lyapunov_function, papers_force, papers_noise};
use crate::native_function::NativeFunction;
use crate::{NOISE_BOUND, channel, full_inertia, full_rate, isotropic, space_of, vector, zone};
use nalgebra::Vector3;
use observer::{ChannelDesign, DeadZoneShape};

fn no_noise(_: f64) -> Vector3<f64> {
    Vector3::zeros()
}

/// Sums and extremes of a function's changes from sample to sample.
#[derive(Debug, Default)]
struct Changes {
    last: Option<f64>,
    rises: usize,
    risen: f64,
    fallen: f64,
}

impl Changes {
    fn note(&mut self, value: f64) {
        let change = value - self.last.replace(value).unwrap_or(value);
        self.rises += usize::from(change > 0.0);
        self.risen += change.max(0.0);
        self.fallen -= change.min(0.0);
    }
}

/// What one step of the law makes of V differs from h V' by O(h²): half the step, half the difference. σ
/// between 0 and beyond 1 and a measurement error, so that all four terms are there.
#[test]
fn a_step_of_the_law_changes_v_by_the_sum_of_its_terms() {
    for (inertia, rate) in [(isotropic(4.0), isotropic(100.0)), (full_inertia(), full_rate())] {
        let design = channel(inertia, rate, zone(DeadZoneShape::Saturated, 0.01));
        let (space, v) = (space_of(&design), lyapunov_function(&design));
        let truth = papers_force(&space);
        let worst_difference = |h_s: f64| {
            let mut before: Option<(f64, f64)> = None;
            let (mut worst, mut largest_terms) = (0.0_f64, [0.0_f64; 4]);
            fly(
                &design,
                &NativeFunction::of(&space, &truth),
                papers_noise(8.0),
                (h_s, (1.0 / h_s) as usize),
                |at| {
                    let f_error = function_error(&space, &truth, at.weights);
                    let (error, output, noise) = (vector(&at.error), vector(&at.output), vector(&at.noise));
                    let now = v.value(&error, &f_error);
                    if let Some((value, rate)) = before {
                        worst = worst.max(((now - value) / h_s - rate).abs());
                    }
                    let rate = v.rate(&error, &f_error, &output, &noise, at.activation);
                    for (largest, term) in
                        largest_terms.iter_mut().zip([rate.decay, rate.noise, rate.dead_zone, rate.dropped])
                    {
                        *largest = largest.max(term.abs());
                    }
                    before = Some((now, rate.sum()));
                },
            );
            assert!(largest_terms.iter().all(|&term| term > 10.0 * worst), "{worst}: {largest_terms:?}");
            worst
        };
        let (coarse, fine) = (worst_difference(4e-4), worst_difference(2e-4));
        println!("V(t+h) − V(t) − h V': {coarse:.2e} h at h, {fine:.2e} h at h/2");
        // First order in h after the division by h; a missing or wrong term would leave the ratio at 1.
        assert!((coarse / fine - 2.0).abs() < 0.2, "{coarse} {fine}");
    }
}

/// δ = 0 and σ = 1: V' = −eᵀQe ≤ −λ_min(Q) d² = −0.032 (isotropic), −0.014 (full), beside which the O(h) of the
/// step before, below 2e-3 at 1 kHz, is nothing: no tolerance. Inside of the dead zone V does rise.
#[test]
fn without_noise_v_falls_at_every_sample_outside_of_the_dead_zone() {
    for (inertia, rate) in [(isotropic(4.0), isotropic(100.0)), (full_inertia(), full_rate())] {
        let design = channel(inertia, rate, zone(DeadZoneShape::Step, 0.02));
        let (space, v) = (space_of(&design), lyapunov_function(&design));
        let truth = papers_force(&space);
        let (mut before, mut outside) = (None, 0);
        let (mut slowest_fall, mut risen_inside) = (f64::INFINITY, 0.0);
        fly(&design, &NativeFunction::of(&space, &truth), no_noise, (1e-3, 6000), |at| {
            let now = v.value(&vector(&at.error), &function_error(&space, &truth, at.weights));
            match before {
                Some((value, true)) => {
                    outside += 1;
                    slowest_fall = f64::min(slowest_fall, (value - now) / 1e-3);
                }
                Some((value, false)) => risen_inside += f64::max(now - value, 0.0),
                None => {}
            }
            before = Some((now, at.activation > 0.0));
        });
        println!(
            "{outside} of 6000 samples outside, V' ≤ −{slowest_fall:.4} there; risen inside: {risen_inside:.1e}"
        );
        assert!(outside > 300 && slowest_fall > 0.0, "{outside} outside, slowest fall {slowest_fall}");
        assert!(risen_inside > 1e-3, "{risen_inside}");
    }
}

fn v_and_v_sigma(
    design: &ChannelDesign,
    h_s: f64,
    noise: impl Fn(f64) -> Vector3<f64>,
) -> (Changes, Changes) {
    let (space, v) = (space_of(design), lyapunov_function(design));
    let truth = papers_force(&space);
    let (mut of_v, mut of_v_sigma) = (Changes::default(), Changes::default());
    fly(design, &NativeFunction::of(&space, &truth), noise, (h_s, (6.0 / h_s) as usize), |at| {
        let f_error = function_error(&space, &truth, at.weights);
        of_v.note(v.value(&vector(&at.error), &f_error));
        // The error as it is measured; without noise it is e itself.
        let measured = vector(&(at.error + at.noise));
        of_v_sigma.note(v.value_in_dead_zone(&measured, &f_error, &design.dead_zone).unwrap());
    });
    (of_v, of_v_sigma)
}

/// V_σ' = −σ eᵀQe vanishes to the order of σ at the edge of the dead zone, and so does what a step adds to it:
/// rises remain where a step crosses the edge, O(h³) with σ's second-order contact. V rises for a third of the
/// time.
#[test]
fn with_a_smooth_dead_zone_v_rises_and_v_sigma_falls() {
    for shape in [DeadZoneShape::Quadratic, DeadZoneShape::Saturated] {
        let design = channel(isotropic(4.0), isotropic(100.0), zone(shape, 0.02));
        let (of_v, of_v_sigma) = v_and_v_sigma(&design, 2e-3, no_noise);
        println!("{shape:?}\n  V   {of_v:?}\n  V_σ {of_v_sigma:?}");
        assert!(of_v.rises > 500 && of_v.risen > 0.1 * of_v.fallen, "{of_v:?}");
        assert!(of_v_sigma.fallen > 1e-3 && of_v_sigma.risen < 1e-6 * of_v_sigma.fallen, "{of_v_sigma:?}");
    }
}

/// With a measurement error the same holds of ỹ in the place of e where ‖δ'‖ ≤ λd: ỹ' = −λỹ + M⁻¹f̃(y) + δ', so
/// that
/// `V_σ(ỹ, f̃)' = −2mσ (λ‖ỹ‖² − ỹᵀδ') ≤ 0`. The paper's δ has ‖δ'‖ ≤ 0.0098 m/s², hence d ≥ 0.00098 m/s is enough.
#[test]
fn with_the_papers_noise_v_sigma_of_the_measured_error_falls() {
    for shape in [DeadZoneShape::Quadratic, DeadZoneShape::Saturated] {
        let design = channel(isotropic(4.0), isotropic(100.0), zone(shape, 0.01));
        let (of_v, of_v_sigma) = v_and_v_sigma(&design, 2e-3, papers_noise(0.5));
        println!("{shape:?}\n  V(e, f̃)    {of_v:?}\n  V_σ(ỹ, f̃) {of_v_sigma:?}");
        assert!(of_v.rises > 100 && of_v.risen > 5e-3 * of_v.fallen, "{of_v:?}");
        assert!(of_v_sigma.fallen > 1e-3 && of_v_sigma.risen < 1e-6 * of_v_sigma.fallen, "{of_v_sigma:?}");
    }
}

/// −2σ⟨f̃(y), δ⟩ against −eᵀQe, on the steps outside of the dead zone of the width E₀ = δ̄ that Theorem 1 asks
/// for.
struct Dropped {
    largest_ratio: f64,
    rms_ratio: f64,
    outside: usize,
    exceeds_decay: usize,
    v_rises: usize,
}

fn dropped_term(rate: f64, omega_rad_s: f64) -> Dropped {
    let design = channel(isotropic(4.0), isotropic(rate), zone(DeadZoneShape::Step, NOISE_BOUND));
    let (space, v) = (space_of(&design), lyapunov_function(&design));
    let truth = papers_force(&space);
    let mut before = None;
    let mut found = Dropped { largest_ratio: 0.0, rms_ratio: 0.0, outside: 0, exceeds_decay: 0, v_rises: 0 };
    let (mut squared_dropped, mut squared_decay) = (0.0, 0.0);
    fly(&design, &NativeFunction::of(&space, &truth), papers_noise(omega_rad_s), (2e-3, 15_000), |at| {
        let f_error = function_error(&space, &truth, at.weights);
        let (error, output, noise) = (vector(&at.error), vector(&at.output), vector(&at.noise));
        let now = v.value(&error, &f_error);
        if let Some((value, true)) = before {
            found.v_rises += usize::from(now > value);
        }
        let outside = at.activation > 0.0;
        if outside {
            let rate = v.rate(&error, &f_error, &output, &noise, at.activation);
            found.outside += 1;
            found.exceeds_decay += usize::from(rate.dropped > -rate.decay);
            found.largest_ratio = found.largest_ratio.max(rate.dropped / -rate.decay);
            squared_dropped += rate.dropped.powi(2);
            squared_decay += rate.decay.powi(2);
        }
        before = Some((now, outside));
    });
    found.rms_ratio = f64::sqrt(squared_dropped / squared_decay);
    println!(
        "Γ_f {rate}, ω {omega_rad_s} rad/s: dropped/decay at most {:.3}, RMS {:.3}; of {} steps outside it exceeds the decay on {} and V \
         rises on {}",
        found.largest_ratio, found.rms_ratio, found.outside, found.exceeds_decay, found.v_rises
    );
    found
}

/// The paper's δ turns slowly beside λ: f̃(y) ≈ λM ỹ follows, and the dropped and the noise term together make
/// −2λm⟨ỹ, δ⟩ − 2λm⟨e, δ⟩, which leaves V' = −2λm‖ỹ‖². So V falls, though not by the paper's reason: the term
/// is two fifths of the decay. At 30 rad/s, with the same δ̄, f̃ does not follow, and V rises where Theorem 1's
/// proof says that it falls.
#[test]
fn the_term_that_the_proof_drops_is_two_fifths_of_the_decay_and_exceeds_it_for_fast_noise() {
    let papers = dropped_term(100.0, 0.5);
    assert!(papers.rms_ratio > 0.25 && papers.outside > 300, "{}", papers.rms_ratio);
    assert_eq!(papers.v_rises, 0);
    let fast = dropped_term(100.0, 30.0);
    assert!(fast.largest_ratio > 5.0 && fast.rms_ratio > 0.25);
    let share = |n: usize| n as f64 / fast.outside as f64;
    assert!(share(fast.exceeds_decay) > 0.02 && share(fast.v_rises) > 0.02);
}
