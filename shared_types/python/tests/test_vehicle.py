"""The client as its users meet it: a real service, real shared memory, good and bad input."""

import importlib.metadata
import math
import os
import signal
import subprocess
import sys
import threading
import time

import numpy
import pytest
from conftest import PATIENCE_S

from observer_client import (
    Domain,
    Estimate,
    Incompatible,
    Measurement,
    NoDaemon,
    ObserverError,
    PortError,
    Refused,
    Status,
    TimedOut,
    Vehicle,
    payload,
    status_bits,
)


def moving(t):
    return {
        "velocity_m_s": [math.sin(t), math.cos(t), 0.5],
        "angular_velocity_rad_s": [0.1, 0.2 * math.sin(t), 0.0],
        "attitude_wxyz": [1.0, 0.0, 0.0, 0.0],
        "force_n": [0.0, 0.0, -19.62],
    }


def estimate_of(estimates, sequence):
    """The first estimate with this sample; None if the sample was rejected, as on a stalled machine, where it is late."""
    deadline = time.monotonic() + PATIENCE_S
    for estimate in estimates:
        if estimate.source_sequence == sequence and estimate.source_stamp_ns > 0:
            return estimate
        if estimate.status & status_bits.REJECTED_SAMPLE:
            return None
        assert time.monotonic() < deadline, f"sample {sequence} goes into no estimate"


def newest_of(vehicle):
    """The newest estimate, once the service has published one for this reader."""
    deadline = time.monotonic() + PATIENCE_S
    while (estimate := vehicle.latest()) is None:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    return estimate


def test_samples_go_in_and_each_comes_back_in_an_estimate(service):
    with service.vehicle() as vehicle:
        estimates = vehicle.estimates(timeout_s=PATIENCE_S)
        assert "waiting" in next(estimates).words()
        received = []
        start_ns = time.monotonic_ns()
        for expected in range(400):
            stamp_ns = time.monotonic_ns()
            reading = moving((stamp_ns - start_ns) * 1e-9)
            assert vehicle.publish(stamp_ns=stamp_ns, **reading) == expected
            estimate = estimate_of(estimates, expected)
            if estimate is None:
                continue
            assert estimate.source_stamp_ns == stamp_ns
            assert estimate.stamp_ns >= stamp_ns and estimate.publish_stamp_ns >= estimate.stamp_ns
            received.append((estimate, reading))
        for (before, _), (after, _) in zip(received, received[1:]):
            assert after.sequence > before.sequence and after.stamp_ns > before.stamp_ns
        tracking = [(e, reading) for e, reading in received[len(received) // 2 :] if e.status & status_bits.TRACKING]
        errors_m_s = sorted(math.dist(e.velocity_m_s, reading["velocity_m_s"]) for e, reading in tracking)
        # Learned by then; the dead zone leaves some hundredths, and stalls of the machine more than that.
        assert errors_m_s[len(errors_m_s) // 2] < 0.1
        newest = newest_of(vehicle)
        assert newest.source_sequence == received[-1][0].source_sequence
        assert newest.sequence >= received[-1][0].sequence
        status = vehicle.status()
        assert (status.counters.samples_accepted, status.counters.samples_lost) == (len(received), 0)
        assert sum(status.rejected().values()) == 400 - len(received)
        assert set(status.rejected()) <= {"too far behind the clock", "the loop was late"}
        assert status.source_pid == os.getpid()
        assert status.counters.ticks >= newest.sequence
        # A reader of its own sees the same.
        assert next(vehicle.statuses(timeout_s=PATIENCE_S)).counters.samples_accepted <= 400
    service.end()
    assert not os.path.exists(service.root), "the last one to go leaves nothing"
    assert [n for n in os.listdir("/dev/shm") if n.startswith(Domain(service.root).prefix)] == []


def test_every_argument_arrives_in_its_field(service):
    readings = {
        "angular_velocity_rad_s": numpy.array([0.1, 0.2, 0.3]),
        "specific_force_m_s2": [0.0, 0.0, -9.5],
        "specific_force_std_m_s2": [0.5, 0.5, 0.5],
        "position_m": (4.0, 5.0, 6.0),
        "attitude_wxyz": [0.0, 1.0, 0.0, 0.0],
        "body_force_n": [1, 2, 3],
        "torque_n_m": iter([0.5, 0.25, 0.125]),
        "output": [7.0, 8.0],
        "input": numpy.arange(6),
    }
    with service.vehicle() as vehicle:
        measurements = vehicle.measurements(timeout_s=PATIENCE_S)
        vehicle.publish(body_velocity_m_s=[1.0, 2.0, 3.0], stamp_ns=123, sequence=41, sensor=3, on_ground=True, **readings)
        assert vehicle.publish(velocity_m_s=[1.0, 2.0, 3.0]) == 42
        vehicle.publish(position_m=(None, None, 6.0), position_std_m=[0.0, 0.0, 0.2])
        assert next(measurements) == Measurement(
            sequence=41,
            stamp_ns=123,
            valid=payload.valid.ALL,
            velocity_frame=payload.frame.BODY,
            flags=payload.flags.ON_GROUND,
            sensor=3,
            force_frame=payload.frame.BODY,
            specific_force_m_s2=(0.0, 0.0, -9.5),
            specific_force_std_m_s2=(0.5, 0.5, 0.5),
            velocity_m_s=(1.0, 2.0, 3.0),
            angular_velocity_rad_s=(0.1, 0.2, 0.3),
            position_m=(4.0, 5.0, 6.0),
            attitude_wxyz=(0.0, 1.0, 0.0, 0.0),
            force_n=(1.0, 2.0, 3.0),
            torque_n_m=(0.5, 0.25, 0.125),
            output=(7.0, 8.0, 0.0, 0.0, 0.0, 0.0),
            input=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0),
        )
        second = next(measurements)
        assert (second.sequence, second.valid, second.velocity_frame) == (42, payload.valid.VELOCITY, payload.frame.INERTIAL)
        assert second.flags == 0
        assert second.stamp_ns <= time.monotonic_ns()
        height = next(measurements)
        assert (height.valid, height.absent) == (payload.valid.POSITION, payload.absent.POSITION_X | payload.absent.POSITION_Y)
        assert (tuple(height.position_m), tuple(height.position_std_m)) == ((0.0, 0.0, 6.0), (0.0, 0.0, 0.2))


def test_readings_of_another_shape_are_refused_and_nothing_is_sent(service):
    with service.vehicle() as vehicle:
        for arguments, found in [
            ({}, "without any reading"),
            ({"velocity_m_s": [1.0, 2.0]}, "velocity_m_s has 2 numbers; needed: 3"),
            ({"attitude_wxyz": [1.0, 0.0, 0.0]}, "attitude_wxyz has 3 numbers; needed: 4"),
            ({"output": range(7)}, "output has 7 numbers; needed: 6"),
            ({"force_n": 3.0}, "force_n=3.0; needed: 3 numbers"),
            ({"force_n": "abc"}, "force_n='abc'; needed: 3 numbers"),
            ({"velocity_m_s": [0.0] * 3, "body_velocity_m_s": [0.0] * 3}, "one of the two"),
        ]:
            with pytest.raises(ObserverError, match=found):
                vehicle.publish(**arguments)
        assert vehicle.publish(velocity_m_s=[0.0] * 3) == 0
        with pytest.raises(TypeError):
            vehicle.publish(velocity=[0.0] * 3)


def test_without_a_service_it_says_how_to_start_one(root):
    start = time.monotonic()
    with pytest.raises(NoDaemon, match=f"daemon run --instance auv1 --root {root}"):
        Vehicle("auv1", root, patience_s=0.2)
    assert time.monotonic() - start >= 0.2
    with pytest.raises(ObserverError, match="1 to 32 letters"):
        Vehicle("no/such", root)


def test_the_start_order_does_not_matter(service_to_start):
    threading.Timer(0.5, service_to_start.start).start()
    with service_to_start.vehicle() as vehicle:
        assert next(vehicle.estimates(timeout_s=PATIENCE_S)).is_finite()


def test_another_version_of_a_payload_is_refused(service, monkeypatch):
    class OlderName(Estimate):
        TYPE_NAME = "observer.Estimate.v3"

    class OtherSize(Estimate):
        _fields_ = [("more", payload.Channel)]

    class OlderReply(payload.Reply):
        TYPE_NAME = "observer.Reply.v4"

    with service.vehicle() as vehicle:
        for other in (OlderName, OtherSize, Status):
            with pytest.raises(Incompatible, match="vehicle/estimate.*another version of the payload.*install this package"):
                vehicle._open_topic("estimate", other)
        monkeypatch.setattr("observer_client.vehicle.Reply", OlderReply)
        with pytest.raises(Incompatible, match="vehicle/control"):
            vehicle.status()
    monkeypatch.setattr("observer_client.vehicle.Estimate", OlderName)
    with pytest.raises(Incompatible, match="another version of the payload"):
        service.vehicle()


def test_another_version_of_iceoryx2_is_refused(root, monkeypatch):
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "0.9.1")
    with pytest.raises(Incompatible, match="iceoryx2 0.9.1 is installed; needed: 0.10.0"):
        Vehicle(root=root)
    assert os.listdir(root) == []


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_service_that_ends_and_starts_again_is_followed(service, how):
    with service.vehicle(patience_s=1.0) as vehicle:
        vehicle.patience_s = PATIENCE_S
        estimates = vehicle.estimates(timeout_s=PATIENCE_S)
        for k in range(20):
            estimate_of(estimates, vehicle.publish(**moving(k * 0.005)))
        before = vehicle.status()
        newest_of(vehicle)
        service.end(how)

        estimates.timeout_s = vehicle.patience_s = 0.3
        with pytest.raises(TimedOut, match="no estimate of instance 'vehicle'.*daemon control status"):
            for _ in estimates:
                pass
        # The control service ends with the last process that has it open; then it is missing.
        with pytest.raises((TimedOut, NoDaemon), match="no reply|daemon run --instance vehicle"):
            vehicle.status()
        lost = vehicle.publish(**moving(0.0))
        assert lost == 20
        assert vehicle.latest().age_s() > 0.2

        service.start()
        estimates.timeout_s = vehicle.patience_s = PATIENCE_S
        assert next(estimates).publish_stamp_ns > before.stamp_ns
        # Samples are taken as soon as the new service listens.
        deadline = time.monotonic() + PATIENCE_S
        while True:
            sequence = vehicle.publish(**moving(0.1))
            estimate = next(estimates)
            if estimate.source_sequence > lost and "tracking" in estimate.words():
                break
            assert time.monotonic() < deadline, estimate
        assert vehicle.status().start_stamp_ns > before.start_stamp_ns
        assert sequence > lost


def test_commands_are_carried_out_and_answered(service, tmp_path):
    with service.vehicle() as vehicle:
        estimates = vehicle.estimates(timeout_s=PATIENCE_S)
        reply = vehicle.command("freeze")
        assert reply.outcome == payload.outcome.DONE and reply.status.adaptation_frozen == 1
        while "frozen" not in next(estimates).words():
            pass
        assert vehicle.command("thaw").status.adaptation_frozen == 0
        n_commands = vehicle.status().counters.commands
        assert vehicle.command("reset").text()
        assert vehicle.status().counters.commands == n_commands + 1
        saved = vehicle.command("save")
        assert saved.status.snapshots_saved >= 1 and list((tmp_path / "state").iterdir())
        assert vehicle.command("status").text().startswith("running")

        with pytest.raises(ObserverError, match="command 'fly'; needed: reset, freeze, thaw, save, status"):
            vehicle.command("fly")
        unknown = vehicle._request(99)
        assert unknown.outcome == payload.outcome.UNKNOWN and "99" in unknown.text()

        # A directory that cannot be written any more.
        for file in (tmp_path / "state").iterdir():
            file.unlink()
        (tmp_path / "state").rmdir()
        (tmp_path / "state").write_text("")
        with pytest.raises(Refused, match="save: ") as refused:
            vehicle.command("save")
        assert refused.value.reply.outcome == payload.outcome.REFUSED
        assert refused.value.reply.status.snapshots_failed >= 1


def test_streams_that_are_dropped_give_their_ports_back(service, facts):
    with service.vehicle() as vehicle:
        for _ in range(2 * facts["max_readers"]):
            next(vehicle.estimates(timeout_s=PATIENCE_S))
        streams = []
        with pytest.raises(PortError, match="create subscriber"):
            for _ in range(2 * facts["max_readers"]):
                streams.append(vehicle.estimates())
        assert 2 < len(streams) < facts["max_readers"] + 1
        streams.clear()
        kept = vehicle.estimates(timeout_s=PATIENCE_S)
        next(kept)
    with pytest.raises(ObserverError, match="closed"):
        next(kept)
    with pytest.raises(ObserverError, match="closed"):
        vehicle.latest()
    with pytest.raises(ObserverError, match="closed"):
        vehicle.publish(velocity_m_s=[0.0] * 3)
    vehicle.close()


def test_an_interrupt_ends_a_waiting_reader_and_nothing_else(service):
    program = (
        "import signal\n"
        "from observer_client import Vehicle\n"
        # A shell starts what it puts into the background with interrupts ignored, and Python leaves it so.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "with Vehicle(patience_s=20.0) as vehicle:\n"
        "    stream = vehicle.truths(timeout_s=None)\n"
        "    try:\n"
        "        print('waits', flush=True)\n"
        "        next(stream)\n"
        "    except KeyboardInterrupt:\n"
        "        print('interrupted')\n"
    )
    reader = subprocess.Popen([sys.executable, "-c", program], env=service.environment, stdout=subprocess.PIPE, text=True)
    assert reader.stdout.readline() == "waits\n"
    reader.send_signal(signal.SIGINT)
    assert reader.communicate(timeout=PATIENCE_S)[0] == "interrupted\n"
    assert reader.returncode == 0
    with service.vehicle() as vehicle:
        assert vehicle.status().counters.ticks > 0
