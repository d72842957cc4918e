"""The residual: measured minus modelled acceleration, and the coefficients behind it.

Accelerations are compared along the wing, normal to it and in pitch; the
coefficients C_L, C_D, C_M refer to ½ρV²S_w (the moment without a chord) and come
with the variables that they may depend on: the article's data set.
"""

from collections.abc import Sequence

import numpy as np

from glider.compiled.replay import flow_at
from glider.physics.effects import FIELD_VARIABLES, NO_FIELD, Field
from glider.physics.effects.field import COEFFICIENTS
from glider.sysid.replay.record import Record
from glider.sysid.replay.signals import node_signals, trimmed, true_nodes
from glider.sysid.replay.theta import OFFSET
from glider.sysid.result import ResidualTable

_EDGE = 3
"""Rows at both ends of a flight where an acceleration is not known well."""


def flow_variables(record: Record, theta: np.ndarray) -> np.ndarray:
    """Returns FIELD_VARIABLES along a flight, (n, 9), at its smoothed states."""
    kinds, dynamics = record.layout.compiled_kinds, record.layout.dynamics(theta)
    nodes, signals = true_nodes(record, theta), node_signals(record, theta)
    flow = flow_at(kinds, record.time, nodes, *signals, dynamics, NO_FIELD)
    columns = _variables(record, nodes, flow, signals[1])
    return np.stack([columns[name] for name in FIELD_VARIABLES], axis=1)


def _variables(
    record: Record, nodes: np.ndarray, flow: np.ndarray, rate: np.ndarray
) -> dict[str, np.ndarray]:
    """Columns of FIELD_VARIABLES from states, flow and elevator rate."""
    return {
        "x": nodes[:, 0],
        "z": nodes[:, 1],
        "t": record.time,
        "pitch": nodes[:, 2],
        "V": flow[:, 0],
        "alpha": np.arctan2(flow[:, 1], flow[:, 2]),
        "pitchdot": nodes[:, 6],
        "elevator": flow[:, 8],
        "elevator_rate": rate,
    }


def flow_along(
    record: Record, theta: np.ndarray, field: Field, trim: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns smoothed true states (n, num_states) and the model's flow there (n, 9).

    The flow's columns are those of `compiled.replay.log_flow`.
    """
    theta, shift = trimmed(record, theta, trim)
    nodes = true_nodes(record, theta).copy()
    nodes[:, OFFSET] = shift
    elevator, rate = node_signals(record, theta)
    kinds, dynamics = record.layout.compiled_kinds, record.layout.dynamics(theta)
    values = flow_at(kinds, record.time, nodes, elevator, rate, dynamics, field)
    return nodes, values


def make_table(
    records: Sequence[Record],
    theta: np.ndarray,
    trims: Sequence[float],
    field: Field = NO_FIELD,
) -> ResidualTable:
    """Stacks the residual of flights, each with its elevator trim [rad]."""
    flights = [
        _columns(record, theta, trim, field)
        for record, trim in zip(records, trims, strict=True)
    ]
    stacked = {name: np.concatenate([f[name] for f in flights]) for name in flights[0]}
    return ResidualTable(
        variables={name: stacked[name] for name in (*FIELD_VARIABLES, "alphadot")},
        residual=stacked["residual"],
        coefficients={name: stacked[f"{name} measured"] for name in COEFFICIENTS},
        modelled={name: stacked[f"{name} modelled"] for name in COEFFICIENTS},
        flight=np.repeat(np.arange(len(flights)), [len(f["t"]) for f in flights]),
        names=tuple(record.name for record in records),
        noise=stacked["noise"],
        unit=stacked["unit"],
    )


def _columns(
    record: Record, theta: np.ndarray, trim: float, field: Field
) -> dict[str, np.ndarray]:
    """The columns of a table along one flight, without its ends."""
    index = record.layout.index
    mass, area, inertia, density, gravity = (
        theta[index["parameters", name]]
        for name in ("mass", "wing_area", "pitch_inertia", "air_density", "gravity")
    )
    nodes, flow = flow_along(record, theta, field, trim)
    speed, _, _, air_x, air_z = flow[:, :5].T
    columns = _variables(record, nodes, flow, node_signals(record, theta)[1])
    columns["alpha"] = np.unwrap(columns["alpha"])
    columns["alphadot"] = np.gradient(columns["alpha"], record.time)
    sine, cosine = np.sin(nodes[:, 2]), np.cos(nodes[:, 2])
    x, z, angular = (record.acceleration - flow[:, 5:8]).T
    columns["residual"] = np.column_stack(
        [x * cosine - z * sine, x * sine + z * cosine, angular]
    )
    x, z, angular = record.acceleration_std.T
    columns["noise"] = np.column_stack(
        [np.hypot(x * cosine, z * sine), np.hypot(x * sine, z * cosine), angular]
    )
    pressure = 0.5 * density * speed**2 * area
    columns["unit"] = np.column_stack([pressure / mass, pressure / inertia])
    for label, a in (("measured", record.acceleration), ("modelled", flow[:, 5:8])):
        force_x, force_z = mass * a[:, 0], mass * (a[:, 1] + gravity)
        lift = (force_z * air_x - force_x * air_z) / speed
        drag = -(force_x * air_x + force_z * air_z) / speed
        columns[f"c_lift {label}"] = lift / pressure
        columns[f"c_drag {label}"] = drag / pressure
        columns[f"c_moment {label}"] = inertia * a[:, 2] / pressure
    return {name: values[_EDGE:-_EDGE] for name, values in columns.items()}
