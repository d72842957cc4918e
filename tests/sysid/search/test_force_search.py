"""Gliders of which little is known: names from forces along the measured attitude."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import LIBRARY
from glider.progress import silent
from glider.sysid.constants import HELD_OUT_THRESHOLD
from glider.sysid.replay.replayed import trimmed
from glider.sysid.search.moves import Search
from glider.sysid.search.subsets import _held_out_threshold
from glider.sysid.search.tracing import _OF_FORCES, trace
from tests.helpers.lifelike import draw_throws
from tests.helpers.tasks import task_of


@pytest.fixture(scope="module")
def throws():
    """Throws of camber, axial drag and lift by pitch rate, in the library's forms."""
    campaign, truth = draw_throws(0)
    return *task_of(campaign), truth


COMMON = tuple(kind.kind for kind in LIBRARY if kind.is_common)
FEW = (*COMMON, "pitch_moment", "pitch_damping", "downwash", "frame_tilt")


@pytest.fixture(scope="module", params=["few", "all"])
def traced(throws, request):
    """Traced among few kinds, or all."""
    task, noise, truth = throws
    if request.param == "few":
        few = tuple(kind for kind in task.kinds if kind in FEW)
        task = dataclasses.replace(task, kinds=few)
    return task, trace(Search(task, silent), noise), truth


@pytest.mark.nightly
def test_what_every_throw_has_is_named(traced):
    _, found, truth = traced
    assert set(truth.named(found.model.kinds)) == {e.name for e in truth.effects}
    assert truth.wrong(found.model.kinds) == ()
    least = HELD_OUT_THRESHOLD["effect"]
    assert all(found.evidence[kind] > least for kind in found.model.kinds)


@pytest.mark.nightly
def test_the_moment_leaves_the_forces_and_the_flights_axes_alone(traced):
    task, found, _ = traced
    forces, model = found.forces, found.model
    assert forces.has_force_errors and not model.has_force_errors
    moved = np.flatnonzero(forces.theta != model.theta)
    names = {task.space.names[i] for i in moved}
    assert "pitch_inertia" in names
    assert names <= {
        "pitch_inertia",
        "servo_log.commands",
        "servo_log.drift",
        "servo_log.poses",
        "wing_offset",
        "pitch_moment.coefficient",
        "pitch_damping.coefficient",
    }
    for name in _OF_FORCES:
        assert getattr(model.scales, name) == getattr(forces.scales, name)


def test_an_effect_that_needs_a_cause_costs_more(throws):
    task, *_ = throws
    least, further, uncommon = HELD_OUT_THRESHOLD.values()
    assert _held_out_threshold(task, "camber", ()) == least
    assert _held_out_threshold(task, "thrust", ()) == least + uncommon
    rare = _held_out_threshold(task, "marker_offset", ())
    assert rare == least + further + uncommon


def test_an_unknown_tails_trim_is_a_moment_alone(throws):
    task, *_ = throws
    record, theta = task.records[0], task.vehicle.theta
    moved, elevator = trimmed(record, theta, 0.1)
    assert record.trim_is_moment and elevator == 0.0
    index = task.space.index
    changed = np.flatnonzero(moved != theta)
    assert changed.tolist() == [index["pitch_moment.coefficient"]]
    assert moved[changed[0]] < theta[changed[0]]  # Trailing edge up lifts the nose.
    told = dataclasses.replace(record, trim_is_moment=False)
    same, elevator = trimmed(told, theta, 0.1)
    assert same is theta and elevator == 0.1


def test_effects_that_cannot_be_told_from_an_unknown_wing_are_not_asked_for(throws):
    task, *_ = throws
    hidden = {"added_mass", "wind", "wind_shear", "marker_offset", "pitch_damping"}
    assert hidden.isdisjoint(task.kinds)
    assert not task.vehicle.knows_forces
