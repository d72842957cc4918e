"""How far off is a clock's offset that the import finds, in its standard errors?

Draws gliders that lack one effect each, converts their flights to two clocks and
imports them: the errors over their standard errors must have an RMS of about one.

    python -m tests.benchmarks.bench_clock [draws]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from glider.campaign.importing.campaign_import import read_flights
from glider.errors import InputError
from tests.campaign.importing.test_servo_logs import AHEAD, write
from tests.helpers.tasks import fly, typical

KINDS = (
    *("attached_lift", "profile_drag", "camber", "pitch_damping", "inertia"),
    *("center_of_pressure", "elevator_area", "tail_wake", "downwash", "wind"),
)


def run(kind: str, flights: int, seed: int) -> tuple[float, float]:
    """Error of the offset and its standard error [s]; nan where it was refused."""
    campaign = fly(typical(kind), flights=flights, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        files, path = write(Path(folder), campaign, "two clocks")
        try:
            [*recordings] = read_flights(files, path).recordings
        except InputError:
            return np.nan, np.nan
    [note] = {n for r in recordings for n in r.notes if n.startswith("clock")}
    offset = float(note.partition(" is ")[2].partition(" ")[0])
    return offset - AHEAD, recordings[0].servo.clock_std


def main(draws: int) -> None:
    for flights in (4, 10):
        found = np.array([run(k, flights, s) for k in KINDS for s in range(draws)])
        error, std = found[np.isfinite(found[:, 0])].T
        print(
            f"{flights:3d} flights: {len(error)} of {len(found)} found, error "
            f"{1e3 * np.mean(error):.1f} ± {1e3 * np.std(error):.1f} ms, most "
            f"{1e3 * np.max(np.abs(error)):.1f} ms; over its standard error "
            f"{np.sqrt(np.mean((error / std) ** 2)):.2f} RMS, "
            f"{np.max(np.abs(error / std)):.1f} at most"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
