"""How planar a throw is: its roll, yaw and sideways speed, where they are logged."""

import dataclasses

import numpy as np

from glider.campaign.checks.motion import calc_motion
from glider.campaign.logs import Flight

PLANAR = 0.35
"""Tilt of the lift out of the plane [rad] up to which a throw counts as planar: its
vertical share then loses 6 %. Throws graded planar by hand reach 0.32."""

LEAST_IN_PLANE = 0.5
"""Share of the wing's normal, squared, that must be in the plane of flight: below it
more of the wing's force acts out of the plane than in it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Planarity:
    """The largest departures of a throw from the plane of x and z."""

    roll: float  # Largest |roll| [rad].
    yaw: float  # Largest |yaw| [rad].
    sideways: float  # RMS of the speed along y over that of the whole speed [-].

    @property
    def tilt(self) -> float:
        """One number: the largest of the angles, of the course too [rad]."""
        return max(self.roll, self.yaw, float(np.arcsin(min(self.sideways, 1.0))))

    @property
    def sentence(self) -> str:
        """What a report says."""
        fits = "planar" if self.tilt <= PLANAR else "not planar"
        degrees = np.degrees([self.roll, self.yaw])
        return (
            f"{fits}: roll up to {degrees[0]:.0f}°, yaw up to {degrees[1]:.0f}°, "
            f"{100 * self.sideways:.0f} % of the speed sideways"
        )


def planarity(flight: Flight) -> Planarity | None:
    """How planar a throw is; None where y, roll and yaw are not logged.

    A straight throw that is not along the log's x shows as yaw and sideways speed.
    """
    if flight.attitude is None:
        return None
    y, roll, yaw = flight.attitude.T
    motion = calc_motion(flight.time, np.column_stack([flight.pose[:, :2], y]))
    square = np.mean(motion.velocity**2, axis=0) if len(motion.time) else np.ones(3)
    return Planarity(
        roll=float(np.max(np.abs(roll))),
        yaw=float(np.max(np.abs(yaw))),
        sideways=float(np.sqrt(square[2] / max(np.sum(square), 1e-12))),
    )


def normal(pitch: np.ndarray, roll: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """The wing's normal in the world (n, 3), turned by yaw, pitch, roll."""
    ahead, side = np.sin(pitch) * np.cos(roll), np.sin(roll)
    x = np.cos(yaw) * ahead + np.sin(yaw) * side
    y = np.sin(yaw) * ahead - np.cos(yaw) * side
    return np.stack([x, y, np.cos(pitch) * np.cos(roll)], axis=1)


def find_rolled(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Rows (n,) from the first on in which the wing is mostly out of the plane.

    The glider has turned off its course: no planar model predicts what follows.
    """
    if flight.attitude is None:
        return np.zeros(len(flight.time), dtype=bool)
    _, roll, yaw = flight.attitude.T
    out = normal(flight.pose[:, 2], roll, yaw)[:, 1] ** 2
    return np.logical_or.accumulate((out > 1.0 - LEAST_IN_PLANE) & usable)
