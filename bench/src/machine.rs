//! The machine a measurement ran on, and the core it was pinned to: what its figures depend on.

use rustix::thread::{CpuSet, sched_getcpu, sched_setaffinity};
use serde::Serialize;
use shared_types::outln;
use std::time::Instant;

/// What the figures depend on.
#[derive(Debug, Serialize)]
pub(crate) struct Machine {
    cpu: String,
    cores: usize,
    profile: &'static str,
    /// The vector unit that steps run on.
    vector_instructions: &'static str,
    pinned_core: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pinned_core_reason: Option<String>,
    /// Median of two readings of the clock with nothing in between; contained in every sample.
    clock_ns: u64,
}

impl Machine {
    /// Pins the thread to the core it runs on, then looks around.
    pub(crate) fn found() -> Self {
        // Before pinning, which would leave one.
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let (pinned_core, pinned_core_reason) = match pin() {
            Ok(core) => (Some(core), None),
            Err(reason) => (None, Some(reason)),
        };
        let mut clock_ns: Vec<_> = (0..10_000).map(|_| Instant::now().elapsed().as_nanos() as u64).collect();
        clock_ns.sort_unstable();
        Self {
            cpu: cpu_model().unwrap_or_else(|| "unknown CPU".into()),
            cores,
            profile: if cfg!(debug_assertions) { "debug" } else { "release" },
            vector_instructions: observer::vector_unit(),
            pinned_core,
            pinned_core_reason,
            clock_ns: clock_ns[clock_ns.len() / 2 - 1],
        }
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
    if core >= CpuSet::MAX_CPU {
        return Err(format!("core {core} is beyond what a CPU set holds"));
    }
    let mut set = CpuSet::new();
    set.set(core);
    sched_setaffinity(None, &set).map_err(|error| format!("sched_setaffinity to core {core}: {error}"))?;
    Ok(core)
}

fn cpu_model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    // "model name" on x86, "Model" on many ARM boards.
    let line = text.lines().find(|line| line.to_ascii_lowercase().starts_with("model name"));
    let line = line.or_else(|| text.lines().find(|line| line.starts_with("Model")))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
