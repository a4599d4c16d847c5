//! What a joint channel remembers of its samples, beside what the filter estimates.

use crate::law::joint::teaches::Teaches;
use crate::timeline::seconds;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Without a sample or a command for this many of their usual periods a gap begins.
const PERIODS_TO_A_GAP: f64 = 1.5;
/// The usual period follows the periods by this much of their difference.
const PERIOD_RATE: f64 = 0.1;
/// A longer time counts as this many periods.
const MAX_PERIODS_COUNTED: u64 = 3;
/// A channel tracks again after this many outputs in a row within the gate.
const OUTPUTS_TO_TRACK: u32 = 3;

/// All of a channel's history. It has a fixed size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointHistory {
    /// The command that is held (N; N·m); 0 before the first.
    pub(crate) command: Vector3<f64>,
    /// Stamp of the newest output (ns).
    pub(crate) output_stamp_ns: Option<u64>,
    /// Of the newest position fix where no output ever came (ns).
    pub(crate) fix_stamp_ns: Option<u64>,
    /// Of the newest one that agreed (ns).
    agreed_fix_stamp_ns: Option<u64>,
    /// When outputs and when commands come.
    outputs: Rhythm,
    commands: Rhythm,
    /// Outputs in a row within the gate, up to those that are needed.
    outputs_within: u32,
    /// Mean of e²/S of the newest output.
    pub(crate) nis: f64,
    /// ‖e‖ of the newest output.
    pub(crate) output_error: f64,
    /// Whether the outputs repeat what cannot be.
    pub(crate) is_stuck: bool,
    /// Whether the weights are learned since the newest sample.
    pub(crate) is_learning: bool,
}

impl JointHistory {
    pub(crate) fn new() -> Self {
        Self {
            command: Vector3::zeros(),
            output_stamp_ns: None,
            fix_stamp_ns: None,
            agreed_fix_stamp_ns: None,
            outputs: Rhythm::default(),
            commands: Rhythm::default(),
            outputs_within: 0,
            nis: 0.0,
            output_error: 0.0,
            is_stuck: false,
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

    /// When a gap begins if nothing comes (ns): outputs and commands are late, each by its own period.
    pub(crate) fn gap_start_ns(&self) -> u64 {
        match (self.outputs.late_ns(), self.commands.late_ns()) {
            (Some(output_ns), Some(command_ns)) => output_ns.max(command_ns),
            (late_ns, None) | (None, late_ns) => late_ns.unwrap_or(u64::MAX),
        }
    }

    /// A command came.
    pub(crate) fn see_command(&mut self, stamp_ns: u64) {
        self.commands.see(stamp_ns);
    }

    /// An output with this e, within the gate or not, after an outage or not.
    pub(crate) fn see_output(&mut self, stamp_ns: u64, output_error: f64, nis: f64, agrees: bool) {
        self.follow(stamp_ns, output_error, nis, agrees);
        self.output_stamp_ns = Some(stamp_ns);
    }

    /// A position fix. It is what there is to follow where no velocity ever comes.
    pub(crate) fn see_fix(&mut self, stamp_ns: u64, error: f64, nis: f64, agrees: bool) {
        if self.output_stamp_ns.is_none() {
            self.follow(stamp_ns, error, nis, agrees);
            self.fix_stamp_ns = Some(stamp_ns);
            if agrees || self.agreed_fix_stamp_ns.is_none() {
                self.agreed_fix_stamp_ns = Some(stamp_ns);
            }
        }
    }

    /// The time since a fix agreed (s), where fixes are all that is measured.
    pub(crate) fn since_agreed_fix_s(&self, stamp_ns: u64) -> Option<f64> {
        let agreed_ns = self.agreed_fix_stamp_ns.filter(|_| self.output_stamp_ns.is_none())?;
        Some(seconds(stamp_ns.saturating_sub(agreed_ns))).filter(|since_s| *since_s > 0.0)
    }

    fn follow(&mut self, stamp_ns: u64, error: f64, nis: f64, agrees: bool) {
        let within = if agrees { self.outputs_within + 1 } else { 0 };
        self.outputs_within = within.min(OUTPUTS_TO_TRACK);
        self.outputs.see(stamp_ns);
        (self.nis, self.output_error) = (nis, error);
    }
}

/// When something usually comes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Rhythm {
    /// Stamp of the newest one (ns).
    newest_ns: Option<u64>,
    /// The usual period (ns); 0 before the second one.
    period_ns: u64,
}

impl Rhythm {
    /// Sees one. Two of one stamp are one; an outage counts as a few periods, so that a slower rhythm is found, too.
    fn see(&mut self, stamp_ns: u64) {
        if let Some(before_ns) = self.newest_ns {
            let period_ns = stamp_ns.saturating_sub(before_ns);
            if self.period_ns == 0 {
                self.period_ns = period_ns;
            } else if period_ns > 0 {
                let counted_ns = period_ns.min(MAX_PERIODS_COUNTED.saturating_mul(self.period_ns));
                let change = PERIOD_RATE * (counted_ns as f64 - self.period_ns as f64);
                self.period_ns = (self.period_ns as f64 + change).ceil() as u64;
            }
        }
        self.newest_ns = Some(stamp_ns);
    }

    /// From when on the next one is late (ns).
    fn late_ns(&self) -> Option<u64> {
        let late_ns = (PERIODS_TO_A_GAP * self.period_ns as f64) as u64;
        self.newest_ns.filter(|_| self.period_ns > 0).map(|newest_ns| newest_ns.saturating_add(late_ns))
    }
}
