"""Times the dynamics: the plant by AutoDiffXd, and compiled rollouts.

Prints ratios and rates on one core; run it on an otherwise idle machine.

    python -m benchmarks.bench_dynamics
"""

import os
import time

import numpy as np
from pydrake.autodiffutils import InitializeAutoDiff

from glider.compiled.flight import fly_tapes
from glider.physics.effects import LIBRARY, PROFILE_DRAG, SERVO_LAG
from glider.physics.model import GliderModel
from glider.systems.plant import GliderPlant

STATE = np.array([-3.5, 0.1, -0.3, 0.1, 7.0, 0.0, 0.5])


def best_seconds(function, calls, rounds=20):
    """Returns the seconds of a call in the fastest of some rounds."""
    function()
    best = np.inf
    for _ in range(rounds):
        start = time.process_time()
        for _ in range(calls):
            function()
        best = min(best, time.process_time() - start)
    return best / calls


def autodiff_seconds(model, fast):
    """Returns the seconds of an evaluation with derivatives by state and input."""
    plant = GliderPlant(model, fast=fast)
    x = model.initial_state(STATE)
    ad = InitializeAutoDiff(np.append(x, 5.0)).ravel()
    twin = plant.ToAutoDiffXd()
    context = twin.CreateDefaultContext()
    rate = twin.GetInputPort("elevator_rate").FixValue(context, ad[-1:])
    derivatives = twin.AllocateTimeDerivatives()

    def evaluate():
        rate.GetMutableData()  # A new input, as an optimizer's.
        context.SetContinuousState(ad[:-1])
        twin.CalcTimeDerivatives(context, derivatives)

    return best_seconds(evaluate, 100)


def flights_per_second(effects, order, batch=10_000, steps=75):
    """Returns how many flights of that many steps a core makes in a second."""
    model = GliderModel(effects=effects)
    start = np.tile(model.initial_state(STATE), (batch, 1))
    command = np.random.default_rng(0).uniform(-5, 5, (batch, steps))
    seconds = best_seconds(lambda: fly_tapes(model, start, command, 0.01, order), 1, 10)
    return batch / seconds


def main():
    print(f"load {os.getloadavg()[0]:.2f} (1 minute)")
    print("\nAutoDiffXd evaluation by state and input: compiled / plain")
    drag = (PROFILE_DRAG(cd0=0.05),)
    library = tuple(
        k(**{c.name: c.scale}) if k.stage == "actuator" else k()
        for k in LIBRARY
        for c in k.coefficients[:1]
    )
    for name, effects in (("nominal", ()), ("drag", drag), ("library", library)):
        model = GliderModel(effects=effects)
        fast, plain = autodiff_seconds(model, True), autodiff_seconds(model, False)
        times = f"{1e6 * fast:.0f} / {1e6 * plain:.0f} us"
        print(f"  {name:10s} {fast / plain:5.2f}   ({times})")

    print("\nFlights per second and core, 10,000 flights of 75 steps")
    lag = (SERVO_LAG(time_constant=0.03),)
    for name, effects in (("nominal", ()), ("drag", drag), ("servo_lag", lag)):
        for order, method in ((1, "Euler"), (4, "Runge-Kutta")):
            print(
                f"  {name:10s} {method:12s} {flights_per_second(effects, order):9,.0f}"
            )


if __name__ == "__main__":
    main()
