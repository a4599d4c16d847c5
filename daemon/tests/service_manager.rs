//! The notifications to systemd: readiness, the watchdog, which only ticks feed, and the end.

use crate::common::{Ended, PATIENCE, Process, TestDomain, daemon_command, wait_until};
use rustix::process::Signal;
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

/// The service manager's end of `NOTIFY_SOCKET`.
struct Manager {
    socket: UnixDatagram,
    directory: tempfile::TempDir,
}

impl Manager {
    fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let socket = UnixDatagram::bind(directory.path().join("notify")).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
        Self { socket, directory }
    }

    fn start(&self, domain: &TestDomain, timeout: Duration, arguments: &[&str]) -> Process {
        let mut command = daemon_command(domain, &[&["run"], arguments].concat());
        command.env("NOTIFY_SOCKET", self.directory.path().join("notify"));
        command.env("WATCHDOG_USEC", timeout.as_micros().to_string());
        Process::spawn(command)
    }

    /// The next message, if one arrives soon.
    fn hear(&self) -> Option<String> {
        let mut message = [0; 4096];
        let length = self.socket.recv(&mut message).ok()?;
        Some(String::from_utf8(message[..length].to_vec()).unwrap())
    }

    /// All messages of that time.
    fn hear_for(&self, time: Duration) -> Vec<String> {
        let end = Instant::now() + time;
        std::iter::from_fn(|| (Instant::now() < end).then(|| self.hear())).flatten().collect()
    }

    fn hear_until(&self, wanted: &str) -> Vec<String> {
        let mut heard = Vec::new();
        wait_until(wanted, || {
            heard.extend(self.hear());
            heard.iter().any(|message| message.starts_with(wanted))
        });
        heard
    }
}

fn feedings(messages: &[String]) -> usize {
    messages.iter().filter(|message| *message == "WATCHDOG=1\n").count()
}

#[test]
fn ready_then_fed_by_ticks_then_stopping() {
    let (manager, domain) = (Manager::new(), TestDomain::new());
    let daemon = manager.start(&domain, Duration::from_millis(400), &[]);
    manager.hear_until("READY=1\n");
    // All services exist: a client need not wait.
    shared_types::Client::connect(&domain.domain, "vehicle", Duration::ZERO).unwrap();
    manager.hear_until("WATCHDOG=1\n");
    let line = manager.hear_until("STATUS=").pop().unwrap();
    assert!(line.contains("ticks") && line.contains("no sample yet"), "{line}");

    // A process that stands still is not alive.
    daemon.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(50));
    while manager.hear().is_some() {}
    assert_eq!(feedings(&manager.hear_for(Duration::from_millis(600))), 0);
    daemon.signal(Signal::CONT);
    manager.hear_until("WATCHDOG=1\n");

    daemon.signal(Signal::TERM);
    manager.hear_until("STOPPING=1\n");
    let Ended { code, log, .. } = daemon.finish();
    assert_eq!(code, Some(0), "{log}");
    domain.assert_clean();
}

/// The housekeeping thread looks every 5 ms and could feed every 20 ms. It feeds only when the loop ticked: here once a
/// second.
#[test]
fn a_loop_that_does_not_tick_feeds_nothing() {
    let (manager, domain) = (Manager::new(), TestDomain::new());
    // Stable at such a rate only if it learns slowly.
    let config = tempfile::NamedTempFile::new().unwrap();
    let text =
        include_str!("../presets/linear.toml").replace("adaptation_rate = 50.0", "adaptation_rate = 5.0");
    std::fs::write(config.path(), text).unwrap();
    let arguments = ["--rate-hz", "1", "--config", config.path().to_str().unwrap()];
    let daemon = manager.start(&domain, Duration::from_millis(80), &arguments);
    manager.hear_until("READY=1\n");
    let start = Instant::now();
    let first_ticks = domain.status().counters.ticks;
    let heard = manager.hear_for(Duration::from_millis(3300));
    let ticks = domain.status().counters.ticks - first_ticks;
    assert!(start.elapsed() < PATIENCE);
    let fed = feedings(&heard) as u64;
    assert!(fed >= 1 && fed <= ticks + 1, "fed {fed} times in {ticks} ticks");
    daemon.stop();
}
