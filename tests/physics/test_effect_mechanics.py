"""Effects against the same mechanics written down another way."""

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.physics.compose import compose
from glider.physics.effects import (
    ADDED_MASS,
    AXIAL_DRAG,
    CAMBER,
    DOWNWASH,
    ELEVATOR_BLOWBACK,
    ELEVATOR_SCALE,
    GROUND_EFFECT,
    INDUCED_DRAG,
    LAGGED_DOWNWASH,
    LAGGED_SEPARATION,
    LIBRARY,
    NO_GAUSSIANS,
    PITCH_RATE_LIFT,
    STALLED_DOWNWASH,
    WIND_SHEAR,
)
from glider.physics.effects.free_functions import (
    FREE_FUNCTIONS,
    FreeFunction,
    gaussians_of,
)
from glider.physics.model import GliderModel
from glider.physics.parameters import Theta
from tests.helpers.physics import (
    PARAMETERS,
    GliderState,
    at_work,
    full_state,
    nominal_derivatives,
    nose_up_dynamics,
    random_states,
)

WING_ALONE = PARAMETERS._replace(elevator_area=1e-12)
TAIL_ALONE = PARAMETERS._replace(wing_area=1e-12)


def flown(effect, x, u=0.0, p=PARAMETERS, wind=(0.0, 0.0)):
    """Returns the derivatives (7,) with one effect that has no state."""
    theta = Theta(p, np.array(effect.values), NO_GAUSSIANS)
    rates = compose((effect.kind,)).derivatives(0.0, x, u, *wind, theta)
    return np.array(rates)


def force_of(rates, p):
    """Returns the force without weight that accelerates so, (x, z) [N]."""
    return p.mass * (rates[4:6] + np.array([0.0, p.gravity]))


def normal_of(angle):
    return np.array([np.sin(angle), np.cos(angle)])


def axis_of(angle):
    return np.array([np.cos(angle), -np.sin(angle)])


def pressure_area(x, p):
    return 0.5 * p.air_density * p.wing_area * (x[4] ** 2 + x[5] ** 2)


def flying_at(alpha, speed=6.0, pitch=-0.2, pitchdot=0.0, elevator=0.0):
    """Returns a state in still air at an angle of attack."""
    path = -(pitch + alpha)  # Above the horizon.
    velocity = speed * np.cos(path), speed * np.sin(path)
    return np.array([0.0, 0.3, pitch, elevator, *velocity, pitchdot])


@pytest.mark.parametrize("alpha", [-0.4, 0.0, 0.2, 0.9, 2.0])
@pytest.mark.parametrize("angle", [-0.12, 0.05])
def test_a_cambered_wing_has_the_plates_force_of_another_angle(alpha, angle):
    x, other = flying_at(alpha), flying_at(alpha - angle)
    force = force_of(flown(CAMBER(zero_lift_angle=angle), x, p=WING_ALONE), WING_ALONE)
    plate = force_of(nominal_derivatives(other, p=WING_ALONE), WING_ALONE)
    np.testing.assert_allclose(force, plate, rtol=1e-7, atol=1e-7)


def test_a_wing_bent_upwards_lifts_at_no_angle_of_attack():
    x = flying_at(0.0)
    rates = flown(CAMBER(zero_lift_angle=-0.03), x, p=WING_ALONE)
    size = np.dot(force_of(rates, WING_ALONE), normal_of(x[2]))
    assert size / pressure_area(x, WING_ALONE) == pytest.approx(2 * np.sin(0.03))


def test_pitch_rate_lift_is_that_of_a_plate_half_an_arm_behind():
    """To first order at no angle of attack; it has no moment of its own."""
    arm = 0.1
    behind = WING_ALONE._replace(wing_offset=-0.5 * arm)
    effect = PITCH_RATE_LIFT(arm=arm)
    rates = {}
    for rate in (-1e-3, 1e-3):
        x = flying_at(0.0, pitchdot=rate)
        rates[rate] = flown(effect, x, p=WING_ALONE), nominal_derivatives(x, p=behind)
    ours, plate = (
        (force_of(a, WING_ALONE) - force_of(b, WING_ALONE)) / 2e-3
        for a, b in zip(rates[1e-3], rates[-1e-3], strict=True)
    )
    np.testing.assert_allclose(ours, plate, rtol=1e-6, atol=1e-9)
    by_rate = -np.dot(ours, normal_of(-0.2))  # Nose up.
    assert by_rate == pytest.approx(arm * pressure_area(x, PARAMETERS) / 6.0)
    for x in random_states(10):
        turn = flown(effect, x)[6] - nominal_derivatives(x)[6]
        assert turn == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("wind", [(0.0, 0.0), (-1.0, 0.4)])
def test_induced_drag_is_against_the_stream_by_the_square_of_lift(wind):
    p, k = WING_ALONE, 0.06
    for x in random_states(20):
        x[6] = 0.0  # Or the wing's center would see another stream.
        plain = nominal_derivatives(x, p=p, wind=wind)
        added = p.mass * (flown(INDUCED_DRAG(k=k), x, p=p, wind=wind) - plain)[4:6]
        through = x[4:6] - wind
        speed = np.linalg.norm(through)
        up = np.array([-through[1], through[0]]) / speed
        size = 0.5 * p.air_density * p.wing_area * speed**2
        lift = np.dot(force_of(plain, p), up) / size
        expected = -size * k * lift**2 * through / speed
        np.testing.assert_allclose(added, expected, rtol=1e-6, atol=1e-9)


def axial_coefficient(effect, alpha, never_drives=True):
    """Returns what an effect adds along the body axis, and asserts that it is all."""
    x = flying_at(alpha)
    added = PARAMETERS.mass * (flown(effect, x) - nominal_derivatives(x))[4:6]
    assert np.dot(added, normal_of(x[2])) == pytest.approx(0.0, abs=1e-12)
    assert not never_drives or np.dot(added, x[4:6]) <= 0.0
    return np.dot(added, -axis_of(x[2]) / pressure_area(x, PARAMETERS))


def test_axial_drag_is_alike_up_to_45_degrees_and_turns_with_the_motion():
    def axial(alpha):
        return axial_coefficient(AXIAL_DRAG(ca0=0.05), alpha)

    assert axial(0.0) == pytest.approx(0.05)
    for alpha in np.linspace(-np.pi / 4, np.pi / 4, 9):
        assert axial(alpha) == pytest.approx(0.05, rel=6e-3)
        assert axial(np.pi - alpha) == pytest.approx(-axial(alpha))
    assert axial(np.deg2rad(76)) == pytest.approx(0.05, rel=0.1)
    assert axial(np.pi / 2) == pytest.approx(0.0, abs=1e-8)


def test_an_axial_force_may_be_alike_in_backward_flight_too():
    constant = AXIAL_DRAG(ca0=0.05, backward=-1.0)
    for alpha in np.linspace(-np.pi, np.pi, 9):
        found = axial_coefficient(constant, alpha, never_drives=False)
        assert found == pytest.approx(0.05, rel=6e-3)
    half = AXIAL_DRAG(ca0=0.05, backward=0.5)
    assert axial_coefficient(half, np.pi) == pytest.approx(-0.025, rel=6e-3)


def test_an_elevator_that_gives_way_flies_as_one_turned_by_its_load():
    compliance = 0.003
    for x in random_states(20):
        u, plate = 3.0, normal_of(x[2] + x[3])
        alone = nose_up_dynamics(x, u, TAIL_ALONE)
        load = np.dot(force_of(alone, TAIL_ALONE), plate) / TAIL_ALONE.elevator_area
        turned = x + np.eye(7)[3] * compliance * load
        expected = nose_up_dynamics(turned, u, PARAMETERS)
        actual = flown(ELEVATOR_BLOWBACK(compliance=compliance), x, u)
        np.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-6)


def test_an_elevator_that_turns_farther_flies_as_one_turned_by_more():
    """Its rate as well, to first order: it counts along the body's normal."""
    u, rows, effect = 3.0, [], ELEVATOR_SCALE(change=0.5)
    for x in random_states(20):
        turned = x * (1.0 + 0.5 * np.eye(7)[3])
        expected = nose_up_dynamics(turned, 1.5 * u, PARAMETERS)
        plain, actual = flown(ELEVATOR_SCALE(), x, u), flown(effect, x, u)
        rows.append([(actual - expected)[4:], (plain - expected)[4:]])
    left, whole = np.linalg.norm(rows, axis=(0, 2))
    assert left < 0.02 * whole


@pytest.mark.parametrize("elevator", [-0.3, 0.3])
def test_an_elevator_that_gives_way_pitches_less(elevator):
    x = flying_at(0.0, elevator=elevator)
    stiff = nominal_derivatives(x)[6]
    soft = flown(ELEVATOR_BLOWBACK(compliance=0.002), x)[6]
    assert 0.5 < soft / stiff < 0.98


@pytest.mark.parametrize("elevator", [-0.1, 0.0, 0.1])
def test_a_spring_linkage_is_in_equilibrium_with_its_load(elevator):
    """The loads of plate and flap are those where the spring has turned to."""
    alpha, compliance, own = 0.08, 0.001, 0.0015
    x = flying_at(alpha, elevator=elevator)
    doubled = PARAMETERS.air_density * (x[4] ** 2 + x[5] ** 2)
    turn = 0.0
    for _ in range(100):
        flap = elevator + turn
        load = compliance * np.sin(alpha - flap) - own * np.sin(flap)
        turn = 0.5 * (turn + doubled * load)
    effect = ELEVATOR_BLOWBACK(compliance=compliance, deflection=own, relief=1.0)
    expected = nominal_derivatives(x + np.eye(7)[3] * turn)
    stiff = nominal_derivatives(x)
    error = np.abs(flown(effect, x) - expected)[6] / np.abs(stiff - expected)[6]
    assert error < 0.01


def separated(x, point, **values):
    """Returns the derivatives (8,) of a glider whose flow has separated at a point."""
    effect = LAGGED_SEPARATION(**values)
    theta = Theta(PARAMETERS, np.array(effect.values), NO_GAUSSIANS)
    full = np.append(x, point)
    chain = compose((LAGGED_SEPARATION,))
    return np.array(chain.derivatives(0.0, full, 0.0, 0.0, 0.0, theta))


@pytest.mark.parametrize(("point", "share"), [(1.0, 1.0), (0.25, 5 / 12), (0.0, 0.0)])
def test_separated_flow_has_kirchhoffs_force_between_plate_and_attached_wing(
    point, share
):
    x = flying_at(0.3)
    added = separated(x, point, slope=3.0) - np.append(nominal_derivatives(x), 0.0)
    size = PARAMETERS.mass * np.dot(added[4:6], normal_of(x[2]))
    size /= pressure_area(x, PARAMETERS) * np.sin(0.3)
    assert size == pytest.approx(3.0 * share, abs=0.02)


def test_the_separation_point_follows_an_angle_of_attack_that_comes_late():
    """Against α̇ from a step of the flight itself; at rest it is the steady one."""
    values = {"stall_angle": 0.3, "fade": 0.1, "relaxation": 0.06, "delay": 0.05}

    def alpha_of(x):
        return -x[2] - np.arctan2(x[5], x[4])

    for x in random_states(20):
        rates = separated(x, 0.4, slope=2.0, **values)
        step = 1e-6 * rates[:7]
        alphadot = (alpha_of(x + step) - alpha_of(x - step)) / 2e-6
        late = abs(alpha_of(x) - 0.05 * alphadot)
        steady = 1.0 / (1.0 + np.exp((late - 0.3) / 0.1))
        assert rates[7] == pytest.approx((steady - 0.4) / 0.06, abs=2e-4)
    kind, flow = LAGGED_SEPARATION, GliderModel(effects=(LAGGED_SEPARATION(slope=1.0),))
    rest = flow.initial_state(flying_at(0.26))
    assert flow.state_names[7:] == (f"{kind.kind}.separation_point",)
    assert rest[7] == pytest.approx(0.5, abs=1e-4)


def test_a_ground_effect_decays_as_wieselsbergers_above_its_floor():
    depth, length, strength = 0.8, 0.35, 0.1
    height = 4.0 / 3.0 * length**0.75 * depth**0.25
    effect = GROUND_EFFECT(strength=strength, height=height, inverse_depth=1 / depth)

    def sigma(above):
        return np.exp(-((above / length) ** 0.75))

    for z in (-1.2, -0.6, -0.2, 0.0, 0.4, 1.5):
        x = flying_at(0.2)
        x[1] = z
        plain = force_of(nominal_derivatives(x, p=WING_ALONE), WING_ALONE)
        more = force_of(flown(effect, x, p=WING_ALONE), WING_ALONE) / plain - 1.0
        share = strength * sigma(max(z + depth, 0.0)) / sigma(depth)
        np.testing.assert_allclose(more, share, rtol=1e-4)
        old = GROUND_EFFECT(strength=strength, height=0.4)
        more = force_of(flown(old, x, p=WING_ALONE), WING_ALONE) / plain - 1.0
        np.testing.assert_allclose(more, strength * np.exp(-z / 0.4), rtol=1e-6)


def test_stalled_downwash_is_downwash_until_it_stalls():
    effect = STALLED_DOWNWASH(gradient=0.6, stall_angle=0.3, fade=0.04)
    for alpha in (-0.6, -0.3, -0.1, 0.05, 0.2, 0.3, 0.37, 0.8, 1.5):
        x = flying_at(alpha, elevator=0.1)
        left = 0.6 / (1.0 + np.exp((abs(alpha) - 0.3) / 0.04))
        # |alpha| is rounded at zero by 1e-6 rad².
        expected = flown(DOWNWASH(gradient=left), x)
        np.testing.assert_allclose(flown(effect, x), expected, rtol=1e-4)
    np.testing.assert_allclose(  # Ten fades beyond, nothing is left of it.
        flown(effect, flying_at(0.9)), nominal_derivatives(flying_at(0.9)), rtol=1e-5
    )


def test_lagged_downwash_is_downwash_of_an_angle_that_comes_late():
    effect = LAGGED_DOWNWASH(gradient=0.5, time_constant=0.08)
    theta = Theta(PARAMETERS, np.array(effect.values), NO_GAUSSIANS)
    chain, model = compose((LAGGED_DOWNWASH,)), GliderModel(effects=(effect,))
    for alpha in (-0.6, -0.1, 0.05, 0.3, 0.8):
        x, product = flying_at(alpha, elevator=0.1), np.sin(alpha) * np.cos(alpha)
        rest = model.initial_state(x)
        assert rest[7] == pytest.approx(product)
        rates = chain.derivatives(0.0, rest, 0.0, 0.0, 0.0, theta)
        np.testing.assert_allclose(rates[:7], flown(DOWNWASH(gradient=0.5), x))
        late = np.append(x, 0.5 * product)
        rates = chain.derivatives(0.0, late, 0.0, 0.0, 0.0, theta)
        np.testing.assert_allclose(rates[:7], flown(DOWNWASH(gradient=0.25), x))
        assert rates[7] == pytest.approx(0.5 * product / 0.08)


def test_wind_shear_is_the_wind_of_that_height():
    for x in random_states(10):
        expected = nominal_derivatives(x, 2.0, wind=(0.7 * x[1], 0.0))
        actual = flown(WIND_SHEAR(gradient=0.7), x, 2.0)
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-12)


def kirchhoff(x, u, p, mass, inertia, ahead):
    """Kirchhoff's equations of a plate in the body axes of aircraft.

    Forward and down, pitch rate q positive nose up (Lamb, Hydrodynamics, chapter VI;
    Etkin and Reid): the momentum (m u, m w + m_a (w - e q)) turns with the axes; its
    air is at e ahead of the center of mass. Munk's moment is part of the plate's own.
    """
    s = GliderState(x.copy())
    plain = nose_up_dynamics(x, u, p)
    forward, down, q = axis_of(s.pitch), -normal_of(s.pitch), -s.pitchdot
    force = p.mass * plain[4:6]  # Weight included.
    moment = -p.pitch_inertia * plain[6]  # Nose up.
    along, across = np.dot(x[4:6], forward), np.dot(x[4:6], down)
    carried = mass * (across - ahead * q)
    u_rate = (np.dot(force, forward) - q * (p.mass * across + carried)) / p.mass
    whole = [
        [p.mass + mass, -mass * ahead],
        [-mass * ahead, p.pitch_inertia + inertia + mass * ahead**2],
    ]
    # The moment of e q's own impulse, m_a e q u, is not Munk's.
    given = [
        np.dot(force, down) + q * p.mass * along,
        moment - mass * ahead * q * along,
    ]
    w_rate, q_rate = np.linalg.solve(whole, given)
    # Back to the world, where the axes themselves turn with q.
    acceleration = (u_rate + q * across) * forward + (w_rate - q * along) * down
    return np.array([*plain[:4], *acceleration, -q_rate])


@pytest.mark.parametrize("ahead", [0.0, -0.04, 0.03])
def test_added_mass_obeys_kirchhoffs_equations(ahead):
    mass, inertia = 0.02, 3e-4
    whole = inertia + mass * ahead**2
    effect = ADDED_MASS(mass=mass, inertia=whole, coupling=mass * ahead)
    for x in random_states(30):
        expected = kirchhoff(x, 3.0, PARAMETERS, mass, inertia, ahead)
        actual = flown(effect, x, 3.0)
        np.testing.assert_allclose(actual, expected, rtol=1e-7, atol=1e-7)
        assert np.linalg.norm(actual - nominal_derivatives(x, 3.0)) > 0.1


def test_free_functions_of_added_mass_obey_them_at_each_angle_of_attack():
    center, width, weights = 0.3, 0.2, (0.4, 0.25)
    gaussians = gaussians_of(
        [
            FreeFunction(
                variables=["alpha"],
                centers=[[center]],
                widths=[width],
                weights={"added_mass": [weights[0]], "added_inertia": [weights[1]]},
            )
        ]
    )
    theta = Theta(PARAMETERS, np.zeros(0), gaussians)
    chain = compose((*FREE_FUNCTIONS.values(),))
    for x in random_states(30):
        velocity = x[4:6]
        across, along = velocity @ normal_of(x[2]), velocity @ axis_of(x[2])
        alpha = np.arctan2(-across, along)
        share = np.exp(-0.5 * ((alpha - center) / width) ** 2)
        mass = weights[0] * share * PARAMETERS.mass
        inertia = weights[1] * share * PARAMETERS.pitch_inertia
        expected = kirchhoff(x, 3.0, PARAMETERS, mass, inertia, 0.0)
        actual = chain.derivatives(0.0, x, 3.0, 0.0, 0.0, theta)
        np.testing.assert_allclose(actual, expected, rtol=1e-7, atol=1e-7)


def test_free_functions_of_forces_meet_the_air_of_others_as_any_air():
    """What varies with the angle of attack and the airspeed is of the flow in it."""
    wind = 0.4, -0.9
    air = {"wind_x": [wind[0]], "wind_z": [wind[1]]}
    forces = FreeFunction(
        variables=["alpha", "V"],
        centers=[[0.2, 6.0], [0.7, 4.0]],
        widths=[0.2, 2.0],
        weights={"c_drag": [0.3, 0.2], "added_mass": [0.2, 0.1]},
    )
    blown = FreeFunction(constant=True, weights=air)
    chain = compose((*FREE_FUNCTIONS.values(),))
    for x in random_states(30):
        theta, plain = (
            Theta(PARAMETERS, np.zeros(0), gaussians_of(own))
            for own in ([forces, blown], [forces])
        )
        np.testing.assert_allclose(
            chain.derivatives(0.0, x, 3.0, 0.0, 0.0, theta),
            chain.derivatives(0.0, x, 3.0, *wind, plain),
            rtol=1e-12,
        )


def test_air_ahead_of_the_center_of_mass_has_the_energy_of_its_motion():
    """In a vacuum without weight nothing changes the energy of glider and air."""
    p = PARAMETERS._replace(air_density=0.0, gravity=0.0)
    effect = ADDED_MASS(mass=0.03, inertia=4e-4, coupling=-6e-4)

    def energy(x):
        across = np.dot(normal_of(x[2]), x[4:6])
        air = 0.03 * across**2 - 2 * -6e-4 * across * x[6] + 4e-4 * x[6] ** 2
        own = p.mass * np.dot(x[4:6], x[4:6]) + p.pitch_inertia * x[6] ** 2
        return 0.5 * (own + air)

    for x in random_states(10):
        rates = flown(effect, x, 0.0, p)
        # But for the power of Munk's moment, which is in the plate's own.
        munk = 0.03 * np.dot(axis_of(x[2]), x[4:6]) * np.dot(normal_of(x[2]), x[4:6])
        change = (energy(x + 1e-5 * rates) - energy(x - 1e-5 * rates)) / 2e-5
        assert change == pytest.approx(-munk * x[6], abs=1e-7)


@pytest.mark.parametrize("coupling", [0.0, 5e-4])
def test_the_momentum_of_glider_and_carried_air_changes_by_its_weight_alone(coupling):
    """In a vacuum: m v + m_a w n falls as a stone does, however it turns."""
    p, carried = PARAMETERS._replace(air_density=0.0), 0.03
    effect = ADDED_MASS(mass=carried, coupling=coupling)

    def momentum(x):
        n = normal_of(x[2])
        impulse = carried * np.dot(n, x[4:6]) - coupling * x[6]
        return p.mass * x[4:6] + impulse * n

    for x in random_states(10):
        step = 1e-5 * flown(effect, x, 2.0, p)
        change = (momentum(x + step) - momentum(x - step)) / 2e-5
        np.testing.assert_allclose(change, [0.0, -p.mass * p.gravity], atol=1e-7)


def test_added_mass_in_a_uniform_wind_is_in_a_moving_frame():
    effect, wind = ADDED_MASS(mass=0.02), np.array([-1.0, 0.5])
    for x in random_states(5):
        moving = x.copy()
        moving[4:6] -= wind
        actual = flown(effect, x, wind=wind)[4:]
        np.testing.assert_allclose(actual, flown(effect, moving)[4:], rtol=1e-9)


@pytest.mark.parametrize("kind", LIBRARY, ids=lambda kind: kind.kind)
def test_every_effect_is_smooth_at_rest(kind):
    effect = at_work(kind)
    x, c = full_state([effect], np.array([0.0, 0.1, -0.3, 0.2, 0.0, 0.0, 2.0]))
    chain = compose((kind,))
    slopes = InitializeAutoDiff(x).ravel()
    rates = np.array(
        chain.derivatives(
            0.0, slopes, 1.0, 0.0, 0.0, Theta(PARAMETERS, c, NO_GAUSSIANS)
        )
    )
    assert np.all(np.isfinite(ExtractValue(rates)))
    assert np.all(np.isfinite(ExtractGradient(rates)))
