"""Paths of the project's data, and of the cache that is kept between runs."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

import platformdirs

from glider.errors import InputError

PACKAGE = Path(__file__).resolve().parent
_VARIABLE = "DRAKE_GLIDER_CACHE"
"""Environment variable by which a process shares its temporary cache with others."""


def models_path(*parts: str) -> Path:
    """Path of a file or folder of the models.

    In an installed wheel the models are part of the package; in the source tree,
    and so after an editable install, they are the folder models/ beside it.

    Args:
        parts: below the models folder, e.g. "vehicles", "perching.yaml".

    Raises:
        FileNotFoundError: if there is no such file or no models folder.
    """
    models = _models_folder(PACKAGE)
    path = models.joinpath(*parts)
    if path.exists():
        return path
    last_folder = next(folder for folder in path.parents if folder.is_dir())
    there = ", ".join(sorted(p.name for p in last_folder.iterdir())) or "nothing"
    raise FileNotFoundError(
        f"There is no '{Path(*parts)}' among the models; "
        f"the folder {last_folder} holds: {there}."
    )


def shipped_path(path: Path | str, folder: str) -> Path:
    """Path of a file, or of a file of models/ by its name.

    Args:
        path: of a file, or the name of one in the folder, without its suffix.
        folder: of the models, e.g. "problems".

    Raises:
        InputError: it has no suffix, and neither the path nor the name exists.
    """
    path = Path(path)
    if path.suffix or path.exists():
        return path
    known = {shipped.stem: shipped for shipped in models_path(folder).glob("*.yaml")}
    if str(path) not in known:
        raise InputError(
            f"{path}: does not exist; expected a file, or the name of one in "
            f"models/{folder} ({', '.join(sorted(known))})."
        )
    return known[str(path)]


def _models_folder(package: Path) -> Path:
    """Folder of the models of the package at the given path."""
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
    """Folder for compiled kernels and unpacked campaigns, private to this user.

    Code in it is run, so nobody else may write there. It is the user's cache folder
    (platformdirs; $XDG_CACHE_HOME on Linux) or, where that cannot be used, a temporary
    folder of this process and the processes that it starts.
    """
    kept = os.environ.get(_VARIABLE)
    for folder in (_user_cache(), Path(kept) if kept else None):
        if folder is not None and _make_private(folder):
            return folder.resolve()
    folder = Path(tempfile.mkdtemp(prefix="drake-glider-"))  # Mode 0700, ours.
    os.environ[_VARIABLE] = str(folder)
    atexit.register(_remove, folder, os.getpid())
    return folder


def _user_cache() -> Path | None:
    try:
        return platformdirs.user_cache_path("drake-glider", appauthor=False)
    except (KeyError, RuntimeError):  # A user without a home.
        return None


def _make_private(folder: Path) -> bool:
    """Makes a folder that only this user can write; False where that fails.

    A folder of another user, or one that others could write, is never used.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.resolve().stat()
        if status.st_uid != os.getuid() or status.st_mode & 0o022:
            return False
        folder.chmod(0o700)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # Not in a forked child.
        shutil.rmtree(folder, ignore_errors=True)
