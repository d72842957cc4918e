"""What many points become in a figure: bins, few points, limits of an axis."""

from collections.abc import Sequence

import numpy as np

_POINTS = 1500  # Largest number of points that a cloud shows; its medians take all.


def bounds(values: np.ndarray, quantile: float = 0.004) -> tuple[float, float] | None:
    """Limits of an axis that shows the points; there are none where none is finite.

    So many of them may lie outside at each end: outliers do not squash it.
    """
    values = values[np.isfinite(values)]
    if values.size == 0:
        return None
    low, high = np.quantile(values, [quantile, 1.0 - quantile]).tolist()
    pad = 0.08 * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


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
    """Mean x (m,) and quantiles of y (q, m) of bins of equally many points.

    They hold at least so many; of fewer points there is no bin.
    """
    keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    order = keep[np.argsort(x[keep], kind="stable")]
    count = min(bins, len(order) // fewest)
    own = np.array_split(order, count) if count else []
    means = np.array([x[rows].mean() for rows in own])
    found = [np.quantile(y[rows], quantiles) for rows in own]
    return means, np.reshape(found, (-1, len(quantiles))).T
