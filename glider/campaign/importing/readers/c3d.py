"""C3D files of motion capture, as Motive, Nexus and others export them.

A point is LABEL.Position.X, in POINT:UNITS, at POINT:RATE; a residual of -1 marks a row
in which it was not seen. Angles that Nexus computes (POINT:ANGLES) are
LABEL.Rotation.X, in POINT:ANGLE_UNITS. Bodies of the group ROTATION have
LABEL.Position.X and quaternions LABEL.Rotation.W; channels of the group ANALOG, as of a
servo, are in a group of that name. Motive and Nexus export a rigid body by its markers:
a mapping then names those of its nose and tail.
"""

import io
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.matrices import to_quaternions
from glider.campaign.importing.recording import Column, Group, Recording, need, spell
from glider.errors import InputError

_TIME = "Time"
_PROGRAM = Path(__file__).with_name("c3d_process.py")
_TIMEOUT = 30.0  # Time to read a small file, at most [s].
_SPEED = 2e6  # ... and what is read of a large one, at least [bytes/s].

Parameters = dict[str, list]  # Values by GROUP:NAME.


def read(path: Path) -> Recording:
    """Reads points, rigid bodies and analog channels."""
    parameters, data = _load(path)
    groups = []
    points = data["points"]
    turns = data["rotations"]
    analogs = data["analogs"][0]
    if points.shape[1] and points.shape[2]:
        columns = _points(parameters, points, data["residuals"][0])
        groups.append(_group("", columns, _rate(path, parameters, "POINT")))
    if turns.ndim == 4 and turns.shape[2] and turns.shape[3]:
        name = "ROTATION" if groups else ""
        columns = _bodies(parameters, turns)
        groups.append(_group(name, columns, _rate(path, parameters, "ROTATION")))
    if analogs.shape[0] and analogs.shape[1]:
        labels = _labels(parameters, "ANALOG", len(analogs))
        columns = dict(zip(labels, map(Column, analogs), strict=True))
        groups.append(_group("ANALOG", columns, _rate(path, parameters, "ANALOG")))
    if not groups:
        raise InputError(f"{path}: holds no point; expected a recording of some.")
    return Recording(path, tuple(groups), up="z")


def _load(path: Path) -> tuple[Parameters, dict[str, np.ndarray]]:
    """Parameters and arrays of a file, read by another process."""
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
    parameters: Parameters, points: np.ndarray, residuals: np.ndarray
) -> dict[str, Column]:
    """Columns of points (4, p, n), nan where residuals (p, n) are negative."""
    length = spell(str(_first(parameters, "POINT:UNITS", "")))
    angle = spell(str(_first(parameters, "POINT:ANGLE_UNITS", "deg")))
    angles = set(parameters.get("POINT:ANGLES") or [])
    places = np.where(residuals < 0.0, np.nan, points[:3])
    columns: dict[str, Column] = {}
    for k, label in enumerate(_labels(parameters, "POINT", points.shape[1])):
        what, unit = ("Rotation", angle) if label in angles else ("Position", length)
        columns |= _vector(f"{label}.{what}", places[:, k], unit)
    return columns


def _bodies(parameters: Parameters, turns: np.ndarray) -> dict[str, Column]:
    """Columns of transformations (4, 4, b, n) from bodies to the laboratory."""
    length = spell(str(_first(parameters, "POINT:UNITS", "")))
    columns: dict[str, Column] = {}
    for k, label in enumerate(_labels(parameters, "ROTATION", turns.shape[2])):
        body = np.moveaxis(turns[:, :, k], 2, 0)
        quaternions = to_quaternions(body[:, :3, :3])
        seen = np.isfinite(body).all(axis=(1, 2)) & np.isfinite(quaternions[:, 0])
        place = np.where(seen[:, None], body[:, :3, 3], np.nan)
        columns |= _vector(f"{label}.Position", place.T, length)
        columns |= _vector(f"{label}.Rotation", quaternions.T, None)
    return columns


def _vector(name: str, rows: np.ndarray, unit: str | None) -> dict[str, Column]:
    """Columns of a vector (3 or 4, n)."""
    return {
        f"{name}.{axis}": Column(values, unit)
        for axis, values in zip("XYZW", rows, strict=False)
    }


def _first(parameters: Parameters, name: str, default: Any) -> Any:
    return (parameters.get(name) or [default])[0]


def _group(name: str, columns: dict[str, Column], rate: float) -> Group:
    rows = len(next(iter(columns.values())).values)
    times = Column(np.arange(rows) / rate, "s")
    return Group(name, {_TIME: times} | columns, _TIME)


def _labels(parameters: Parameters, group: str, count: int) -> list[str]:
    """Labels of a group, also those in LABELS2, ...; empty or repeated: numbered."""
    lists = ["LABELS", *(f"LABELS{i}" for i in range(2, count // 255 + 2))]
    values = [v for name in lists for v in parameters.get(f"{group}:{name}", [])]
    found = [str(value).strip() for value in values]
    found += [""] * (count - len(found))
    for i, label in enumerate(found):
        if not label or label in found[:i]:
            found[i] = f"{label or group.title()}_{i + 1}"
    return found[:count]


def _rate(path: Path, parameters: Parameters, group: str) -> float:
    """Rate of a group [Hz]; bodies may come at a multiple of the points'."""
    if group == "ROTATION" and parameters.get("ROTATION:RATE") is None:
        ratio = float(_first(parameters, "ROTATION:RATIO", 1.0))
        return _rate(path, parameters, "POINT") * (ratio or 1.0)
    value = float(_first(parameters, f"{group}:RATE", 0.0))
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(
            f"{path}: {group}:RATE is {value:g}; expected a positive rate in Hz."
        )
    return value
