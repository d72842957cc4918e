"""Funnels of one loop at any phase are made, by Drake's solvers."""

import numpy as np
import pytest

from glider.errors import InputError
from glider.planning.problem import PerchingProblem
from glider.verification import phases
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof.phases import phase_faults
from tests.verification.test_phases import FOLDER, RESTS, scaled


@pytest.mark.nightly
def test_phases_are_made_one_after_the_other(monkeypatch):
    """The launch funnel is as large as fits; those of the phases start as shipped."""
    launch, rests = load_funnel(FOLDER / "launch.npz"), [*map(load_funnel, RESTS)]
    problem, model = PerchingProblem.load("perching_hook"), launch.nominal.model
    waiting, launches, made = iter(rests), [], phases.make_funnel

    def make(model, policy, settings, **given):
        assert given["confidence"] is launch.allowed
        is_launch = policy is not None
        return made(model, policy, settings, **given) if is_launch else next(waiting)

    monkeypatch.setattr(phases, "make_funnel", make)
    first, found = phases.make_phases(
        model,
        lambda problem: launches.append(problem.launch),
        problem,
        rests[0].settings,
        latency=0.01,
        confidence=launch.allowed,
    )
    assert found == rests
    starts = [own.nominal.states[0] for own in rests]
    assert np.array(launches) == pytest.approx(np.array(starts), abs=1e-6)
    assert phase_faults(first, rests, problem) == []
    assert phase_faults(scaled(first, 1.06), rests)
    assert first.half_widths() == pytest.approx(launch.half_widths(), rel=0.02)
    with pytest.raises(InputError, match="'period' is 0"):
        phases.make_phases(model, lambda p: None, problem, launch.settings, latency=0.0)
