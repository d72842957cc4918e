"""Calls in processes of their own, for solvers that may die.

A semidefinite solver can abort its whole process (Clarabel on a hard program, CSDP in
Drake's SolveInParallel). Here that ends a worker, and the caller gets a SolverError.
"""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor

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
        tasks: arguments; arrays and plain objects.
        workers: processes, kept for the next call.

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
    """Returns processes of our own: joblib takes loky's shared ones for its own."""
    return ProcessPoolExecutor(max_workers=workers, env=_ONE_THREAD, timeout=60)
