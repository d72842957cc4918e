"""YAML and JSON files with a schema: read, checked and written by msgspec.

A schema is a dataclass, with annotated fields and defaults. What msgspec has against
a file becomes one sentence: file, field, what was found, what was expected.
"""

import copy
import dataclasses
import difflib
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import msgspec
import numpy as np
import yaml
from msgspec import inspect

from glider.errors import InputError, show

T = TypeVar("T")

if TYPE_CHECKING:
    Number = float
else:

    class Number(float):
        """A float of a schema for which a file may have null: NaN."""


Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e12)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e12)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""Numbers of a schema that a file must keep within bounds."""

_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a mapping of fields",
    "null": "null",
}
"""msgspec's names of types, as our messages have them."""


def read_text(path: Path | str, what: str) -> str:
    """Reads a text file; InputError "not {what}" where it cannot be read as UTF-8."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = error.strerror or str(error)
    except UnicodeDecodeError:
        reason = "it is no UTF-8 text"
    raise InputError(f"{path}: not {what}: {reason}.")


def parse_yaml(text: str, source: str) -> object:
    """Returns what a YAML text holds; InputError where it is none."""
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{source}: not readable as YAML: {reason}.") from None


def parse_json(text: str, source: str) -> object:
    """Returns what a JSON text holds; InputError where it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: not readable as JSON: {error}.") from None


def load_yaml(schema: type[T], path: Path | str, what: str) -> T:
    """Fills a schema from a YAML file; see `read_text` and `convert`."""
    return convert(parse_yaml(read_text(path, what), str(path)), schema, str(path))


def load_json(schema: type[T], path: Path | str, what: str) -> T:
    """Fills a schema from a JSON file; see `load_yaml`."""
    return convert(parse_json(read_text(path, what), str(path)), schema, str(path))


def convert(data: object, schema: type[T], source: str) -> T:
    """Fills a dataclass, or a type built of them, from what YAML or JSON holds.

    An integer does for a float, null in an array of numbers is NaN. InputError if a
    field is unknown, missing, of another type, or refused by a schema's own
    __post_init__: with `source`, the file, before it.
    """
    for place, name, known in _unknown_fields(data, inspect.type_info(schema), ""):
        near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.7)
        hint = f"; did you mean '{near[0]}'?" if near else "."
        raise InputError(
            f"{source}: unknown field {show(name)}{f' of {place}' if place else ''}, "
            f"expected one of {', '.join(known)}{hint}"
        )
    try:
        return msgspec.convert(data, schema, dec_hook=_decode)
    except msgspec.ValidationError as error:
        if isinstance(error.__cause__, InputError):
            raise InputError(f"{source}: {error.__cause__}") from None
        message = _with_key(str(error), data, schema)
        raise InputError(_sentence(message, data, source)) from None


def to_builtins(value: object) -> Any:
    """Returns a value as JSON has it: no arrays, None for NaN and infinity."""
    return json.loads(json_text(value))


def json_text(value: object, indent: int = 2) -> str:
    """Returns a value as JSON text; null for NaN and infinity."""
    packed = msgspec.json.encode(value, enc_hook=_encode)
    return msgspec.json.format(packed, indent=indent).decode()


def yaml_text(value: Any) -> str:
    """A dataclass or a dict as YAML text, without the top fields that are None."""
    fields = value if isinstance(value, dict) else dataclasses.asdict(value)
    return yaml.dump(
        {name: field for name, field in fields.items() if field is not None},
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=88,
    )


class _Loader(yaml.SafeLoader):
    """Takes 1e-3 for a number, as YAML 1.2 does; PyYAML alone reads text.

    A field that is there twice is refused; PyYAML alone takes the last.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Makes a dict of a mapping whose fields are there once."""
        known: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value != "<<":
                if key.value in known:
                    problem = f"field '{key.value}' is there twice"
                    raise yaml.constructor.ConstructorError(
                        problem=problem, problem_mark=key.start_mark
                    )
                known.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


class _Dumper(yaml.SafeDumper):
    """Writes NumPy's floats as numbers, and repeated lists in full."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _represent_list(dumper: _Dumper, values: list | tuple) -> yaml.Node:
    """Writes numbers on one line, and everything else one below the other."""
    numbers = all(isinstance(value, (int, float)) for value in values)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, numbers)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(tuple, _represent_list)
_Dumper.add_representer(np.ndarray, lambda dumper, x: dumper.represent_data(x.tolist()))
_Dumper.add_multi_representer(float, lambda dumper, x: dumper.represent_float(float(x)))


def _encode(value: object) -> object:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return float(value) if isinstance(value, Number) else str(value)


def _decode(kind: type, value: Any) -> object:
    if kind is Number:
        if isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
            raise ValueError("Expected a number")
        return Number(math.nan if value is None else value)
    if kind is np.ndarray:
        try:
            return np.array(value, dtype=float)  # None becomes NaN.
        except (TypeError, ValueError):
            raise ValueError("Expected a list of numbers") from None
    raise TypeError(f"{kind.__name__} cannot be read from a file")


def _unknown_fields(
    data: object, info: inspect.Type, place: str
) -> Iterator[tuple[str, str, list[str]]]:
    """Yields place, name and the known names of each field that a schema lacks."""
    if isinstance(info, inspect.UnionType):
        # At most one of a union's types has fields: a dataclass, or a list of them.
        for option in info.types:
            yield from _unknown_fields(data, option, place)
    elif isinstance(info, inspect.DataclassType) and isinstance(data, dict):
        fields = {field.encode_name: field.type for field in info.fields}
        for name, value in data.items():
            if name not in fields:
                yield place, name, list(fields)
            else:
                yield from _unknown_fields(value, fields[name], _join(place, name))
    elif isinstance(info, inspect.CollectionType) and isinstance(data, list):
        for i, value in enumerate(data):
            yield from _unknown_fields(value, info.item_type, f"{place}[{i}]")
    elif isinstance(info, inspect.DictType) and isinstance(data, dict):
        for name, value in data.items():
            yield from _unknown_fields(value, info.value_type, _join(place, name))


def _join(place: str, name: object) -> str:
    return f"{place}.{name}" if place else str(name)


def _sentence(message: str, data: Any, source: str) -> str:
    """Returns msgspec's message as ours: field, what was found, what was expected."""
    message, _, path = message.partition(" - at `$")
    path = path.rstrip("`").lstrip(".")
    if missing := re.match(r"Object missing required field `(\w+)`", message):
        return f"{source}: '{_join(path, missing[1])}' is missing."
    found = re.sub(r"`([\w| ]+)`", _named, message.partition(", got")[0])
    expected = found[0].lower() + found[1:]
    place = f"field '{path}' is " if path else "found "
    return f"{source}: {place}{show(_at(data, path))}; {expected}."


def _with_key(message: str, data: Any, schema: type) -> str:
    """Returns msgspec's message with the key of a mapping where it says "[...]".

    It is the key that alone in the mapping is refused likewise.
    """
    before, unknown, after = message.partition("[...]")
    if not unknown:
        return message
    path = before.partition("`$")[2].lstrip(".")
    alone = copy.deepcopy(data)
    kept = _at(alone, path)
    for key, value in _at(data, path).items():
        kept.clear()
        kept[key] = value
        try:
            msgspec.convert(alone, schema, dec_hook=_decode)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return f"{before}.{key}{after}"
    return message


def _named(types: re.Match) -> str:
    return " or ".join(_WORDS.get(t.strip(), t.strip()) for t in types[1].split("|"))


def _at(data: Any, path: str) -> Any:
    """Returns what stands at a path such as vehicle.limits[0]; mappings as a whole."""
    for name, index in re.findall(r"([^.\[\]]+)|\[(\d+|\.{3})\]", path):
        if isinstance(data, dict) and name in data:
            data = data[name]
        elif index.isdigit() and isinstance(data, list):
            data = data[int(index)]
        else:
            return data
    return data
