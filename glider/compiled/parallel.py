"""Work over flights in parallel.

By threads: the compiled loops release Python's lock. The caller may choose other
workers through joblib, up to a cluster of computers:

    with workers_of("tcp://scheduler:8786"):
        result = close_the_loop(folder)
"""

import collections
import contextlib
import itertools
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import joblib
from joblib.parallel import get_active_backend
from threadpoolctl import threadpool_limits

from glider.errors import InputError

_WORKERS = joblib.cpu_count()
"""One for each core that this process may use, by affinity and cgroup."""

_THREADS = ThreadPoolExecutor(max_workers=_WORKERS)
"""joblib's own threads are for long tasks: it polls every 10 ms, and a flight takes
less."""

_PARTS = 4
"""Parts of the work for each worker of joblib, so that none waits long for the last."""

_UNSET = type(get_active_backend()[0])
"""joblib's backend where the caller has not chosen one."""


@contextlib.contextmanager
def workers_of(address: str | None, timeout: float = 10.0) -> Iterator[None]:
    """Lets the workers of a Dask scheduler do what is done in parallel.

    Args:
        address: of the scheduler, such as "tcp://host:8786"; None for the threads of
            this computer.
        timeout: to reach it [s].

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """
    if address is None:
        yield
        return
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise InputError(
            "A cluster needs Dask: pip install 'drake-glider[cluster]'."
        ) from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own, at closing.
        try:
            client = Client(address, timeout=timeout)
        except (OSError, ValueError) as error:
            raise InputError(
                f"No Dask scheduler answers at '{address}'; expected an address such "
                "as tcp://host:8786, which `dask scheduler` prints."
            ) from error
        with client, joblib.parallel_config(backend="dask"):
            yield


def in_parallel(function: Callable[[Any], Any], items: Iterable) -> list:
    """Returns function(item) for each.

    Args:
        function: that touches nothing outside but what it holds; where joblib's workers
            are processes, it is pickled with the items and what it returns.
        items: in any number; a worker of joblib's gets several at a time.
    """
    items = list(items)
    backend, jobs = get_active_backend()
    if jobs is None and type(backend) is _UNSET:
        return _by_threads(function, items)
    count = min(len(items), _PARTS * joblib.effective_n_jobs(None))
    edges = [len(items) * k // count for k in range(count + 1)] if count else []
    tasks = (
        joblib.delayed(_part)(function, items[first:last])
        for first, last in itertools.pairwise(edges)
    )
    parts = joblib.Parallel(batch_size=1)(tasks)
    return [found for part in parts for found in part]


def _by_threads(function: Callable[[Any], Any], items: Sequence) -> list:
    """Returns function(item) for each; a thread takes the next as it is done with one.

    The caller's thread is one of them. To hand each to a thread by itself takes as long
    as a short flight is filtered.
    """
    found: list = [None] * len(items)
    places = iter(range(len(items)))

    def work() -> None:
        try:
            for k in places:
                found[k] = function(items[k])
        finally:  # After an error or an interrupt no thread begins another.
            collections.deque(places, maxlen=0)

    others = min(_WORKERS, len(items)) - 1
    helping = [_THREADS.submit(work) for _ in range(others)]
    try:
        work()
    finally:
        begun = [each for each in helping if not each.cancel()]
        wait(begun)
    for each in begun:
        each.result()  # Raises its error.
    return found


def _part(function: Callable[[Any], Any], items: Sequence) -> list:
    with threadpool_limits(limits=1, user_api="blas"):  # Each worker is one of many.
        return [function(item) for item in items]
