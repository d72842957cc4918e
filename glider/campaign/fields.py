"""Files of named fields: read, and refused where a field is none of those known."""

import difflib
import re
from collections.abc import Sequence
from pathlib import Path

import yaml

from glider.campaign.csv_table import read_text
from glider.errors import InputError, show


class _Loader(yaml.SafeLoader):
    """Takes 1e-3 for a number, as YAML 1.2 does; PyYAML alone reads text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def read_yaml(file: Path) -> object:
    """Returns what a YAML file holds; raises InputError where it is none."""
    text = read_text(file)
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{file}: not readable as YAML: {reason}.") from None


def check_fields(fields: object, known: Sequence[str], source: str) -> dict:
    """Returns the fields; raises InputError unless all of them are known ones.

    Args:
        fields: from a file.
        known: their names.
        source: the file, and where in it.
    """
    if not isinstance(fields, dict):
        raise InputError(
            f"{source}: found {show(fields)}; "
            f"a mapping of fields is needed, out of {', '.join(known)}."
        )
    for name in fields:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.7)
            hint = f"; did you mean '{near[0]}'?" if near else "."
            raise InputError(
                f"{source}: unknown field {show(name)}, one of "
                f"{', '.join(known)} is needed{hint}"
            )
    return fields
