"""Checks of the machine, of this Python and of what is installed in it."""

import importlib.metadata
import importlib.util
import os
import re
import shutil
import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from pathlib import Path

from glider.doctor.finding import Finding, fails, look, works

_PACKAGE = "drake-glider"
_LEAST_PYTHON = (3, 11)
_LEAST_SPACE = 200e6  # Bytes: compiled kernels take about half of it.
_LEAST_MEMORY = 1.5e9  # Bytes: a campaign of 40 flights takes about half of it.
_REINSTALL = "install it again: make setup, or pip install . in its source tree"


def check_python() -> Finding:
    """Looks at the version of Python."""
    found = f"{'.'.join(map(str, sys.version_info[:3]))}, {sys.executable}"
    if sys.version_info < _LEAST_PYTHON:
        least = ".".join(map(str, _LEAST_PYTHON))
        advice = f"Python {least} or later is needed; make PYTHON=python3.12 takes it"
        return fails("Python", found, advice)
    return works("Python", found)


def check_package() -> Finding:
    """Looks whether this package is installed, and from where it is imported."""
    here = Path(__file__).parents[1]
    try:
        version = importlib.metadata.version(_PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        advice = "run make setup and use .venv/bin/python, or pip install ."
        return fails(_PACKAGE, f"not installed; it is run from {here}", advice)
    return works(_PACKAGE, f"{version}, {here}")


def check_requirements() -> Iterator[Finding]:
    """Looks at what is needed, and at each extra."""
    try:
        requirements = importlib.metadata.requires(_PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return  # Told by check_package.
    needed: dict[str, list[str]] = {}
    for line in requirements:
        name = re.split(r"[\s<>=!~;\[(]", line.strip(), maxsplit=1)[0]
        of = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", line)
        if name != _PACKAGE:
            needed.setdefault(of.group(1) if of else "", []).append(name)
    for extra, listed in sorted(needed.items()):
        names = list(dict.fromkeys(listed))
        title = f"extra [{extra}]" if extra else "libraries"
        missing = [name for name in names if not _is_installed(name)]
        if not missing:
            versions = (f"{n} {importlib.metadata.version(n)}" for n in names)
            yield works(title, ", ".join(versions))
        elif extra:
            words = f"without {', '.join(missing)}"
            yield look(title, words, f"pip install '{_PACKAGE}[{extra}]', if needed")
        else:
            yield fails(title, f"without {', '.join(missing)}", _REINSTALL)


def _is_installed(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def check_data() -> Finding:
    """Looks for the models and the sample campaigns."""
    from glider.paths import models_path

    try:
        folder = models_path()
        models_path("campaigns", "samples.yaml")
    except FileNotFoundError as error:
        return fails("data", str(error), _REINSTALL)
    return works("data", str(folder))


def check_threads() -> Finding:
    """Looks at how many threads may run."""
    count = os.cpu_count()
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else count
    found = f"{usable} of {count} processors may be used"
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        advice = (
            "unset NUMBA_DISABLE_JIT: without compiled code all is 100 times slower"
        )
        return look("threads", f"{found}; NUMBA_DISABLE_JIT is set", advice)
    return works("threads", found)


def check_memory() -> Finding:
    """Looks at how much memory is free."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        [kilobytes] = re.findall(r"^MemAvailable:\s+(\d+) kB$", text, re.MULTILINE)
    except (OSError, ValueError):
        return works("memory", "this system does not tell")
    free = 1000.0 * int(kilobytes)
    found = f"{free / 1e9:.1f} GB free"
    if free < _LEAST_MEMORY:
        least = f"{_LEAST_MEMORY / 1e9:.1f} GB"
        return look("memory", found, f"have {least} free, or use --flights for fewer")
    return works("memory", found)


def check_cache() -> Finding:
    """Looks whether compiled code can be kept, and how much there is."""
    from glider.paths import cache_folder

    try:
        folder = cache_folder()
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
    except OSError as error:
        advice = "set XDG_CACHE_HOME to a folder that you may write"
        return fails("cache", f"cannot be written: {error}", advice)
    files = [p for p in folder.rglob("*") if p.is_file()]
    size = sum(p.stat().st_size for p in files)
    free = shutil.disk_usage(folder).free
    found = f"{folder}, {size / 1e6:.0f} MB, {free / 1e9:.1f} GB free"
    if free < _LEAST_SPACE:
        advice = f"make room, or rm -r {folder}; what is compiled is compiled again"
        return look("cache", found, advice)
    if folder.is_relative_to(tempfile.gettempdir()):
        advice = "set XDG_CACHE_HOME to a folder that lasts, or each day compiles anew"
        return look("cache", found, advice)
    return works("cache", found)


def check_output() -> Finding:
    """Looks whether reports can be written here."""
    from glider.errors import InputError
    from glider.files.writing import check_writable

    folder = Path("out").absolute()
    try:
        check_writable(folder)
    except InputError as error:
        return look("output", str(error).rstrip("."), "give --out DIR, or go elsewhere")
    return works("output", f"reports go to {folder}")


def check_browser() -> Finding:
    """Looks for a browser that shows pages."""
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform == "linux" and not screen:
        advice = (
            "ssh -L 7000:localhost:7000 brings Meshcat to your own browser; copy "
            "report.html, and the page of --html FILE, to where it is"
        )
        return look("browser", "there is no screen here", advice)
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return look("browser", "none was found", "install one, such as firefox")
    return works("browser", getattr(browser, "name", "one that Python knows"))
