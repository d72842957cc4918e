"""Paths of the project's data, and of the folder for what is kept between runs."""

import os
import tempfile
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def models_path(*parts: str) -> Path:
    """Returns the path of a file or folder of the models.

    In an installed wheel the models are part of the package; in the source tree,
    and so after an editable install, they are the folder models/ beside it.

    Args:
        parts: below the models folder, e.g. "vehicles", "perching.yaml".

    Raises:
        FileNotFoundError: if there is no such file or no models folder.
    """
    models = _models_folder(_PACKAGE)
    path = models.joinpath(*parts)
    if path.exists():
        return path
    last_folder = next(folder for folder in path.parents if folder.is_dir())
    there = ", ".join(sorted(p.name for p in last_folder.iterdir())) or "nothing"
    raise FileNotFoundError(
        f"There is no '{Path(*parts)}' among the models; "
        f"the folder {last_folder} holds: {there}."
    )


def _models_folder(package: Path) -> Path:
    """Returns the models of the package that is at the given path."""
    installed = package / "_models"
    if installed.is_dir():
        return installed
    source = package.parent / "models"
    # Beside an installed package, another project may have put its own "models".
    if source.is_dir() and (package.parent / "pyproject.toml").is_file():
        return source
    raise FileNotFoundError(
        f"The models were not found, neither in {installed} nor in {source}; "
        "install drake-glider again, or run it from a complete source tree."
    )


def cache_folder() -> Path:
    """Returns a folder for compiled kernels and unpacked samples.

    The first of $XDG_CACHE_HOME, ~/.cache and the folder for temporary files that this
    user can write.
    """
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
