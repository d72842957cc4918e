"""Peaks of an unmodelled field and their standard errors."""

import math

import numpy as np

from glider.physics.effects.field import FieldData
from glider.sysid.result import Estimate


def find_peaks(data: FieldData, covariance_of_all: np.ndarray) -> dict[str, Estimate]:
    """Returns the largest value of each term of a field over one variable.

    Standard errors follow from the weights' covariance C. With the field
    f = b(ξ)·w, to first order a peak's height moves with δw as b·δw, its place
    as -b'·δw / f'': their variances are b'C b and b''C b' / f''². A peak at the
    edge of the flown range is not one of the field: its place has no error (NaN).
    """
    variable = data.variables[0]
    centers, width = np.array(data.centers)[:, 0], data.widths[0]
    grid = np.linspace(centers.min(), centers.max(), 401)
    found = {}
    for k, (term, values) in enumerate(data.weights.items()):
        weights = np.array(values)
        of_term = slice(k, None, len(data.weights))
        covariance = covariance_of_all[of_term, of_term]
        scaled = (grid[:, None] - centers) / width
        basis = np.exp(-0.5 * scaled**2)
        peak = int(np.argmax(np.abs(basis @ weights)))
        height, place = basis[peak], grid[peak]
        slope = -scaled[peak] / width * height
        curvature = (scaled[peak] ** 2 - 1.0) / width**2 * height @ weights
        is_inside = 0 < peak < len(grid) - 1
        unit = "m/s" if term.startswith("wind") else ("m" if "moment" in term else "-")
        found[f"{term}_peak"] = Estimate(
            value=float(height @ weights),
            std=float(np.sqrt(height @ covariance @ height)),
            unit=unit,
        )
        found[f"{term}_peak_at_{variable}"] = Estimate(
            value=float(place),
            std=float(np.sqrt(slope @ covariance @ slope) / abs(curvature))
            if is_inside and curvature != 0.0
            else math.nan,
            unit=_UNITS[variable],
        )
    return found


_UNITS = {
    "x": "m",
    "z": "m",
    "t": "s",
    "pitch": "rad",
    "V": "m/s",
    "alpha": "rad",
    "pitchdot": "rad/s",
    "elevator": "rad",
    "elevator_rate": "rad/s",
}
