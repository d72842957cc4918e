"""Libraries that only some file formats need."""

import importlib
from pathlib import Path
from types import ModuleType

from glider.errors import InputError


def need(module: str, path: Path) -> ModuleType:
    """Returns an imported module; raises InputError that says what to install.

    Args:
        module: e.g. "pyulog".
        path: of the file that needs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise InputError(
            f"{path}: reading it needs {package}, which is not installed; "
            "pip install 'drake-glider[import]' installs it."
        ) from None
