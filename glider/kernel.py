"""The dynamics and their loops, compiled by numba and kept on disk.

`compiled(effects)` writes the text of the chain, of the effects' sums and of
the loops as one module into the user's cache folder and imports it. The file's
name holds a digest of every source that it depends on, so that an edit never
meets an old binary; numba keeps the machine code beside it.
"""

import functools
import hashlib
import inspect
import os
import sys
import tempfile
import threading
import types
from importlib.machinery import SourceFileLoader
from pathlib import Path

import numba
import numpy as np

from glider import aerodynamics, chain, loops, servo_limits, trigonometry
from glider.dynamics import formulas, source
from glider.effects import effect as effect_module
from glider.effects import field
from glider.effects.effect import EffectKind

FAST = {"contract", "nsz", "arcp", "reassoc", "afn"}
"""Liberties that the compiler may take with rounding; NaN and infinity stay."""


_LOOPS = "\n\n".join(inspect.getsource(f) for f in loops.LOOPS)
"""Read now: the file may be edited while this process runs."""


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


def _text(effects: tuple[EffectKind, ...], has_field: bool) -> str:
    """Returns the text of the module to compile, without the formulas' names."""
    parts = [
        "import numpy as np",
        "from glider.servo_limits import limited_rate",
        source(effects, has_field, skip_absent=True),
        f"DIFFERENCE = {loops.DIFFERENCE!r}",
        f"TINY = {loops.TINY!r}",
        f"BLOCK = {loops.BLOCK!r}",
    ]
    return "\n\n".join([*parts, _LOOPS])


def _wrap(names: dict, effects: tuple[EffectKind, ...], cache: bool) -> None:
    """Compiles, in place, every function that the text of the module defined."""
    for name in formulas(effects):
        names[name] = numba.njit(names[name])
    for name, value in list(names.items()):
        if (
            isinstance(value, types.FunctionType)
            and value.__module__ == names["__name__"]
        ):
            is_loop = name.startswith("log_") or name in loops.ENTRIES
            names[name] = numba.njit(
                value,
                nogil=True,
                error_model="numpy",
                fastmath=FAST,
                cache=cache and is_loop,
                forceinline=not is_loop,
            )


def _digest(text: str, effects: tuple[EffectKind, ...]) -> str:
    modules = {inspect.getmodule(f) for f in formulas(effects).values()}
    modules |= {aerodynamics, chain, effect_module, field, servo_limits, trigonometry}
    modules.add(sys.modules[__name__])
    files = sorted(inspect.getsource(m) for m in modules if m is not None)
    seed = "\n".join([text, *files, numba.__version__, np.__version__, sys.version])
    return hashlib.sha256(seed.encode()).hexdigest()[:16]


@functools.lru_cache(maxsize=32)
def compiled(
    effects: tuple[EffectKind, ...] = (), has_field: bool = False
) -> types.SimpleNamespace:
    """Returns the compiled functions of `glider.loops` for these effects.

    Numba compiles each function at its first call with a type of numbers;
    what is compiled is kept on disk when every formula can be imported by
    name, else (a formula typed into a notebook) for this process only.
    """
    text = _text(effects, has_field)
    if not _importable(effects):
        names: dict = {"__name__": "glider_kernel", **formulas(effects)}
        exec(compile(text, "<glider kernel>", "exec"), names)
        _wrap(names, effects, cache=False)
        return types.SimpleNamespace(**names)

    imports = [
        f"from {f.__module__} import {f.__name__} as {alias}"
        for alias, f in formulas(effects).items()
    ]
    text = "\n".join(imports) + "\n\n" + text + "\n"
    name = f"glider_kernel_{_digest(text, effects)}"
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        partial = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        partial.write_text(text)
        partial.replace(path)  # Atomic: another process may do the same.
    module = types.ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module
    SourceFileLoader(name, str(path)).exec_module(module)
    _wrap(module.__dict__, effects, cache=True)
    return types.SimpleNamespace(**module.__dict__)
