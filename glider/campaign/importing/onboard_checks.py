"""Do sensors on board agree with the poses? Refused, or reported, where they do not.

Gyros and accelerometers measure what the poses' derivatives are, so one confirms units
and axes of the other without a model of the air; the airspeed shows wind. The tracer is
given the rates beside the poses, and none of the others.
"""

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from glider.campaign.checks.motion import calc_motion
from glider.campaign.importing.selection import Stream
from glider.campaign.importing.track import Track, angles_of
from glider.campaign.logs import PITCH_RATE
from glider.errors import InputError

_SPAN = 0.5
"""Time over which changes of velocity and pitch are compared [s]: 3 mm of noise leave,
at 50 Hz, 0.08 m/s in a velocity, but 1.6 m/s² in an acceleration; and the noise of the
sensors, which lowers the ratio, averages out."""
_ENOUGH = 20  # Changes below which nothing is concluded.
_FOLLOWS = 0.5  # Correlation below which the poses do not follow a sensor.
_WARNED = 0.05  # Part by which two scales may differ without a word.
_REFUSED = 0.15  # ... and up to which the import goes on.
_WINDY = 0.05
"""Part of the airspeed that a wind must have to be reported: the forces of the air are
10 % off those at the speed over ground."""


def read_sensors(flight: Track, gravity: float) -> dict[str, np.ndarray]:
    """What the sensors and the poses of a flight show of the same motion.

    By the quantity of a sensor, columns of the poses' and its changes of pitch [rad] or
    velocity [m/s], or of speeds over ground and in the air [m/s]; and the pitch rates
    of the gyro (n,) [rad/s], NaN in rows that no value of its own is near.
    """
    turn = flight.rotation
    time = flight.time
    onboard = flight.onboard
    pitch = angles_of(flight)[0][:, None]
    turn = Rotation.from_euler("y", pitch).as_matrix() if turn is None else turn
    stride = max(round(_SPAN / float(np.median(np.diff(time)))), 1)
    motion = calc_motion(time, np.hstack([flight.position, pitch]), stride=stride)
    readings = {}
    if onboard.angular_velocity is not None:
        # The axis of the pitch is level, and across the nose.
        across = np.stack([-turn[:, 1, 0], turn[:, 0, 0]], axis=1)
        across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-9
        gyro = onboard.angular_velocity
        body = np.einsum("nij,ni->nj", turn[:, :2], across)
        rate = np.sum(body * _at(gyro, time), axis=1, keepdims=True)
        turned = motion.pose[:, 3:]
        readings["angular_velocity"] = _changes(motion.time, turned, time, rate)
        readings[PITCH_RATE] = np.sum(body * _averaged(gyro, time), axis=1)
    if onboard.acceleration is not None:
        push = np.einsum("nij,nj->ni", turn, _at(onboard.acceleration, time))
        push = push - [0.0, 0.0, gravity]
        velocity = motion.velocity[:, :3]
        readings["acceleration"] = _changes(motion.time, velocity, time, push)
    if onboard.airspeed is not None and len(motion.time):
        speed = np.linalg.norm(motion.velocity[:, :3], axis=1, keepdims=True)
        readings["airspeed"] = np.hstack([speed, _at(onboard.airspeed, motion.time)])
    return readings


def check_sensors(
    flights: Sequence[dict[str, np.ndarray]], source: str
) -> tuple[str, ...]:
    """Reports wind, and scales that differ; raises InputError if they do by much."""
    warnings = []
    for quantity in ("angular_velocity", "acceleration"):
        pairs = np.concatenate([f.get(quantity, np.empty((0, 2))) for f in flights])
        if len(pairs) < _ENOUGH:
            continue
        (poses, both), (_, sensors) = pairs.T @ pairs + 1e-12
        ratio = both / sensors
        correlation = both / np.sqrt(poses * sensors)
        error = np.sqrt(max(poses / sensors - ratio**2, 0.0) / len(pairs))
        off = abs(ratio - 1.0) - 2.0 * error
        words = (
            f"the poses change {ratio:.3g} ± {error:.1g} times as much as '{quantity}' "
            "says; expected 1 (units of time, length and sensor; its axes; nose, top)"
        )
        if off > _REFUSED:
            raise InputError(f"{source}: {words}.")
        if off > _WARNED or abs(correlation) < _FOLLOWS:
            warnings.append(words)
    means = [np.mean(f["airspeed"], axis=0) for f in flights if "airspeed" in f]
    ground, air = np.reshape(means, (-1, 2)).T
    wind = ground - air
    if len(wind) and np.sqrt(np.mean(wind**2)) > _WINDY * np.mean(air):
        warnings.append(
            f"the flights' speed over ground is {wind.min():+.2f} to {wind.max():+.2f} "
            f"m/s off the airspeed of {np.mean(air):.3g} m/s: there is wind, or the "
            "sensor or the unit of length is off (the tracer is not given the airspeed)"
        )
    return tuple(warnings)


def _changes(
    since: np.ndarray, states: np.ndarray, time: np.ndarray, rates: np.ndarray
) -> np.ndarray:
    """Changes of states at times, and of integrated rates, one below the other (m, 2).

    Without their means: a sensor's bias changes all by the same.
    """
    summed = cumulative_trapezoid(rates, time, axis=0, initial=0.0)
    both = np.diff(np.stack([states, _at(Stream(time, summed, ""), since)]), axis=1)
    mean = np.sum(both, axis=1, keepdims=True) / max(both.shape[1], 1)
    return (both - mean).reshape(2, -1).T


def _averaged(stream: Stream, time: np.ndarray) -> np.ndarray:
    """A sensor's means about times (n, k); NaN where its nearest value is far off.

    So no value of a slow sensor counts for several rows.
    """
    usual, own = (float(np.median(np.diff(t))) for t in (time, stream.time))
    count = max(round(usual / own), 1)
    offsets = own * (np.arange(count) - 0.5 * (count - 1))
    means = np.mean([_at(stream, time + offset) for offset in offsets], axis=0)
    after = np.clip(np.searchsorted(stream.time, time), 1, len(stream.time) - 1)
    nearest = np.abs(stream.time[[after - 1, after]] - time).min(axis=0)
    return np.where((nearest < 0.51 * usual)[:, None], means, np.nan)


def _at(stream: Stream, time: np.ndarray) -> np.ndarray:
    """A sensor's values at times (n, k)."""
    return np.stack([np.interp(time, stream.time, v) for v in stream.values.T], axis=1)
