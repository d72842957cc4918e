"""The lifelike simulator is a second opinion: it must be right by itself."""

import copy

import numpy as np
import pytest

from glider.compiled.replay import roll_out
from glider.physics.effects import KINDS, NO_FIELD
from glider.physics.model import GliderModel
from glider.sysid.fit.simulate import layout_for, theta_of
from glider.sysid.replay.nodes import sensed
from glider.sysid.replay.signals import replayed_path
from glider.sysid.replay.theta import OFFSET
from tests.helpers.lifelike import (
    COMMAND_RATE,
    draw_campaign,
    draw_commands,
    draw_starts,
    draw_throws,
    turbulence_campaign,
)
from tests.helpers.lifelike_flight import (
    STEP,
    Glider,
    elevator_paths,
    fly,
    gusts,
    shown_pose,
)
from tests.helpers.lifelike_forms import FORMS, RIVALS

STEPS = 1020
"""Of a flight of 0.85 s."""

ALL_FORMS = [(kind, form) for kind, forms in FORMS.items() for form in forms]


def flown(glider, flights=4, seed=5, air=None):
    """Returns launches, commands, the flights' Motion and the poses shown."""
    rng = np.random.default_rng(seed)
    start, commands = draw_starts(rng, flights), draw_commands(rng, flights)
    elevator = elevator_paths(
        glider.servo, commands, 1 / COMMAND_RATE, 2 * STEPS, glider.elevator_limits
    )
    motion = fly(glider, start, elevator, air)
    return start, commands, motion, shown_pose(glider, motion)


def flown_by_library(effects, start, commands):
    """Returns the poses shown (K + 1, F, 3) of the same flights by the library."""
    model = GliderModel(effects=effects)
    layout, theta = layout_for(model), theta_of(model)
    replay = layout.replay(theta)
    switches = np.arange(len(commands)) / COMMAND_RATE
    fine = STEP * np.arange(STEPS + 1)
    poses = []
    for i in range(start.shape[1]):

        def path(query, i=i):
            return replayed_path(
                replay,
                switches,
                commands[:, i],
                query,
                limits=model.parameters.elevator_limits,
            )

        here, middle = path(fine), path(0.5 * (fine[1:] + fine[:-1]))
        rate = np.diff(here) / STEP
        position, velocity, pitch, pitchdot = start[:, i]
        x = np.zeros(layout.num_states)
        x[:7] = (
            *(position.real, position.imag, pitch.real, here[0]),
            *(velocity.real, velocity.imag, pitchdot.real),
        )
        x[7:] = layout.steady_states(0.0, x, rate[0], theta)
        x[OFFSET] = 0.0
        states = roll_out(
            layout.compiled_kinds,
            fine,
            x,
            np.stack([here[:-1], middle, here[1:]], axis=1),
            rate,
            layout.dynamics(theta),
            NO_FIELD,
        )
        poses.append(sensed(layout, states, theta))
    return np.stack(poses, axis=1)


def test_without_effects_it_flies_as_the_library_does():
    start, commands, _, pose = flown(Glider())
    np.testing.assert_allclose(pose, flown_by_library((), start, commands), atol=1e-6)


@pytest.mark.parametrize(
    "kind", [k for k, forms in FORMS.items() if "library" in forms]
)
def test_the_librarys_forms_are_the_librarys(kind):
    """With its coefficients the library flies the same; sensors and servo too."""
    if kind not in KINDS:
        pytest.skip(f"the library has no {kind} yet")
    glider = Glider()
    (planted,) = FORMS[kind]["library"](np.random.default_rng(1), glider)
    start, commands, _, pose = flown(glider)
    effect = KINDS[kind](**planted.coefficients)
    expected = flown_by_library((effect,), start, commands)
    nothing = flown_by_library((), start, commands)
    difference = np.abs(pose - expected).max()
    assert difference < 1e-6 + 1e-4 * np.abs(pose - nothing).max()


@pytest.mark.parametrize(("kind", "form"), ALL_FORMS, ids="-".join)
def test_every_form_changes_the_flights_well_beyond_the_noise(kind, form):
    _, _, _, nominal = flown(Glider())
    for seed in range(3):
        glider = Glider()
        planted = FORMS[kind][form](np.random.default_rng(seed), glider)
        assert kind in {p.name for p in planted}
        assert {p.form for p in planted} == {form}
        change = np.linalg.norm((flown(glider)[3] - nominal)[..., :2], axis=2)
        assert 0.01 < np.sqrt(np.mean(change**2)) < 2.0
