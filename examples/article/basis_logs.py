"""The identification exercise as logs, for the tracer to look at."""

import numpy as np
from threadpoolctl import threadpool_limits

from basis_dynamics import SampledFlights
from basis_exercise import Exercise, fly_exercise
from basis_features import angle_sign
from glider.campaign.logs import Campaign, Flight, campaign_of
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.turning import Signs
from glider.simulation.campaigns import FINE
from glider.sysid.pipeline import Progress, close_the_loop
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.result import Result
from glider.sysid.search.signs import find_signs


def exercise_campaign(exercise: Exercise, angles: str) -> Campaign:
    """Returns the exercise's data as a campaign, without noise.

    A campaign's angles are nose down. Who takes the exercise's numbers for nose up
    turns them round on the way into the log: so the published exercise's fault looks
    in a log.

    Args:
        exercise: the flights.
        angles: what their numbers are taken for, a key of `basis_features.ANGLES`.
    """
    flights = exercise.flights
    nothing = np.zeros((*flights.states.shape[:2], 4))
    return _campaign(exercise, flights, angles, nothing)


def filmed_campaign(
    exercise: Exercise, angles: str, rng: np.random.Generator
) -> Campaign:
    """Returns the exercise's launches and tapes as cameras would log them.

    They are flown by fine Runge-Kutta steps, where the exercise takes Euler steps of
    a hundredth of a second that part from the glider by centimetres, and measured
    with the noise of `MotionCapture`.

    Args:
        exercise: the flights.
        angles: as in `exercise_campaign`.
        rng: of the noise.
    """
    given = exercise.flights
    fine = fly_exercise(
        exercise.parameters,
        given.states[:, 0].copy(),
        given.rates.repeat(FINE, axis=1),
        given.step / FINE,
        order=4,
    )
    flights = SampledFlights(
        states=fine.states[:, ::FINE], rates=given.rates, step=given.step
    )
    noise = MotionCapture().draw(rng, *flights.states.shape[:2])
    return _campaign(exercise, flights, angles, noise)


def find_exercise_signs(exercise: Exercise, angles: str) -> Signs:
    """Returns which signs are wrong in the log of `exercise_campaign`."""
    log = exercise_campaign(exercise, angles)
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        return find_signs(log, log.flights, {}, make_vehicle(log))


def trace_filmed(
    exercise: Exercise, angles: str, rng: np.random.Generator, progress: Progress
) -> Result:
    """Traces the logs of `filmed_campaign`."""
    return close_the_loop(filmed_campaign(exercise, angles, rng), progress=progress)


def _campaign(
    exercise: Exercise, flights: SampledFlights, angles: str, noise: np.ndarray
) -> Campaign:
    sign = -angle_sign(angles)
    measured = (flights.states[:, :, :4] + noise) * [1.0, 1.0, sign, sign]
    commands = sign * np.concatenate([flights.rates, flights.rates[:, -1:]], axis=1)
    logs = [
        Flight(
            name=f"flight_{i:03d}.csv",
            time=flights.step * np.arange(len(seen)),
            pose=seen[:, :3],
            elevator=seen[:, 3],
            command=command,
        )
        for i, (seen, command) in enumerate(zip(measured, commands, strict=True))
    ]
    rate = 1.0 / flights.step
    return campaign_of("identification", exercise.parameters, logs, rate, rate)
