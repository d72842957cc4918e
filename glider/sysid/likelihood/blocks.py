"""Free functions in the links of the force chain: blocks of Gaussians.

A block adds a function of a flow's variables to one link: the air, the forces, the
tail's force or the stream at the tail. It is a Gaussian process with a physical prior
scale (MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 45),
and stands for any formula of a family of effects. Blocks compete with the library's
formulas; beside one they absorb what a formula of nearly the right shape leaves.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import scipy.linalg

from glider.physics.effects import FIELD_VARIABLES, Field
from glider.physics.effects.field import (
    AIR_TERMS,
    INERTIA_TERMS,
    SENSOR_TERMS,
    FieldData,
)
from glider.sysid.constants import RESOLVED
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import flow_along, flow_at_nodes

SPREADS = {
    **dict.fromkeys(AIR_TERMS, 0.5),
    **{"c_normal": 0.2, "c_axial": 0.2, "c_drag": 0.2, "c_moment": 0.01},
    **{"elevator_factor": 0.5, "tail_downwash": 0.2, "tail_angle": 0.2},
    **{"wing_factor": 0.2, "push": 1.0, **dict.fromkeys(INERTIA_TERMS, 0.1)},
    **dict.fromkeys(SENSOR_TERMS, 0.05),
}
"""Prior spread of a block's weights at a strength of one [m/s; -, -, -, m; -, rad, rad;
-, m/s², -, -; m, m, rad]: a tenth of a flat plate's largest coefficients, half of a
tail's force, a fifth of a wing's, a tenth of the weight, of mass and inertia, of a
reading what a wide lens or a tilted axis does."""

ABOUT_MEAN = {"c_drag", "c_axial", "c_moment", "pose_x", "pose_z"}
"""Terms of blocks that vary about their means: effects of the library, and of measured
positions nothing that a flight shows."""

# Gaussians over a variable, and over each of two; over the others there are 8, and 3.
COUNTS = {"x": 24, "z": 16, "t": 16, "alpha": 30, "tail_load": 16}
PAIR_COUNTS = {"x": 8, "z": 4, "alpha": 16}
OF_POSITIONS = 1.5, 1e-4
"""Width in distances of centers, and RMS along flights over its prior's, of what an
error of a measured position shows: a lens bends smoothly, and cameras resolve a
thousandth of that. With widths of one and `RESOLVED`, a twentieth of a lens is left."""
WIDEST = {"alpha": 0.08}
"""Width of a Gaussian at most, of two variables twice that: a stall is as sharp, and a
glider that tumbles may pass through all angles [rad]."""
_LEAST_RANGE = 1e-6  # Range below which nothing can depend on a variable.


@dataclasses.dataclass(frozen=True, kw_only=True)
class BlockKind:
    """A family of effects: a link of the force chain, and what it varies with.

    Of two variables where the past matters: to first order, what lags behind the angle
    of attack is a function of it and of the pitch rate (for a force: the reduced one).
    """

    link: str  #: Of the force chain, as reports have it.
    term: str  #: Of FIELD_TERMS.
    variables: tuple[str, ...]  #: Of FIELD_VARIABLES, one or two.
    words: str  #: A short phrase for people.
    formulas: tuple[str, ...]  #: Effects of the library that are of the family.
    bends: frozenset[str]  #: Effects whose formula it may bend.

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variables as reports have them: a rate, not a rate over a speed."""
        return tuple(
            "pitchdot" if name == "reduced_rate" else name for name in self.variables
        )


_DRAGS = "profile_drag axial_drag induced_drag"
_LAGGED = "dynamic_stall lagged_separation"
_DOWNWASH = "downwash stalled_downwash"
_OF_TAIL = f"tail_wake elevator_area {_DOWNWASH} lagged_downwash elevator_blowback"
_LINKS = {
    "air along x": ("air", "wind_x", "air along x that changes", ""),
    "air along z": ("air", "wind_z", "air along z that changes", ""),
    "lift": ("wing_force", "c_normal", "a lift that changes", _LAGGED),
    "drag": ("wing_force", "c_drag", "a drag that changes", _DRAGS),
    "axial force": ("wing_force", "c_axial", "an axial force that changes", _DRAGS),
    "push": ("push", "push", "a push along the body axis that changes", ""),
    "moment": ("moment", "c_moment", "a moment that changes", ""),
    "added mass": ("inertia", "added_mass", "an added mass that changes", ""),
    "added inertia": ("inertia", "added_inertia", "an added inertia that changes", ""),
    "wing's force": ("wing_force", "wing_factor", "a wing's force that changes", ""),
    "tail's force": (
        *("tail_pressure", "elevator_factor", "a tail's force that changes"),
        _OF_TAIL,
    ),
    "stream at the tail": (
        *("tail_angle", "tail_downwash", "a stream at the tail that turns"),
        _OF_TAIL,
    ),
    "tail's angle": ("tail_angle", "tail_angle", "a tail that turns", _OF_TAIL),
    "measured x": ("sensor", "pose_x", "an error of the measured x that changes", ""),
    "measured z": ("sensor", "pose_z", "an error of the measured z that changes", ""),
    "measured pitch": (
        "sensor",
        "pose_pitch",
        "an error of the measured pitch that changes",
        "",
    ),
}
"""Links of the force chain: their name in reports, term, what acts there, and which
formulas of other variables a function may bend: lags are soon over, and only the
deflection distinguishes a change of the tail's angle from one of its force."""

_FAMILIES = (
    ("air along x", "x", ""),
    ("air along x", "z", "wind_shear"),
    ("air along x", "t", ""),
    ("air along z", "x", ""),
    ("air along z", "z", ""),
    ("air along z", "t", ""),
    ("lift", "alpha", "attached_lift camber"),
    ("lift", "reduced_rate", f"pitch_rate_lift {_LAGGED}", "added_mass"),
    ("lift", "alpha reduced_rate", f"pitch_rate_lift {_LAGGED}", "added_mass"),
    ("lift", "elevator_rate", ""),
    ("drag", "alpha", _DRAGS),
    ("axial force", "alpha", _DRAGS),
    ("drag", "V", ""),
    ("drag", "z", ""),
    ("drag", "elevator", ""),
    ("push", "x", "thrust"),
    ("push", "t", "thrust"),
    ("moment", "alpha", "center_of_pressure pitch_moment"),
    ("moment", "V", ""),
    ("moment", "reduced_rate", "pitch_damping", "added_mass"),
    ("moment", "alpha reduced_rate", "pitch_damping", "added_mass"),
    ("moment", "elevator", ""),
    ("moment", "elevator_rate", ""),
    ("added mass", "alpha", "added_mass"),
    ("added inertia", "alpha", "added_mass inertia"),
    ("wing's force", "V", "airspeed_dependence"),
    ("wing's force", "z", "ground_effect"),
    ("tail's force", "V", ""),
    ("tail's force", "alpha", "tail_wake"),
    ("tail's force", "alpha elevator", "tail_wake"),
    ("tail's force", "elevator", ""),
    ("stream at the tail", "alpha", _DOWNWASH),
    ("stream at the tail", "alpha reduced_rate", f"{_DOWNWASH} lagged_downwash"),
    ("tail's angle", "tail_load", "elevator_blowback"),
    ("tail's angle", "elevator", ""),
    ("measured x", "x z", "position_scale frame_tilt marker_offset"),
    ("measured z", "x z", "position_scale frame_tilt marker_offset"),
    ("measured pitch", "pitch", "pitch_offset"),
)
"""Link, variables, the library's formulas of the family, others that it may bend."""

BLOCKS = {
    f"{link} over {named}": BlockKind(
        link=reported,
        term=term,
        variables=tuple(variables.split()),
        words=f"{acts} with {named}",
        formulas=tuple(formulas.split()),
        bends=frozenset(" ".join([formulas, bent, *more]).split()),
    )
    for link, variables, formulas, *more in _FAMILIES
    for reported, term, acts, bent in [_LINKS[link]]
    for named in [" and ".join(variables.split())]
}
"""Families of effects that are searched without a formula, by name."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Block:
    """Gaussians over variables, with a weight for each of some terms.

    Weights (M T,) go by functions first and then by terms; they are mixtures of
    coordinates with a common prior spread, the block's strength.
    """

    name: str  #: Of BLOCKS.
    terms: tuple[str, ...]  #: T of FIELD_TERMS.
    variables: tuple[str, ...]  #: d of FIELD_VARIABLES.
    centers: np.ndarray  #: (M, d)
    widths: np.ndarray  #: (d,)
    flown: np.ndarray  #: (2, d) least and largest values of the variables in flight.
    mix: np.ndarray  #: (M T, q) weights of coordinates.

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return self.mix.shape[1]

    @property
    def columns(self) -> list[int]:
        """Indices of the variables."""
        return [FIELD_VARIABLES.index(name) for name in self.variables]

    @property
    def reached(self) -> np.ndarray:
        """Centers in the flown range, (n, d)."""
        low, high = self.flown + np.outer([-1e-6, 1e-6], self.widths)
        is_within = (low <= self.centers) & (self.centers <= high)
        return self.centers[is_within.all(axis=1)]

    def functions(self, values: np.ndarray) -> np.ndarray:
        """Returns the Gaussians (n, M) at values of the variables (n, d)."""
        return gaussian(values, self.centers, self.widths)

    def values(self, coordinates: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Returns the terms (n, T) at values of the variables (n, d)."""
        weights = (self.mix @ coordinates).reshape(-1, len(self.terms))
        return self.functions(at) @ weights

    def data(self, coordinates: np.ndarray) -> FieldData:
        """Returns the function as a model file has it, without terms of no weight."""
        by_term = (self.mix @ coordinates).reshape(-1, len(self.terms)).T
        weights = zip(self.terms, by_term.tolist(), strict=True)
        return FieldData(
            kind="unexplained",
            variables=list(self.variables),
            centers=self.centers.tolist(),
            widths=self.widths.tolist(),
            weights={term: own for term, own in weights if any(own)},
        )

    def added_to(self, flight: LinearFlight, values: np.ndarray) -> LinearFlight:
        """Returns a flight with a column for each coordinate.

        `values` (K + 1, v) are FIELD_VARIABLES at its nodes.
        """
        if self.terms[0] not in SENSOR_TERMS:
            values = variables_between(values)
        functions = self.functions(values[:, self.columns])
        return flight.with_forces(functions, self.terms, self.mix)


def gaussian(values: np.ndarray, centers: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Returns Gaussians (n, M) about centers (M, d) at values (n, d)."""
    scaled = (values[:, None, :] - centers) / widths
    return np.exp(-0.5 * np.sum(scaled**2, axis=2))


@dataclasses.dataclass(frozen=True, kw_only=True)
class FittedBlock:
    """A block that acts in a model."""

    block: Block
    coordinates: np.ndarray  #: (q,)
    strength: float  #: Prior spread of the coordinates.

    @property
    def precision(self) -> np.ndarray:
        """Prior precision of each coordinate (q,)."""
        return np.full(self.block.count, self.strength**-2.0)

    @property
    def data(self) -> FieldData:
        """The function as a model file has it."""
        return self.block.data(self.coordinates)


def carried_blocks(data: FieldData | None) -> tuple[FittedBlock, ...]:
    """Returns the functions that a model carries, each with a factor to fit."""
    found = []
    for i, part in enumerate(() if data is None else (data, *data.more)):
        weights = np.array(list(part.weights.values())).T.reshape(-1, 1)
        centers = np.array(part.centers).reshape(-1, len(part.variables))
        block = Block(
            name=f"carried {i}",
            terms=tuple(part.weights),
            variables=tuple(part.variables),
            centers=centers,
            widths=np.array(part.widths),
            flown=np.stack([centers.min(axis=0), centers.max(axis=0)]),
            mix=weights,
        )
        found.append(FittedBlock(block=block, coordinates=np.ones(1), strength=1.0))
    return tuple(found)


def flown_values(records: Sequence[Record], theta: np.ndarray) -> np.ndarray:
    """Returns FIELD_VARIABLES along all flights of a model, (n, v)."""
    flows = [flow_along(record, theta)[1] for record in records]
    return np.concatenate(flows)[:, -len(FIELD_VARIABLES) :]


def between(values: np.ndarray) -> np.ndarray:
    """Returns values at the midpoint of each interval, (K, v), from those at nodes."""
    return 0.5 * (values[1:] + values[:-1])


def variables_between(values: np.ndarray) -> np.ndarray:
    """Returns FIELD_VARIABLES at the midpoints, (K, v): angles of attack turn by ±π."""
    middle, alpha = between(values), FIELD_VARIABLES.index("alpha")
    turned = between(np.unwrap(values[:, alpha]))
    middle[:, alpha] = np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi
    return middle


def values_at_nodes(
    flight: LinearFlight, theta: np.ndarray, field: Field
) -> np.ndarray:
    """Returns FIELD_VARIABLES at the nodes of a flight of a model, (K + 1, v)."""
    nodes, wind = flight.nodes.copy(), flight.about.wind(flight.record)
    nodes[:, 4:6] -= np.vstack([wind[:1], between(wind), wind[-1:]])
    flow = flow_at_nodes(flight.record, theta, nodes, field)
    return flow[:, -len(FIELD_VARIABLES) :]


def make_blocks(flown: np.ndarray) -> dict[str, Block]:
    """Spreads the bases of BLOCKS over `flown_values`; a point has none.

    They go a width beyond: where the last Gaussian stands at the edge, what grows
    towards it takes large weights that nearly cancel, and a lens of 68 mm (RMS) is
    missed by 1 mm instead of 0.06.
    """
    low, high = np.percentile(flown, [0.1, 99.9], axis=0)
    found = {}
    for name, kind in BLOCKS.items():
        columns = [FIELD_VARIABLES.index(name) for name in kind.variables]
        if np.any(high[columns] - low[columns] < _LEAST_RANGE):
            continue
        is_pair = len(columns) == 2
        counts, usual = (PAIR_COUNTS, 3) if is_pair else (COUNTS, 8)
        of_position = kind.term in ("pose_x", "pose_z")
        width, resolved = OF_POSITIONS if of_position else (1.0, RESOLVED)
        spaced = []
        for variable, j in zip(kind.variables, columns, strict=True):
            least = counts.get(variable, usual)
            widest = (1 + is_pair) * WIDEST.get(variable, np.inf)
            count = max(least, 1 + math.ceil((high[j] - low[j]) / widest))
            apart, beyond = (high[j] - low[j]) / (count - 1), math.ceil(width)
            spaced.append(low[j] + apart * np.arange(-beyond, count + beyond))
        widths = width * np.array([own[1] - own[0] for own in spaced])
        centers = np.stack(np.meshgrid(*spaced, indexing="ij"), axis=-1)
        centers = centers.reshape(-1, len(columns))
        count = len(centers)
        basis, values = np.eye(count), flown[:: max(1, len(flown) // 2000)][:, columns]
        shown = gaussian(values, centers, widths)
        if kind.term in ABOUT_MEAN:
            basis = scipy.linalg.null_space(np.mean(shown, axis=0)[None])
        _, spreads, axes = np.linalg.svd(
            shown @ basis / np.sqrt(len(shown)), full_matrices=False
        )
        basis = basis @ axes[: np.count_nonzero(spreads > resolved)].T
        found[name] = Block(
            name=name,
            terms=(kind.term,),
            variables=kind.variables,
            centers=centers,
            widths=widths,
            flown=np.stack([low[columns], high[columns]]),
            mix=SPREADS[kind.term] * basis,
        )
    return found
