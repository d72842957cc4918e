"""The benchmark's truth is the library's physics, and its judgement is right."""

import functools

import numpy as np
import pytest

from benchmarks.bench_forms import (
    Planted,
    draw,
    draw_families,
    floor_of,
    taken_place,
    with_play,
)
from benchmarks.hooked_flight import EVERY, HookedGlider, hook
from benchmarks.other_forms import FAMILIES, FORMS, RIVALS
from glider.physics.effects import ADDED_MASS, DYNAMIC_STALL, EffectKind
from glider.physics.model import GliderModel
from glider.simulation.campaigns import fly_path
from glider.sysid.replay.log_space import log_space_of, sensed, vector_of
from glider.sysid.result import FoundEffect
from tests.helpers.lifelike import Capture
from tests.helpers.lifelike_flight import STEP

STEPS = 600


def hooked(kind: EffectKind, *values: float) -> EffectKind:
    """Returns an effect of the library as a hook without coefficients."""

    def bound(function):
        return function and functools.partial(given, function)

    def given(function, *arguments):
        return function(*arguments, *values)

    functions = kind.formula, kind.state_rate, kind.steady_state
    return hook("hooked", kind.adds_to, *map(bound, functions))


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        pytest.param(None, (), marks=pytest.mark.nightly),
        pytest.param(DYNAMIC_STALL, (1.2, 0.08), marks=pytest.mark.nightly),
        (ADDED_MASS, (0.02, 2e-4, -3e-4)),
    ],
    ids=["nominal", "a state", "inertia"],
)
def test_hooked_flights_are_the_librarys(kind, values):
    _, truth = draw(0, count=1)
    start, elevator = truth.start[:, :2], truth.glider.elevator[: 2 * STEPS + 1, :2]
    hooks = () if kind is None else (hooked(kind, *values),)
    poses = HookedGlider(hooks=hooks, elevator=elevator).fly(start)
    names = () if kind is None else [c.name for c in kind.coefficients]
    effects = () if kind is None else (kind(**dict(zip(names, values, strict=True))),)
    model = GliderModel(effects=effects)
    space, theta = log_space_of(model), vector_of(model)
    times = STEP * np.arange(STEPS + 1)
    for i in range(2):
        x, z, pitch, *rates = start[:, i]
        launch = np.array([x, z, pitch, elevator[0, i], *rates])
        path = np.column_stack(
            [elevator[:-2:2, i], elevator[1::2, i], elevator[2::2, i]]
        )
        rate = (path[:, 2] - path[:, 0]) / STEP
        states = fly_path(space, theta, launch, times, path, rate)
        expected = sensed(space, states, theta)[::EVERY]
        np.testing.assert_allclose(poses[:, i], expected, rtol=0.0, atol=1e-8)


@pytest.mark.nightly
def test_a_perfect_model_leaves_little_more_than_noise_in_still_air():
    campaign, truth = draw(4, count=1)
    assert not truth.air[0]
    names = [f.name for f in campaign.flights]
    assert Capture().position < floor_of(campaign, truth, names) < 0.01


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("family", "form"), [(f, n) for f, forms in FORMS.items() for n in forms]
)
def test_every_form_changes_the_flights_well_beyond_the_noise(family, form):
    _, truth = draw(0, null=True)
    drawn = FORMS[family][form](np.random.default_rng(1))
    path = truth.glider.elevator
    if family == "servo":  # The elevator itself differs, and its sensor shows it.
        assert drawn.play or drawn.servo.slew or drawn.servo.natural_frequency
        return
    plain = HookedGlider(elevator=path).fly(truth.start)
    other = HookedGlider(hooks=drawn.hooks, elevator=path).fly(truth.start)
    change = (other - plain) / (0.0004, 0.0004, 0.0025)
    assert 4.0 < np.sqrt(np.mean(change**2)) < 1500.0


def test_families_are_drawn_without_rivals_and_each_has_forms():
    assert all(FORMS[family] for family in FAMILIES)
    for seed in range(50):
        families = draw_families(np.random.default_rng(seed), "ground", 4)
        assert len(set(families)) == 4
        assert all(len(rivals & set(families)) <= 1 for rivals in RIVALS)


def test_play_holds_the_elevator_until_it_is_taken_up():
    path = np.array([[0.0], [0.03], [0.1], [0.08], [0.02]])
    followed = with_play(path, 0.02)
    np.testing.assert_allclose(followed[:, 0], [0.0, 0.01, 0.08, 0.08, 0.04])


def test_a_family_is_found_by_name_or_by_a_curve_in_its_link():
    def found(kind, *depends_on, link=""):
        return FoundEffect(
            kind=kind, coefficients={}, words="", link=link, depends_on=depends_on
        )

    ground = Planted(family="ground", form="", words="")
    assert ground.is_named_by(found("ground_effect", "z"))
    assert not ground.is_named_by(found("airspeed_dependence", "V"))
    assert ground.is_named_by(found("unexplained", "z", link="wing_force"))
    assert not ground.is_named_by(found("unexplained", "z", link="air"))
    lift = Planted(family="lift", form="", words="")
    assert not lift.is_named_by(found("unexplained", "alpha"))
    assert Planted(family="wind", form="", words="").is_named_by(
        found("unexplained", "x", link="air")
    )
    servo = Planted(family="servo", form="", words="")
    assert taken_place(found("downwash"), [lift, servo], [servo]) == "for servo"
    assert taken_place(found("camber"), [lift, servo], []) == "beside lift"
