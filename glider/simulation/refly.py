"""A logged flight flown again by models, as motions to look at."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider.campaign.logs import Campaign, Flight
from glider.campaign.turning import signs_of, turn, turn_campaign
from glider.compiled.replay import OFFSET
from glider.errors import InputError
from glider.physics.compose import compose
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.sysid.constants import FEW_FLIGHTS
from glider.sysid.fit.prediction import RolloutModel, predict
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import start_scales
from glider.sysid.replay.log_space import log_space_of, vector_of
from glider.sysid.replay.record import Noise, Record, evenly, measure_noise, prepare
from glider.sysid.replay.replayed import signals, trimmed, true_nodes
from glider.sysid.replay.vehicle import make_vehicle

_LARGEST_POSITION = 100.0
"""Position that no flight reaches [m]: a model that does has diverged."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Motion:
    """Flight as cameras or a model have it."""

    #: (n,) from the first row of the log [s]; it ends early where a model diverges.
    time: np.ndarray
    poses: np.ndarray  #: (n, 4) x, z [m], pitch, elevator [rad].
    #: (n, 2) of wing and elevator along their normals [N], as the model has them along
    #: the measured flight; None for a model's own flight, and where the campaign does
    #: not give the mass.
    forces: np.ndarray | None = None


def nominal_model(campaign: Campaign) -> GliderModel | None:
    """Returns the nominal model; None where the campaign does not give all of it."""
    vehicle = make_vehicle(campaign)
    if not vehicle.is_known:
        return None
    return GliderModel(parameters=vehicle.parameters)


def nominal_parameters(campaign: Campaign) -> GliderParameters:
    """The given parameters of the vehicle; the default glider's for the others."""
    vehicle: dict[str, Any] = dict(campaign.vehicle)
    return GliderParameters(**vehicle)


def find_flight(campaign: Campaign, name: str) -> Flight:
    """Returns a flight, named with or without ".csv".

    Raises:
        InputError: there is none; it lists those there are.
    """
    flights = {f.name.removesuffix(".csv"): f for f in campaign.flights}
    if name.removesuffix(".csv") not in flights:
        raise InputError(
            f"{campaign.path}: there is no flight '{name}'; expected one of "
            f"{', '.join(flights)}."
        )
    return flights[name.removesuffix(".csv")]


def refly(
    campaign: Campaign,
    flight: Flight,
    models: Mapping[str, GliderModel],
    *,
    rollouts: Mapping[str, RolloutModel] | None = None,
) -> dict[str, Motion]:
    """Flies a logged flight again, each model from its own fitted launch.

    The launch is fitted on the flight's beginning, as for the errors on held-out
    flights (`glider.sysid.fit.prediction`); the elevator moves as its commands say.

    Args:
        campaign: all of it: its flights determine the noise, and their
            flight-to-flight variation under the last model.
        flight: of the campaign.
        models: by name, at least one; the measured flight's forces are the last
            one's.
        rollouts: of the same models; None: those of the campaign as it is.

    Returns:
        "measured", then the models by name. Angles have the signs that the last
        model knows, so that a log with a wrong sign is seen as it was flown.
    """
    *_, last = models.values()
    true = signs_of(last)
    rollouts = rollouts or rollout_models(campaign, models)
    motions = {}
    for label, model in models.items():
        signs = signs_of(model)
        [record], _ = _records(campaign, [flight], model)
        predicted = predict(rollouts[label], record)
        elevator = signals(record, vector_of(model)).logged + predicted.trim
        poses = np.column_stack([predicted.pose, elevator])
        poses *= (1, 1, signs.pitch * true.pitch, signs.elevator * true.elevator)
        near = np.max(np.abs(poses), axis=1) < _LARGEST_POSITION
        rows = len(near) if near.all() else int(np.argmin(near))
        motions[label] = Motion(time=record.time[:rows], poses=poses[:rows])
    # With the last model's signs.
    angle = np.where(record.seen[:, 3], record.elevator, elevator)
    has_mass = "mass" in campaign.vehicle
    measured = Motion(
        time=record.time,
        poses=np.column_stack([record.pose, angle]),
        forces=_forces(record, last, predicted.trim) if has_mass else None,
    )
    return {"measured": measured, **motions}


def rollout_models(
    campaign: Campaign, models: Mapping[str, GliderModel], *, varies: bool = True
) -> dict[str, RolloutModel]:
    """Models with what a campaign's flights have in common: noise, variation, trim.

    Args:
        campaign: with the flights.
        models: by name, at least one; flights vary about the last one.
        varies: whether flights vary by more than their launches, as the models fit
            them. What a model lacks is taken for such a variation, too: without it a
            model's errors do not depend on what the other models know.
    """
    *_, last = models.values()
    some = evenly(campaign.flights, FEW_FLIGHTS)
    records, noise = _records(campaign, some, last)
    scales = start_scales(noise)
    if varies:
        theta = vector_of(last)
        flights = [linearize(r, theta, last.gaussians) for r in records]
        fitted, cost = fit_scales(flights, scales)
        scales = fitted if np.isfinite(cost) else scales  # A model may diverge.
    has_trims = make_vehicle(campaign).per_flight_trims
    if not varies:
        scales = scales.without("wind", "pitch_zero", "memory")
        scales = scales if has_trims else scales.without("trim")
    return {
        name: RolloutModel(
            theta=vector_of(model),
            gaussians=model.gaussians,
            scales=scales,
            per_flight_trims=has_trims,
        ).on(records if model is last else _records(campaign, some, model)[0])
        for name, model in models.items()
    }


def position_errors(motions: Mapping[str, Motion]) -> dict[str, tuple[float, float]]:
    """RMS and last distance in x and z of each model's rows from the measured [m]."""
    (_, measured), *models = motions.items()
    errors = {}
    for name, flown in models:
        across = measured.poses[: len(flown.time), :2] - flown.poses[:, :2]
        distances = np.linalg.norm(across, axis=1)
        errors[name] = float(np.sqrt(np.mean(distances**2))), float(distances[-1])
    return errors


def _records(
    campaign: Campaign, flights: Sequence[Flight], model: GliderModel
) -> tuple[list[Record], Noise]:
    """Returns flights and the campaign's noise, with a model's signs and servo."""
    signs = signs_of(model)
    limits = model.parameters.elevator_limits
    turned = dataclasses.replace(
        turn_campaign(campaign, signs),
        elevator_limits=None if limits is None else (limits[0], limits[1]),
        elevator_rate_limit=model.parameters.elevator_rate_limit,
    )
    noise = measure_noise(turned)
    flights = tuple(turn(flight, signs) for flight in flights)
    return prepare(flights, turned, noise, log_space_of(model)), noise


def _forces(record: Record, model: GliderModel, trim: float) -> np.ndarray:
    """Returns the model's forces of the plates along the smoothed flight, (n, 2)."""
    theta = vector_of(model)
    gaussians = model.gaussians
    moved, shift = trimmed(record, theta, trim)
    nodes = true_nodes(record, moved, gaussians)
    nodes[:, OFFSET] = shift
    path, rate = signals(record, theta).at_nodes
    chain = compose(record.space.flown)
    numbers = chain.theta_of(theta, gaussians)
    forces = []
    for t, node, angle, u in zip(record.time, nodes, path, rate, strict=True):
        x = node.copy()
        x[OFFSET] += angle
        flow, terms = chain.meet_air(t, x, u, 0.0, 0.0, numbers)
        forces.append(chain.wrench(flow, terms, x, numbers.c)[:2])
    return np.array(forces)
