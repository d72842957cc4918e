"""The dynamics obey mechanics, and are the same in each of their five uses."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.symbolic import MakeVectorContinuousVariable

from glider.compiled.flight import fly_tapes
from glider.compiled.jacobian import differentiate
from glider.physics import formulas
from glider.physics.model import GliderModel
from glider.physics.parameters import Parameters
from tests.helpers.physics import (
    PARAMETERS,
    GliderState,
    nominal_derivatives,
    nose_up_dynamics,
    random_states,
)

HEAVY_EKF = PARAMETERS._replace(mass=0.12, air_density=1.292, wing_offset=-0.03)


def numbers(low, high, count):
    bounds = [st.floats(a, b) for a, b in zip(low, high, strict=True)]
    return st.tuples(*bounds).map(np.array) if count else st.just(np.zeros(0))


states = numbers([-5, -2, -1.6, -0.45, -8, -8, -10], [5, 2, 1.6, 0.95, 10, 8, 10], 7)


# ---------------------------------------------------------------- known values


@pytest.mark.parametrize(
    ("state", "u", "expected"),
    [
        ([0, 0, -0.3, 0, 7, 0, 0], 5, [7, 0, 0, 5, -6.592, 11.50, 47.02]),
        ([0, 0, 0, -0.3, 7, 0, 0], 0, [7, 0, 0, 0, -0.947, -6.749, 47.83]),
        ([0, 0, 0, 0, 7, 0, 1], 0, [7, 0, 1, 0, 0, -10.263, -7.048]),
    ],
)
def test_check_values_of_the_reference(state, u, expected):
    actual = nominal_derivatives(np.array(state, dtype=float), u)
    np.testing.assert_allclose(actual[:5], expected[:5], atol=6e-4)
    np.testing.assert_allclose(actual[5:], expected[5:], atol=6e-3)


@pytest.mark.parametrize("p", [PARAMETERS, HEAVY_EKF], ids=["perching", "heavy_ekf"])
def test_an_independent_glider_in_the_other_signs_agrees(p):
    for x in random_states(100, seed=1):
        # The plates' speeds carry a smoothing of 1e-8 m²/s².
        np.testing.assert_allclose(
            nominal_derivatives(x, 3.0, p),
            nose_up_dynamics(x, 3.0, p),
            rtol=1e-9,
            atol=1e-8,
        )


def aliased_dynamics(x, u):
    """The published notebook's plant, whose derivative is a view of its state."""
    p, s = Parameters(*PARAMETERS), GliderState(x)
    along, across = np.sin(s.pitch), np.cos(s.pitch)
    e, edot = s.pitch + s.elevator, s.pitchdot + u
    tail_x = s.xdot + p.hinge_offset * s.pitchdot * along
    tail_z = s.zdot + p.hinge_offset * s.pitchdot * across
    tail_x = tail_x + p.elevator_offset * edot * np.sin(e)
    tail_z = tail_z + p.elevator_offset * edot * np.cos(e)
    tail = -p.air_density * p.elevator_area * np.hypot(tail_x, tail_z)
    tail *= tail_x * np.sin(e) + tail_z * np.cos(e)

    sdot = GliderState(s[:])  # An alias, not a copy ...
    sdot[0:3] = s[4:7]
    sdot.elevator = u  # ... so s.elevator is now the rate.
    arm = p.hinge_offset * np.cos(s.elevator) + p.elevator_offset
    sdot.pitchdot = arm * tail / p.pitch_inertia
    return sdot[:]


def test_fault_1_writing_through_a_view_of_the_state():
    """Reference-facts: 15.9 rad/s² of pitch where 47.0 is right."""
    x = np.array([0, 0, -0.3, 0, 7, 0, 0], dtype=float)
    kept = x.copy()
    assert nominal_derivatives(x, 5.0)[6] == pytest.approx(47.02, abs=0.01)
    np.testing.assert_array_equal(x, kept)
    assert aliased_dynamics(x, 5.0)[6] == pytest.approx(15.9, abs=0.05)
    assert not np.array_equal(x, kept)  # The fault: the caller's state is gone.


# ------------------------------------------------------------------ five uses


def test_floats_autodiff_symbols_complex_and_compiled_agree():
    points, rates = random_states(20), np.linspace(-10, 10, 20)
    u = MakeVectorContinuousVariable(1, "u")
    x = MakeVectorContinuousVariable(7, "x")
    formula = nominal_derivatives(x, u[0])
    for point, rate in zip(points, rates, strict=True):
        expected = nominal_derivatives(point, rate)
        ad = InitializeAutoDiff(np.append(point, rate)).ravel()
        with_gradient = nominal_derivatives(ad[:7], ad[7])
        np.testing.assert_allclose(
            ExtractValue(with_gradient).ravel(), expected, rtol=1e-12, atol=1e-12
        )
        gradient = ExtractGradient(with_gradient)

        env = dict(zip([*x, *u], [*point, rate], strict=True))
        symbolic = [(0.0 + e).Evaluate(env) for e in formula]
        np.testing.assert_allclose(symbolic, expected, rtol=1e-12, atol=1e-12)

        for j in range(8):
            step = np.append(point, rate) + 1e-30j * np.eye(8)[j]
            slope = nominal_derivatives(step[:7], step[7]).imag / 1e-30
            np.testing.assert_allclose(slope, gradient[:, j], rtol=1e-11, atol=1e-11)

        z = np.concatenate([point, [rate, 0, 0], PARAMETERS])
        unit = np.asfortranarray(np.eye(8))
        value, slopes = differentiate(GliderModel(), 0.0, z, unit)
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(slopes, gradient, rtol=1e-10, atol=1e-10)

    out = fly_tapes(GliderModel(), points, rates[:, None], 0.01, order=1)
    batch = [
        x + 0.01 * nominal_derivatives(x, r) for x, r in zip(points, rates, strict=True)
    ]
    np.testing.assert_allclose(out[:, 1], batch, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_the_compiled_sine_is_numpys(name):
    ours = getattr(formulas, name)

    @numba.njit
    def over(values, out):
        for i in range(len(values)):
            out[i] = ours(values[i])

    angles = np.concatenate(
        [
            np.linspace(-20, 20, 40001),
            np.linspace(-1e6, 1e6, 1001),
            np.arange(-8, 9) * np.pi / 4,
        ]
    )
    out = np.empty_like(angles)
    over(angles, out)
    np.testing.assert_allclose(out, getattr(np, name)(angles), rtol=0, atol=4e-16)
    over(np.array([np.nan, np.inf]), out)
    assert np.isnan(out[:2]).all()

    complex_angles = angles[:40001:100] + 0.3j
    complex_out = np.empty_like(complex_angles)
    over(complex_angles, complex_out)
    np.testing.assert_allclose(
        complex_out, getattr(np, name)(complex_angles), rtol=1e-14, atol=1e-15
    )


def test_the_compiled_root_is_numpys():
    @numba.njit
    def over(values, out):
        for i in range(len(values)):
            out[i] = formulas.sqrt(values[i])

    real = np.array([1e-8, 0.5, 49.0, 1e6])
    out = np.empty_like(real)
    over(real, out)
    np.testing.assert_array_equal(out, np.sqrt(real))
    # As of a complex step, not quite so small, large, and beside the cut.
    many = np.concatenate([real + 1e-30j, real * (1 + 1e-9j), real + 0.3j, -real + 1j])
    complex_out = np.empty_like(many)
    over(many, complex_out)
    for part in (np.real, np.imag):
        expected = part(np.sqrt(many))
        np.testing.assert_allclose(part(complex_out), expected, rtol=1e-14)


def test_the_compiled_exponential_is_numpys():
    @numba.njit
    def over(values, out):
        for i in range(len(values)):
            out[i] = formulas.exp(values[i])

    powers = np.concatenate([np.linspace(-700, 700, 40001), [0.0, -1e-300, 1e-9]])
    out = np.empty_like(powers)
    over(powers, out)
    np.testing.assert_allclose(out, np.exp(powers), rtol=5e-16)
    over(np.array([np.nan, -np.inf, -1e9, np.inf]), out)
    assert np.isnan(out[0])
    assert np.all(out[1:3] < 1e-300)
    assert out[3] > 1e300

    many = np.linspace(-3, 3, 61) + 0.3j
    complex_out = np.empty_like(many)
    over(many, complex_out)
    np.testing.assert_allclose(complex_out, np.exp(many), rtol=1e-14)


# ------------------------------------------------------------------- mechanics


@given(states)
def test_still_air_only_takes_energy_while_the_elevator_is_locked(x):
    s, rate = GliderState(x), GliderState(nominal_derivatives(x, 0.0, HEAVY_EKF))
    p = Parameters(*HEAVY_EKF)
    power = p.mass * (s.xdot * rate.xdot + s.zdot * (rate.zdot + p.gravity))
    power += p.pitch_inertia * s.pitchdot * rate.pitchdot
    assert power <= 1e-9


@given(states, st.floats(-13, 13))
def test_a_vacuum_is_free_fall(x, u):
    p = PARAMETERS._replace(air_density=0.0)
    expected = [x[4], x[5], x[6], u, 0, -9.81, 0]
    np.testing.assert_allclose(nominal_derivatives(x, u, p), expected, atol=1e-12)


@given(states, st.floats(-13, 13))
def test_a_glider_upside_down_flies_the_mirrored_path(x, u):
    """A flat plate has no top: mirror z, turn gravity round, nothing else changes."""
    mirror = np.array([1, -1, -1, -1, 1, -1, -1])
    p = HEAVY_EKF._replace(gravity=-HEAVY_EKF.gravity)
    np.testing.assert_allclose(
        nominal_derivatives(mirror * x, -u, p),
        mirror * nominal_derivatives(x, u, HEAVY_EKF),
        atol=1e-9,
    )


@given(states, st.floats(-5, 5), st.floats(-5, 5))
def test_uniform_wind_is_a_moving_frame(x, wind_x, wind_z):
    moving = x.copy()
    moving[4:6] -= [wind_x, wind_z]
    actual = nominal_derivatives(x, 3.0, wind=(wind_x, wind_z))
    expected = nominal_derivatives(moving, 3.0)
    np.testing.assert_allclose(actual[2:], expected[2:], atol=1e-10)
    np.testing.assert_allclose(
        actual[:2], expected[:2] + np.array([wind_x, wind_z]), atol=1e-12
    )


@given(states, st.floats(-5, 5), st.floats(-5, 5))
def test_it_flies_the_same_everywhere(x, dx, dz):
    moved = x + np.array([dx, dz, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(
        nominal_derivatives(x, 2.0), nominal_derivatives(moved, 2.0)
    )


def test_a_plate_across_the_stream_has_a_drag_coefficient_of_two():
    p = PARAMETERS._replace(elevator_area=1e-12, gravity=0.0)
    x = np.array([0, 0, 0, 0, 0, -3.0, 0])  # Falls flat.
    drag = nominal_derivatives(x, 0.0, p)[5] * p.mass
    assert drag / (0.5 * p.air_density * p.wing_area * 3.0**2) == pytest.approx(
        2.0, rel=1e-8
    )


@pytest.mark.parametrize(("order", "slope"), [(1, 1.0), (4, 4.0)])
def test_the_error_of_a_rollout_falls_with_its_order(order, slope):
    def end(steps, order):
        start = np.array([[-3.5, 0.1, 0, 0, 7, 0, 0]])
        command, step = np.full((1, steps), 3.0), 0.4 / steps
        return fly_tapes(GliderModel(), start, command, step, order=order)[0, -1]

    counts = {1: [200, 400, 800], 4: [40, 80, 160]}[order]
    errors = [np.linalg.norm(end(n, order) - end(4000, 4)) for n in counts]
    fitted = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert fitted == pytest.approx(slope, abs=0.15)
