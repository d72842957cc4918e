"""Text of all that machine code depends on, as it is in memory.

Numba compiles a function with its globals, closures and defaults as constants, and
inlines the functions that it calls; on disk it looks only at the file of the outermost
function. So the name of that file holds a digest of the text written here.
"""

import types
from collections.abc import Iterable, Iterator

import numpy as np

_VERSIONED = {"numpy", "numba", "math", "cmath"}
"""Packages that are known by their version, or Python's."""


def fingerprint(roots: Iterable[object]) -> str:
    """Describes functions, types and constants, and all that they reach by name.

    Args:
        roots: functions, plain or compiled, NamedTuples, and numbers.
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
        kind, name = type(value), getattr(value, "__name__", "")
        yield f"{kind.__module__}.{kind.__qualname__} {name}"


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yields a function's code and that of the functions within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)
