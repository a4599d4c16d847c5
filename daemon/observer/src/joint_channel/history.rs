//! What a joint channel remembers of its samples, beside what the filter estimates.

use crate::law::joint::teaches::Teaches;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Without a sample or a command for this many of their usual periods a gap begins.
const PERIODS_TO_A_GAP: f64 = 1.5;
/// The usual period follows the periods by this much of their difference.
const PERIOD_RATE: f64 = 0.1;
/// After more periods in a row than this that are three times as long, they are the usual ones.
const MAX_LONG_PERIODS: u32 = 4;
/// A channel tracks again after this many outputs in a row within the gate.
const OUTPUTS_TO_TRACK: u32 = 3;

/// All of a channel's history. It has a fixed size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointHistory {
    /// The command that is held (N; N·m); 0 before the first.
    pub(crate) command: Vector3<f64>,
    /// Stamp of the newest output (ns).
    pub(crate) output_stamp_ns: Option<u64>,
    /// Stamp of the newest sample or command (ns), and their usual period.
    event_ns: Option<u64>,
    period_ns: u64,
    long_periods: u32,
    /// Outputs in a row within the gate, up to those that are needed.
    outputs_within: u32,
    /// Mean of e²/S of the newest output.
    pub(crate) nis: f64,
    /// ‖e‖ of the newest output.
    pub(crate) output_error: f64,
    /// Whether the weights are learned since the newest sample.
    pub(crate) is_learning: bool,
}

impl JointHistory {
    pub(crate) fn new() -> Self {
        Self {
            command: Vector3::zeros(),
            output_stamp_ns: None,
            event_ns: None,
            period_ns: 0,
            long_periods: 0,
            outputs_within: 0,
            nis: 0.0,
            output_error: 0.0,
            is_learning: true,
        }
    }

    pub(crate) fn teaches(&self) -> Teaches {
        if self.is_learning { Teaches::All } else { Teaches::State }
    }

    /// Whether the innovations are not back within the gate since the newest outage.
    pub(crate) fn is_reacquiring(&self) -> bool {
        self.outputs_within < OUTPUTS_TO_TRACK
    }

    /// When a gap begins if nothing comes (ns).
    pub(crate) fn gap_start_ns(&self) -> u64 {
        match self.event_ns {
            Some(event_ns) if self.period_ns > 0 => {
                event_ns.saturating_add((PERIODS_TO_A_GAP * self.period_ns as f64) as u64)
            }
            _ => u64::MAX,
        }
    }

    /// An output, or a command: the usual period follows.
    pub(crate) fn see_event(&mut self, stamp_ns: u64) {
        if let Some(before_ns) = self.event_ns {
            let period_ns = stamp_ns.saturating_sub(before_ns);
            // What is much longer is an outage and no period, unless it is so again and again.
            let is_long = self.period_ns > 0 && period_ns >= 3 * self.period_ns;
            self.long_periods = if is_long { self.long_periods + 1 } else { 0 };
            if self.period_ns == 0 || self.long_periods > MAX_LONG_PERIODS {
                (self.period_ns, self.long_periods) = (period_ns, 0);
            } else if !is_long {
                let change = PERIOD_RATE * (period_ns as f64 - self.period_ns as f64);
                self.period_ns = (self.period_ns as f64 + change) as u64;
            }
        }
        self.event_ns = Some(stamp_ns);
    }

    /// An output with this e, within the gate or not, after an outage or not.
    pub(crate) fn see_output(&mut self, stamp_ns: u64, output_error: f64, nis: f64, agrees: bool) {
        let within = if agrees { self.outputs_within + 1 } else { 0 };
        self.outputs_within = within.min(OUTPUTS_TO_TRACK);
        (self.output_stamp_ns, self.nis, self.output_error) = (Some(stamp_ns), nis, output_error);
    }
}
