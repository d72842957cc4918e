"""The families of effects that free functions are searched for."""

import dataclasses

from glider.physics.effects import LIBRARY, EffectKind
from glider.physics.effects.free_functions import FREE_FUNCTIONS


@dataclasses.dataclass(frozen=True, kw_only=True)
class Family:
    """A family of effects: a link of the force chain, and what it varies with.

    Of two variables where the past matters: to first order, what lags behind the angle
    of attack is a function of it and of the pitch rate (for a force: the reduced one).
    """

    link: str  #: Of the force chain, as reports have it.
    free_function: EffectKind  #: Of FREE_FUNCTIONS.
    variables: tuple[str, ...]  #: Of FLOW_VARIABLES, one or two.
    formulas: tuple[str, ...]  #: Effects of the library that are of the family.
    bends: frozenset[str]  #: Effects whose formula it may bend.

    @property
    def words(self) -> str:
        """A short phrase for people."""
        return f"{self.free_function.words} with {' and '.join(self.variables)}"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variables as reports have them: a rate, not a rate over a speed."""
        return tuple(
            "pitchdot" if name == "reduced_rate" else name for name in self.variables
        )


_LINKS = {
    "air along x": ("air", "wind_x"),
    "air along z": ("air", "wind_z"),
    "lift": ("wing_force", "c_normal"),
    "drag": ("wing_force", "c_drag"),
    "axial force": ("wing_force", "c_axial"),
    "push": ("push", "push"),
    "moment": ("moment", "c_moment"),
    "added mass": ("inertia", "added_mass"),
    "added inertia": ("inertia", "added_inertia"),
    "wing's force": ("wing_force", "wing_factor"),
    "tail's force": ("tail_pressure", "elevator_factor"),
    "stream at the tail": ("tail_angle", "tail_downwash"),
    "tail's angle": ("tail_angle", "tail_angle"),
    "measured x": ("sensor", "pose_x"),
    "measured z": ("sensor", "pose_z"),
    "measured pitch": ("sensor", "pose_pitch"),
}
"""Links of the force chain: their name in reports, and the free function there."""

_NAMES = (
    "air along x over x",
    "air along x over z",
    "air along x over t",
    "air along z over x",
    "air along z over z",
    "air along z over t",
    "lift over alpha",
    "lift over reduced_rate",
    "lift over alpha and reduced_rate",
    "lift over elevator_rate",
    "drag over alpha",
    "axial force over alpha",
    "drag over V",
    "drag over z",
    "drag over elevator",
    "push over x",
    "push over t",
    "moment over alpha",
    "moment over V",
    "moment over reduced_rate",
    "moment over alpha and reduced_rate",
    "moment over elevator",
    "moment over elevator_rate",
    "added mass over alpha",
    "added inertia over alpha",
    "wing's force over V",
    "wing's force over z",
    "tail's force over V",
    "tail's force over alpha",
    "tail's force over alpha and elevator",
    "tail's force over elevator",
    "stream at the tail over V",
    "stream at the tail over alpha",
    "stream at the tail over alpha and reduced_rate",
    "tail's angle over V",
    "tail's angle over tail_load",
    "tail's angle over elevator",
    "measured x over x and z",
    "measured z over x and z",
    "measured pitch over pitch",
)
"""Link and variables of the families."""


def _make_family(name: str) -> Family:
    link, _, varying = name.partition(" over ")
    reported, function = _LINKS[link]
    formulas = [kind.kind for kind in LIBRARY if name in kind.families]
    bent = [kind.kind for kind in LIBRARY if {link, name} & {*kind.bent_by}]
    return Family(
        link=reported,
        free_function=FREE_FUNCTIONS[function],
        variables=tuple(varying.split(" and ")),
        formulas=tuple(formulas),
        bends=frozenset([*formulas, *bent]),
    )


FAMILIES = {name: _make_family(name) for name in _NAMES}
"""Families of effects that are searched without a formula, by name."""


def formulas_at(name: str) -> set[str]:
    """Returns the formulas that may explain a free function.

    They are of its link, over some of its variables or all.
    """
    link, _, _ = name.partition(" over ")
    variables = {*FAMILIES[name].variables}
    return {
        formula
        for other, family in FAMILIES.items()
        if other.startswith(f"{link} over ") and variables.issuperset(family.variables)
        for formula in family.formulas
    }
