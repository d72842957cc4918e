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

import numpy as np

from glider.campaign.importing.recording import Column, Group, Recording, need, spell
from glider.errors import InputError, expect

_TIME = "Time"
_AXES = tuple(enumerate("XYZ"))
_PROGRAM = Path(__file__).with_name("c3d_process.py")
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
        points |= {f"{label}.Position.{a}": Column(place[k], unit) for k, a in _AXES}
    channels = _label(parameters, "ANALOG", data["analogs"][0])
    analog = {label: Column(values) for label, values in channels}
    groups = []
    for name, group, columns in (("", "POINT", points), ("ANALOG", "ANALOG", analog)):
        rows = max((len(column.values) for column in columns.values()), default=0)
        if rows:
            rate = float((parameters.get(f"{group}:RATE") or [0.0])[0])
            what = f"{path}: {group}:RATE"
            expect(0.0 < rate < np.inf, what, rate, "a positive rate in Hz")
            times = Column(np.arange(rows) / rate, "s")
            groups.append(Group(name, {_TIME: times} | columns, _TIME))
    if not groups:
        raise InputError(f"{path}: holds no point; expected a recording of some.")
    return Recording(path, tuple(groups), up="z")


def _load(path: Path) -> tuple[_Parameters, dict[str, np.ndarray]]:
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


def _label(
    parameters: _Parameters, group: str, rows: np.ndarray
) -> list[tuple[str, np.ndarray]]:
    """Rows of a group by their labels; those without one of their own are numbered."""
    found: dict[str, np.ndarray] = {}
    labels = [str(label).strip() for label in parameters.get(f"{group}:LABELS", [])]
    for i, own in enumerate(rows):
        label = labels[i] if i < len(labels) else ""
        if not label or label in found:
            label = f"{label or group.title()}_{i + 1}"
        found[label] = own
    return list(found.items())
