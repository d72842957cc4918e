"""Does each form of log give back the campaign, and its truth? Prints a table.

    python -m benchmarks.bench_conversions [--trace] [FORM ...]

A line a campaign and a form that contains a FORM's text: the flights that come back,
the largest errors of their columns and times, the rows that are lost where recordings
are cut, and what `--guess` makes of it. With --trace what close-the-loop finds: it runs
once for each set of columns, and the others name the form that has the same.
"""

import argparse
import dataclasses
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.conversions import FORMS, vehicle_text
from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.guess import guess_mapping
from glider.campaign.logs import Campaign, Flight
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.campaign.samples import campaign_folder
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.sysid.pipeline import close_the_loop
from tests.helpers.tasks import fly


class Differences(NamedTuple):
    """How flights differ from the true ones."""

    flights: int
    pose: float  #: Of x, z [m] and pitch [rad], the largest.
    servo: float  #: Of the elevator [rad] and its commands [rad/s].
    time: float  #: [s]
    lost: int  #: Rows.


def campaigns(count: int = 20) -> Iterator[Campaign]:
    """A sample, and a campaign in wind with noisier poses at 200 Hz."""
    sample = load_campaign(campaign_folder("attached_lift"))
    yield dataclasses.replace(sample, flights=sample.flights[:count])
    capture = MotionCapture(rate=200.0, position=1e-3, pitch=5e-3)
    wind = KINDS["wind"](x=-0.6, z=0.1)
    yield fly(wind, seed=7, flights=count, capture=capture)


def compare(made: Campaign, true: Sequence[Flight]) -> Differences:
    """Compares each flight with the true one, and its rows, that are nearest."""
    worst = np.zeros(3)
    lost = 0
    for flight in made.flights:
        error, rows = min((_compare(flight, other) for other in true), key=_first)
        worst = np.maximum(worst, error)
        lost += rows - len(flight.time)
    return Differences(len(made.flights), *worst.tolist(), lost)


def is_same(one: Campaign, other: Campaign) -> bool:
    """Whether the tracer gets the same of two campaigns: one trace is enough."""
    spatial = [c.flights[0].attitude is not None for c in (one, other)]
    if len(one.flights) != len(other.flights) or one.servo != other.servo:
        return False
    found = compare(one, other.flights)
    equal = max(found.pose, found.servo) < 1e-8 and found.time < 1e-6
    return equal and not found.lost and spatial[0] == spatial[1]


def _first(found: tuple[np.ndarray, int]) -> float:
    return float(found[0][0])


def _compare(flight: Flight, true: Flight) -> tuple[np.ndarray, int]:
    """Largest errors of pose, servo and time, where the pose's is least."""
    time = flight.time - flight.time[0]
    best = np.full(3, np.inf)
    for first in range(max(len(true.time) - len(time) + 1, 0)):
        rows = first + np.arange(len(time))
        if len(time) < len(true.time):  # Some in between may be missing.
            rows = np.searchsorted(true.time, true.time[first] + time - 2e-3)
            rows = np.minimum(rows, len(true.time) - 1)
        pose = flight.pose - true.pose[rows]
        pose[:, :2] -= pose[0, :2]
        errors = [np.abs(pose).max(), np.inf, np.inf]
        if errors[0] < best[0]:
            errors[2] = np.abs(time - true.time[rows] + true.time[first]).max()
            if flight.elevator is not None:
                servo = flight.elevator - true.elevator[rows]
                rate = flight.command - true.command[rows]
                errors[1] = np.abs([servo, rate]).max()
            best = np.array(errors)
    return best, len(true.time)


def read(files: Sequence[Path], text: str) -> Campaign | str:
    """The campaign of a MAP, or the sentence that refuses it."""
    path = files[0].parent / "MAP.yaml"
    path.write_text(text)
    try:
        return read_flights(files, path).campaign
    except InputError as error:
        return str(error).replace(f"{files[0].parent}/", "")


def guessed(files: Sequence[Path], vehicle: str) -> str:
    """The text of a guessed MAP with what is known of the vehicle."""
    guess = guess_mapping(files)
    if "elevator: servo" not in guess.text:
        vehicle = "vehicle: {elevator: fixed_per_flight}\n"
    return guess.text.partition("vehicle:")[0] + vehicle


def describe(made: Campaign | str, true: Sequence[Flight]) -> str:
    """Cells of the table."""
    if isinstance(made, str):
        return f"refused: {made} | | | | "
    found = compare(made, true)
    errors = f"{found.pose:.0e} | {found.servo:.0e} | {found.time:.0e}"
    return f"{found.flights} of {len(true)} | {errors} | {found.lost}"


def found_in(campaign: Campaign) -> str:
    """Verdict and effects with their first coefficients."""
    result = close_the_loop(campaign)
    effects = [
        f"{e.kind} {v.value:.4g} ± {v.std:.1g}"
        for e in result.effects
        for v in list(e.coefficients.values())[:1]
    ]
    return f"{result.verdict}: {', '.join(effects)}"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("forms", nargs="*", default=[""])
    parser.add_argument("--trace", action="store_true")
    args = parser.parse_args()
    print("| form | flights | pose | servo | time | rows lost | guess | trace |")
    print("|---|---|---|---|---|---|---|---|")
    for campaign in campaigns():
        original = found_in(campaign) if args.trace else ""
        print(f"| **{campaign.name}** | | | | | | | {original} |", flush=True)
        traces = {"the original": campaign}
        for name, (write, count) in FORMS.items():
            if not any(form in name for form in args.forms):
                continue
            true, vehicle = campaign.flights[:count], vehicle_text(campaign)
            some = dataclasses.replace(campaign, flights=true)
            with tempfile.TemporaryDirectory() as folder:
                files, text = write(Path(folder), some)
                made = read(files, text + vehicle)
                try:
                    guess = read(files, guessed(files, vehicle))
                except InputError:
                    guess = "none"
            traced = ""
            if args.trace and isinstance(made, Campaign):
                same = (n for n, other in traces.items() if is_same(made, other))
                if known := next(same, None):
                    traced = f"as {known}"
                else:
                    traces[name], traced = made, found_in(made)
            first = describe(guess, true).partition(" |")[0]
            print(
                f"| {name} | {describe(made, true)} | {first} | {traced} |", flush=True
            )


if __name__ == "__main__":
    main()
