"""C3D files of motion capture, as Motive, Nexus and others export them.

A point is LABEL.Position.X, in POINT:UNITS, at POINT:RATE; a residual of -1 marks a row
in which it was not seen. Channels of the group ANALOG, as of a servo, are in a group of
that name. Motive and Nexus export a rigid body by its markers: a mapping then names
those of its nose and tail.
"""

import io
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.recording import Column, Group, Recording, need, spell
from glider.errors import InputError

_TIME = "Time"
_PROGRAM = Path(__file__).with_name("c3d_process.py")
_TIMEOUT = 30.0  # Time to read a small file, at most [s].
_SPEED = 2e6  # ... and what is read of a large one, at least [bytes/s].

_Parameters = dict[str, list]  # Values by GROUP:NAME.


def read(path: Path) -> Recording:
    """Reads points, rigid bodies and analog channels."""
    parameters, data = _load(path)
    groups = []
    points = data["points"]
    analogs = data["analogs"][0]
    if points.shape[1] and points.shape[2]:
        columns = _points(parameters, points, data["residuals"][0])
        groups.append(_group("", columns, _rate(path, parameters, "POINT")))
    if analogs.shape[0] and analogs.shape[1]:
        labels = _labels(parameters, "ANALOG", len(analogs))
        columns = dict(zip(labels, map(Column, analogs), strict=True))
        groups.append(_group("ANALOG", columns, _rate(path, parameters, "ANALOG")))
    if not groups:
        raise InputError(f"{path}: holds no point; expected a recording of some.")
    return Recording(path, tuple(groups), up="z")


def _load(path: Path) -> tuple[_Parameters, dict[str, np.ndarray]]:
    """_Parameters and arrays of a file, read by another process."""
    need("ezc3d", path)
    seconds = _TIMEOUT + path.stat().st_size / _SPEED
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "arrays.npz"
        command = [sys.executable, "-P", str(_PROGRAM), str(path), str(target)]
        try:
            subprocess.run(command, capture_output=True, check=True, timeout=seconds)
            content = target.read_bytes()
        except (subprocess.SubprocessError, OSError) as error:
            words = (getattr(error, "stderr", None) or b"").decode(errors="replace")
            reason = words.strip().rpartition("\n")[2].rstrip(".") or "it is damaged"
            raise InputError(f"{path}: not readable as C3D: {reason[:200]}.") from None
    with np.load(io.BytesIO(content)) as arrays:
        data = dict(arrays)
    return json.loads(str(data.pop("parameters"))), data


def _points(
    parameters: _Parameters, points: np.ndarray, residuals: np.ndarray
) -> dict[str, Column]:
    """Columns of points (4, p, n), nan where residuals (p, n) are negative."""
    unit = spell(str(_first(parameters, "POINT:UNITS", "")))
    places = np.where(residuals < 0.0, np.nan, points[:3])
    columns: dict[str, Column] = {}
    for k, label in enumerate(_labels(parameters, "POINT", points.shape[1])):
        for axis, values in zip("XYZ", places[:, k], strict=True):
            columns[f"{label}.Position.{axis}"] = Column(values, unit)
    return columns


def _first(parameters: _Parameters, name: str, default: Any) -> Any:
    return (parameters.get(name) or [default])[0]


def _group(name: str, columns: dict[str, Column], rate: float) -> Group:
    rows = len(next(iter(columns.values())).values)
    times = Column(np.arange(rows) / rate, "s")
    return Group(name, {_TIME: times} | columns, _TIME)


def _labels(parameters: _Parameters, group: str, count: int) -> list[str]:
    """Labels of a group, also those in LABELS2, ...; empty or repeated: numbered."""
    lists = ["LABELS", *(f"LABELS{i}" for i in range(2, count // 255 + 2))]
    values = [v for name in lists for v in parameters.get(f"{group}:{name}", [])]
    found = [str(value).strip() for value in values]
    found += [""] * (count - len(found))
    for i, label in enumerate(found):
        if not label or label in found[:i]:
            found[i] = f"{label or group.title()}_{i + 1}"
    return found[:count]


def _rate(path: Path, parameters: _Parameters, group: str) -> float:
    """Rate of a group [Hz]."""
    value = float(_first(parameters, f"{group}:RATE", 0.0))
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(
            f"{path}: {group}:RATE is {value:g}; expected a positive rate in Hz."
        )
    return value
