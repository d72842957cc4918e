"""The file of a funnel: notes and arrays in one .npz.

A file is a compressed .npz (`numpy.load`) with the arrays, of float64 but for `grams`
(float32 is accepted too, no other type),

    times   (T,)       times, increasing from 0 [s]; where commands are held, a time of
                       a sample stands twice, with what holds before it and after it
    states  (T, n)     x₀ of the nominal flight, in the order of `state_names`
    inputs  (T,)       u₀, the elevator's rate [rad/s]
    gains   (T, n)     K of the feedback u = u₀ - K (x - x₀); u₀ and K are straight
                       lines between the times, x₀ is the cubic Hermite polynomial
    S       (T, n, n)  of the sets V = (x - x₀)ᵀ S (x - x₀) <= 1; symmetric
    slopes  (T, n, n)  Ṡ [1/s], symmetric; between the times S is the cubic Hermite
                       polynomial
    beta    (T, n)     β of the bounds |R| <= β (1 + eᵀ F e) of the Taylor remainder of
                       each rate [m/s², rad/s²]
    focus   (T, n, n)  F, symmetric, straight lines between the times
    weights (T, n)     λ that brings β into V̇, `glider.verification.funnel.remainder`
    push_weights       (T, 2) λ of the bounds `errors` and `wind`, in the notes
    errors  (T,)       largest error of the command u₀ - K e, straight lines between
                       the times [rad/s]
    rests   (T,)       the same of u₀ - K e + eᵀ M e
    bends   (T, n, n)  M of held commands, symmetric, straight lines between the times
    grams   (T, E)     Gram matrices of -V̇/V on the boundary: float32, as the check
                       corrects them; lower triangles, column by column, in the
                       basis of `glider.verification.sos.sphere`

and `notes`, a JSON text with the fields of `Notes`.
"""

import dataclasses
import hashlib
import io
import stat
import zipfile
import zlib
from pathlib import Path

import numpy as np

from glider.errors import InputError, expect, show
from glider.files import schema
from glider.verification.funnel.settings import FunnelSettings

_FORMAT = "drake-glider funnel 4"

_MOST_BYTES = 30_000_000
"""Largest file, packed and unpacked; shipped funnels have 2 MB of arrays."""

_OF_PYTHON = OSError, EOFError, ValueError, TypeError, KeyError, RuntimeError
_FAULTS = (*_OF_PYTHON, OverflowError, MemoryError, zipfile.BadZipFile, zlib.error)
"""Exceptions on reading a file that was truncated, edited or made elsewhere."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GlidersNote:
    """The set of gliders that it was made for, see `glider.physics.confidence`."""

    names: tuple[str, ...]  #: Names of the numbers that deviate.
    matrix: np.ndarray  #: Their covariance.
    level: float  #: Probability with which the true numbers are in the set.
    shape: str = "ellipsoid"  #: No other one is known.
    degrees_of_freedom: float | None = None  #: Of the covariance.

    def __post_init__(self):
        """Raises InputError where no number deviates, or the shape is another."""
        expect(self.names, "field 'names'", [], "at least one name")
        good = self.shape == "ellipsoid"
        expect(good, "field 'shape'", self.shape, "ellipsoid")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Notes:
    """What a file says besides its arrays."""

    #: STATE_NAMES, then the effects' own states; n of them.
    state_names: tuple[str, ...]
    settings: FunnelSettings  #: Settings that the funnel was made with.
    model: str  #: The glider, text of a file of `glider.physics.model`.
    solver: str  #: Name of the solver that was tried first.
    seconds: float  #: Duration of the computation [s].
    #: Set of gliders that it was made for; None for the model's alone.
    confidence: GlidersNote | None = None
    format: str = _FORMAT  #: Of a file.


_SYMMETRIC = ("S", "slopes", "focus", "bends")


def _shapes(count: int, n: int) -> dict[str, tuple[int, ...]]:
    """Returns the shape of each array, given the numbers of times and states."""
    size = n + n * (n + 1) // 2
    entries = size * (size + 1) // 2
    shapes: dict[str, tuple[int, ...]]
    shapes = dict.fromkeys(("times", "inputs", "errors", "rests"), (count,))
    shapes |= dict.fromkeys(("states", "gains", "beta", "weights"), (count, n))
    shapes |= dict.fromkeys(_SYMMETRIC, (count, n, n))
    shapes["push_weights"] = count, 2
    shapes["grams"] = count, entries
    return shapes


def read_file(path: Path | str) -> tuple[Notes, dict[str, np.ndarray], str]:
    """Reads a file's notes, its arrays as finite doubles, and its SHA-256.

    Raises:
        InputError: it holds no funnel.
    """
    try:
        if not _may_be_a_funnel(path):
            raise InputError(
                f"{path}: is not a funnel; expected a file that "
                "funnels.save_funnel wrote (.npz)."
            )
        content = Path(path).read_bytes()
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            size = sum(info.file_size for info in archive.zip.infolist())
            if size > _MOST_BYTES:
                raise ValueError(f"its arrays are larger than {_MOST_BYTES:,} bytes")
            notes = _notes_of(archive["notes"], str(path))
            shapes = _shapes(len(archive["times"]), len(notes.state_names))
            arrays = {
                name: _array_of(name, archive[name], shape)
                for name, shape in shapes.items()
            }
        _check(arrays, notes)
        return notes, arrays, hashlib.sha256(content).hexdigest()
    except InputError:
        raise
    except _FAULTS as error:
        what = "is a damaged funnel"
        reason = str(error)
        if isinstance(error, OSError):
            what = "cannot be read"
            reason = error.strerror or reason
        reason = " ".join(reason.split()).rstrip(".")
        raise InputError(f"{path}: {what}: {reason}.") from None


def _may_be_a_funnel(path: Path | str) -> bool:
    """Determines whether a file is an archive with the notes that a funnel has."""
    status = Path(path).stat()
    good = stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES
    if not good or not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return "notes.npy" in archive.namelist()


def _notes_of(text, source):
    if text.ndim or text.dtype.kind != "U":
        raise ValueError("'notes' is not a text")
    data = schema.parse_json(str(text), source)
    if isinstance(data, dict) and data.get("format") != _FORMAT:
        raise ValueError(f"its format is {show(data.get('format'))}, not '{_FORMAT}'")
    return schema.convert(data, Notes, source)


def _array_of(name, array, shape):
    """Returns an array as doubles, if its type and shape are right.

    Integers and complex numbers are refused: their arithmetic is another.
    """
    if array.dtype.kind != "f" or array.dtype.itemsize not in (4, 8):
        raise ValueError(f"'{name}' is of type {array.dtype}; expected float64")
    if array.shape != shape:
        raise ValueError(
            f"'{name}' has shape {show(array.shape)}; expected {show(shape)}, as "
            "'times' and 'state_names' have it"
        )
    if not np.all(np.isfinite(array)):
        raise ValueError(f"'{name}' is infinite or NaN somewhere; expected numbers")
    return array.astype(np.float64)


def _check(arrays: dict[str, np.ndarray], notes: Notes) -> None:
    """Raises ValueError unless times increase, S is symmetric and bounds are >= 0."""
    times = arrays["times"]
    states = arrays["states"]
    steps = np.diff(times)
    samples = np.flatnonzero(steps == 0.0)
    rises = steps.size and np.all(steps >= 0.0) and min(steps[0], steps[-1]) > 0.0
    if not rises or times[0] != 0.0 or np.any(np.diff(samples) == 1):
        raise ValueError("'times' must increase from 0; only samples may repeat one")
    if len(samples) and not notes.settings.period:
        raise ValueError("'times' has samples, but there is no 'period'")
    if not np.array_equal(states[samples], states[samples + 1]):
        raise ValueError("'states' jump at a sample")
    for name in _SYMMETRIC:
        array = arrays[name]
        if not np.array_equal(array, np.swapaxes(array, 1, 2)):
            raise ValueError(f"'{name}' is not symmetric")
    for name in ("beta", "weights", "push_weights", "errors", "rests"):
        if np.any(arrays[name] < 0.0):
            raise ValueError(f"'{name}' is negative somewhere")
