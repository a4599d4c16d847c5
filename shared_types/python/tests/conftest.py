"""A domain of its own for every test, and the real service in it."""

import json
import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest

from observer_client import Vehicle

PATIENCE_S = 20.0
EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture(scope="session")
def facts():
    """What the Rust side says about itself: `cargo test -p daemon --test daemon python` runs these tests with it."""
    return json.loads(Path(os.environ["OBSERVER_FACTS"]).read_text())


@pytest.fixture
def root():
    """A root path that is removed, with all segments, when the test ends."""
    path = tempfile.mkdtemp(prefix="op", dir="/dev/shm")
    yield path
    for name in os.listdir("/dev/shm"):
        # Whatever the hash after it: this must not depend on what is tested.
        if name.startswith(os.path.basename(path) + "~"):
            os.unlink(f"/dev/shm/{name}")
    shutil.rmtree(path, ignore_errors=True)


class Service:
    """`daemon run`, and the programs around it."""

    def __init__(self, facts, root, state):
        self.program = facts["daemon"]
        self.root = root
        self.environment = {**os.environ, "OBSERVER_STATE": str(state), "OBSERVER_ROOT": root}
        self.process = None

    def start(self):
        command = [self.program, "run", "--preset", "rigid-body"]
        self.process = subprocess.Popen(command, env=self.environment, stderr=subprocess.DEVNULL)

    def end(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        self.process.wait(PATIENCE_S)
        self.process = None

    def control(self, *arguments):
        command = [self.program, "control", *arguments]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=PATIENCE_S)

    def vehicle(self, **options):
        return Vehicle("vehicle", self.root, **{"patience_s": PATIENCE_S, **options})


@pytest.fixture
def service_to_start(facts, root, tmp_path):
    state = tmp_path / "state"
    state.mkdir()
    service = Service(facts, root, state)
    yield service
    if service.process is not None:
        service.end(signal.SIGKILL)


@pytest.fixture
def service(service_to_start):
    service_to_start.start()
    return service_to_start
