//! Domains, each test with directories of its own.

use domain::{Domain, Leftovers};
use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

const SEGMENTS: &str = "/dev/shm";

fn temporary() -> (tempfile::TempDir, Domain) {
    let directory = tempfile::Builder::new().prefix("ot").tempdir_in(SEGMENTS).unwrap();
    let domain = Domain::at(directory.path()).unwrap();
    (directory, domain)
}

#[test]
fn unusable_root_paths_are_refused_with_a_reason() {
    for (root, reason) in [
        ("relative/path", "not an absolute path"),
        ("/tmp/with space", "letters, digits"),
        ("/tmp/0123456789012345678901234567890123456789", "at most 60 bytes"),
    ] {
        let error = Domain::at(Path::new(root)).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn a_claimed_instance_names_its_holder_to_the_second() {
    let (_directory, domain) = temporary();
    let claim = domain.claim_instance("vehicle").unwrap();
    let error = domain.claim_instance("vehicle").unwrap_err().to_string();
    assert!(error.contains(&std::process::id().to_string()), "{error}");
    assert_eq!(domain.instance_holder("vehicle").unwrap(), Some(std::process::id().to_string()));
    assert_eq!(domain.instance_holder("other").unwrap(), None);
    drop(claim);
    assert_eq!(domain.instance_holder("vehicle").unwrap(), None);
    domain.claim_instance("vehicle").unwrap();
}

#[test]
fn leftovers_are_what_no_living_process_holds() {
    let (directory, domain) = temporary();
    assert_eq!(domain.leftovers().unwrap(), Leftovers::default());
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "looking makes nothing");
    let claim = domain.claim_instance("vehicle").unwrap();
    let held = domain.leftovers().unwrap();
    assert_eq!((held.dead_claims.len(), held.files), (0, 2));
    drop(claim);
    let left = domain.leftovers().unwrap();
    assert_eq!(left.dead_claims, [directory.path().join("vehicle.claim")]);
    assert!(!left.is_clean());
}

#[test]
fn only_the_domains_own_files_are_removed() {
    let (directory, domain) = temporary();
    let precious = directory.path().join("logs");
    fs::create_dir(&precious).unwrap();
    // A directory with other files is refused before anything is made in it.
    let error = domain.lock_for_making().unwrap_err().to_string();
    assert!(error.contains("other files in it"), "{error}");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    fs::remove_dir(&precious).unwrap();
    drop(domain.lock_for_making().unwrap());
    fs::create_dir(&precious).unwrap();
    let neighbour = Domain::at(
        &directory
            .path()
            .with_file_name(format!("{}_2", directory.path().file_name().unwrap().to_str().unwrap())),
    )
    .unwrap();
    let segment = Path::new(SEGMENTS).join(format!("{}data", neighbour.prefix()));
    File::create(&segment).unwrap();
    domain.remove_if_unused().unwrap();
    assert!(precious.exists() && segment.exists());
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    neighbour.remove().unwrap();
    assert!(!segment.exists());
}

#[test]
fn half_made_files_are_removed_and_finished_ones_stay() {
    let (directory, domain) = temporary();
    drop(domain.lock_for_making().unwrap());
    let services = directory.path().join("services");
    fs::create_dir(&services).unwrap();
    let write = |path: PathBuf, mode: u32| {
        File::create(&path).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        path
    };
    let service = |name: &str| services.join(format!("{}{name}.service", domain.prefix()));
    let segment = |name: &str| Path::new(SEGMENTS).join(format!("{}{name}", domain.prefix()));
    let half_made = [write(service("a"), 0o600), write(segment("a"), 0o200)];
    let finished = [write(service("b"), 0o400), write(segment("b"), 0o600)];
    // Looking removes nothing.
    let mut found = domain.leftovers().unwrap();
    found.half_made.sort_by_key(|file| !file.starts_with(directory.path()));
    assert_eq!((found.half_made.as_slice(), found.is_clean()), (&half_made[..], false));
    let lock = domain.lock_for_making().unwrap();
    assert!(half_made.iter().all(|file| !file.exists()));
    assert!(finished.iter().all(|file| file.exists()));
    drop(lock);
    domain.remove().unwrap();
    assert!(!finished[1].exists() && !directory.path().exists());
}
