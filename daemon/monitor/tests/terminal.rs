//! The live view in a real terminal (tmux), beside a real service.

use crate::programs::{service, vehicle};
use rustix::process::{Pid, Signal, kill_process};
use std::process::Command;
use std::time::{Duration, Instant};
use testkit::{PATIENCE, TestDomain, skip, wait_until};

/// A tmux server of our own with one pane.
struct Pane {
    directory: tempfile::TempDir,
}

impl Pane {
    /// The monitor in a shell that outlives it and reports its exit code; `None`, reported as skipped, without tmux.
    fn open(domain: &TestDomain, variables: &str, options: &str) -> Option<Self> {
        if Command::new("tmux").arg("-V").output().is_err() {
            skip("the view in a terminal", "tmux is not installed");
            return None;
        }
        let pane = Self { directory: tempfile::tempdir().unwrap() };
        let program = env!("CARGO_BIN_EXE_monitor");
        let root = domain.root().display();
        let line = format!(
            "{variables} '{program}' {options} --root '{root}'; echo code $?; stty -a; exec sleep 1000"
        );
        let configuration = pane.directory.path().join("conf");
        std::fs::write(&configuration, "set -g status off\n").unwrap();
        let configuration = configuration.to_str().unwrap();
        pane.tmux(&["-f", configuration, "new-session", "-d", "-x", "80", "-y", "24", "sh", "-c", &line]);
        Some(pane)
    }

    fn tmux(&self, arguments: &[&str]) -> String {
        let output = Command::new("tmux")
            .args(["-u", "-S"])
            .arg(self.directory.path().join("socket"))
            .args(arguments)
            .env("LC_ALL", "C.UTF-8")
            .env_remove("TMUX")
            .output()
            .unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// The process id of the monitor.
    fn pid(&self) -> i32 {
        let shell = self.tmux(&["display-message", "-p", "#{pane_pid}"]);
        let shell = shell.trim();
        let children = std::fs::read_to_string(format!("/proc/{shell}/task/{shell}/children")).unwrap();
        children.trim().parse().unwrap()
    }

    fn text(&self) -> String {
        self.tmux(&["capture-pane", "-p"])
    }

    fn press(&self, key: &str) {
        self.tmux(&["send-keys", key]);
    }

    fn wait_for(&self, needed: &[&str]) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let text = self.text();
            let missing: Vec<_> = needed.iter().filter(|needed| !text.contains(*needed)).collect();
            if missing.is_empty() {
                if let Ok(directory) = std::env::var("MONITOR_PANES") {
                    let name: String = needed[0].chars().filter(char::is_ascii_alphanumeric).collect();
                    std::fs::write(format!("{directory}/{name}"), text).unwrap();
                }
                return;
            }
            assert!(Instant::now() < deadline, "waited {PATIENCE:?} for {missing:?} in:\n{text}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Pane {
    fn drop(&mut self) {
        let socket = self.directory.path().join("socket");
        let _ = Command::new("tmux").arg("-S").arg(socket).arg("kill-server").output();
    }
}

#[test]
fn the_view_follows_a_service_through_its_life() {
    let domain = TestDomain::new();
    let Some(pane) = Pane::open(&domain, "", "") else { return };
    pane.wait_for(&["NO SERVICE yet; waiting since", "no process runs it; start it: daemon run"]);

    let daemon = service(&domain, "--preset rigid-body --fresh");
    pane.wait_for(&["no sample yet", "DO NOT FLY ON THIS", "200 Hz"]);
    let flight = vehicle(&domain, "");
    pane.wait_for(&["TRACKING, learning", "learns", "process ", "off the truth", "velocity m/s"]);

    flight.signal(Signal::STOP);
    pane.wait_for(&["coasting-translation: no velocity for", "predicts"]);
    pane.wait_for(&["stale: no good sample for", "DO NOT FLY ON THIS"]);
    flight.signal(Signal::CONT);
    pane.wait_for(&["TRACKING"]);

    daemon.signal(Signal::STOP);
    pane.wait_for(&["the service is away", "runs it and publishes nothing: it is stopped"]);
    daemon.signal(Signal::CONT);
    pane.wait_for(&["TRACKING"]);

    // Long enough for the ports to be given back.
    daemon.kill();
    pane.wait_for(&["the service is away", "no process runs it"]);
    std::thread::sleep(Duration::from_secs(4));
    let daemon = service(&domain, "--preset rigid-body");
    pane.wait_for(&["TRACKING", "restarts 1"]);

    pane.tmux(&["resize-window", "-x", "60", "-y", "15"]);
    pane.wait_for(&["80×24 shows all", "TRACKING", "velocity m/s"]);
    pane.tmux(&["resize-window", "-x", "200", "-y", "50"]);
    pane.wait_for(&["error until now", "p99.9", "SAMPLE TO OUTPUT", "TRACKING"]);

    flight.stop().ok();
    daemon.stop().ok();
    pane.wait_for(&["the service is away", "no process runs it"]);
    pane.press("q");
    pane.wait_for(&["code 0"]);
    domain.assert_clean();
}

#[test]
fn keys_act_on_the_service() {
    let domain = TestDomain::new();
    let daemon = service(&domain, "--preset rigid-body --fresh");
    let flight = vehicle(&domain, "");
    wait_until("samples", || domain.status().counters.samples_accepted > 0);
    let Some(pane) = Pane::open(&domain, "", "--fps 20") else { return };
    pane.wait_for(&["TRACKING"]);

    pane.press("f");
    pane.wait_for(&["freeze: adaptation frozen", "frozen: an operator"]);
    assert_eq!(domain.status().adaptation_frozen, 1);
    pane.press("f");
    pane.wait_for(&["thaw: adaptation resumed"]);
    assert_eq!(domain.status().adaptation_frozen, 0);

    pane.press("s");
    pane.wait_for(&["save: "]);
    wait_until("the snapshot", || domain.status().snapshots_saved > 0);

    let commands = domain.status().counters.commands;
    pane.press("r");
    pane.wait_for(&["Forget the state and all that was learned?"]);
    pane.press("n");
    pane.wait_for(&["nothing was reset"]);
    assert_eq!(domain.status().counters.commands, commands);
    pane.press("r");
    pane.wait_for(&["Forget the state and all that was learned?"]);
    pane.press("y");
    pane.wait_for(&["reset: state and learned weights forgotten"]);
    assert_eq!(domain.status().counters.commands, commands + 1);

    pane.press("?");
    pane.wait_for(&["the dead zone's output"]);
    pane.press("x");
    pane.press("p");
    pane.wait_for(&["PAUSED, p goes on; now: TRACKING"]);
    let picture = || pane.text().lines().take(23).collect::<Vec<_>>().join("\n");
    let still = picture();
    flight.kill();
    pane.wait_for(&["PAUSED, p goes on; now: DO NOT FLY ON THIS"]);
    assert_eq!(picture(), still);
    pane.press("p");
    pane.wait_for(&[" DO NOT FLY ON THIS", "q quit"]);

    pane.press("C-c");
    pane.wait_for(&["code 0"]);
    daemon.stop().ok();
    domain.assert_clean();
}

#[test]
fn the_terminal_is_given_back_on_a_signal_and_not_taken_where_it_is_dumb() {
    let domain = TestDomain::new();
    let Some(pane) = Pane::open(&domain, "", "") else { return };
    pane.wait_for(&["NO SERVICE yet", "q quit"]);
    let state = || pane.tmux(&["display-message", "-p", "alternate #{alternate_on} cursor #{cursor_flag}"]);
    assert_eq!(state(), "alternate 1 cursor 0\n");
    kill_process(Pid::from_raw(pane.pid()).unwrap(), Signal::TERM).unwrap();
    pane.wait_for(&["code 0", " icanon ", " echo "]);
    assert_eq!(state(), "alternate 0 cursor 1\n");

    let Some(pane) = Pane::open(&domain, "TERM=dumb", "") else { return };
    pane.wait_for(&["TERM is 'dumb'", "--once", "code 2"]);
    domain.assert_clean();
}

#[test]
fn a_terminal_that_is_closed_ends_it() {
    let domain = TestDomain::new();
    let daemon = service(&domain, "--preset rigid-body --fresh");
    let Some(pane) = Pane::open(&domain, "", "") else { return };
    pane.wait_for(&["no sample yet"]);
    // Gone, or ended and not yet waited for by its new parent.
    let has_ended = |pid: i32| match std::fs::read_to_string(format!("/proc/{pid}/stat")) {
        Ok(stat) => stat.contains(") Z "),
        Err(_) => true,
    };
    let pid = pane.pid();
    assert!(!has_ended(pid));
    drop(pane);
    wait_until("the end", || has_ended(pid));
    daemon.stop().ok();
    domain.assert_clean();
}
