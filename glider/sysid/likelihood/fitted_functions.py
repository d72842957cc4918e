"""Free functions as flights show them: mixtures of Gaussians with a prior.

Each adds a function of a flow's variables to one link of the force chain: the air, the
forces, the tail's force or the stream at the tail. It is a Gaussian process with a
physical prior scale (MacKay, Information Theory, Inference, and Learning Algorithms,
2003, ch. 45), and stands for any formula of a family of effects. Such functions compete
with the library's formulas; beside one they absorb what a formula of nearly the right
shape leaves.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg

from glider.physics.effects import FLOW_VARIABLES, FREE_FUNCTIONS, EffectKind, Gaussians
from glider.physics.effects.families import FAMILIES
from glider.physics.effects.free_functions import FreeFunction, gaussian
from glider.sysid.constants import LEADING, RESOLVED
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import flow_at_nodes, true_nodes

_ABOUT_MEAN = {"c_drag", "c_axial", "c_moment", "pose_x", "pose_z"}
"""Terms that vary about their means: these are effects of the library, and of measured
positions nothing that a flight shows."""

_LEVELS = (8, 1.0), (32, 0.3)
"""Gaussians over one variable, and their prior spread over the function's: wide ones,
and narrow ones for kinks that only sharp flights show."""
_PAIR_COUNTS = {"x": 8, "z": 4}
"""Those over each of two variables; over others there are 5."""
_WIDEST = {"alpha": (0.14, 0.035)}
"""Widths of the levels at most, of two variables twice that: flow separates within two
degrees, and a glider that tumbles may pass through all angles [rad]."""
_OF_POSITIONS = 1.5, 1e-4
"""Width in distances of centers, and RMS along flights over its prior's, of what an
error of a measured position shows, which has wide Gaussians alone: a lens bends
smoothly, and cameras resolve a thousandth of that. With widths of one and `RESOLVED`, a
twentieth of a lens is left."""
_LEAST_MET = 0.01
"""Largest value along the flights below which a Gaussian is left out, as a third of
those over two variables are. Functions change there by less than 1e-5 of their size."""
_LEAST_RANGE = 1e-6  # Range below which nothing can depend on a variable.


@dataclasses.dataclass(frozen=True, kw_only=True)
class FittedFunction:
    """A free function as a search fits it: Σ_j w_j g_j(x) with w = mix · coordinates.

    The coordinates have a common prior spread, the function's strength.

    Attributes:
        name: of FAMILIES.
        effect: of FREE_FUNCTIONS, whose coefficient the function is.
        variables: d of FLOW_VARIABLES.
        centers: of the M Gaussians, (M, d), in the variables' units.
        widths: of the Gaussians, (M, d), in the variables' units.
        mix: (M, q) weights of coordinates, the most shown ones first.
        leading: number of coordinates by which it is compared with others.
        coordinates: (q,) zero unless it acts in a model.
        strength: prior spread of the coordinates.
    """

    name: str
    effect: EffectKind
    variables: tuple[str, ...]
    centers: np.ndarray
    widths: np.ndarray
    mix: np.ndarray
    leading: int
    coordinates: np.ndarray
    strength: float = 1.0

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return self.mix.shape[1]

    @property
    def leading_only(self) -> "FittedFunction":
        """The function with its leading coordinates alone."""
        mix = self.mix[:, : self.leading]
        coordinates = self.coordinates[: self.leading]
        return dataclasses.replace(self, mix=mix, coordinates=coordinates)

    @property
    def is_read(self) -> bool:
        """Whether sensors show it, and nothing else."""
        return self.effect.stage == "sensor"

    @property
    def columns(self) -> list[int]:
        """Indices of its variables in FLOW_VARIABLES."""
        return [FLOW_VARIABLES.index(name) for name in self.variables]

    def gaussians(self, values: np.ndarray) -> np.ndarray:
        """Returns the Gaussians (n, M) at values of the variables (n, d)."""
        return gaussian(values, self.centers, self.widths)

    @property
    def weights(self) -> np.ndarray:
        """Weights of the Gaussians, (M,)."""
        return self.mix @ self.coordinates

    def size(self, flown: np.ndarray) -> float:
        """Returns its RMS along flights, FLOW_VARIABLES (n, v), over its prior's."""
        values = self.gaussians(flown[:, self.columns]) @ self.weights
        [value] = self.effect.coefficients
        return float(np.sqrt(np.mean(values**2))) / value.scale

    @property
    def data(self) -> FreeFunction:
        """The function as a model file has it: equal widths are one number."""
        widths: list[float | list[float]] = []
        for own in self.widths.T.tolist():
            is_common = np.ptp(own) == 0.0
            widths.append(own[0] if is_common else own)

        return FreeFunction(
            kind="unexplained",
            variables=list(self.variables),
            centers=self.centers.tolist(),
            widths=widths,
            weights={self.effect.kind: self.weights.tolist()},
        )

    @property
    def basis(self) -> tuple[object, ...]:
        """Key of its Gaussians along a flight: functions with equal ones share them."""
        own = self.centers.tobytes(), self.widths.tobytes()
        return self.variables, self.is_read, *own

    def along(self, values: np.ndarray) -> np.ndarray:
        """Returns the Gaussians (K, M) along a flight, those of sensors (K + 1, M).

        `values` (K + 1, v) are FLOW_VARIABLES at its nodes.
        """
        if not self.is_read:
            values = _variables_between(values)
        return self.gaussians(values[:, self.columns])


def functions_of(functions: Iterable[FreeFunction]) -> tuple[FittedFunction, ...]:
    """Returns the free functions of a model file, each with one factor to fit.

    The only coordinate of each is one, by which its weights in the file are multiplied.
    """
    found = []
    for own in functions:
        centers = np.array(own.centers).reshape(-1, len(own.variables))
        widths = [np.full(len(centers), width) for width in own.widths]
        for kind, weights in own.weights.items():
            found.append(
                FittedFunction(
                    name=f"{kind} over {', '.join(own.variables)}",
                    effect=FREE_FUNCTIONS[kind],
                    variables=tuple(own.variables),
                    centers=centers,
                    widths=np.column_stack(widths),
                    mix=np.reshape(weights, (-1, 1)),
                    leading=1,
                    coordinates=np.ones(1),
                )
            )

    return tuple(found)


def flown_values(records: Sequence[Record], theta: np.ndarray) -> np.ndarray:
    """Returns FLOW_VARIABLES at the nodes of all flights of a model, (n, v)."""
    flows = [flow_at_nodes(r, theta, true_nodes(r, theta)) for r in records]
    return np.concatenate(flows)[:, -len(FLOW_VARIABLES) :]


def _between(values: np.ndarray) -> np.ndarray:
    """Returns values at the midpoint of each interval, (K, v), from those at nodes."""
    return 0.5 * (values[1:] + values[:-1])


def _variables_between(values: np.ndarray) -> np.ndarray:
    """Returns FLOW_VARIABLES at the midpoints, (K, v), from those at nodes (K + 1, v).

    Angles of attack are averaged across their jump at ±π.
    """
    middle = _between(values)
    alpha = FLOW_VARIABLES.index("alpha")
    turned = _between(np.unwrap(values[:, alpha]))
    middle[:, alpha] = np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi
    return middle


def values_at_nodes(
    flight: LinearFlight, theta: np.ndarray, gaussians: Gaussians
) -> np.ndarray:
    """Returns FLOW_VARIABLES at the nodes of a flight of a model, (K + 1, v).

    They are those of the air that the flight is linear about, with its wind.
    """
    wind = flight.about.wind(flight.record)  # (K, 2) of intervals.
    wind_at_nodes = np.vstack([wind[:1], _between(wind), wind[-1:]])
    nodes = flight.nodes.copy()
    nodes[:, 4:6] -= wind_at_nodes
    flow = flow_at_nodes(flight.record, theta, nodes, gaussians)
    return flow[:, -len(FLOW_VARIABLES) :]


def make_functions(flown: np.ndarray) -> dict[str, FittedFunction]:
    """Spreads the bases of FAMILIES over `flown_values` (n, v).

    Returns:
        the functions by name, without those of variables that do not vary.
    """
    low, high = np.percentile(flown, [0.1, 99.9], axis=0)
    few = flown[:: max(1, len(flown) // 2000)]
    varies = high - low >= _LEAST_RANGE
    bases: dict[tuple[tuple[str, ...], bool, bool], _Basis] = {}
    found = {}
    for name, family in FAMILIES.items():
        variables = family.variables
        columns = [FLOW_VARIABLES.index(variable) for variable in variables]
        if not np.all(varies[columns]):
            continue

        # Functions of the same variables share a basis.
        effect = family.free_function
        is_position = effect.kind in ("pose_x", "pose_z")
        key = variables, is_position, effect.kind in _ABOUT_MEAN
        if key not in bases:
            ranges = np.column_stack([low, high])[columns]
            bases[key] = _make_basis(*key, ranges, few[:, columns])

        basis = bases[key]
        [value] = effect.coefficients
        found[name] = FittedFunction(
            name=name,
            effect=effect,
            variables=variables,
            centers=basis.centers,
            widths=basis.widths,
            mix=value.scale * basis.mix,
            leading=int(np.count_nonzero(basis.sizes > LEADING)),
            coordinates=np.zeros(len(basis.sizes)),
        )

    return found


class _Basis(NamedTuple):
    """Gaussians over some variables, mixed by what they show along flights.

    Attributes:
        centers: of the M Gaussians (M, d).
        widths: of the Gaussians (M, d).
        mix: (M, q) weights of the mixtures, the most shown ones first.
        sizes: (q,) RMS of each along the flights.
    """

    centers: np.ndarray
    widths: np.ndarray
    mix: np.ndarray
    sizes: np.ndarray


def _make_basis(
    variables: Sequence[str],
    is_position: bool,
    about_mean: bool,
    ranges: np.ndarray,
    flown: np.ndarray,
) -> _Basis:
    """Spreads Gaussians over d variables.

    Args:
        variables: of FLOW_VARIABLES.
        is_position: whether the function is an error of a measured position.
        about_mean: whether no mixture has a mean along the flights.
        ranges: least and largest values of the variables (d, 2).
        flown: their values along flights (n, d).
    """
    width, resolved = _OF_POSITIONS if is_position else (1.0, RESOLVED)
    levels = _LEVELS[:1] if is_position else _LEVELS
    grids = [_grid(variables, ranges, width, i) for i in range(len(levels))]
    centers, widths = map(np.vstack, zip(*grids, strict=True))
    counts = [len(centers) for centers, _ in grids]
    spreads = np.repeat([spread for _, spread in levels], counts)

    shown = gaussian(flown, centers, widths)
    is_met = shown.max(axis=0) > _LEAST_MET
    mixed = _mix(shown[:, is_met], spreads[is_met], about_mean, resolved)
    return _Basis(centers[is_met], widths[is_met], *mixed)


def _mix(
    shown: np.ndarray, spreads: np.ndarray, about_mean: bool, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mixes Gaussians by what they show along flights, the most shown mixtures first.

    Args:
        shown: the Gaussians along flights (n, M).
        spreads: prior spreads of their weights (M,).
        about_mean: whether no mixture has a mean along the flights.
        least: RMS along the flights below which mixtures are left out.

    Returns:
        weights of the q mixtures (M, q), uncorrelated along the flights, and the RMS of
        each along them (q,).
    """
    basis = np.diag(spreads)
    if about_mean:
        mean = shown.mean(axis=0, keepdims=True) @ basis
        basis = basis @ scipy.linalg.null_space(mean)

    squares, axes = np.linalg.eigh(basis.T @ (shown.T @ shown) @ basis / len(shown))
    sizes = np.sqrt(np.maximum(squares[::-1], 0.0))
    count = np.count_nonzero(sizes > least)
    return basis @ axes[:, ::-1][:, :count], sizes[:count]


def _grid(
    variables: Sequence[str], ranges: np.ndarray, width: float, level: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns centers and widths (M, d) of one level of Gaussians.

    They go a width beyond the range: where the last Gaussian stands at the edge, what
    grows towards it takes large weights that nearly cancel, and a lens of 68 mm (RMS)
    is missed by 1 mm instead of 0.06.

    Args:
        variables: d of FLOW_VARIABLES.
        ranges: their least and largest values (d, 2).
        width: of the Gaussians, in distances of centers.
        level: index into `_LEVELS`.
    """
    is_pair = len(variables) == 2
    beyond = math.ceil(width)
    axes = []
    for variable, (low, high) in zip(variables, ranges, strict=True):
        count, _ = _LEVELS[level]
        if is_pair:
            count = _PAIR_COUNTS.get(variable, 5)
        if variable in _WIDEST:
            widest = (1 + is_pair) * _WIDEST[variable][level]
            count = max(3, 1 + math.ceil((high - low) / widest))

        apart = (high - low) / (count - 1)
        axes.append(low + apart * np.arange(-beyond, count + beyond))

    grids = np.meshgrid(*axes, indexing="ij")
    centers = np.stack(grids, axis=-1).reshape(-1, len(axes))
    widths = width * np.array([axis[1] - axis[0] for axis in axes])
    return centers, np.tile(widths, (len(centers), 1))
