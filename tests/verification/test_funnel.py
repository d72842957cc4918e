"""A funnel: what is saved is checked, what is checked is kept by flights."""

import dataclasses
import json

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from glider.__main__ import main
from glider.control.tvlqr import compiled_policy
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects.field import FieldData
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.verification.dynamics.error_dynamics import (
    evaluate,
    expand,
)
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import (
    load_funnel,
    save_funnel,
)
from glider.verification.funnel.remainder import (
    remainder_form,
    remainder_of,
    remainder_weights,
    sample_remainder,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.monitor import FunnelMonitor
from glider.verification.proof.check import (
    BALL_BITS,
    check_funnel,
    check_time,
    exact_faults,
    growth_polynomial,
    largest_between,
)
from glider.verification.sos.exact import (
    exact,
    rounded,
)
from glider.verification.sos.forms import (
    higher_forms,
    linear_part,
    quadratic_form,
    to_ball,
)
from glider.verification.sos.sphere import sphere
from glider.verification.trials.attack import (
    attack_funnel,
    boundary_states,
    fly_inside,
)

EVERY = 50
"""Of the times that tests check exactly."""


@pytest.fixture(scope="module")
def funnel():
    """The drawn glider's, as it ships."""
    return load_funnel(models_path("funnels", "drawn.npz"))


@pytest.fixture(scope="module")
def coefficients(funnel):
    return expand(funnel.nominal)


def unit(count, n, seed=0):
    z = np.random.default_rng(seed).normal(size=(count, n))
    return z / np.linalg.norm(z, axis=1, keepdims=True)


def test_the_inlet_is_as_wide_as_promised(funnel):
    widths = funnel.half_widths()
    assert widths[1] >= 0.11
    assert np.degrees(widths[2]) >= 5.5
    assert widths[4] >= 0.22


def test_the_error_dynamics_are_the_true_ones_up_to_fourth_order(funnel, coefficients):
    direction = 0.1 * unit(5, 7) * [1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 5.0]
    k = 90
    rests = []
    for size in (1.0, 0.5):
        errors = size * direction
        rest = remainder_of(funnel.nominal, coefficients, [k], errors[None])
        rests.append(np.abs(rest).max())
    assert np.log2(rests[0] / rests[1]) == pytest.approx(4.0, abs=0.5)


def test_the_forms_are_the_growth_of_v_on_the_boundary(funnel, coefficients):
    k, z = 120, unit(20, 7)
    S, slope = funnel.S[k], funnel.slopes[k]
    back = to_ball(S)[1]
    errors = z @ back.T
    rates = evaluate(coefficients[k], errors)
    growth = np.einsum("bi,ij,bj->b", errors, slope, errors)
    growth += 2.0 * np.einsum("bi,ij,bj->b", errors, S, rates)
    quadratic = back.T @ quadratic_form(S, slope, coefficients[k]) @ back
    tables = sphere(7)
    polynomial = tables.coefficients(quadratic, *higher_forms(S, coefficients[k]))
    values = tables.values(np.broadcast_to(polynomial, (20, len(polynomial))), z)
    assert values == pytest.approx(growth, abs=1e-9)
    assert np.all(growth < 0.0)
    assert np.linalg.eigvals(linear_part(coefficients[k])).real.max() < 50.0


def test_the_remainders_form_bounds_what_it_stands_for(funnel, coefficients):
    S, z = funnel.S[[150]], unit(200, 7)
    beta = sample_remainder(funnel.nominal, coefficients, S, z, np.array([150]))
    form = remainder_form(S, beta, remainder_weights(S, beta, np.ones(7)))[0]
    upper, back = to_ball(S[0])
    errors = z @ back.T
    rest = remainder_of(funnel.nominal, coefficients, [150], errors[None])[0]
    pushed = 2.0 * np.sum((z @ upper) * rest, axis=1)
    assert np.all(pushed <= np.einsum("bi,ij,bj->b", z, form, z))
    assert np.abs(pushed).max() > 0.01


def test_the_shipped_certificate_holds(funnel):
    verdict = check_funnel(funnel, every=EVERY)
    assert verdict.holds, verdict.faults
    assert verdict.times >= 4
    assert verdict.between < 0.0
    assert verdict.rounding < 1e-3


def test_the_exact_polynomial_is_the_growth_with_the_disturbance(funnel, coefficients):
    k, slack = 150, 0.25
    S, slope = funnel.S[k], funnel.slopes[k]
    rng = np.random.default_rng(0)
    beta, weights = rng.uniform(0.1, 1.0, 7), rng.uniform(0.1, 1.0, 7)
    back = to_ball(S)[1]
    polynomial, metric = growth_polynomial(
        exact(S),
        exact(slope),
        coefficients[k],
        rounded(back, BALL_BITS),
        beta,
        weights,
        exact(slack),
    )
    assert metric.to_float() == pytest.approx(np.eye(7), abs=1e-5)
    quadratic = back.T @ quadratic_form(S, slope, coefficients[k]) @ back
    quadratic += remainder_form(S[None], beta[None], weights[None])[0]
    quadratic += slack * np.eye(7)
    expected = sphere(7).coefficients(quadratic, *higher_forms(S, coefficients[k]))
    assert polynomial.to_float() == pytest.approx(-expected, rel=1e-5, abs=1e-3)


def lighter(funnel):
    parameters = GliderParameters(mass=0.07)
    return dataclasses.replace(funnel.nominal, model=GliderModel(parameters=parameters))


def weaker(funnel):
    parameters = GliderParameters(elevator_limits=[-0.3, 0.8])
    return dataclasses.replace(funnel.nominal, model=GliderModel(parameters=parameters))


CORRUPTIONS = {
    "a wider set": (lambda f: {"S": 0.9 * f.S}, "proves nothing"),
    "a narrower set": (lambda f: {"slopes": 1.2 * f.slopes}, "proves nothing"),
    "random Gram matrices": (
        lambda f: {"grams": f.grams[:, ::-1].copy()},
        "proves nothing",
    ),
    "a larger disturbance": (
        lambda f: {"beta": f.beta + 0.5, "weights": f.weights + 0.5},
        "proves nothing",
    ),
    "weights that divide by zero": (
        lambda f: {"beta": f.beta + 0.5},
        "proves nothing",
    ),
    "no ellipsoid": (lambda f: {"S": -f.S}, "no ellipsoid"),
    "a larger goal set": (lambda f: {"S": f.S / 1.01}, "goal"),
    "a servo of less travel": (lambda f: {"nominal": weaker(f)}, "servo"),
    "another glider": (lambda f: {"nominal": lighter(f)}, "proves nothing"),
}


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corrupted_funnel_fails_the_check(name, funnel):
    change, words = CORRUPTIONS[name]
    changed = dataclasses.replace(funnel, **change(funnel))
    faults, _ = exact_faults(changed, [100])
    assert words in " ".join(faults)


def test_a_check_is_of_the_nominal_and_between_the_times_too(funnel):
    changed = dataclasses.replace(funnel, nominal=lighter(funnel))
    assert "no flight" in " ".join(check_funnel(changed, every=1000).faults)
    assert largest_between(dataclasses.replace(funnel, S=0.8 * funnel.S), 20) > 0.0


def test_one_wrong_number_in_one_gram_matrix_fails_its_time(funnel, coefficients):
    assert check_time(funnel, coefficients[7], 7, 0.003)[0]
    grams = funnel.grams.copy()
    grams[7, 0] -= 200.0
    wrong = dataclasses.replace(funnel, grams=grams)
    assert not check_time(wrong, coefficients[7], 7, 0.003)[0]


def test_no_flight_from_the_boundary_leaves_the_funnel(funnel):
    attack = attack_funnel(funnel, 400, np.random.default_rng(0))
    assert attack.samples > 400
    assert attack.escapes == 0
    assert attack.levels.max() <= 1.0 + 1e-6
    assert attack.ends.max() < 1.0


def test_flights_leave_a_funnel_that_promises_too_much(funnel):
    """Three times as wide, it asks for more than the servo can do."""
    wide = dataclasses.replace(funnel, S=funnel.S / 9.0, slopes=funnel.slopes / 9.0)
    attack = attack_funnel(wide, 400, np.random.default_rng(0), climb=False)
    assert attack.escapes > 20


def test_without_the_servos_limits_in_it_a_funnel_does_not_hold():
    """It was made for a servo of wider travel and a higher rate."""
    funnel = load_funnel(models_path("funnels", "strong_servo.npz"))
    shares = (0.37, 0.5)
    own = attack_funnel(funnel, 200, np.random.default_rng(0), shares=shares)
    assert own.escapes == 0
    drawn = GliderModel()
    real = attack_funnel(
        funnel, 200, np.random.default_rng(0), shares=shares, model=drawn
    )
    assert real.escapes > 0.05 * real.samples
    with_drawn = dataclasses.replace(funnel.nominal, model=drawn)
    faults, _ = exact_faults(dataclasses.replace(funnel, nominal=with_drawn), [100])
    assert any("servo" in fault for fault in faults)


def test_climbing_finds_worse_flights_than_chance(funnel):
    rng = np.random.default_rng(1)
    climbed = attack_funnel(funnel, 200, rng, shares=(0.75,))
    chance = attack_funnel(funnel, climbed.samples, rng, shares=(0.75,), climb=False)
    assert climbed.ends.max() > 1.01 * chance.ends.max()


def test_flights_from_inside_end_in_the_goal(funnel):
    paths = fly_inside(funnel, 20, np.random.default_rng(2))
    levels = funnel.level(funnel.nominal.times, paths)
    assert np.all(levels <= 1.0)
    goal = np.array(funnel.settings.goal)
    ends = paths[:, -1] - funnel.nominal.states[-1]
    assert np.all(np.sum((ends / goal) ** 2, axis=1) <= 1.0)


def test_boundary_states_are_on_the_boundary(funnel):
    states = boundary_states(funnel, 40, unit(10, 7))
    assert funnel.level(funnel.nominal.times[40], states) == pytest.approx(1.0)


def test_a_funnel_is_saved_and_loaded(funnel, tmp_path):
    path = tmp_path / "funnel.npz"
    save_funnel(path, funnel)
    again = load_funnel(path)
    assert np.array_equal(again.S, funnel.S)
    assert np.array_equal(again.grams, funnel.grams)
    assert again.settings == funnel.settings
    assert again.nominal.model == funnel.nominal.model


def test_what_is_no_funnel_is_an_input_error(funnel, tmp_path):
    path = tmp_path / "funnel.npz"
    path.write_text("no")
    with pytest.raises(InputError, match="not a funnel"):
        load_funnel(path)
    save_funnel(path, dataclasses.replace(funnel, S=funnel.S[:-1]))
    with pytest.raises(InputError, match="'S' has shape"):
        load_funnel(path)
    gust = FieldData(
        variables=("t",), centers=[[0.5]], widths=[0.1], weights={"wind_z": [3.0]}
    )
    model = GliderModel(field=gust)
    save_funnel(
        path,
        dataclasses.replace(
            funnel, nominal=dataclasses.replace(funnel.nominal, model=model)
        ),
    )
    with pytest.raises(InputError, match="vary with time"):
        load_funnel(path)
    with pytest.raises(InputError, match="goal"):
        FunnelSettings(goal=(1.0, 2.0))
    with pytest.raises(InputError, match="margin"):
        FunnelSettings(margin=0.0)


def test_the_command_line_checks_a_file(funnel, tmp_path, capsys):
    path = tmp_path / "funnel.npz"
    save_funnel(path, funnel)
    assert main(["check-funnel", str(path), "--every", "1000"]) == 0
    assert "holds" in capsys.readouterr().out
    save_funnel(path, dataclasses.replace(funnel, S=0.9 * funnel.S))
    assert main(["check-funnel", str(path), "--every", "1000", "--json"]) == 1
    out = capsys.readouterr()
    assert json.loads(out.out)["holds"] is False
    assert json.loads(out.out)["remainder"] == "none"
    save_funnel(path, dataclasses.replace(funnel, S=-funnel.S))
    assert main(["check-funnel", str(path), "--every", "1000", "--prove"]) == 1
    assert "no ellipsoid" in capsys.readouterr().out
    path.write_text("no")
    assert main(["check-funnel", str(path)]) == 2
    assert "not a funnel" in capsys.readouterr().err


def test_the_command_line_proves_the_remainder(tmp_path, capsys):
    proven = load_funnel(models_path("funnels", "proven", "drawn.npz"))
    path, end = tmp_path / "funnel.npz", f"{proven.nominal.times[-1]:.4f}"
    save_funnel(path, proven)
    few = ["check-funnel", str(path), "--every", "1000", "--prove"]
    assert main([*few, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["remainder"] == f"rigorous until t={end} at 2 of 201 times"
    assert found["boxes"] > 1000
    beta = proven.beta.copy()
    beta[-1] *= 0.8
    save_funnel(path, dataclasses.replace(proven, beta=beta))
    assert main(few) == 1
    words = capsys.readouterr().out
    assert "The certificate holds" in words
    assert "proven until 0.0000 s, and at 1 of 2 times" in words


def test_the_monitor_tells_inside_from_outside_in_a_diagram(funnel):
    k = 60
    center = funnel.nominal.states[k]
    step = boundary_states(funnel, k, unit(1, 7))[0] - center
    for share, inside in ((0.0, 1.0), (0.9, 1.0), (1.1, 0.0)):
        builder = DiagramBuilder()
        source = builder.AddSystem(ConstantVectorSource(center + share * step))
        monitor = builder.AddSystem(FunnelMonitor(funnel))
        builder.Connect(source.get_output_port(), monitor.get_input_port())
        diagram = builder.Build()
        context = diagram.CreateDefaultContext()
        context.SetTime(funnel.nominal.times[k])
        here = monitor.GetMyContextFromRoot(context)
        assert monitor.GetOutputPort("inside").Eval(here)[0] == inside
        margin = monitor.GetOutputPort("margin").Eval(here)[0]
        assert margin == pytest.approx(1.0 - share, abs=1e-6)


@pytest.fixture(scope="module")
def short(article_plan):
    """A funnel over the last tenth of the flight, made from nothing."""
    plan = article_plan
    arrays = {name: getattr(plan, name)[36:] for name in ("states", "slopes", "inputs")}
    plan = dataclasses.replace(plan, times=plan.times[36:] - plan.times[36], **arrays)
    policy = compiled_policy(GliderModel(), plan)
    settings = FunnelSettings(step=0.011, hold=0.044, remainder=0.5, margin=0.1)
    return make_funnel(GliderModel(), policy, settings)


def test_a_funnel_is_made_from_a_feedback(short):
    verdict = check_funnel(short, every=4)
    assert verdict.holds, verdict.faults
    assert short.beta[:, 4:].max() > 0.0
    attack = attack_funnel(short, 200, np.random.default_rng(0))
    assert attack.escapes == 0
