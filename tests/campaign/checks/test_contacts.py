"""A flight ends before it touches something: the wire, a hand or the floor."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.checks.rows import find_faults
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.track import Track
from glider.campaign.reader import load_campaign
from tests.campaign.importing import foreign
from tests.helpers.campaigns import campaign_path

NOISE = (4e-4, 4e-4, 2.5e-3)


def touching(flight, rng, rows, slide=0.0):
    """A flight that is stopped between two rows; then `rows` at rest, or sliding.

    Returns the flight, and its last row in the air.
    """
    last = int(rng.integers(60, len(flight.time) - 2))
    step = float(np.median(np.diff(flight.time)))
    share = rng.uniform()
    way = flight.pose[last + 1] - flight.pose[last]
    speed = 0.7 * way[0] / step
    since = (np.arange(1, rows + 1) - share) * step
    since = np.minimum(since, speed / slide if slide else 0.0)
    after = np.tile(flight.pose[last] + share * way, (rows, 1))
    after[:, 0] += speed * since - 0.5 * slide * since**2
    pose = np.concatenate(
        [flight.pose[: last + 1], after + rng.normal(size=after.shape) * NOISE]
    )

    def held(values):
        return np.concatenate([values[: last + 1], np.repeat(values[last], rows)])

    stopped = dataclasses.replace(
        flight,
        time=flight.time[0] + np.arange(len(pose)) * step,
        pose=pose,
        elevator=held(flight.elevator),
        command=held(flight.command),
    )
    return stopped, last


@pytest.fixture(scope="module")
def campaign():
    return load_campaign(campaign_path("attached_lift"))


@pytest.mark.parametrize("rows", [1, 2, 3, 4, 6, 12, 20])
def test_no_row_after_a_stop_counts(campaign, rows):
    rng = np.random.default_rng(rows)
    stopped, last = zip(
        *(touching(f, rng, rows) for f in campaign.flights), strict=True
    )
    faults = find_faults(dataclasses.replace(campaign, flights=stopped))
    for flight, row in zip(stopped, last, strict=True):
        mask = faults.masks[flight.name].pose
        assert mask[row + 1 :].all()
        assert mask[: row + 1].sum() <= 8
    assert sum(m.pose.sum() for m in faults.masks.values()) < (rows + 3) * len(stopped)


@pytest.mark.parametrize(("slide", "least"), [(0.0, 1.0), (8.0, 0.85)])
def test_a_recording_is_cut_before_a_stop_or_a_slide(campaign, slide, least):
    rng = np.random.default_rng(7)
    before = []
    for flight in campaign.flights:
        stopped, last = touching(flight, rng, 120, slide)
        x, z, pitch = stopped.pose.T
        track = Track(
            path=Path("take.csv"),
            time=stopped.time,
            position=np.column_stack([x, 0.0 * x, z]),
            rotation=foreign.planar_rotation(pitch),
            spatial=False,
        )
        [found], _ = cut(track, 9.81)
        before.append(stopped.time[last] - found.time[-1])
    assert np.mean(np.array(before) > 0.04) >= least
    assert np.max(before) < 0.15
