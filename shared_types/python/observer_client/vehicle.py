"""The vehicle's side: publish samples, read estimates, send commands."""

import ctypes
import importlib.metadata
import re
import time
import weakref

import iceoryx2 as iox2

from . import payload
from .domain import Domain
from .errors import DomainError, Incompatible, NoDaemon, ObserverError, PortError, Refused, TimedOut
from .payload import Command, Estimate, Measurement, Reply, Status, Truth

_ICEORYX2 = "0.10.0"
#: How long a waiting reader sleeps between two looks.
_POLL_S = 1e-4
_COMMANDS = {
    "reset": payload.command.RESET,
    "freeze": payload.command.FREEZE,
    "thaw": payload.command.THAW,
    "save": payload.command.SAVE,
    "status": payload.command.STATUS,
}


class Vehicle:
    """A process's connection to one instance of the service. Use it on the thread that makes it.

    `instance` is the service's name, `root` the domain's root path (default: `$OBSERVER_ROOT`, or the user's own).
    Waits up to `patience_s` for the service to start, here and whenever it is opened or asked later.

    A service that is stopped or killed and started again is followed: ports stay, publishing goes on, waiting readers
    wait. Ports are made when they are first used, which takes some milliseconds: publish once, or call `latest`,
    before it matters.

    Raises NoDaemon after `patience_s`, Incompatible where what exists does not fit, DomainError where the root path
    cannot be used.
    """

    def __init__(self, instance="vehicle", root=None, patience_s=5.0):
        _check_iceoryx2()
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", instance):
            raise ObserverError(f"instance '{instance}': needed: 1 to 32 letters, digits, '-' or '_'")
        self.instance = instance
        self.patience_s = patience_s
        self.domain = Domain(root)
        self._sequence = 0
        self._publisher = None
        self._newest = None
        # A stream that is dropped gives its port back.
        self._streams = weakref.WeakSet()
        self._node = None
        with self.domain.making():
            self._node = _make_node(self.domain)
            self.domain.close_segments_to_others()
        try:
            # The last service that the daemon makes.
            self._open_topic("estimate", Estimate)
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Gives back all ports. What the service learned and its own life do not depend on it."""
        for stream in list(self._streams):
            stream.close()
        if self._publisher is not None:
            self._publisher.delete()
        self._publisher = self._newest = self._node = None

    def publish(
        self,
        *,
        stamp_ns=None,
        sequence=None,
        sensor=0,
        body_velocity_m_s=None,
        body_force_n=None,
        on_ground=False,
        **readings,
    ):
        """Sends one sample: sensor readings, and commands that are held until the next ones. Returns its sequence.

        `stamp_ns` is when the readings were taken, on the clock of `time.monotonic_ns()`, which is also the default;
        `sequence` counts by itself, a gap means loss. Never blocks: where the service is slow or away, the oldest
        sample is dropped.

        `sensor` is the number of the service's `[[sensor]]` that these readings come from: lever arm, mounting, noise, latency.

        With `on_ground`, the vehicle says that it stands on the ground: nothing is learned until a sample without it.

        Raises ObserverError where an argument has another shape, or none is given.

        Readings, in SI units:

        body_velocity_m_s: instead of velocity_m_s, along the body axes, as of a Doppler log.
        body_force_n: instead of force_n, along the body axes, as a multicopter commands its thrust.

        A component of velocity_m_s, angular_velocity_rad_s or position_m that was not measured is None: position_m=(None, None, z)
        is a height. Standard deviations of this sample, by component, 0 as configured: velocity_std_m_s,
        angular_velocity_std_rad_s, specific_force_std_m_s2, position_std_m, attitude_std_rad.
        """
        sample = Measurement(
            sequence=self._sequence if sequence is None else sequence,
            stamp_ns=time.monotonic_ns() if stamp_ns is None else stamp_ns,
            sensor=sensor,
            flags=payload.flags.ON_GROUND if on_ground else 0,
        )
        if body_velocity_m_s is not None:
            if readings.get("velocity_m_s") is not None:
                raise ObserverError("velocity_m_s and body_velocity_m_s: needed: one of the two")
            readings["velocity_m_s"], sample.velocity_frame = body_velocity_m_s, payload.frame.BODY
        if body_force_n is not None:
            if readings.get("force_n") is not None:
                raise ObserverError("force_n and body_force_n: needed: one of the two")
            readings["force_n"], sample.force_frame = body_force_n, payload.frame.BODY
        for name, value in readings.items():
            if name not in payload.READINGS and name not in _DEVIATIONS:
                names = [*payload.READINGS, *_DEVIATIONS]
                raise TypeError(f"publish() has no argument '{name}'; needed: one of {', '.join(names)}")
            if value is None:
                continue
            if name in _FIRST_ABSENT:
                value, absent = _without_absent(value, _FIRST_ABSENT[name])
                sample.absent |= absent
            _fill(getattr(sample, name), name, value)
            if name in payload.READINGS:
                sample.valid |= payload.READINGS[name][0]
        if not sample.valid:
            raise ObserverError("a sample without any reading; needed: one of velocity_m_s=..., output=... (help(Vehicle.publish))")
        if self._publisher is None:
            topic = self._open_topic("measurement", Measurement)
            self._publisher = self._make("create publisher", lambda: topic.publisher_builder().create())
        try:
            self._publisher.send_copy(sample)
        except Exception as cause:
            raise _port_error("publish measurement", cause) from cause
        self._sequence = sample.sequence + 1
        return sample.sequence

    def latest(self):
        """The newest estimate, or None before the first that comes after the first call. A glance, no queue.

        When the service dies, the last one stays: look at `age_s()` and `words()` before you fly on it.
        """
        if self._newest is None:
            self._newest = self._stream("estimate", Estimate, None, buffer_size=1)
        while (estimate := self._newest.take()) is not None:
            self._newest.last = estimate
        return self._newest.last

    def estimates(self, timeout_s=1.0):
        """Every estimate from now on, and the newest one before: iterate over it.

        Raises TimedOut where none comes for `timeout_s` (None waits for ever); iterating again goes on. The oldest are
        dropped where a reader is slow, which shows as gaps in `sequence`.
        """
        return self._stream("estimate", Estimate, timeout_s)

    def statuses(self, timeout_s=5.0):
        """The service's status, a few times a second; as `estimates`."""
        return self._stream("status", Status, timeout_s)

    def measurements(self, timeout_s=1.0):
        """Every sample that a source publishes, for recorders; as `estimates`."""
        return self._stream("measurement", Measurement, timeout_s)

    def truths(self, timeout_s=1.0):
        """The true plant's states that a simulator publishes; as `estimates`."""
        return self._stream("truth", Truth, timeout_s)

    def status(self):
        """What the service did since it started, asked now."""
        return self.command("status").status

    def command(self, kind):
        """Sends "freeze", "thaw", "reset", "save" or "status", and waits for the reply, which has the status afterwards.

        Raises Refused with the service's reason, TimedOut where no service answers within `patience_s`.
        """
        if kind not in _COMMANDS:
            raise ObserverError(f"command '{kind}'; needed: {', '.join(_COMMANDS)}")
        reply = self._request(_COMMANDS[kind])
        if reply.outcome != payload.outcome.DONE:
            raise Refused(f"{kind}: {reply.text()}", reply)
        return reply

    def _request(self, kind):
        builder = self._builder("control")
        control = self._open("control", lambda: builder().request_response(Command, Reply).open())
        client = self._make("create client", lambda: control.client_builder().create())
        pending = None
        try:
            pending = client.send_copy(Command(kind=kind))
            deadline = time.monotonic() + self.patience_s
            while (response := pending.receive()) is None:
                if time.monotonic() > deadline:
                    raise self._timed_out("reply", self.patience_s)
                time.sleep(1e-3)
            return _taken(response, Reply)
        except ObserverError:
            raise
        except Exception as cause:
            raise _port_error("send command", cause) from cause
        finally:
            if pending is not None:
                pending.delete()
            client.delete()

    def _stream(self, topic, payload_type, timeout_s, buffer_size=None):
        service = self._open_topic(topic, payload_type)
        builder = service.subscriber_builder()
        if buffer_size is not None:
            builder = builder.buffer_size(buffer_size)
        subscriber = self._make("create subscriber", builder.create)
        stream = Stream(subscriber, payload_type, topic, timeout_s, self._timed_out)
        self._streams.add(stream)
        return stream

    def _timed_out(self, what, timeout_s):
        return TimedOut(
            f"no {what} of instance '{self.instance}' in {self.domain.root} within {timeout_s:.1f} s; is the service "
            f"still running? (daemon control status --instance {self.instance} --root {self.domain.root})"
        )

    def _builder(self, topic):
        if self._node is None:
            raise ObserverError("the connection is closed; needed: a new Vehicle")
        name = iox2.ServiceName.new(f"{self.instance}/{topic}")
        return lambda: self._node.service_builder(name)

    def _open_topic(self, topic, payload_type):
        builder = self._builder(topic)
        return self._open(topic, lambda: builder().publish_subscribe(payload_type).open())

    def _open(self, topic, attempt):
        """Opens a service as soon as the daemon has made it."""
        start = time.monotonic()
        while True:
            try:
                return attempt()
            except (iox2.PublishSubscribeOpenError, iox2.RequestResponseOpenError) as cause:
                found = str(cause)
                if not re.search("DoesNotExist|IsMarkedForDestruction|HangsInCreation", found):
                    raise _refused("open service", f"{self.instance}/{topic}", found) from cause
                waited_s = time.monotonic() - start
                if waited_s >= self.patience_s:
                    raise NoDaemon(
                        f"no service for instance '{self.instance}' in {self.domain.root} after {waited_s:.1f} s; "
                        f"start it: daemon run --instance {self.instance} --root {self.domain.root}"
                    ) from None
            time.sleep(0.01)

    def _make(self, action, make):
        with self.domain.making():
            try:
                return make()
            except Exception as cause:
                raise _port_error(action, cause) from cause


Vehicle.publish.__doc__ += "".join(f"\n        {name}: {doc}" for name, (_, doc) in payload.READINGS.items())


class Stream:
    """A queue of messages to this reader; iterate over it, or `take` what is there."""

    def __init__(self, subscriber, payload_type, what, timeout_s, timed_out):
        self._subscriber = subscriber
        self._type = payload_type
        self._what = what
        self._timed_out = timed_out
        self.timeout_s = timeout_s
        self.last = None

    def take(self):
        """The oldest message not yet taken, or None."""
        if self._subscriber is None:
            raise ObserverError("the connection is closed; needed: a new Vehicle")
        try:
            sample = self._subscriber.receive()
        except Exception as cause:
            raise _port_error(f"receive {self._what}", cause) from cause
        return None if sample is None else _taken(sample, self._type)

    def __iter__(self):
        return self

    def __next__(self):
        deadline = None if self.timeout_s is None else time.monotonic() + self.timeout_s
        while (message := self.take()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise self._timed_out(self._what, self.timeout_s)
            time.sleep(_POLL_S)
        return message

    def close(self):
        """Gives back the port."""
        if self._subscriber is not None:
            self._subscriber.delete()
            self._subscriber = None


def _taken(sample, payload_type):
    """A copy of our own; its place in shared memory is free again."""
    message = payload_type()
    ctypes.memmove(ctypes.byref(message), sample.payload_ptr, ctypes.sizeof(message))
    sample.delete()
    return message


#: Fields with the deviations of others.
_DEVIATIONS = ("velocity_std_m_s", "angular_velocity_std_rad_s", "specific_force_std_m_s2", "position_std_m", "attitude_std_rad")
#: Bit of `absent` of the first component.
_FIRST_ABSENT = {
    "velocity_m_s": payload.absent.VELOCITY_X,
    "angular_velocity_rad_s": payload.absent.ANGULAR_VELOCITY_X,
    "position_m": payload.absent.POSITION_X,
}


def _without_absent(value, first):
    """The components with 0 in place of None, and the bits of those."""
    try:
        components = list(value)
    except TypeError:
        return value, 0
    absent = sum(first << place for place, component in enumerate(components) if component is None)
    return [0.0 if component is None else component for component in components], absent


def _fill(field, name, value):
    try:
        numbers = [float(number) for number in value]
    except (TypeError, ValueError) as cause:
        raise ObserverError(f"{name}={value!r}; needed: {len(field)} numbers") from cause
    fits = 0 < len(numbers) <= len(field) if name in ("output", "input") else len(numbers) == len(field)
    if not fits:
        raise ObserverError(f"{name} has {len(numbers)} numbers; needed: {len(field)}")
    field[: len(numbers)] = numbers


def _check_iceoryx2():
    found = importlib.metadata.version("iceoryx2")
    if found != _ICEORYX2:
        raise Incompatible(f"iceoryx2 {found} is installed; needed: {_ICEORYX2} (pip install iceoryx2=={_ICEORYX2})")


def _make_node(domain):
    # iceoryx2 logs on its own; what matters comes back as an error and is said once, by us.
    iox2.set_log_level(iox2.LogLevel.Fatal)
    config = iox2.config.default()
    config.global_cfg.prefix = iox2.FileName.new(domain.prefix)
    config.global_cfg.root_path = iox2.Path.new(domain.root)
    builder = iox2.NodeBuilder.new().name(iox2.NodeName.new("client")).config(config)
    # Signals are Python's.
    builder = builder.signal_handling_mode(iox2.SignalHandlingMode.Disabled)
    try:
        return builder.create(iox2.ServiceType.Ipc)
    except Exception as cause:
        raise _refused("create node", "client", str(cause)) from cause


def _refused(action, name, found):
    if "Type" in found:
        kind, remedy = Incompatible, (
            "the other side has another version of the payload: install this package from the service's own version, "
            "and stop every process that still holds the service"
        )
    elif "Permission" in found:
        kind, remedy = DomainError, "the service belongs to another user: run as that user, or choose another root"
    elif "VersionMismatch" in found:
        kind, remedy = Incompatible, f"the other side uses another version of iceoryx2: this one needs {_ICEORYX2}"
    elif re.search("DoesNotSupport|Incompatible|Exceeds", found):
        kind, remedy = Incompatible, (
            "it exists with other qualities of service: stop every process that still holds it, then start the daemon first"
        )
    else:
        kind, remedy = PortError, (
            "stop every process of this domain, then remove its files: rm -r the root path, and the files of the same "
            "name in /dev/shm"
        )
    return kind(f"{action} '{name}': {found}; {remedy}")


def _port_error(action, cause):
    return PortError(f"{action}: {cause}")
