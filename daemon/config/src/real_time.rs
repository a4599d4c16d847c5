//! The table `[real_time]`: the settings that the service's loop requests from the system.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the loop asks of the system; everything absent: it is scheduled like any other thread.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RealTimeConfig {
    /// SCHED_FIFO with this priority, 1 … 98, for the loop's thread alone; absent: scheduled like any other.
    ///
    /// Needs CAP_SYS_NICE or RLIMIT_RTPRIO. 80 is above interrupt threads (50) and ordinary tasks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 98), example = 80)]
    pub priority: Option<u8>,
    /// Cores of the loop's thread, as `[2]`; the service's other threads stay off them. Absent: all.
    ///
    /// A core that nothing else uses (isolcpus, or CPUAffinity of the others) gives the least lateness.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1), extend("uniqueItems" = true), example = vec![2])]
    pub cores: Option<Vec<usize>>,
    /// Lock all memory, so that none is swapped out or mapped late.
    ///
    /// Needs CAP_IPC_LOCK or RLIMIT_MEMLOCK unlimited. Set it wherever a late tick costs something.
    pub lock_memory: bool,
    /// No core of the machine enters an idle state that takes time to leave; costs power.
    ///
    /// Set it where wake-up lateness of some 10 µs to 100 µs matters more than power; needs
    /// /dev/cpu_dma_latency.
    pub awake_cores: bool,
    /// Refuse to start when something of this is refused (as --require-real-time).
    ///
    /// For vehicles that must not fly without.
    pub required: bool,
}
