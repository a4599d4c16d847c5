//! Describes the machine of a measurement and the core that it is pinned to.

use anyhow::Context;
use daemon::system::{machine, real_time};
use rustix::thread::sched_getcpu;
use serde::Serialize;
use shared_types::outln;

/// The machine, as far as figures depend on it.
#[derive(Debug, Serialize)]
pub(crate) struct Machine {
    cpu: String,
    cores: usize,
    profile: &'static str,
    /// The vector unit that steps run on.
    vector_instructions: &'static str,
    pinned_core: Option<usize>,
    /// The cores that were left to other threads and processes of the measurement.
    #[serde(skip)]
    other_cores: Vec<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pinned_core_reason: Option<String>,
    /// Median of two readings of the clock with nothing in between; contained in every sample.
    clock_ns: u64,
}

impl Machine {
    /// Pins the thread to its present core, and collects the facts.
    pub(crate) fn found() -> Self {
        // Before pinning, which would leave one.
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut other_cores = real_time::allowed_cores();
        let (pinned_core, pinned_core_reason) = match pin() {
            Ok(core) => (Some(core), None),
            Err(reason) => (None, Some(reason)),
        };
        other_cores.retain(|core| Some(*core) != pinned_core);
        Self {
            cpu: machine::cpu_model().unwrap_or_else(|| "unknown CPU".into()),
            cores,
            profile: if cfg!(debug_assertions) { "debug" } else { "release" },
            vector_instructions: observer::vector_unit(),
            pinned_core,
            other_cores,
            pinned_core_reason,
            clock_ns: machine::clock_reading_ns(),
        }
    }

    /// A core for the process or thread on the other side: neither ours nor the first one, which serves most
    /// interrupts, if there is a choice.
    pub(crate) fn other_core(&self) -> anyhow::Result<usize> {
        self.other_cores.last().copied().with_context(|| {
            format!(
                "found {} core that this process may use, needed two: both sides of an exchange poll (taskset -p tells \
                 which it may use)",
                self.cores
            )
        })
    }

    /// Every core that this process may use.
    pub(crate) fn all_cores(&self) -> Vec<usize> {
        self.pinned_core.iter().chain(&self.other_cores).copied().collect()
    }

    /// One line above a table.
    pub(crate) fn print(&self) {
        let pinned = match (&self.pinned_core, &self.pinned_core_reason) {
            (Some(core), _) => format!("pinned to core {core}"),
            (None, reason) => format!("not pinned ({})", reason.as_deref().unwrap_or("unknown reason")),
        };
        outln!(
            "{}, {} cores; {} build, steps on {}; {pinned}; reading the clock takes {} ns, contained in every sample",
            self.cpu,
            self.cores,
            self.profile,
            self.vector_instructions,
            self.clock_ns
        );
    }
}

fn pin() -> Result<usize, String> {
    let core = sched_getcpu();
    real_time::stay_on_cores(&[core]).map_err(|refused| refused.to_string())?;
    Ok(core)
}
