"""The dynamics and their loops, compiled by numba and kept on disk.

`compiled(effects)` gives the loops of `glider.compiled` over the chain with these
effects. At the first use of one it writes the text of the chain, of the effects'
sums and of that loop's family as one module into the user's cache folder and
imports it. The file's name holds a digest of every source that it depends on,
so that an edit never meets an old binary; numba keeps the machine code beside it.
"""

import functools
import hashlib
import inspect
import os
import sys
import tempfile
import threading
import types
from collections.abc import Callable
from importlib.machinery import SourceFileLoader
from pathlib import Path

import numba
import numpy as np

from glider.compiled import (
    FAMILIES,
    constants,
)
from glider.physics import (
    aerodynamics,
    chain,
    servo,
    trigonometry,
)
from glider.physics.compose import (
    formulas,
    source,
)
from glider.physics.effects import effect as effect_module
from glider.physics.effects import field
from glider.physics.effects.effect import EffectKind

FAST = {"contract", "nsz", "arcp", "reassoc", "afn"}
"""Liberties that the compiler may take with rounding; NaN and infinity stay."""

_FAMILY_OF = {f.__name__: family for family in FAMILIES for f in family.ENTRIES}

_TEXT_OF = {
    family: "\n\n".join(inspect.getsource(f) for f in family.LOOPS)
    for family in FAMILIES
}
"""Read now: the files may be edited while this process runs."""

_COMPILING = threading.RLock()


def cache_folder() -> Path:
    """Returns a folder for compiled kernels that this user can write."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "drake-glider"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    folder = Path(tempfile.gettempdir()) / f"drake-glider-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    return folder


def _importable(effects: tuple[EffectKind, ...]) -> bool:
    return all(
        getattr(f, "__module__", "__main__") != "__main__"
        and f.__qualname__.isidentifier()
        for f in formulas(effects).values()
    )


def _text(
    family: types.ModuleType, effects: tuple[EffectKind, ...], has_field: bool
) -> str:
    """Returns the text of the module to compile, without the formulas' names."""
    parts = [
        "import numpy as np",
        "from glider.compiled.constants import BLOCK, DIFFERENCE, TINY",
        "from glider.physics.servo import limited_rate",
        source(effects, has_field, skip_absent=True),
        _TEXT_OF[family],
    ]
    return "\n\n".join(parts)


def _wrap(
    names: dict, entries: set[str], effects: tuple[EffectKind, ...], cache: bool
) -> None:
    """Compiles, in place, every function that the text of the module defined."""
    for name in formulas(effects):
        names[name] = numba.njit(names[name])
    for name, value in list(names.items()):
        if (
            isinstance(value, types.FunctionType)
            and value.__module__ == names["__name__"]
        ):
            names[name] = numba.njit(
                value,
                nogil=True,
                error_model="numpy",
                fastmath=FAST,
                cache=cache and name in entries,
                forceinline=name not in entries,
            )


def _digest(
    text: str, family: types.ModuleType, effects: tuple[EffectKind, ...]
) -> str:
    modules = {inspect.getmodule(f) for f in formulas(effects).values()}
    modules |= {aerodynamics, chain, effect_module, field, servo, trigonometry}
    modules |= {sys.modules[__name__], constants}
    files = sorted(inspect.getsource(m) for m in modules if m is not None)
    called = [_TEXT_OF[_FAMILY_OF[name]] for name in family.USES]
    versions = [numba.__version__, np.__version__, sys.version]
    seed = "\n".join([text, *called, *files, *versions])
    return hashlib.sha256(seed.encode()).hexdigest()[:16]


class Kernel:
    """The loops of `glider.compiled` for given effects, as attributes.

    A family is made ready when the first of its loops is asked for.
    """

    def __init__(self, effects: tuple[EffectKind, ...], has_field: bool) -> None:
        self._effects = effects
        self._has_field = has_field

    def __getattr__(self, name: str) -> Callable:
        if name not in _FAMILY_OF:
            raise AttributeError(f"no loop is called '{name}'")
        with _COMPILING:  # Threads that meet here share one.
            if name not in self.__dict__:
                self.__dict__.update(self._load(_FAMILY_OF[name]))
        return self.__dict__[name]

    def _load(self, family: types.ModuleType) -> dict[str, Callable]:
        """Returns the entries of a family, compiled."""
        effects = self._effects
        text = _text(family, effects, self._has_field)
        entries = {f.__name__ for f in family.ENTRIES}
        shared = {name: getattr(self, name) for name in family.USES}
        cache = _importable(effects)
        if cache:
            imports = [
                f"from {f.__module__} import {f.__name__} as {alias}"
                for alias, f in formulas(effects).items()
            ]
            text = "\n".join(imports) + "\n\n" + text + "\n"
            names = _import(_digest(text, family, effects), text)
        else:
            names = {"__name__": "glider_kernel", **formulas(effects)}
            exec(compile(text, "<glider kernel>", "exec"), names)
        names |= shared
        _wrap(names, entries, effects, cache)
        return {name: names[name] for name in entries}


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


@functools.lru_cache(maxsize=32)
def compiled(effects: tuple[EffectKind, ...] = (), has_field: bool = False) -> Kernel:
    """Returns the compiled loops of `glider.compiled` for these effects.

    Numba compiles each loop at its first call with a type of numbers; what is
    compiled is kept on disk when every formula can be imported by name, else (a
    formula typed into a notebook) for this process only.
    """
    return Kernel(effects, has_field)
