"""The file of a funnel: notes and arrays in one .npz, read before they mean anything.

NumPy is all that this needs, so that a file that is no funnel is refused at once.

A file is a compressed .npz (`numpy.load`) with the arrays, of float64 but for `grams`
(float32 is read too, and nothing else),

    times   (T,)       times, increasing from 0 [s]
    states  (T, n)     x₀ of the nominal flight, in the order of `state_names`
    inputs  (T,)       u₀, the elevator's rate [rad/s]
    gains   (T, n)     K of the feedback u = u₀ - K (x - x₀); u₀ and K are straight
                       lines between the times, x₀ is the cubic Hermite polynomial
    S       (T, n, n)  of the sets V = (x - x₀)ᵀ S (x - x₀) <= 1; symmetric
    slopes  (T, n, n)  Ṡ [1/s], symmetric; between the times S is the cubic Hermite
                       polynomial
    beta    (T, n)     bounds β of the Taylor remainder of each rate [m/s², rad/s²]
    weights (T, n)     λ that brings β into V̇, `glider.verification.funnel.remainder`
    grams   (T, E)     Gram matrices of -V̇/V on the boundary: float32, for they are a
                       hint that the check mends; lower triangles, column by column, in
                       the basis of `glider.verification.sos.sphere`

and `notes`, a JSON text with

    format       "drake-glider funnel 1"
    state_names  n names: STATE_NAMES, then the effects' own states
    settings     the fields of FunnelSettings
    solver       name of the solver that was tried first
    seconds      duration of the computation [s]
    model        the glider, the text of a file of `glider.physics.model`
    confidence   null or left out, or for a funnel of more gliders than that one
                 {"names", "matrix", "level", "shape"} of the set that they deviate in,
                 `glider.verification.dynamics.confidence`
"""

import dataclasses
import hashlib
import io
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from glider.errors import InputError
from glider.files.writing import replace_file

_FORMAT = "drake-glider funnel 1"

_FAULTS = (
    OSError,
    EOFError,
    ValueError,
    TypeError,
    KeyError,
    AttributeError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What reading a file may raise that somebody cut short, edited or made otherwise."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelFile:
    """What a file holds."""

    state_names: tuple[str, ...]
    """STATE_NAMES, then the effects' own states; n of them."""

    settings: dict[str, Any]
    """Field of FunnelSettings to its value."""

    model: str
    """Text of the glider's model file."""

    solver: str
    """Name of the solver that was tried first."""

    seconds: float
    """Duration of the computation [s]."""

    arrays: dict[str, np.ndarray]
    """Name to finite doubles, of the shapes in `_shapes`."""

    confidence: dict[str, Any] | None = None
    """What the set of gliders is that it was made for; None for the model's own."""

    sha256: str = ""
    """Hash of the file that was read, in hexadecimal."""


def _shapes(count: int, n: int) -> dict[str, tuple[int, ...]]:
    """Returns the shape of each array, for so many times and states."""
    size = n + n * (n + 1) // 2
    return {
        "times": (count,),
        "states": (count, n),
        "inputs": (count,),
        "gains": (count, n),
        "S": (count, n, n),
        "slopes": (count, n, n),
        "beta": (count, n),
        "weights": (count, n),
        "grams": (count, size * (size + 1) // 2),
    }


def write_file(path: Path | str, file: FunnelFile) -> None:
    """Writes a file at once; `read_file` gives it back unchanged."""
    notes = {f.name: getattr(file, f.name) for f in dataclasses.fields(file)}
    arrays = notes.pop("arrays")
    del notes["sha256"]
    text = json.dumps({"format": _FORMAT, **notes})
    buffer = io.BytesIO()
    np.savez_compressed(buffer, notes=np.array(text), **arrays)
    replace_file(Path(path), lambda file: file.write_bytes(buffer.getvalue()))


def read_file(path: Path | str) -> FunnelFile:
    """Reads a file; InputError where it holds no funnel."""
    try:
        if not _may_be_a_funnel(path):
            raise InputError(
                f"{path}: is not a funnel; expected a file that "
                "examples/perching_funnel.py --save wrote (.npz)."
            )
        content = Path(path).read_bytes()
        with np.load(io.BytesIO(content), allow_pickle=False) as data:
            notes = json.loads(str(data["notes"]))
            arrays = {name: data[name] for name in _shapes(0, 0)}
        if notes["format"] != _FORMAT:
            raise ValueError(f"its format is {notes['format']!r}, not {_FORMAT!r}")
        file = FunnelFile(
            state_names=tuple(notes["state_names"]),
            settings={
                key: tuple(value) if isinstance(value, list) else value
                for key, value in notes["settings"].items()
            },
            model=str(notes["model"]),
            solver=str(notes["solver"]),
            seconds=float(notes["seconds"]),
            confidence=notes.get("confidence"),
            arrays=_checked(arrays, len(notes["state_names"])),
            sha256=hashlib.sha256(content).hexdigest(),
        )
    except InputError:
        raise
    except _FAULTS as error:
        reason = error.strerror if isinstance(error, OSError) else None
        reason = " ".join(str(reason or error).split()).rstrip(".")
        what = "cannot be read" if isinstance(error, OSError) else "is a spoilt funnel"
        raise InputError(f"{path}: {what}: {reason}.") from None
    return file


def _may_be_a_funnel(path: Path | str) -> bool:
    """Returns whether a file is an archive with the notes that a funnel has."""
    if Path(path).is_dir():
        return False
    with open(path, "rb") as stream:
        if not zipfile.is_zipfile(stream):
            return False
        with zipfile.ZipFile(stream) as archive:
            return "notes.npy" in archive.namelist()


def _checked(arrays: dict[str, np.ndarray], n: int) -> dict[str, np.ndarray]:
    """Returns the arrays as doubles; what a check relies on, it may rely on from here.

    Whole, complex and other numbers are refused: arithmetic on them is another.
    """
    times, checked = arrays["times"], {}
    for name, shape in _shapes(np.size(times), n).items():
        array = arrays[name]
        if array.dtype.kind != "f" or array.dtype.itemsize not in (4, 8):
            raise ValueError(f"'{name}' is of type {array.dtype}; float64 is needed")
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise ValueError(
                f"'{name}' has shape {array.shape}; finite numbers of shape {shape} "
                "are needed"
            )
        checked[name] = array.astype(np.float64)
    if len(times) < 2 or times[0] != 0.0 or not np.all(np.diff(times) > 0.0):
        raise ValueError("'times' must increase from 0")
    for name in ("S", "slopes"):
        array = checked[name]
        if not np.array_equal(array, np.swapaxes(array, 1, 2)):
            raise ValueError(f"'{name}' is not symmetric")
    for name in ("beta", "weights"):
        if np.any(checked[name] < 0.0):
            raise ValueError(f"'{name}' is negative somewhere")
    return checked
