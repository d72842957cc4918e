"""Loops over the dynamics, compiled by numba and kept on disk.

A `Family` is a few functions of one module that loop over the chain of
`glider.physics.chain`. Asked for a glider's effects, it writes the text of the chain,
of the effects' sums and of its own functions as one module into the user's cache
folder and imports it. The file's name holds a digest of all that it depends on, helpers
in other modules included, so that an edit never meets an old binary; numba keeps the
machine code beside it. An edit of one family leaves the others' machine code valid.
"""

import functools
import hashlib
import inspect
import os
import sys
import threading
import types
from collections.abc import Callable, Iterable, Iterator
from importlib.machinery import SourceFileLoader
from types import FunctionType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.extending import register_jitable

from glider.compiled import fast_functions, runge_kutta
from glider.errors import InputError
from glider.paths import cache_folder
from glider.physics import chain
from glider.physics.compose import formulas, source
from glider.physics.effects import EffectKind, Gaussians
from glider.physics.formulas import connect_compiler
from glider.physics.parameters import Parameters, Theta
from glider.physics.servo import Servo

FAST = {"contract", "nsz", "arcp", "reassoc", "afn"}
"""Liberties that the compiler may take with rounding; NaN and infinity stay."""

_STEP = inspect.getsource(runge_kutta)

_HEAD = """\
import numpy as np
from glider.physics.effects.free_functions import Gaussians
from glider.physics.servo import (
    STOPPING_TIME,
    held_rate,
    lagged_rate,
    limited_rate,
    rate_bounds,
    turned_angle,
)
"""

_KERNEL = inspect.getsource(sys.modules[__name__])
"""Read now: the file may be edited while this process runs."""

_TYPES = (Theta, Parameters, Gaussians, Servo)
"""What is kept on disk names the classes of arguments, and their fields."""

_INLINED = ("advance", "slope")
"""Prefixes of the names of functions whose text takes the place of their call: the
Runge-Kutta step and what is handed to it. A call would keep the compiler from seeing
what stays the same from stage to stage; rollouts are a third faster so."""

_OUTLINED = (
    "log_step",
    "_add_product",
    "_factorize",
    "_solve_factorized",
    "_ekf_predict",
    "_ekf_correct",
    "_ekf_measure",
)
"""Functions that stay calls: they are long and called from many places, which would
each take the compiler seconds. The Kalman filter compiles in half the time so, and is
as fast."""

_INNER: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a function that only compiled code calls: a sixth less to compile."""

_BORROWING = {
    name
    for name, value in vars(chain).items()
    if isinstance(value, FunctionType) and value.__module__ == chain.__name__
} - {"theta_of"} | {runge_kutta.put.__name__}
"""Functions, of the chain but for one, that return scalars or nothing: compiled without
counting references to the arrays that they are handed, which took a third of a glider's
step. What returns an array has to count, and they may not call it."""

_VERSIONED = {"numpy", "numba", "math", "cmath"}
"""Packages whose code the digest holds by their version, or Python's."""

_COMPILING = threading.RLock()

connect_compiler(register_jitable(fastmath=FAST, forceinline=True))


machine_code = numba.njit(cache=True, nogil=True, error_model="numpy")
"""Compiles a function of arrays that has no physics in it, and keeps it on disk.

Numba compiles it again where its file has changed, and no other: it may use only its
own module and NumPy."""

called_code = numba.njit(nogil=True, error_model="numpy", **_INNER)
"""Compiles what only functions of `machine_code` of the same module call."""

inlined_code = numba.njit(nogil=True, error_model="numpy", forceinline=True, **_INNER)
"""The same, once for each call: constants among the arguments are known inside."""


CompileError = numba.core.errors.NumbaError
"""Numba's, of a formula that does not compile."""


class UncompilableError(InputError):
    """A formula is not of what numba compiles."""


class Family:
    """Functions that loop over the dynamics and are compiled together.

    `derivatives` and the other functions of the chain, and those of
    `glider.compiled.runge_kutta`, may be called by name: in the compiled text they
    mean the glider with its effects.

    Args:
        functions: callees first.
        entries: those of them that are called from Python.
        uses: families whose entries these functions call, shared in machine code.
    """

    def __init__(
        self,
        functions: tuple[Callable, ...],
        entries: tuple[Callable, ...],
        uses: tuple["Family", ...] = (),
    ) -> None:
        """Reads the functions' text now: their file may change while this runs."""
        self.text = "\n\n".join(inspect.getsource(f) for f in functions)
        # What numba keeps names the types of arguments, tuples of this module too: by
        # where they are defined, so that a module that moves is compiled again.
        home = functions[0].__module__
        self._module = f"{home}\n{inspect.getsource(sys.modules[home])}"
        self.entries = tuple(f.__name__ for f in entries)
        self.uses = uses
        self._made: dict[tuple, types.SimpleNamespace] = {}
        self._last: tuple[Any, Any] = (None, None)

    def over(self, kinds: tuple[EffectKind, ...] = ()) -> types.SimpleNamespace:
        """Returns the compiled entries for these effects, as attributes.

        Numba compiles each at its first call with a type of numbers; what is
        compiled is kept on disk when every formula can be imported by name, else (a
        formula typed into a notebook) for this process only.
        """
        asked, entries = self._last
        if asked is kinds:  # Avoids hashing many kinds.
            return entries
        if kinds not in self._made:
            with _COMPILING:  # Threads that meet here share one.
                if kinds not in self._made:
                    self._made[kinds] = self._make(kinds)
        self._last = kinds, self._made[kinds]
        return self._made[kinds]

    def module_text(self, kinds: tuple[EffectKind, ...]) -> str:
        """Returns the text that is compiled, without the formulas' names."""
        physics = source(kinds, skip_absent=True)
        return "\n\n".join([_HEAD, physics, _STEP, self.text])

    def _make(self, kinds: tuple[EffectKind, ...]) -> types.SimpleNamespace:
        text = self.module_text(kinds)
        shared: dict[str, Callable] = {}
        for family in self.uses:
            shared |= vars(family.over(kinds))
        cache = _importable(kinds)
        if cache:
            imports = [
                f"from {f.__module__} import {f.__name__} as {alias}"
                for alias, f in formulas(kinds).items()
            ]
            text = "\n".join(imports) + "\n\n" + text + "\n"
            names = _import(self._digest(text, kinds), text)
        else:
            names = {"__name__": "glider_kernel", **formulas(kinds)}
            exec(compile(text, "<glider kernel>", "exec"), names)
        names |= shared
        _wrap(names, self.entries, kinds, cache)
        return types.SimpleNamespace(**{name: names[name] for name in self.entries})

    def _digest(self, text: str, kinds: tuple[EffectKind, ...]) -> str:
        head: dict[str, object] = {}
        exec(_HEAD, head)
        physics = [f for f in vars(chain).values() if isinstance(f, FunctionType)]
        called = [*head.values(), *physics, *formulas(kinds).values()]
        hidden = fast_functions.OVERLOADS  # Of sin, cos, sqrt and exp, under no name.
        texts = [text, _KERNEL, self._module]
        texts += [family.text + family._module for family in self.uses]
        texts += [numba.__version__, llvmlite.__version__, np.__version__, sys.version]
        texts.append(fingerprint([*called, *hidden, *_TYPES]))
        return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]


def check_compiles(formula: Callable, arguments: tuple) -> object:
    """Runs a formula's machine code on arguments.

    Raises:
        Exception: of the compiler or the formula.
    """
    return numba.njit(formula)(*arguments)


@functools.cache
def _importable(kinds: tuple[EffectKind, ...]) -> bool:
    return all(
        getattr(f, "__module__", "__main__") != "__main__"
        and f.__qualname__.isidentifier()
        for f in formulas(kinds).values()
    )


def _wrap(
    names: dict, entries: tuple[str, ...], kinds: tuple[EffectKind, ...], cache: bool
) -> None:
    """Compiles, in place, every function that the text of the module defined."""
    for name in formulas(kinds):
        names[name] = numba.njit(names[name], **_INNER)
    for name, value in list(names.items()):
        if isinstance(value, FunctionType) and value.__module__ == names["__name__"]:
            own: dict[str, Any] = {} if name in entries else dict(_INNER)
            own["_nrt"] = name not in _BORROWING  # Unsaid, a callee has its caller's.
            names[name] = numba.njit(
                value,
                nogil=True,
                error_model="numpy",
                fastmath=FAST,
                cache=cache and name in entries,
                forceinline=name not in entries and name not in _OUTLINED,
                inline="always" if name.startswith(_INLINED) else "never",
                **own,
            )


def _import(digest: str, text: str) -> dict:
    """Writes a module into the cache folder, imports it and returns its names."""
    name = f"glider_kernel_{digest}"
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        partial = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        partial.write_text(text)
        partial.replace(path)  # Atomic: another process may do the same.
    module = types.ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module
    SourceFileLoader(name, str(path)).exec_module(module)
    return module.__dict__


def fingerprint(roots: Iterable[object]) -> str:
    """Describes all that machine code depends on, as it is in memory.

    Numba compiles a function with its globals, closures and defaults as constants, and
    inlines the functions that it calls; on disk it looks only at the file of the
    outermost function.

    Args:
        roots: functions, plain or compiled, NamedTuples, and numbers; described with
            all that they reach by name.
    """
    seen: set[int] = set()
    return "\n".join(line for root in roots for line in _describe(root, seen))


def reached(function: types.FunctionType) -> Iterator[tuple[str, object]]:
    """Yields names and values of what a function takes from outside itself."""
    names = {name for code in _codes(function.__code__) for name in code.co_names}
    for name in sorted(names & function.__globals__.keys()):
        value = function.__globals__[name]
        if not isinstance(value, types.ModuleType):
            yield name, value
        elif value.__name__.partition(".")[0] not in _VERSIONED:
            attributes = vars(value)
            for attribute in sorted(names & attributes.keys()):
                yield f"{name}.{attribute}", attributes[attribute]
    for name, cell in zip(
        function.__code__.co_freevars, function.__closure__ or (), strict=True
    ):
        yield name, cell.cell_contents
    yield "defaults", (function.__defaults__, function.__kwdefaults__)


def _describe(value: object, seen: set[int]) -> Iterator[str]:
    value = getattr(value, "py_func", value)  # Of a function that numba compiles.
    if isinstance(value, types.FunctionType):
        yield f"{value.__module__}.{value.__qualname__}"
        if id(value) in seen:
            return
        seen.add(id(value))
        for code in _codes(value.__code__):
            constants = [c for c in code.co_consts if not isinstance(c, types.CodeType)]
            yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames}"
            yield f"{constants} {code.co_freevars} {code.co_argcount}"
        for name, found in reached(value):
            yield name
            yield from _describe(found, seen)
    elif isinstance(value, type):
        fields = getattr(value, "__annotations__", {})
        yield f"{value.__module__}.{value.__qualname__} {fields}"
    elif isinstance(value, (tuple, list)):
        for part in value:
            yield from _describe(part, seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, (int, float, complex, str, np.generic, type(None))):
        yield repr(value)
    else:  # By name: an address in its text would make each process compile.
        kind = type(value)
        name = getattr(value, "__name__", "")
        yield f"{kind.__module__}.{kind.__qualname__} {name}"


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yields a function's code and that of the functions within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)
