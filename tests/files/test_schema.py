"""Files with a schema: what they give, and one sentence where they do not fit."""

import dataclasses
import json
import math

import numpy as np
import pytest

from glider.errors import InputError
from glider.files import schema


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle:
    mass: float = 1.0
    limits: list[float] | None = None

    def __post_init__(self):
        if self.mass <= 0:
            raise InputError(f"field 'mass' is {self.mass:g}; expected more than 0.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    name: str
    vehicle: Vehicle = dataclasses.field(default_factory=Vehicle)
    values: np.ndarray | None = None
    by_name: dict[str, Vehicle] = dataclasses.field(default_factory=dict)
    several: list[Vehicle] = dataclasses.field(default_factory=list)
    count: int = 0


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"vehicle": {"mas": 1}}, "unknown field 'mas' of vehicle, expected one of"),
        ({"vehicle": {"mas": 1}}, "did you mean 'mass'?"),
        ({"several": [{}, {"ma": 1}]}, r"unknown field 'ma' of several[1]"),
        ({"by_name": {"a": {"ma": 1}}}, "unknown field 'ma' of by_name.a"),
        ({"vehicle": {"mass": "x"}}, "'vehicle.mass' is 'x'; expected a number."),
        ({"vehicle": {"mass": True}}, "'vehicle.mass' is True; expected a number."),
        ({"vehicle": {"mass": -1.0}}, "f.yaml: field 'mass' is -1; expected more"),
        ({"vehicle": 3}, "'vehicle' is 3; expected a mapping of fields."),
        ({"vehicle": {"limits": [1, "a"]}}, "'vehicle.limits[1]' is 'a'; expected"),
        (
            {"by_name": {"a": {}, "b": {"mass": "x"}}},
            "'by_name.b.mass' is 'x'; expected",
        ),
        ({"by_name": {"a": {}, "b.c": 3}}, "'by_name.b.c' is"),
        ({"values": ["a"]}, "'values' is ['a']; expected a list of numbers."),
        ({"count": 1.5}, "'count' is 1.5; expected a whole number."),
        ({"name": None}, "'name' is None; expected text."),
    ],
)
def test_what_does_not_fit_is_one_sentence(fields, message):
    with pytest.raises(InputError) as error:
        schema.convert({"name": "a"} | fields, Report, "f.yaml")
    assert message in str(error.value)
    assert str(error.value).startswith("f.yaml: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [({}, "f: 'name' is missing."), ([], "f: found []; expected a mapping of fields.")],
)
def test_a_file_of_something_else(data, message):
    with pytest.raises(InputError) as error:
        schema.convert(data, Report, "f")
    assert str(error.value) == message


@pytest.mark.parametrize("text", ["a: [", "\t- x", "[" * 100_000])
def test_text_that_is_no_yaml_or_json(text):
    for parse in (schema.parse_yaml, schema.parse_json):
        with pytest.raises(InputError, match="f: not readable as"):
            parse(text, "f")


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00"])
def test_a_file_that_cannot_be_read(tmp_path, content):
    path = tmp_path / "a.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.yaml: not a report: "):
        schema.load_yaml(Report, path, "a report")


def test_what_is_written_is_read_again(tmp_path):
    report = Report(
        name="a", vehicle=Vehicle(limits=[1.0, 1e-5]), values=np.array([1.0, np.nan])
    )
    data = json.loads(schema.json_text(report))
    assert data["values"] == [1.0, None]
    again = schema.convert(data, Report, "f")
    np.testing.assert_array_equal(again.values, report.values)
    assert again.vehicle == report.vehicle
    path = tmp_path / "vehicle.yaml"
    path.write_text(schema.yaml_text(Vehicle(mass=np.float64(1e-7), limits=[2.0, 3.0])))
    assert schema.load_yaml(Vehicle, path, "a vehicle").mass == 1e-7


def test_json_has_no_nan_and_no_infinity():
    data = schema.to_builtins({"a": math.nan, "b": [math.inf, np.float64(1.0)]})
    assert data == {"a": None, "b": [None, 1.0]}


@pytest.mark.parametrize("text", ["{a: 1, b: 2, a: 3}", "p:\n  a: 1\n  a: 1\n"])
def test_a_field_that_is_there_twice_is_refused(text):
    """The last would count, and the first be lost without a word."""
    with pytest.raises(InputError, match="field 'a' is there twice"):
        schema.parse_yaml(text, "f.yaml")


def test_a_merged_field_may_be_replaced():
    text = "base: &b {a: 1, c: 2}\nown:\n  <<: *b\n  a: 3\n"
    assert schema.parse_yaml(text, "f.yaml")["own"] == {"a": 3, "c": 2}
