"""A glider whose flow changes with airspeed, as in the article's simulator.

The article's simulator corrects the flat plate by 126 weights a coefficient, over
angle of attack, elevator and airspeed. Its weights are not published; these are fitted
to an effect that no kind of the library describes. Between launch and wire the chord's
Reynolds number falls from 60,000 to 15,000. As long as it is high, a vortex sits on the
leading edge and sucks; as it falls the vortex leaves, and its wake blankets the tail.

    python -m benchmarks.low_reynolds models/truths/low_reynolds.yaml
"""

import argparse
from pathlib import Path

import numpy as np

from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters, load_parameters
from residual_coefficients import Residual, features, gaussian_grid, glider_with

LEAVES, RANGE = 4.5, 1.0
"""Airspeed at which half of the vortex has left, and how fast that goes [m/s]."""

VORTEX = 0.7
"""Normal force coefficient of the vortex over sin² α, after Polhamus 1966."""

AHEAD = 0.012
"""Distance ahead of the center of mass at which it acts [m]."""

FRICTION = 0.04
"""Drag coefficient of the skin."""

BLANKET, BLANKET_AT, BLANKET_WIDTH = 0.4, 0.7, 0.35
"""Share of the elevator's force that the wake takes away, at which angle of attack,
and over which range [rad]."""

_RIDGE = 1e-3
_SPEEDS = (0.0, 8.0)
_ALPHA = (-0.3, 1.8)
_ELEVATOR = (-0.5, 1.0)
_SAMPLES = (15, 8, 9)


def low_reynolds_coefficients(
    alpha: np.ndarray,
    elevator: np.ndarray,
    speed: np.ndarray,
    parameters: GliderParameters,
) -> np.ndarray:
    """Computes the corrections of the flat plate's C_L, C_D, C_M, shape (N, 3).

    With the vortex's share s = ½ (1 + tanh((V - LEAVES) / RANGE)):
        ΔC_L = VORTEX s sin² α cos α
        ΔC_D = VORTEX s sin³ α + FRICTION cos² α
        ΔC_M = -AHEAD VORTEX s sin² α                           nose up
    and the elevator, whose coefficient is C_e = 2 S_e / S_w sin(α - φ) along its
    normal, loses the share BLANKET (1 - s) exp(-((α - BLANKET_AT) / BLANKET_WIDTH)²/2).

    Args:
        alpha: (N,) angle of attack [rad].
        elevator: (N,) φ [rad].
        speed: (N,) V [m/s].
        parameters: areas and arms.
    """
    sine, cosine = np.sin(alpha), np.cos(alpha)
    share = 0.5 * (1.0 + np.tanh((speed - LEAVES) / RANGE))
    vortex = VORTEX * share * sine**2
    lost = BLANKET * (1.0 - share)
    lost = lost * np.exp(-0.5 * ((alpha - BLANKET_AT) / BLANKET_WIDTH) ** 2)
    angle = alpha - elevator
    tail = lost * 2.0 * parameters.elevator_area / parameters.wing_area * np.sin(angle)
    arm = parameters.hinge_offset * np.cos(elevator) + parameters.elevator_offset
    return np.stack(
        [
            vortex * cosine - tail * np.cos(angle),
            vortex * sine + FRICTION * cosine**2 - tail * np.sin(angle),
            -AHEAD * vortex - tail * arm,
        ],
        axis=1,
    )


def low_reynolds_residual(parameters: GliderParameters) -> Residual:
    """Returns the residual, 126 weights a coefficient, fitted on a grid."""
    ranges = zip((_ALPHA, _ELEVATOR, _SPEEDS), _SAMPLES, strict=True)
    axes = [np.linspace(low, high, count) for (low, high), count in ranges]
    alpha, elevator, speed = (
        axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")
    )
    grid = gaussian_grid(np.linspace(*_SPEEDS, 5))
    values = np.column_stack([alpha, elevator, speed])
    columns = features(values, grid.centers, grid.widths)
    wanted = low_reynolds_coefficients(alpha, elevator, speed, parameters)
    regular = columns.T @ columns + _RIDGE * np.eye(columns.shape[1])
    weights = np.linalg.solve(regular, columns.T @ wanted)
    return grid._replace(weights=np.vectorize(lambda w: float(f"{w:.6g}"))(weights))


def main() -> None:
    """Writes the glider as a model file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("path", metavar="FILE", type=Path)
    path = parser.parse_args().path
    parameters = load_parameters(models_path("vehicles", "heavy.yaml"))
    plate = GliderModel(parameters=parameters)
    glider_with(low_reynolds_residual(parameters), plate).save(path)


if __name__ == "__main__":
    main()
