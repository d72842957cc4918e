"""How well do flights show gravity? Prints a table; asserts nothing.

    python -m benchmarks.bench_fall [--draws 20] [--measured FOLDER]

A line a family of campaigns whose scales are right: how many show gravity, its error
(RMS of the logarithm), the median of the stated standard deviations, and the largest
errors in standard deviations. Families: strong effects of the library, lifelike
campaigns and throws, ten launches under one plan and its feedback, and parts of
campaigns of 3 to 8 flights.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from examples.perch_corrected import rehearse
from glider.campaign.checks.fall import _UNKNOWN, _measure_fall
from glider.campaign.checks.forces import Motions, measure_motions
from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.motion import Motion
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.campaign.samples import sample_names
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from tests.campaign.checks.test_effects_pass import STRONG, fly
from tests.helpers.lifelike import draw_campaign, draw_throws, turbulence_campaign


def campaigns(draws: int, folders: list[Path]) -> Iterator[tuple[str, Campaign]]:
    """Yields families and their campaigns."""
    for kind, values in STRONG:
        if kind != "position_scale":
            yield "strong effects", fly((KINDS[kind](**values),))
    for name in sorted(path.stem for path in models_path("truths").glob("*.yaml")):
        yield "one plan", of_one_plan(name)
    for seed in range(draws):
        yield "lifelike", draw_campaign(seed)[0]
        yield "throws", draw_throws(seed)[0]
        yield "turbulence", turbulence_campaign(seed)[0]
    for folder in folders:
        yield folder.name, load_campaign(folder)


def of_one_plan(name: str, seed: int = 0) -> Campaign:
    """Logs of a glider of models/truths, launched under the plan of its nominal model.

    The flights are alike: they show little of what shapes the forces of the air.
    """
    problem, rng = PerchingProblem(), np.random.default_rng(seed)
    starts, truth = problem.draw_launches(10, rng), GliderModel.load(name)
    nominal = GliderModel(parameters=truth.parameters)
    _, flights = rehearse(truth, nominal, problem, starts, rng)
    return flights.campaign


def motions_of(campaign: Campaign) -> list[Motion]:
    """Motions of the flights that pass the checks."""
    found = inspect(campaign)
    motions = measure_motions(found.campaign.flights, found.masks)
    return [motion for motion in motions.each if len(motion.time) > 3]


def sets(draws: int, folders: list[Path]) -> Iterator[tuple[str, float, list[Motion]]]:
    """Yields families, gravity, and motions of flights."""
    rng = np.random.default_rng(0)
    for family, campaign in campaigns(draws, folders):
        try:
            yield family, campaign.gravity, motions_of(campaign)
        except InputError as error:
            print("refused:", error)
    for folder in [*sample_names(), *folders]:
        campaign = load_campaign(folder)
        motions, family = (
            motions_of(campaign),
            "measured" if folder in folders else "sample",
        )
        for count in (3, 5, 8):
            for _ in range(draws):
                rows = rng.choice(len(motions), min(count, len(motions)), replace=False)
                chosen = [motions[i] for i in rows]
                yield f"{count} of a {family}", campaign.gravity, chosen


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--measured", type=Path, action="append", default=[])
    options = parser.parse_args()
    table: dict[str, list[tuple[float, float]]] = {}
    for family, gravity, motions in sets(options.draws, options.measured):
        fall, error = _measure_fall(Motions(tuple(motions)))
        table.setdefault(family, []).append((np.log(fall / gravity), error))
    for family, found in table.items():
        known = np.array([f for f in found if f[1] < _UNKNOWN])
        if not len(known):
            print(f"{family:20} 0 of {len(found)}")
            continue
        off, error = known.T
        z = np.sort(np.abs(off / error))[::-1]
        print(
            f"{family:20} {len(known):3d} of {len(found):3d}  "
            f"off {np.sqrt(np.mean(off**2)):.3f}  std {np.median(error):.3f}  "
            f"rms z {np.sqrt(np.mean(z**2)):.2f}  largest {z[:4].round(1)}"
        )


if __name__ == "__main__":
    main()
