//! §3b: how much the command varies, for the uncertainty of a gap in which it is not known.

use serde::{Deserialize, Serialize};

/// The command's mean and variance follow it with this time (s).
pub(super) const COMMAND_TIME_S: f64 = 10.0;

/// a_m and σ_a² (m/s² and its square; rad/s²); unknown before the first command.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct CommandStatistics {
    mean: Option<[f64; 3]>,
    /// σ_a², of one axis.
    pub(crate) variance: f64,
}

impl CommandStatistics {
    pub(crate) fn unknown() -> Self {
        Self { mean: None, variance: 0.0 }
    }

    /// Follows a known command over a step of h: `a_m += rate (a_u − a_m)`, then `σ_a² += rate (‖a_u − a_m‖²/3 − σ_a²)`,
    /// rate = 1 − e^{−h/10 s}.
    pub(crate) fn follow(&mut self, rate: f64, command: &[f64; 3]) {
        let mean = self.mean.get_or_insert(*command);
        let mut square = 0.0;
        for (mean, command) in mean.iter_mut().zip(command) {
            *mean += rate * (command - *mean);
            square += (command - *mean) * (command - *mean);
        }
        self.variance += rate * (square / 3.0 - self.variance);
    }
}
