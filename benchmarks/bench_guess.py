"""Is `import --guess` as certain as it is right? Prints a table; asserts nothing.

    python -m benchmarks.bench_guess [--draws N] [--measured FOLDER]

Flights of recorded campaigns are written as a camera would: any axis of the log up and
along the throw, any axes of the body, any format of rotations, 1 to 10 takes, each
thrown in its own direction with some roll. Half of the conventions are drawn with no
habit at all, half as most files of the format have them. A line a range of
probabilities that the guesses state: how many there were, and how many were right.
"""

import argparse
import dataclasses
import itertools
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from glider.campaign.importing.guess import Guess, guess_mapping
from glider.campaign.logs import Campaign, Flight
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from tests.helpers.campaigns import LIFELIKE, PRACTICE, campaign_path

FORMATS = ("motive", "motive_euler", "quaternion", "list", "euler")
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.01)
_MOTIVE = (
    "Format Version,1.24,Rotation Type,{rotation},Length Units,Millimeters\n\n"
    ",Type{bodies}\n,Name{names}\n,ID{ids}\n,,{parts}\nFrame,Time (Seconds),{axes}\n"
)


@dataclasses.dataclass(frozen=True)
class Convention:
    """How a camera logs: rows of `world` and `body` are its axes in ours."""

    format: str
    world: np.ndarray  # (3, 3) in forward, left, up.
    body: np.ndarray  # (3, 3) in nose, left, top.


def turns() -> list[np.ndarray]:
    """The 24 rotations that map axes to axes."""
    signed = [s * np.eye(3)[k] for k in range(3) for s in (1.0, -1.0)]
    pairs = itertools.product(signed, signed)
    return [np.stack([a, b, np.cross(a, b)]) for a, b in pairs if not a @ b]


def draw(rng: np.random.Generator, *, habit: bool) -> Convention:
    """A convention; with habit y is up in Motive, z elsewhere, and x ahead."""
    kind = str(rng.choice(FORMATS))
    if not habit:
        return Convention(kind, *(turns()[i] for i in rng.integers(24, size=2)))
    y_up = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    usual = y_up if kind.startswith("motive") else np.eye(3)
    return Convention(kind, usual, usual)


def write(
    folder: Path, flights: Sequence[Flight], way: Convention, rng: np.random.Generator
) -> list[Path]:
    """Writes each flight to a file as a camera would."""
    files = []
    for k, flight in enumerate(flights):
        pitch, (x, z) = flight.pose[:, 2], flight.pose[:, :2].T
        if flight.attitude is None:
            y = rng.normal(scale=2e-4, size=len(x))
            side = np.outer(flight.time, rng.normal(scale=[0.3, 0.1]))
        else:
            y, side = flight.attitude[:, 0], flight.attitude[:, 1:]
        turn = Rotation.from_euler(
            "ZYX", np.column_stack([side[:, 1], pitch, side[:, 0]])
        )
        throw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
        place = throw.apply(np.column_stack([x + 1.0, y + 2.0, z + 1.5]))
        place = place @ way.world.T
        rotation = Rotation.from_matrix(
            way.world @ (throw * turn).as_matrix() @ way.body.T
        )
        path = folder / f"take_{k}.csv"
        path.write_text(_text(way.format, flight.time, place, rotation))
        files.append(path)
    return files


def _text(kind: str, time: np.ndarray, place: np.ndarray, turn: Rotation) -> str:
    if kind == "list":
        x, y, z, w = turn.as_quat().T
        values = np.column_stack([time, place, w, x, y, z])
        head = "t,pos_x,pos_y,pos_z,q[0],q[1],q[2],q[3]\n"
    elif kind == "quaternion":
        values = np.column_stack([time, place, turn.as_quat()])
        head = "t,pos_x,pos_y,pos_z,quat_x,quat_y,quat_z,quat_w\n"
    elif kind == "euler":
        angles = turn.as_euler("ZYX", degrees=True)[:, ::-1]
        values = np.column_stack([time, 1000.0 * place, angles])
        head = "t,pos_x,pos_y,pos_z,rot_x,rot_y,rot_z\n"
    else:
        euler = kind == "motive_euler"
        angles = turn.as_euler("XYZ", degrees=True) if euler else turn.as_quat()
        count = angles.shape[1] + 3
        parts = ["Rotation"] * (count - 3) + ["Position"] * 3
        axes = ["X", "Y", "Z", *("W" * (count - 6)), "X", "Y", "Z"]
        head = _MOTIVE.format(
            rotation="XYZ" if euler else "Quaternion",
            bodies=",Rigid Body" * count,
            names=",Glider" * count,
            ids=",1" * count,
            parts=",".join(parts),
            axes=",".join(axes),
        )
        frames = np.arange(len(time))
        values = np.column_stack([frames, time, angles, 1000.0 * place])
    rows = (",".join(f"{v:.9g}" for v in row) for row in values)
    return head + "\n".join(rows) + "\n"


def is_right(guess: Guess, flights: Sequence[Flight]) -> bool:
    """Whether each of its flights has the heights and pitches of a true one."""
    return all(
        any(_contains(true.pose, flight.pose) for true in flights)
        for flight in guess.campaign.flights
    )


def _contains(true: np.ndarray, pose: np.ndarray) -> bool:
    heights, pitch = true[:, 1], pose[:, 2]
    z = pose[:, 1] - pose[0, 1]
    for at in range(len(true) - len(pose) + 1):
        rows = slice(at, at + len(pose))
        same = np.allclose(heights[rows] - heights[at], z, atol=2e-3)
        # A throw's direction is that of a fitted line: off by some milliradians.
        if same and np.allclose(true[rows, 2], pitch, atol=0.03):
            return True
    return False


def campaigns(measured: Path | None) -> list[Campaign]:
    """Simulated campaigns, and a measured one."""
    paths = [campaign_path(name) for name in (*PRACTICE, *LIFELIKE)]
    return [load_campaign(path) for path in [*paths, *([measured] if measured else [])]]


def run(
    sources: Sequence[Campaign], draws: int, seed: int = 0
) -> list[tuple[float, bool, bool]]:
    """Probability, whether it asks, and whether it is right, of many guesses."""
    rows = []
    for k in range(draws):
        rng = np.random.default_rng([seed, k])
        source = sources[rng.integers(len(sources))]
        count = int(rng.integers(1, 11))
        chosen = rng.choice(len(source.flights), size=count, replace=False)
        flights = [source.flights[i] for i in chosen]
        way = draw(rng, habit=k % 2 == 1)
        with tempfile.TemporaryDirectory() as folder:
            files = write(Path(folder), flights, way, rng)
            try:
                guess = guess_mapping(files)
            except InputError as error:
                print(f"{source.name}, {way.format}, {count} takes: {error}")
                continue
        frame = guess.text.partition("frame:")[2].partition("elevator:")[0]
        row = guess.probability, "?" in frame, is_right(guess, flights)
        rows.append(row)
        if not row[2]:
            print(source.name, way, count, *row, frame, sep="\n")
    return rows


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--measured", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rows = np.array(run(campaigns(args.measured), args.draws, args.seed))
    print("| probability stated | guesses | right |\n|---|---|---|")
    for low, high in itertools.pairwise(BINS):
        inside = rows[(rows[:, 0] >= low) & (rows[:, 0] < high)]
        right = f"{int(inside[:, 2].sum())}"
        print(f"| {low:g} to {min(high, 1.0):g} | {len(inside)} | {right} |")
    asks, right = rows[:, 1] > 0, rows[:, 2] > 0
    print(
        f"{len(rows)} guesses: {np.sum(right)} right, {np.sum(asks)} ask, of which "
        f"{np.sum(asks & right)} are right; {np.sum(~asks & ~right)} wrong unasked"
    )


if __name__ == "__main__":
    main()
