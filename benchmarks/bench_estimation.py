"""Times the extended Kalman filter.

Prints processor times; run it on an otherwise idle machine.

    python -m benchmarks.bench_estimation
"""

import os

import numpy as np

from benchmarks.bench_control import best_seconds
from benchmarks.estimated_perches import fly_on_estimate
from glider.estimation.ekf import make_ekf
from glider.estimation.perching import CAPTURE, LAUNCH_STD, PROCESS, perching_filter
from glider.estimation.running import make_prior, predict_mean, run_ekf
from tests.helpers.filter_consistency import UNCERTAIN, watch_perches
from tests.helpers.flights import NOMINAL, PROBLEM, plan_of, policy
from tests.helpers.noisy_flights import draw_starts, fly_watched


def main():
    print(f"load {os.getloadavg()[0]:.2f} (1 minute)")
    rng, samples = np.random.default_rng(0), 100
    tape = 2.0 * np.sin(np.arange(samples) / 8.0)[:, None]
    full = make_ekf(
        NOMINAL, rate=CAPTURE.rate, process=PROCESS, noise=[1e-4] * 7, slow=UNCERTAIN
    )
    rich, _ = perching_filter(NOMINAL, PROBLEM.launch, slow=UNCERTAIN)
    print("\nA step of the filter: prediction and correction; x̄ has N numbers")
    for name, ekf in (
        ("N 9, 7 measured", full),
        ("N 7, 4 measured", perching_filter(NOMINAL, PROBLEM.launch)[0]),
        ("N 9, 4 measured", rich),
    ):
        prior = make_prior(ekf, PROBLEM.launch, LAUNCH_STD)
        flight = fly_watched(ekf, draw_starts(prior, 20, rng), tape, rng)

        def run(ekf=ekf, prior=prior, flight=flight):
            return run_ekf(ekf, prior, flight.inputs, flight.measured)

        seconds = best_seconds(run, 20) / (20 * samples)
        print(f"  {name:26s} {1e6 * seconds:6.2f} us")
    single = flight.inputs[:1, :1], flight.measured[:1, :1]
    calls = {
        "one step, from Python": lambda: run_ekf(ekf, prior, *single),
        "mean only, from Python": lambda: predict_mean(
            ekf, prior.mean, tape[0], ekf.period
        ),
    }
    for name, call in calls.items():
        seconds = best_seconds(lambda c=call: [c() for _ in range(200)], 10) / 200
        print(f"  {name:26s} {1e6 * seconds:6.2f} us")

    seen = watch_perches(NOMINAL, policy(), 200, rng).consistency
    print("\n200 perches: mean normalized squared errors, 1 is right")
    print(f"  NEES {np.mean(seen.nees):.3f}, NIS {np.mean(seen.nis):.3f}")

    starts = PROBLEM.draw_launches(50, rng)
    flown = fly_on_estimate(NOMINAL, plan_of(), starts, rng)
    print("\n50 launches of the article's plan, 1 mm of noise, TVLQR")
    for name, flights in (("state", flown.on_state), ("estimate", flown.on_estimate)):
        print(
            f"  on the {name:10s} {flights.describe()}; largest miss "
            f"{1e3 * flights.worst.miss:.2f} mm"
        )


if __name__ == "__main__":
    main()
