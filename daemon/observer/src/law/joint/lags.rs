//! §1: the actuators' lags, `ā_i' = (a_u − ā_i)/τ_i`.

use serde::{Deserialize, Serialize};

/// ā_1, ā_2: the command as slow actuators follow it (m/s²; rad/s²). Unknown before the first command.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Lags {
    pub(crate) lagged: Option<[[f64; 3]; 2]>,
}

impl Lags {
    pub(crate) fn unknown() -> Self {
        Self { lagged: None }
    }

    /// Mean of a_u − ā_i over a step of h with a_u held: `(a_u − ā_i) τ_i (1 − α_i)/h`, α_i = e^{−h/τ_i}; then
    /// `ā_i := α_i ā_i + (1 − α_i) a_u`.
    pub(crate) fn advance(
        &mut self,
        h_s: f64,
        command: &[f64; 3],
        (times_s, decays): (&[f64; 2], &[f64; 2]),
    ) -> [[f64; 3]; 2] {
        let lagged = self.lagged.get_or_insert([*command; 2]);
        std::array::from_fn(|i| {
            let alpha = decays[i];
            // 1 in the limit of a step without length.
            let mean = if h_s > 0.0 { times_s[i] * (1.0 - alpha) / h_s } else { 1.0 };
            std::array::from_fn(|axis| {
                let difference = command[axis] - lagged[i][axis];
                lagged[i][axis] = alpha * lagged[i][axis] + (1.0 - alpha) * command[axis];
                difference * mean
            })
        })
    }
}
