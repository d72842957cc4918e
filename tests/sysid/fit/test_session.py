"""A change during a session is found by the flights' order, and nothing without one."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.bench_changes import begin_during_session
from glider import close_the_loop
from glider.campaign.changes import Change, by_number
from glider.campaign.logs import Campaign
from glider.physics.effects import ELEVATOR_TRIM, MASS, EffectKind
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.fit.session import are_at_one_end, change_of
from glider.sysid.replay.log_space import log_space

ROWS = 40  # Of each flight.


def changed(shares: np.ndarray, seed: int = 0, scatter: float = 0.0) -> Change | None:
    """What is found in flights of which the second coefficient has such shares.

    It is that of the elevator's trim; the first, of the mass, is the same in all.
    """
    rng = np.random.default_rng(seed)
    space = log_space(())
    slots = [space.slots_of(kind.kind)[0] for kind in (MASS, ELEVATOR_TRIM)]
    grams = []
    for share in shares:
        columns = rng.normal(size=(ROWS, 2)) * 100.0
        truth = 0.01, 0.05 * (share + scatter * rng.normal())
        errors = columns @ truth + rng.normal(size=ROWS)
        rows = np.column_stack([columns, errors])
        grams.append(rows.T @ rows)

    names = [f"flight_{i}.csv" for i in range(len(shares))]
    in_files = np.argsort(names)  # 10 comes before 2 there.
    records = [SimpleNamespace(name=names[i]) for i in in_files]
    candidates: Any = SimpleNamespace(
        task=SimpleNamespace(space=space, records=records),
        model=SimpleNamespace(kinds=()),
        variants={"mass": ((0,),), "elevator_trim": ((1,),)},
        slots=slots,
        directions=[SimpleNamespace(kind=kind.kind) for kind in (MASS, ELEVATOR_TRIM)],
        always=[],
    )
    prior: Any = SimpleNamespace(precision=np.ones(2))
    ordered = np.array(grams)[in_files]
    return change_of(candidates, ordered, prior, np.random.default_rng(1))


@pytest.mark.parametrize("at", [2, 6, 11])
def test_a_break_is_dated(at: int) -> None:
    found = changed(np.arange(13) >= at)
    assert found is not None
    assert (found.kind, found.coefficient) == ("elevator_trim", "angle")
    assert found.flight == f"flight_{at}.csv"
    assert abs(found.value - 0.05) < 4.0 * found.std


def test_a_drift_is_no_break() -> None:
    found = changed(np.linspace(-0.5, 0.5, 14))
    assert found is not None and found.flight == ""
    assert abs(found.value - 0.05) < 4.0 * found.std
    assert "drifts" in found.sentence


def test_scatter_over_flights_is_no_change() -> None:
    found = [changed(np.zeros(12), seed, scatter=1.0) for seed in range(100)]
    assert not any(found)


def test_a_single_flight_is_an_outlier() -> None:
    assert changed(np.arange(9) == 8) is None


def test_two_flights_apart_from_the_others_and_from_one_another_are_no_change() -> None:
    """As of a formula that does not fit: a change is from one value to another."""
    shares = np.where(np.arange(14) < 2, 0.0, 1.0)
    assert changed(shares) is not None
    assert changed(np.where(np.arange(14) == 0, -0.5, shares)) is None


def test_a_change_too_small_to_report_is_left_out() -> None:
    assert changed(0.01 * (np.arange(12) >= 6)) is None


def test_flights_are_ordered_by_their_numbers() -> None:
    names = ["b_10.csv", "b_9.csv", "a.csv"]
    assert sorted(names, key=by_number) == ["a.csv", "b_9.csv", "b_10.csv"]


@pytest.mark.parametrize(
    ("some", "expected"),
    [("89", True), ("012", True), ("9", False), ("39", False), ("01234567", True)],
)
def test_flights_at_one_end_of_the_session(some: str, expected: bool) -> None:
    assert are_at_one_end(some, "0123456789") == expected


def session(sizes: dict[EffectKind, np.ndarray], seed: int) -> Campaign:
    """A campaign of as many flights as sizes of effects, with these in turn."""
    rng = np.random.default_rng(seed)
    flights = []
    for i, own in enumerate(zip(*sizes.values(), strict=True)):
        effects = [
            effect(**{effect.coefficients[0].name: size})
            for effect, size in zip(sizes, own, strict=True)
        ]
        model = GliderModel(effects=tuple(effects))
        one = CampaignPlan(flights=1).simulate(model, rng)
        name = f"flight_{i:03d}.csv"
        flights.append(dataclasses.replace(one.flights[0], name=name))

    return dataclasses.replace(one, flights=tuple(flights))


@pytest.mark.slow
def test_a_lighter_glider_is_traced_alone() -> None:
    sizes = 0.1 * (np.arange(18) >= 8)
    result = close_the_loop(session({MASS: sizes}, 3))
    assert [change.flight for change in result.changes] == ["flight_008.csv"]
    assert result.changes[0].kind == "mass"
    assert result.verdict == "effect_found"
    [found] = result.effects
    mass = found.coefficients["change"]
    assert found.kind == "mass" and abs(mass.value - 0.1) < 4.0 * mass.std
    aside = [rows.file for rows in result.set_aside]
    assert aside == [f"flight_{i:03d}.csv" for i in range(8)]
    assert result.reason.startswith("At flight_008.csv 'change' of mass jumps")


@pytest.mark.slow
def test_the_flights_since_a_change_may_hold_another() -> None:
    order = np.arange(20)
    sizes = {MASS: 0.1 * (order >= 6), ELEVATOR_TRIM: 0.04 * (order >= 13)}
    result = close_the_loop(session(sizes, 5))
    dates = {change.kind: change.flight for change in result.changes}
    assert dates == {"mass": "flight_006.csv", "elevator_trim": "flight_013.csv"}
    assert result.flights.count == 7
    assert [effect.kind for effect in result.effects] == ["mass", "elevator_trim"]


@pytest.mark.slow
def test_a_break_is_no_variation_from_flight_to_flight() -> None:
    """A fitted variation of trims holds their break, which gusts then outweigh."""
    planted, found = begin_during_session("elevator_trim", 64)
    assert planted == "elevator_trim +0.05 at flight_007.csv of 18"
    assert found.startswith("elevator_trim +0.049") and "at flight_007.csv" in found


@pytest.mark.slow
def test_another_servo_is_dated_and_one_part_is_traced() -> None:
    planted, found = begin_during_session("upper_stop", 57)
    assert planted.endswith("at flight_003.csv of 18")
    assert found == "servo -0.497 at flight_003.csv | no_effect: nothing"


@pytest.mark.slow
def test_a_drift_is_not_called_noise() -> None:
    sizes = np.linspace(-0.03, 0.03, 14)
    result = close_the_loop(session({ELEVATOR_TRIM: sizes}, 4))
    [change] = result.changes
    assert (change.kind, change.flight) == ("elevator_trim", "")
    assert abs(change.value - 0.06) < 4.0 * change.std
    assert result.verdict == "unexplained"
