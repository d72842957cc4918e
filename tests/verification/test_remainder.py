"""The Taylor remainder is what is left, and its form bounds it."""

import numpy as np
import pytest

from glider.paths import models_path
from glider.verification.funnel import shape_flow
from glider.verification.funnel.funnel import load_funnel
from glider.verification.funnel.remainder import (
    find_focus,
    remainder_weights,
    sample_remainder,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.forms import to_ball
from tests.verification.points import forms_of, remainder_of_one, sphere_points


def test_the_error_dynamics_are_the_true_ones_up_to_fourth_order(funnel):
    direction = 0.1 * sphere_points(5, 7) * [1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 5.0]
    k = 90
    largest = []
    for size in (1.0, 0.5):
        errors = size * direction
        remainder = remainder_of_one(funnel.nominal, [k], errors[None])
        largest.append(np.abs(remainder).max())
    assert np.log2(largest[0] / largest[1]) == pytest.approx(4.0, abs=0.5)


def test_the_remainders_form_bounds_what_it_stands_for(funnel):
    S, z = funnel.S[[150]], sphere_points(200, 7)
    beta = sample_remainder(funnel.nominal, S, z, np.array([150]), funnel.gliders)
    weights = remainder_weights(S, beta, np.eye(7))
    part = funnel.between(150, 151)
    more = forms_of(part, beta=np.repeat(beta, 2, 0), weights=np.repeat(weights, 2, 0))
    form = (more.quadratic - forms_of(part).quadratic)[0]
    L_T, L_inv_T = to_ball(S[0])
    errors = z @ L_inv_T.T
    remainder = remainder_of_one(funnel.nominal, [150], errors[None])[0]
    pushed = 2.0 * np.sum((z @ L_T) * remainder, axis=1)
    assert np.all(pushed <= np.einsum("bi,ij,bj->b", z, form, z))
    assert np.abs(pushed).max() > 0.01


def test_a_bound_is_large_only_where_the_remainder_is(proven):
    """|R| <= β (1 + eᵀ F e) on the boundary, though β is a third of R's largest."""
    at, points = np.array([60, 150]), sphere_points(300, 7)
    given = proven.nominal, proven.S[at], points, at, proven.gliders
    largest = sample_remainder(*given)
    sizes = np.broadcast_to(np.diag([0.05, 0.05, 0.15, 0.3, 0.3, 0.3, 1.0]), (2, 7, 7))
    focus = find_focus(*given, sizes**2)
    beta = sample_remainder(*given, focus)
    assert np.all(focus[:, :2] == 0.0)
    assert np.linalg.eigvalsh(focus).min() > -1e-9 * np.abs(focus).max()
    assert np.all(beta <= 1.2 * FunnelSettings.floor * largest)
    e = sphere_points(20_000, 7, 1) @ np.swapaxes(to_ball(proven.S[at])[1], 1, 2)
    found = np.abs(remainder_of_one(proven.nominal, at, e))
    bent = 1.0 + np.einsum("kbi,kij,kbj->kb", e, focus, e)
    ratios = (found[..., 4:] / beta[:, None, 4:]).max(axis=2) / bent
    assert 0.8 < ratios.max() < 1.05
    # Most of the boundary has hardly more than the floor.
    assert np.all(np.median(bent, axis=1) < 0.7 / FunnelSettings.floor)


def test_climbing_finds_nearly_all_of_what_many_more_samples_find():
    funnel = load_funnel(models_path("funnels", "drawn.npz"))
    at = np.array([20, 150])  # The glider is fast, and slow.
    given = at, funnel.gliders
    few, many = (
        sample_remainder(funnel.nominal, funnel.S[at], sphere_points(n, 7, n), *given)
        for n in (300, 20_000)
    )
    assert np.all(few[:, 4:] > 0.85 * many[:, 4:])
    assert np.all(few[:, :4] == 0.0)


def test_climbing_goes_on_from_what_its_neighbors_in_time_found():
    """A hill of the pitch's R, which a climb of one time alone misses at some."""
    funnel = load_funnel(models_path("funnels", "head_wind_hook.npz"))
    at = np.arange(174, 190)

    def found(seed, at):
        """Returns the largest R of the pitch's rate (K,)."""
        points = sphere_points(500, 7, seed)
        sampled = sample_remainder(
            funnel.nominal, funnel.S[at], points, at, funnel.gliders
        )
        return sampled[:, 6]

    truth = np.maximum(found(1, at), found(2, at))
    alone = np.concatenate([found(0, at[[k]]) for k in range(len(at))])
    assert np.min(alone / truth) < 0.85
    assert np.min(found(0, at) / truth) > 0.9


def test_a_focus_found_alone_is_smoothed_in_time(monkeypatch):
    """A spike at one time is shared with its neighbors, a straight line stays."""
    held = load_funnel(models_path("funnels", "held_head_wind_hook.npz"))
    part, at = held.between(40, 44), np.arange(5)
    spike = 1.0 + np.eye(5)[:, 2]
    monkeypatch.setattr(
        shape_flow, "find_focus", lambda *given: spike[:, None, None] * np.eye(7)
    )
    points = sphere_points(40, 10)
    task = shape_flow.FunnelTask(part.nominal, part.settings, points)
    bounds = task.sets(part.nominal, part.S, part.slopes, at)
    wanted = [1.0, 1.25, 1.5, 1.25, 1.0]
    assert bounds.focus == pytest.approx(np.multiply.outer(wanted, np.eye(7)))
    line = np.linspace(0.0, 1.0, 5)
    assert shape_flow.smoothed(line)[1:-1] == pytest.approx(line[1:-1])
