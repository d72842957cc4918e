"""The families of effects that free functions are searched for."""

import dataclasses

from glider.physics.effects import LIBRARY


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


_LINKS = {
    "air along x": ("air", "wind_x", "air along x that changes"),
    "air along z": ("air", "wind_z", "air along z that changes"),
    "lift": ("wing_force", "c_normal", "a lift that changes"),
    "drag": ("wing_force", "c_drag", "a drag that changes"),
    "axial force": ("wing_force", "c_axial", "an axial force that changes"),
    "push": ("push", "push", "a push along the body axis that changes"),
    "moment": ("moment", "c_moment", "a moment that changes"),
    "added mass": ("inertia", "added_mass", "an added mass that changes"),
    "added inertia": ("inertia", "added_inertia", "an added inertia that changes"),
    "wing's force": ("wing_force", "wing_factor", "a wing's force that changes"),
    "tail's force": ("tail_pressure", "elevator_factor", "a tail's force that changes"),
    "stream at the tail": (
        "tail_angle",
        "tail_downwash",
        "a stream at the tail that turns",
    ),
    "tail's angle": ("tail_angle", "tail_angle", "a tail that turns"),
    "measured x": ("sensor", "pose_x", "an error of the measured x that changes"),
    "measured z": ("sensor", "pose_z", "an error of the measured z that changes"),
    "measured pitch": (
        "sensor",
        "pose_pitch",
        "an error of the measured pitch that changes",
    ),
}
"""Links of the force chain: their name in reports, term, and what acts there."""

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
    "stream at the tail over alpha",
    "stream at the tail over alpha and reduced_rate",
    "tail's angle over tail_load",
    "tail's angle over elevator",
    "measured x over x and z",
    "measured z over x and z",
    "measured pitch over pitch",
)
"""Link and variables of the families."""


def _make_block(name: str) -> BlockKind:
    link, _, varying = name.partition(" over ")
    reported, term, acts = _LINKS[link]
    formulas = [kind.kind for kind in LIBRARY if name in kind.families]
    bent = [kind.kind for kind in LIBRARY if {link, name} & {*kind.bent_by}]
    return BlockKind(
        link=reported,
        term=term,
        variables=tuple(varying.split(" and ")),
        words=f"{acts} with {varying}",
        formulas=tuple(formulas),
        bends=frozenset([*formulas, *bent]),
    )


BLOCKS = {name: _make_block(name) for name in _NAMES}
"""Families of effects that are searched without a formula, by name."""
