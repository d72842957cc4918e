"""C3D files of motion capture, as Motive, Nexus and others export them.

A point is LABEL.Position.X, in POINT:UNITS, at POINT:RATE; a residual of -1 marks a row
in which it was not seen. Channels of the group ANALOG, as of a servo, are in a group of
that name. Motive and Nexus export a rigid body by its markers: a mapping then names
those of its nose and tail.

ezc3d reads the files, in a process of its own, because damaged ones make it crash.
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
_Content = tuple[_Parameters, dict[str, np.ndarray]]


def read(path: Path) -> Recording:
    """Reads the points and the analog channels of a file.

    Returns:
        A recording with the points in the group "" and the channels in "ANALOG".

    Raises:
        InputError: the file is damaged, has neither points nor channels, or has no
            rate for those that it has.
    """
    parameters, data = _load(path)
    is_unseen = data["residuals"][0] < 0.0
    points = np.where(is_unseen, np.nan, data["points"][:3]).swapaxes(0, 1)  # (k, 3, n)
    channels = data["analogs"][0]  # (k, n)
    groups = []

    if len(points):
        units = parameters.get("POINT:UNITS") or [""]
        unit = spell(str(units[0]))
        columns = {_TIME: _make_times(path, parameters, "POINT", points.shape[-1])}
        for label, place in _label(parameters, "POINT", points):
            for axis, values in zip("XYZ", place, strict=True):
                columns[f"{label}.Position.{axis}"] = Column(values, unit)
        groups.append(Group("", columns, _TIME))

    if len(channels):
        columns = {_TIME: _make_times(path, parameters, "ANALOG", channels.shape[-1])}
        for label, values in _label(parameters, "ANALOG", channels):
            columns[label] = Column(values)
        groups.append(Group("ANALOG", columns, _TIME))

    if not groups:
        raise InputError(f"{path}: holds no point; expected a recording of some.")
    return Recording(path, tuple(groups), up="z")


def _load(path: Path) -> _Content:
    """Reads a file in another process; see `_read_file` for what it returns.

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


def _read_file(path: str) -> _Content:
    """Reads a file with ezc3d.

    Returns:
        The parameters of POINT and ANALOG; and the arrays "points" (4, k, n),
        "residuals" (1, k, n) of these, and "analogs" (1, k, n) of k channels.
    """
    faulthandler.disable()  # A crash is reported as a sentence.
    content = importlib.import_module("ezc3d").c3d(path)
    parameters = {}
    for group in ("POINT", "ANALOG"):
        for name, parameter in content["parameters"].get(group, {}).items():
            if name != "__METADATA__":
                parameters[f"{group}:{name}"] = np.ravel(parameter["value"]).tolist()

    data = content["data"]
    arrays = {name: np.asarray(data[name]) for name in ("points", "analogs")}
    arrays["residuals"] = np.asarray(data["meta_points"]["residuals"])
    return parameters, arrays


def _make_times(path: Path, parameters: _Parameters, kind: str, rows: int) -> Column:
    """Makes the column of the times of rows (n,), from zero [s].

    Args:
        path: of the file, for messages.
        parameters: of the file.
        kind: POINT or ANALOG, whose rate counts.
        rows: their number.

    Raises:
        InputError: there is no rate, or none that is positive and finite.
    """
    rates = parameters.get(f"{kind}:RATE") or [0.0]
    rate = float(rates[0])
    expect(0.0 < rate < np.inf, f"{path}: {kind}:RATE", rate, "a positive rate in Hz")
    return Column(np.arange(rows) / rate, "s")


def _label(
    parameters: _Parameters, group: str, items: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yields each point or channel with its label.

    Its number is added to a label that one before it has, or the column of times; and
    to the name of the group where it has no label: "Point_3".
    """
    labels = [str(label).strip() for label in parameters.get(f"{group}:LABELS", [])]
    labels += [""] * len(items)
    for i, values in enumerate(items):
        label = labels[i]
        if not label or label in (_TIME, *labels[:i]):
            label = f"{label or group.title()}_{i + 1}"
        yield label, values
