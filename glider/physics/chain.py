"""The chain of forces on the glider, written once, as pure functions of scalars.

    command -> [actuator] -> [air] -> [geometry] -> [surface] -> forces
            -> [wrench] -> [inertia] -> acceleration;  state -> [sensor] -> pose

The functions named `*_terms` and `*_rates` are the places where effects enter, and
`*_values` returns the coefficients of effects that are free functions, which the terms
take as `values`. Here, on the nominal model, they are zero or none;
`glider.physics.compose.compose` puts in their place the sums over given effects, and
`glider.compiled.kernel` compiles the same text. Frames and signs:
`glider.physics.state`.
"""

from glider.physics.aerodynamics import airspeed, elevator_velocity, plate_force, turned
from glider.physics.effects.effect import Flow, Motion
from glider.physics.formulas import cos, sin
from glider.physics.parameters import NUM_PARAMETERS, Parameters, Theta

NUM_INPUTS = 3
"""Command [rad/s] and wind (x, z) [m/s]."""


def actuator_terms(rate, x, c):
    """Elevator rate that the servo makes of a commanded one [rad/s]."""
    return rate


def actuator_rates(rate, x, c):
    """Rates of the actuators' own states."""
    return ()


def pending_terms(x, c):
    """Angle by which the actuators still turn the elevator, unasked [rad]."""
    return 0.0


def air_terms(motion, x, c, values):
    """Velocity of the air beyond the input wind, world (x, z) [m/s]."""
    return 0.0, 0.0


def geometry_terms(flow, x, c, values):
    """Wing incidence [rad], wing shift [m], elevator trim [rad], downwash [m/s]."""
    return 0.0, 0.0, 0.0, 0.0


def surface_terms(flow, x, c, values):
    """Added C_n of the wing, relative change of wing and of elevator force."""
    return 0.0, 0.0, 0.0


def wrench_terms(flow, x, c, values):
    """Added world force (x, z) [N] and moment about +y [N m]."""
    return 0.0, 0.0, 0.0


def inertia_terms(flow, x, c, values):
    """Relative change of mass and inertia, added mass, inertia and their coupling."""
    return 0.0, 0.0, 0.0, 0.0, 0.0


def sensor_terms(flow, x, c, values):
    """Measured minus true pose (x, z, pitch) [m, m, rad]."""
    return 0.0, 0.0, 0.0


def air_values(motion, gaussians):
    """Values of the free functions that move the air."""
    return ()


def body_values(flow, gaussians):
    """Values of the free functions that act on the glider."""
    return ()


def sensor_values(flow, gaussians):
    """Values of the free functions that the sensors show."""
    return ()


def effect_rates(flow, xdd, zdd, x, c):
    """Rates of the states of effects that are not actuators."""
    return ()


def demanded_angle(x, c):
    """Returns the angle ψ that the servo has turned to [rad]: the elevator follows.

    Its rate is the servo's, whatever the actuators are: see `glider.physics.servo`.
    """
    return x[3] + pending_terms(x, c)


def motion_of(t, x, rate):
    """Returns the Motion of a state (7,) whose elevator turns at `rate`."""
    pitch = x[2]
    return Motion(
        t, x[0], x[1], pitch, x[3], x[4], x[5], x[6], rate, sin(pitch), cos(pitch)
    )


def flow_of(motion, wind_x, wind_z, p):
    """Returns the Flow that a glider in Motion meets in air of that velocity.

    V = √(v_x² + v_z²), sin α = -(v·n)/V, cos α = (v·t)/V, with v the velocity
    through the air, n = (sin θ, cos θ) and t = (cos θ, -sin θ).
    """
    air_x = motion.xdot - wind_x
    air_z = motion.zdot - wind_z
    speed = airspeed(air_x, air_z)
    sin_alpha = -(air_x * motion.sin_pitch + air_z * motion.cos_pitch) / speed
    cos_alpha = (air_x * motion.cos_pitch - air_z * motion.sin_pitch) / speed
    return Flow(
        motion.t,
        motion.x,
        motion.z,
        motion.pitch,
        motion.elevator,
        motion.xdot,
        motion.zdot,
        motion.pitchdot,
        motion.elevator_rate,
        motion.sin_pitch,
        motion.cos_pitch,
        air_x,
        air_z,
        speed,
        sin_alpha,
        cos_alpha,
        p.mass,
        p.pitch_inertia,
        p.wing_area,
        p.elevator_area,
        p.wing_offset,
        p.hinge_offset,
        p.elevator_offset,
        p.air_density,
        p.gravity,
    )


def wing_force(flow, plate, incidence, shift, normal, factor):
    """Force of the wing along its normal [N] and its moment about +y [N m].

    f = ½ ρ S_w V² (2 sin α + ΔC_n)(1 + factor) at the wing's center, which lies
    l_w + shift ahead of the center of mass: M = -(l_w + shift) f cos(incidence).
    `plate` is sine and cosine of the wing's angle.
    """
    offset = flow.wing_offset + shift
    turning = offset * flow.pitchdot
    velocity = (
        flow.air_x - turning * flow.sin_pitch,
        flow.air_z - turning * flow.cos_pitch,
    )
    force = plate_force(velocity, plate, flow.wing_area, flow.air_density)
    pressure = 0.5 * flow.air_density * flow.wing_area * flow.speed * flow.speed
    force = (force + pressure * normal) * (1.0 + factor)
    return force, -offset * force * cos(incidence)


def elevator_force(flow, plate, deflection, downwash, factor):
    """Force of the elevator along its normal [N] and its moment about +y [N m].

    Its center lies l_h + l_e behind the center of mass and moves with
    l_h θ̇ n(θ) + l_e (θ̇ + φ̇) n(e), e = θ + δ; M = (l_h cos δ + l_e) f with the
    deflection δ. `plate` is sine and cosine of e.
    """
    velocity = elevator_velocity(flow, plate, downwash)
    force = plate_force(velocity, plate, flow.elevator_area, flow.air_density)
    force = force * (1.0 + factor)
    arm = flow.hinge_offset * cos(deflection) + flow.elevator_offset
    return force, arm * force


def flow_in_air(t, x, rate, wind_x, wind_z, theta):
    """Returns the Flow of a state, in the effects' air too."""
    motion = motion_of(t, x, rate)
    values = air_values(motion, theta.gaussians)
    more_x, more_z = air_terms(motion, x, theta.c, values)
    return flow_of(motion, wind_x + more_x, wind_z + more_z, theta.p)


def meet_air(t, x, rate, wind_x, wind_z, theta):
    """Returns the Flow of a state and the values of the free functions in it."""
    flow = flow_in_air(t, x, rate, wind_x, wind_z, theta)
    return flow, body_values(flow, theta.gaussians)


def wrench(flow, values, x, c):
    """Forces and moment on the glider without weight.

    Returns:
        wing force along its normal, elevator force along its normal [N], total
        world force (x, z) [N], total moment about +y [N m], wing incidence and
        elevator trim [rad].
    """
    incidence, shift, trim, downwash = geometry_terms(flow, x, c, values)
    normal, wing_factor, elevator_factor = surface_terms(flow, x, c, values)
    deflection = flow.elevator + trim
    wing_plate = turned(flow, incidence)
    tail_plate = turned(flow, deflection)
    wing, wing_moment = wing_force(
        flow, wing_plate, incidence, shift, normal, wing_factor
    )
    tail, tail_moment = elevator_force(
        flow, tail_plate, deflection, downwash, elevator_factor
    )
    force_x, force_z, moment = wrench_terms(flow, x, c, values)
    force_x = force_x + wing * wing_plate[0] + tail * tail_plate[0]
    force_z = force_z + wing * wing_plate[1] + tail * tail_plate[1]
    moment = moment + wing_moment + tail_moment
    return wing, tail, force_x, force_z, moment, incidence, trim


def accelerations(flow, values, x, c):
    """Returns (ẍ, z̈, θ̈) [m/s², rad/s²].

    (1 + μ) m (a + g e_z) + (m_a n·a - s θ̈) n =
        F - θ̇ (m_a (v·t) n + (m_a (v·n) - s θ̇) t),  ((1 + ι) I + I_a) θ̈ - s n·a = M
    with the added mass m_a along the body's normal n, whose rate is ṅ = θ̇ t, the added
    inertia I_a and their coupling s.
    """
    _, _, force_x, force_z, moment, _, _ = wrench(flow, values, x, c)
    change, turn_change, added_mass, added_inertia, coupling = inertia_terms(
        flow, x, c, values
    )
    mass = flow.mass * (1.0 + change)
    inertia = flow.pitch_inertia * (1.0 + turn_change) + added_inertia
    # Not by the angle of attack, whose sine is a quotient by an airspeed.
    along = flow.air_x * flow.cos_pitch - flow.air_z * flow.sin_pitch
    across = flow.air_x * flow.sin_pitch + flow.air_z * flow.cos_pitch
    back = flow.pitchdot * (added_mass * across - coupling * flow.pitchdot)
    down = flow.pitchdot * added_mass * along
    force_x = force_x - back * flow.cos_pitch - down * flow.sin_pitch
    force_z = force_z + back * flow.sin_pitch - down * flow.cos_pitch
    x = force_x / mass
    z = force_z / mass - flow.gravity
    normal = x * flow.sin_pitch + z * flow.cos_pitch
    lever = coupling / inertia
    heavier = added_mass - lever * coupling
    carried = (heavier * normal - lever * moment) / (mass + heavier)
    x = x - carried * flow.sin_pitch
    z = z - carried * flow.cos_pitch
    return x, z, moment / inertia + lever * (normal - carried)


def alpha_rate(flow, xdd, zdd):
    """Rate of the angle of attack in steady air [rad/s], for state rates."""
    turn = flow.air_x * zdd - flow.air_z * xdd
    return -flow.pitchdot - turn / (flow.speed * flow.speed)


def derivatives(t, x, u, wind_x, wind_z, theta):
    """The dynamics: ẋ = f(t, x, u, w; θ).

    Args:
        t: time [s]; free functions of it and formulas that ask for it use it.
        x: (7 + extra,): the states of glider.physics.state, then the effects' own.
        u: commanded elevator rate [rad/s].
        wind_x: velocity of the air, world x [m/s].
        wind_z: the same, world z [m/s].
        theta: the glider's numbers.

    Returns:
        ẋ as a tuple of 7 + extra scalars.
    """
    c = theta.c
    rate = actuator_terms(u, x, c)
    flow, values = meet_air(t, x, rate, wind_x, wind_z, theta)
    xdd, zdd, pitchdd = accelerations(flow, values, x, c)
    return (
        flow.xdot,
        flow.zdot,
        flow.pitchdot,
        rate,
        xdd,
        zdd,
        pitchdd,
        *actuator_rates(u, x, c),
        *effect_rates(flow, xdd, zdd, x, c),
    )


def measure(x, theta):
    """Returns the pose (x, z, pitch) that the sensors show of a state."""
    flow = flow_of(motion_of(0.0, x, 0.0), 0.0, 0.0, theta.p)
    values = sensor_values(flow, theta.gaussians)
    error_x, error_z, error_pitch = sensor_terms(flow, x, theta.c, values)
    return x[0] + error_x, x[1] + error_z, x[2] + error_pitch


def parameters_of(n):
    """Returns the Parameters at the front of a vector n."""
    return Parameters(n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8])


def theta_of(numbers, gaussians):
    """Returns the Theta of a vector: parameters, then coefficients.

    It returns an array, so no other function of the chain may call it: compiled, they
    count no references (see `glider.compiled.kernel`), and its array would never go.
    """
    return Theta(parameters_of(numbers), numbers[NUM_PARAMETERS:], gaussians)


def derivatives_of(t, z, n, gaussians):
    """Returns ẋ from one vector of all numbers that it depends on.

    Args:
        t: [s].
        z: (n + 3 + 9 + len(c),) state, command [rad/s], wind (x, z) [m/s], parameters,
            coefficients.
        n: number of states.
        gaussians: of the free functions.
    """
    numbers = z[n + NUM_INPUTS :]
    theta = Theta(parameters_of(numbers), numbers[NUM_PARAMETERS:], gaussians)
    return derivatives(t, z, z[n], z[n + 1], z[n + 2], theta)
