"""The lifelike simulator is a second opinion: it must be right by itself."""

import dataclasses
import functools

import numpy as np
import pytest

from benchmarks.lifelike_oracle import oracle_predict
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.compiled.actuators import replayed_path
from glider.compiled.replay import OFFSET, log_path, roll_out
from glider.physics.effects import KINDS, NO_GAUSSIANS
from glider.physics.model import GliderModel
from glider.sysid.replay.log_space import (
    log_space_of,
    resting_states,
    sensed,
    vector_of,
)
from tests.helpers.lifelike import (
    COMMAND_RATE,
    draw_campaign,
    draw_commands,
    draw_kinds,
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

STEPS = 720
"""Of flights of 0.6 s, well beyond stall."""

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
    space, theta = log_space_of(model), vector_of(model)
    replay = space.replay(theta)
    switches = np.arange(len(commands)) / COMMAND_RATE
    fine = STEP * np.arange(STEPS + 1)
    poses = []
    for i in range(start.shape[1]):

        def path(query, i=i):
            return replayed_path(
                replay, switches, commands[:, i], query, model.parameters.servo
            )

        here, middle = path(fine), path(0.5 * (fine[1:] + fine[:-1]))
        rate = np.diff(here) / STEP
        position, velocity, pitch, pitchdot = start[:, i]
        x = np.zeros(space.num_states)
        x[:7] = (
            *(position.real, position.imag, pitch.real, here[0]),
            *(velocity.real, velocity.imag, pitchdot.real),
        )
        x[7:] = resting_states(space, 0.0, x, rate[0], theta)
        x[OFFSET] = 0.0
        along = log_path(fine, np.stack([here[:-1], middle, here[1:]], axis=1), rate)
        states = roll_out(space.flown, along, x, theta, NO_GAUSSIANS)
        poses.append(sensed(space, states, theta))
    return np.stack(poses, axis=1)


@functools.cache
def planted_flights(kind, form):
    """Returns what a form plants, and `flown` of a glider with it."""
    glider = Glider()
    planted = FORMS[kind][form](np.random.default_rng(0), glider)
    return planted, flown(glider)


@pytest.fixture(scope="module")
def nominal():
    return flown(Glider())[3]


@pytest.fixture(scope="module")
def plain():
    """The poses of these flights by the library without effects."""
    start, commands, _, _ = flown(Glider())
    return flown_by_library((), start, commands)


def test_without_effects_it_flies_as_the_library_does(nominal, plain):
    np.testing.assert_allclose(nominal, plain, atol=1e-6)


EACH_STAGE = (
    *("servo_lag", "wind", "attached_lift", "dynamic_stall", "tail_wake"),
    *("pitch_damping", "inertia", "marker_offset"),
)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(k, marks=() if k in EACH_STAGE else pytest.mark.nightly)
        for k, forms in FORMS.items()
        if "library" in forms
    ],
)
def test_the_librarys_forms_are_the_librarys(kind, plain):
    """With its coefficients the library flies the same; sensors and servo too."""
    if kind not in KINDS:
        pytest.skip(f"the library has no {kind} yet")
    (planted,), (start, commands, _, pose) = planted_flights(kind, "library")
    effect = KINDS[kind](**planted.coefficients)
    expected = flown_by_library((effect,), start, commands)
    difference = np.abs(pose - expected).max()
    assert difference < 1e-6 + 1e-4 * np.abs(pose - plain).max()


@pytest.mark.nightly
@pytest.mark.parametrize(("kind", "form"), ALL_FORMS)
def test_every_form_changes_the_flights_well_beyond_the_noise(kind, form, nominal):
    planted, (_, _, _, pose) = planted_flights(kind, form)
    assert kind in {p.name for p in planted}
    assert {p.form for p in planted} == {form}
    change = (pose - nominal) / (0.0004, 0.0004, 0.0025)
    assert 5.0 < np.sqrt(np.mean(change**2)) < 1000.0


def test_gusts_have_their_strength_and_memory(nominal):
    air = gusts(np.random.default_rng(0), 0.2, 0.1, (24000, 64))
    later = air[240:]  # 0.1 s.
    for part in (np.real, np.imag):
        assert np.std(part(air)) == pytest.approx(0.2, rel=0.05)
        kept = np.mean(part(air[:-240]) * part(later)) / np.var(part(air))
        assert kept == pytest.approx(np.exp(-1.0), abs=0.05)
    assert abs(np.mean(air.real * air.imag)) < 0.1 * 0.2**2
    moved = flown(Glider(), air=air[: 2 * STEPS + 1, :4])[3]
    assert np.abs(moved - nominal)[-1].max() > 0.01


DRAWS = (draw_campaign, turbulence_campaign, draw_throws)


@pytest.mark.nightly
@pytest.mark.parametrize("draw", DRAWS, ids=lambda draw: draw.__name__)
def test_a_seed_gives_one_campaign(draw):
    (one, truth), (same, _), (other, _) = (draw(seed, 3) for seed in (7, 7, 8))
    assert truth.air_std >= 0.0
    for a, b, c in zip(one.flights, same.flights, other.flights, strict=True):
        np.testing.assert_array_equal(a.pose, b.pose)
        assert a.pose.shape != c.pose.shape or np.any(a.pose != c.pose)


@pytest.mark.nightly
@pytest.mark.parametrize("draw", DRAWS, ids=lambda draw: draw.__name__)
def test_what_is_drawn_can_be_saved_and_read(draw, tmp_path):
    for seed in range(2):
        campaign, _ = draw(seed, 3)
        save_campaign(tmp_path / campaign.name, campaign)
        read = load_campaign(tmp_path / campaign.name)
        assert read.vehicle == campaign.vehicle
        for one, other in zip(read.flights, campaign.flights, strict=True):
            np.testing.assert_allclose(one.time, other.time, atol=1e-6)
            turns = (one.pose - other.pose)[:, 2] / (2 * np.pi)
            np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)


def test_the_log_is_the_flight_with_noise():
    """Numbers of the lifelike logs: 0.4 mm, 2.5 mrad, 5 mrad, 103 rows at 120 Hz."""
    campaign, truth = turbulence_campaign(0)
    assert truth.names == frozenset()
    every = round(1.0 / (campaign.pose_rate * STEP))
    pose = shown_pose(truth.glider, truth.motion)[::every]
    noise = np.stack([f.pose for f in campaign.flights], axis=1) - pose
    level = noise.std(axis=(0, 1))
    np.testing.assert_allclose(level, (0.0004, 0.0004, 0.0025), rtol=0.05)
    angle = np.stack([f.elevator for f in campaign.flights], axis=1)
    assert np.std(angle - truth.motion.elevator[::every]) == pytest.approx(0.005, 0.05)
    for flight in campaign.flights:
        assert len(flight.time) == 103
        switches = flight.time[1:][np.diff(flight.command) != 0]
        assert np.all(np.mod(switches + 1e-9, 1 / COMMAND_RATE) < 1 / 120)


@pytest.mark.nightly
def test_trims_differ_by_their_spread_and_the_elevator_does_not_show_it():
    _, truth = turbulence_campaign(3, 400)
    spread = truth.spreads["elevator_trim"]
    assert 0.01 < spread < 0.03
    assert np.std(truth.glider.elevator_trim) == pytest.approx(spread, rel=0.1)
    assert np.all(truth.motion.elevator[0] == 0.0)
    assert truth.wrong(["elevator_trim", "wind"]) == ("wind",)


def test_only_the_rows_that_are_broken_differ():
    whole, _ = draw_campaign(4, 24, broken=False)
    campaign, truth = draw_campaign(4, 24, broken=True)
    assert {"jumps", "frozen", "missing"} == set().union(*truth.broken.values())
    for before, after in zip(whole.flights, campaign.flights, strict=True):
        kept = np.isin(before.time, after.time)
        differ = np.any(before.pose[kept] != after.pose, axis=1)
        faults = truth.broken.get(after.name, ())
        assert np.any(~kept) == ("missing" in faults)
        assert np.mean(differ) < 0.1
        assert np.any(differ) <= bool({"jumps", "frozen"} & set(faults))


def test_kinds_are_drawn_without_rivals_and_asked_for_by_form():
    for seed in range(50):
        kinds = draw_kinds(np.random.default_rng(seed), 4)
        assert len(kinds) == len(set(kinds)) == 4
        assert all(len(rivals & set(kinds)) <= 1 for rivals in RIVALS)
    _, truth = draw_campaign(0, 1, [("servo_lag", "second_order"), "mass"])
    assert truth.names == {"servo_lag", "mass"}
    assert truth.named(["command_delay"]) == ("servo_lag",)
    assert truth.wrong(["command_delay", "mass", "unexplained"]) == ()
    assert truth.coefficients.keys() == {"mass.change"}


def test_throws_tell_little_and_show_what_was_planted():
    campaign, truth = draw_throws(2)
    assert campaign.elevator == "fixed_per_flight"
    assert campaign.vehicle.keys() == {"hinge_offset", "air_density", "gravity"}
    assert {"camber", "axial_drag", "pitch_rate_lift"} <= truth.names
    assert all(f.elevator is None and f.command is None for f in campaign.flights)
    assert np.std(truth.per_flight["elevator_trim"]) > 0.02


@pytest.mark.nightly
def test_who_knows_the_glider_foretells_its_flights():
    campaign, truth = draw_campaign(
        1, 6, [("wing_incidence", "library")], moving_air=False, broken=True
    )

    def error(truth):
        """Median over flights of the last tenth of a second's largest error [m]."""
        foretold = oracle_predict(campaign, truth)
        motion = shown_pose(truth.glider, truth.motion)
        left = [
            foretold[f.name][-12:]
            - motion[np.round(f.time[-12:] / STEP).astype(int), i]
            for i, f in enumerate(campaign.flights)
        ]
        return np.median([np.abs(x[:, :2]).max() for x in left])

    wrong = dataclasses.replace(truth.glider, wing_incidence=0.0)
    assert error(truth) < 0.02
    assert error(dataclasses.replace(truth, glider=wrong)) > 0.05
