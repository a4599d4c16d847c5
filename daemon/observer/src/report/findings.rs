//! The findings of a design report, one sentence each.

use crate::report::design_report::DesignReport;
use crate::report::words::{matrix_in_words, number, pole_in_words};
use serde::Serialize;

/// Whether a condition is met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// It is.
    Holds,
    /// It is not.
    Fails,
    /// The paper claims it, and its proof does not cover this design.
    Claimed,
    /// It says nothing about this design.
    #[serde(rename = "not applicable")]
    NotApplicable,
}

/// One line of a report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The condition.
    pub condition: String,
    /// Whether it is met.
    pub verdict: Verdict,
    /// The numbers, and what they mean.
    pub detail: String,
}

impl DesignReport {
    /// All conditions, in the order in which they build on each other.
    pub fn findings(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        let plain = |holds: bool| if holds { Verdict::Holds } else { Verdict::Fails };
        let mut find = |condition: &str, verdict: Verdict, detail: String| {
            findings.push(Finding { condition: condition.into(), verdict, detail });
        };
        let n = self.states.len();
        find("(A, B) controllable", plain(self.controllable), format!("{n} states"));
        let hidden = self.unobservable.join(", ");
        find(
            "(A, C) observable",
            plain(self.observable),
            match self.observable {
                true => "everything acts on what is measured".into(),
                false => format!(
                    "unobservable: {hidden}; it is integrated from its start, its error bounded only through the rest"
                ),
            },
        );
        let poles = self.poles.iter().map(pole_in_words).collect::<Vec<_>>().join(", ");
        find("A_e = A − LC Hurwitz", plain(self.hurwitz), format!("poles {poles} 1/s"));
        if !self.observable {
            let detail = "what the theorems are about".into();
            find("A_e Hurwitz on the observable part", plain(self.observable_hurwitz), detail);
        }
        find(
            "error dynamics strictly positive real (Lur'e)",
            plain(self.lure.is_ok()),
            match &self.lure {
                Ok(pair) => format!(
                    "{}, λ_min(WᵀW + εP) = {}, ‖PL‖ = {}; residuals at most {:.0e}",
                    matrix_in_words("P", &pair.p),
                    number(pair.lambda_min),
                    number(pair.pl_norm),
                    pair.input_residual.max(pair.lyapunov_residual)
                ),
                Err(reason) => reason.clone(),
            },
        );
        let noise = self.bounds.noise;
        let (e0, d_n) = match &self.certificate {
            None => (None, None),
            Some(certificate) => {
                (Some(certificate.e0()), Some((certificate.d_n(), certificate.is_admissible())))
            }
        };
        let claimed_with_noise = |holds: bool| match (holds, noise > 0.0) {
            (true, true) => Verdict::Claimed,
            (true, false) => Verdict::Holds,
            (false, _) => Verdict::Fails,
        };
        let no_pair = || "not defined without a Lur'e pair".to_owned();
        find(
            "‖e‖ settles below E₀ (Theorem 1)",
            e0.map_or(Verdict::NotApplicable, |_| claimed_with_noise(true)),
            e0.map_or_else(no_pair, |e0| format!("E₀ = {}", number(e0))),
        );
        find(
            "d > d_N (Theorem 2)",
            d_n.map_or(Verdict::NotApplicable, |(_, holds)| claimed_with_noise(holds)),
            d_n.map_or_else(no_pair, |(d_n, _)| {
                format!(
                    "d = {}, d_N = {} with sup P_N = {:.4} (no point above {:.4}) and r_f = {}{}",
                    number(self.dead_zone_width),
                    number(d_n),
                    self.sup_power_function.value,
                    self.sup_power_function.upper_bound,
                    number(self.bounds.residual_norm),
                    if self.bounds.residual_norm == 0.0 {
                        ": as if f lay in the span of the centers"
                    } else {
                        ""
                    }
                )
            }),
        );
        find(
            "dead zone continuously differentiable",
            plain(self.dead_zone_is_smooth),
            if self.dead_zone_is_smooth { "admissible".into() } else { "a step: it may chatter".into() },
        );
        find(
            "sampled law stable",
            plain(self.sampled_data_stable()),
            format!(
                "adaptation rate {}, largest {} for an output held for {} ms",
                number(self.adaptation_rate),
                number(self.largest_stable_adaptation_rate),
                number(1e3 * self.hold_s)
            ),
        );
        find(
            "the proofs cover the measurement error",
            plain(noise == 0.0),
            match noise == 0.0 {
                true => "δ̄ = 0".into(),
                false => format!(
                    "δ̄ = {}: with it E₀ and d_N are the paper's claim; its proof drops −2σ⟨f̃(y), δ⟩",
                    number(noise)
                ),
            },
        );
        findings
    }
}
