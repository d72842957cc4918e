"""Machine code that another process makes, while this one goes on.

Numba compiles one function after the other in a process, whatever its threads, and
keeps on disk what it has made. So what takes longest in a first session is begun early
by a process of its own, and loaded from the disk where it is needed. Where no process
can be started, or it fails, the call compiles it here, as it does without this module.
"""

import contextlib
import importlib
import os
import pickle
import subprocess
import sys
import threading

import numba
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.event import Event, Listener, install_listener
from numba.extending import is_jitted

_BEGUN: dict[Dispatcher, subprocess.Popen] = {}
"""Function to the process that compiles it, or has compiled it."""

_BEGINNING = threading.Lock()


def compile_ahead(function: Dispatcher, *arguments: object) -> None:
    """Begins to compile a function by another process, unless it is kept on disk.

    Before the function is called, `wait_for` it: two processes that keep the same
    function for other arguments could mix them up.

    Args:
        function: of `machine_code`.
        arguments: of the types that it will be called with; they are not read.
    """
    if not is_jitted(function) or function.signatures or os.cpu_count() == 1:
        return
    signature = tuple(map(numba.typeof, arguments))
    with _BEGINNING:  # Threads that meet here share one process.
        if function not in _BEGUN and not _is_loaded(function, signature):
            with contextlib.suppress(OSError):
                _BEGUN[function] = _begin(function, signature)


def wait_for(function: Dispatcher) -> None:
    """Returns when no other process of `compile_ahead` compiles the function."""
    if function in _BEGUN:
        _BEGUN[function].wait()


class _NotKeptError(Exception):
    """What is asked for would have to be compiled."""


class _Refusal(Listener):
    """Stops numba where it begins to compile."""

    def on_start(self, event: Event) -> None:
        """Raises _NotKeptError."""
        raise _NotKeptError

    def on_end(self, event: Event) -> None:
        """Does nothing."""


def _is_loaded(function: Dispatcher, signature: tuple) -> bool:
    """Returns whether the function's code was found on disk; it is loaded then."""
    with global_compiler_lock, install_listener("numba:compile", _Refusal()):
        try:
            function.compile(signature)
        except _NotKeptError:
            return False
    return True


def _begin(function: Dispatcher, signature: tuple) -> subprocess.Popen:
    """Starts a process that finds what this one finds."""
    paths = [os.path.abspath(path) for path in sys.path]
    what = function.py_func.__module__, function.py_func.__name__, signature
    return subprocess.Popen(
        [sys.executable, "-P", "-m", __name__, pickle.dumps(what).hex()],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def main(what: str) -> None:
    """Compiles what the process that started this one asks for."""
    module, name, signature = pickle.loads(bytes.fromhex(what))
    getattr(importlib.import_module(module), name).compile(signature)


if __name__ == "__main__":
    main(sys.argv[1])
