//! `[real_time]`: what the service's loop asks of the system, and the combinations that would do harm.

use super::{ConfigError, ConfigFile, Trigger};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Priority 99 is that of the kernel's own watchdog and migration threads.
const HIGHEST_PRIORITY: u8 = 98;
/// A loop with a fixed priority that polls for more than this part of the only core starves everything else.
const LARGEST_SHARE_OF_THE_ONLY_CORE: f64 = 0.5;

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
    #[schemars(length(min = 1), extend("uniqueItems" = true), example = [2])]
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

impl ConfigFile {
    /// Replaces settings of `[real_time]`, as the command line does.
    pub fn set_real_time(&mut self, change: impl FnOnce(&mut RealTimeConfig)) {
        change(&mut self.config.real_time);
    }

    /// What needs no look at the machine.
    pub(super) fn check_real_time(&self) -> Result<(), ConfigError> {
        let real_time = &self.config.real_time;
        if let Some(priority) = real_time.priority.filter(|p| !(1..=HIGHEST_PRIORITY).contains(p)) {
            let needed = format!("1 … {HIGHEST_PRIORITY} (99 is the kernel's own), or no such key");
            return Err(self.wrong("real_time.priority", &priority.to_string(), &needed));
        }
        let Some(cores) = &real_time.cores else { return Ok(()) };
        let mut sorted = cores.clone();
        sorted.sort_unstable();
        sorted.dedup();
        if sorted.len() != cores.len() || cores.is_empty() {
            let needed = "at least one core, each once, as [2] or [2, 3]; or no such key";
            return Err(self.wrong("real_time.cores", &format!("{cores:?}"), needed));
        }
        Ok(())
    }

    /// What the cores decide that this process may use: those asked for must be among them, and a loop that
    /// polls at a fixed priority must not have the only one.
    ///
    /// # Errors
    /// The key, its line, what was found and what would be accepted.
    pub fn check_cores(&self, allowed: &[usize]) -> Result<(), ConfigError> {
        let config = &self.config;
        let real_time = &config.real_time;
        let not_allowed =
            |cores: &&Vec<usize>| !allowed.is_empty() && cores.iter().any(|core| !allowed.contains(core));
        if let Some(cores) = real_time.cores.as_ref().filter(not_allowed) {
            let needed = format!(
                "some of {allowed:?}, which this process may use (taskset -cp PID; AllowedCPUs= of systemd, --cpuset-cpus of a container)"
            );
            return Err(self.wrong("real_time.cores", &format!("{cores:?}"), &needed));
        }
        if real_time.priority.is_none() || allowed.len() != 1 {
            return Ok(());
        }
        let (key, found) = if config.trigger == Trigger::Sample {
            ("trigger", "\"sample\"".to_owned())
        } else if config.spin_us * 1e-6 * config.rate_hz > LARGEST_SHARE_OF_THE_ONLY_CORE {
            ("spin_us", config.spin_us.to_string())
        } else {
            return Ok(());
        };
        let needed = "a second core, trigger = \"timer\" with spin_us below half a period, or no real_time.priority: \
                      polling at a fixed priority on the only core starves every other thread, and the kernel then stops \
                      the loop for 50 ms of every second (sched_rt_runtime_us)";
        Err(self.wrong(key, &found, needed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(before: &str, table: &str) -> ConfigFile {
        // Lines before and after the preset's own, which are whole ones.
        let text = format!("{before}\n{}\n[real_time]\n{table}\n", super::super::PRESETS[0].1);
        ConfigFile::parse("vehicle.toml".into(), text).unwrap()
    }

    #[test]
    fn dangerous_settings_are_refused_with_their_line_and_reason() {
        for (table, parts) in [
            ("priority = 99", ["real_time.priority", "found 99", "1 … 98"]),
            ("priority = 0", ["real_time.priority", "found 0", "1 … 98"]),
            ("cores = []", ["real_time.cores", "found []", "at least one core"]),
            ("cores = [1, 1]", ["real_time.cores", "found [1, 1]", "each once"]),
        ] {
            let error = file("", table).estimator().unwrap_err().to_string();
            let line = format!("vehicle.toml, line {}", super::super::PRESETS[0].1.lines().count() + 4);
            assert!(parts.iter().all(|part| error.contains(part)) && error.contains(&line), "{error}");
        }
        let text = format!("{}\n[real_time]\npriority = -1\n", super::super::PRESETS[0].1);
        assert!(ConfigFile::parse("vehicle.toml".into(), text).is_err());
    }

    #[test]
    fn cores_must_be_among_those_allowed_and_polling_must_leave_one() {
        let fine = file("", "cores = [1]\npriority = 80");
        fine.check_cores(&[0, 1]).unwrap();
        let error = fine.check_cores(&[0, 2]).unwrap_err().to_string();
        assert!(error.contains("found [1]") && error.contains("[0, 2]"), "{error}");
        // Unknown cores: the system is asked, and answers.
        fine.check_cores(&[]).unwrap();

        let polling = |before: &str| file(before, "priority = 80").check_cores(&[0]);
        let error = polling("trigger = \"sample\"").unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("starves"), "{error}");
        // rate_hz of the preset is 200: half a period is 2500 µs.
        polling("spin_us = 2600.0").unwrap_err();
        polling("spin_us = 200.0").unwrap();
        file("trigger = \"sample\"", "priority = 80").check_cores(&[0, 1]).unwrap();
        file("trigger = \"sample\"", "").check_cores(&[0]).unwrap();
    }
}
