"""What many points become in a figure: bins, few points, limits of an axis."""

from collections.abc import Sequence

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
    low, high = np.quantile(values, [quantile, 1.0 - quantile])
    if around is not None:
        low = min(low, around)
        high = max(high, around)
    pad = margin * (high - low) or 0.05 * abs(high) or 1.0
    return float(low - pad), float(high + pad)


def thin(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of at most _POINTS finite points, the same ones each time."""
    keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if keep.size > _POINTS:
        keep = np.sort(np.random.default_rng(0).choice(keep, _POINTS, replace=False))
    return keep


def binned_quantiles(
    x: np.ndarray,
    y: np.ndarray,
    quantiles: Sequence[float] = (0.5,),
    bins: int = 18,
    fewest: int = 8,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean x (m,) and quantiles of y (q, m) of equally wide bins.

    Bins that hold fewer than so many points are omitted.
    """
    keep = np.isfinite(x) & np.isfinite(y)
    x = x[keep]
    y = y[keep]
    if x.size < fewest:
        return np.zeros(0), np.zeros((len(quantiles), 0))
    low, high = np.quantile(x, [0.005, 0.995])
    index = np.digitize(x, np.linspace(low, high, bins + 1)[1:-1])
    count = np.bincount(index, minlength=bins)
    full = count >= fewest
    first = np.cumsum(count) - count
    # Linear between the values of a bin in their order.
    place = first[full] + np.outer(quantiles, count[full] - 1)
    below = np.floor(place).astype(int)
    ordered = y[np.lexsort((y, index))]
    step = ordered[np.ceil(place).astype(int)] - ordered[below]
    means = np.bincount(index, x, bins)[full] / count[full]
    return means, ordered[below] + (place - below) * step
