"""Stability and control derivatives in a result, see `glider.physics.derivatives`."""

import dataclasses
import itertools

import numpy as np

from glider.physics.derivatives import Condition, calc_derivatives, find_steady_glide
from glider.sysid.result import Derivatives, Estimate, Result


def with_derivatives(
    result: Result, trim: float | None = None, chord: float | None = None
) -> Result:
    """A result with the derivatives of its corrected model.

    Args:
        result: of closing the loop.
        trim: airspeed of the steady glide that they are taken at [m/s]. They are at
            the median state of the flights without one, and where there is no such
            glide.
        chord: reference length [m]; by default the arm of the tail.
    """
    model = result.model
    flown = result.residual_after.variables
    names = "V", "alpha", "elevator", "pitch", "t", "x", "z"
    speed, alpha, elevator, pitch, *place = (
        float(np.nanmedian(flown[n])) for n in names
    )
    at = Condition(speed, alpha, 0.0, -elevator, -pitch - alpha, *place)
    words = "median state of the flights"
    median = at
    if trim is not None:
        at = find_steady_glide(model, trim, at)
        none = f"{words}, as the model has no steady glide at {trim:g} m/s"
        words = none if at is median else "steady glide"

    length = chord or model.parameters.hinge_offset + model.parameters.elevator_offset
    numbers = calc_derivatives(model, at, length, result.covariance)
    slopes = (("", "-"), ("_alpha", "1/rad"), ("_q", "1/rad"), ("_delta_e", "1/rad"))
    rows = zip(itertools.product(("C_L", "C_D", "C_m"), slopes), *numbers, strict=True)
    found = Derivatives(
        condition=words,
        airspeed_m_s=float(at.airspeed),
        alpha_rad=float(at.alpha),
        delta_e_rad=float(at.elevator),
        area_m2=model.parameters.wing_area,
        length_m=length,
        length="chord" if chord else "arm of the tail",
        values={c + by: Estimate(float(v), float(s), u) for (c, (by, u)), v, s in rows},
    )
    return dataclasses.replace(result, derivatives=found)
