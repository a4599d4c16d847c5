"""The examples do what they say."""

import csv
import math
import subprocess
import sys
import time

from conftest import EXAMPLES, PATIENCE_S

from observer_client import Vehicle


def run(name, service, *arguments):
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    return subprocess.run(command, env=service.environment, capture_output=True, text=True, timeout=4 * PATIENCE_S)


def test_the_flight_loop_learns_the_drag(service):
    # 2 to 3 N, which the service does not know; repeated where the machine stalls.
    for _ in range(5):
        done = run("flight_loop.py", service, "--duration", 4)
        assert done.returncode == 0, done.stderr
        assert " m/s, unknown force " in done.stdout
        if float(done.stdout.split("error ")[1].split(" N")[0]) < 0.8:
            return
    raise AssertionError(done.stdout)


def test_a_table_is_streamed_and_the_estimates_written(service, tmp_path):
    samples, estimates = tmp_path / "samples.csv", tmp_path / "estimates.csv"
    with open(samples, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "velocity_x", "velocity_y", "velocity_z", "force_x", "force_y", "force_z", "note"])
        for k in range(400):
            t = 100.0 + k * 0.005
            writer.writerow([t, math.sin(t), math.cos(t), 0.5, 0.0, 0.0, -19.62, "ignored"])
    done = run("stream_csv.py", service, samples, estimates)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("400 samples played; ")
    with open(estimates, newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == int(done.stdout.split("; ")[1].split()[0]) >= 300
    compared = [row for row in rows if 1.0 < float(row["time_s"]) < 2.0 and row["status"].startswith("tracking")
                or "coasting-rotation" in row["status"] and 1.0 < float(row["time_s"]) < 1.9]
    assert len(compared) > 50
    for row in compared:
        t = 100.0 + float(row["time_s"])
        truth = [math.sin(t), math.cos(t), 0.5]
        assert math.dist([float(row[f"velocity_{axis}"]) for axis in "xyz"], truth) < 0.15, row
    assert int(rows[-1]["source_sequence"]) == 399
    with Vehicle(root=service.root, patience_s=PATIENCE_S) as vehicle:
        status = vehicle.status()
        assert status.counters.samples_accepted + sum(status.counters.samples_rejected) == 400
        assert status.counters.samples_accepted > 300


def test_tables_that_cannot_be_played_are_refused_with_the_reason(service_to_start, tmp_path):
    samples = tmp_path / "samples.csv"
    for text, found in [
        ("velocity_x,velocity_y,velocity_z\n1,2,3\n", "needed: time_s and velocity_x"),
        ("time_s,velocity_x,velocity_y\n1,2,3\n", "lacks the column velocity_z"),
        ("time_s,velocity_x,velocity_y,velocity_z\n1,2,3,x\n", "line 2"),
        ("time_s,velocity_x,velocity_y,velocity_z\n", "has no rows"),
    ]:
        samples.write_text(text)
        done = run("stream_csv.py", service_to_start, samples, tmp_path / "out.csv")
        assert done.returncode == 1 and found in done.stderr, done.stderr
        assert "Traceback" not in done.stderr


def test_the_plot_is_drawn_without_a_display(service, tmp_path):
    picture = tmp_path / "live.png"
    vehicle = subprocess.Popen(
        [sys.executable, str(EXAMPLES / "flight_loop.py"), "--duration", "30"],
        env=service.environment,
        stdout=subprocess.DEVNULL,
    )
    try:
        done = run("live_plot.py", service, "--save", picture, "--window", 2)
    finally:
        vehicle.kill()
        vehicle.wait()
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[0]) > 100
    header = picture.read_bytes()[:24]
    assert header[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(header[16:20], "big") >= 900
