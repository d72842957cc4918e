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

import numpy as np
import scipy.linalg

from glider.physics.effects import FLOW_VARIABLES, FREE_FUNCTIONS, EffectKind, Gaussians
from glider.physics.effects.families import FAMILIES, Family
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
    """A free function as a search fits it.

    The weights of its Gaussians are mixtures of coordinates with a common prior spread,
    the function's strength.
    """

    name: str  #: Of FAMILIES.
    effect: EffectKind  #: Of FREE_FUNCTIONS, whose coefficient it is.
    variables: tuple[str, ...]  #: d of FLOW_VARIABLES.
    centers: np.ndarray  #: (M, d)
    widths: np.ndarray  #: (M, d)
    mix: np.ndarray  #: (M, q) weights of coordinates, the most shown ones first.
    leading: int  #: Number of coordinates by which it is compared with others.
    coordinates: np.ndarray  #: (q,) zero unless it acts in a model.
    strength: float = 1.0  #: Prior spread of the coordinates.

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
        """Indices of the variables."""
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
        """The function as a model file has it."""
        return FreeFunction(
            kind="unexplained",
            variables=list(self.variables),
            centers=self.centers.tolist(),
            widths=[
                own[0] if np.ptp(own) == 0.0 else own for own in self.widths.T.tolist()
            ],
            weights={self.effect.kind: self.weights.tolist()},
        )

    @property
    def basis(self) -> tuple[object, ...]:
        """What the Gaussians along a flight depend on, equal where they are."""
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
    """Returns the free functions of a model, each with a factor to fit."""
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
    """Returns FLOW_VARIABLES along all flights of a model, (n, v)."""
    flows = [flow_at_nodes(r, theta, true_nodes(r, theta)) for r in records]
    return np.concatenate(flows)[:, -len(FLOW_VARIABLES) :]


def _between(values: np.ndarray) -> np.ndarray:
    """Returns values at the midpoint of each interval, (K, v), from those at nodes."""
    return 0.5 * (values[1:] + values[:-1])


def _variables_between(values: np.ndarray) -> np.ndarray:
    """Returns FLOW_VARIABLES at the midpoints, (K, v): angles of attack turn by ±π."""
    middle = _between(values)
    alpha = FLOW_VARIABLES.index("alpha")
    turned = _between(np.unwrap(values[:, alpha]))
    middle[:, alpha] = np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi
    return middle


def values_at_nodes(
    flight: LinearFlight, theta: np.ndarray, gaussians: Gaussians
) -> np.ndarray:
    """Returns FLOW_VARIABLES at the nodes of a flight of a model, (K + 1, v)."""
    nodes = flight.nodes.copy()
    wind = flight.about.wind(flight.record)
    nodes[:, 4:6] -= np.vstack([wind[:1], _between(wind), wind[-1:]])
    flow = flow_at_nodes(flight.record, theta, nodes, gaussians)
    return flow[:, -len(FLOW_VARIABLES) :]


def make_functions(flown: np.ndarray) -> dict[str, FittedFunction]:
    """Spreads the bases of FAMILIES over `flown_values`; a point has none."""
    low, high = np.percentile(flown, [0.1, 99.9], axis=0)
    flown = flown[:: max(1, len(flown) // 2000)]
    found = {}
    for name, family in FAMILIES.items():
        columns = [FLOW_VARIABLES.index(variable) for variable in family.variables]
        range_ = np.stack([low[columns], high[columns]])
        if np.all(np.ptp(range_, axis=0) >= _LEAST_RANGE):
            found[name] = _make_function(name, family, range_, flown[:, columns])
    return found


def _make_function(
    name: str, family: Family, range_: np.ndarray, flown: np.ndarray
) -> FittedFunction:
    """Spreads Gaussians over the range (2, d) of values (n, d), and mixes them.

    Mixtures that no flight shows are left out.
    """
    function = family.free_function
    [value] = function.coefficients
    of_position = function.kind in ("pose_x", "pose_z")
    width, resolved = _OF_POSITIONS if of_position else (1.0, RESOLVED)
    levels = _LEVELS[:1] if of_position else _LEVELS
    own = [_grid(family.variables, range_, width, i) for i in range(len(levels))]
    centers, widths = map(np.vstack, zip(*own, strict=True))
    counts = [len(centers) for centers, _ in own]
    shares = np.repeat([share for _, share in levels], counts)
    shown = gaussian(flown, centers, widths)
    is_met = shown.max(axis=0) > _LEAST_MET
    centers, widths, shares = centers[is_met], widths[is_met], shares[is_met]
    shown = shown[:, is_met]
    basis = np.diag(shares)
    if function.kind in _ABOUT_MEAN:
        mean = shown.mean(axis=0, keepdims=True) @ basis
        basis = basis @ scipy.linalg.null_space(mean)

    # Mixtures by what they show along flights, the most shown ones first.
    squares, axes = np.linalg.eigh(basis.T @ (shown.T @ shown) @ basis / len(shown))
    spreads = np.sqrt(np.maximum(squares[::-1], 0.0))
    basis = basis @ axes[:, ::-1][:, : np.count_nonzero(spreads > resolved)]
    return FittedFunction(
        name=name,
        effect=function,
        variables=family.variables,
        centers=centers,
        widths=widths,
        mix=value.scale * basis,
        leading=int(np.count_nonzero(spreads > LEADING)),
        coordinates=np.zeros(basis.shape[1]),
    )


def _grid(
    variables: Sequence[str], range_: np.ndarray, width: float, level: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns centers and widths (M, d) of a level, of `width` distances of centers.

    They go a width beyond the range: where the last Gaussian stands at the edge, what
    grows towards it takes large weights that nearly cancel, and a lens of 68 mm (RMS)
    is missed by 1 mm instead of 0.06.
    """
    is_pair = len(variables) == 2
    beyond = math.ceil(width)
    axes = []
    for variable, low, high in zip(variables, *range_, strict=True):
        count = _PAIR_COUNTS.get(variable, 5) if is_pair else _LEVELS[level][0]
        if variable in _WIDEST:
            widest = (1 + is_pair) * _WIDEST[variable][level]
            count = max(3, 1 + math.ceil((high - low) / widest))

        apart = (high - low) / (count - 1)
        axes.append(low + apart * np.arange(-beyond, count + beyond))

    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    centers = centers.reshape(-1, len(axes))
    widths = width * np.array([axis[1] - axis[0] for axis in axes])
    return centers, np.tile(widths, (len(centers), 1))
