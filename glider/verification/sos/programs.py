"""The semidefinite programs of a funnel, from coefficients, through Drake.

A least λ such that λᵀ r(z) - p(z) is a sum of squares on the sphere is found as a
problem of moments, its dual: with m the moments of z up to degree 4,
    maximize  pᵀ m   subject to   rows m = targets,  E[b bᵀ](m) ⪰ 0,
whose multipliers are λ and the Gram matrix. That takes two thirds of the time.

A semidefinite solver can abort its whole process (Clarabel on a hard program). So
programs run in a process of their own, and the caller gets a SolverError.
"""

import functools
from collections.abc import Callable
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

_CLARABEL_TOLERANCE = 1e-4
"""Gap and infeasibility where Clarabel stops: below the margins of a funnel. Its
default, 1e-8, takes half as long again."""


class SolverError(RuntimeError):
    """No solver succeeded, or its process died."""


def first_success(program: Callable, *arguments: Any, fault: str) -> tuple:
    """Returns what a program returns with the first solver that succeeds.

    It is `least_growth` or `largest_margin`, run in another process with its arguments
    but the solver; the fault is that of the SolverError where none succeeds.
    """
    for solver in SOLVERS:
        success, *found = _solve_apart(program, *arguments, solver)
        if success and np.all(np.isfinite(found[-1])):
            return tuple(found)
    raise SolverError(fault)


def _solve_moments(
    polynomial: np.ndarray, rows: np.ndarray, targets: np.ndarray, n: int, solver: str
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Solves the problem of moments, p (C,), rows (K, C) and targets (K,).

    Returns:
        whether the solver reports success, on which nothing relies; the multipliers λ
        (K,) of the equations; the Gram matrix (E,), its lower triangle by columns.
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
        options.SetOption(ClarabelSolver.id(), name, _CLARABEL_TOLERANCE)
    result = SOLVERS[solver]().Solve(program, None, options)
    multipliers = -np.asarray(result.GetDualSolution(equations), dtype=float)
    gram = np.asarray(result.GetDualSolution(positive), dtype=float)
    return result.is_success(), multipliers, gram


def least_growth(
    cubic: np.ndarray, quartic: np.ndarray, weight: np.ndarray, solver: str = "clarabel"
) -> tuple[bool, np.ndarray]:
    """Minimizes tr(W N) so that zᵀ N z - c₃ - c₄ is a sum of squares on the sphere.

    Returns whether the solver succeeded, and N (n, n); W is positive definite.
    """
    n = len(weight)
    low = np.tril_indices(n)
    lift = sphere(n).lift[:, low[0], low[1]].T
    rows = np.hstack([np.zeros((len(lift), len(cubic))), lift])
    polynomial = np.concatenate([cubic, quartic])
    success, found, _ = _solve_moments(polynomial, rows, weight[low], n, solver)
    # A multiplier of E[z_i z_j |z|²] counts twice in N off the diagonal.
    N = np.zeros((n, n))
    N[low] = found
    return success, 0.5 * (N + N.T)


def largest_margin(
    coefficients: np.ndarray, n: int, solver: str = "clarabel"
) -> tuple[bool, float, np.ndarray]:
    """Maximizes γ so that p - γ is a sum of squares on the sphere, p by (C,).

    Returns whether the solver succeeded, γ, and the Gram matrix of p - γ, (E,).
    """
    rows = sphere(n).constant[None, :]
    success, found, gram = _solve_moments(-coefficients, rows, np.ones(1), n, solver)
    return success, -float(found[0]), gram


_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "RAYON")}


def _solve_apart(function: Callable, *arguments: Any) -> Any:
    """Returns function(*arguments) of another process; SolverError if that died."""
    executor = _pool()
    try:
        return executor.submit(function, *arguments).result()
    except BrokenProcessPool as error:
        _pool.cache_clear()
        executor.shutdown(wait=False, kill_workers=True)
        first = str(error).strip().partition("\n")[0]
        raise SolverError(f"A solver's process died: {first}") from None


@functools.cache
def _pool() -> ProcessPoolExecutor:
    """Returns a process of our own: joblib uses loky's shared ones itself.

    It never ends when it is idle: loky does not notice the death of a process that
    comes after one.
    """
    return ProcessPoolExecutor(max_workers=1, env=_ONE_THREAD, timeout=None)
