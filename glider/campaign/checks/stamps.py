"""Stamps that jitter about the even steps at which the cameras measured.

A computer that stamps poses on receipt stamps them late, by another delay each; at
7 m/s a millisecond is 7 mm. A smooth motion shows which times are right: those at which
fourth differences of the position are smaller.

The stamps of a log are parted at gaps. In each part the rows are ticks of an even
clock, but for frames that were lost. Its times replace the stamps of the whole log if
they make the motion smoother by more than chance does.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from glider.campaign.checks.masks import find_repeats
from glider.campaign.checks.motion import robust_std
from glider.campaign.checks.rows import find_filled
from glider.campaign.checks.smoothness import fourth_differences

_LEAST_GAIN = 10.0
"""Log-likelihood by which even steps must explain the position better than the stamps
do [nats], odds of 22,000 to one: tests/campaign/checks/test_stamps.py holds what the
flights of the samples show."""
_LEAST_JITTER = 2e-5  # At 10 m/s 0.2 mm, less than cameras' noise [s].
_LEAST_RATIO = 1e-3  # Of two noises: that of the stamps may be zero.
_SURELY = 6.0  # Standard deviations that are not by chance.
_MOST_LOST = 5  # Frames lost at one place, which the motion counts.
_AROUND = 9  # Rows that show the way of one.
_GAP = 4.0  # Steps of a gap that parts a log in two, each on a clock of its own.
_DELAYED = 13  # Rows within which a delay has passed.
_SAME_RATE = 0.02  # Share by which a rate of frames may be off, as in `check_rates`.
_FEWEST = 20  # Rows from which a rate of frames is taken, at least.
_LONG = 241  # Rows over which a clock is even: frames may be lost while nothing moves.


class _EvenTimes(NamedTuple):
    """Times of poses at even steps, some of which were lost.

    Attributes:
        stamps: (n,) of the rows that show the body [s].
        time: (n,) of these rows [s].
        rate: of the cameras, as specified or as the stamps show it [Hz].
        jitter: standard deviation of the stamps about the times [s].
    """

    stamps: np.ndarray
    time: np.ndarray
    rate: float
    jitter: float

    def at(self, others: np.ndarray) -> np.ndarray:
        """Times (k,) of any rows of the log, by their stamps (k,)."""
        return others + np.interp(others, self.stamps, self.time - self.stamps)


def find_even_times(
    logs: Sequence[tuple[np.ndarray, np.ndarray]], rate: float | None
) -> tuple[list[_EvenTimes | None], str]:
    """Finds the even times of logs, None where their stamps are as good.

    Args:
        logs: increasing stamps (n,) [s] and positions (n, k) [m] by the same cameras.
        rate: of the cameras [Hz]; None: what the stamps of all logs show.

    Returns:
        The times of each log, and the sentence that reports them; "" if all are None.
    """
    found = [_even_times_of(*log, rate) for log in logs]
    rates = [even.rate for even in found if even is not None]
    if not rates:
        return found, ""
    doubt = ""
    if rate is None:
        rate = np.median(rates)
        found = [_even_times_of(*log, rate) for log in logs]
        doubt = (
            "; their rate was estimated, and all speeds and forces depend on it: "
            "specify 'pose_rate'"
        )
    jitters = [even.jitter for even in found if even is not None]
    jitter = math.sqrt(np.mean(np.square(jitters)))
    return found, (
        f"The times of {len(jitters)} of {len(logs)} logs jitter by "
        f"{1e3 * jitter:.2g} ms: even steps of {rate:.4g} Hz, at which the glider "
        f"moves more smoothly, were restored{doubt}."
    )


def _even_times_of(
    time: np.ndarray, position: np.ndarray, rate: float | None
) -> _EvenTimes | None:
    """The even times of one log, by the rows that show the body where it is.

    Of m rows between gaps whose noise falls from σ to σ' the log-likelihood gains
    m log(σ / σ') in each column.
    """
    shown = np.isfinite(position).all(axis=1) & ~find_repeats(position, 2)
    shown[shown] = ~find_filled(time[shown], position[shown])
    stamps = time[shown]
    place = position[shown]
    if len(stamps) < _FEWEST:
        return None

    even = stamps.copy()
    gain = 0.0
    rates = []
    for rows in _split_at_gaps(stamps):
        if len(rows) < _FEWEST:
            continue
        ticks = np.arange(len(rows)) + _find_lost(place[rows])
        even[rows], step = _restore(stamps[rows], ticks, rate)
        rates.append(1.0 / step)
        noise = _measure_noise(stamps[rows], place[rows])
        quiet = _measure_noise(even[rows], place[rows])
        is_noisy = quiet > 0.0  # Without noise nothing is likelier.
        ratio = np.maximum(noise[is_noisy] / quiet[is_noisy], _LEAST_RATIO)
        gain += len(rows) * np.sum(np.log(ratio))

    jitter = np.std(stamps - even)
    if gain < _LEAST_GAIN or jitter < _LEAST_JITTER:
        return None
    return _EvenTimes(stamps, even, np.median(rates), jitter)


def _restore(
    stamps: np.ndarray, ticks: np.ndarray, rate: float | None
) -> tuple[np.ndarray, float]:
    """Even times of rows between gaps.

    Args:
        stamps: (n,) [s].
        ticks: (n,) of the clock, increasing by 1 and by the frames that were lost.
        rate: of the cameras [Hz], which the clock has if it is about that.

    Returns:
        The times (n,) [s], the stamps themselves where frames were lost and the motion
        does not show it, and the step of the clock [s].
    """
    # The median step between rows that are half a flight, or half a window, apart.
    half = min(len(stamps), _LONG) // 2
    duration = stamps[half:] - stamps[:-half]
    passed = ticks[half:] - ticks[:-half]
    step = np.median(duration / passed)
    jitter = robust_std(np.diff(stamps - step * ticks)) / math.sqrt(2.0)
    off = max(_SAME_RATE, _SURELY * jitter / np.ptp(stamps))
    if rate is not None and abs(step * rate - 1.0) < off:
        step = 1.0 / rate

    even = step * ticks
    late = stamps - even
    if len(stamps) > _LONG:
        from scipy.ndimage import median_filter  # It takes long to import.

        return even + median_filter(late, _LONG, mode="nearest"), step

    # Frames that were lost unseen make the last rows later than the first.
    third = len(stamps) // 3
    later = np.median(late[-third:]) - np.median(late[:third])
    spread = jitter * math.sqrt(np.pi / third)  # Of the difference of two medians.
    if abs(later) < 0.5 * step + _SURELY * spread:
        return even + np.mean(late), step
    return stamps, step


def _split_at_gaps(time: np.ndarray) -> list[np.ndarray]:
    """Indices of the rows between gaps of stamps (n,).

    A delay passes within a few rows; after lost frames all rows remain late.
    """
    rows = np.arange(len(time))
    late = time / np.median(np.diff(time)) - rows
    following = np.pad(late, (0, _DELAYED - 1), mode="edge")
    lasting = sliding_window_view(following, _DELAYED).min(axis=1)
    gaps = np.flatnonzero(np.diff(lasting) > _GAP) + 1
    return np.split(rows, gaps)


def _find_lost(position: np.ndarray) -> np.ndarray:
    """Numbers (n,) of frames lost so far, by positions (n, k).

    A moving body jumps by their way: by a whole number of its usual ways from row to
    row.
    """
    way = np.linalg.norm(np.diff(position, axis=0), axis=1)
    around = np.pad(way, _AROUND // 2, mode="reflect")
    usual = np.median(sliding_window_view(around, _AROUND), axis=1)
    noise = np.linalg.norm(_measure_noise(np.arange(len(position)), position))
    is_sure = 0.5 * usual > _SURELY * noise  # Half a step more is no noise.
    steps = np.round(way / np.where(is_sure, usual, np.inf))
    lost = np.clip(steps - 1.0, 0.0, _MOST_LOST)
    return np.append(0, np.cumsum(lost.astype(int)))


def _measure_noise(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of the noise of a position (n, k) while it moves fast.

    A body that rests shows nothing of the times.
    """
    differences, _ = fourth_differences(time, position)  # Of each five rows.
    ways = np.linalg.norm(position[4:] - position[:-4], axis=1)
    is_fast = ways > 0.5 * np.quantile(ways, 0.95)
    return robust_std(differences[is_fast])
