//! Facts about shared memory: whether it is usable, its size, and what dead processes have left in it.

use super::fact::Fact;
use rustix::fs::statvfs;
use shared_types::Domain;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

const SEGMENTS: &str = "/dev/shm";
/// One service with all its readers takes less than a megabyte; sixteen leave room for a fleet.
const MIN_FREE_BYTES: u64 = 16 << 20;
const TEST_BYTES: usize = 1 << 20;

pub(super) fn all(domain: &Domain, instance: &str) -> Vec<Fact> {
    vec![shared_memory(), write_test(), root_path(domain), stale_files(domain, instance)]
}

/// File system type and options of the longest mount point above a path.
fn mount_of(path: &Path, mounts: &str) -> Option<(String, String)> {
    let fields = mounts.lines().filter_map(|line| {
        let mut fields = line.split(' ').skip(1);
        Some((PathBuf::from(fields.next()?), fields.next()?, fields.next()?))
    });
    let above = fields.filter(|(point, ..)| path.starts_with(point));
    let (_, kind, options) = above.max_by_key(|(point, ..)| point.components().count())?;
    Some((kind.to_owned(), options.to_owned()))
}

fn mount(path: &Path) -> Option<(String, String)> {
    mount_of(path, &std::fs::read_to_string("/proc/self/mounts").ok()?)
}

fn shared_memory() -> Fact {
    const NAME: &str = "shared memory";
    let space = match statvfs(SEGMENTS) {
        Ok(space) => space,
        Err(error) => {
            return Fact::bad(
                NAME,
                format!("{SEGMENTS}: {error}"),
                format!("sudo mount -t tmpfs -o mode=1777 tmpfs {SEGMENTS}"),
            );
        }
    };
    let bytes = |blocks: u64| blocks * space.f_frsize;
    let (kind, options) = mount(Path::new(SEGMENTS)).unwrap_or_default();
    let found = format!(
        "{SEGMENTS}: {} MB of {} MB free; {kind} ({options})",
        bytes(space.f_bavail) >> 20,
        bytes(space.f_blocks) >> 20
    );
    if bytes(space.f_bavail) < MIN_FREE_BYTES {
        let remedy = format!(
            "remove what is stale in {SEGMENTS}, or sudo mount -o remount,size=64m {SEGMENTS} (containers: --shm-size=64m)"
        );
        return Fact::bad(NAME, found, remedy);
    }
    if kind != "tmpfs" {
        let remedy =
            format!("sudo mount -t tmpfs -o mode=1777 tmpfs {SEGMENTS}: shared memory should be memory");
        return Fact::better(NAME, found, remedy);
    }
    Fact::good(NAME, found)
}

/// A file of a megabyte, written, read and removed.
fn write_test() -> Fact {
    const NAME: &str = "shared memory, write test";
    let path = Path::new(SEGMENTS).join(format!("observer-doctor-{}", std::process::id()));
    let test = || -> std::io::Result<bool> {
        let mut file = std::fs::File::options().read(true).write(true).create_new(true).open(&path)?;
        let written: Vec<u8> = (0..TEST_BYTES).map(|i| i as u8).collect();
        file.write_all(&written)?;
        file.rewind()?;
        let mut read = Vec::new();
        file.read_to_end(&mut read)?;
        Ok(read == written)
    };
    let result = test();
    let _ = std::fs::remove_file(&path);
    match result {
        Ok(true) => Fact::good(NAME, "1 MB written, read and removed"),
        Ok(false) => Fact::bad(NAME, "what was read is not what was written", "test this machine's memory"),
        Err(error) => Fact::bad(
            NAME,
            error.to_string(),
            format!(
                "sudo chmod 1777 {SEGMENTS}, or give the container a writable one (-v {SEGMENTS}:{SEGMENTS})"
            ),
        ),
    }
}

fn root_path(domain: &Domain) -> Fact {
    const NAME: &str = "root path";
    let root = domain.root();
    // The first process of the domain makes it; before that, its nearest ancestor is looked at.
    let there = root.ancestors().find(|path| path.exists()).unwrap_or(Path::new("/"));
    let kind = mount(there).map_or("an unknown file system".into(), |(kind, _)| kind);
    let found = format!("{} ({kind}{})", root.display(), if root.exists() { "" } else { ", not there yet" });
    if let Err(error) = rustix::fs::access(there, rustix::fs::Access::WRITE_OK) {
        let remedy = "run as its owner, or choose another one (--root, OBSERVER_ROOT)";
        return Fact::bad(NAME, format!("{found}: {error}"), remedy);
    }
    match kind.as_str() {
        "tmpfs" => Fact::good(NAME, found),
        _ => Fact::better(
            NAME,
            found,
            format!("a root path in memory starts faster: --root {SEGMENTS}/NAME, or OBSERVER_ROOT"),
        ),
    }
}

fn stale_files(domain: &Domain, instance: &str) -> Fact {
    const NAME: &str = "stale files";
    let left = match domain.leftovers() {
        Ok(left) => left,
        Err(error) => return Fact::unknown(NAME, error.to_string()),
    };
    let root = domain.root().display();
    let user = match left.living {
        0 => "no living process uses the domain".to_owned(),
        n => format!("{n} living nodes use the domain"),
    };
    if left.is_clean() {
        return Fact::good(NAME, format!("none; {user}"));
    }
    let found = format!(
        "{} half-made files, {} dead processes' nodes{}, {} dead services' claims, {} files in all; {user}",
        left.half_made.len(),
        left.dead_pids.len(),
        match left.dead_pids.as_slice() {
            [] => String::new(),
            pids => format!(" ({})", pids.iter().map(u32::to_string).collect::<Vec<_>>().join(", ")),
        },
        left.dead_claims.len(),
        left.files,
    );
    // A process that joins the domain removes what is stale; the last one that leaves removes the rest.
    let remedy = format!(
        "daemon control status --root {root} --instance {instance} removes what is stale, and everything if no process is left"
    );
    Fact::better(NAME, found, remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_mount_point_counts() {
        let mounts =
            "/dev/vda / ext4 rw,relatime 0 0\ntmpfs /dev tmpfs rw 0 0\nshm /dev/shm tmpfs rw,nosuid 0 0\n";
        let (kind, options) = mount_of(Path::new("/dev/shm/observer-0"), mounts).unwrap();
        assert_eq!((kind.as_str(), options.as_str()), ("tmpfs", "rw,nosuid"));
        assert_eq!(mount_of(Path::new("/dev/shmx"), mounts).unwrap().1, "rw");
        assert_eq!(mount_of(Path::new("/home"), mounts).unwrap().0, "ext4");
        assert_eq!(mount_of(Path::new("/home"), ""), None);
    }
}
