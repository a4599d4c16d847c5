//! Real-time settings of a thread: cores, a fixed priority, timers without slack, locked memory, no idle states.
//!
//! They affect when an estimate is published, not its value. Each call reads back the value that is then in effect. An error
//! says what was requested, why it was refused and what would help; the caller continues without the setting.

use rustix::mm::{MlockAllFlags, mlockall, munlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, current_timer_slack, sched_getaffinity, sched_setaffinity,
    set_current_timer_slack,
};
use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZeroU64;
use thread_priority::{
    Error as PriorityError, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id, thread_schedule_policy_param,
};

pub(super) const CORES_REMEDY: &str =
    "see the cores of this process with taskset -p, of the machine with lscpu";
pub(super) const FIFO_REMEDY: &str =
    "needed: root, CAP_SYS_NICE, or a limit (ulimit -r, LimitRTPRIO= of systemd) of that";
pub(super) const TIMERS_REMEDY: &str = "nothing to do: waits may end 50 µs later";
pub(super) const MEMORY_REMEDY: &str =
    "needed: root, CAP_IPC_LOCK, or ulimit -l unlimited (LimitMEMLOCK=infinity of systemd)";
pub(super) const AWAKE_REMEDY: &str = "needed: read and write permission on that file, by default root's";

/// A request that the system did not grant.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{asked}: {found}; {remedy}")]
pub struct Refused {
    /// What was asked for.
    pub asked: String,
    /// The system's reason.
    pub found: String,
    /// What would help.
    pub remedy: &'static str,
}

fn refused(asked: impl Into<String>, found: impl ToString, remedy: &'static str) -> Refused {
    Refused { asked: asked.into(), found: found.to_string(), remedy }
}

/// The cores that the calling thread may run on, in ascending order; empty if the system does not report them.
pub fn allowed_cores() -> Vec<usize> {
    let allowed = sched_getaffinity(None).unwrap_or_default();
    (0..CpuSet::MAX_CPU).filter(|&core| allowed.is_set(core)).collect()
}

/// Keeps the calling thread on these cores; threads and processes that it starts inherit that.
///
/// # Errors
/// `Refused` where no such core exists or the process may not use one of them: the kernel grants the allowed part of a
/// set without an error.
pub fn stay_on_cores(cores: &[usize]) -> Result<(), Refused> {
    let asked = || format!("run on cores {cores:?} only");
    let mut set = CpuSet::new();
    for &core in cores {
        if core >= CpuSet::MAX_CPU {
            return Err(refused(
                asked(),
                format!("core {core} is beyond what a CPU set holds"),
                CORES_REMEDY,
            ));
        }
        set.set(core);
    }
    sched_setaffinity(None, &set).map_err(|error| refused(asked(), error, CORES_REMEDY))?;
    match allowed_cores() {
        found if cores.iter().all(|core| found.contains(core)) => Ok(()),
        found => Err(refused(asked(), format!("cores {found:?} were given"), CORES_REMEDY)),
    }
}

/// Gives the calling thread a fixed priority (SCHED_FIFO), 1 to 99: it runs whenever it can, before every
/// ordinary thread and those of lower priority, until it sleeps.
///
/// # Errors
/// `Refused` without the right to it, or for a priority out of range.
pub fn use_fifo(priority: u8) -> Result<(), Refused> {
    let found = match priority.try_into() {
        Ok(value) => set_thread_priority_and_policy(
            thread_native_id(),
            ThreadPriority::Crossplatform(value),
            ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
        ),
        Err(_) => Err(PriorityError::PriorityNotInRange(1..=99)),
    };
    let asked = || format!("SCHED_FIFO with priority {priority}");
    found.map_err(|error| {
        let found = match error {
            PriorityError::OS(code) => std::io::Error::from_raw_os_error(code).to_string(),
            PriorityError::PriorityNotInRange(range) => format!("{priority} is not in {range:?}"),
            other => format!("{other:?}"),
        };
        refused(asked(), found, FIFO_REMEDY)
    })?;
    match scheduling() {
        Some(("SCHED_FIFO", found)) if found == i32::from(priority) => Ok(()),
        found => Err(refused(asked(), format!("the thread has {found:?}"), FIFO_REMEDY)),
    }
}

/// Policy and priority of the calling thread, as the kernel says.
fn scheduling() -> Option<(&'static str, i32)> {
    let (policy, parameters) = thread_schedule_policy_param(thread_native_id()).ok()?;
    let name = match policy {
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo) => "SCHED_FIFO",
        ThreadSchedulePolicy::Realtime(_) => "another real-time policy",
        ThreadSchedulePolicy::Normal(_) => "an ordinary policy",
    };
    Some((name, parameters.sched_priority))
}

/// Removes the 50 µs by which the kernel may delay the calling thread's timers to serve several at once.
/// A thread with a fixed priority has none anyway; for an ordinary one no right is needed.
///
/// # Errors
/// `Refused` if the kernel has no timer slack.
pub fn use_punctual_timers() -> Result<(), Refused> {
    const ASKED: &str = "timers without slack";
    set_current_timer_slack(NonZeroU64::new(1)).map_err(|error| refused(ASKED, error, TIMERS_REMEDY))?;
    match current_timer_slack() {
        Ok(0 | 1) => Ok(()),
        slack => Err(refused(ASKED, format!("slack of {slack:?} ns"), TIMERS_REMEDY)),
    }
}

/// Keeps all memory of this process, present and future, from being swapped out or mapped only when it is
/// first touched.
///
/// Also refused if a limit would make later allocations fail: without the right, the limit must be infinite.
///
/// # Errors
/// `Refused` without the right to it.
pub fn lock_memory() -> Result<(), Refused> {
    const ASKED: &str = "lock all memory";
    if let Some(limit) = getrlimit(Resource::Memlock).current.filter(|_| !has(CapabilitySet::IPC_LOCK)) {
        return Err(refused(ASKED, format!("the limit is {} kB", limit / 1024), MEMORY_REMEDY));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        .map_err(|error| refused(ASKED, error, MEMORY_REMEDY))?;
    match locked_and_occupied_kb() {
        // Locked memory contains what is only reserved, for heaps of threads that may come.
        Some((locked, occupied)) if locked >= occupied => Ok(()),
        found => {
            unlock_memory();
            Err(refused(ASKED, format!("locked and occupied (kB): {found:?}"), MEMORY_REMEDY))
        }
    }
}

/// Takes [`lock_memory`] back.
pub fn unlock_memory() {
    // It fails only where nothing can be locked either.
    let _ = munlockall();
}

/// Locked memory of this process, and that which it occupies (kB).
fn locked_and_occupied_kb() -> Option<(u64, u64)> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kb = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse().ok()
    };
    Some((kb("VmLck:")?, kb("VmRSS:")?))
}

/// Whether the calling thread has a capability in effect.
pub fn has(capability: CapabilitySet) -> bool {
    capabilities(None).is_ok_and(|sets| sets.effective.contains(capability))
}

/// While it lives, no core enters an idle state that takes time to leave.
#[derive(Debug)]
pub struct AwakeCores {
    _request: File,
}

/// Disables idle states that take time to leave, which costs power. It holds for the whole machine until the
/// returned value is dropped.
///
/// # Errors
/// `Refused` without the right to it, or where the kernel does not offer it.
pub fn keep_cores_awake() -> Result<AwakeCores, Refused> {
    const REQUEST: &str = "/dev/cpu_dma_latency";
    let open = || -> std::io::Result<File> {
        let mut request = File::options().read(true).write(true).open(REQUEST)?;
        // The longest latency that is accepted (µs), as 32 bits; read back, the shortest that anyone asks for.
        request.write_all(&0_i32.to_ne_bytes())?;
        let mut found = [1; 4];
        request.read_exact(&mut found)?;
        match i32::from_ne_bytes(found) {
            0 => Ok(request),
            latency_us => Err(std::io::Error::other(format!("the kernel keeps to {latency_us} µs"))),
        }
    };
    open()
        .map(|request| AwakeCores { _request: request })
        .map_err(|error| refused(format!("cores that wake up at once ({REQUEST})"), error, AWAKE_REMEDY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_stays_on_its_core() {
        std::thread::spawn(|| {
            let cores = allowed_cores();
            let last = *cores.last().expect("at least one core");
            stay_on_cores(&[last]).unwrap();
            assert_eq!(allowed_cores(), [last]);
            assert_eq!(rustix::thread::sched_getcpu(), last);
            stay_on_cores(&cores).unwrap();
            assert_eq!(allowed_cores(), cores);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn what_is_refused_says_what_was_found_and_what_would_help() {
        let beyond = stay_on_cores(&[1_000_000]).unwrap_err().to_string();
        assert!(beyond.contains("1000000") && beyond.contains("taskset"), "{beyond}");
        for priority in [0, 100, 255] {
            let error = use_fifo(priority).unwrap_err();
            assert!(error.found.contains("1..=99"), "{error}");
        }
    }

    #[test]
    fn timers_lose_their_slack() {
        std::thread::spawn(|| {
            use_punctual_timers().unwrap();
            assert_eq!(rustix::thread::current_timer_slack().unwrap(), 1);
        })
        .join()
        .unwrap();
    }

    /// Whether it is granted is the machine's affair; then it must be so.
    #[test]
    fn a_granted_priority_is_the_thread_s_own() {
        std::thread::spawn(|| match use_fifo(10) {
            Ok(()) => {
                let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
                assert_eq!(thread_priority::thread_schedule_policy().unwrap(), fifo);
            }
            Err(refused) => assert!(refused.remedy.contains("LimitRTPRIO"), "{refused}"),
        })
        .join()
        .unwrap();
    }
}
