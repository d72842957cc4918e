"""What a set of effects leaves free, and what it is worth, whatever acts already."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood import candidates as gathering
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.candidates import gather, gather_in_parts, saturated
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import Task
from tests.helpers.searches import gain_of
from tests.helpers.tasks import begin, fly, task_of


@pytest.fixture(scope="module")
def dragged():
    """A little drag, and the model that has been fitted to it."""
    task, noise = task_of(fly(KINDS["profile_drag"](cd0=0.01), flights=4))
    few = ("profile_drag", "axial_drag", "attached_lift", "servo_lag")
    task = dataclasses.replace(task, kinds=few)
    plate = fit_model(task, begin(task, noise))
    return task, plate, fit_model(task, begin(task, noise, ["profile_drag"]))


@pytest.mark.parametrize("is_known", [True, False], ids=["known", "unknown"])
def test_a_shifted_center_of_pressure_is_one_with_an_unknown_wing_offset(is_known):
    campaign = fly(flights=2, duration=0.2)
    if not is_known:
        known = {k: v for k, v in campaign.vehicle.items() if k != "wing_offset"}
        campaign = dataclasses.replace(campaign, vehicle=known)
    task, _ = task_of(campaign)
    index, slots_of = task.space.index, task.space.slots_of
    free = set(task.free(("center_of_pressure", "profile_drag")))
    everything = {*slots_of("center_of_pressure"), *slots_of("profile_drag")}
    everything |= {*task.vehicle.of_log}
    shift = {index["center_of_pressure.shift"]}
    if is_known:
        assert free == everything
    else:
        assert free == (everything - shift) | set(task.vehicle.nuisance)
        assert index["wing_offset"] in free


def test_each_starting_shape_is_a_variant(dragged):
    task, plate, _ = dragged
    candidates = gather(task.offering(task.kinds), plate)
    counts = {kind: len(own) for kind, own in candidates.variants.items()}
    shapes = [c.grid for c in KINDS["attached_lift"].coefficients if c.is_shape]
    assert counts["profile_drag"] == 1
    assert counts["axial_drag"] == len(KINDS["axial_drag"].coefficients[1].grid)
    assert counts["attached_lift"] == np.prod([len(grid) for grid in shapes])
    assert counts["servo_lag"] == len(KINDS["servo_lag"].coefficients[0].grid)
    columns = [c for own in candidates.variants.values() for v in own for c in v]
    clocks = len(task.vehicle.of_log)
    assert sorted(columns) == list(range(clocks, len(candidates.directions)))


def test_an_effect_is_worth_the_same_whether_it_acts_or_not(dragged):
    """Linear about the plate, or about the model with it, counted from nothing."""
    task, plate, model = dragged
    gains = []
    for about in (saturated(gather(task, plate), 3), model):
        candidates = gather(task, about)
        gram = candidates.grams(model.scales).sum(axis=0)
        evidence = candidates.evidence(gram)
        (drag,) = candidates.variants["profile_drag"]
        gains.append((gain_of(evidence, drag), evidence.step(drag)[0]))
    (before, step), (after, again) = gains
    assert before > 50.0
    assert after == pytest.approx(before, rel=0.2)
    assert step == pytest.approx(0.01, rel=0.1)
    assert again == pytest.approx(0.01, rel=0.05)


def test_a_formula_far_outside_of_what_it_is_for_is_no_candidate():
    """Flights deep below a ground that ground_effect takes to be at zero."""
    campaign = fly(flights=2, duration=0.4)
    flights = tuple(
        dataclasses.replace(f, pose=f.pose - [0.0, 60.0, 0.0]) for f in campaign.flights
    )
    task, noise = task_of(dataclasses.replace(campaign, flights=flights))
    candidates = gather(task, begin(task, noise))
    assert "ground_effect" in task.kinds
    assert "ground_effect" not in candidates.variants
    assert {"wind", "profile_drag"} <= set(candidates.variants)
    assert np.all(np.isfinite(candidates.grams(candidates.model.scales)))


def test_what_a_model_lacks_is_not_taken_for_noise(dragged):
    task, plate, model = dragged
    scales = saturated(gather(task, plate), 3).scales
    assert plate.scales.air > 5.0 * model.scales.air
    assert scales.air < 0.3 * plate.scales.air


def test_a_set_whose_shape_stays_at_its_bound_is_physical(monkeypatch):
    """Flights ask for more than is possible; the effect is there all the same."""
    stall = KINDS["attached_lift"](slope=2.0, stall_angle=0.3)
    task, noise = task_of(fly(stall, flights=4))
    task = dataclasses.replace(task, kinds=("attached_lift", "profile_drag"))
    slot, bounds = task.space.index["attached_lift.stall_angle"], Task.bounds

    def narrow(task, slots):
        lower, upper = bounds(task, slots)
        return lower, np.where(np.array(slots) == slot, 0.2, upper)

    monkeypatch.setattr(Task, "bounds", narrow)
    model = fit_model(task, begin(task, noise, ["attached_lift"]))
    assert model.theta[slot] == 0.2
    candidates = gather(task, model)
    evidence = candidates.evidence(candidates.total(model.scales))
    [own] = candidates.variants["attached_lift"]
    assert slot not in [candidates.slots[j] for j in own]
    assert gain_of(evidence, own) > 100.0


def test_an_effect_that_ends_at_none_stays_in_its_set(dragged):
    """A drag cannot be negative: the set has it, without a column."""
    task, _, model = dragged
    theta = model.theta.copy()
    theta[list(task.space.slots_of("profile_drag"))] = 0.0
    candidates = gather(task, dataclasses.replace(model, theta=theta))
    assert candidates.variants["profile_drag"] == ((),)
    evidence = candidates.evidence(candidates.total(model.scales))
    assert gain_of(evidence, ()) == 0.0


def test_flights_may_be_gathered_in_parts(dragged, monkeypatch):
    """What diverges on a flight of any part is offered by none."""
    task, _, model = dragged
    monkeypatch.setattr(gathering, "_IN_PART", 3)
    monkeypatch.setattr(gathering, "_LARGEST_PUSH", np.inf)
    whole = gather(task.offering(task.kinds), model)
    flights = model_fit.linear_flights(task, model, whole.directions)
    scale = task.space.scale[whole.slots]
    pushes = [
        (np.abs(f.inputs[:, :, :-1]).max(axis=(0, 1)) * scale).max() for f in flights
    ]
    order = np.argsort(pushes)  # The wildest alone, in the last part.
    task = task.on([task.records[i] for i in order]).offering(task.kinds)
    most = 0.5 * sum(pushes[i] for i in order[-2:])
    monkeypatch.setattr(gathering, "_LARGEST_PUSH", most)
    whole = gather(task, model)
    parts, grams = gather_in_parts(task, model, model.scales)
    assert parts.variants == whole.variants
    assert parts.task.records is task.records
    used = sorted({c for own in whole.variants.values() for v in own for c in v})
    places = np.ix_(range(len(grams)), [*used, -1], [*used, -1])
    np.testing.assert_allclose(grams[places], whole.grams(model.scales)[places])
