"""Drake's direct collocation of the problem, for costs and constraints of one's own."""

import numpy as np
import pytest
from pydrake.solvers import IpoptSolver, SnoptSolver

from glider import GliderModel, PerchingProblem, perching_program
from glider.errors import InputError


@pytest.mark.parametrize("solver", [SnoptSolver, IpoptSolver])
def test_with_nothing_added_it_has_the_known_minimum(solver):
    dc = perching_program(GliderModel())
    result = solver().Solve(dc.prog())
    assert result.is_success()
    assert result.get_optimal_cost() == pytest.approx(194.0462, abs=1e-3)
    assert dc.ReconstructStateTrajectory(result).end_time() == pytest.approx(
        0.8795, abs=1e-4
    )


def test_what_is_added_is_kept():
    """The article's plan climbs to 0.27 m."""
    dc = perching_program(GliderModel(), PerchingProblem(), knots=21)
    dc.AddConstraintToAllKnotPoints(dc.state()[1] <= 0.2)
    result = SnoptSolver().Solve(dc.prog())
    assert result.is_success()
    assert dc.GetStateSamples(result)[1].max() == pytest.approx(0.2, abs=1e-5)
    assert result.get_optimal_cost() > 195.0


def test_a_pole_is_flown_round():
    """The article's plan passes through it."""
    dc = perching_program(GliderModel(), knots=21)
    x, z = dc.state()[:2]
    dc.AddConstraintToAllKnotPoints((x + 1.75) ** 2 + (z - 0.2) ** 2 >= 0.2**2)
    free = perching_program(GliderModel(), knots=21)
    nearest = []
    for program in (free, dc):
        result = SnoptSolver().Solve(program.prog())
        assert result.is_success()
        places = program.GetStateSamples(result)[:2].T
        away = np.linalg.norm(places - [-1.75, 0.2], axis=1)
        nearest.append(away.min())
    without, with_pole = nearest
    assert without < 0.195
    assert with_pole > 0.2 - 1e-5


def test_constraints_have_names():
    dc = perching_program(GliderModel(), PerchingProblem(), knots=5)
    names = {
        binding.evaluator().get_description()
        for binding in dc.prog().GetAllConstraints()
    }
    assert {"launch", "z", "elevator rate", "pitch at the wire"} <= names


def test_its_guess_is_a_straight_line():
    dc = perching_program(GliderModel(), PerchingProblem(), knots=5)
    guess = dc.prog().GetInitialGuess(dc.state(2))
    np.testing.assert_allclose(guess[:2], [-1.75, 0.05], atol=1e-12)


def test_one_knot_is_refused():
    with pytest.raises(InputError, match="'knots' is 1; expected 2 or more"):
        perching_program(GliderModel(), knots=1)
