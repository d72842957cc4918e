"""A model survives its file, and what is wrong in a file is named."""

import dataclasses
import math

import numpy as np
import pytest

from glider.errors import InputError
from glider.files import schema
from glider.paths import models_path
from glider.physics.confidence import make_confidence
from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS, LIBRARY, NO_GAUSSIANS, PROFILE_DRAG, WIND
from glider.physics.effects.free_functions import ROWS, FreeFunction, gaussians_of
from glider.physics.model import GliderModel, Origin, as_model, load_covariance
from glider.physics.parameters import GliderParameters
from tests.helpers.physics import FREE, at_work


@pytest.mark.parametrize(
    "model",
    [
        GliderModel(),
        GliderModel(parameters=GliderParameters(mass=0.1, wing_offset=-0.03)),
        GliderModel(effects=(WIND(x=-1 / 3, z=0.1), PROFILE_DRAG(cd0=0.05))),
        GliderModel(
            effects=tuple(at_work(kind) for kind in LIBRARY), free_functions=FREE
        ),
    ],
    ids=["nominal", "parameters", "effects", "all"],
)
def test_a_model_comes_back_from_its_file_unchanged(tmp_path, model):
    path = tmp_path / "model.yaml"
    model.save(path)
    assert GliderModel.load(path) == model
    first = path.read_text()
    GliderModel.load(path).save(path)
    assert path.read_text() == first


def test_how_well_a_model_is_known_comes_back_from_its_file(tmp_path):
    path = tmp_path / "model.yaml"
    model = GliderModel(effects=(WIND(x=-0.6, z=0.1),))
    matrix = np.array([[1.2e-7, 1e-8 / 3.0], [1e-8 / 3.0, 4e-9]])
    known = Covariance(names=("wind.x", "mass"), matrix=matrix)
    model.save(path, covariance=known)
    assert GliderModel.load(path) == model
    again = load_covariance(path)
    assert again.names == known.names
    np.testing.assert_array_equal(again.matrix, matrix)
    model.save(path)
    assert load_covariance(path) is None
    assert "covariance" not in path.read_text()


def test_a_flight_depends_on_no_sensor():
    names = ("mass", "wind.x", "pitch_offset.angle")
    known = Covariance(names=names, matrix=np.diag([1.0, 2.0, 3.0]))
    model = GliderModel(effects=(WIND(x=-0.5), KINDS["pitch_offset"](angle=0.1)))
    part = make_confidence(model, known).covariance
    assert part.names == ("mass", "wind.x")
    np.testing.assert_array_equal(part.matrix, np.diag([1.0, 2.0]))


def test_the_coefficients_follow_one_another():
    model = GliderModel(effects=(WIND(x=-0.5, z=0.1), PROFILE_DRAG(cd0=0.05)))
    np.testing.assert_array_equal(model.numbers.c, [-0.5, 0.1, 0.05])
    assert GliderModel().numbers.c.shape == (0,)


def test_a_file_says_only_what_it_changes(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(
        "parameters: {mass: 0.09}\n"
        "effects:\n"
        "  - {kind: wind, coefficients: {x: -0.6}}\n"
        "  - {kind: dynamic_stall}\n"
    )
    with pytest.warns(UserWarning, match="pitch_inertia, wing_area") as caught:
        model = GliderModel.load(path)
    assert "mass" not in str(caught[0].message)
    assert caught[0].filename == __file__
    assert model.parameters == GliderParameters(mass=0.09)
    assert [e.to_dict() for e in model.effects] == [
        {"x": -0.6, "z": 0.0},
        {"strength": 0.0, "time_constant": 0.08},
    ]
    assert model.gaussians is NO_GAUSSIANS


def test_a_reading_is_measured_and_moves_nothing():
    data = FreeFunction(
        variables=["pitch"],
        centers=[[0.1]],
        widths=[0.5],
        weights={"pose_pitch": [0.04]},
    )
    both = GliderModel(free_functions=(data,)), GliderModel()
    state = np.array([1.0, 2.0, 0.1, 0.0, 6.0, 0.0, 0.0])
    shown = [own.chain.measure(state, own.numbers) for own in both]
    np.testing.assert_allclose(np.subtract(*shown), [0.0, 0.0, 0.04])
    at = 0.0, state, 0.0, 0.0, 0.0
    rates = [own.chain.derivatives(*at, own.numbers) for own in both]
    np.testing.assert_array_equal(*rates)


def test_gaussians_of_different_widths_add_like_functions_of_one(tmp_path):
    one = {"variables": ["x", "V"], "weights": {"c_drag": [1.0]}}
    first = FreeFunction(centers=[[-2.0, 5.0]], widths=[0.5, 2.0], **one)
    second = FreeFunction(centers=[[0.0, 6.0]], widths=[0.1, 2.0], **one)
    both = FreeFunction(
        variables=["x", "V"],
        centers=[[-2.0, 5.0], [0.0, 6.0]],
        widths=[[0.5, 0.1], 2.0],
        weights={"c_drag": [1.0, 1.0]},
    )
    GliderModel(free_functions=(both,)).save(tmp_path / "model.yaml")
    read = GliderModel.load(tmp_path / "model.yaml").gaussians
    apart = gaussians_of([first, second])
    for array, expected in zip(read, apart, strict=True):
        np.testing.assert_array_equal(array, expected)


def test_the_arrays_of_free_functions():
    arrays = GliderModel(free_functions=FREE).gaussians
    assert (arrays.num_air, arrays.num_flown) == (2, 5)
    np.testing.assert_array_equal(
        arrays.centers[:, 2], [-1, 0, 0.2, *4 * [0], 6, 0.3, 0, 0]
    )
    np.testing.assert_allclose(
        arrays.inverse_widths[:, 1], [1 / 1.5, 0, 2, 2.5, *7 * [0]]
    )
    np.testing.assert_array_equal(arrays.inverse_widths[:, 4], 0.0)  # The constant.
    np.testing.assert_array_equal(arrays.weights[:, 4], [0, 0, 0.1, 0.05, *13 * [0]])


def test_a_gaussian_of_several_functions_is_evaluated_once_and_where_it_acts():
    same = {"variables": ["x"], "centers": [[-2.0], [0.0]], "widths": [0.5]}
    functions = [
        FreeFunction(**same, weights={"c_lift": [1.0, 0.0], "c_drag": [0.5, 0.0]}),
        FreeFunction(**same, weights={"pose_x": [0.1, 0.2]}),
        FreeFunction(**same, weights={"c_lift": [2.0, 0.0]}),
    ]
    arrays = gaussians_of(functions)
    assert (arrays.num_air, arrays.num_flown) == (0, 1)
    np.testing.assert_array_equal(arrays.centers[0], [-2.0, -2.0, 0.0])
    terms = [ROWS[name] for name in ("c_lift", "c_drag", "pose_x")]
    expected = [[3.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.1, 0.2]]
    np.testing.assert_allclose(arrays.weights[terms], expected)


@pytest.mark.parametrize(
    ("name", "variable", "words"),
    [("wind_z", "V", "x, z, t, pitch, pitchdot"), ("pose_x", "alpha", "x, z, pitch")],
)
def test_what_a_free_function_cannot_vary_with_is_refused(name, variable, words):
    """Air is met before its speed is known; a reading shows the pose alone."""
    data = FreeFunction(
        variables=[variable], centers=[[1.0]], widths=[1.0], weights={name: [1.0]}
    )
    with pytest.raises(InputError, match=f"variables of.*{variable}.*some of {words}"):
        gaussians_of([data])


def free(text):
    """Returns the text of a model with one free function."""
    return f"free_functions: [{{{text}}}]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("parameters: {mass: -1}", "'mass'"),
        ("parameters: {masse: 1}", "masse"),
        ("effects: [{kind: wnid}]", "unknown effect 'wnid'"),
        ("effects: [{kind: wind, coefficients: {y: 1.0}}]", "'y'"),
        ("effects: [{kind: wind, coefficients: {x: 99.0}}]", "'x' is 99"),
        ("effects: [{kind: wind, coefficients: {x: .nan}}]", "finite"),
        ("effects: [{kind: wind, values: {x: 1.0}}]", "values"),
        (free("variables: [altitude], widths: [1.0]"), "'altitude'"),
        (free("variables: [x], widths: [0.0]"), "widths"),
        (free("variables: [x], widths: []"), "widths"),
        (free("variables: [x], widths: [[1]], centers: [[0], [1]]"), "widths"),
        (free("variables: [x], widths: [[1, 0]], centers: [[0], [1]]"), "widths"),
        (free("variables: [x], widths: [[1, .nan]], centers: [[0], [1]]"), "finite"),
        (free("variables: [x], widths: [1.0], centers: [[1.0, 2.0]]"), "center 0"),
        (free("constant: true, weights: {c_lift: [1.0, 2.0]}"), "'c_lift'"),
        (free("weights: {c_left: [1.0]}"), "'c_left'"),
        (
            free("variables: [V], widths: [1], weights: {pose_z: []}"),
            "variables of pose_z is ['V']; expected some of x, z, pitch",
        ),
        (
            "covariance: {names: [wind.x], matrix: [[1.0]]}",
            "a name is 'wind.x'; expected",
        ),
        ("covariance: {names: [mass, mass], matrix: [[1, 0], [0, 1]]}", "none twice"),
        (
            "covariance: {names: [mass], matrix: [[1.0, 0.0]]}",
            "shape is [1, 2]; expected (1, 1)",
        ),
        (
            "covariance: {names: [mass, wing_area], matrix: [[1.0]]}",
            "shape is [1, 1]; expected (2, 2)",
        ),
        (
            "covariance: {names: [], matrix: [[1.0]]}",
            "shape is [1, 1]; expected (0, 0)",
        ),
        ("covariance: {names: [mass]}", "'covariance.matrix' is missing"),
        ("covariance: {names: [mass], matrix: [[.nan]]}", "expected finite numbers"),
        ("covariance: {names: [mass], matrix: [[-1.0]]}", "variance of 'mass' is -1.0"),
        (
            "covariance: {names: [mass, wing_area], matrix: [[1, 0.1], [0.2, 1]]}",
            "[0.1, 0.2]; expected one value",
        ),
        (
            "covariance: {names: [mass, wing_area], matrix: [[1, 2], [2, 1]]}",
            "correlations is -1.0",
        ),
        (
            "covariance: {names: [mass, wing_area], matrix: [[0, 1], [1, 1]]}",
            "eigenvalue",
        ),
        ("covariance: {names: mass, matrix: [[1.0]]}", "names' is 'mass'; expected a"),
        (
            "covariance: {names: [mass], matrix: [[one]]}",
            "[['one']]; expected a list of numbers",
        ),
        ("covariance: 3", "'covariance' is 3; expected a mapping"),
        ("- 1", "found [1]; expected a mapping of fields"),
        ("effects: [", "line 2, column 1"),
        ("effects: 3", "'effects' is 3; expected a list"),
        ("effects: [wind]", "'effects[0]' is 'wind'; expected a mapping"),
        ("parameters: [1]", "'parameters' is [1]; expected a mapping"),
        ("5: 6", "unknown field 5, expected one of parameters"),
        ("effects: [{kind: wind, coefficients: [1]}]", "' is [1]; expected a mapping"),
        ("effects: [{kind: wind}, {kind: wind}]", "effect 'wind' is given twice"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, words):
    path = tmp_path / "model.yaml"
    path.write_text(text + "\n")
    with pytest.raises(InputError) as error:
        GliderModel.load(path)
    assert words in str(error.value)
    assert "model.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.yaml: .*: No such file"):
        GliderModel.load(tmp_path / "absent.yaml")


def test_a_path_stands_for_the_model_in_its_file(tmp_path):
    model, path = GliderModel(effects=(WIND(x=-0.5),)), tmp_path / "model.yaml"
    model.save(path)
    assert as_model(model) is model
    assert as_model(path) == model
    assert as_model(str(path)) == model


@pytest.mark.parametrize(
    ("thing", "found"),
    [
        (5, "int"),
        (None, "NoneType"),
        (["model.yaml"], "list"),
        (GliderModel, "type"),
        (GliderParameters(), "GliderParameters"),
        (WIND, "EffectKind"),
    ],
)
def test_what_is_neither_a_model_nor_a_path_is_refused(thing, found):
    with pytest.raises(
        InputError, match=f"found {found}; expected a GliderModel or the"
    ):
        as_model(thing)


@pytest.mark.parametrize("name", ["centers", "widths", "weights"])
def test_a_free_function_that_is_no_number_is_refused(name):
    parts = {"centers": [[0.3]], "widths": [0.2], "weights": {"c_drag": [0.1]}}
    wrong = {
        "centers": [[math.nan]],
        "widths": [math.nan],
        "weights": {"c_drag": [math.inf]},
    }
    data = FreeFunction(variables=["alpha"], **{**parts, name: wrong[name]})
    with pytest.raises(InputError, match="finite numbers"):
        gaussians_of([data])


def test_an_unknown_servo_is_not_invented(tmp_path):
    """Its limits are null in the file, and None when it is read again."""
    parameters = GliderParameters(elevator_limits=None, elevator_rate_limit=None)
    GliderModel(parameters=parameters).save(tmp_path / "model.yaml")
    model = GliderModel.load(tmp_path / "model.yaml")
    assert model.parameters == parameters
    with pytest.raises(InputError, match="has no servo limits"):
        _ = model.parameters.servo


def test_where_a_model_comes_from_does_not_change_it(tmp_path):
    path, model = tmp_path / "model.yaml", GliderModel(effects=(WIND(x=-0.6, z=0.1),))
    origin = Origin(source="throws", date="2026-01-01", standard_errors={"wind.x": 0.1})
    model.save(path, origin)
    assert "standard_errors" in path.read_text()
    assert GliderModel.load(path) == model


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"parameters": {"mass": 0.1}}, ("'parameters'", "{mass: 0.1}", "GliderParam")),
        ({"effects": WIND(x=-0.5)}, ("'effects'", "WIND(x=-0.5, z=0.0)", "such as (")),
        ({"effects": (WIND,)}, ("one of them", "WIND", "(WIND(...),)")),
        ({"effects": ("wind",)}, ("one of them", "'wind'")),
        ({"mass": 0.1}, ("'mass'", "GliderParameters(mass=")),
    ],
)
def test_what_is_no_field_of_a_model_is_refused_in_one_sentence(fields, words):
    with pytest.raises(InputError) as caught:
        GliderModel(**fields)
    for word in ("GliderModel: ", *words):
        assert word in str(caught.value)


def test_a_shipped_glider_loads_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = GliderModel.load(models_path("truths", "head_wind.yaml"))
    assert GliderModel.load("head_wind") == as_model("head_wind") == shipped
    (tmp_path / "head_wind").write_text(
        models_path("vehicles", "heavy.yaml").read_text()
    )
    assert GliderModel.load("head_wind").parameters.mass == 0.12  # A file goes first.
    with pytest.raises(InputError, match=r"^tail_wind: does not exist.*head_wind"):
        GliderModel.load("tail_wind")


def test_a_mass_in_grams_is_refused(tmp_path):
    path = tmp_path / "grams.yaml"
    values = dataclasses.asdict(GliderParameters()) | {"mass": 80.0}
    path.write_text(schema.yaml_text({"parameters": values}))
    with pytest.raises(InputError, match=r"grams\.yaml.*'mass'.*80\.0 kg.*in grams"):
        GliderModel.load(path)
