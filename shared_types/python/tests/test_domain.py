"""The same domain as on the Rust side, and the same care."""

import os
import stat
import time

import pytest

from observer_client import Domain, DomainError, Vehicle


def test_prefixes_and_refusals_are_those_of_the_rust_side(facts):
    n_refused = 0
    for rust in facts["domains"]:
        if "prefix" in rust:
            assert Domain(rust["root"]).prefix == rust["prefix"], rust["root"]
        else:
            n_refused += 1
            with pytest.raises(DomainError) as refused:
                Domain(rust["root"])
            assert str(refused.value) == rust["refused"]
    assert 0 < n_refused < len(facts["domains"])


def test_the_root_path_is_the_environments_or_the_users_own(monkeypatch):
    monkeypatch.setenv("OBSERVER_ROOT", "/dev/shm/flight1")
    assert Domain().root == "/dev/shm/flight1"
    monkeypatch.delenv("OBSERVER_ROOT")
    assert Domain().root == f"/dev/shm/observer-{os.geteuid()}"


@pytest.mark.parametrize("umask", [0o000, 0o777])
def test_root_path_and_lock_are_the_owners_alone_whatever_the_umask(root, umask):
    inner = f"{root}/in"
    before = os.umask(umask)
    try:
        with Domain(inner).making():
            assert stat.S_IMODE(os.stat(inner).st_mode) == 0o700
            assert stat.S_IMODE(os.stat(f"{inner}/making.lock").st_mode) == 0o600
            assert open(f"{inner}/making.lock").read() == str(os.getpid())
    finally:
        os.umask(before)


def test_the_lock_keeps_the_service_from_making_anything(service_to_start, root):
    with Domain(root).making():
        service_to_start.start()
        time.sleep(0.5)
        assert os.listdir(root) == ["making.lock"]
    service_to_start.vehicle().close()
    assert "services" in os.listdir(root)


def test_a_lock_that_is_held_names_its_holder(root, monkeypatch):
    monkeypatch.setattr("observer_client.domain._LOCK_PATIENCE_S", 0.05)
    with Domain(root).making():
        with pytest.raises(DomainError, match=f"held by process {os.getpid()}.*kill {os.getpid()}"):
            Vehicle(root=root)


def test_a_lock_file_that_was_replaced_meanwhile_is_taken_again(root, monkeypatch):
    """As the last process of a domain does, which removes its files under the lock."""
    lock = f"{root}/making.lock"
    taken = []

    def flock(descriptor, how):
        if not taken:
            os.unlink(lock)
        taken.append(descriptor)

    monkeypatch.setattr("fcntl.flock", flock)
    with Domain(root).making():
        assert os.path.exists(lock) and len(taken) == 2


def test_what_is_not_ours_is_refused_by_name(root):
    for name, plant, found in [
        ("link", lambda path: os.symlink("/dev/shm", path), "a symbolic link"),
        ("file", lambda path: open(path, "w").close(), "a file"),
    ]:
        path = f"{root}/{name}"
        plant(path)
        with pytest.raises(DomainError, match=f"{path}.*{found} that belongs to user id"):
            Vehicle(root=path)
    for name, plant, found in [
        ("l1", lambda path: os.symlink("/etc/passwd", path), "a symbolic link"),
        ("l2", lambda path: os.mkfifo(path), "neither a file nor a directory"),
        ("l3", lambda path: os.link(f"{root}/file", path), "a file with several names"),
    ]:
        os.mkdir(f"{root}/{name}")
        plant(f"{root}/{name}/making.lock")
        with pytest.raises(DomainError, match=found):
            Vehicle(root=f"{root}/{name}")
    with pytest.raises(DomainError, match="other files in it"):
        Vehicle(root=root)
    os.mkdir(f"{root}/open")
    os.chmod(f"{root}/open", 0o777)
    with pytest.raises(DomainError, match="writable by everyone"):
        Vehicle(root=f"{root}/open/d")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can act as another user")
def test_what_another_user_planted_is_refused_by_name(root):
    segment = f"/dev/shm/{Domain(root).prefix}planted"
    open(segment, "w").close()
    os.chown(segment, 65534, 65534)
    with pytest.raises(DomainError, match=f"{segment}.*user id 65534"):
        Vehicle(root=root)


def test_no_segment_is_left_open_to_others(root):
    """iceoryx2 opens one to everyone when the first node is made, which may be ours."""
    from observer_client.vehicle import _make_node

    domain = Domain(root)
    with domain.making():
        node = _make_node(domain)
        segments = [f"/dev/shm/{name}" for name in os.listdir("/dev/shm") if name.startswith(domain.prefix)]
        content = {segment: open(segment, "rb").read() for segment in segments}
        assert any(os.stat(segment).st_mode & 0o077 for segment in segments), "iceoryx2 does not do it any more"
        domain.close_segments_to_others()
    for segment in segments:
        assert os.stat(segment).st_mode & 0o077 == 0
        assert open(segment, "rb").read() == content[segment]
    del node


def test_what_a_killed_process_left_half_made_is_named_and_removed_by_the_services_programs(service_to_start, root):
    """It could make the making of a node hang for ever."""
    segment = f"/dev/shm/{Domain(root).prefix}half"
    with Domain(root).making():
        os.close(os.open(segment, os.O_CREAT | os.O_WRONLY, 0o200))
    with pytest.raises(DomainError, match=f"{segment}.*half-made.*daemon control status --root {root}"):
        Vehicle(root=root)
    assert os.path.exists(segment)
    service_to_start.start()
    deadline = time.monotonic() + 20.0
    while os.path.exists(segment):
        assert time.monotonic() < deadline, f"{segment} stays"
        time.sleep(0.01)
    service_to_start.vehicle().close()
