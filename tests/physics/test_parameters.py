"""Vehicles load as their files tell, and what cannot be one is refused."""

import dataclasses

import pytest
import yaml

from glider.errors import InputError
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import PARAMETER_NAMES, GliderParameters, load_parameters

# m, I, S_w, S_e, l_w, l_h, l_e, rho, g: the table of reference-facts.md, in the
# order of PARAMETER_NAMES.
VEHICLES = {
    "perching": [0.08, 0.0015, 0.0885, 0.0147, 0.0, 0.27, 0.022, 1.204, 9.81],
    "heavy": [0.12, 0.0015, 0.0885, 0.0147, 0.0, 0.27, 0.022, 1.292, 9.81],
    "heavy_ekf": [0.12, 0.0015, 0.0885, 0.0147, -0.03, 0.27, 0.022, 1.292, 9.81],
}


def vehicle_file(name):
    return models_path("vehicles", f"{name}.yaml")


@pytest.fixture
def write(tmp_path):
    """Writes a vehicle that differs from the perching one in some lines."""

    def write_vehicle(**changes):
        path = tmp_path / "vehicle.yaml"
        fields = yaml.safe_load(vehicle_file("perching").read_text()) | changes
        path.write_text(yaml.safe_dump(fields))
        return path

    return write_vehicle


@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_has_the_numbers_of_its_file(name):
    parameters = load_parameters(vehicle_file(name))
    assert list(GliderModel(parameters=parameters).numbers.p) == VEHICLES[name]
    # The travel is larger with the trailing edge up, which is nose up.
    assert parameters.elevator_limits == [-0.4463, 0.9473]
    assert parameters.elevator_rate_limit == 13.0


def test_every_vehicle_is_in_the_table():
    assert {path.stem for path in models_path("vehicles").iterdir()} == set(VEHICLES)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_file_writes_every_field_with_its_unit(name):
    names = {field.name for field in dataclasses.fields(GliderParameters)}
    lines = vehicle_file(name).read_text().splitlines()
    fields = [line for line in lines if not line.startswith("#")]
    assert {line.split(":")[0] for line in fields} == names
    for line in fields:
        assert line.split("# ")[1].split(",")[0].split("^")[0] in {
            "kg",
            "kg m",
            "kg/m",
            "m",
            "m/s",
            "rad",
            "rad/s",
        }


def test_the_defaults_are_the_perching_glider():
    assert load_parameters(vehicle_file("perching")) == GliderParameters()


def test_the_numbers_go_by_their_names():
    values = {name: 1.0 + i for i, name in enumerate(PARAMETER_NAMES)}
    model = GliderModel(parameters=GliderParameters(**values))
    assert model.numbers.p._asdict() == values


def test_the_servo_has_the_limits_of_the_vehicle():
    parameters = GliderParameters(elevator_limits=[-0.3, 0.7], elevator_rate_limit=5)
    assert parameters.servo == (-0.3, 0.7, 5.0)


def test_a_file_says_only_what_it_changes(tmp_path):
    path = tmp_path / "light.yaml"
    path.write_text("mass: 0.06\n")
    assert load_parameters(path) == GliderParameters(mass=0.06)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mass", -0.08),
        ("mass", 0.0),
        ("mass", float("nan")),
        ("mass", float("inf")),
        ("mass", "heavy"),
        ("mass", [0.08]),
        ("pitch_inertia", -0.0015),
        ("wing_area", 0.0),
        ("elevator_area", -0.0147),
        ("air_density", 0.0),
        ("gravity", -9.81),
        ("hinge_offset", "0.27 m"),
        ("hinge_offset", -0.27),
        ("elevator_rate_limit", 0.0),
        ("elevator_limits", [0.9473, -0.4463]),
        ("elevator_limits", [0.1, 0.1]),
        ("elevator_limits", [0.9473]),
        ("elevator_limits", [-0.4463, 0.0, 0.9473]),
        ("elevator_limits", [-0.4463, float("nan")]),
        ("elevator_limits", [-0.4463, "up"]),
        ("elevator_limits", 0.9473),
        ("elevator_limits", [-25, 54]),
        ("wing_aera", 0.0885),
        ("masse", 0.08),
    ],
)
def test_a_field_that_cannot_be_is_refused_by_file_and_name(write, field, value):
    path = write(**{field: value})
    with pytest.raises(InputError) as error:
        load_parameters(path)
    message = str(error.value)
    assert str(path) in message
    assert field in message
    assert "\n" not in message


@pytest.mark.parametrize("value", ["heavy", "0.08 kg"])
def test_text_for_a_number_is_refused_by_file(write, value):
    with pytest.raises(InputError, match=r"vehicle\.yaml.*" + value):
        load_parameters(write(mass=value))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("gravity", 0.0),
        ("wing_offset", -0.03),
        ("elevator_limits", [-0.4463, 0]),
        ("mass", 1),
    ],
)
def test_what_only_looks_odd_is_allowed(write, field, value):
    assert getattr(load_parameters(write(**{field: value})), field) == value


@pytest.mark.parametrize("text", ["", "- 0.08\n- 0.0015\n", "just text\n", "mass: [\n"])
def test_a_file_that_is_no_list_of_fields_is_refused(tmp_path, text):
    path = tmp_path / "vehicle.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"vehicle\.yaml"):
        load_parameters(path)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"absent\.yaml"):
        load_parameters(tmp_path / "absent.yaml")


@pytest.mark.parametrize("value", [-0.08, 0.0, float("nan"), "0.08", True, None])
def test_a_mass_that_cannot_be_is_refused_from_python_too(value):
    with pytest.raises(InputError, match=r"^field 'mass' is "):
        GliderParameters(mass=value)
