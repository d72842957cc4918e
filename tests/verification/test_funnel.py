"""A funnel is made, saved, loaded, and used in a diagram."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from glider.control.tvlqr import tracking_policy
from glider.errors import InputError
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.systems.funnel_monitor import FunnelMonitor
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import load_funnel, save_funnel
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof.check import check_funnel
from glider.verification.proof.purpose import hook_faults
from glider.verification.trials import ESCAPE_LEVEL, boundary_states, falsify_funnel
from tests.verification.points import sphere_points


def test_the_inlet_is_as_wide_as_promised(funnel):
    widths = funnel.half_widths()
    assert widths[1] >= 0.11
    assert np.degrees(widths[2]) >= 5.5
    assert widths[4] >= 0.22


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
    gust = FreeFunction(
        variables=("t",), centers=[[0.5]], widths=[0.1], weights={"wind_z": [3.0]}
    )
    model = GliderModel(free_functions=(gust,))
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


def test_the_monitor_tells_inside_from_outside_in_a_diagram(funnel):
    k = 60
    center = funnel.nominal.states[k]
    step = boundary_states(funnel, k, sphere_points(1, 7))[0] - center
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
    policy = tracking_policy(GliderModel(), plan)
    settings = FunnelSettings(step=0.011, hold=0.044, remainder=1.1, margin=0.1)
    return make_funnel(GliderModel(), policy, settings, hook_of=PerchingProblem())


@pytest.mark.nightly
def test_a_funnel_is_made_for_the_hook(short):
    assert hook_faults(short, PerchingProblem()) == []
    assert short.settings.goal[3] == FunnelSettings().goal[3]


def test_a_funnel_is_made_from_a_feedback(short):
    verdict = check_funnel(short, every=4)
    assert verdict.holds, verdict.faults
    assert short.beta[:, 4:].max() > 0.0
    levels = falsify_funnel(short, 200, np.random.default_rng(0))
    assert levels.max() <= ESCAPE_LEVEL
