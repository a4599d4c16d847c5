"""Samples in, state estimates out: the vehicle's side of the state-estimation service.

    from observer_client import Vehicle

    with Vehicle("vehicle") as vehicle:
        vehicle.publish(velocity_m_s=[1.0, 0.0, 0.0], angular_velocity_rad_s=[0.0, 0.0, 0.1])
        for estimate in vehicle.estimates(timeout_s=1.0):
            print(estimate.velocity_m_s, estimate.matched_force_n, estimate.words())

| module | holds |
|---|---|
| vehicle | `Vehicle`: publish, latest, estimates, status, command |
| payload | the messages, every field with its unit, and the bits and words of their fields |
| domain | which shared memory: root path, prefix, and the lock under which anything in it is made |
| errors | why something failed |

Time stamps are CLOCK_MONOTONIC in nanoseconds: `time.monotonic_ns()`. Array fields of messages are sequences;
`estimate.velocity_m_s.numpy()` is a NumPy view of one. Frames: inertial and body, both right-handed;
`attitude_wxyz` rotates body vectors into inertial ones.
"""

from .domain import Domain
from .errors import DomainError, Incompatible, NoDaemon, ObserverError, PortError, Refused, TimedOut
from .payload import Channel, Command, Counters, Estimate, LatencySummary, Measurement, Reply, Status, Truth, status_bits
from .vehicle import Stream, Vehicle

__all__ = [
    "Channel",
    "Command",
    "Counters",
    "Domain",
    "DomainError",
    "Estimate",
    "Incompatible",
    "LatencySummary",
    "Measurement",
    "NoDaemon",
    "ObserverError",
    "PortError",
    "Refused",
    "Reply",
    "Status",
    "Stream",
    "TimedOut",
    "Truth",
    "Vehicle",
    "status_bits",
]
