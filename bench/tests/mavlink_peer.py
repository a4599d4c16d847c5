"""A vehicle that speaks MAVLink through pymavlink, for bench/tests/mavlink.rs.

Its clock is CLOCK_MONOTONIC less a known offset, its motion a circle with a turning nose; rotations are written out
here, so that nothing is checked with itself. What it sent and heard goes to stdout as JSON.
"""

import argparse
import json
import math
import os
import select
import sys
import time
import tty

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import common as mavlink  # noqa: E402

BOOT_AGE_S = 1234.5


class Serial:
    """The far end of a pseudo terminal."""

    def __init__(self, system_id):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.mav = mavlink.MAVLink(self, srcSystem=system_id, srcComponent=1)
        self.waiting = []
        print(os.ttyname(self.slave), flush=True)

    def write(self, data):
        os.write(self.master, data)

    def recv_msg(self):
        if not self.waiting and select.select([self.master], [], [], 0)[0]:
            self.waiting = self.mav.parse_buffer(os.read(self.master, 4096)) or []
        return self.waiting.pop(0) if self.waiting else None


def quaternion(roll, pitch, yaw):
    """Body to inertial, w first, from 3-2-1 angles."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def to_inertial(roll, pitch, yaw):
    """The rotation matrix of the same angles: Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def motion(t):
    roll, pitch, yaw = 0.3 * math.sin(0.7 * t), 0.2 * math.cos(0.9 * t), 2.8 * math.sin(0.4 * t)
    velocity = [1.5 * math.cos(0.5 * t), 1.5 * math.sin(0.5 * t), 0.4 * math.sin(0.8 * t)]
    matrix = to_inertial(roll, pitch, yaw)
    return {
        "position": [3 * math.sin(0.5 * t), -3 * math.cos(0.5 * t), -10 - 0.5 * math.cos(0.8 * t)],
        "velocity": velocity,
        "body_velocity": [sum(matrix[row][column] * velocity[row] for row in range(3)) for column in range(3)],
        "euler": [roll, pitch, yaw],
        "quaternion": quaternion(roll, pitch, yaw),
        "rates": [0.2 * math.cos(0.7 * t), -0.1 * math.sin(0.9 * t), 0.5 * math.cos(0.4 * t)],
        "up": [-matrix[row][2] for row in range(3)],
        "thrust": 0.5 + 0.2 * math.sin(0.3 * t),
    }


class Vehicle:
    def __init__(self, options):
        self.options = options
        if options.wire == "pty":
            self.link = Serial(1)
        else:
            self.link = mavutil.mavlink_connection(options.wire, source_system=1, source_component=1, dialect="common")
        self.mav = self.link.mav
        self.boot_s = time.monotonic() - BOOT_AGE_S
        self.heard = {"odometry": [], "heartbeats": 0, "requests": [], "offsets_us": [], "sources": []}
        self.sent = []

    def now_s(self):
        return time.monotonic() - self.boot_s

    def listen(self):
        while True:
            try:
                message = self.link.recv_msg()
            except (ConnectionRefusedError, BlockingIOError):
                message = None
            if message is None:
                return
            kind = message.get_type()
            source = [message.get_srcSystem(), message.get_srcComponent()]
            if source not in self.heard["sources"]:
                self.heard["sources"].append(source)
            if kind == "HEARTBEAT":
                self.heard["heartbeats"] += 1
            elif kind == "TIMESYNC" and message.tc1 == 0:
                self.mav.timesync_send(int(self.now_s() * 1e9), message.ts1)
            elif kind == "TIMESYNC":
                # Ours came back with the bridge's CLOCK_MONOTONIC in it.
                self.heard["offsets_us"].append((message.tc1 - message.ts1) / 1e3)
            elif kind == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                wanted = int(message.param1)
                self.heard["requests"].append([wanted, message.param2, message.target_system])
                denied = wanted == mavlink.MAVLINK_MSG_ID_ODOMETRY
                result = mavlink.MAV_RESULT_DENIED if denied else mavlink.MAV_RESULT_ACCEPTED
                self.mav.command_ack_send(message.command, result)
            elif kind == "ODOMETRY":
                self.heard["odometry"].append(
                    {
                        "time_usec": message.time_usec,
                        "frames": [message.frame_id, message.child_frame_id],
                        "position": [message.x, message.y, message.z],
                        "quaternion": list(message.q),
                        "velocity": [message.vx, message.vy, message.vz],
                        "rates": [message.rollspeed, message.pitchspeed, message.yawspeed],
                        "unknown": [math.isnan(message.pose_covariance[0]), math.isnan(message.velocity_covariance[0])],
                        "estimator_type": message.estimator_type,
                    }
                )

    def beat(self):
        self.mav.heartbeat_send(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4)

    def odometry(self, t_s, m):
        unknown = [math.nan] + [0.0] * 20
        velocities = [*m["body_velocity"], *m["rates"]]
        fields = [int(t_s * 1e6), 1, 12, *m["position"], m["quaternion"], *velocities, unknown, unknown]
        self.mav.odometry_send(*fields, 0, mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT, 0)

    def note(self, t_s, m):
        self.sent.append({"monotonic_s": t_s + self.boot_s, **m})

    def paced(self, n):
        """Counts, at the rate asked for, listening in between, before and after."""
        start = time.monotonic()
        while time.monotonic() < start + self.options.lead_s:
            self.beat()
            self.listen()
            time.sleep(0.05)
        period = 1 / self.options.rate_hz
        due = time.monotonic()
        for k in range(n):
            if k % 100 == 0:
                self.beat()
            yield k
            # Late ones are not made up for in a burst.
            due = max(due + period, time.monotonic() + 0.6 * period)
            while (left := due - time.monotonic()) > 0:
                self.listen()
                time.sleep(min(left, 0.002))
        end = time.monotonic() + 0.6
        while time.monotonic() < end:
            self.listen()
            time.sleep(0.005)

    def fly_odometry(self):
        for k in self.paced(self.options.n):
            t = self.now_s()
            m = motion(t)
            self.odometry(t, m)
            self.note(t, m)
            if k % 50 == 0:
                self.mav.timesync_send(0, time.monotonic_ns())

    def fly_pair(self):
        """Position and attitude some milliseconds apart, in either order, in both versions of the protocol."""
        for k in self.paced(self.options.n):
            t = self.now_s()
            ms = int(t * 1e3)
            m = motion(ms * 1e-3)
            old = k % 3 == 0
            self.mav.attitude_target_send(ms, 0, [1, 0, 0, 0], 0, 0, 0, m["thrust"], force_mavlink1=old)

            def position():
                self.mav.local_position_ned_send(ms, *m["position"], *m["velocity"], force_mavlink1=old)

            def attitude():
                if k < self.options.n // 2:
                    self.mav.attitude_send(ms - k % 3, *m["euler"], *m["rates"], force_mavlink1=not old)
                else:
                    self.mav.attitude_quaternion_send(ms - k % 3, *m["quaternion"], *m["rates"])

            for half in (position, attitude) if k % 2 else (attitude, position):
                half()
            self.note(ms * 1e-3, m)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("wire")
    parser.add_argument("flight")
    parser.add_argument("--n", type=int, default=1000)
    parser.add_argument("--rate-hz", type=float, default=200.0)
    parser.add_argument("--lead-s", type=float, default=0.5)
    options = parser.parse_args()
    vehicle = Vehicle(options)
    if options.wire == "pty":
        sys.stdin.readline()
    getattr(vehicle, f"fly_{options.flight}")()
    print(json.dumps({"sent": vehicle.sent, **vehicle.heard}))


if __name__ == "__main__":
    main()
