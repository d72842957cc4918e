"""How far off is a clock's offset that the import finds, in its standard errors?

Draws gliders with one effect each, converts their flights to two clocks and imports
them: planar poses at 120 Hz, and Motive's at 200 Hz with twice the noise. The errors
over their standard errors must have an RMS of one at most.

    python -m benchmarks.bench_clock [draws]
"""

import itertools
import sys
import tempfile
from pathlib import Path

import numpy as np

from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.motion_capture import MotionCapture
from glider.errors import InputError
from tests.campaign.importing import foreign
from tests.campaign.importing.test_servo_logs import AHEAD, write
from tests.helpers.tasks import fly, typical

KINDS = (
    *("attached_lift", "profile_drag", "camber", "pitch_damping", "inertia"),
    *("center_of_pressure", "elevator_area", "tail_wake", "downwash", "wind"),
)


def run(kind: str, flights: int, seed: int, motive: bool) -> tuple[float, float]:
    """Error of the offset and its standard error [s]; nan where it was refused."""
    noisy = MotionCapture(rate=200.0, position=1e-3, pitch=5e-3)
    capture = noisy if motive else MotionCapture()
    campaign = fly(typical(kind), flights=flights, seed=seed, capture=capture)
    with tempfile.TemporaryDirectory() as folder:
        if motive:
            files, path = (
                foreign.write_motive(Path(folder), campaign),
                Path(folder, "M"),
            )
            path.write_text(foreign.MAP_MOTIVE + foreign.VEHICLE)
        else:
            files, path = write(Path(folder), campaign, "two clocks")
        try:
            imported = read_flights(files, path)
        except InputError:
            return np.nan, np.nan
    [note] = {n for r in imported.recordings for n in r.notes if n.startswith("clock")}
    offset = float(note.partition(" is ")[2].partition(" ")[0])
    true = foreign.AHEAD if motive else AHEAD
    return offset - true, imported.campaign.servo.clock_std


def main(draws: int) -> None:
    for flights, motive in itertools.product((4, 10), (False, True)):
        drawn = itertools.product(KINDS, range(draws))
        found = np.array([run(kind, flights, s, motive) for kind, s in drawn])
        error, std = found[np.isfinite(found[:, 0])].T
        form = "Motive" if motive else "planar"
        print(
            f"{flights:3d} flights, {form}: {len(error)} of {len(found)} found, error "
            f"{1e3 * np.mean(error):.1f} ± {1e3 * np.std(error):.1f} ms, most "
            f"{1e3 * np.max(np.abs(error)):.1f} ms; over its standard error "
            f"{np.sqrt(np.mean((error / std) ** 2)):.2f} RMS, "
            f"{np.max(np.abs(error / std)):.1f} at most"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
