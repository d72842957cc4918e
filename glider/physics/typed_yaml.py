"""Typed YAML files: a dataclass filled from a file, or one sentence why it cannot be.

Drake reads them. It is imported here when a file is read, not before: whoever needs
only the names and the checks of a vehicle, as the reader of campaigns does, does not
wait for it.
"""

import dataclasses
from pathlib import Path
from typing import Any, TypeVar

import yaml

from glider.errors import InputError

T = TypeVar("T")

_MISPLACED = (RuntimeError, ValueError, TypeError, AssertionError, AttributeError)
"""Errors that Drake's reader raises where a file's values are not the schema's."""


def load_typed(schema: type[T], path: Path | str, what: str) -> T:
    """Returns a dataclass with the fields that a file gives, the others at default.

    Drake sets fields after construction: a dataclass that checks its values must be
    checked once more.

    Args:
        schema: the dataclass.
        path: of the file.
        what: a file of this schema is, with its article, for the message.

    Raises:
        InputError: the file cannot be read, or its fields are not the schema's.
    """
    from pydrake.common.yaml import yaml_load_typed

    try:
        return yaml_load_typed(schema=schema, filename=str(path))
    except OSError as error:
        raise InputError(f"{path}: not {what}: {error.strerror}.") from None
    except (yaml.YAMLError, *_MISPLACED) as error:
        raise InputError(f"{path}: not {what}: {_reason(error)}.") from None


def dump_typed(data: Any) -> str:
    """Returns the text of a file of a dataclass; `load_typed` gives it back unchanged.

    Drake's own writer leaves None out everywhere, which its reader takes for the
    default; here only a field of the whole file is left out, where None is the default.
    """
    fields = dataclasses.asdict(data)
    return yaml.dump(
        {name: value for name, value in fields.items() if value is not None},
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=88,
    )


class _Dumper(yaml.SafeDumper):
    """Takes NumPy's floats for what they are, and lists again where they are met."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _represent_list(dumper: _Dumper, values: list) -> yaml.Node:
    """Returns numbers in a line, and everything else one below the other."""
    numbers = all(isinstance(value, (int, float)) for value in values)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, numbers)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_multi_representer(float, lambda dumper, x: dumper.represent_float(float(x)))


def _reason(error: Exception) -> str:
    """Returns what an error says, as a part of a sentence for a user."""
    if isinstance(error, (AssertionError, AttributeError)):  # Of no use to a user.
        return "a value, a list or a mapping is where something else is needed"
    return " ".join(str(error).split()).rstrip(".")
