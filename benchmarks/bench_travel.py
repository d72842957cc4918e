"""How far off is the elevator's gain that the checks find, and do they warn?

Over groups of one, three and ten flights of campaigns whose elevators turn as far as
commanded: the scatter of the gain, the largest error in standard errors, and warnings.
Then the same flights with their elevators geared by 1.3 and by 0.5: all must be found.

    python -m benchmarks.bench_travel CAMPAIGN...
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

from glider.campaign.checks.servo import measure_elevators
from glider.campaign.checks.travel import _calc_travel, check_travel
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.errors import InputError


def is_flagged(campaign: Campaign) -> bool:
    """Whether the check warns or refuses."""
    try:
        return bool(check_travel(campaign, measure_elevators(campaign, {})))
    except InputError:
        return True


def geared(campaign: Campaign, gear: float) -> Campaign:
    """The campaign with elevators that turn so many times as far."""
    turned = [
        dataclasses.replace(f, elevator=gear * f.elevator) for f in campaign.flights
    ]
    return dataclasses.replace(campaign, flights=tuple(turned))


def main(paths: list[str]) -> None:
    """Prints a line for each size of group."""
    campaigns = [load_campaign(Path(path)) for path in paths]
    for size in (1, 3, 10):
        groups = [
            dataclasses.replace(c, flights=c.flights[k : k + size])
            for c in campaigns
            if c.elevator == "servo"
            for k in range(0, len(c.flights) - size + 1, size)
        ]
        found = np.array(
            [_calc_travel(measure_elevators(group, {})) for group in groups]
        )
        off = np.abs(found[:, 0] - 1.0) / found[:, 1]
        line = f"{size:3d} flights, {len(groups):3d} groups: gain "
        line += f"{np.mean(found[:, 0]):.3f} ± {np.std(found[:, 0]):.3f}, at most "
        line += f"{np.max(off):.1f} standard errors off; flagged "
        for gear in (1.0, 1.3, 0.5):
            line += f"{sum(is_flagged(geared(g, gear)) for g in groups)} (x {gear}) "
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
