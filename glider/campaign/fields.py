"""Files of named fields: read, and refused where a field is none of those known."""

import difflib
from collections.abc import Sequence

from glider.errors import InputError, show


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
