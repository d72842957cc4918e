"""What many points become in a figure: bins, few points, limits of an axis."""

import numpy as np

_POINTS = 1500  # Largest number of points that a cloud shows; its medians take all.


def bounds(
    values: np.ndarray,
    margin: float = 0.08,
    quantile: float = 0.004,
    around: float | None = None,
) -> tuple[float, float] | None:
    """Limits of an axis that shows the points; a few outliers do not squash it.

    Args:
        values: of the points; there are no limits where none is finite.
        margin: added at both ends, relative to the range.
        quantile: of points that may lie outside at each end.
        around: a value that must lie inside.
    """
    values = values[np.isfinite(values)]
    if values.size == 0:
        return None
    ends = np.quantile(values, [quantile, 1.0 - quantile])
    if around is not None:
        ends = np.append(ends, around)
    low = float(ends.min())
    high = float(ends.max())
    pad = margin * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


def thin(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of at most _POINTS finite points, the same ones each time."""
    keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if keep.size > _POINTS:
        keep = np.sort(np.random.default_rng(0).choice(keep, _POINTS, replace=False))
    return keep


_BINS = 18
_FEWEST = 8  # Points of a bin that has a median.


def binned_medians(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean x (m,) and median y (m,) of equally wide bins; of few points there is none.

    A few outliers in x do not widen the bins.
    """
    keep = np.isfinite(x) & np.isfinite(y)
    x = x[keep]
    y = y[keep]
    means = []
    medians = []
    if x.size >= _FEWEST:
        low, high = np.quantile(x, [0.005, 0.995])
        index = np.digitize(x, np.linspace(low, high, _BINS + 1)[1:-1])
        for k in range(_BINS):
            own = index == k
            if np.count_nonzero(own) >= _FEWEST:
                means.append(x[own].mean())
                medians.append(np.median(y[own]))
    return np.array(means), np.array(medians)
