"""Functions without a formula find what acts."""

import dataclasses

import numpy as np
import pytest

from benchmarks.bench_forms import draw
from benchmarks.other_forms import FORMS
from glider.campaign.turning import Signs
from glider.physics.effects import FLOW_VARIABLES, KINDS
from glider.physics.effects.families import FAMILIES
from glider.physics.effects.free_functions import (
    ROWS,
    FreeFunction,
    basis_function,
    gaussians_of,
)
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.constants import EVIDENCE_THRESHOLD, PRIOR_SCALES
from glider.sysid.likelihood.fitted_functions import (
    _variables_between,
    flown_values,
    make_functions,
)
from glider.sysid.likelihood.model_fit import fit_model, linear_flight
from glider.sysid.outcome import model_of
from glider.sysid.search.moves import Search
from glider.sysid.search.subsets import survey
from tests.helpers.tasks import begin, fly, task_of

VENT = FreeFunction(
    kind="unexplained",
    variables=["x"],
    centers=[[-1.8]],
    widths=[0.3],
    weights={"wind_z": [1.0]},
)


TOW = FreeFunction(
    kind="unexplained",
    variables=["t"],
    centers=[[0.0]],
    widths=[0.06],
    weights={"push": [3.0]},
)


SHED = FreeFunction(
    kind="unexplained",
    variables=["alpha"],
    centers=[[0.0]],
    widths=[0.4],
    weights={"added_mass": [0.3]},
)


def searched(function, flights=6, seed=0, kinds=None):
    """A search in flights through a free function, and the plate fitted to them."""
    rng = np.random.default_rng(seed)
    campaign = CampaignPlan(flights=flights).simulate(
        GliderModel(free_functions=(function,)), rng
    )
    task, noise = task_of(campaign)
    if kinds is not None:
        task = dataclasses.replace(task, kinds=kinds)
    search = Search(task, lambda text: None)
    return search, search.fit(begin(task, noise))


@pytest.fixture(scope="module")
def vent():
    return searched(VENT)


def test_functions_of_the_same_variables_have_their_own_gaussians(vent):
    search, plate = vent
    function = search.task.functions["air along z over x"]
    wide = dataclasses.replace(function, widths=2.0 * function.widths)
    apart = dataclasses.replace(function, centers=function.centers + 0.1)
    record = search.task.records[0]
    functions = [function, wide, apart, function]
    found = linear_flight(plate, (), record, functions).expanded()
    blocks = np.split(found.inputs[..., :-1], len(functions), axis=2)
    for own, block in zip(functions, blocks, strict=True):
        alone = linear_flight(plate, (), record, [own]).expanded()
        np.testing.assert_array_equal(block, alone.inputs[..., :-1])
    assert len({block.tobytes() for block in blocks}) == 3


def test_a_vent_is_seen_over_x_and_as_moving_air(vent):
    search, plate = vent
    found = survey(search.task, plate)
    assert max(found, key=found.__getitem__) == "air along z over x"
    assert found["air along z over x"] > EVIDENCE_THRESHOLD
    others = [gain for name, gain in found.items() if not name.startswith("air")]
    assert max(others) < found["air along z over x"]


def test_beside_errors_of_the_forces_functions_are_seen_too(vent):
    search, plate = vent
    forces = dataclasses.replace(plate, has_force_errors=True)
    found = survey(search.task, forces)
    assert max(found, key=found.__getitem__) == "air along z over x"
    assert found.keys() == survey(search.task, plate).keys()


def test_where_nothing_is_nothing_is_seen():
    task, noise = task_of(fly(flights=6))
    assert max(survey(task, fit_model(task, begin(task, noise))).values()) < 0.0


def test_about_a_model_that_diverges_nothing_is_seen(vent):
    search, model = vent
    lost = dataclasses.replace(model, theta=np.full_like(model.theta, np.nan))
    assert survey(search.task, lost) == {}


def test_the_function_is_the_vent(vent):
    """Of the right height and place; it blows upward alone."""
    search, plate = vent
    found = search.improved(plate)
    assert found.kinds == ("air along z over x",)
    assert search._renamed(found, search.near(found)) is None
    (own,) = found.functions
    x = np.linspace(-2.6, -1.0, 161)[:, None]
    blown = own.gaussians(x) @ own.weights
    assert x[np.argmax(blown), 0] == pytest.approx(-1.8, abs=0.05)
    assert blown.max() == pytest.approx(1.0, abs=0.1)


@pytest.mark.nightly
def test_a_tow_after_the_release_is_a_force_along_the_body_that_ends():
    """Not a drag, nor moving air: it does not depend on the airspeed."""
    search, plate = searched(TOW, kinds=("thrust", "profile_drag", "mass", "wind"))
    found = search.improved(plate)
    assert set(found.kinds) <= {"push over t", "thrust"}
    own = found.by_name["push over t"]
    t = np.array([0.03, 0.06, 0.3, 0.7])
    pushed = own.gaussians(t[:, None]) @ own.weights
    index, start = search.task.space.index, search.task.vehicle.theta
    thrust = found.theta[index["thrust.force"]]
    pushed += thrust / start[index["mass"]]
    true = 3.0 * np.exp(-0.5 * (t / 0.06) ** 2)
    assert pushed == pytest.approx(true, abs=0.3)


@pytest.mark.nightly
def test_air_that_a_stalled_wing_no_longer_carries_is_an_added_mass_over_alpha():
    """Neither drags nor a moment by the pitch rate, which stood in for it."""
    search, plate = searched(SHED, kinds=("added_mass", "inertia", "induced_drag"))
    found = search.improved(plate)
    assert found.free_kinds == ("added mass over alpha",)
    assert set(found.kinds) <= {"added mass over alpha", "added_mass"}
    own = found.by_name["added mass over alpha"]
    alpha = np.linspace(0.1, 1.0, 19)[:, None]
    carried = own.gaussians(alpha) @ own.weights
    index, start = search.task.space.index, search.task.vehicle.theta
    mass = found.theta[index["added_mass.mass"]]
    carried += mass / start[index["mass"]]
    true = 0.3 * np.exp(-0.5 * (alpha[:, 0] / 0.4) ** 2)
    assert carried == pytest.approx(true, abs=0.05)


def test_a_glider_that_turns_over_is_backward_in_between():
    """Not halfway between -π and π, where its angle of attack would be zero."""
    values = np.zeros((4, len(FLOW_VARIABLES)))
    values[:, 0] = [0.0, 1.0, 2.0, 4.0]
    values[:, FLOW_VARIABLES.index("alpha")] = [2.9, 3.1, -3.1, 3.0]
    middle = _variables_between(values)
    np.testing.assert_allclose(middle[:, 0], [0.5, 1.5, 3.0])
    alpha = middle[:, FLOW_VARIABLES.index("alpha")]
    np.testing.assert_allclose(np.cos(alpha), np.cos([3.0, np.pi, 3.0916]), atol=1e-4)
    assert np.all(np.abs(alpha) <= np.pi)


def test_every_family_is_of_the_library():
    for name, kind in FAMILIES.items():
        assert set(kind.formulas) <= set(KINDS), name
        assert set(kind.formulas) <= kind.bends <= set(KINDS)


@pytest.mark.nightly
def test_a_stream_of_another_form_is_one_family_not_several_effects():
    """A downwash of which no formula has the shape: no second effect stands in."""
    bump = FreeFunction(
        kind="unexplained",
        variables=["alpha"],
        centers=[[0.25]],
        widths=[0.12],
        weights={"tail_downwash": [0.15]},
    )
    search, plate = searched(bump, flights=8)
    found = search.improved(plate)
    assert found.free_kinds == ("stream at the tail over alpha",)
    assert not set(found.kinds) - {*found.free_kinds, "downwash", "stalled_downwash"}


@pytest.mark.nightly
def test_a_damping_that_fades_with_alpha_is_a_function_of_two(tmp_path, monkeypatch):
    """Its model file holds it, and flies."""
    form = FORMS["damping"]["attached_damping"]
    monkeypatch.setitem(FORMS, "damping", {"attached_damping": form})
    campaign, _ = draw(2, family="damping", count=1)
    task, noise = task_of(campaign)
    task = dataclasses.replace(task, kinds=("pitch_damping", "mass"))
    plate = fit_model(task, begin(task, noise))
    found = Search(task, lambda text: None).improved(plate)
    assert "moment over alpha and reduced_rate" in found.free_kinds
    model = model_of(task, found, Signs())
    model.save(tmp_path / "model.yaml")
    again = GliderModel.load(tmp_path / "model.yaml")
    assert any("reduced_rate" in own.variables for own in again.free_functions)
    flown = CampaignPlan(flights=1).simulate(again, np.random.default_rng(0))
    plate = CampaignPlan(flights=1).simulate(GliderModel(), np.random.default_rng(0))
    pitch, other = (c.flights[0].pose[:, 2] for c in (flown, plate))
    count = min(len(pitch), len(other))
    assert np.abs(pitch[:count] - other[:count]).max() > 0.01


def test_functions_are_spread_over_what_was_flown(vent):
    search, plate = vent
    functions = make_functions(flown_values(search.task.records, plate.theta))
    assert set(functions) == set(FAMILIES)
    own = functions["wing's force over V"]
    assert own.centers[0, 0] < 5.0 < own.centers[-1, 0]


@pytest.mark.parametrize("term", ["x", "z"])
def test_a_lens_is_an_error_of_measured_positions_within_the_noise(vent, term):
    """-5 mm/m³ r² of each coordinate, by the radius about a center before the perch."""
    search, plate = vent
    function = search.task.functions[f"measured {term} over x and z"]
    flown = flown_values(search.task.records, plate.theta)[:, function.columns]
    from_center = flown + np.array([1.0, 0.0])
    error = -5e-3 * np.sum(from_center**2, axis=1) * from_center[:, "xz".index(term)]
    shown = function.gaussians(flown) @ function.mix
    both = np.hstack([shown, np.ones((len(flown), 1))])  # It varies about its mean.
    weights = np.linalg.lstsq(both, error, rcond=1e-5)[0]
    assert np.std(error) > 2e-3 and np.std(error - both @ weights) < 1e-4
    assert np.std(weights[:-1]) < PRIOR_SCALES


def left_by(function, values, term):
    """Share (RMS) of a term that a function of moderate weights does not show."""
    shown, prior = (
        function.gaussians(values) @ function.mix,
        0.1 * np.eye(function.count),
    )
    rows = np.vstack([shown / (0.01 * np.std(term)), prior])
    right = np.append(term / (0.01 * np.std(term)), np.zeros(function.count))
    weights = np.linalg.lstsq(rows, right, rcond=None)[0]
    return np.std(term - shown @ weights) / np.std(term)


def test_a_stall_in_two_steps_is_shown_to_four_percent(vent):
    """Gaussians of one width, 0.08 rad, leave seven percent."""
    search, plate = vent
    function = search.task.functions["lift over alpha"]
    alpha = flown_values(search.task.records, plate.theta)[:, function.columns]
    lost = 0.5 * sum(
        np.clip((np.abs(alpha[:, 0]) - begin) / 0.08, 0.0, 1.0) for begin in (0.2, 0.4)
    )
    assert left_by(function, alpha, 3.0 * np.sin(alpha[:, 0]) * (1.0 - lost)) < 0.04
    assert np.ptp(function.widths[:, 0]) > 0.5 * function.widths.max()


def test_a_lift_that_saturates_with_the_rate_is_shown_to_two_percent(vent):
    """Three Gaussians over the rate leave four percent."""
    search, plate = vent
    function = search.task.functions["lift over alpha and reduced_rate"]
    values = flown_values(search.task.records, plate.theta)[:, function.columns]
    alpha, rate = values.T
    attached = 0.5 - 0.5 * np.tanh((np.abs(alpha) - 0.45) / 0.15)
    assert (
        left_by(function, values, 0.15 * np.tanh(0.2 * rate / 0.15) * attached) < 0.025
    )


def test_gaussians_go_beyond_the_flown_range(vent):
    task = vent[0].task
    function = task.functions["measured x over x and z"]
    flown = flown_values(task.records, task.vehicle.theta)[:, function.columns]
    low, high = np.percentile(flown, [1.0, 99.0], axis=0)
    assert np.all(function.centers.min(axis=0) < low - 0.9 * function.widths)
    assert np.all(function.centers.max(axis=0) > high + 0.9 * function.widths)


def test_an_uneven_pitch_is_an_error_of_the_measured_pitch_alone(vent):
    """With its mean: needing a `pitch_offset` too, others were found in its place."""
    search, plate = vent
    function = search.task.functions["measured pitch over pitch"]
    pitch = flown_values(search.task.records, plate.theta)[:, function.columns]
    error = -0.04 * np.sin(2.0 * pitch[:, 0])
    shown = function.gaussians(pitch) @ function.mix
    left = error - shown @ np.linalg.lstsq(shown, error, rcond=None)[0]
    assert abs(np.mean(error)) > 5e-3 and np.std(error) > 5e-3
    assert np.sqrt(np.mean(left**2)) < 1e-3


@pytest.mark.nightly
def test_a_bent_floor_is_an_error_of_the_measured_height():
    campaign, _ = draw(302, family="sensor_position", count=1)
    task, noise = task_of(campaign)
    plate = fit_model(task, begin(task, noise))
    found = Search(task, lambda text: None).improved(plate)
    assert "measured z over x and z" in found.free_kinds
    assert found.scales.air < 0.01 and found.scales.moment < 0.1


@pytest.mark.parametrize(
    "name", ["drag over alpha", "moment over alpha and reduced_rate"]
)
def test_a_function_in_a_model_file_has_the_values_of_the_fitted_one(vent, name):
    function = vent[0].task.functions[name]
    coordinates = np.random.default_rng(0).normal(size=function.count)
    function = dataclasses.replace(function, coordinates=coordinates)
    low, high = function.centers.min(axis=0), function.centers.max(axis=0)
    values = np.random.default_rng(1).uniform(low, high, size=(31, len(low)))
    expected = function.gaussians(values) @ function.weights
    assert np.abs(expected).max() > 1e-4
    gaussians = gaussians_of([function.data])
    row = ROWS[function.effect.kind]
    rest = np.zeros(len(FLOW_VARIABLES))
    found = []
    for value in values:
        rest[function.columns] = value
        basis = [basis_function(rest, gaussians, m) for m in range(gaussians.num_flown)]
        found.append(gaussians.weights @ basis)
    found = np.array(found)
    np.testing.assert_allclose(found[:, row], expected, atol=1e-12)
    others = [k for k in range(len(ROWS)) if k != row]
    assert np.all(found[:, others] == 0.0)
