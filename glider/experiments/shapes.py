"""What the choice of an effect's shape costs its explanation.

Where an effect's shape is fitted, the best of many shapes was chosen, and noise alone
makes the best of many good. Beforehand each of the library's starting shapes s is as
probable as the next, and each stands for those around it, so that an effect is worth
    log mean_s exp E_s
of the evidence E_s with that shape, in closed form; around the fitted shape it is that
of the fit. An effect that shows well pays log(number of shapes), one that hardly does
is worth what its shapes are worth on average.
"""

import numpy as np

from glider.sysid.likelihood.candidates import tamed
from glider.sysid.likelihood.directions import nearest_start, slopes, starts_of
from glider.sysid.likelihood.evidence import Evidence, eliminate
from glider.sysid.likelihood.model_fit import FitResult, grams_of, linear_flights
from glider.sysid.likelihood.task import Task


def choice_of_shapes(task: Task, model: FitResult) -> float:
    """Returns the log of how much less a model is worth for its chosen shapes [nats].

    Args:
        task: the flights.
        model: fitted to them.
    """
    return sum(_choice(task, model, kind) for kind in model.kinds)


def _choice(task: Task, model: FitResult, kind: str) -> float:
    layout = task.layout
    own = layout.slots_of(kind)
    shapes = [i for i in own if task.is_shape(i)]
    sizes = [i for i in own if i in model.free and i not in shapes]
    if not shapes or not sizes:
        return 0.0
    others = [i for i in model.free if i not in own]
    starts = [
        [d for d in columns if d.slot in sizes]
        for columns in starts_of(layout, layout.kinds[kind], model.theta)
    ]
    directions = slopes(layout, model.theta, [*sizes, *others])
    directions += [d for columns in starts for d in columns]
    flights, wild = tamed(task, directions, linear_flights(task, model, directions))
    gram = np.sum(grams_of(flights, model.scales), axis=0)

    # The error of the model without the effect, the others fitted to it.
    count, end = len(sizes), len(sizes) + len(others)
    mean, precision = task.priors([*sizes, *others], model.theta)
    restored = np.zeros(len(gram))
    restored[:count] = model.theta[sizes] - mean[:count]
    restored[-1] = 1.0
    gram[:, -1] = gram @ restored
    gram[-1, -1] = gram[:, -1] @ restored
    gram[-1, :-1] = gram[:-1, -1]
    change = mean[count:] - model.theta[others]
    variants = 1 + len(starts)
    evidence = Evidence(
        gram=eliminate(gram, range(count, end), precision[count:], change),
        precision=np.tile(precision[:count], variants),
        lower=np.tile(layout.lower[sizes] - mean[:count], variants),
        upper=np.tile(layout.upper[sizes] - mean[:count], variants),
    )
    fitted, *told = (
        evidence.log_marginal(range(k * count, (k + 1) * count))
        for k in range(variants)
    )
    if not np.isfinite(fitted):
        return 0.0
    nearest = nearest_start(layout, starts, model.theta)
    worth = np.exp(np.minimum(np.array(told) - fitted, 0.0))
    worth[nearest] = 1.0  # Around the fitted shape.
    columns = np.arange(end, end + len(worth) * count).reshape(-1, count)
    sound = [wild.isdisjoint(own) for own in columns.tolist()]
    sound[nearest] = True
    return float(np.log(np.mean(worth[sound])))
