"""C3D files of motion capture, as Motive, Nexus and others export them.

A point is LABEL.Position.X, in POINT:UNITS, at POINT:RATE; a residual of -1 marks a row
in which it was not seen. Channels of the group ANALOG, as of a servo, are in a group of
that name. Motive and Nexus export a rigid body by its markers: a mapping then names
those of its nose and tail.
"""

import faulthandler
import importlib
import multiprocessing
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import joblib
import numpy as np

from glider.campaign.importing.recording import Column, Group, Recording, need, spell
from glider.errors import InputError, expect

_TIME = "Time"
_TIMEOUT = 30.0  # Time to read a small file, at most [s].
_SPEED = 2e6  # ... and what is read of a large one, at least [bytes/s].

_Parameters = dict[str, list]  # Values by GROUP:NAME.


def read(path: Path) -> Recording:
    """Reads points, rigid bodies and analog channels."""
    parameters, data = _load(path)
    unit = spell(str((parameters.get("POINT:UNITS") or [""])[0]))
    # A point that is not seen has a residual of -1.
    places = np.where(data["residuals"][0] < 0.0, np.nan, data["points"][:3])
    points: dict[str, Column] = {}
    for label, place in _label(parameters, "POINT", places.swapaxes(0, 1)):
        for axis, values in zip("XYZ", place, strict=True):
            points[f"{label}.Position.{axis}"] = Column(values, unit)
    channels = _label(parameters, "ANALOG", data["analogs"][0])
    analog = {label: Column(values) for label, values in channels}
    groups = []
    for name, kind, columns in (("", "POINT", points), ("ANALOG", "ANALOG", analog)):
        if columns:
            rate = float((parameters.get(f"{kind}:RATE") or [0.0])[0])
            expected = "a positive rate in Hz"
            expect(0.0 < rate < np.inf, f"{path}: {kind}:RATE", rate, expected)
            rows = len(next(iter(columns.values())).values)
            times = Column(np.arange(rows) / rate, "s")
            groups.append(Group(name, {_TIME: times} | columns, _TIME))
    if not groups:
        raise InputError(f"{path}: holds no point; expected a recording of some.")
    return Recording(path, tuple(groups), up="z")


def _load(path: Path) -> tuple[_Parameters, dict[str, np.ndarray]]:
    """Parameters and arrays of a file, read by another process.

    Of 400 damaged files ezc3d 1.7 crashed on 8 and hung on 3.
    """
    need("ezc3d", path)
    seconds = _TIMEOUT + path.stat().st_size / _SPEED
    processes = joblib.Parallel(n_jobs=2, timeout=seconds)
    try:
        [content] = processes([joblib.delayed(_read_file)(str(path))])
    except (multiprocessing.TimeoutError, BrokenProcessPool):
        raise InputError(f"{path}: not readable as C3D: it is damaged.") from None
    return content


def _read_file(path: str) -> tuple[_Parameters, dict[str, np.ndarray]]:
    faulthandler.disable()  # A crash is reported as a sentence.
    content = importlib.import_module("ezc3d").c3d(path)
    parameters = {
        f"{group}:{name}": np.ravel(parameter["value"]).tolist()
        for group in ("POINT", "ANALOG")
        for name, parameter in content["parameters"].get(group, {}).items()
        if name != "__METADATA__"
    }
    data = content["data"]
    arrays = {name: np.asarray(data[name]) for name in ("points", "analogs")}
    arrays["residuals"] = np.asarray(data["meta_points"]["residuals"])
    return parameters, arrays


def _label(
    parameters: _Parameters, group: str, rows: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yields rows of a group by their labels; without one of its own it is numbered."""
    labels = [str(label).strip() for label in parameters.get(f"{group}:LABELS", [])]
    labels += [""] * len(rows)
    for i, own in enumerate(rows):
        is_own = labels[i] and labels[i] not in labels[:i]
        yield labels[i] if is_own else f"{labels[i] or group.title()}_{i + 1}", own
