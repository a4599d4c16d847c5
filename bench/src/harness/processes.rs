//! The processes of a measurement and their domain. Both are removed when the measurement ends, also after an error.

use anyhow::{Context, bail};
use daemon::config::PRESETS;
use daemon::system::real_time;
use rustix::process::{Pid, Signal, WaitOptions, kill_process, waitpid};
use shared_types::{Client, Domain};
use std::fs::{self, File};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use tempfile::NamedTempFile;

/// How long a process may take to answer.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10);

/// A domain that is removed at the end.
pub(crate) struct OwnDomain {
    domain: Domain,
    _root: tempfile::TempDir,
}

impl OwnDomain {
    /// A domain whose files in /dev/shm begin with `bench` and this process's id, so that leftovers of a killed process
    /// can be identified. The prefix is short: root path and segments' prefix have 60 bytes together ([`Domain::at`]).
    pub(crate) fn new() -> anyhow::Result<Self> {
        let prefix = format!("bench{}-", std::process::id());
        let root = tempfile::Builder::new().prefix(&prefix).tempdir_in("/dev/shm");
        let root = root.context("make a directory in /dev/shm")?;
        Ok(Self { domain: Domain::at(root.path())?, _root: root })
    }

    pub(crate) fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Memory that its segments and files take.
    pub(crate) fn shm_bytes(&self) -> anyhow::Result<u64> {
        fn below(path: &Path) -> u64 {
            let entries = fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
            entries.map(|path| if path.is_dir() { below(&path) } else { bytes(&path) }).sum()
        }
        // Blocks, not length: an untouched page takes no memory.
        fn bytes(path: &Path) -> u64 {
            fs::symlink_metadata(path).map_or(0, |metadata| 512 * metadata.blocks())
        }
        let segments = self.domain.segments()?;
        Ok(segments.iter().map(|path| bytes(path)).sum::<u64>() + below(self.domain.root()))
    }
}

impl Drop for OwnDomain {
    fn drop(&mut self) {
        // The temporary directory removes what is left after this.
        let _ = self.domain.remove();
    }
}

/// One of this program's roles as a process of its own; terminated with this value.
pub(crate) struct Child {
    name: String,
    process: std::process::Child,
    output: File,
    log: File,
    _config: Option<NamedTempFile>,
}

/// What a measurement sets of a service's configuration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ServiceSettings<'a> {
    pub(crate) preset: &'a str,
    pub(crate) trigger: &'a str,
    pub(crate) rate_hz: f64,
    pub(crate) spin_us: f64,
}

impl Child {
    /// Starts the service of `instance`, on these cores.
    pub(crate) fn start_service(
        domain: &OwnDomain,
        instance: &str,
        settings: &ServiceSettings<'_>,
        cores: &[usize],
    ) -> anyhow::Result<Self> {
        let ServiceSettings { preset, trigger, rate_hz, spin_us } = *settings;
        let (_, text) = *PRESETS.iter().find(|(name, _)| *name == preset).context("an unknown preset")?;
        let mut config = NamedTempFile::new().context("make the configuration's file")?;
        write!(config, "trigger = \"{trigger}\"\nspin_us = {spin_us:?}\n{text}")?;
        let path = config.path().to_str().context("the configuration's path is no text")?.to_owned();
        let rate_hz = rate_hz.to_string();
        let arguments = ["daemon", "run", "--instance", instance, "--rate-hz", &rate_hz, "--config", &path];
        let mut child = Self::start_on(domain, &arguments, cores)?;
        child._config = Some(config);
        Ok(child)
    }

    /// As [`Child::start`], on these cores from its first instruction on.
    pub(crate) fn start_on(domain: &OwnDomain, arguments: &[&str], cores: &[usize]) -> anyhow::Result<Self> {
        // A process inherits the cores of the thread that starts it.
        let ours = real_time::allowed_cores();
        real_time::stay_on_cores(cores)?;
        let child = Self::start(domain, arguments);
        real_time::stay_on_cores(&ours)?;
        child
    }

    /// Starts `bench ROLE …` in that domain.
    pub(crate) fn start(domain: &OwnDomain, arguments: &[&str]) -> anyhow::Result<Self> {
        let name = arguments[0].to_owned();
        let program = std::env::current_exe().context("find this program's file")?;
        let (output, log) = (tempfile::tempfile()?, tempfile::tempfile()?);
        let process = Command::new(program)
            .args(arguments)
            .arg("--root")
            .arg(domain.domain().root())
            // A measurement saves no snapshots.
            .env("OBSERVER_STATE", "none")
            .stdin(Stdio::null())
            .stdout(output.try_clone()?)
            .stderr(log.try_clone()?)
            // A group of its own: Ctrl-C reaches the demo alone, which then ends its processes in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("start {name}"))?;
        Ok(Self { name, process, output, log, _config: None })
    }

    pub(crate) fn has_ended(&mut self) -> anyhow::Result<bool> {
        Ok(self.process.try_wait()?.is_some())
    }

    /// Processor time of all of its threads (ns).
    pub(crate) fn cpu_ns(&self) -> anyhow::Result<u64> {
        cpu_ns(self.process.id())
    }

    /// Resident memory that it does not share with files or other processes (kB).
    pub(crate) fn private_kb(&self) -> anyhow::Result<u64> {
        private_kb(self.process.id())
    }

    /// Stops all of its threads where they are, and returns once they stand still: it costs no core then.
    pub(crate) fn pause(&self) -> anyhow::Result<()> {
        let pid = Pid::from_child(&self.process);
        kill_process(pid, Signal::STOP).with_context(|| format!("stop {}", self.name))?;
        match waitpid(Some(pid), WaitOptions::UNTRACED)? {
            Some((_, status)) if status.stopped() => Ok(()),
            _ => bail!("{} ended: {}", self.name, self.log()),
        }
    }

    /// Lets it go on after [`Child::pause`].
    pub(crate) fn go_on(&self) -> anyhow::Result<()> {
        kill_process(Pid::from_child(&self.process), Signal::CONT)
            .with_context(|| format!("continue {}", self.name))
    }

    /// Asks it to end, as Ctrl-C does.
    pub(crate) fn terminate(&self) {
        // It may have ended already.
        let _ = kill_process(Pid::from_child(&self.process), Signal::TERM);
    }

    /// Asks it to end, and waits until it has.
    pub(crate) fn stop(self) -> anyhow::Result<()> {
        self.terminate();
        self.finish().map(drop)
    }

    /// Connects to its service's instance; an error contains the service's log.
    pub(crate) fn connect(&self, domain: &OwnDomain, instance: &str) -> anyhow::Result<Client> {
        Client::connect(domain.domain(), instance, PATIENCE)
            .or_else(|error| Err(error).with_context(|| self.log()))
    }

    /// Waits for the end of a vehicle and returns the document that it printed, and how many samples it sent.
    pub(crate) fn finish_with_summary(self) -> anyhow::Result<(serde_json::Value, u64)> {
        let summary: serde_json::Value =
            serde_json::from_str(&self.finish()?).context("read the vehicle's summary")?;
        let n_samples =
            summary["samples_published"].as_u64().context("the vehicle's summary has no samples")?;
        Ok((summary, n_samples))
    }

    /// Waits for its end and returns what it printed.
    pub(crate) fn finish(mut self) -> anyhow::Result<String> {
        let status = self.process.wait()?;
        if !status.success() {
            bail!("{} failed ({status}): {}", self.name, self.log());
        }
        read_all(&mut self.output)
    }

    /// Its log so far.
    pub(crate) fn log(&self) -> String {
        let log = self.log.try_clone().map_err(anyhow::Error::from).and_then(|mut log| read_all(&mut log));
        format!("{}: {}", self.name, log.unwrap_or_default().trim_end())
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        if let Ok(None) = self.process.try_wait() {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
    }
}

fn cpu_ns(pid: u32) -> anyhow::Result<u64> {
    let mut sum_ns = 0;
    for thread in fs::read_dir(format!("/proc/{pid}/task"))? {
        let text = fs::read_to_string(thread?.path().join("schedstat"))?;
        let on_cpu_ns = text.split_whitespace().next().and_then(|ns| ns.parse::<u64>().ok());
        sum_ns += on_cpu_ns.with_context(|| format!("schedstat of process {pid}: '{text}'"))?;
    }
    Ok(sum_ns)
}

fn private_kb(pid: u32) -> anyhow::Result<u64> {
    let text = fs::read_to_string(format!("/proc/{pid}/status")).context("read a process's memory")?;
    let line = text.lines().find_map(|line| line.strip_prefix("RssAnon:"));
    let number = line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse().ok());
    number.context("/proc/PID/status has no RssAnon")
}

fn read_all(file: &mut File) -> anyhow::Result<String> {
    let mut text = String::new();
    file.rewind()?;
    file.read_to_string(&mut text)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn a_process_s_own_use_is_read_from_the_kernel() {
        let pid = std::process::id();
        let before_ns = cpu_ns(pid).unwrap();
        let started = Instant::now();
        while started.elapsed() < Duration::from_millis(30) {
            std::hint::spin_loop();
        }
        assert!(cpu_ns(pid).unwrap() > before_ns);
        assert!(private_kb(pid).unwrap() > 0);
        assert!(private_kb(u32::MAX).is_err());
    }
}
