"""What flights have of their own, and its mean over all of them."""

import dataclasses

import numpy as np

from glider.sysid.likelihood.model_fit import FitResult, error_flights
from glider.sysid.likelihood.scales import OWN_VALUES, own_values
from glider.sysid.search.fits import Search


def with_means(search: Search, model: FitResult) -> FitResult:
    """Returns a model with what flights have of their own, where its mean is not zero.

    To first order a spread that took up the mean hides it; both are fitted anew.
    """
    task = search.task
    flights = error_flights(task, model)
    own = own_values(flights, model.scales)
    mean, error = own.mean(axis=0), own.std(axis=0) / np.sqrt(len(own))
    is_off = np.abs(mean) > OFF * error
    for kind, places in OWN_VALUES.items():
        slots = {task.layout.index[kind, name]: k for name, k in places.items()}
        is_free = bool(set(slots) & set(model.free))
        if kind not in task.kinds or is_free or not is_off[list(slots.values())].any():
            continue
        theta = model.theta.copy()
        for slot, place in slots.items():
            theta[slot] += mean[place]
        kinds = (*model.kinds, kind)
        if model.extra is None and frozenset(kinds) in search.fitted:
            continue
        search.progress(f"{kind} in all flights?")
        other = dataclasses.replace(
            model, kinds=kinds, theta=theta, free=task.free(kinds)
        )
        other = search.fit_with_strength(other, iterations=4)
        if search.price(other) < search.price(model):
            model = other
    return model


OFF = 5.0
"""Standard errors by which a mean over flights is off zero."""
