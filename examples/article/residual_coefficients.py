"""Lesson 3: how is the flat plate wrong? A residual by radial basis functions.

The article's section "Residual function". The mechanics stay, and of the coefficients
only what the flat plate lacks is learned from flights:

    c(ξ) = c_plate(ξ) + ψ(ξ)ᵀ w,   ξ = (α, φ),   w = argmin ‖Φ w - y‖² + γ ‖w‖²

with Gaussians ψ on 5 x 5 centers over angle of attack and elevator and a constant: 26
weights each for C_L, C_D and C_M, by one linear solve; and 126 with airspeed. The
flights are those of a sample campaign, as cameras see them: positions are smoothed,
differentiated twice and compared with the plate, as in Moore's thesis. Held-out
flights, flown again by the plant with the residual, show what it is worth. No weight
says why the plate is wrong: `glider close-the-loop attached_lift` does.

    python examples/article/residual_coefficients.py --figure coefficients.png
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import UnivariateSpline

from course import SHOWN, compare, picture, rates_of, read_options, start
from glider import Campaign, GliderModel, load_campaign, refly
from glider.campaign.logs import Flight
from glider.campaign.motion_capture import MotionCapture
from glider.physics.effects.free_functions import COEFFICIENTS, FreeFunction
from glider.report.plots.style import BLUE, RED

ARTICLE = {
    "C_L: data, flat plate, plate with residual": SHOWN,
    "C_L: the same beside the richer model": SHOWN,
    "C_D and C_M": "described",
    "Samples of the coefficients": "3.9e3",
    "Weights of a coefficient": "26 and 126",
    "C_L, left by the plate, by 26 and by 126 weights (RMS)": "-",
    "Held-out flights, position, the same (RMS)": "-",
}

RIDGE = 0.1
"""γ of the article."""

CAPTURE = MotionCapture()
"""Of the campaign: how far a reading scatters."""


# ------------------------------------------------------------- coefficients of flights


class Samples(NamedTuple):
    """Coefficients along some flights, N samples."""

    variables: np.ndarray  #: (N, 3) angle of attack, elevator [rad], airspeed [m/s].
    measured: np.ndarray  #: (N, 3) C_L, C_D, C_M [-, -, m].
    plate: np.ndarray  #: (N, 3) those of the flat plate in the same states.


def samples_of(flights: Sequence[Flight], plate: GliderModel) -> Samples:
    """Returns the coefficients along flights of a glider that is nominally `plate`."""
    parts = [_samples_of(flight, plate) for flight in flights]
    return Samples(*map(np.concatenate, zip(*parts, strict=True)))


def _samples_of(flight: Flight, plate: GliderModel) -> Samples:
    readings = np.column_stack([flight.pose, flight.elevator])
    curves = [
        UnivariateSpline(flight.time, reading, k=5, s=len(reading) * std**2)
        for reading, std in zip(readings.T, CAPTURE.std, strict=True)
    ]
    times = flight.time[3:-3]  # A curve bends as it likes at its ends.
    x, z, pitch, elevator = (curve(times) for curve in curves)
    xdot, zdot, pitchdot, rate = (curve(times, 1) for curve in curves)
    measured = [curve(times, 2) for curve in curves[:3]]
    state = np.array([x, z, pitch, elevator, xdot, zdot, pitchdot])
    rates = rates_of(plate, state, rate)
    alpha = np.arctan2(-zdot, xdot) - pitch
    variables = np.column_stack([alpha, elevator, np.hypot(xdot, zdot)])
    return Samples(
        variables,
        coefficients_of(np.array(measured), xdot, zdot, plate),
        coefficients_of(rates[4:7], xdot, zdot, plate),
    )


def coefficients_of(
    accelerations: np.ndarray, xdot: np.ndarray, zdot: np.ndarray, model: GliderModel
) -> np.ndarray:
    """Returns accelerations (3, N) as C_L, C_D, C_M over ½ ρ V² S_w, (N, 3).

    Lift is the force without weight across the velocity, drag that against it. The
    moment has no chord in it and turns the nose down, as all angles here do.
    """
    p = model.parameters
    speed = np.hypot(xdot, zdot)
    force_x = p.mass * accelerations[0]
    force_z = p.mass * (accelerations[1] + p.gravity)
    lift = (force_z * xdot - force_x * zdot) / speed
    drag = -(force_x * xdot + force_z * zdot) / speed
    moment = p.pitch_inertia * accelerations[2]
    pressure = 0.5 * p.air_density * speed**2 * p.wing_area
    return (np.array([lift, drag, moment]) / pressure).T


# ---------------------------------------------------------------------- the residual


class Residual(NamedTuple):
    """Gaussians, a constant, and their weights."""

    centers: np.ndarray  #: (M - 1, d)
    widths: np.ndarray  #: (d,)
    weights: np.ndarray  #: (M, 3) of C_L, C_D, C_M.


def features(values: np.ndarray, centers: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Returns ψ, (N, M), at values (N, d) of the variables."""
    apart = (values[:, None, :] - centers) / widths
    gaussians = np.exp(-0.5 * np.sum(apart**2, axis=2))
    return np.column_stack([gaussians, np.ones(len(values))])


def gaussian_grid(speeds: np.ndarray | None = None) -> Residual:
    """Returns the article's Gaussians with weights of zero.

    5 x 5 centers over α in [0, π] and elevator in [-π/4, π/4], of covariance 0.1 I;
    with 5 speeds [m/s], 5 x 5 x 5.
    """
    axes = [np.linspace(0.0, np.pi, 5), np.linspace(-np.pi / 4, np.pi / 4, 5)]
    widths = [np.sqrt(0.1), np.sqrt(0.1)]
    if speeds is not None:
        axes.append(speeds)
        widths.append(speeds[1] - speeds[0])
    centers = np.array(list(itertools.product(*axes)))
    return Residual(centers, np.array(widths), np.zeros((len(centers) + 1, 3)))


def fit_residual(samples: Samples, grid: Residual) -> Residual:
    """Returns the residual with the weights that fit what the plate lacks."""
    values = samples.variables[:, : len(grid.widths)]
    columns = features(values, grid.centers, grid.widths)
    regular = columns.T @ columns + RIDGE * np.eye(columns.shape[1])
    target = columns.T @ (samples.measured - samples.plate)
    return grid._replace(weights=np.linalg.solve(regular, target))


def residual_at(residual: Residual, variables: np.ndarray) -> np.ndarray:
    """Returns what a residual adds to C_L, C_D, C_M at variables (N, 3), (N, 3)."""
    values = variables[:, : len(residual.widths)]
    return features(values, residual.centers, residual.widths) @ residual.weights


def glider_with(residual: Residual, plate: GliderModel) -> GliderModel:
    """Returns the flat plate with a residual, as a model that flies."""
    named = zip(COEFFICIENTS, residual.weights.T.tolist(), strict=True)
    function = FreeFunction(
        variables=["alpha", "elevator", "V"][: len(residual.widths)],
        centers=residual.centers.tolist(),
        widths=residual.widths.tolist(),
        constant=True,
        weights=dict(named),
    )
    return GliderModel(parameters=plate.parameters, free_functions=[function])


def rollout_errors(
    campaign: Campaign, flights: Sequence[Flight], models: dict[str, GliderModel]
) -> list[float]:
    """Returns the RMS distance of each model's flights from those measured [m].

    Each flies from a launch that is fitted to the flight's beginning.
    """
    rollouts = refly.rollout_models(campaign, models, varies=False)
    squares: dict[str, list[float]] = {name: [] for name in models}
    for flight in flights:
        motions = refly.refly(campaign, flight, models, rollouts=rollouts)
        for name, (rms, _) in refly.position_errors(motions).items():
            squares[name].append(rms**2)
    return [float(np.sqrt(np.mean(own))) for own in squares.values()]


# --------------------------------------------------------------------------- lecture


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Measures coefficients, learns what the plate lacks, and flies it."""
    path = read_options(__doc__, arguments)
    campaign = load_campaign("attached_lift")
    plate = refly.nominal_model(campaign)
    held_out = campaign.flights[::4]
    fitted = [flight for flight in campaign.flights if flight not in held_out]
    data, unseen = samples_of(fitted, plate), samples_of(held_out, plate)

    speeds = np.linspace(*np.quantile(data.variables[:, 2], [0.01, 0.99]), 5)
    small, large = (fit_residual(data, gaussian_grid(own)) for own in (None, speeds))
    left = [unseen.measured - unseen.plate]
    for own in (small, large):
        left.append(left[0] - residual_at(own, unseen.variables))
    lift = [np.sqrt(np.mean(part[:, 0] ** 2)) for part in left]

    models = {
        "flat plate": plate,
        "26 weights": glider_with(small, plate),
        "126 weights": glider_with(large, plate),
    }
    errors = rollout_errors(campaign, held_out, models)
    if path:
        draw(path, data, plate, small, large)
    return compare(
        ARTICLE,
        SHOWN,
        SHOWN,
        SHOWN,
        f"{len(data.measured):,}",
        f"{len(small.weights)} and {len(large.weights)}",
        ", ".join(f"{error:.3f}" for error in lift),
        ", ".join(f"{1000 * error:.0f} mm" for error in errors),
    )


def plate_at(variables: np.ndarray, model: GliderModel) -> np.ndarray:
    """Returns the flat plate's C_L, C_D, C_M (N, 3), nothing turning."""
    alpha, elevator, speed = variables.T
    still = np.zeros_like(alpha)
    state = np.array([still, still, -alpha, elevator, speed, still, still])
    rates = rates_of(model, state, still)
    return coefficients_of(rates[4:7], speed, still, model)


def draw(
    path: Path, data: Samples, plate: GliderModel, small: Residual, large: Residual
) -> None:
    """Draws each coefficient over the angle of attack, and what the plate lacks."""
    alpha, elevator, speed = data.variables.T
    angles = np.linspace(*np.quantile(alpha, [0.01, 0.99]), 100)
    order = np.argsort(alpha)
    # Curves along a typical flight: elevator and speed as they mostly go with α.
    typical = [
        np.polynomial.Polynomial.fit(alpha, v, 3)(angles) for v in (elevator, speed)
    ]
    along = np.column_stack([angles, *typical])
    curves = {
        "flat plate": (plate_at(along, plate), "k"),
        "with 26 weights": (plate_at(along, plate) + residual_at(small, along), RED),
        "with 126 weights": (plate_at(along, plate) + residual_at(large, along), BLUE),
    }
    with picture(path, 10.0, 4.2) as figure:
        panels = figure.subplots(1, 3)
        for k, (ax, name) in enumerate(
            zip(panels, ("C_L", "C_D", "C_M [m]"), strict=True)
        ):
            shown = ax.scatter(
                np.degrees(alpha[order]), data.measured[order, k], 3, elevator[order]
            )
            for label, (values, color) in curves.items():
                ax.plot(np.degrees(angles), values[:, k], color="w", lw=3.5)
                ax.plot(np.degrees(angles), values[:, k], color=color, label=label)
            low, high = np.quantile(data.measured[:, k], [0.005, 0.995])
            ax.set(xlabel="angle of attack [°]", ylabel=name)
            ax.set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
        figure.colorbar(shown, ax=panels, label="elevator [rad]")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=3)


if __name__ == "__main__":
    start(main)
