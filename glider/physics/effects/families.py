"""The families of effects that free functions are searched for."""

import dataclasses


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
