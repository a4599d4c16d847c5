"""Plays a table (CSV) as live samples at its own time, and writes every estimate to another one.

    daemon run --preset rigid-body &
    python examples/stream_csv.py flight.csv estimates.csv

Columns of the table, all SI; a quantity has all of its components or none, and where its cells are empty nothing was
measured: time_s; velocity_x, _y, _z (inertial, or body with --body-velocity) or body_velocity_x ...; angular_velocity_x ...; position_x ...; attitude_w, _x, _y, _z; force_x ...; torque_x ...
"""

import argparse
import csv
import sys
import time

from observer_client import ObserverError, Vehicle

QUANTITIES = {
    "velocity_m_s": ["velocity_x", "velocity_y", "velocity_z"],
    "body_velocity_m_s": ["body_velocity_x", "body_velocity_y", "body_velocity_z"],
    "angular_velocity_rad_s": ["angular_velocity_x", "angular_velocity_y", "angular_velocity_z"],
    "position_m": ["position_x", "position_y", "position_z"],
    "attitude_wxyz": ["attitude_w", "attitude_x", "attitude_y", "attitude_z"],
    "force_n": ["force_x", "force_y", "force_z"],
    "torque_n_m": ["torque_x", "torque_y", "torque_z"],
}
ESTIMATED = [
    ("position", "position_m"),
    ("velocity", "velocity_m_s"),
    ("angular_velocity", "angular_velocity_rad_s"),
    ("unknown_force", "matched_force_n"),
    ("unknown_torque", "matched_torque_n_m"),
]
HEADER = ["time_s", "sequence", "source_sequence", "status", "attitude_w", "attitude_x", "attitude_y", "attitude_z"]
HEADER += [f"{name}_{axis}" for name, _ in ESTIMATED for axis in "xyz"]


def read_table(path, is_body_velocity):
    """Times (s) from the first row on, and what was measured then, as arguments of `Vehicle.publish`."""
    with open(path, newline="") as file:
        table = csv.DictReader(file)
        columns = table.fieldnames or []
        quantities = {}
        for quantity, needed in QUANTITIES.items():
            missing = [column for column in needed if column not in columns]
            if not missing:
                quantities[quantity] = needed
            elif len(missing) < len(needed):
                raise ObserverError(f"{path}: lacks the column {missing[0]}; needed: all of {', '.join(needed)}, or none")
        if "time_s" not in columns or not quantities:
            raise ObserverError(f"{path} has the columns {', '.join(columns)}; needed: time_s and velocity_x, ... (--help)")
        rows = []
        for row in table:
            try:
                cells = {quantity: [row[column] for column in needed] for quantity, needed in quantities.items()}
                values = {q: [float(cell) for cell in found] for q, found in cells.items() if any(found)}
                time_s = float(row["time_s"])
            except (TypeError, ValueError) as cause:
                raise ObserverError(f"{path}, line {table.line_num}: {cause}; needed: a number in each column") from cause
            if is_body_velocity and "velocity_m_s" in values:
                values["body_velocity_m_s"] = values.pop("velocity_m_s")
            if values:
                rows.append((time_s, values))
    if not rows:
        raise ObserverError(f"{path} has no rows")
    return [(time_s - rows[0][0], values) for time_s, values in rows]


def stream(vehicle, rows, writer):
    """Publishes each row when its time has come, and writes what was estimated meanwhile. How many samples, estimates."""
    n_written = 0
    estimates = vehicle.estimates()
    start_ns = time.monotonic_ns()

    def write_estimates_until(end_ns):
        nonlocal n_written
        while True:
            while (estimate := estimates.take()) is not None:
                time_s = (estimate.stamp_ns - start_ns) * 1e-9
                row = [f"{time_s:.6f}", estimate.sequence, estimate.source_sequence, " ".join(estimate.words())]
                row += estimate.attitude_wxyz
                for _, field in ESTIMATED:
                    row += getattr(estimate, field)
                writer.writerow(row)
                n_written += 1
            left_s = (end_ns - time.monotonic_ns()) * 1e-9
            if left_s <= 0.0:
                return
            time.sleep(min(left_s, 0.002))

    for time_s, values in rows:
        stamp_ns = start_ns + round(time_s * 1e9)
        write_estimates_until(stamp_ns)
        vehicle.publish(stamp_ns=stamp_ns, **values)
    write_estimates_until(time.monotonic_ns() + 100_000_000)
    return len(rows), n_written


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("samples", help="table to play")
    parser.add_argument("estimates", help="table to write")
    parser.add_argument("--body-velocity", action="store_true", help="velocity columns are along the body axes")
    parser.add_argument("--instance", default="vehicle")
    parser.add_argument("--root", help="root path of the shared memory's domain")
    arguments = parser.parse_args()
    try:
        rows = read_table(arguments.samples, arguments.body_velocity)
        with Vehicle(arguments.instance, arguments.root) as vehicle, open(arguments.estimates, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(HEADER)
            n_samples, n_estimates = stream(vehicle, rows, writer)
    except (ObserverError, OSError) as error:
        sys.exit(f"stream_csv: {error}")
    print(f"{n_samples} samples played; {n_estimates} estimates in {arguments.estimates}")


if __name__ == "__main__":
    main()
