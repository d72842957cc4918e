"""Flights left out in turn, in closed form, are flights left out."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.held_out import HeldOutEvidence
from glider.sysid.likelihood.model_fit import prior_of
from tests.helpers.searches import gain_of
from tests.helpers.tasks import begin, fly, task_of

OFFERED = ("profile_drag", "camber", "pitch_rate_lift")


@pytest.fixture(scope="module")
def dragged():
    """Candidates and what five flights with drag and camber tell of them."""
    effects = KINDS["profile_drag"](cd0=0.05), KINDS["camber"](zero_lift_angle=-0.03)
    campaign = fly(*effects, flights=5, duration=0.5)
    known = {k: v for k, v in campaign.vehicle.items() if k != "wing_area"}
    task, noise = task_of(dataclasses.replace(campaign, vehicle=known))
    task = dataclasses.replace(task, kinds=OFFERED, functions={})
    model = begin(task, noise)
    candidates = gather(task, model)
    return candidates, candidates.grams(model.scales)


def cost_without(candidates, grams, left_out, columns):
    """Returns a flight's cost with columns fitted to the others, one by one."""
    task, model = candidates.task, candidates.model
    slots = candidates.slots
    rest = sum(g for i, g in enumerate(grams) if i != left_out)
    total = prior_of(task, model, slots).added_to(rest)
    some = [*candidates.always, *columns]
    change = np.zeros(len(slots))
    change[some] = np.linalg.solve(total[np.ix_(some, some)], total[some, -1])
    weights = np.append(-change, 1.0)
    return 0.5 * weights @ grams[left_out] @ weights


def columns_of(candidates, kind):
    return list(candidates.variants[kind][0])


@pytest.mark.parametrize("kinds", [("profile_drag",), ("camber", "profile_drag")])
def test_the_gain_is_that_of_leaving_out_flights_one_by_one(dragged, kinds):
    candidates, grams = dragged
    evidence = HeldOutEvidence(candidates, grams)
    told = candidates.variants
    gain = gain_of(evidence, [c for kind in kinds for c in told[kind][0]])
    columns = [c for kind in kinds for c in columns_of(candidates, kind)]
    wanted = sum(
        cost_without(candidates, grams, i, [])
        - cost_without(candidates, grams, i, columns)
        for i in range(len(grams))
    )
    assert gain == pytest.approx(wanted, rel=1e-6)
    assert gain > 20.0
    assert gain_of(evidence, []) == 0.0


def test_what_is_not_there_gains_nothing(dragged):
    candidates, grams = dragged
    evidence = HeldOutEvidence(candidates, grams)
    told = {k: list(v[0]) for k, v in candidates.variants.items()}
    both = told["profile_drag"] + told["camber"]
    more = gain_of(evidence, both + told["pitch_rate_lift"])
    assert more - gain_of(evidence, both) < 3.0


def test_coefficients_count_from_nothing(dragged):
    candidates, grams = dragged
    evidence = HeldOutEvidence(candidates, grams)
    told = candidates.variants
    columns = [told["profile_drag"][0][0], told["camber"][0][0]]
    assert evidence.step(columns) == pytest.approx([0.05, -0.03], rel=0.1)


def test_a_coefficient_beyond_its_bounds_is_no_effect():
    """Drag cannot push."""
    campaign = fly(KINDS["thrust"](force=0.1), flights=4, duration=0.5)
    task, noise = task_of(campaign)
    task = task.offering(("profile_drag", "thrust"))
    model = begin(task, noise)
    candidates = gather(task, model)
    grams = candidates.grams(model.scales)
    evidence = HeldOutEvidence(candidates, grams)
    told = candidates.variants
    assert gain_of(evidence, told["profile_drag"][0]) == -np.inf
    assert gain_of(evidence, told["thrust"][0]) > 20.0
