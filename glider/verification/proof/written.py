"""A proof as a file, for a program that verifies it without this package.

`tools/verify_proof.py` reads it and describes it: a header, the funnel's values at its
times, and for each interval the Gram matrices that prove that V falls and the balls
that contain the deviations. Integers count binary places.
"""

import gzip
import json
from pathlib import Path

import numpy as np

from glider.errors import InputError
from glider.files.writing import replace_file
from glider.physics.effects import KINDS
from glider.physics.parameters import PARAMETER_NAMES
from glider.planning.problem import PerchingProblem
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.enclosure import make_remainder
from glider.verification.proof.interval import covers, make_interval, tight_cover
from glider.verification.proof.interval_growth import (
    BALL_BITS,
    GRAM_BITS,
    HALVINGS,
    prove_growth,
)
from glider.verification.proof.interval_proof import gram_guesses, needed_slack
from glider.verification.sos.exact import exact

FORMAT = "drake-glider proof 1"

STRETCH = 1.02
"""Share by which a written ball may be wider than the sets along an axis."""


def write_proof(
    path: Path, funnel: Funnel, problem: PerchingProblem, progress: Shares = silent
) -> None:
    """Writes the proof of a funnel that was proven, as JSON lines in gzip.

    Raises:
        InputError: see `expect_writable`; or a part is not proven.
    """
    expect_writable(funnel)
    count = len(funnel.nominal.times) - 1
    lines = [_header(funnel, problem), _knots(funnel)]
    for k in range(count):
        lines.append({"interval": k, **_interval_proof(funnel.between(k, k + 1))})
        progress((k + 1) / count)
    text = "".join(json.dumps(line) + "\n" for line in lines)
    content = gzip.compress(text.encode(), mtime=0)
    replace_file(path, lambda file: file.write_bytes(content))


def expect_writable(funnel: Funnel) -> None:
    """Raises InputError for a funnel whose proof the verifying program cannot read."""
    model = funnel.nominal.model
    if len(model.effects) != len(_winds(model)) or model.free_functions:
        raise InputError(
            "--write-proof is for a glider of flat plates, in still air or in a steady "
            "wind; this model has other effects."
        )
    if funnel.gliders:
        raise InputError("--write-proof is for one glider; this funnel is of a set.")
    if funnel.pushes.any() or funnel.settings.period:
        raise InputError("--write-proof is for a loop without disturbances.")


def _winds(model):
    """Returns the coefficients of the winds among a model's effects."""
    return [e.to_dict() for e in model.effects if e.kind is KINDS["wind"]]


def _header(funnel, problem):
    """Returns the glider and what it is to do."""
    model = funnel.nominal.model
    winds = _winds(funnel.nominal.model)
    return {
        "format": FORMAT,
        "funnel": funnel.sha256,
        "parameters": {
            name: getattr(model.parameters, name)
            for name in (*PARAMETER_NAMES, "elevator_limits", "elevator_rate_limit")
        },
        "wind": [winds[0][axis] for axis in "xz"] if winds else [0.0, 0.0],
        "launch": np.array(model.initial_state(problem.launch)).tolist(),
        "wire": np.array(problem.wire).tolist(),
        "reach": problem.hook.reach,
        "goal": funnel.settings.goal_axes(funnel.num_states).tolist(),
    }


def _knots(funnel):
    nominal = funnel.nominal
    arrays = {
        **{name: getattr(nominal, name) for name in ("times", "states", "inputs")},
        **{name: getattr(funnel, name) for name in ("S", "beta", "weights", "focus")},
        "gains": nominal.gains,
        "state_slopes": nominal.slopes,
        "S_slopes": funnel.slopes,
    }
    return {name: values.tolist() for name, values in arrays.items()}


def _interval_proof(piece):
    """Returns the slack, Gram matrices and balls of an interval."""
    interval = make_interval(piece)
    n = piece.num_states
    slack = needed_slack(piece, interval)
    proofs = prove_growth(interval, exact(slack), gram_guesses(piece, slack))
    if proofs is None:
        raise InputError("--write-proof needs a funnel that --prove proves.")
    parts = [
        {
            "span": _shares(part),
            "basis": part.basis.integers(-BALL_BITS)[0].tolist(),
            "multiplier": part.multiplier.integers(-GRAM_BITS).tolist(),
            "grams": [
                [row[: k + 1].tolist() for k, row in enumerate(gram[n:], n)]
                for [gram] in (own.integers(-GRAM_BITS) for own in part.grams)
            ],
        }
        for part in proofs
    ]
    return {"slack": slack, "parts": parts, "balls": list(_balls(piece, interval))}


def _shares(part):
    """Returns where a part begins and ends, from 0 to 1."""
    return [0.5 + 0.5 * s for s in part.span]


def _balls(piece, interval, halvings=HALVINGS):
    """Yields balls that contain the deviations y, for parts of an interval in time."""
    basis, stretch = tight_cover(interval)
    if stretch > STRETCH and halvings:
        for half in interval.halves():
            yield from _balls(piece, half, halvings - 1)
        return
    # With axes in the order of how much R varies.
    basis = make_remainder(piece, basis, interval.span).basis
    if not covers(interval, basis):
        raise InputError("--write-proof finds no ball that contains the sets.")
    yield {"span": _shares(interval), "basis": basis.tolist()}
