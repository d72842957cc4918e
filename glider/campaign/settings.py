"""Schema of campaign.yaml and of a MAP file: a vehicle, and how its logs are mapped."""

import dataclasses
import math
from pathlib import Path

from glider.campaign.importing.mapping import Columns, Frame, Mapping, Units, given
from glider.campaign.logs import MAX_ANGLE, Campaign
from glider.errors import expect
from glider.files import schema
from glider.physics.parameters import PARAMETER_NAMES, check_parameters


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle:
    """What is known of a glider, in SI units; None: unknown."""

    mass: float | None = None
    pitch_inertia: float | None = None
    wing_area: float | None = None
    elevator_area: float | None = None
    wing_offset: float | None = None
    hinge_offset: float | None = None
    elevator_offset: float | None = None
    air_density: float | None = None
    gravity: float | None = None
    elevator_limits: list[float] | None = None
    elevator_rate_limit: float | None = None
    elevator: str = "servo"

    def __post_init__(self):
        """Raises InputError where a value cannot be."""
        known = given(self)
        is_known = known.pop("elevator") in ("servo", "fixed", "fixed_per_flight")
        kinds = "'fixed', 'fixed_per_flight' or 'servo'"
        expect(is_known, "field 'elevator' of vehicle", self.elevator, kinds)
        check_parameters(known)
        limits, unit = (
            self.elevator_limits or [0.0],
            "radians (this looks like degrees)",
        )
        small = max(map(abs, limits)) <= MAX_ANGLE
        expect(small, "field 'elevator_limits'", limits, unit)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """Fields of campaign.yaml, or of a MAP file."""

    vehicle: Vehicle = Vehicle()
    pose_rate: float | None = None
    command_rate: float | None = None
    columns: Columns | None = None
    units: Units | None = None
    frame: Frame | str | None = None
    clock: float | str | None = None
    join: list[str] | None = None

    def __post_init__(self):
        """Raises InputError where a value cannot be."""
        for name in ("pose_rate", "command_rate"):
            rate = getattr(self, name)
            known = rate is None or 0 < rate < math.inf
            expect(known, f"field '{name}'", rate, "a positive number of Hz")
        number = isinstance(self.clock, float) and math.isfinite(self.clock)
        known = number or self.clock in (None, "same", "find")
        expected = (
            "'same', 'find', or how many seconds the elevator's clock is ahead of that "
            "of the poses"
        )
        expect(known, "field 'clock'", self.clock, expected)
        join = self.join or ["*", "*"]
        known = len(join) > 1 and all(pattern.count("*") == 1 for pattern in join)
        expected = (
            "two or more names of files with one * each: those with the same text for "
            "* are one recording"
        )
        expect(known, "field 'join'", join, expected)
        if isinstance(self.frame, str):
            object.__setattr__(self, "frame", Frame(axes=self.frame))

    def campaign(self, folder: Path) -> Campaign:
        """Campaign without flights; its pose_rate is nan where it is not given."""
        known, limits = given(self.vehicle), self.vehicle.elevator_limits
        return Campaign(
            name=folder.resolve().name,
            path=folder,
            vehicle={n: float(known[n]) for n in PARAMETER_NAMES if n in known},
            elevator=self.vehicle.elevator,
            elevator_limits=(limits[0], limits[1]) if limits else None,
            elevator_rate_limit=self.vehicle.elevator_rate_limit,
            pose_rate=math.nan if self.pose_rate is None else self.pose_rate,
            command_rate=self.command_rate,
            flights=(),
        )

    def mapping(self, source: str) -> Mapping | None:
        """How logs are mapped; None where no field says so."""
        if not {"columns", "units", "frame", "clock", "join"} & given(self).keys():
            return None
        assert not isinstance(self.frame, str)
        columns, units = given(self.columns or Columns()), given(self.units or Units())
        frame, join = self.frame or Frame(), tuple(self.join or ())
        return Mapping(source, columns, units, frame, self.clock, join)


def read_settings(file: Path) -> tuple[Campaign, Mapping | None]:
    """Reads a campaign without flights, and how its logs are mapped if they are."""
    settings = schema.load_yaml(Settings, file, "a campaign.yaml or a MAP file")
    return settings.campaign(file.parent), settings.mapping(str(file))
