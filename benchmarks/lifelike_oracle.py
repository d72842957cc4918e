"""How well flights can be predicted by who knows the glider, but not the gusts."""

import numpy as np

from glider.campaign.logs import Campaign
from tests.helpers.lifelike import Truth
from tests.helpers.lifelike_flight import STEP, Motion, fly, shown_pose

_SIZES = np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2])
"""Differences in x, z, pitch [m, m, rad] and their rates."""


def oracle_predict(
    campaign: Campaign, truth: Truth, fitted_share: float = 0.2
) -> dict[str, np.ndarray]:
    """Flies the true glider, with the flights' own trims, from a fitted launch.

    Args:
        campaign: as logged.
        truth: of it.
        fitted_share: of each flight's rows that its launch state is fitted to.

    Returns:
        name of a flight to its poses (n, 3) at the rows of the log. The launch is
        fitted by least squares to rows that are not broken, which the oracle knows.
    """
    capture = truth.capture
    sizes = np.array([capture.position, capture.position, capture.pitch])
    rows = [np.round(f.time / STEP).astype(int) for f in campaign.flights]
    real = shown_pose(truth.glider, truth.motion)
    sound = [
        np.all(np.abs(f.pose - real[r, i]) < 6.0 * sizes, axis=1)
        & (r <= fitted_share * r[-1])
        for i, (f, r) in enumerate(zip(campaign.flights, rows, strict=True))
    ]
    angle = truth.motion.elevator
    elevator = np.empty((2 * len(angle) - 1, angle.shape[1]))
    elevator[::2], elevator[1::2] = angle, 0.5 * (angle[1:] + angle[:-1])
    start = _start(truth.motion)
    fitted = 2 * int(np.ceil(fitted_share * max(r[-1] for r in rows))) + 3
    for _ in range(4):
        middle = _shown(truth, start, elevator[:fitted])
        by_start = []
        for k, size in enumerate(_SIZES):
            moved = start.copy()
            moved[k] += size
            by_start.append((_shown(truth, moved, elevator[:fitted]) - middle) / size)
        columns = np.stack(by_start, axis=-1)  # (K + 1, F, 3, 6)
        for i, (flight, r) in enumerate(zip(campaign.flights, rows, strict=True)):
            used, pose = r[sound[i]], flight.pose[sound[i]]
            left = ((pose - middle[used, i]) / sizes).ravel()
            slopes = (columns[used, i] / sizes[:, None]).reshape(-1, 6)
            start[:, i] += np.linalg.lstsq(slopes, left, rcond=None)[0]
    flown = _shown(truth, start, elevator)
    return {
        flight.name: flown[r, i]
        for i, (flight, r) in enumerate(zip(campaign.flights, rows, strict=True))
    }


def _start(motion: Motion) -> np.ndarray:
    """Returns launches as (6, F): x, z, pitch and their rates."""
    position, velocity = motion.position[0], motion.velocity[0]
    return np.array(
        [
            *(position.real, position.imag, motion.pitch[0]),
            *(velocity.real, velocity.imag, motion.pitchdot[0]),
        ]
    )


def _shown(truth: Truth, start: np.ndarray, elevator: np.ndarray) -> np.ndarray:
    x, z, pitch, xdot, zdot, pitchdot = start
    states = np.array([x + 1j * z, xdot + 1j * zdot, pitch, pitchdot])
    return shown_pose(truth.glider, fly(truth.glider, states, elevator))
