//! The demo's processes and its domain: both are gone when it ends, however it ends.

use anyhow::{Context, bail};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::Domain;
use std::fs::File;
use std::io::{Read, Seek};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

/// A domain that is removed at the end.
pub(super) struct OwnDomain {
    domain: Domain,
    _root: tempfile::TempDir,
}

impl OwnDomain {
    pub(super) fn new() -> anyhow::Result<Self> {
        let root = tempfile::Builder::new().prefix("demo").tempdir_in("/dev/shm");
        let root = root.context("make a directory in /dev/shm")?;
        Ok(Self { domain: Domain::at(root.path())?, _root: root })
    }

    pub(super) fn domain(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for OwnDomain {
    fn drop(&mut self) {
        // Whatever is left after this is the temporary directory's to remove.
        let _ = self.domain.remove();
    }
}

/// One of this program's roles as a process of its own; terminated with this value.
pub(super) struct Child {
    name: String,
    process: std::process::Child,
    output: File,
    log: File,
}

impl Child {
    /// Starts `bench ROLE …` in that domain.
    pub(super) fn start(domain: &OwnDomain, arguments: &[&str]) -> anyhow::Result<Self> {
        let name = arguments[0].to_owned();
        let program = std::env::current_exe().context("find this program's file")?;
        let (output, log) = (tempfile::tempfile()?, tempfile::tempfile()?);
        let process = Command::new(program)
            .args(arguments)
            .arg("--root")
            .arg(domain.domain().root())
            .stdin(Stdio::null())
            .stdout(output.try_clone()?)
            .stderr(log.try_clone()?)
            // A group of its own: Ctrl-C reaches the demo alone, which then ends its processes in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("start {name}"))?;
        Ok(Self { name, process, output, log })
    }

    pub(super) fn has_ended(&mut self) -> anyhow::Result<bool> {
        Ok(self.process.try_wait()?.is_some())
    }

    /// Asks it to end, as Ctrl-C does.
    pub(super) fn terminate(&self) {
        // It may have ended already.
        let _ = kill_process(Pid::from_child(&self.process), Signal::TERM);
    }

    /// Waits for its end and returns what it printed.
    pub(super) fn finish(mut self) -> anyhow::Result<String> {
        let status = self.process.wait()?;
        if !status.success() {
            bail!("{} failed ({status}): {}", self.name, self.log());
        }
        read_all(&mut self.output)
    }

    /// What it logged so far.
    pub(super) fn log(&self) -> String {
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

fn read_all(file: &mut File) -> anyhow::Result<String> {
    let mut text = String::new();
    file.rewind()?;
    file.read_to_string(&mut text)?;
    Ok(text)
}
