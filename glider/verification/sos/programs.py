"""The semidefinite programs of a funnel, from coefficients, through Drake.

A least λ such that λᵀ r(z) - p(z) is a sum of squares on the sphere is found as a
problem of moments, its dual: with m the moments of z up to degree 4,
    maximize  pᵀ m   subject to   rows m = targets,  E[b bᵀ](m) ⪰ 0,
whose multipliers are λ and the Gram matrix. That has 294 unknowns instead of 658 and
takes two thirds of the time.

A semidefinite solver can abort its whole process (Clarabel on a hard program, CSDP in
Drake's SolveInParallel). So programs are functions of arrays that run in processes of
their own, and the caller gets a SolverError.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor
from pydrake.solvers import (
    ClarabelSolver,
    MathematicalProgram,
    ScsSolver,
    SolverOptions,
)

from glider.verification.sos.sphere import sphere

SOLVERS = {"clarabel": ClarabelSolver, "scs": ScsSolver}
"""Solvers by name, in the order in which they are tried."""

CLARABEL_TOLERANCE = 1e-4
"""Gap and infeasibility where Clarabel stops: below the margins of a funnel. Its
default, 1e-8, takes half as long again; the check relies on neither."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Moments:
    """A solution of the problem of moments.

    Attributes:
        success: success as the solver reports it; nothing relies on it.
        multipliers: multipliers λ (K,) of the equations.
        gram: gram matrix (E,), its lower triangle column by column.
    """

    success: bool
    multipliers: np.ndarray
    gram: np.ndarray


def first_success(program: Callable, *arguments: Any) -> tuple | None:
    """Returns what a program returns with the first solver that succeeds.

    Args:
        program: `least_growth` or `largest_margin`, run in another process.
        arguments: all of its arguments but the solver.

    Returns:
        None where no solver succeeds.
    """
    for solver in SOLVERS:
        [solved] = solve_apart(program, [(*arguments, solver)])
        success, *_, array = solved
        if success and np.all(np.isfinite(array)):
            return solved
    return None


def solve_moments(
    polynomial: np.ndarray, rows: np.ndarray, targets: np.ndarray, n: int, solver: str
) -> Moments:
    """Solves the problem of moments above.

    Args:
        polynomial: (C,) coefficients of p, odd then even.
        rows: (K, C) of the equations, in the same coefficients.
        targets: (K,) right-hand sides.
    """
    tables = sphere(n)
    program = MathematicalProgram()
    moments = program.NewContinuousVariables(tables.map.shape[0])
    equations = program.AddLinearEqualityConstraint(rows, targets, moments)
    share = np.where(tables.rows == tables.columns, 1.0, 2.0)
    matrices = [np.zeros((tables.size, tables.size))]
    matrices += list(tables.matrix(tables.map / share))
    positive = program.AddLinearMatrixInequalityConstraint(matrices, moments)
    program.AddLinearCost(-polynomial, 0.0, moments)
    options = SolverOptions()
    for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
        options.SetOption(ClarabelSolver.id(), name, CLARABEL_TOLERANCE)
    result = SOLVERS[solver]().Solve(program, None, options)
    return Moments(
        success=result.is_success(),
        multipliers=-np.asarray(result.GetDualSolution(equations), dtype=float),
        gram=np.asarray(result.GetDualSolution(positive), dtype=float),
    )


def least_growth(
    cubic: np.ndarray, quartic: np.ndarray, weight: np.ndarray, solver: str = "clarabel"
) -> tuple[bool, np.ndarray]:
    """Minimizes tr(W N) so that zᵀ N z - c₃ - c₄ is a sum of squares on the sphere.

    Args:
        cubic: (C₃,) of c₃.
        quartic: (C₄,) of c₄.
        weight: (n, n) W, positive definite.

    Returns:
        whether the solver succeeded, and N (n, n).
    """
    n = len(weight)
    low = np.tril_indices(n)
    lift = sphere(n).lift[:, low[0], low[1]].T
    rows = np.hstack([np.zeros((len(lift), len(cubic))), lift])
    polynomial = np.concatenate([cubic, quartic])
    solved = solve_moments(polynomial, rows, weight[low], n, solver)
    # A multiplier of E[z_i z_j |z|²] counts twice in N off the diagonal.
    N = np.zeros((n, n))
    N[low] = solved.multipliers
    return solved.success, 0.5 * (N + N.T)


def largest_margin(
    coefficients: np.ndarray, n: int, solver: str = "clarabel"
) -> tuple[bool, float, np.ndarray]:
    """Maximizes γ so that p - γ is a sum of squares on the sphere.

    Args:
        coefficients: (C,) of p, odd then even, as `Sphere.coefficients` gives them.

    Returns:
        whether the solver succeeded, γ, and the Gram matrix of p - γ, (E,).
    """
    rows = sphere(n).constant[None, :]
    solved = solve_moments(-coefficients, rows, np.ones(1), n, solver)
    return solved.success, -float(solved.multipliers[0]), solved.gram


WORKERS = 2
"""Number of processes. Each imports Drake's solvers once, which takes half a second."""

_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "RAYON_NUM_THREADS": "1",
}


class SolverError(RuntimeError):
    """No solver succeeded, or its process died."""


def solve_apart(
    function: Callable, tasks: Sequence[tuple], workers: int = WORKERS
) -> list[Any]:
    """Returns [function(*task) for task in tasks], computed in other processes.

    Args:
        function: importable by name, or one that cloudpickle takes.

    Raises:
        SolverError: a process died.
    """
    executor = _pool(workers)
    futures = [executor.submit(function, *task) for task in tasks]
    try:
        return [future.result() for future in futures]
    except BrokenProcessPool as error:
        _pool.cache_clear()
        executor.shutdown(wait=False, kill_workers=True)
        first = str(error).strip().splitlines()[0] if str(error).strip() else ""
        raise SolverError(f"A solver's process died: {first}") from None


@functools.cache
def _pool(workers: int) -> ProcessPoolExecutor:
    """Returns processes of our own: joblib uses loky's shared ones itself."""
    return ProcessPoolExecutor(max_workers=workers, env=_ONE_THREAD, timeout=60)
