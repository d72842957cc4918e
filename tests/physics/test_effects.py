"""Every effect of the library does nothing at zero, and all uses of it agree."""

import math

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.compiled.actuators import elevator_path
from glider.compiled.jacobian import differentiate
from glider.compiled.replay import flow_at
from glider.errors import InputError
from glider.physics.compose import compose
from glider.physics.effects import (
    COMMAND_DELAY,
    KINDS,
    LIBRARY,
    NO_GAUSSIANS,
    SERVO_LAG,
    STAGES,
    Coefficient,
    EffectKind,
)
from glider.physics.effects.free_functions import FREE_FUNCTIONS, gaussians_of
from glider.physics.formulas import scalar
from glider.physics.model import GliderModel
from glider.physics.parameters import Parameters, Theta
from glider.systems.plant import GliderPlant
from tests.helpers.physics import (
    FREE,
    PARAMETERS,
    at_work,
    full_state,
    nominal_derivatives,
    random_states,
)

ALL = pytest.mark.parametrize("kind", LIBRARY, ids=lambda kind: kind.kind)

# design.md, 'Effects'; rbf_residual is a free function.
REQUIRED = [
    "servo_lag",
    "command_delay",
    "wind",
    "wind_shear",
    "attached_lift",
    "camber",
    "pitch_rate_lift",
    "dynamic_stall",
    "lagged_separation",
    "wing_incidence",
    "airspeed_dependence",
    "ground_effect",
    "downwash",
    "stalled_downwash",
    "lagged_downwash",
    "tail_wake",
    "elevator_trim",
    "elevator_scale",
    "elevator_blowback",
    "elevator_area",
    "center_of_pressure",
    "profile_drag",
    "induced_drag",
    "axial_drag",
    "pitch_damping",
    "pitch_moment",
    "thrust",
    "mass",
    "inertia",
    "added_mass",
    "marker_offset",
    "pose_latency",
    "frame_tilt",
    "position_scale",
    "pitch_offset",
    "angle_sign",
]


def evaluate(effects, x, u, wind, p, c, gaussians=NO_GAUSSIANS):
    """Returns derivatives and pose, one after the other."""
    chain = compose((*(e.kind for e in effects), *FREE_FUNCTIONS.values()))
    theta = Theta(Parameters(*p), c, gaussians)
    rates = chain.derivatives(0.3, x, u, *wind, theta)
    return np.array([*rates, *chain.measure(x, theta)])


def test_the_library_is_complete():
    assert sorted(KINDS) == sorted(REQUIRED)
    assert len(KINDS) == len(LIBRARY)


@ALL
def test_it_is_documented(kind):
    assert kind.stage in STAGES
    assert set(kind.adds_to) <= set(STAGES[kind.stage])
    assert bool(kind.adds_to) == (kind.stage != "actuator")
    assert kind.words
    assert kind.depends_on
    assert kind.coefficients
    for c in kind.coefficients:
        assert c.unit
        assert c.scale > 0
        assert math.isfinite(c.lower)
        assert math.isfinite(c.upper)
        assert c.lower <= c.default <= c.upper
        assert all(c.lower <= g <= c.upper for g in c.grid)
    assert bool(kind.states) == (kind.state_rate is not None)
    assert bool(kind.states) == (kind.steady_state is not None)


@ALL
def test_defaults_do_nothing(kind):
    effect = kind()
    if kind.stage == "actuator":  # No duration: singular, and the plant drops it.
        plant = GliderPlant(GliderModel(effects=(effect,)))
        assert plant.model.kinds == ()
        assert plant.num_continuous_states() == 7
        return
    for point in random_states(20):
        x, c = full_state([effect], point)
        actual = evaluate([effect], x, 2.0, (0.5, -0.2), PARAMETERS, c)
        expected = nominal_derivatives(point, 2.0, wind=(0.5, -0.2))
        np.testing.assert_allclose(actual[:7], expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(actual[-3:], point[:3], rtol=1e-15, atol=1e-15)


@ALL
def test_its_coefficients_change_what_they_should(kind):
    """Sensors change the pose and not the flight; all others the reverse."""
    point = random_states(1, seed=4)[0]
    effect = at_work(kind)
    x, c = full_state([effect], point)
    base = evaluate([effect], x, 2.0, (0, 0), PARAMETERS, c)
    n = len(x)
    flight = np.max(np.abs(base[:7] - nominal_derivatives(point, 2.0)))
    pose = np.max(np.abs(base[n:] - point[:3]))
    assert (flight > 1e-4) == (kind.stage not in ("sensor", "log"))
    assert (pose > 1e-4) == (kind.stage in ("sensor", "log"))
    for i, coefficient in enumerate(kind.coefficients):
        if (kind.kind, coefficient.name) in (
            ("angle_sign", "elevator"),  # These act on the log's other columns.
            ("angle_sign", "command"),
        ):
            continue
        moved = c.copy()
        moved[i] += 0.1 * coefficient.scale
        change = evaluate([effect], x, 2.0, (0, 0), PARAMETERS, moved) - base
        assert np.max(np.abs(change)) > 1e-6, coefficient.name


def check_gradients(effects, functions=()):
    """AutoDiff = complex step = central differences (= compiled), by everything."""
    arrays = gaussians_of(functions)
    for point in random_states(3, seed=5):
        x, c = full_state(effects, point)
        n = len(x)
        z = np.concatenate([x, [2.0, 0.4, -0.3], PARAMETERS, c])

        def f(z, n=n):
            wind = (z[n + 1], z[n + 2])
            return evaluate(
                effects, z[:n], z[n], wind, z[n + 3 : n + 12], z[n + 12 :], arrays
            )

        result = f(InitializeAutoDiff(z).ravel())
        gradient = ExtractGradient(result)
        np.testing.assert_allclose(ExtractValue(result).ravel(), f(z), rtol=1e-13)
        size = np.abs(gradient).max(axis=1, keepdims=True) + 1.0

        steps = np.eye(len(z))
        exact = np.array([f(z + 1e-30j * e).imag / 1e-30 for e in steps]).T
        np.testing.assert_allclose(exact / size, gradient / size, atol=1e-12)

        h = 1e-6 * np.maximum(np.abs(z), 1e-2)
        difference = [(f(z + e) - f(z - e)) / (2 * e.sum()) for e in np.diag(h)]
        np.testing.assert_allclose(
            np.transpose(difference) / size, gradient / size, atol=3e-6
        )

        if not functions:
            continue
        model = GliderModel(effects=tuple(effects), free_functions=functions)
        value, slopes = differentiate(model, 0.3, z, np.asfortranarray(steps))
        np.testing.assert_allclose(value, f(z)[:n], rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(
            slopes / size[:n], gradient[:n] / size[:n], atol=1e-10
        )


@ALL
def test_autodiff_complex_step_and_differences_agree(kind):
    check_gradients([at_work(kind)])


@pytest.mark.nightly
def test_the_compiled_chain_agrees_with_all_effects_and_free_functions():
    """One kernel for the whole library: compiling one each would take minutes."""
    check_gradients([at_work(kind) for kind in LIBRARY], FREE)


@ALL
def test_numbers_that_cannot_be_are_refused(kind):
    name = kind.coefficients[0].name
    with pytest.raises(InputError, match=f"'{kind.kind}'.*'{name}'.*a value in"):
        kind(**{name: kind.coefficients[0].upper + 1.0})
    with pytest.raises(InputError, match=f"'{kind.kind}'.*finite number"):
        kind(**{name: math.nan})
    with pytest.raises(InputError, match=f"'{kind.kind}': a coefficient is 'nmae'"):
        kind(nmae=0.0)


@pytest.mark.parametrize(
    "kind, value, moment",
    [
        ("pitch_moment", 0.002, lambda speed, rate: 0.002 * speed**2),
        ("pitch_damping", 0.004, lambda speed, rate: -0.004 * speed * rate),
    ],
)
def test_moments_have_their_signs(kind, value, moment):
    """Positive turns the nose down; damping slows a rate."""
    plain = GliderModel()
    model = GliderModel(effects=(KINDS[kind](coefficient=value),))
    own = plain.parameters
    x = np.array([0.0, 0.0, -0.1, 0.0, 6.0, -0.5, 0.8])
    speed = math.hypot(6.0, 0.5)
    rates = [
        m.chain.derivatives(0.0, x, 0.0, 0.0, 0.0, m.numbers) for m in (plain, model)
    ]
    pressure = 0.5 * own.air_density * own.wing_area / own.pitch_inertia
    added = rates[1][6] - rates[0][6]
    assert added == pytest.approx(pressure * moment(speed, 0.8), rel=1e-9)


def test_effects_add_in_any_order():
    effects = [at_work(kind) for kind in LIBRARY if kind.stage != "actuator"]
    point = random_states(1)[0]
    forward = evaluate(effects, *packed(effects, point))
    backward = evaluate(effects[::-1], *packed(effects[::-1], point))
    np.testing.assert_allclose(backward[:7], forward[:7], rtol=1e-12)
    np.testing.assert_allclose(backward[-3:], forward[-3:], rtol=1e-12)


def packed(effects, point):
    x, c = full_state(effects, point)
    return x, 2.0, (0.0, 0.0), PARAMETERS, c


# ---------------------------------------------------------------- a user's own


def user_kind(formula):
    return EffectKind(
        kind="pitch_spring",
        stage="wrench",
        adds_to=("moment",),
        coefficients=(
            Coefficient(name="stiffness", unit="N m/rad", lower=-1.0, upper=1.0),
        ),
        formula=formula,
        words="a spring between the pitch and the horizon",
        depends_on=("pitch",),
    )


def plain_spring(flow, stiffness):
    return -stiffness * flow.pitch


@pytest.mark.parametrize(
    "formula",
    [plain_spring, lambda flow, stiffness: -stiffness * flow.pitch],
    ids=["plain", "lambda"],
)
def test_a_users_own_effect_goes_everywhere(formula):
    effect = user_kind(formula)(stiffness=0.01)
    x = random_states(1)[0]
    expected = nominal_derivatives(x, 2.0)
    expected[6] += -0.01 * x[2] / PARAMETERS[1]

    actual = evaluate([effect], x, 2.0, (0, 0), PARAMETERS, np.array([0.01]))[:7]
    np.testing.assert_allclose(actual, expected, rtol=1e-13)

    plant = GliderPlant(GliderModel(effects=(effect,)))
    context = plant.CreateDefaultContext()
    context.SetContinuousState(x)
    plant.GetInputPort("elevator_rate").FixValue(context, [2.0])
    rates = plant.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(rates, expected, rtol=1e-13)

    values = flow_at(
        (effect.kind,),
        np.zeros(1),
        x[np.newaxis],
        np.zeros(1),
        np.array([2.0]),
        np.append(PARAMETERS, 0.01),
        NO_GAUSSIANS,
    )
    np.testing.assert_allclose(values[0, :3], expected[4:], rtol=1e-12)


def own_force(size=0.0, shape=0.3, **changes):
    """A kind with a size and a shape; by default a valid one."""
    given = {
        "kind": "own_force",
        "stage": "wrench",
        "adds_to": ("force_x", "force_z"),
        "coefficients": (
            Coefficient("size", "N", size, lower=-2.0, upper=2.0),
            Coefficient("shape", "-", shape, lower=0.1, upper=1.0, grid=(0.3,)),
        ),
        "formula": lambda flow, size, shape: (size * shape, 0.0 * flow.x),
        "words": "a force",
    }
    return EffectKind(**(given | changes))


def only(**bounds):
    return {"coefficients": (Coefficient("size", "N", **bounds),)}


SHAPE = Coefficient("shape", "-", 0.3, lower=0.1, upper=1.0, grid=(0.3,))
LAGS = {
    "stage": "actuator",
    "adds_to": (),
    "states": ("lagged",),
    "steady_state": lambda rate, size, shape: rate,
    "state_rate": lambda rate, lagged, size, shape: (rate - lagged) / shape,
}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stage": "wing"}, "stage is 'wing'; expected one of actuator, air"),
        ({"stage": "actuator"}, r"adds_to is .* expected a choice of \(\)"),
        ({"adds_to": ("wing_normal",)}, "adds_to"),
        ({"adds_to": ()}, "adds_to"),
        ({"coefficients": ()}, r"coefficients is \[\]"),
        ({"coefficients": (SHAPE,)}, "one without a grid, which is the effect's size"),
        ({"coefficients": (SHAPE, SHAPE)}, "expected different names"),
        (only(), r"lower and upper is \[-inf, inf\]; expected finite"),
        (only(lower=1.0, upper=-1.0), "lower and upper"),
        (only(default=3.0, lower=-1.0, upper=1.0), "default and grid is"),
        (only(scale=0.0, lower=-1.0, upper=1.0), "scale is 0"),
        ({"states": ("lag",)}, "expected all or none"),
        ({"formula": lambda flow, size, shape: (1.0, 0.0)}, "returns 1, 0; expected 0"),
        ({"size": 1.0}, "returns 0.3, .*; expected 0"),
        (
            {"formula": lambda flow, size, shape: (size + shape - 0.3, 0.0)},
            "does nothing where its sizes are at their defaults",
        ),
        ({"formula": lambda flow, size, shape: size}, "2 finite numbers"),
        ({"formula": lambda flow, size: (size, 0.0)}, "does not take 3 arguments"),
        ({"formula": lambda flow, size, shape: None}, "its formula fails"),
        ({"formula": lambda flow, size, shape: (size / 0.0, 0.0)}, "division by zero"),
        (LAGS | {"formula": lambda r, lagged, size, shape: r + 1.0}, "expected 1"),
        (LAGS | {"formula": lambda r, lagged, size, shape: lagged}, "expected 1"),
    ],
)
def test_a_kind_that_could_not_fly_is_refused_where_it_is_made(changes, words):
    """The library's, a model's and a user's own alike."""
    assert own_force().defaults == (0.0, 0.3)
    with pytest.raises(InputError, match=words) as error:
        own_force(**changes)
    assert str(error.value).startswith("effect 'own_force'")
    assert "\n" not in str(error.value)


@scalar
def _weaker_tail(flow, gain, share):
    return (gain - 1.0) * share


@scalar
def _late_rate(rate, lagged, gain):
    return gain * rate + (1.0 - gain) * lagged


@scalar
def _late_state_rate(rate, lagged, gain):
    return (rate - lagged) / 0.05


@scalar
def _late_rest(rate, gain):
    return rate


GAIN = Coefficient("gain", "-", 1.0, scale=0.2, lower=0.0, upper=2.0)
WEAKER_TAIL = EffectKind(
    kind="weaker_tail",
    stage="surface",
    adds_to=("elevator_factor",),
    coefficients=(
        GAIN,
        Coefficient("share", "-", 0.5, lower=0.0, upper=1.0, grid=(0.5, 0.9)),
    ),
    formula=_weaker_tail,
    words="a tail of another force, as a factor",
)
LATE = EffectKind(
    kind="late",
    stage="actuator",
    adds_to=(),
    coefficients=(GAIN,),
    formula=_late_rate,
    states=("lagged",),
    state_rate=_late_state_rate,
    steady_state=_late_rest,
    words="a servo of which a share comes late",
)


@pytest.mark.parametrize("gain", [0.0, 1e-9, 0.7, 1.0])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_what_does_nothing_at_one_flies_compiled_as_in_python(gain, share):
    """Compiled code skips an effect at its defaults, not where it is zero."""
    effects = (WEAKER_TAIL(gain=gain, share=share), LATE(gain=gain))
    model = GliderModel(effects=effects)
    assert (LATE in model.kinds) == (gain != 1.0)
    x = model.initial_state(random_states(1)[0]) + 0.01
    theta = model.numbers
    expected = model.chain.derivatives(0.3, x, 2.0, 0.4, -0.3, theta)
    nominal = GliderModel().chain.derivatives(
        0.3, x[:7], 2.0, 0.4, -0.3, GliderModel().numbers
    )
    assert np.array_equal(expected[:7], nominal) == (gain == 1.0)
    z = np.concatenate([x, [2.0, 0.4, -0.3], *theta[:2]])
    found, _ = differentiate(model, 0.3, z, np.zeros((len(z), 0), order="F"))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


# ------------------------------------------------------------- exact actuators


def fly_elevator(effect, period=0.05, step=1e-3):
    """Flies a tape through the plant's actuator; returns times, angles, exact."""
    commands = np.array([4.0, -6.0, 2.0, 0.0, 5.0, 0.0])
    x, c = full_state([effect], random_states(1)[0])
    x[3], x[7:] = 0.0, 0.0
    chain = compose((effect.kind,))
    per = round(period / step)
    angles = [x[3]]
    for k in range(per * len(commands)):
        u = commands[k // per]

        def rate(y, u=u):
            theta = Theta(PARAMETERS, c, NO_GAUSSIANS)
            return np.array(chain.derivatives(0.0, y, u, 0.0, 0.0, theta))

        k1 = rate(x)
        k2 = rate(x + 0.5 * step * k1)
        k3 = rate(x + 0.5 * step * k2)
        k4 = rate(x + step * k3)
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        angles.append(x[3])
    times = step * np.arange(len(angles))
    return times, np.array(angles), period * np.arange(len(commands)), commands


def test_a_servo_lag_in_the_plant_is_the_exact_one():
    times, angles, switches, commands = fly_elevator(SERVO_LAG(time_constant=0.03))
    exact = elevator_path(switches, commands, times, time_constant=0.03)
    np.testing.assert_allclose(angles, exact, atol=1e-7)


def test_a_command_delay_in_the_plant_is_nearly_the_exact_one():
    """The Padé approximant stays within an eighth of rate times delay."""
    times, angles, switches, commands = fly_elevator(COMMAND_DELAY(delay=0.025))
    exact = elevator_path(switches, commands, times, delay=0.025)
    undelayed = elevator_path(switches, commands, times)
    largest_jump = 10.0 * 0.025
    assert np.max(np.abs(angles - exact)) < 0.125 * largest_jump
    assert np.max(np.abs(undelayed - exact)) > 0.9 * largest_jump * 0.6
    # At rest again, nothing is left of the difference.
    assert angles[-1] == pytest.approx(exact[-1], abs=2e-3)
