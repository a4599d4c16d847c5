"""Which shared memory: a root path, a prefix, and the lock under which anything in it is made.

The same rules as in the Rust crate (``shared_types/domain``, which says why), and a test compares them. Two
things are left to the programs in Rust: to remove what a process left half-made that was killed while it made it
(here it is refused by name, since it could make every later start hang), and to remove a domain that no process uses.
"""

import fcntl
import os
import stat
import time
from contextlib import contextmanager

from .errors import DomainError

#: Environment variable that names the default root path.
ROOT_VARIABLE = "OBSERVER_ROOT"

_SEGMENTS = "/dev/shm"
_MAKING_LOCK = "making.lock"
_CLAIM_SUFFIX = ".claim"
_MAX_ROOT_AND_PREFIX_BYTES = 60
_LOCK_PATIENCE_S = 10.0
_HALF_MADE_AGE_S = 0.25
_NAME_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.")


class Domain:
    """One isolated set of services: processes see each other only inside the same one.

    ``root`` is its root path; by default ``$OBSERVER_ROOT``, or the user's own, ``/dev/shm/observer-<uid>``.
    ``prefix`` begins the name of each of its segments in /dev/shm: the last component and a hash of the path.
    """

    def __init__(self, root=None):
        if root is None:
            root = os.environ.get(ROOT_VARIABLE, f"{_SEGMENTS}/observer-{os.geteuid()}")
        self.root = os.fspath(root)
        components = [part for part in self.root.split("/") if part not in ("", ".")]
        name = components[-1] if components else ".."
        if not self.root.startswith("/") or name == "..":
            raise self._refused("not an absolute path", "for example /dev/shm/flight1")
        if not _NAME_CHARACTERS.issuperset(name):
            raise self._refused(f"last component '{name}'", "letters, digits, '-', '_', '.' only")
        text = os.fsencode(self.root)
        self.prefix = f"{name}~{_fnv1a_32(text):08x}_"
        size = len(text) + len(self.prefix)
        if size > _MAX_ROOT_AND_PREFIX_BYTES:
            raise self._refused(
                f"it and its segments' prefix '{self.prefix}' are {size} bytes long",
                f"at most {_MAX_ROOT_AND_PREFIX_BYTES} bytes: sockets with both in their names live below it",
            )

    def __repr__(self):
        return f"Domain({self.root!r})"

    @contextmanager
    def making(self):
        """Holds the domain's lock: around the making of a node or port, and nothing else.

        Makes the root path if it is missing. Raises DomainError where it is not this user's alone, where another
        user's file lies in the domain's place, where something is half-made, or another process holds the lock for 10 s.
        """
        lock = self._take_lock()
        try:
            self._check_segments()
            self._check_half_made()
            yield
        finally:
            os.close(lock)

    def close_segments_to_others(self):
        """Puts a copy of the owner's alone in the place of a segment that iceoryx2 opened to everyone.

        Call it under the lock once the node is made.
        """
        for segment in _paths(_SEGMENTS, self._has_prefix):
            try:
                if stat.S_IMODE(os.lstat(segment).st_mode) & 0o077 == 0:
                    continue
                with open(segment, "rb") as file:
                    content = file.read()
                copy = os.path.join(_SEGMENTS, f"{self.prefix}closing")
                if os.path.lexists(copy):
                    os.unlink(copy)
                descriptor = os.open(copy, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
                with open(descriptor, "wb") as file:
                    os.fchmod(descriptor, 0o600)
                    file.write(content)
                os.rename(copy, segment)
            except FileNotFoundError:
                continue
            except OSError as cause:
                raise DomainError(f"close to others '{segment}': {cause}") from cause

    def _refused(self, found, needed):
        return DomainError(f"root path '{self.root}': {found}; needed: {needed}")

    def _has_prefix(self, name):
        return name.startswith(self.prefix)

    def _take_lock(self):
        """The descriptor of the locked file. The last process of a domain removes its files, and a lock on a removed
        file protects nothing: so it is opened again until the locked one is the one that is there."""
        path = os.path.join(self.root, _MAKING_LOCK)
        deadline = time.monotonic() + _LOCK_PATIENCE_S
        while True:
            self._make_root()
            lock = _open_lock_file(path)
            if lock is None:
                continue
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is_still_at(lock, path):
                    os.ftruncate(lock, 0)
                    os.write(lock, str(os.getpid()).encode())
                    held, lock = lock, None
                    return held
            except BlockingIOError:
                if time.monotonic() > deadline:
                    holder = os.pread(lock, 32, 0).decode(errors="replace") or "unknown"
                    raise DomainError(
                        f"the lock '{path}' is held by process {holder}; it should last milliseconds: look at that "
                        f"process, and stop it if it hangs (kill {holder})"
                    ) from None
                time.sleep(0.002)
            except OSError as cause:
                raise DomainError(f"lock '{path}': {cause}") from cause
            finally:
                if lock is not None:
                    os.close(lock)

    def _make_root(self):
        self._check_directories_above()
        try:
            _make_directories(self.root)
            found = os.lstat(self.root)
        except OSError as cause:
            if not os.path.lexists(self.root):
                raise DomainError(f"create directory '{self.root}': {cause}") from cause
            found = os.lstat(self.root)
        user = os.geteuid()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != user:
            raise self._refused(
                _described(self.root),
                f"a directory of user id {user}: run as its owner, or choose a root path of your own "
                f"(root=..., or {ROOT_VARIABLE} in the environment)",
            )
        # The lock is the first file made here and the last one removed: without it, nothing here is ours.
        names = os.listdir(self.root)
        if names and not any(name == _MAKING_LOCK or name.endswith(_CLAIM_SUFFIX) for name in names):
            raise self._refused(
                f"a directory with other files in it ('{os.path.join(self.root, names[0])}')",
                f"a directory of the domain's own, empty or not there yet (root=..., or {ROOT_VARIABLE})",
            )
        if stat.S_IMODE(found.st_mode) & 0o777 != 0o700:
            os.chmod(self.root, 0o700)

    def _check_directories_above(self):
        """Checks the directories above: a user who may rename the root path could replace it."""
        directory = self.root.rstrip("/")
        while directory not in ("", "/"):
            directory = os.path.dirname(directory)
            try:
                found = os.stat(directory)
            except OSError:
                continue
            is_open = found.st_mode & 0o002 and not found.st_mode & stat.S_ISVTX
            if is_open or found.st_uid not in (0, os.geteuid()):
                what = "is writable by everyone" if is_open else f"belongs to user id {found.st_uid}"
                raise self._refused(
                    f"'{directory}' above it {what}, who may put another one in its place",
                    "below directories of root or of your own, for example /dev/shm/flight1",
                )

    def _check_segments(self):
        """Refuses what another user planted where the domain's segments lie: /dev/shm is everyone's."""
        for segment in _paths(_SEGMENTS, self._has_prefix):
            try:
                found = os.lstat(segment)
            except FileNotFoundError:
                continue
            if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid():
                raise _foreign(segment)

    def _check_half_made(self):
        """A service file still writable (0600; finished is 0400) and a segment not yet readable (0200) were never
        finished. A young one is given the time in which a living maker finishes it."""
        services = _paths(
            os.path.join(self.root, "services"),
            lambda name: self._has_prefix(name) and name.endswith(".service"),
        )
        candidates = [(path, lambda mode: mode & 0o200) for path in services]
        candidates += [(path, lambda mode: not mode & 0o400) for path in _paths(_SEGMENTS, self._has_prefix)]
        for path, is_unfinished in candidates:
            while True:
                try:
                    found = os.lstat(path)
                except FileNotFoundError:
                    break
                if not is_unfinished(found.st_mode):
                    break
                age_s = max(time.time() - found.st_mtime, 0.0)
                if age_s >= _HALF_MADE_AGE_S:
                    raise DomainError(
                        f"'{path}': half-made by a process that was killed meanwhile; needed: it removed, by the next "
                        f"program of the service that starts (daemon control status --root {self.root})"
                    )
                time.sleep(min(_HALF_MADE_AGE_S - age_s, _HALF_MADE_AGE_S))


def _fnv1a_32(data):
    value = 0x811C9DC5
    for byte in data:
        value = ((value ^ byte) * 0x01000193) & 0xFFFFFFFF
    return value


def _paths(directory, is_wanted):
    try:
        return [os.path.join(directory, name) for name in os.listdir(directory) if is_wanted(name)]
    except FileNotFoundError:
        return []


def _make_directories(path):
    """As `mkdir -p`, each of the owner's alone (os.makedirs would make those above with the umask's mode)."""
    if not os.path.isdir(path):
        above = os.path.dirname(path.rstrip("/"))
        if above != path:
            _make_directories(above)
        try:
            os.mkdir(path, 0o700)
        except FileExistsError:
            pass


def _open_lock_file(path):
    # No link is followed, and a pipe in its place does not make us wait.
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        lock = os.open(path, flags, 0o600)
    except FileNotFoundError:
        return None
    except OSError as cause:
        if os.path.lexists(path) and not stat.S_ISREG(os.lstat(path).st_mode):
            raise _foreign(path) from cause
        raise DomainError(f"open lock file '{path}': {cause}") from cause
    found = os.fstat(lock)
    if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_nlink > 1:
        os.close(lock)
        raise _foreign(path)
    if stat.S_IMODE(found.st_mode) & 0o777 != 0o600:
        # The umask took a bit that the next one to open it needs.
        os.fchmod(lock, 0o600)
    return lock


def _is_still_at(lock, path):
    try:
        return os.path.samestat(os.fstat(lock), os.stat(path))
    except FileNotFoundError:
        return False


def _foreign(path):
    return DomainError(
        f"'{path}': {_described(path)}; needed: only files that user id {os.geteuid()} made here: look who made it, "
        f"then remove it (as its owner or root: rm '{path}'), or choose another root path (root=..., or {ROOT_VARIABLE})"
    )


def _described(path):
    try:
        found = os.lstat(path)
    except FileNotFoundError:
        return "vanished while it was looked at"
    if stat.S_ISDIR(found.st_mode):
        kind = "a directory"
    elif stat.S_ISLNK(found.st_mode):
        kind = "a symbolic link"
    elif stat.S_ISREG(found.st_mode):
        kind = "a file with several names" if found.st_nlink > 1 else "a file"
    else:
        kind = "neither a file nor a directory"
    return f"{kind} that belongs to user id {found.st_uid}; this process runs as user id {os.geteuid()}"
