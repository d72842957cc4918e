"""The plant is the dynamics with ports, in every scalar type and way."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.symbolic import MakeVectorContinuousVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ZeroOrderHold

from glider.compiled.flight import fly_tapes
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.compose import compose
from glider.physics.effects import (
    COMMAND_DELAY,
    DYNAMIC_STALL,
    GROUND_EFFECT,
    LIBRARY,
    NO_GAUSSIANS,
    PITCH_OFFSET,
    PROFILE_DRAG,
    SERVO_LAG,
    WIND,
)
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters, Theta
from glider.physics.state import STATE_NAMES
from glider.systems.plant import GliderPlant
from tests.helpers.own_kinds import LEAK
from tests.helpers.physics import (
    FREE,
    PARAMETERS,
    at_work,
    nominal_derivatives,
    random_states,
)

ALL_AT_WORK = GliderModel(
    effects=tuple(at_work(k) for k in LIBRARY), free_functions=FREE
)
ALL_AT_WORK_STEADY = GliderModel(effects=tuple(at_work(k) for k in LIBRARY))
EACH = [GliderModel(), *(GliderModel(effects=(at_work(k),)) for k in LIBRARY)]
EACH_IDS = ["nominal", *(k.kind for k in LIBRARY)]


def set_up(plant, x, u, wind=None):
    """Returns a context at a state, with inputs fixed."""
    context = plant.CreateDefaultContext()
    context.SetContinuousState(x)
    plant.GetInputPort("elevator_rate").FixValue(context, u)
    if wind is not None:
        plant.GetInputPort("wind").FixValue(context, wind)
    return context


@pytest.mark.parametrize("kind", [str, Path])
def test_the_path_of_a_model_stands_for_it(tmp_path, kind):
    model, path = GliderModel(effects=(WIND(x=-0.5),)), tmp_path / "model.yaml"
    model.save(path)
    plant = GliderPlant(kind(path))
    assert plant.model == model
    assert plant.ToAutoDiffXd().model == model


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        ("absent.yaml", "absent.yaml: not a glider model: No such file"),
        (models_path("problems", "perching.yaml"), "unknown field 'launch'"),
        (models_path(), "not a glider model: Is a directory"),
        (0.08, "found float; expected a GliderModel or the path of its file"),
        (GliderParameters(), "found GliderParameters; expected a GliderModel"),
    ],
)
def test_what_is_no_model_is_refused_in_one_sentence(thing, words):
    with pytest.raises(InputError) as error:
        GliderPlant(thing)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def rates(plant, context):
    return plant.EvalTimeDerivatives(context).CopyToVector()


def output(plant, name, context):
    return plant.GetOutputPort(name).Eval(context)


# ----------------------------------------------------------------------- ports


def test_the_ports_have_names_and_sizes():
    plant = GliderPlant()
    assert plant.GetInputPort("elevator_rate").size() == 1
    assert plant.GetInputPort("wind").size() == 2
    assert plant.GetOutputPort("state").size() == 7
    assert plant.GetOutputPort("forces").size() == 5
    assert plant.GetOutputPort("pose").size() == 3
    assert plant.state_names == STATE_NAMES
    # The forces answer at once to both inputs, state and pose to none.
    assert plant.HasDirectFeedthrough(
        plant.GetInputPort("elevator_rate").get_index(),
        plant.GetOutputPort("forces").get_index(),
    )
    for name in ("state", "pose"):
        assert not plant.HasDirectFeedthrough(plant.GetOutputPort(name).get_index())


def test_the_dynamics_are_those_of_the_chain():
    plant = GliderPlant()
    for x in random_states(5):
        context = set_up(plant, x, [2.0])
        np.testing.assert_array_equal(
            rates(plant, context), nominal_derivatives(x, 2.0)
        )
        np.testing.assert_array_equal(output(plant, "state", context), x)


def test_an_open_wind_is_still_air():
    plant, x = GliderPlant(), random_states(1)[0]
    still = rates(plant, set_up(plant, x, [2.0], [0.0, 0.0]))
    np.testing.assert_array_equal(rates(plant, set_up(plant, x, [2.0])), still)
    windy = rates(plant, set_up(plant, x, [2.0], [0.5, -0.2]))
    np.testing.assert_array_equal(windy, nominal_derivatives(x, 2.0, wind=(0.5, -0.2)))
    # The input adds to the wind of the model.
    plant = GliderPlant(GliderModel(effects=(WIND(x=0.3, z=-0.2),)))
    both = rates(plant, set_up(plant, x, [2.0], [0.2, 0.0]))
    np.testing.assert_allclose(both, windy, rtol=1e-13)


def test_parameters_and_coefficients_in_the_context_act():
    plant = GliderPlant(GliderModel(effects=(PROFILE_DRAG(cd0=0.05), WIND(x=0.1))))
    x = random_states(1)[0]
    context = set_up(plant, x, [2.0])
    numbers = context.get_numeric_parameter(0).CopyToVector()
    np.testing.assert_array_equal(numbers, [*PARAMETERS, 0.05, 0.1, 0.0])
    assert plant.model.space.names[9:] == ("profile_drag.cd0", "wind.x", "wind.z")

    before = rates(plant, context)
    heavy = PARAMETERS._replace(mass=2 * PARAMETERS.mass)
    numbers[:9] = heavy
    context.get_mutable_numeric_parameter(0).SetFromVector(numbers)
    after = rates(plant, context)
    assert after[4] == pytest.approx(before[4] / 2)
    numbers[9:] = 0.0
    context.get_mutable_numeric_parameter(0).SetFromVector(numbers)
    np.testing.assert_allclose(
        rates(plant, context), nominal_derivatives(x, 2.0, heavy)
    )


@pytest.mark.parametrize(
    "effects", [(), (PROFILE_DRAG(cd0=0.1), GROUND_EFFECT(strength=0.3))]
)
def test_the_forces_make_the_accelerations(effects):
    plant = GliderPlant(GliderModel(effects=effects))
    for x in random_states(5):
        context = set_up(plant, x, [6.0], [0.3, 0.1])
        wing, elevator, force_x, force_z, moment = output(plant, "forces", context)
        acceleration = rates(plant, context)[4:7]
        m, inertia, *_, gravity = PARAMETERS
        np.testing.assert_allclose(
            [force_x / m, force_z / m - gravity, moment / inertia], acceleration
        )
        if not effects:
            e = x[2] + x[3]
            assert wing * np.sin(x[2]) + elevator * np.sin(e) == pytest.approx(force_x)
            assert wing * np.cos(x[2]) + elevator * np.cos(e) == pytest.approx(force_z)
    still = output(plant, "forces", set_up(plant, x, [0.0], [0.3, 0.1]))
    assert still[1] != pytest.approx(elevator, abs=1e-6)  # u moves the plate.


def test_the_pose_is_what_the_sensors_show():
    plant = GliderPlant(GliderModel(effects=(PITCH_OFFSET(angle=0.1),)))
    x = random_states(1)[0]
    context = set_up(plant, x, [2.0])
    np.testing.assert_allclose(
        output(plant, "pose", context), np.add(x[:3], [0, 0, 0.1])
    )
    np.testing.assert_array_equal(rates(plant, context), nominal_derivatives(x, 2.0))


# --------------------------------------------------------------- extra states


def test_effects_with_states_enlarge_the_state():
    effects = (
        DYNAMIC_STALL(strength=1.0),
        COMMAND_DELAY(delay=0.02),
        SERVO_LAG(time_constant=0.03),
    )
    plant = GliderPlant(GliderModel(effects=effects))
    assert plant.state_names == (
        *STATE_NAMES,
        "command_delay.delay_first",
        "command_delay.delay_second",
        "servo_lag.servo_rate",
        "dynamic_stall.lagged_sin_alpha",
    )
    assert plant.GetOutputPort("state").size() == 11
    x = plant.model.initial_state(random_states(1)[0])
    assert x.shape == (11,)
    np.testing.assert_array_equal(plant.model.initial_state(x), x)
    # At rest: with no command, no state of an effect moves.
    at_rest = rates(plant, set_up(plant, x, [0.0]))
    np.testing.assert_allclose(at_rest[7:], 0.0, atol=1e-12)
    np.testing.assert_allclose(at_rest[:7], nominal_derivatives(x[:7], 0.0), atol=1e-12)
    with pytest.raises(InputError, match="is 8; expected 7 or 11"):
        plant.model.initial_state(np.zeros(8))


def test_a_lag_of_no_duration_is_left_out():
    effects = (SERVO_LAG(), PROFILE_DRAG(), COMMAND_DELAY())
    plant = GliderPlant(GliderModel(effects=effects))
    assert [k.kind for k in plant.model.kinds] == ["profile_drag"]
    assert plant.num_continuous_states() == 7


def test_an_effect_given_twice_is_refused():
    with pytest.raises(InputError, match="'wind' is given twice"):
        GliderPlant(GliderModel(effects=(WIND(x=0.1), WIND(x=0.2))))


def test_a_formula_over_time_makes_it_time_varying():
    assert GliderModel(effects=(LEAK(rate=0.1),)).is_time_varying
    assert not ALL_AT_WORK_STEADY.is_time_varying


def test_only_a_field_over_time_makes_it_time_varying():
    assert not GliderModel().is_time_varying
    assert GliderModel(free_functions=FREE).is_time_varying
    plant = GliderPlant(GliderModel(free_functions=FREE))
    x = random_states(1)[0]
    context = set_up(plant, x, [2.0])
    now = rates(plant, context)
    context.SetTime(0.4)
    assert np.max(np.abs(rates(plant, context) - now)) > 1e-3
    steady = FreeFunction(
        variables=["alpha"], centers=[[0.3]], widths=[0.2], weights={"c_drag": [0.1]}
    )
    assert not GliderModel(free_functions=(steady,)).is_time_varying


# --------------------------------------------------------------------- scalars


def autodiff_rates(model, fast, seeds, with_theta, wind=True):
    """Returns value and gradient by state, inputs and perhaps all parameters."""
    plant = GliderPlant(model, fast=fast)
    x = plant.model.initial_state(random_states(1, seed=4)[0])
    parts = [x, [2.0]] + ([[0.3, -0.2]] if wind else [])
    context = plant.CreateDefaultContext()
    if with_theta:
        parts.append(context.get_numeric_parameter(0).CopyToVector())
    ad = InitializeAutoDiff(np.concatenate(parts)).ravel()
    if not seeds:
        ad = InitializeAutoDiff(ExtractValue(ad), np.zeros((len(ad), 0))).ravel()
    twin = plant.ToAutoDiffXd()
    n = len(x)
    context = set_up(twin, ad[:n], ad[n : n + 1], ad[n + 1 : n + 3] if wind else None)
    context.SetTime(0.3)
    if with_theta:
        numbers = ad[n + 1 + 2 * wind :]
        context.get_mutable_numeric_parameter(0).SetFromVector(numbers)
    result = rates(twin, context)
    assert twin.fast == fast  # It did compile.
    return ExtractValue(result).ravel(), ExtractGradient(result)


@pytest.mark.parametrize("wind", [True, False], ids=["wind", "still"])
@pytest.mark.parametrize("with_theta", [True, False], ids=["parameters", "state"])
@pytest.mark.parametrize(
    "model",
    [
        pytest.param(GliderModel(), id="nominal"),
        pytest.param(ALL_AT_WORK, id="all", marks=pytest.mark.nightly),
    ],
)
def test_the_fast_way_equals_the_plain_one(model, with_theta, wind):
    fast = autodiff_rates(model, True, True, with_theta, wind)
    plain = autodiff_rates(model, False, True, with_theta, wind)
    np.testing.assert_allclose(fast[0], plain[0], rtol=1e-11, atol=1e-11)
    size = 1.0 + np.abs(plain[1]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(fast[1] / size, plain[1] / size, atol=1e-12)


def test_numbers_without_derivatives_stay_so():
    fast = autodiff_rates(GliderModel(), True, False, False)
    plain = autodiff_rates(GliderModel(), False, False, False)
    np.testing.assert_allclose(fast[0], plain[0], rtol=1e-12)
    assert fast[1].shape == plain[1].shape == (7, 0)


def test_parameters_alone_may_carry_the_derivatives():
    plant = GliderPlant()
    x, gradients = random_states(1)[0], []
    for fast in (True, False):
        twin = GliderPlant(plant.model, fast=fast).ToAutoDiffXd()
        context = set_up(twin, InitializeAutoDiff(x, np.zeros((7, 0))), [2.0])
        p = InitializeAutoDiff(PARAMETERS)
        context.get_mutable_numeric_parameter(0).SetFromVector(p)
        first = ExtractGradient(rates(twin, context))
        # The cache of parameters must notice a change of them.
        p = InitializeAutoDiff(2.0 * np.array(PARAMETERS))
        context.get_mutable_numeric_parameter(0).SetFromVector(p)
        gradients.append([first, ExtractGradient(rates(twin, context))])
        assert np.max(np.abs(np.diff(gradients[-1], axis=0))) > 1e-3
    np.testing.assert_allclose(*gradients, rtol=1e-10, atol=1e-10)


def test_a_formula_that_does_not_compile_goes_the_plain_way():
    from tests.physics.test_effects import user_kind

    bag = {"calls": 0}

    def formula(flow, stiffness):
        bag["calls"] += 1  # Nothing that numba can compile.
        return -stiffness * flow.pitch

    effect = user_kind(formula)(stiffness=0.01)
    twin = GliderPlant(GliderModel(effects=(effect,))).ToAutoDiffXd()
    ad = InitializeAutoDiff(np.append(random_states(1)[0], 2.0)).ravel()
    gradient = ExtractGradient(rates(twin, set_up(twin, ad[:7], ad[7:])))
    assert not twin.fast
    nominal = ExtractGradient(nominal_derivatives(ad[:7], ad[7]))
    assert gradient[6, 2] - nominal[6, 2] == pytest.approx(
        -0.01 / PARAMETERS.pitch_inertia
    )


@pytest.mark.parametrize("model", EACH, ids=EACH_IDS)
def test_symbols_give_the_same_numbers(model):
    plant = GliderPlant(model)
    point = plant.model.initial_state(random_states(1, seed=2)[0])
    n = len(point)
    x = MakeVectorContinuousVariable(n, "x")
    u = MakeVectorContinuousVariable(1, "u")
    w = MakeVectorContinuousVariable(2, "w")
    twin = plant.ToSymbolic()
    formula = rates(twin, set_up(twin, x, u, w))
    values = [2.0, 0.3, -0.2]
    env = dict(zip([*x, *u, *w], [*point, *values], strict=True))
    expected = rates(plant, set_up(plant, point, values[:1], values[1:]))
    np.testing.assert_allclose(
        [e.Evaluate(env) for e in formula], expected, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("convert", ["ToAutoDiffXd", "ToSymbolic"])
def test_a_copy_keeps_model_and_way(convert):
    model = GliderModel(
        parameters=GliderParameters(mass=0.1), effects=(SERVO_LAG(time_constant=0.03),)
    )
    plant = GliderPlant(model, fast=False)
    copy = getattr(plant, convert)()
    assert copy.model == model
    assert copy.fast is False
    assert copy.state_names == plant.state_names


def test_a_clone_flies_the_same():
    """Drake wraps the clone of a Python system and renames its ports."""
    plant = GliderPlant(ALL_AT_WORK)
    clone, x = plant.Clone(), plant.model.initial_state(random_states(1)[0])
    context = clone.CreateDefaultContext()
    context.SetContinuousState(x)
    clone.GetInputPort("wrapped_elevator_rate").FixValue(context, [2.0])
    expected = rates(plant, set_up(plant, x, [2.0]))
    np.testing.assert_array_equal(rates(clone, context), expected)


# --------------------------------------------------------------------- flights


def test_a_simulator_flies_the_kernels_rollout():
    effects = (SERVO_LAG(time_constant=0.03), GROUND_EFFECT(strength=0.2))
    model = GliderModel(effects=effects)
    plant = GliderPlant(model)
    start = plant.model.initial_state(np.array([-3.5, 0.1, 0, 0, 7, 0, 0]))
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    context.SetContinuousState(start)
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    commands = np.array([5.0, -8.0, 3.0, 0.0, 6.0])
    for k, u in enumerate(commands):
        plant.GetInputPort("elevator_rate").FixValue(context, [u])
        simulator.AdvanceTo(0.1 * (k + 1))

    tape = np.repeat(commands, 100)[np.newaxis]
    states = fly_tapes(model, start[np.newaxis], tape, 0.001)
    end = context.get_continuous_state_vector().CopyToVector()
    np.testing.assert_allclose(states[0, -1], end, atol=1e-6)


def test_it_lives_in_a_diagram_of_any_scalar():
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("glider", GliderPlant(ALL_AT_WORK))
    hold = builder.AddSystem(ZeroOrderHold(0.02, 1))
    builder.Connect(hold.get_output_port(), plant.GetInputPort("elevator_rate"))
    builder.ExportInput(hold.get_input_port(), "command")
    diagram = builder.Build()
    twin = diagram.ToAutoDiffXd().GetSubsystemByName("glider")
    assert twin.model == plant.model
    assert twin.num_continuous_states() == plant.num_continuous_states()


def test_a_model_from_a_file_flies_the_same(tmp_path):
    path = tmp_path / "model.yaml"
    ALL_AT_WORK.save(path)
    again, plant = GliderPlant(GliderModel.load(path)), GliderPlant(ALL_AT_WORK)
    x = plant.model.initial_state(random_states(1)[0])
    np.testing.assert_array_equal(
        rates(again, set_up(again, x, [2.0])), rates(plant, set_up(plant, x, [2.0]))
    )


def test_the_reference_state_at_rest_uses_the_models_own_air():
    """Wind of the model counts: the lagged sine is that of the flow it meets."""
    effects = (WIND(x=-1.0, z=0.5), DYNAMIC_STALL(strength=1.0))
    plant = GliderPlant(GliderModel(effects=effects))
    x = plant.model.initial_state([0, 0, -0.2, 0, 6.0, 0, 0])
    chain = compose(plant.model.kinds)
    theta = Theta(PARAMETERS, np.array([-1.0, 0.5, 1.0, 0.08]), NO_GAUSSIANS)
    flow, _ = chain.meet_air(0.0, x, 0.0, 0.0, 0.0, theta)
    assert x[7] == flow.sin_alpha
    assert flow.air_x == 7.0
