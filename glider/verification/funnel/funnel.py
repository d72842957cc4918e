"""A funnel: ellipsoids along a flight that no deviation leaves. What is kept of it."""

import dataclasses
import functools
import io
import json
import os
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.errors import InputError
from glider.physics.model import (
    GliderModel,
    load_model,
    save_model,
)
from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.between import nominal_slopes
from glider.verification.funnel.settings import FunnelSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class Funnel:
    """{x : (x - x₀(t))ᵀ S(t) (x - x₀(t)) <= 1}, from the launch to the goal.

    S is the cubic Hermite polynomial through its values and slopes.
    """

    nominal: Nominal
    """x₀, and the feedback that keeps the glider inside."""

    settings: FunnelSettings
    """What was asked for."""

    S: np.ndarray
    """(T, n, n)."""

    slopes: np.ndarray
    """(T, n, n) Ṡ [1/s]."""

    beta: np.ndarray
    """(T, n) the remainder of the Taylor polynomial that it bears [m/s², rad/s²]."""

    weights: np.ndarray
    """(T, n) λ of `glider.verification.funnel.remainder`."""

    grams: np.ndarray
    """(T, E) one Gram matrix a time: the certificate."""

    solver: str
    """Which one shaped it."""

    seconds: float
    """That it took."""

    @property
    def num_states(self) -> int:
        """Counts the states, the effects' own included."""
        return self.S.shape[1]

    @functools.cached_property
    def _curves(self) -> tuple[CubicHermiteSpline, CubicHermiteSpline]:
        return (
            CubicHermiteSpline(self.nominal.times, self.S, self.slopes),
            CubicHermiteSpline(
                self.nominal.times, self.nominal.states, nominal_slopes(self.nominal)
            ),
        )

    def center(self, times: np.ndarray | float) -> np.ndarray:
        """Returns x₀ at times within the flight, (..., n)."""
        return self._curves[1](self._inside(times))

    def shape(self, times: np.ndarray | float) -> np.ndarray:
        """Returns S at times within the flight, (..., n, n)."""
        return self._curves[0](self._inside(times))

    def shape_rate(self, times: np.ndarray | float) -> np.ndarray:
        """Returns Ṡ at times within the flight, (..., n, n)."""
        return self._curves[0](self._inside(times), 1)

    def level(self, times: np.ndarray | float, states: np.ndarray) -> np.ndarray:
        """Returns V = (x - x₀)ᵀ S (x - x₀), at most 1 inside, (...).

        Args:
            times: (...) within the flight; earlier and later ones count as its ends.
            states: (..., n).
        """
        error = states - self.center(times)
        return np.einsum("...i,...ij,...j->...", error, self.shape(times), error)

    def half_widths(self, times: np.ndarray | float = 0.0) -> np.ndarray:
        """Returns how far each state alone may deviate, 1/√S_ii, (..., n)."""
        S = self.shape(times)
        return 1.0 / np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))

    def extents(self, times: np.ndarray | float = 0.0) -> np.ndarray:
        """Returns how far each state deviates at most, √(S⁻¹)_ii, (..., n)."""
        inverse = np.linalg.inv(self.shape(times))
        return np.sqrt(np.diagonal(inverse, axis1=-2, axis2=-1))

    def _inside(self, times):
        return np.clip(times, self.nominal.times[0], self.nominal.times[-1])


_NOMINAL = ("times", "states", "inputs", "gains")
_OWN = ("S", "slopes", "beta", "weights", "grams")
_FORMAT = "drake-glider funnel 1"


def save_funnel(path: Path | str, funnel: Funnel) -> None:
    """Writes a funnel as .npz, its glider included; `load_funnel` reads it."""
    with TemporaryDirectory() as folder:
        model_path = Path(folder) / "model.yaml"
        save_model(model_path, funnel.nominal.model)
        model = model_path.read_text(encoding="utf-8")
    notes = {
        "format": _FORMAT,
        "state_names": list(funnel.nominal.state_names),
        "settings": dataclasses.asdict(funnel.settings),
        "solver": funnel.solver,
        "seconds": funnel.seconds,
        "model": model,
    }
    arrays = {name: getattr(funnel.nominal, name) for name in _NOMINAL}
    arrays |= {name: getattr(funnel, name) for name in _OWN}
    # A Gram matrix is a hint that the check mends: half of its digits are enough.
    arrays["grams"] = funnel.grams.astype(np.float32)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, notes=np.array(json.dumps(notes)), **arrays)
    part = Path(f"{path}.{os.getpid()}.part")
    part.write_bytes(buffer.getvalue())
    part.replace(path)


def load_funnel(path: Path | str) -> Funnel:
    """Loads a funnel; a file that is none is an InputError.

    Nothing is taken on trust but that the numbers fit together; whether they are a
    certificate is for `glider.verification.proof.check`.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            notes = json.loads(str(data["notes"]))
            arrays = {name: data[name] for name in _NOMINAL + _OWN}
        if notes["format"] != _FORMAT:
            raise ValueError(f"its format is {notes['format']!r}, not {_FORMAT!r}")
        settings: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in notes["settings"].items()
        }
        names = tuple(notes["state_names"])
        _check_shapes(arrays, len(names))
        model = _read_model(notes["model"])
        if model.is_time_varying:
            raise ValueError("its glider's dynamics vary with time")
        nominal = Nominal(
            model=model,
            state_names=names,
            **{name: arrays[name] for name in _NOMINAL},
        )
        return Funnel(
            nominal=nominal,
            settings=FunnelSettings(**settings),
            solver=str(notes["solver"]),
            seconds=float(notes["seconds"]),
            **{name: arrays[name] for name in _OWN},
        )
    except InputError:
        raise
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        EOFError,
        zipfile.BadZipFile,
    ) as e:
        raise InputError(f"{path}: not a funnel: {e}") from None


def _read_model(text: str) -> GliderModel:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.yaml"
        path.write_text(text, encoding="utf-8")
        return load_model(path)


def _check_shapes(arrays: dict[str, np.ndarray], n: int) -> None:
    count = len(arrays["times"])
    size = n + n * (n + 1) // 2
    shapes: dict[str, tuple[int, ...]] = {
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
    for name, shape in shapes.items():
        array = arrays[name]
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise ValueError(
                f"'{name}' has shape {array.shape}; finite numbers of shape {shape} "
                "are needed"
            )
    if count < 2 or not np.all(np.diff(arrays["times"]) > 0.0):
        raise ValueError("'times' must increase")
