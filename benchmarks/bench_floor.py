"""Does a perfect model leave the predicted floor? Prints a table; asserts nothing.

    python -m benchmarks.bench_floor [--seeds 24] [--first 0] [--wrong]

Lifelike campaigns of effects in the library's own forms, in still air and in
turbulence, half of them with flight-to-flight variation; the right effects are fitted
to three quarters of the flights. A line has the held-out errors over their floor (free,
along the measured pitch), and the probability that a perfect model leaves as much. With
--wrong, the forms are others.
"""

import argparse
import types
from collections.abc import Sequence

import numpy as np

from glider.sysid.constants import UNLIKELY
from glider.sysid.evaluation import without_model_errors
from glider.sysid.fit.floor import PerfectModel, find_floor
from glider.sysid.fit.prediction import flown_by, mean_squares, predict
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.outcome import spreads_of
from tests.helpers.known_truth import starts_of, task_of
from tests.helpers.lifelike import draw_campaign

Planted = tuple[tuple[str, str], ...]

RIGHT: tuple[Planted, ...] = (
    (("attached_lift", "library"),),
    (("profile_drag", "library"), ("wind", "library")),
    (("servo_lag", "library"), ("camber", "library")),
    (("center_of_pressure", "library"), ("attached_lift", "library")),
    (("ground_effect", "library"),),
    (("downwash", "library"), ("profile_drag", "library")),
    (("dynamic_stall", "library"),),
    (("pitch_damping", "library"), ("mass", "library")),
)

WRONG: tuple[Planted, ...] = (
    (("attached_lift", "soft"),),
    (("dynamic_stall", "separation"),),
    (("profile_drag", "rising"), ("wind", "library")),
    (("servo_lag", "second_order"),),
    (("center_of_pressure", "travelling"), ("attached_lift", "library")),
    (("ground_effect", "inverse"),),
    (("stalled_downwash", "smoothstep"),),
    (("pitch_damping", "quadratic"),),
)


def measure(
    seed: int, planted: Planted, moving_air: bool, flights: int = 25
) -> tuple[np.ndarray, float]:
    """Returns errors over floors (2,), and their probability."""
    campaign, _ = draw_campaign(
        seed,
        flights,
        planted,
        moving_air=moving_air,
        spreads=seed % 2 == 1,
        broken=False,
    )
    whole, noise = task_of(campaign)
    unseen = whole.records[::4]
    names = {record.name for record in unseen}
    task = whole.on([r for r in whole.records if r.name not in names])
    starts = starts_of(task, noise, [kind for kind, _ in planted])
    model = min((fit_model(task, start) for start in starts), key=lambda fit: fit.cost)
    flown = flown_by(task, model, model.scales)
    traced = types.SimpleNamespace(model=model, forces=None)
    truth = without_model_errors(traced, spreads_of(task, model))
    perfect = PerfectModel(
        truth=truth,
        pitch_ratio=noise.smoothing[2].ratio,
        rng=np.random.default_rng(seed),
    )
    floor = find_floor(flown, unseen, perfect)
    own = [predict(flown, record) for record in unseen]
    errors = np.sqrt(mean_squares(unseen, own)[:, :2])
    flown = np.isfinite(errors).all(axis=1)
    rms = np.sqrt(np.average(errors[flown] ** 2, axis=0, weights=floor.rows[flown]))
    squares = floor.squares[flown].mean(axis=2)[:, :2]
    floors = np.sqrt(np.average(squares, axis=0, weights=floor.rows[flown]))
    return rms / floors, floor.chance(errors)


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a line a campaign, and the means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--wrong", action="store_true")
    options = parser.parse_args(arguments)
    cases = WRONG if options.wrong else RIGHT
    for air in (False, True):
        ratios = []
        chances = []
        for seed in range(options.first, options.first + options.seeds):
            planted = cases[seed % len(cases)]
            found, chance = measure(seed, planted, air)
            names = ", ".join("/".join(pair) for pair in planted)
            print(f"{seed:4d} {found.round(2)} {chance:.4f} {names}", flush=True)
            ratios.append(found)
            chances.append(chance)
        logs = np.log(ratios)
        beyond = np.sum(np.array(chances) < UNLIKELY)
        mean = np.exp(logs.mean(axis=0)).round(3)
        spread = logs.std(axis=0).round(3)
        print(
            f"{'turbulence' if air else 'still air'}: over the floor, geometric mean "
            f"{mean}, spread {spread}; beyond it in {beyond} of {len(ratios)}"
        )


if __name__ == "__main__":
    main()
