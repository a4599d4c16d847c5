//! Facts that affect punctuality: rights, cores, clock, kernel.

use super::fact::{Fact, Plan};
use crate::system::machine;
use crate::system::{real_time, settings};
use rustix::process::{Resource, getrlimit};
use rustix::thread::CapabilitySet;
use std::path::Path;

/// Reading the clock through the vDSO takes some tens of nanoseconds; a system call takes more than this.
const SYSTEM_CALL_NS: u64 = 150;
/// If a hypervisor takes more than this part of the processor time, measurements are not meaningful.
const MAX_STOLEN_SHARE: f64 = 0.001;

pub(super) fn all(plan: &Plan, before: Option<ProcessorTime>) -> Vec<Fact> {
    vec![
        scheduling_right(plan.priority),
        locked_memory_limit(),
        cores(),
        isolated_cores(),
        governor(),
        clock(),
        hypervisor(before),
        preemption(),
        throttling(),
        swap(),
        huge_pages(),
        awake_cores(),
        Fact::good("vector unit", observer::vector_unit()),
    ]
}

fn read(path: impl AsRef<Path>) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn scheduling_right(priority: u8) -> Fact {
    const NAME: &str = "scheduling right";
    let source = match getrlimit(Resource::Rtprio).current {
        _ if real_time::has(CapabilitySet::SYS_NICE) => "CAP_SYS_NICE".to_owned(),
        Some(limit) => format!("RLIMIT_RTPRIO is {limit}"),
        None => "RLIMIT_RTPRIO is unlimited".into(),
    };
    // Tried, in a thread that ends with it.
    let tried = std::thread::spawn(move || real_time::use_fifo(priority)).join();
    match tried {
        Ok(Ok(())) => Fact::good(NAME, format!("SCHED_FIFO {priority} granted; {source}")),
        Ok(Err(refused)) => Fact::better(
            NAME,
            format!("SCHED_FIFO {priority}: {}; {source}", refused.found),
            "LimitRTPRIO=98 (systemd), '@USER - rtprio 98' in /etc/security/limits.conf, or sudo setcap cap_sys_nice+ep PROGRAM",
        ),
        Err(_) => Fact::unknown(NAME, source),
    }
}

fn locked_memory_limit() -> Fact {
    const NAME: &str = "locked memory";
    match getrlimit(Resource::Memlock).current {
        _ if real_time::has(CapabilitySet::IPC_LOCK) => Fact::good(NAME, "unlimited (CAP_IPC_LOCK)"),
        None => Fact::good(NAME, "unlimited"),
        Some(limit) => Fact::better(
            NAME,
            format!("at most {} kB", limit / 1024),
            "LimitMEMLOCK=infinity (systemd), '@USER - memlock unlimited' in /etc/security/limits.conf, or sudo setcap cap_ipc_lock+ep PROGRAM",
        ),
    }
}

fn cores() -> Fact {
    const NAME: &str = "cores";
    let allowed = real_time::allowed_cores();
    let online = read("/sys/devices/system/cpu/online").unwrap_or_else(|| "unknown".into());
    let found = format!("this process may use {allowed:?}; online: {online}");
    match allowed.len() {
        0 => Fact::unknown(NAME, found),
        1 => Fact::better(
            NAME,
            found,
            "a second core for everything else: taskset -c, AllowedCPUs= of systemd, --cpuset-cpus of a container",
        ),
        _ => Fact::good(NAME, found),
    }
}

fn isolated_cores() -> Fact {
    const NAME: &str = "isolated cores";
    let list = |name: &str| read(format!("/sys/devices/system/cpu/{name}"));
    let Some(isolated) = list("isolated") else {
        return Fact::unknown(NAME, "the kernel does not tell");
    };
    let tickless = list("nohz_full").filter(|list| !list.is_empty() && list != "(null)");
    let tickless = tickless.map_or(String::new(), |list| format!("; without timer ticks: {list}"));
    match isolated.is_empty() {
        false => Fact::good(NAME, format!("{isolated}{tickless}; use them as real_time.cores")),
        true => Fact::better(
            NAME,
            format!("none{tickless}"),
            "kernel command line isolcpus=N nohz_full=N rcu_nocbs=N, then real_time.cores = [N]",
        ),
    }
}

fn governor() -> Fact {
    const NAME: &str = "frequency governor";
    let mut found: Vec<_> = real_time::allowed_cores()
        .into_iter()
        .filter_map(|core| read(format!("/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor")))
        .collect();
    found.sort();
    found.dedup();
    match found.as_slice() {
        [] => Fact::unknown(NAME, "the kernel controls no frequency here, as in most virtual machines"),
        [only] if only == "performance" => Fact::good(NAME, "performance"),
        others => Fact::better(NAME, others.join(", "), "sudo cpupower frequency-set --governor performance"),
    }
}

fn clock() -> Fact {
    const NAME: &str = "clock";
    let cost_ns = machine::clock_reading_ns();
    let place = "/sys/devices/system/clocksource/clocksource0";
    let source = read(format!("{place}/current_clocksource"));
    let available = read(format!("{place}/available_clocksource")).unwrap_or_default();
    let found = format!("{}, read in {cost_ns} ns", source.as_deref().unwrap_or("unknown source"));
    if cost_ns <= SYSTEM_CALL_NS {
        return Fact::good(NAME, found);
    }
    match available.split_whitespace().find(|name| ["tsc", "kvm-clock", "arch_sys_counter"].contains(name)) {
        Some(better) if source.as_deref() != Some(better) => {
            Fact::bad(NAME, found, format!("echo {better} | sudo tee {place}/current_clocksource"))
        }
        _ => Fact::bad(
            NAME,
            found,
            "each reading is a system call: look why the kernel distrusts its clock (dmesg | grep -i clocksource)",
        ),
    }
}

/// Processor time of all cores since the machine started, in ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ProcessorTime {
    all: u64,
    stolen: u64,
}

pub(super) fn processor_time() -> Option<ProcessorTime> {
    processor_time_of(&read("/proc/stat")?)
}

/// user nice system idle iowait irq softirq steal; what follows is contained in the first two.
fn processor_time_of(stat: &str) -> Option<ProcessorTime> {
    let line = stat.lines().find_map(|line| line.strip_prefix("cpu "))?;
    let ticks: Vec<u64> = line.split_whitespace().take(8).map_while(|ticks| ticks.parse().ok()).collect();
    Some(ProcessorTime { all: ticks.iter().sum(), stolen: *ticks.get(7)? })
}

fn hypervisor(before: Option<ProcessorTime>) -> Fact {
    const NAME: &str = "hypervisor";
    let is_guest = read("/proc/cpuinfo").is_some_and(|text| {
        let flags = text.lines().find(|line| line.starts_with("flags"));
        flags.is_some_and(|flags| flags.split_whitespace().any(|flag| flag == "hypervisor"))
    }) || Path::new("/sys/hypervisor/type").exists();
    let stolen = match (before, processor_time()) {
        (Some(before), Some(after)) if after.all > before.all => {
            after.stolen.saturating_sub(before.stolen) as f64 / (after.all - before.all) as f64
        }
        _ => 0.0,
    };
    let found = format!("{:.2} % of processor time stolen while measuring", 100.0 * stolen);
    if stolen > MAX_STOLEN_SHARE {
        let remedy = "ask the host for processors of this machine's own (pinned, not shared)";
        return Fact::bad(NAME, found, remedy);
    }
    match is_guest {
        false => Fact::good(NAME, "none"),
        true => Fact::better(
            NAME,
            format!("a virtual machine; {found}"),
            "maxima of lateness are the host's: fly on real hardware, or pin the virtual processors on the host",
        ),
    }
}

fn preemption() -> Fact {
    const NAME: &str = "kernel preemption";
    let Some(version) = read("/proc/version") else {
        return Fact::unknown(NAME, "the kernel does not tell");
    };
    let release = version.split_whitespace().nth(2).unwrap_or("of unknown release").to_owned();
    let has = |model: &str| version.split_whitespace().any(|word| word == model);
    let found = |model: &str| format!("{model}, Linux {release}");
    let chosen = read("/sys/kernel/debug/sched/preempt")
        .and_then(|text| Some(text.split_once('(')?.1.split_once(')')?.0.to_owned()));
    if has("PREEMPT_RT") || read("/sys/kernel/realtime").as_deref() == Some("1") {
        return Fact::good(NAME, found("PREEMPT_RT"));
    }
    let remedy = "a kernel with PREEMPT_RT bounds the maxima (linux-image-rt-amd64 of Debian, Ubuntu's real-time kernel)";
    match (has("PREEMPT_DYNAMIC"), chosen) {
        (true, Some(chosen)) => Fact::better(NAME, found(&format!("PREEMPT_DYNAMIC ({chosen})")), remedy),
        (true, None) => Fact::better(NAME, found("PREEMPT_DYNAMIC"), remedy),
        (false, _) if has("PREEMPT") => Fact::better(NAME, found("PREEMPT"), remedy),
        (false, _) => Fact::bad(NAME, found("none or voluntary"), remedy),
    }
}

fn throttling() -> Fact {
    const NAME: &str = "real-time throttling";
    match settings::throttling() {
        None => Fact::good(NAME, "none, or the kernel does not tell"),
        Some(found) => Fact::good(
            NAME,
            format!(
                "{found}: it only concerns a loop that polls (trigger = \"sample\", long spin_us) at a fixed priority; \
                 with a core of its own: sudo sysctl -w kernel.sched_rt_runtime_us=-1"
            ),
        ),
    }
}

fn swap() -> Fact {
    const NAME: &str = "swap";
    match read("/proc/swaps").map(|text| text.lines().count().saturating_sub(1)) {
        None => Fact::unknown(NAME, "the kernel does not tell"),
        Some(0) => Fact::good(NAME, "none"),
        Some(n) => Fact::better(
            NAME,
            format!("{n} in use"),
            "real_time.lock_memory = true, or sudo swapoff --all, before the flight",
        ),
    }
}

fn huge_pages() -> Fact {
    const NAME: &str = "transparent huge pages";
    let Some(text) = read("/sys/kernel/mm/transparent_hugepage/enabled") else {
        return Fact::unknown(NAME, "the kernel has none");
    };
    let chosen =
        text.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map_or("unknown", |(word, _)| word);
    match chosen {
        "always" => Fact::better(
            NAME,
            "always: the kernel may move pages of a running loop",
            "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled",
        ),
        other => Fact::good(NAME, other),
    }
}

fn awake_cores() -> Fact {
    const NAME: &str = "idle states";
    let states = std::fs::read_dir("/sys/devices/system/cpu/cpu0/cpuidle");
    let states = states.map_or(0, |entries| {
        entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with("state")).count()
    });
    let found = match states {
        0 => "no idle states known to the kernel".to_owned(),
        n => format!("{n} idle states"),
    };
    match real_time::keep_cores_awake() {
        Ok(_request) => Fact::good(NAME, format!("{found}; /dev/cpu_dma_latency granted")),
        Err(refused) if states == 0 => Fact::good(NAME, format!("{found}; {}", refused.found)),
        Err(refused) => Fact::better(
            NAME,
            format!("{found}; /dev/cpu_dma_latency: {}", refused.found),
            "a rule for udev: KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stolen_time_is_the_eighth_field_of_the_first_line() {
        let stat = "cpu  100 1 50 1000 5 0 4 40 7 0\ncpu0 1 1 1 1 1 1 1 1 0 0\n";
        assert_eq!(processor_time_of(stat), Some(ProcessorTime { all: 1200, stolen: 40 }));
        assert_eq!(processor_time_of("cpu  1 2 3\n"), None);
        assert_eq!(processor_time_of(""), None);
    }

    #[test]
    fn every_verdict_but_good_and_unknown_comes_with_what_would_help() {
        let plan = Plan { rate_hz: 100.0, spin_us: 0.0, seconds: 0.1, priority: 10, cores: None };
        let facts = all(&plan, processor_time());
        for fact in &facts {
            use super::super::fact::Verdict;
            let needs_help = matches!(fact.verdict, Verdict::CouldBeBetter | Verdict::Bad);
            assert_eq!(needs_help, fact.remedy.is_some(), "{fact:?}");
            assert!(!fact.found.is_empty(), "{fact:?}");
        }
    }
}
