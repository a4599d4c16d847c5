//! Access to a running service: only its owner has it. What another user can try, and what a faulty source of the same user
//! can do.

use crate::common::{Ended, PATIENCE, Process, TestDomain, daemon_command, run_daemon, wait_until};
use daemon::limits::MAX_SAMPLES_PER_TICK;
use iceoryx2::prelude::*;
use shared_types::clock::monotonic_ns;
use shared_types::payload::command;
use shared_types::{Domain, Measurement, service};
use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, lchown, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// The user id of `nobody`.
const OTHER_USER: u32 = 65534;
/// Set where this test program plays another user.
const ROOT_OF_VICTIM: &str = "ROOT_OF_VICTIM";

/// Another user can be played by root alone.
fn is_root() -> bool {
    let is_root = rustix::process::geteuid().is_root();
    if !is_root {
        testkit::skip(
            "what another user can do",
            "found user id other than 0, needed: root, which can act as another user",
        );
    }
    is_root
}

/// A program where everyone may run it: build directories often lie below a closed home.
fn for_everyone(program: &Path) -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::Builder::new().prefix("otp").tempdir_in("/dev/shm").unwrap();
    fs::set_permissions(directory.path(), Permissions::from_mode(0o755)).unwrap();
    let copy = directory.path().join("program");
    fs::copy(program, &copy).unwrap();
    fs::set_permissions(&copy, Permissions::from_mode(0o755)).unwrap();
    (directory, copy)
}

fn as_other_user(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.uid(OTHER_USER).gid(OTHER_USER).current_dir("/").stdin(Stdio::null());
    command.env("OBSERVER_STATE", "none");
    command
}

fn mode_of(path: &Path) -> u32 {
    fs::symlink_metadata(path).unwrap().permissions().mode() & 0o777
}

#[track_caller]
fn assert_refused(domain: &TestDomain, parts: &[&str]) {
    let Ended { code, log, .. } = run_daemon(domain, &[]).finish();
    assert_eq!(code, Some(1), "{log}");
    for part in parts {
        assert!(log.contains(part), "'{part}' is missing in: {log}");
    }
}

/// A running service with a source, readers and a command, so that all files that the tests check exist.
fn in_use(domain: &TestDomain) {
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut estimates = client.estimate_subscriber().unwrap();
    sensors.publish(&Measurement::at(monotonic_ns(), 0).with_velocity_m_s([1.0, 0.0, 0.0])).unwrap();
    estimates.wait_next(PATIENCE).unwrap();
    client.command(command::STATUS, PATIENCE).unwrap();
    assert_owner_only(domain);
}

#[track_caller]
fn assert_owner_only(domain: &TestDomain) {
    assert_eq!(mode_of(domain.root()), 0o700);
    let segments = domain.domain.segments().unwrap();
    assert!(segments.len() > 5, "{segments:?}");
    for segment in segments {
        // A segment that was needed for a moment may be gone again.
        let Ok(found) = fs::symlink_metadata(&segment) else { continue };
        let mode = found.permissions().mode() & 0o777;
        assert_eq!(mode & 0o077, 0, "{} has mode {mode:o}", segment.display());
    }
}

#[test]
fn whatever_the_umask_only_the_owner_can_open_anything() {
    for umask in ["000", "022", "077", "277"] {
        let domain = TestDomain::new();
        // The mode that a user's mkdir gives.
        fs::set_permissions(domain.root(), Permissions::from_mode(0o755)).unwrap();
        let daemon = daemon_command(&domain, &["run"]);
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(format!("umask {umask}; exec \"$0\" \"$@\"")).arg(daemon.get_program());
        shell.envs(daemon.get_envs().filter_map(|(name, value)| Some((name, value?))));
        shell.args(daemon.get_args()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let daemon = Process::spawn(shell);
        in_use(&domain);
        assert_eq!(daemon.stop().code, Some(0), "umask {umask}");
        domain.assert_clean();
    }
}

#[test]
fn another_user_is_told_whose_service_it_is() {
    if !is_root() {
        return;
    }
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    in_use(&domain);
    let (_directory, program) = for_everyone(Path::new(env!("CARGO_BIN_EXE_daemon")));
    for arguments in [&["control", "reset"][..], &["control", "status"], &["run"]] {
        let output =
            as_other_user(&program).args(arguments).arg("--root").arg(domain.root()).output().unwrap();
        let Ended { code, log, .. } = Ended::from(output);
        assert_eq!(code, Some(1), "{log}");
        assert!(log.contains("belongs to user id 0; this process runs as user id 65534"), "{log}");
        assert!(log.contains("--root"), "{log}");
    }
    assert_eq!(domain.status().counters.commands, 0, "no command of theirs was carried out");
}

/// Started by the test below as another user: tries every access directly, without our client.
#[test]
#[ignore = "a part of another test"]
fn try_every_door() {
    let root = PathBuf::from(std::env::var_os(ROOT_OF_VICTIM).unwrap());
    assert_eq!(rustix::process::geteuid().as_raw(), OTHER_USER);
    let domain = Domain::at(&root).unwrap();
    let segments = domain.segments().unwrap();
    assert!(segments.len() > 5);
    for segment in segments {
        for (read, write) in [(true, false), (false, true)] {
            let opened = fs::OpenOptions::new().read(read).write(write).open(&segment);
            assert!(opened.is_err(), "{} can be opened", segment.display());
        }
        assert!(fs::remove_file(&segment).is_err() && fs::rename(&segment, "/dev/shm/otmine").is_err());
    }
    assert!(fs::read_dir(&root).is_err() && fs::File::create(root.join("vehicle.claim")).is_err());
    assert!(fs::rename(&root, "/dev/shm/otmine").is_err());
    let mut config = Config::default();
    config.global.prefix = FileName::new(domain.prefix().as_bytes()).unwrap();
    let root = iceoryx2::prelude::Path::new(root.to_str().unwrap().as_bytes()).unwrap();
    config.global.set_root_path(&root);
    set_log_level(LogLevel::Fatal);
    let node = NodeBuilder::new().config(&config).create::<ipc::Service>();
    assert!(node.is_err(), "a node of another user in the domain");
    println!("every door is closed");
}

#[test]
fn another_user_finds_every_door_closed() {
    if !is_root() {
        return;
    }
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    in_use(&domain);
    let client = domain.client();
    let _sensors = client.measurement_publisher().unwrap();
    let (_directory, program) = for_everyone(&std::env::current_exe().unwrap());
    let mut intruder = as_other_user(&program);
    intruder.args(["--exact", "access::try_every_door", "--ignored", "--nocapture"]);
    let output = intruder.env(ROOT_OF_VICTIM, domain.root()).output().unwrap();
    let Ended { code, out, log } = Ended::from(output);
    assert!(code == Some(0) && out.contains("every door is closed"), "{out}{log}");
    let status = domain.status();
    assert_eq!((status.counters.samples_accepted, status.counters.commands), (1, 0));
}

#[test]
fn what_another_user_puts_in_place_of_the_root_path_is_refused() {
    if !is_root() {
        return;
    }
    let theirs = |domain: &TestDomain| lchown(domain.root(), Some(OTHER_USER), None).unwrap();
    let not_there = || {
        let domain = TestDomain::new();
        fs::remove_dir(domain.root()).unwrap();
        domain
    };
    let directory = TestDomain::new();
    theirs(&directory);
    assert_refused(&directory, &["a directory that belongs to user id 65534", "--root"]);

    // A link to a directory of ours that happens to be empty.
    let ours = tempfile::tempdir().unwrap();
    let link = not_there();
    symlink(ours.path(), link.root()).unwrap();
    theirs(&link);
    assert_refused(&link, &[link.root().to_str().unwrap(), "a symbolic link that belongs to user id 65534"]);
    assert_eq!(fs::read_dir(ours.path()).unwrap().count(), 0);
    fs::remove_file(link.root()).unwrap();

    let dangling = not_there();
    symlink("/no/such/place", dangling.root()).unwrap();
    assert_refused(&dangling, &["a symbolic link"]);
    fs::remove_file(dangling.root()).unwrap();

    let file = not_there();
    fs::write(file.root(), "").unwrap();
    theirs(&file);
    assert_refused(&file, &["a file that belongs to user id 65534"]);
    fs::remove_file(file.root()).unwrap();
}

#[test]
fn a_root_path_that_others_may_replace_is_refused() {
    let open = tempfile::Builder::new().prefix("oto").tempdir_in("/dev/shm").unwrap();
    let root = open.path().join("d");
    let refusal = || {
        let error = Domain::at(&root).unwrap().lock_for_making().unwrap_err().to_string();
        assert!(!root.exists());
        error
    };
    fs::set_permissions(open.path(), Permissions::from_mode(0o777)).unwrap();
    let error = refusal();
    assert!(
        error.contains(open.path().to_str().unwrap()) && error.contains("writable by everyone"),
        "{error}"
    );
    fs::set_permissions(open.path(), Permissions::from_mode(0o755)).unwrap();
    if is_root() {
        chown(open.path(), Some(OTHER_USER), None).unwrap();
        assert!(refusal().contains("belongs to user id 65534"));
        chown(open.path(), Some(0), None).unwrap();
    }
    Domain::at(&root).unwrap().lock_for_making().unwrap();
}

#[test]
fn what_another_user_plants_among_the_segments_is_refused_and_left_alone() {
    if !is_root() {
        return;
    }
    let domain = TestDomain::new();
    let segment = |name: &str| PathBuf::from(format!("/dev/shm/{}{name}", domain.domain.prefix()));
    let file = segment("planted");
    // Open to all, so that we would gladly take it; or as if half made, so that we would remove it.
    for mode in [0o666, 0o200] {
        fs::write(&file, [0; 64]).unwrap();
        fs::set_permissions(&file, Permissions::from_mode(mode)).unwrap();
        chown(&file, Some(OTHER_USER), None).unwrap();
        assert_refused(&domain, &[file.to_str().unwrap(), "a file that belongs to user id 65534", "rm '"]);
        assert_eq!(fs::metadata(&file).unwrap().size(), 64);
    }
    fs::remove_file(&file).unwrap();

    let link = segment("link");
    symlink("/etc/hostname", &link).unwrap();
    assert_refused(&domain, &[link.to_str().unwrap(), "a symbolic link"]);
    fs::remove_file(&link).unwrap();

    // Planted while the service runs: the next client reports it, and the service goes on.
    let daemon = run_daemon(&domain, &[]);
    in_use(&domain);
    fs::write(&file, "").unwrap();
    chown(&file, Some(OTHER_USER), None).unwrap();
    let Ended { code, log, .. } = Ended::of(&mut daemon_command(&domain, &["control", "status"]));
    assert!(code == Some(1) && log.contains(file.to_str().unwrap()), "{log}");
    assert_eq!(daemon.stop().code, Some(0));
    assert!(file.exists());
    fs::remove_file(&file).unwrap();
}

#[test]
fn lock_files_are_no_way_to_other_files() {
    let precious = tempfile::Builder::new().prefix("otf").tempfile_in("/dev/shm").unwrap();
    type Plant = fn(target: &Path, lock: &Path);
    let plant: [(&str, Plant); 3] = [
        ("a symbolic link", |target, lock| symlink(target, lock).unwrap()),
        ("a file with several names", |target, lock| fs::hard_link(target, lock).unwrap()),
        ("neither a file nor a directory", |_, lock| {
            let made = Command::new("mkfifo").arg(lock).status().unwrap();
            assert!(made.success());
        }),
    ];
    for name in ["making.lock", "vehicle.claim"] {
        for (found, plant) in plant {
            let domain = TestDomain::new();
            fs::write(precious.path(), "precious").unwrap();
            plant(precious.path(), &domain.root().join(name));
            assert_refused(&domain, &[name, found]);
            assert_eq!(fs::read_to_string(precious.path()).unwrap(), "precious");
        }
    }
}

#[test]
fn a_flood_drops_the_oldest_counts_them_and_does_not_hold_the_loop() {
    let domain = TestDomain::new();
    // Slow ticks, so that the queue overflows between two of them.
    let _daemon = run_daemon(&domain, &["--rate-hz", "10"]);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut sequence = 0;
    let mut publish = || {
        sensors
            .publish(&Measurement::at(monotonic_ns(), sequence).with_velocity_m_s([1.0, 0.0, 0.0]))
            .unwrap();
        sequence += 1;
    };
    publish();
    wait_until("the first sample", || domain.status().counters.samples_accepted == 1);
    let ticks_before = domain.status().counters.ticks;
    // As many as may be missed in a row without a new start of the stream.
    let published = 1_000_000;
    for _ in 2..published {
        publish();
    }
    wait_until("the next tick", || domain.status().counters.ticks > ticks_before);
    // The gap before the last one shows when it is taken.
    std::thread::sleep(Duration::from_millis(300));
    publish();
    wait_until("the last sample", || {
        let status = domain.status();
        let rejected: u64 = status.counters.samples_rejected.iter().sum();
        status.counters.samples_accepted + status.counters.samples_lost + rejected == published
    });
    let status = domain.status();
    assert!(status.counters.samples_lost > published / 2, "{} of {published}", status.counters.samples_lost);
    // While a tick takes them others come: it stops at its limit.
    let most = MAX_SAMPLES_PER_TICK as u64 * (status.counters.ticks - ticks_before + 1) + 1;
    assert!(status.counters.samples_accepted <= most, "{} of {published}", status.counters.samples_accepted);
}

/// Of the size of a measurement, and another one.
#[repr(C)]
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("observer.Measurement.v2")]
struct Short {
    value: [f64; 3],
}

/// Of its size, but not of its name.
#[repr(C)]
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("observer.Else.v1")]
struct Renamed(Measurement);

#[test]
fn a_source_of_another_type_or_size_cannot_connect() {
    let domain = TestDomain::new();
    let _daemon = run_daemon(&domain, &[]);
    in_use(&domain);
    let node = {
        let _making = domain.domain.lock_for_making().unwrap();
        service::node(&domain.domain, "intruder").unwrap()
    };
    let name = "vehicle/measurement".try_into().unwrap();
    assert!(node.service_builder(&name).publish_subscribe::<Measurement>().open().is_ok());
    let reason = |refused: String| assert!(refused.contains("IncompatibleTypes"), "{refused}");
    reason(format!("{:?}", node.service_builder(&name).publish_subscribe::<Short>().open().unwrap_err()));
    reason(format!("{:?}", node.service_builder(&name).publish_subscribe::<Renamed>().open().unwrap_err()));
    reason(format!("{:?}", node.service_builder(&name).publish_subscribe::<[u8]>().open().unwrap_err()));
}
