"""What campaign.yaml, or the MAP of an import, says of a vehicle and of its logs."""

import math
from pathlib import Path

from glider.campaign.csv_table import read_text
from glider.campaign.fields import check_fields
from glider.campaign.importing.mapping import MAPPING_FIELDS, Mapping, parse_mapping
from glider.campaign.logs import MAX_ANGLE, Campaign
from glider.errors import InputError, show
from glider.files import schema
from glider.physics.parameters import PARAMETER_NAMES, check_parameters

_LIMIT_FIELDS = ("elevator_limits", "elevator_rate_limit")
_VEHICLE_FIELDS = (*PARAMETER_NAMES, *_LIMIT_FIELDS, "elevator")
_TOP_FIELDS = ("vehicle", "pose_rate", "command_rate", *MAPPING_FIELDS)


def read_settings(file: Path) -> tuple[Campaign, Mapping | None]:
    """Returns a campaign without flights, and how its logs are mapped if they are.

    Its pose_rate is nan where it is not given; its folder is that of the file.

    Raises:
        InputError: a field is unknown or has a value that it cannot have.
    """
    settings = check_fields(
        schema.parse_yaml(read_text(file), str(file)), _TOP_FIELDS, str(file)
    )
    vehicle = settings.get("vehicle", {})
    check_fields(vehicle, _VEHICLE_FIELDS, f"{file}: vehicle")
    folder = file.parent
    elevator = vehicle.get("elevator", "servo")
    if "elevator" in vehicle and elevator not in ("fixed", "fixed_per_flight"):
        raise InputError(
            f"{file}: field 'elevator' of vehicle is {show(elevator)}; 'fixed' or "
            "'fixed_per_flight' is needed, or no such field where there is a servo."
        )
    numbers = {name: vehicle[name] for name in vehicle if name != "elevator"}
    try:
        check_parameters(numbers)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    limits = vehicle.get("elevator_limits")
    if limits and max(map(abs, limits)) > MAX_ANGLE:
        raise InputError(
            f"{file}: field 'elevator_limits' is {show(limits)}; "
            "radians are needed (this looks like degrees)."
        )
    for name in ("pose_rate", "command_rate"):
        rate = settings.get(name, 1.0)
        number = isinstance(rate, (int, float)) and not isinstance(rate, bool)
        if not (number and 0 < rate < math.inf):
            raise InputError(
                f"{file}: field '{name}' is {show(rate)}; "
                "a positive number of Hz is needed."
            )
    campaign = Campaign(
        name=folder.resolve().name,
        path=folder,
        vehicle={n: float(v) for n, v in numbers.items() if n not in _LIMIT_FIELDS},
        elevator=elevator,
        elevator_limits=(float(limits[0]), float(limits[1])) if limits else None,
        elevator_rate_limit=numbers.get("elevator_rate_limit"),
        pose_rate=settings.get("pose_rate", math.nan),
        command_rate=settings.get("command_rate"),
        flights=(),
    )
    return campaign, parse_mapping(settings, str(file))
