"""Draws what the service estimates while it runs: velocity, the unknown force, and how far both can be trusted.

    daemon run --preset rigid-body &
    sim_publisher run --scenario rigid-body --duration 30 &
    python examples/live_plot.py

Needs matplotlib. Without a display: --save FILE draws the last --window seconds once, after as many seconds. Where a
simulator publishes the truth, it is drawn dashed.
"""

import argparse
import collections
import sys
import time

from observer_client import ObserverError, Vehicle, status_bits

AXES = ("north", "east", "down")
COLORS = ("#1f77b4", "#d95f02", "#2a9d5c")
FRAMES_HZ = 20.0


class Window:
    """The newest seconds of two streams."""

    def __init__(self, vehicle, window_s):
        self.window_ns = round(window_s * 1e9)
        self.streams = vehicle.estimates(), vehicle.truths()
        self.estimates, self.truths = collections.deque(), collections.deque()

    def update(self):
        for stream, kept in zip(self.streams, (self.estimates, self.truths)):
            while (message := stream.take()) is not None:
                kept.append(message)
        newest_ns = self.estimates[-1].stamp_ns if self.estimates else 0
        for kept in (self.estimates, self.truths):
            while kept and kept[0].stamp_ns < newest_ns - self.window_ns:
                kept.popleft()

    def times_s(self, messages):
        newest_ns = self.estimates[-1].stamp_ns if self.estimates else 0
        return [(message.stamp_ns - newest_ns) * 1e-9 for message in messages]


class Picture:
    """Three panels over the same time."""

    def __init__(self, plt, window_s):
        self.figure, (velocity, force, trust) = plt.subplots(3, 1, sharex=True, figsize=(9, 7), layout="constrained")
        self.panels = velocity, force, trust
        self.lines = {}
        for panel, field, label in (
            (velocity, "velocity_m_s", "velocity (m/s)"),
            (force, "matched_force_n", "unknown force (N)"),
        ):
            for axis, (name, color) in enumerate(zip(AXES, COLORS)):
                self.lines["estimate", field, axis] = panel.plot([], [], color=color, label=name)[0]
                self.lines["truth", field, axis] = panel.plot([], [], "--", color=color, linewidth=1, alpha=0.7)[0]
            panel.set_ylabel(label)
        velocity.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
        self.lines["output_error"] = trust.plot([], [], color="#444444", label="velocity's output error (m/s)")[0]
        self.lines["coasting"] = trust.plot([], [], "|", color="#c1121f", label="coasting, stale or late")[0]
        trust.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
        trust.set_ylabel("trust")
        trust.set_xlabel("time before the newest estimate (s)")
        trust.set_xlim(-window_s, 0.0)
        for panel in self.panels:
            panel.grid(True, color="#dddddd", linewidth=0.6)
            panel.spines[["top", "right"]].set_visible(False)

    def draw(self, window):
        estimates, truths = list(window.estimates), list(window.truths)
        times_s = {"estimate": window.times_s(estimates), "truth": window.times_s(truths)}
        for field in ("velocity_m_s", "matched_force_n"):
            for source, messages in (("estimate", estimates), ("truth", truths)):
                columns = zip(*(getattr(message, field) for message in messages)) if messages else ([], [], [])
                for axis, values in enumerate(columns):
                    self.lines[source, field, axis].set_data(times_s[source], values)
        self.lines["output_error"].set_data(times_s["estimate"], [e.translation.output_error for e in estimates])
        doubtful = status_bits.COASTING | status_bits.STALE | status_bits.LATE | status_bits.INVALID
        at_s = [t for t, e in zip(times_s["estimate"], estimates) if e.status & doubtful]
        self.lines["coasting"].set_data(at_s, [0.0] * len(at_s))
        for panel in self.panels:
            panel.relim()
            panel.autoscale_view(scalex=False)
        if estimates:
            newest = estimates[-1]
            self.panels[0].set_title(
                f"{', '.join(newest.words())};  age {newest.age_s() * 1e3:.0f} ms", loc="right", fontsize="medium"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--window", type=float, default=10.0, help="seconds to show")
    parser.add_argument("--save", metavar="FILE", help="picture (.png, .svg, .pdf) after --window seconds; no display needed")
    parser.add_argument("--instance", default="vehicle")
    parser.add_argument("--root", help="root path of the shared memory's domain")
    arguments = parser.parse_args()
    try:
        import matplotlib

        if arguments.save:
            matplotlib.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError:
        sys.exit("live_plot: matplotlib is not installed; needed: pip install matplotlib")
    try:
        with Vehicle(arguments.instance, arguments.root) as vehicle:
            window = Window(vehicle, arguments.window)
            picture = Picture(plt, arguments.window)
            end_s = time.monotonic() + arguments.window
            if arguments.save:
                while time.monotonic() < end_s:
                    window.update()
                    time.sleep(1.0 / FRAMES_HZ)
                picture.draw(window)
                picture.figure.savefig(arguments.save, dpi=120)
                print(f"{len(window.estimates)} estimates, {len(window.truths)} true states in {arguments.save}")
                return
            plt.show(block=False)
            while plt.fignum_exists(picture.figure.number):
                window.update()
                picture.draw(window)
                plt.pause(1.0 / FRAMES_HZ)
    except ObserverError as error:
        sys.exit(f"live_plot: {error}")
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
