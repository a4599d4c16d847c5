"""A vehicle's loop at its own pace: publish a sample, look at the newest estimate, steer by it if it can be trusted.

    daemon run --preset rigid-body &
    python examples/flight_loop.py

Here the vehicle is a multicopter of 2 kg. Its drag is not part of the configuration: the service learns it.
"""

import argparse
import math
import random
import time

from observer_client import Vehicle, status_bits


def fly(read_sensors, instance="vehicle", root=None, rate_hz=200.0, duration_s=10.0):
    do_not_fly = status_bits.STALE | status_bits.INVALID | status_bits.WAITING
    estimate = None
    with Vehicle(instance, root, patience_s=5.0) as vehicle:
        start_ns = time.monotonic_ns()
        for tick in range(round(duration_s * rate_hz)):
            stamp_ns = time.monotonic_ns()
            velocity_m_s, angular_velocity_rad_s, attitude_wxyz, force_n = read_sensors((stamp_ns - start_ns) * 1e-9)
            vehicle.publish(
                stamp_ns=stamp_ns,  # when the readings were taken
                velocity_m_s=velocity_m_s,  # inertial; body_velocity_m_s for a Doppler log
                angular_velocity_rad_s=angular_velocity_rad_s,
                attitude_wxyz=attitude_wxyz,
                force_n=force_n,  # what was commanded, inertial axes
                # on_ground=True while the landed detector says so: nothing is learned
            )
            estimate = vehicle.latest()  # the newest one, no queue
            if estimate is None or estimate.status & do_not_fly or estimate.age_s() > 0.1:
                print("no estimate to fly on")
            elif tick % 100 == 0:
                print(estimate.velocity_m_s, "m/s, unknown force", estimate.matched_force_n, "N", estimate.words())
            time.sleep(max(0.0, (tick + 1) / rate_hz - (time.monotonic_ns() - start_ns) * 1e-9))
    return estimate


class Multicopter:
    """The truth, and its sensors. North-east-down: hovering takes a force of -m g along the third axis."""

    MASS_KG, GRAVITY_M_S2, DRAG_N_S_M = 2.0, 9.81, 2.0

    def __init__(self):
        self.time_s, self.velocity_m_s, self.pushed_n = 0.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self.noise = random.Random(1)

    def drag_n(self):
        return [-self.DRAG_N_S_M * v for v in self.velocity_m_s]

    def sensors(self, time_s):
        """What is measured at a time, and the force commanded from then on."""
        steps = max(1, round((time_s - self.time_s) / 1e-3))
        dt_s = (time_s - self.time_s) / steps
        for _ in range(steps):
            forces_n = zip(self.pushed_n, self.drag_n())
            self.velocity_m_s = [
                v + dt_s * (pushed_n + drag_n) / self.MASS_KG for v, (pushed_n, drag_n) in zip(self.velocity_m_s, forces_n)
            ]
        self.time_s = time_s
        self.pushed_n = [4.0 * math.sin(1.5 * time_s), 4.0 * math.cos(1.1 * time_s), 1.0]
        force_n = [*self.pushed_n[:2], self.pushed_n[2] - self.MASS_KG * self.GRAVITY_M_S2]
        velocity_m_s = [v + self.noise.gauss(0.0, 0.01) for v in self.velocity_m_s]
        angular_velocity_rad_s = [self.noise.gauss(0.0, 0.002) for _ in range(3)]
        return velocity_m_s, angular_velocity_rad_s, [1.0, 0.0, 0.0, 0.0], force_n


def main():
    parser = argparse.ArgumentParser(description="a simulated multicopter beside the service")
    parser.add_argument("--instance", default="vehicle")
    parser.add_argument("--root", help="root path of the shared memory's domain")
    parser.add_argument("--duration", type=float, default=10.0, help="seconds")
    arguments = parser.parse_args()
    vehicle = Multicopter()
    estimate = fly(vehicle.sensors, arguments.instance, arguments.root, duration_s=arguments.duration)
    error_n = math.dist(estimate.matched_force_n, vehicle.drag_n())
    print(f"drag {vehicle.drag_n()} N; learned {estimate.matched_force_n} N; error {error_n:.3f} N")


if __name__ == "__main__":
    main()
