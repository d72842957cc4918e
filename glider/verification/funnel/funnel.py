"""A funnel: a tube of states about a nominal flight, saved and loaded whole."""

import dataclasses
import io
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from glider.control.tvlqr import TrackingPolicy, linear_policy
from glider.errors import InputError
from glider.files import schema
from glider.files.writing import replace_file
from glider.physics.confidence import ALONE, ConfidenceSet, make_confidence
from glider.physics.covariance import Covariance, check_names
from glider.physics.model import GliderModel, model_text, parse_model
from glider.planning.plan import Plan
from glider.verification.dynamics.moving_center import MovingCenter, make_moving_center
from glider.verification.dynamics.nominal import ARRAYS, Nominal
from glider.verification.funnel.boundary import BOUNDS, BoundarySets
from glider.verification.funnel.file import GlidersNote, Notes, read_file


@dataclasses.dataclass(frozen=True, kw_only=True)
class Funnel(BoundarySets):
    """The sets that no flight leaves, from the launch to the goal, and their proof."""

    grams: np.ndarray  #: Gram matrices (T, E), one a time: the certificate.
    solver: str  #: Name of the solver that was tried first.
    seconds: float  #: Duration of the computation [s].
    sha256: str = ""  #: Hash of the file that it was loaded from, in hexadecimal.
    gliders: MovingCenter  #: Gliders that it was made for, one or a set.

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        times = self.nominal.times
        return f"Funnel({times[-1]:.4f} s, {times.size} times)"

    @property
    def num_states(self) -> int:
        """Number of states n, the effects' own included."""
        return self.S.shape[1]

    @property
    def allowed(self) -> ConfidenceSet:
        """Set of gliders that it is proven for."""
        return self.gliders.confidence

    @property
    def is_of_set(self) -> bool:
        """Whether it was made for several gliders."""
        return bool(self.allowed.names)

    def between(self, first: int, last: int) -> "Funnel":
        """Returns the funnel from one of its times to another, given their indices."""
        here = slice(first, last + 1)
        own = {name: getattr(self, name)[here] for name in _OWN_ARRAYS}
        nominal = self.nominal.part(here)
        gliders = self.gliders.part(here)
        return dataclasses.replace(self, nominal=nominal, gliders=gliders, **own)

    def center(self, times: ArrayLike) -> np.ndarray:
        """Returns x₀ at times within the flight, (..., n)."""
        return self.nominal.path(self._inside(times))

    def shape(self, times: ArrayLike) -> np.ndarray:
        """Returns S at times within the flight, (..., n, n)."""
        return self.curve(self._inside(times))

    def level(self, times: ArrayLike, states: np.ndarray) -> np.ndarray:
        """Returns V = eᵀ S e of states (..., n) about x₀, at most 1 inside.

        Times (...) before and after the flight count as its ends.
        """
        error = states - self.center(times)
        return np.einsum("...i,...ij,...j->...", error, self.shape(times), error)

    def half_widths(self, times: ArrayLike = 0.0) -> np.ndarray:
        """Returns how far each state alone may deviate, 1/√S_ii, (..., n)."""
        S = self.shape(times)
        return 1.0 / np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))

    def _inside(self, times):
        return np.clip(times, self.nominal.times[0], self.nominal.times[-1])


_OWN_ARRAYS = ("S", "slopes", *BOUNDS, "grams")


def save_funnel(path: Path | str, funnel: Funnel) -> None:
    """Writes a funnel as .npz, its glider included; `load_funnel` reads it."""
    arrays = {name: getattr(funnel.nominal, name) for name in ARRAYS}
    arrays |= {name: getattr(funnel, name) for name in _OWN_ARRAYS}
    # The check corrects a Gram matrix: half of its digits are enough.
    arrays["grams"] = funnel.grams.astype(np.float32)
    notes = Notes(
        state_names=funnel.nominal.model.state_names,
        settings=funnel.settings,
        model=model_text(funnel.nominal.model),
        solver=funnel.solver,
        seconds=funnel.seconds,
        confidence=gliders_note(funnel),
    )
    buffer = io.BytesIO()
    text = np.array(schema.json_text(notes))
    np.savez_compressed(buffer, notes=text, **arrays)
    replace_file(Path(path), lambda file: file.write_bytes(buffer.getvalue()))


def gliders_note(funnel: Funnel) -> GlidersNote | None:
    """Returns the set of gliders of a funnel as its file has it; None for one."""
    if not funnel.is_of_set:
        return None
    known = vars(funnel.allowed.covariance)
    return GlidersNote(**known, level=funnel.allowed.level)


def load_funnel(path: Path | str) -> Funnel:
    """Loads a funnel; whether it is a certificate is for `check_funnel`.

    Raises:
        InputError: the file holds no funnel, or one of a time-varying glider.
    """
    return funnel_of(path, *read_file(path))


@np.errstate(all="ignore")  # Numbers that overflow are for `check_funnel` to refuse.
def funnel_of(
    path: Path | str, notes: Notes, arrays: dict[str, np.ndarray], sha256: str
) -> Funnel:
    """Returns the funnel of a file that was read from a path.

    Raises:
        InputError: its glider can have no funnel.
    """
    fault = f"{path}: not a funnel: its"
    model = parse_model(notes.model, f"{fault} glider")
    if model.is_time_varying:
        raise InputError(f"{fault} glider's dynamics vary with time.")
    if notes.state_names != model.state_names:
        raise InputError(
            f"{fault} states are {', '.join(notes.state_names)}; its glider's are "
            f"{', '.join(model.state_names)}."
        )
    nominal = Nominal(model=model, **{name: arrays[name] for name in ARRAYS})
    try:
        confidence = _noted_confidence(model, notes.confidence)
        held = notes.settings.period > 0.0
        gliders = make_moving_center(nominal, confidence, held)
    except InputError as error:
        raise InputError(f"{fault} gliders: {error}") from None
    return Funnel(
        nominal=nominal,
        settings=notes.settings,
        solver=notes.solver,
        seconds=notes.seconds,
        sha256=sha256,
        gliders=gliders,
        **{name: arrays[name] for name in _OWN_ARRAYS},
    )


def _noted_confidence(model: GliderModel, note: GlidersNote | None) -> ConfidenceSet:
    """Returns the set in a file's notes; InputError if it is not of the model."""
    if note is None:
        return ALONE
    check_names(note.names, model.effects)
    covariance = Covariance(
        names=note.names, matrix=note.matrix, degrees_of_freedom=note.degrees_of_freedom
    )
    confidence = make_confidence(model, covariance, note.level)
    if confidence.names != note.names:
        raise InputError(
            f"the confidence set is of {', '.join(note.names)}, of which a flight "
            f"depends on {', '.join(confidence.names) or 'none'} only."
        )
    return confidence


def funnel_policy(funnel: Funnel, first: int = 0, held: bool = False) -> TrackingPolicy:
    """Returns the feedback of a funnel from one of its times on, as a policy.

    Raises:
        InputError: it is for held commands, and these are not.
    """
    nominal = funnel.nominal
    period = funnel.settings.period
    if period and not held:
        raise InputError(
            "The funnel is for commands that are held; expected one for a feedback "
            "that acts at all times."
        )
    if not 0 <= first < len(nominal.times) - 1:
        raise InputError(f"There is no flight from the funnel's time {first} on.")
    # Of a time that stands twice, what holds after it.
    kept = first + np.flatnonzero(np.append(np.diff(nominal.times[first:]) > 0.0, True))
    plan = Plan(
        times=nominal.times[kept] - nominal.times[first],
        states=nominal.states[kept],
        slopes=nominal.slopes[kept],
        inputs=nominal.inputs[kept],
        state_names=nominal.model.state_names,
        cost=0.0,
    )
    return linear_policy(plan, nominal.gains[kept], funnel.S[kept], period)
