//! Real-time settings of a real process, observed from outside: they are applied, read back and reported.

use crate::common::{
    Ended, Process, TestDomain, Unprivileged, daemon_command, preset_between, run_daemon, wait_until,
};
use rustix::thread::CapabilitySet;
use shared_types::payload::real_time as bits;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;

const EVERYTHING: u64 =
    bits::PRIORITY | bits::CORES | bits::LOCKED_MEMORY | bits::PUNCTUAL_TIMERS | bits::AWAKE_CORES;

/// A configuration that requests these settings, readable for every user.
fn asking(settings: &str) -> tempfile::NamedTempFile {
    let file = preset_between("", &format!("[real_time]\n{settings}"));
    fs::set_permissions(file.path(), fs::Permissions::from_mode(0o644)).unwrap();
    file
}

fn path(file: &tempfile::NamedTempFile) -> &str {
    file.path().to_str().unwrap()
}

/// Of one thread: scheduling policy (1 is SCHED_FIFO), priority, allowed cores as a list.
type Scheduling = (u32, u32, String);

fn field(status: &str, name: &str) -> String {
    status.lines().find_map(|line| line.strip_prefix(name)).unwrap().trim().to_owned()
}

/// Whether a list of the kernel's, as `0-2,5`, holds a core.
fn holds(list: &str, core: usize) -> bool {
    list.split(',').any(|range| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        (first.parse().unwrap()..=last.parse().unwrap()).contains(&core)
    })
}

/// The threads of a process by name, as the kernel describes them.
fn threads(pid: u32) -> BTreeMap<String, Scheduling> {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap().flatten();
    let thread = |task: fs::DirEntry| {
        let read = |name: &str| fs::read_to_string(task.path().join(name)).unwrap();
        let stat = read("stat");
        // rt_priority and policy are fields 40 and 41 of all; the third is the first after the name.
        let fields: Vec<_> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
        let number = |field: usize| fields[field - 3].parse().unwrap();
        let cores = field(&read("status"), "Cpus_allowed_list:");
        (read("comm").trim().to_owned(), (number(41), number(40), cores))
    };
    tasks.map(thread).collect()
}

#[test]
fn what_the_status_calls_granted_the_kernel_has() {
    let allowed = daemon::system::real_time::allowed_cores();
    let core = *allowed.last().unwrap();
    let config = asking(&format!("priority = 11\ncores = [{core}]\nlock_memory = true\nawake_cores = true"));
    let domain = TestDomain::new();
    let daemon = run_daemon(&domain, &["--config", path(&config)]);
    domain.client();
    wait_until("the settings to be known", || domain.status().real_time_requested != 0);
    let status = domain.status();
    assert_eq!(status.real_time_requested, EVERYTHING);
    let granted = |bit: u64| status.real_time_granted & bit != 0;
    assert!(granted(bits::CORES) && granted(bits::PUNCTUAL_TIMERS));

    let pid = daemon.child.id();
    // The main thread leaves the loop's core once it has nothing more to start.
    wait_until("the main thread to settle", || allowed.len() == 1 || !holds(&threads(pid)["daemon"].2, core));
    let threads = threads(pid);
    assert!(threads.len() >= 3, "{threads:?}");
    for (name, (policy, priority, cores)) in &threads {
        let is_loop = name == "daemon-loop";
        let fifo = is_loop && granted(bits::PRIORITY);
        assert_eq!((*policy, *priority), if fifo { (1, 11) } else { (0, 0) }, "{threads:?}");
        assert!(!is_loop || *cores == core.to_string(), "{threads:?}");
        assert!(holds(cores, core) == is_loop || allowed.len() == 1, "{threads:?}");
    }
    let locked = field(&fs::read_to_string(format!("/proc/{pid}/status")).unwrap(), "VmLck:");
    assert_eq!(locked != "0 kB", granted(bits::LOCKED_MEMORY), "{locked}");
    assert!(granted(bits::LOCKED_MEMORY) || !daemon::system::real_time::has(CapabilitySet::IPC_LOCK));

    let text = Ended::of(&mut daemon_command(&domain, &["control", "status"])).out;
    let line = text.lines().find(|line| line.trim().starts_with("real time")).unwrap();
    assert!(line.contains("granted:") && line.contains("punctual timers"), "{line}");
    let text = Ended::of(&mut daemon_command(&domain, &["control", "status", "--json"])).out;
    let document: serde_json::Value = serde_json::from_str(&text).unwrap();
    let n_granted = document["real_time"]["granted"].as_array().unwrap().len();
    let n_refused = document["real_time"]["refused"].as_array().unwrap().len();
    assert_eq!(n_granted, status.real_time_granted.count_ones() as usize);
    assert_eq!(n_granted + n_refused, 5);
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    assert!(
        log.contains("real time: timers without slack") && log.contains(&format!("on cores [{core}]")),
        "{log}"
    );
    domain.assert_clean();
}

#[test]
fn what_is_refused_is_told_with_reason_and_remedy_and_the_service_runs() {
    let nobody = Unprivileged::new();
    let config = asking("priority = 11\nlock_memory = true");
    let mut daemon = Process::spawn(nobody.command(&["run", "--config", path(&config)]));
    wait_until("the service to answer", || {
        assert!(daemon.child.try_wait().unwrap().is_none(), "it ended");
        nobody.command(&["control", "status"]).output().unwrap().status.success()
    });
    let text = Ended::of(&mut nobody.command(&["control", "status"])).out;
    let json = Ended::of(&mut nobody.command(&["control", "status", "--json"])).out;
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    let refused = document["real_time"]["refused"].as_array().unwrap();
    let setting = |name: &str| refused.iter().find(|entry| entry["setting"] == name);
    // If the user has the right, the setting is not refused.
    if let Some(entry) = setting("priority") {
        let message = document["message"].as_str().unwrap();
        assert!(entry["remedy"].as_str().unwrap().contains("LimitRTPRIO"), "{entry}");
        assert!(message.contains("priority (Operation not permitted"), "{message}");
        assert!(text.contains("priority (Operation not permitted") && text.contains("LimitRTPRIO"), "{text}");
        assert!(log.contains("SCHED_FIFO with priority 11: Operation not permitted"), "{log}");
    }
    if setting("locked memory").is_some() {
        assert!(text.contains("locked memory (the limit is") && text.contains("LimitMEMLOCK"), "{text}");
    }
    assert!(refused.len() == 2 || !rustix::process::geteuid().is_root(), "{document}");
    nobody.domain.assert_clean();
}

#[test]
fn what_is_required_and_refused_starts_nothing() {
    let nobody = Unprivileged::new();
    let command = nobody.command(&["run", "--require-real-time", "--priority", "11"]);
    let mut daemon = Process::spawn(command);
    let domain = &nobody.domain;
    wait_until("a refusal, or a service", || {
        daemon.child.try_wait().unwrap().is_some() || !domain.domain.segments().unwrap().is_empty()
    });
    if daemon.child.try_wait().unwrap().is_none() {
        assert!(!rustix::process::geteuid().is_root(), "it runs as nobody, without the right");
        return; // This user has the right.
    }
    let Ended { code, log, .. } = daemon.finish();
    assert_eq!(code, Some(1), "{log}");
    assert!(log.contains("required") && log.contains("SCHED_FIFO with priority 11"), "{log}");
    assert!(log.contains("LimitRTPRIO") && log.contains("daemon doctor"), "{log}");
    domain.assert_clean();

    // What anyone is granted may be required.
    let domain = TestDomain::new();
    let core = daemon::system::real_time::allowed_cores()[0].to_string();
    let daemon = run_daemon(&domain, &["--require-real-time", "--cores", &core]);
    domain.client();
    let Ended { code, log, .. } = daemon.stop();
    assert_eq!(code, Some(0), "{log}");
}

#[test]
fn cores_that_are_not_there_are_a_wrong_configuration() {
    let domain = TestDomain::new();
    let config = asking("cores = [1023]");
    let Ended { code, log, .. } = run_daemon(&domain, &["--config", path(&config)]).finish();
    assert_eq!(code, Some(2), "{log}");
    assert!(log.contains("real_time.cores: found [1023]") && log.contains("line"), "{log}");
    let Ended { code, log, .. } = run_daemon(&domain, &["--priority", "99"]).finish();
    assert!(code == Some(2) && log.contains("1 … 98"), "{log}");
    domain.assert_clean();
}
