"""Results as closing the loop may give them, made by hand."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.checks.masks import ExcludedRows
from glider.physics.effects import KINDS
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.sysid.result import (
    OTHER_SHAPE,
    PERFECT,
    Air,
    Difference,
    EquationErrors,
    Errors,
    Estimate,
    FlightNames,
    FoundEffect,
    HeldOutFlight,
    MeasurementNoise,
    PathErrors,
    Residual,
    ResidualTable,
    Result,
    RolloutErrors,
    Spread,
    UnlikeFlights,
)

WIND = FoundEffect(
    kind="wind",
    words="a steady wind",
    coefficients={
        "x": Estimate(value=-0.59987, std=0.00312, unit="m/s"),
        "z": Estimate(value=0.0502, std=0.0009, unit="m/s"),
    },
    evidence=21345.6,
    share_of_residual=0.93,
    indistinguishable_from=("frame_tilt",),
    depends_on=("V", "alpha"),
    inclusion=0.97,
)
UNEXPLAINED = FoundEffect(
    kind="unexplained",
    words="no effect of the library: the air moves with x",
    coefficients={"wind_z_peak": Estimate(value=0.98, std=0.0, unit="m/s")},
    evidence=5000.0,
    share_of_residual=0.99,
    indistinguishable_from=(),
    link="air",
    depends_on=("x",),
)


VENT = FreeFunction(
    kind="unexplained",
    variables=["x"],
    centers=[[-3.0], [-2.0], [-1.0]],
    widths=[0.5],
    weights={"wind_x": [0.0, 0.0, 0.0], "wind_z": [0.1, 1.0, 0.1]},
)


def errors_of(tangential, normal, pitch, rms, end, pitch_rms, along):
    return Errors(
        equation=EquationErrors(tangential=tangential, normal=normal, pitch=pitch),
        rollout=RolloutErrors(
            position_rms_m=rms, position_end_m=end, pitch_rms_rad=pitch_rms
        ),
        rollout_measured_pitch=PathErrors(position_rms_m=along),
    )


def make_errors(scale):
    """Returns errors of a few decimetres, times the scale."""
    values = (0.8, 1.9, 14.0, 0.413, 0.9, 0.2, 0.22)
    return errors_of(*(scale * value for value in values))


def all_errors(value):
    return errors_of(*[value] * 7)


PERFECT_ERRORS = errors_of(0.001, 0.002, 0.03, 5.66e-4, 5.01e-4, 2.5e-3, 5.66e-4)


def make_flight(name, miss):
    time = np.linspace(0.0, 0.8, 50)
    pose = np.stack([6.0 * time - 3.5, 0.3 - time**2, 0.5 * np.sin(4.0 * time)], axis=1)
    drift = np.outer(time**2, [1.0, -1.0, 0.5])
    return HeldOutFlight(
        name=name,
        time=time,
        measured=pose,
        flown={
            "nominal": pose + drift,
            "refitted": pose + 0.5 * drift,
            "corrected": pose + miss * drift,
        },
        fitted_until=0.16,
    )


def make_table(slope, rng):
    alpha, speed = rng.uniform(-0.1, 1.0, 300), rng.uniform(3.0, 8.0, 300)
    lift = np.sin(2.0 * alpha)
    trend = np.outer(speed - 5.0, [0.1, 1.0, 4.0])
    return ResidualTable(
        variables={
            "alpha": alpha,
            "V": speed,
            "x": rng.uniform(-3.5, 1.0, 300),
            "t": np.tile(np.linspace(0.0, 0.8, 50), 6),
            **dict.fromkeys(("z", "pitch", "elevator"), np.zeros(300)),
        },
        residual=slope * trend + rng.normal(size=(300, 3)),
        coefficients={"c_lift": lift, "c_drag": lift**2, "c_moment": 0.1 * lift},
        modelled={"c_lift": lift, "c_drag": lift**2, "c_moment": 0.1 * lift},
        flight=np.repeat(np.arange(6), 50),
        names=tuple(f"flight_1{i:02d}.csv" for i in range(6)),
        noise=np.tile([0.001, 0.002, 0.03], (300, 1)),
    )


def make_unlike(scale, **changes):
    """Returns the errors on two faster flights, times the scale of the corrected."""
    errors = {
        "nominal": make_errors(1.2),
        "refitted": make_errors(0.7),
        "corrected": make_errors(scale),
        PERFECT: PERFECT_ERRORS,
    }
    position = errors["corrected"].position_rms_m
    ratio = position / PERFECT_ERRORS.position_rms_m
    unlike = UnlikeFlights(
        flights=("flight_001.csv", "flight_104.csv"),
        difference=Difference(what="V at launch", unit="m/s", value=8.12, others=6.9),
        errors=errors,
        left=Residual(
            position_m=position, ratio_to_floor=ratio, chance=0.5, depends_on=()
        ),
    )
    return dataclasses.replace(unlike, **changes)


def make_result(**changes):
    """Returns what closing the loop on a windy campaign may give."""
    rng = np.random.default_rng(0)
    result = Result(
        campaign="head_wind",
        path=Path("campaigns/head_wind"),
        flights=FlightNames(
            fit=("flight_001.csv", "flight_002.csv"),
            held_out=tuple(f"flight_1{i:02d}.csv" for i in range(6)),
        ),
        verdict="effect_found",
        reason="With the wind the held-out flights are flown to the noise.",
        effects=(WIND,),
        errors={
            "nominal": make_errors(1.0),
            "refitted": make_errors(0.5),
            "corrected": make_errors(0.001),
            PERFECT: PERFECT_ERRORS,
        },
        left=Residual(
            position_m=5.3e-3,
            ratio_to_floor=13.25,
            ratio_along_pitch=9.5,
            chance=1e-4,
            depends_on=("alpha",),
        ),
        unlike=make_unlike(0.0015),
        spreads={
            "elevator_trim": Spread(
                std=0.0203,
                unit="rad",
                values={"flight_001.csv": 0.015, "flight_002.csv": -0.031},
            )
        },
        air=Air(std_m_s=0.12, correlation_s=0.31),
        vehicle={"wing_area_per_mass": Estimate(value=1.106, std=0.021, unit="m²/kg")},
        knows_forces=True,
        warnings=("flight_002.csv: the clock of the pose drifts by 0.3 %.",),
        set_aside=(
            ExcludedRows(file="flight_007.csv", rows="all", why="it stands still."),
            ExcludedRows(
                file="flight_001.csv", rows="41-80", why="the pose is frozen."
            ),
        ),
        noise=MeasurementNoise(position_m=4e-4, pitch_rad=2.5e-3),
        evidence_threshold=6.6,
        model=GliderModel(effects=(KINDS["wind"](x=-0.6, z=0.05),)),
        held_out=tuple(
            make_flight(f"flight_1{i:02d}.csv", 0.001 * i) for i in range(6)
        ),
        residual_before=make_table(1.0, rng),
        residual_after=make_table(0.0, rng),
        seconds={"smooth": 0.31, "trace": 5.2},
        version="0.1.0",
        settings={"seed": 0, "effects": None, "notes": ["A mass of 1 kg is assumed."]},
    )
    return dataclasses.replace(result, **changes)


def diverged():
    """Returns a result with numbers that are missing, infinite or enormous."""
    flight = make_flight("flight_100.csv", 0.0)
    flown = {
        "nominal": 1e300 ** np.linspace(0.0, 1.0, 50)[:, None] * np.ones((1, 3)),
        "refitted": np.full((50, 3), np.nan),
        "corrected": flight.measured,
    }
    table = make_result().residual_before
    residual = table.residual.copy()
    residual[:3] = [[np.nan] * 3, [np.inf] * 3, [1e200] * 3]
    return make_result(
        errors={
            "nominal": all_errors(math.inf),
            "refitted": all_errors(1e300),
            "corrected": errors_of(8e-4, 1.9e-3, math.nan, 4.13e-4, 9e-4, 2e-4, 2.2e-4),
        },
        effects=(
            dataclasses.replace(
                WIND,
                coefficients={"x": Estimate(value=1.0, std=math.nan, unit="m/s")},
                evidence=math.inf,
            ),
        ),
        left=Residual(position_m=math.nan, ratio_to_floor=math.inf, depends_on=()),
        unlike=make_unlike(
            math.inf,
            flights=("flight_001.csv",),
            left=Residual(position_m=math.inf, ratio_to_floor=math.nan, depends_on=()),
            diverged=("flight_104.csv",),
        ),
        air=Air(std_m_s=math.nan, correlation_s=math.inf),
        spreads={
            "wind": Spread(
                std=math.nan, unit="m/s", values={"flight_001.csv": math.nan}
            )
        },
        vehicle={"wing_area": Estimate(value=math.nan, std=math.inf, unit="m²")},
        noise=MeasurementNoise(position_m=4e-4, pitch_rad=math.nan),
        held_out=(dataclasses.replace(flight, flown=flown),),
        residual_before=dataclasses.replace(table, residual=residual),
    )


VARIANTS = {
    "effect": make_result(),
    "two effects": make_result(effects=(WIND, UNEXPLAINED), verdict="partly_explained"),
    "unexplained": make_result(
        verdict="unexplained",
        effects=(UNEXPLAINED,),
        model=GliderModel(free_functions=(VENT,)),
    ),
    "partly explained": make_result(
        verdict="partly_explained",
        effects=(dataclasses.replace(WIND, shape=OTHER_SHAPE),),
        unlike=make_unlike(0.02),
        warnings=(make_unlike(0.02).warning,),
    ),
    "not trusted": make_result(
        verdict="not_trusted",
        errors={
            "nominal": None,
            "refitted": make_errors(0.5),
            "corrected": make_errors(0.6),
            PERFECT: PERFECT_ERRORS,
        },
    ),
    "no effect": make_result(
        verdict="no_effect",
        effects=(),
        spreads={},
        vehicle={},
        warnings=(),
        set_aside=(),
        held_out=(),
        unlike=None,
    ),
    "unknown vehicle": make_result(
        errors={
            "nominal": None,
            "refitted": make_errors(0.5),
            "corrected": make_errors(0.01),
        },
        held_out=(),
        knows_forces=False,
    ),
    "diverged": diverged(),
}


def errors_json(scale):
    """Returns what report.json has of make_errors(scale)."""
    return {
        "equation": {
            "tangential": pytest.approx(scale * 0.8),
            "normal": pytest.approx(scale * 1.9),
            "pitch": pytest.approx(scale * 14.0),
        },
        "rollout": {
            "position_rms_m": pytest.approx(scale * 0.413),
            "position_end_m": pytest.approx(scale * 0.9),
            "pitch_rms_rad": pytest.approx(scale * 0.2),
        },
        "rollout_measured_pitch": {"position_rms_m": pytest.approx(scale * 0.22)},
    }
