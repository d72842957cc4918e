"""Lesson 1: which nonlinear terms belong in the model?

The article's section "Model structure". The acceleration along the wing, normal to it
and in pitch is each a short sum of fixed features of the flight,

    q̈_r = Σ_j β_j φ_j(q, u),   r = x, z, pitch,   β = argmin ‖Φ β - y‖²,

nonlinear in the state and linear in what is unknown. Fifteen flights of the flat plate
are simulated by Euler steps; flight 0 is held out. Ten choices of features are compared
by the error that they leave, the best one flies the held-out flight, and then all
triples of the 20 features are tried.

The published exercise takes angles for nose up that its flights count nose down. So its
best choice leaves 63,831; with one sign for all, the same choice leaves a sixteenth.

    python examples/article/basis_model.py --figure basis_model.png
"""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from course import (
    SHOWN,
    compare,
    draw_attitudes,
    legend_beside,
    picture,
    rates_of,
    read_options,
    start,
)
from glider import GliderModel
from glider.report.plots.style import BLUE, GREEN, RED

ARTICLE = {
    "Fifteen synthetic flights": SHOWN,
    "Squared error of configuration 6, the best of ten": "63,831",
    "Squared error of the next best": "96,418",
    "Held-out flight by configuration 6": SHOWN,
    "Its end: x, z [m], pitch [rad]": "3.34..3.36, 4.99..5.10, -0.54..-0.52",
    "Configuration 6 with one sign for all angles": "-",
    "Best three of the 20 features for each acceleration": "-",
}

# ------------------------------------------------------------------- fifteen flights

GLIDER = GliderModel()
STEP = 0.01  # [s]
LAUNCH = np.array([0.0, 5.0, 0.0, 0.0, 7.0, 0.0, 0.0])
FLIGHTS = 15
SEED = 10
TAPE = np.array(
    [
        *(6.15395591, 7.28319761, -1.83089634, 4.58240618, 0.45388034),
        *(1.06884147, 6.68525636, -6.73814984, -6.48535779, -7.53639179),
        *(5.22478032, 4.36927603, 5.81213723, 7.51811934, 4.69917174),
        *(-0.60508076, 4.406542, -5.9961313, 2.19787426, -5.60219346),
        *(6.98484302, 0.34319264, -1.34048711, -3.6983518, 4.30765272),
        *(-0.68878897, 1.07495796, -7.55883214, 1.84781407, 1.7607955),
        *(1.83679493, 6.97037852, 2.85602658, -2.20684474, -0.98909976),
        *(3.10438357, -6.90796214, 2.61956544, 2.68037339, -4.54930009),
        *(-5.82881209, -2.89924468, -2.1408262, 1.10264829, -0.96444517),
        *(7.67135831, -6.2510655, -4.57295322, -5.32013765, 2.40501995),
    ]
)
"""Elevator rate of each step [rad/s], about which each flight has its own."""


def fly_exercise() -> tuple[np.ndarray, np.ndarray]:
    """Returns states (15, 51, 7) and elevator rates (15, 50) of the flights.

    The published data come from NumPy's legacy generator, the launch drawn first.
    """
    rng = np.random.RandomState(SEED)
    starts, rates = [], []
    for _ in range(FLIGHTS):
        starts.append(LAUNCH + rng.uniform(-0.1, 0.1, len(LAUNCH)))
        rates.append(TAPE + rng.uniform(-1.0, 1.0, len(TAPE)))
    rates = np.array(rates)
    states = [np.array(starts)]
    for u in rates.T:
        now = states[-1].T
        states.append(states[-1] + STEP * rates_of(GLIDER, now, u).T)
    return np.stack(states, axis=1), rates


# -------------------------------------------------------------------------- features

PUBLISHED, CONSISTENT = 1, -1
"""Factor on the angles of the flights, which are positive nose down.

CONSISTENT turns them nose up, as the features need them; PUBLISHED leaves them as they
are, which is the fault of the exercise.
"""


class Flow(NamedTuple):
    """What features are made of; angles are nose up where the sign is CONSISTENT."""

    V: np.ndarray  #: Speed of the wing [m/s].
    sin_a: np.ndarray  #: Of its angle of attack a.
    cos_a: np.ndarray
    W: np.ndarray  #: Speed of the elevator's center [m/s].
    sin_b: np.ndarray  #: Of its angle of attack b.
    cos_b: np.ndarray
    q: np.ndarray  #: Pitch rate [rad/s].
    sin_p: np.ndarray  #: Of the elevator's angle p.
    cos_p: np.ndarray
    u: np.ndarray  #: Elevator rate [rad/s].


def flow_of(states: np.ndarray, rates: np.ndarray, sign: int) -> Flow:
    """Returns the flow at states (..., 7); both may be complex."""
    _, _, pitch, elevator, xdot, zdot, q = np.moveaxis(states, -1, 0)
    pitch = sign * pitch
    elevator = sign * elevator
    q = sign * q
    u = sign * rates
    arm = GLIDER.parameters.hinge_offset + GLIDER.parameters.elevator_offset
    tail_x = xdot + arm * q * np.sin(pitch)
    tail_z = zdot - arm * q * np.cos(pitch)
    V, sin_a, cos_a = _meet(xdot, zdot, pitch)
    W, sin_b, cos_b = _meet(tail_x, tail_z, pitch + elevator)
    sin_p, cos_p = np.sin(elevator), np.cos(elevator)
    return Flow(V, sin_a, cos_a, W, sin_b, cos_b, q, sin_p, cos_p, u)


def _meet(xdot, zdot, angle):
    """Speed of a plate, and sine and cosine of angle - atan2(ż, ẋ)."""
    speed = np.sqrt(xdot**2 + zdot**2)
    sine = np.sin(angle)
    cosine = np.cos(angle)
    across = xdot * sine - zdot * cosine
    along = xdot * cosine + zdot * sine
    return speed, across / speed, along / speed


def _size(value):
    """|value|, which a complex step can differentiate."""
    return np.sqrt(value * value)


FEATURES: dict[int, tuple[str, Callable[[Flow], np.ndarray]]] = {
    1: ("V² sin a", lambda f: f.V**2 * f.sin_a),
    3: ("V² sin a cos² a", lambda f: f.V**2 * f.sin_a * f.cos_a**2),
    5: ("V² sin³ a", lambda f: f.V**2 * f.sin_a**3),
    6: ("V² cos³ a", lambda f: f.V**2 * f.cos_a**3),
    7: ("V³ cos a", lambda f: f.V**3 * f.cos_a),
    9: ("V q cos a", lambda f: f.V * f.q * f.cos_a),
    11: ("q", lambda f: f.q),
    13: ("sin p", lambda f: f.sin_p),
    15: ("V u sin p", lambda f: f.V * f.u * f.sin_p),
    18: ("V (q+u) sin p cos p", lambda f: f.V * (f.q + f.u) * f.sin_p * f.cos_p),
    20: ("W² sin b", lambda f: f.W**2 * f.sin_b),
    24: ("W² sin b sin p", lambda f: f.W**2 * f.sin_b * f.sin_p),
    26: ("W u cos b", lambda f: f.W * f.u * f.cos_b),
    29: ("V² sin a cos a", lambda f: f.V**2 * f.sin_a * f.cos_a),
    30: ("W² sin b cos b cos p", lambda f: f.W**2 * f.sin_b * f.cos_b * f.cos_p),
    32: ("q |q|", lambda f: f.q * _size(f.q)),
    35: ("q |q| cos a", lambda f: f.q * _size(f.q) * f.cos_a),
    38: ("W (q+u)", lambda f: f.W * (f.q + f.u)),
    39: ("W (q+u) sin b", lambda f: f.W * (f.q + f.u) * f.sin_b),
    41: ("W (q+u) sin b cos b", lambda f: f.W * (f.q + f.u) * f.sin_b * f.cos_b),
}
"""The exercise's 20 features of the 41 of Hoburg and Tedrake 2009, by number."""

Choice = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
"""Numbers of the features along the wing, normal to it and in pitch."""

CONFIGURATIONS: dict[int, Choice] = {
    1: ((1, 15), (11,), (38, 32)),
    2: ((41,), (26, 20), (3, 38, 35)),
    3: ((26, 5), (11,), (7, 9)),
    4: ((35, 3, 1), (11, 13, 30), (7, 9)),
    5: ((9,), (41, 26), (11,)),
    6: ((7, 24), (1, 6, 9), (29, 30)),
    7: ((38,), (32,), (11,)),
    8: ((39, 18), (9,), (5, 30)),
    9: ((15, 6), (35, 41), (18, 3)),
    10: ((1, 20, 24), (26,), (7,)),
}

# ------------------------------------------------------------------------------- fit


class BasisModel(NamedTuple):
    """A glider whose accelerations are features times coefficients."""

    choice: Choice
    coefficients: np.ndarray  #: (m,), one acceleration after the other.
    sign: int  #: PUBLISHED or CONSISTENT.


def plane_accelerations(states: np.ndarray, sign: int) -> list[np.ndarray]:
    """Returns accelerations along and normal to the wing and in pitch, less gravity.

    ẍ_p = ẍ cos θ + (z̈ + g) sin θ,  z̈_p = (z̈ + g) cos θ - ẍ sin θ,  θ̈: in these axes
    the forces do not move from one equation to the other as the glider turns.
    """
    x, z, turn = np.moveaxis(np.diff(states[..., 4:], axis=-2) / STEP, -1, 0)
    z = z + GLIDER.parameters.gravity
    pitch = sign * states[..., :-1, 2]
    sine, cosine = np.sin(pitch), np.cos(pitch)
    return [x * cosine + z * sine, z * cosine - x * sine, sign * turn]


def feature_columns(
    states: np.ndarray, rates: np.ndarray, numbers: Sequence[int], sign: int
) -> np.ndarray:
    """Returns Φ, (samples, len(numbers)), at the beginning of each step."""
    flow = flow_of(states[..., :-1, :], rates, sign)
    columns = [FEATURES[number][1](flow).ravel() for number in numbers]
    return np.stack(columns, axis=1)


def fit(
    states: np.ndarray, rates: np.ndarray, choice: Choice, sign: int
) -> tuple[BasisModel, float]:
    """Fits a choice of features; returns the model and the squared error left.

    By `lstsq` and not by the normal equation, which squares the condition of Φ.
    """
    coefficients, left = [], 0.0
    targets = plane_accelerations(states, sign)
    for numbers, target in zip(choice, targets, strict=True):
        columns = feature_columns(states, rates, numbers, sign)
        y = target.ravel()
        beta, *_ = np.linalg.lstsq(columns, y, rcond=None)
        error = y - columns @ beta
        left += float(np.sum(error**2))
        coefficients.append(beta)
    return BasisModel(choice, np.concatenate(coefficients), sign), left


def best_subset(columns: np.ndarray, target: np.ndarray, size: int) -> tuple[int, ...]:
    """Returns the `size` columns that leave the least of a target.

    All subsets at once: of columns of unit length, with G = ΦᵀΦ and c = Φᵀy, those in a
    subset explain cᵀ G⁻¹ c of ‖y‖². Subsets with dependent columns are
    skipped: V² sin a is the sum of V² sin a cos² a and V² sin³ a.
    """
    unit = columns / np.linalg.norm(columns, axis=0)
    subsets = np.array(list(itertools.combinations(range(columns.shape[1]), size)))
    gram = (unit.T @ unit)[subsets[:, :, None], subsets[:, None, :]]
    along = (unit.T @ target)[subsets][..., None]
    usable = np.linalg.eigvalsh(gram)[:, 0] > 1e-9
    gram[~usable] = np.eye(size)
    explained = np.sum(along * np.linalg.solve(gram, along), axis=(1, 2))
    best = np.argmax(np.where(usable, explained, -1.0))
    return tuple(int(column) for column in subsets[best])


def best_choice(
    states: np.ndarray, rates: np.ndarray, size: int, sign: int = CONSISTENT
) -> Choice:
    """Returns the best `size` features for each acceleration."""
    numbers = list(FEATURES)
    columns = feature_columns(states, rates, numbers, sign)
    along, normal, pitch = (
        tuple(numbers[k] for k in best_subset(columns, target.ravel(), size))
        for target in plane_accelerations(states, sign)
    )
    return along, normal, pitch


# ----------------------------------------------------------------------------- flight


def rollout(
    model: BasisModel,
    start: np.ndarray,
    rates: np.ndarray,
    coefficients: np.ndarray | None = None,
) -> np.ndarray:
    """Flies a model by Euler steps from start (..., 7) under rates (..., N).

    The plane's accelerations turn back into the world and gravity returns. Complex
    coefficients (..., m) in place of the model's own give complex states.

    Returns:
        states (..., N + 1, 7).
    """
    beta = model.coefficients if coefficients is None else coefficients
    numbers = [number for part in model.choice for number in part]
    ends = np.cumsum([0, *map(len, model.choice)])
    states = [start.astype(beta.dtype)]
    for u in np.moveaxis(rates, -1, 0):
        now = states[-1]
        flow = flow_of(now, u, model.sign)
        terms = [beta[..., j] * FEATURES[k][1](flow) for j, k in enumerate(numbers)]
        along, normal, turn = (
            sum(terms[first:last]) for first, last in itertools.pairwise(ends)
        )
        pitch = model.sign * now[..., 2]
        sine, cosine = np.sin(pitch), np.cos(pitch)
        x = along * cosine - normal * sine
        z = along * sine + normal * cosine - GLIDER.parameters.gravity
        velocity = np.moveaxis(now[..., 4:], -1, 0)
        slopes = np.broadcast_arrays(*velocity, u, x, z, model.sign * turn)
        states.append(now + STEP * np.stack(slopes, axis=-1))
    return np.stack(states, axis=-2)


def words_of(choice: Choice) -> str:
    """Returns a model's equations without their coefficients."""
    names = ("ẍ", "z̈", "pitch")
    sums = (" + ".join(FEATURES[k][0] for k in numbers) for numbers in choice)
    return "; ".join(f"{n}: {s}" for n, s in zip(names, sums, strict=True))


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Flies, fits, compares and flies the held-out flight."""
    path = read_options(__doc__, arguments)
    states, rates = fly_exercise()
    fitted = states[1:], rates[1:]
    held_out = states[0]

    scores = {
        sign: {k: fit(*fitted, c, sign)[1] for k, c in CONFIGURATIONS.items()}
        for sign in (PUBLISHED, CONSISTENT)
    }
    best, second, *_ = sorted(scores[PUBLISHED].items(), key=lambda item: item[1])
    print(f"Configuration {best[0]}: {words_of(CONFIGURATIONS[best[0]])}")

    triples = best_choice(*fitted, 3)
    subset_model, left = fit(*fitted, triples, CONSISTENT)
    print(f"Best triples: {words_of(triples)}\n")

    models = {
        "configuration 6, published signs": fit(*fitted, CONFIGURATIONS[6], PUBLISHED),
        "configuration 6, one sign": fit(*fitted, CONFIGURATIONS[6], CONSISTENT),
        "best triples": (subset_model, left),
    }
    flown = {name: rollout(m, held_out[0], rates[0]) for name, (m, _) in models.items()}
    x, z, pitch = flown["configuration 6, published signs"][-1, :3]
    if path:
        draw(path, states, scores, flown)
    return compare(
        ARTICLE,
        SHOWN,
        f"{int(best[1]):,}",
        f"{int(second[1]):,}",
        SHOWN,
        f"{x:.2f}, {z:.2f}, {pitch:.2f}",
        f"{int(scores[CONSISTENT][6]):,}",
        f"{left:.2f}",
    )


def draw(
    path: Path,
    states: np.ndarray,
    scores: dict[int, dict[int, float]],
    flown: dict[str, np.ndarray],
) -> None:
    """Draws the flights, the scores and the held-out flight."""
    with picture(path, 9.0, 8.0) as figure:
        flights, bars, held_out = figure.subplots(3, 1)
        for flight in states:
            draw_attitudes(flights, flight, color=BLUE)
        flights.set(xlabel="x [m]", ylabel="z [m]", title="fifteen flights")
        place = np.arange(1, 11)
        words = {PUBLISHED: "published signs", CONSISTENT: "one sign"}
        for shift, (sign, color) in enumerate(((PUBLISHED, RED), (CONSISTENT, BLUE))):
            heights = list(scores[sign].values())
            bars.bar(
                place + 0.4 * shift - 0.2, heights, 0.4, color=color, label=words[sign]
            )
        bars.set(xlabel="configuration", ylabel="squared error", yscale="log")
        bars.set_xticks(place)
        legend_beside(bars)
        held_out.plot(*states[0, :, :2].T, color="k", lw=4, alpha=0.3, label="flight 0")
        for (name, model), color in zip(flown.items(), (RED, BLUE, GREEN), strict=True):
            held_out.plot(*model[:, :2].T, color=color, ls="--", label=name)
        held_out.set(xlabel="x [m]", ylabel="z [m]", title="the held-out flight")
        legend_beside(held_out)


if __name__ == "__main__":
    start(main)
